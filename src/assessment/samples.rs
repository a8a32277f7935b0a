//! The rollouts of all samples, by any number of threads: ranges of them are independent, and are put together in order.

use super::{AssessInput, EndError, error};
use crate::motion::Undisturbed;
use crate::robot::State;
use crate::solver::{REPLAY_EXCESS, RunControl, in_parts};
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

/// The outcomes of all samples, in their order.
pub(super) fn outcomes(
    input: &AssessInput,
    (driven, target): (&Undisturbed, &State),
    control: &RunControl,
) -> Result<Vec<Outcome>, Stopped> {
    let outcome_of = |sample: usize, stop: Stop| -> Result<Outcome, Stopped> {
        let Ok(motion) = driven.under(&input.changes(sample)) else { return Ok(None) };
        let (end, separations, uses) = motion.end_with_limits(&input.limits(&motion), stop)?;
        // Not a number is an excess too.
        let exceeded = uses.iter().enumerate().filter(|(_, used)| used.excess > REPLAY_EXCESS || used.excess.is_nan());
        let exceeded = exceeded.fold(0, |bits, (index, _)| bits | 1 << index);
        Ok(Some(Ended { error: error(target, &end), separates: separations > 0, exceeded }))
    };
    let of_range = |range: usize, stop: Stop| {
        let samples = range * RANGE..((range + 1) * RANGE).min(input.sample_count);
        samples.map(|sample| outcome_of(sample, stop)).collect::<Result<Vec<_>, _>>().ok()
    };
    let ranges = in_parts(control, input.sample_count.div_ceil(RANGE), &of_range);
    Ok(ranges.into_iter().collect::<Option<Vec<_>>>().ok_or(Stopped)?.concat())
}
