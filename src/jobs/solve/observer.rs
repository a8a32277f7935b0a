//! What a running solve reports: its progress, its phases as spans, and when its search ended.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Instant;

use tracing::Span;

use crate::contract::message::SearchPhase;
use crate::service::JobControl;
use crate::solver::{Phase, ProgressObserver, SolveProgress};

/// The best iterate of a running solve, and what the search does.
#[derive(Debug, Clone, Copy)]
pub struct Progressed {
    pub(super) best: SolveProgress,
    pub(super) phase: SearchPhase,
}

/// Keeps the latest progress for whoever asks, when the search ended, and a span per running phase.
pub(super) struct SolveObserver<'a> {
    control: &'a JobControl<'a, Progressed>,
    pub(super) search_end: OnceLock<Instant>,
    latest: Mutex<(Option<SolveProgress>, SearchPhase)>,
    phases: Mutex<Vec<(Phase, Span)>>,
}

impl<'a> SolveObserver<'a> {
    pub(super) fn new(control: &'a JobControl<'a, Progressed>) -> Self {
        let latest = Mutex::new((None, SearchPhase::Start));
        Self { control, search_end: OnceLock::new(), latest, phases: Mutex::default() }
    }

    /// Reports what is new together with what is known; nothing before there is an iterate.
    fn report(&self, best: Option<SolveProgress>, phase: SearchPhase) {
        let mut latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        *latest = (best.or(latest.0), phase.max(latest.1));
        if let (Some(best), phase) = *latest {
            self.control.report(Progressed { best, phase });
        }
    }

    fn span_of(&self, phase: Phase) -> Span {
        match phase {
            Phase::Start { number } => tracing::info_span!(parent: self.control.span(), "start", start.number = number),
            Phase::Polish => tracing::info_span!(parent: self.control.span(), "polish"),
            Phase::Refinement => tracing::info_span!(parent: self.control.span(), "refinement"),
            Phase::Certificate => tracing::info_span!(parent: self.control.span(), "certificate"),
        }
    }
}

fn search_phase(phase: Phase) -> SearchPhase {
    match phase {
        Phase::Start { .. } => SearchPhase::Start,
        Phase::Polish => SearchPhase::Polish,
        Phase::Refinement => SearchPhase::Refinement,
        Phase::Certificate => SearchPhase::Certificate,
    }
}

impl ProgressObserver for SolveObserver<'_> {
    fn progress(&self, progress: &SolveProgress) {
        self.report(Some(*progress), SearchPhase::Start);
    }

    fn begins(&self, phase: Phase) {
        if phase == Phase::Certificate {
            self.search_end.get_or_init(Instant::now);
        }
        self.report(None, search_phase(phase));
        let span = self.span_of(phase);
        self.phases.lock().unwrap_or_else(PoisonError::into_inner).push((phase, span));
    }

    fn ends(&self, phase: Phase) {
        let mut phases = self.phases.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(position) = phases.iter().position(|(running, _)| *running == phase) {
            phases.swap_remove(position);
        }
    }
}
