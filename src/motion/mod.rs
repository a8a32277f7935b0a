//! Motions of given torques: as they are asked for, under changes of what they were made for, compared with what they must keep.

mod disturbed;
mod limit_uses;
mod schedule_check;
mod sensitivity;
mod simulate;

pub use disturbed::{ChangedParameter, Disturbed, Undisturbed};
pub use limit_uses::LimitUse;
pub use sensitivity::{EndShift, Sensitivity};
pub use simulate::{SimulateInput, SimulateParameters, Simulation, simulate};

pub(crate) use limit_uses::{limit_uses, most_exceeded, motion_with_limits};
pub(crate) use schedule_check::{TIME_RULE, check_schedule, rules_of_schedule};
pub(crate) use sensitivity::{finite_or_largest, friction_shift, sensitivity};

/// The paper's number of steps.
pub const PAPER_STEP_COUNT: usize = 200;
/// Most steps of a plan, unless a caller of the library says otherwise.
pub const STEP_LIMIT: usize = 10_000;

/// What is smaller, in its unit or as a share of what it is compared with, counts as none, and no tolerance may be tighter: a rollout
/// of thousands of steps rounds to about 1e-12.
pub(crate) const ROUNDING: f64 = 1e-9;

/// The steps where nobody asks for a number: the paper's, or the next one on which all control intervals are equally long. On other
/// grids the steps' midpoints favour some intervals, and finer grids would see other torques. A search begins with more where the
/// robot needs them to keep its course.
pub fn first_step_count(control_count: usize) -> usize {
    PAPER_STEP_COUNT.checked_next_multiple_of(control_count).unwrap_or(PAPER_STEP_COUNT)
}
