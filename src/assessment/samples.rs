//! The rollouts of all samples, by any number of threads: ranges of them are independent, and are put together in order.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::{AssessInput, EndError, error};
use crate::robot::State;
use crate::solver::{CancelOnPanic, REPLAY_EXCESS, RunControl, SharedWork, Undisturbed};
use crate::stop::{Stop, Stopped};

/// Samples of a range: some milliseconds, which are lost when a helper is recalled.
const RANGE: usize = 16;

/// How a sample ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ended {
    pub(super) error: EndError,
    /// Whether a contact lifts.
    pub(super) separates: bool,
    /// A bit for each limit that is exceeded, in their order.
    pub(super) exceeded: u32,
}

/// Nothing where the rules refuse the changes.
pub(super) type Outcome = Option<Ended>;

/// All samples of one assessment.
pub(super) struct Samples<'a> {
    input: &'a AssessInput,
    driven: &'a Undisturbed,
    target: &'a State,
    control: &'a RunControl<'a>,
    ranges: Mutex<Vec<Range>>,
    /// Set when a range panics: the others are no longer needed.
    is_cancelled: AtomicBool,
}

enum Range {
    Open,
    UnderWay,
    Done(Vec<Outcome>),
}

impl<'a> Samples<'a> {
    pub(super) fn new(
        input: &'a AssessInput,
        (driven, target): (&'a Undisturbed, &'a State),
        control: &'a RunControl<'a>,
    ) -> Self {
        let ranges = (0..input.sample_count.div_ceil(RANGE)).map(|_| Range::Open).collect();
        Self { input, driven, target, control, ranges: Mutex::new(ranges), is_cancelled: AtomicBool::new(false) }
    }

    /// The outcomes in the order of the samples.
    pub(super) fn outcomes(self) -> Result<Vec<Outcome>, Stopped> {
        self.control.share(&self);
        let ranges = self.ranges.into_inner().unwrap_or_else(PoisonError::into_inner);
        let done = |range: Range| match range {
            Range::Done(outcomes) => Ok(outcomes),
            Range::Open | Range::UnderWay => Err(Stopped),
        };
        Ok(ranges.into_iter().map(done).collect::<Result<Vec<_>, _>>()?.concat())
    }

    fn ranges(&self) -> MutexGuard<'_, Vec<Range>> {
        self.ranges.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_over(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed) || self.control.is_stopped()
    }

    fn run(&self, range: usize, stop: Stop) -> Result<Vec<Outcome>, Stopped> {
        let samples = range * RANGE..((range + 1) * RANGE).min(self.input.sample_count);
        samples.map(|sample| self.outcome(sample, stop)).collect()
    }

    fn outcome(&self, sample: usize, stop: Stop) -> Result<Outcome, Stopped> {
        let Ok(motion) = self.driven.under(&self.input.changes(sample)) else { return Ok(None) };
        let (end, separations, uses) = motion.end_with_limits(&self.input.limits(&motion), stop)?;
        // Not a number is an excess too.
        let exceeded = uses.iter().enumerate().filter(|(_, used)| used.excess > REPLAY_EXCESS || used.excess.is_nan());
        let exceeded = exceeded.fold(0, |bits, (index, _)| bits | 1 << index);
        Ok(Some(Ended { error: error(self.target, &end), separates: separations > 0, exceeded }))
    }
}

impl SharedWork for Samples<'_> {
    fn open_parts(&self) -> usize {
        if self.is_over() {
            return 0;
        }
        self.ranges().iter().filter(|range| matches!(range, Range::Open)).count()
    }

    fn take_part(&self, recalled: &AtomicBool) -> bool {
        if self.is_over() || recalled.load(Ordering::Relaxed) {
            return false;
        }
        let index = {
            let mut ranges = self.ranges();
            let Some(index) = ranges.iter().position(|range| matches!(range, Range::Open)) else { return false };
            ranges[index] = Range::UnderWay;
            index
        };
        let alarm = CancelOnPanic::new(&self.is_cancelled);
        let outcomes = self.run(index, self.control.stop().interrupted_by([&self.is_cancelled, recalled]));
        alarm.disarm();
        self.ranges()[index] = outcomes.map_or(Range::Open, Range::Done);
        true
    }
}
