//! What a running solve reports: its progress, its phases as spans, and when its search ended.

use std::sync::{Mutex, PoisonError};

use tracing::Span;

use super::finishing::SearchEnd;
use crate::service::JobControl;
use crate::solver::{Helpers, Phase, ProgressObserver, SharedWork, SolveProgress};

/// Keeps the latest progress for whoever asks, when the search ended, and a span per running phase; lends idle workers.
pub(super) struct SolveObserver<'a> {
    control: &'a JobControl<'a, SolveProgress>,
    pub(super) search_end: SearchEnd,
    phases: Mutex<Vec<(Phase, Span)>>,
}

impl<'a> SolveObserver<'a> {
    pub(super) fn new(control: &'a JobControl<'a, SolveProgress>) -> Self {
        Self { control, search_end: SearchEnd::default(), phases: Mutex::default() }
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

impl ProgressObserver for SolveObserver<'_> {
    fn progress(&self, progress: &SolveProgress) {
        self.control.report(*progress);
    }

    fn begins(&self, phase: Phase) {
        if phase == Phase::Certificate {
            self.search_end.mark();
        }
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

impl Helpers for SolveObserver<'_> {
    fn share(&self, work: &dyn SharedWork) {
        self.control.share(&|| work.open_parts(), &|is_recalled| work.take_part(is_recalled));
    }
}
