//! How often a plan succeeds where robot, torques and start are known up to a distribution only, and how wrong its end is.
//!
//! Each sample is one rollout of the torques by Coulomb's law under changes of its own. Ends are compared at the axle midpoint with
//! the goal, or with the plan's own end where nothing is asked of it.

mod draw;
mod samples;
mod statistics;

pub use draw::Distribution;
pub use statistics::FEWEST_FOR_SHARES;

use std::iter::successors;

use samples::Outcome;

use crate::motion::{ChangedParameter, Disturbed, LimitUse, STEP_LIMIT, Undisturbed};
use crate::robot::State;
use crate::shooting::{Aisle, Goal, Maneuver, ManeuverLimits, PathLimits, ReferencePoint, wrapped_angle};
use crate::solver::{REPLAY_REFINEMENT, RunControl};
use crate::stop::{Stop, Stopped};

/// Shares of the samples at which quantiles are given; the last is the largest of all.
pub const QUANTILES: [f64; 6] = [0.05, 0.25, 0.5, 0.75, 0.95, 1.0];
/// Most steps of all samples together: finer grids are not tried.
pub const MOST_STEPS: f64 = 2e7;

/// How far an end is from where it should be: along and across the heading there, m (forward and left), the distance, m, the
/// heading modulo 2 pi, rad, and the speed, m/s, which is the magnitude of the difference of the velocities.
pub type EndError = [f64; 5];

/// What a plan is compared with its limits by.
#[derive(Debug, Clone)]
pub enum Limited {
    /// What a maneuver asks.
    Maneuver(Box<Maneuver>),
    /// What a motion is compared with.
    Motion(ReferencePoint, ManeuverLimits),
}

/// What is assessed.
#[derive(Debug, Clone)]
pub struct AssessInput {
    /// The motion of the robot that the plan was made for.
    pub planned: Undisturbed,
    /// The same of the robot that is to drive it.
    pub driven: Undisturbed,
    /// Where the plan should end, at the reference point; what it leaves free is that of the plan's own end.
    pub goal: Option<Goal>,
    /// The limits on the way.
    pub limited: Limited,
    /// Where the robot must stay.
    pub aisle: Option<Aisle>,
    /// What is not known.
    pub uncertain: Vec<(ChangedParameter, Distribution)>,
    /// Largest magnitude of each error.
    pub tolerances: [Option<f64>; 5],
    /// How many samples.
    pub sample_count: usize,
    /// Seed of all randomness.
    pub seed: u64,
}

/// What comes out.
#[derive(Debug, Clone)]
pub struct Assessment {
    /// How many samples.
    pub sample_count: usize,
    /// Samples within all tolerances in which no contact lifts.
    pub success_count: usize,
    /// Wilson's interval of 95 % of their share, (low, high).
    pub interval: (f64, f64),
    /// Samples whose changes break the rules: they fail.
    pub refused_count: usize,
    /// Samples in which a contact lifts: they fail.
    pub separated_count: usize,
    /// Where it was rolled out.
    pub grid: AssessedGrid,
    /// The motion without changes there.
    pub nominal: Nominal,
    /// Mean errors, signed.
    pub mean: EndError,
    /// Magnitudes of the errors at each of [`QUANTILES`]; infinite where motions diverge.
    pub quantiles: [EndError; QUANTILES.len()],
    /// The share of each parameter in the variance of each error.
    pub shares: Vec<ParameterShares>,
    /// How many samples exceed each limit.
    pub excesses: Vec<LimitExcess>,
    /// The worst sample; none where all are refused.
    pub worst: Option<WorstSample>,
}

/// The grid of the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AssessedGrid {
    /// Number of steps, delays aside.
    pub step_count: usize,
    /// How many times that of the plan it is.
    pub factor: usize,
}

/// The motion without changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nominal {
    /// Its errors.
    pub error: EndError,
    /// Whether a contact lifts.
    pub separates: bool,
    /// Whether it is a success.
    pub is_success: bool,
}

/// First-order Sobol shares of one parameter; NaN where too few samples or no variance are there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterShares {
    /// The parameter.
    pub parameter: ChangedParameter,
    /// Its share in the variance of each error, the signed ones as they are.
    pub shares: EndError,
}

/// How often a limit is exceeded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitExcess {
    /// The field of a solve.
    pub limit: &'static str,
    /// What is allowed, in the unit of the field.
    pub value: f64,
    /// Samples that use more than 0.5 % more.
    pub sample_count: usize,
}

/// The sample with the largest error for its tolerance; one that leaves the model before all others.
#[derive(Debug, Clone)]
pub struct WorstSample {
    /// Its number, from 0.
    pub index: usize,
    /// Its changes.
    pub changes: Vec<(ChangedParameter, f64)>,
    /// Its errors.
    pub error: EndError,
    /// Its largest error as a multiple of the tolerance; infinite where the motion diverges.
    pub relative_error: f64,
    /// Whether a contact lifts.
    pub separates: bool,
    /// Its motion, as a simulation can be asked for it.
    pub motion: Disturbed,
}

impl AssessInput {
    /// Steps of a rollout on the plan's grid, with the longest delay that is to be expected.
    pub fn expected_steps(&self) -> f64 {
        self.driven.steps_under_delay(self.longest_delay())
    }

    /// Whether samples are compared with limits.
    pub fn has_limits(&self) -> bool {
        !self.limits(&self.driven.unchanged()).is_empty()
    }

    fn longest_delay(&self) -> f64 {
        let is_delay = |parameter| matches!(parameter, ChangedParameter::DelayLeft | ChangedParameter::DelayRight);
        let delays = self.uncertain.iter().filter(|(parameter, _)| is_delay(*parameter));
        delays.map(|(_, distribution)| distribution.largest()).fold(0.0, f64::max)
    }

    fn changes(&self, sample: usize) -> Vec<(ChangedParameter, f64)> {
        let of = |&(parameter, distribution): &(ChangedParameter, Distribution)| {
            (parameter, distribution.draw(self.seed, sample, parameter))
        };
        self.uncertain.iter().map(of).collect()
    }

    fn limits(&self, motion: &Disturbed) -> PathLimits {
        let (payload, aisle) = (motion.payload.as_ref(), self.aisle.as_ref());
        match &self.limited {
            Limited::Maneuver(maneuver) => PathLimits::of_maneuver(&motion.robot, maneuver, payload, aisle),
            Limited::Motion(point, limits) => PathLimits::new(&motion.robot, (limits, *point), payload, aisle),
        }
    }

    /// Where the plan should end, at the axle midpoint.
    fn target(&self, stop: Stop) -> Result<State, Stopped> {
        let from_axle = self.planned.from_axle;
        let (end, _) = self.planned.unchanged().end(stop)?;
        let mut wanted = end.moved_by(from_axle).to_vector();
        for (component, value) in self.goal.iter().flat_map(Goal::constrained) {
            wanted[component.index()] = value;
        }
        Ok(State::from_vector(&wanted).moved_by(-from_axle))
    }

    /// The largest error as a multiple of its tolerance; infinite where one is not a number.
    fn relative(&self, error: &EndError) -> f64 {
        let relative = |(error, tolerance): (&f64, &Option<f64>)| Some(error.abs() / (*tolerance)?);
        let errors = error.iter().zip(&self.tolerances).filter_map(relative);
        let largest = errors.fold(0.0, f64::max);
        if error.iter().all(|error| error.is_finite()) { largest } else { f64::INFINITY }
    }

    fn is_success(&self, error: &EndError, separates: bool) -> bool {
        !separates && self.relative(error) <= 1.0
    }
}

/// From where an end should be to where it is, both at the axle midpoint.
fn error(target: &State, end: &State) -> EndError {
    let (wanted, reached) = (target.configuration, end.configuration);
    let (x, y) = (reached.x - wanted.x, reached.y - wanted.y);
    let (sin, cos) = wanted.heading.sin_cos();
    let speed = (end.velocity.x - target.velocity.x).hypot(end.velocity.y - target.velocity.y);
    [cos * y - sin * x, -cos * x - sin * y, x.hypot(y), wrapped_angle(reached.heading - wanted.heading), speed]
}

/// Samples a plan under all that is not known of it; the answer does not depend on the helpers of the control.
///
/// # Errors
/// When the control stops it.
pub fn assess(input: &AssessInput, control: &RunControl) -> Result<Assessment, Stopped> {
    let target = input.target(control.stop())?;
    let (grid, nominal) = grid(input, &target, control.stop())?;
    let driven = Undisturbed { step_count: grid.step_count, ..input.driven.clone() };
    let unchanged = driven.unchanged();
    let (_, _, limits) = unchanged.end_with_limits(&input.limits(&unchanged), control.stop())?;
    let outcomes = samples::outcomes(input, (&driven, &target), control)?;
    let ended: Vec<_> = outcomes.iter().flatten().collect();
    let success_count = ended.iter().filter(|sample| input.is_success(&sample.error, sample.separates)).count();
    let errors = |which: usize| ended.iter().map(move |sample| sample.error[which]);
    let magnitudes: [Vec<f64>; 5] = std::array::from_fn(|which| {
        // What is not a number has diverged as what is infinite.
        let magnitude = |error: f64| if error.is_finite() { error.abs() } else { f64::INFINITY };
        let mut ascending: Vec<f64> = errors(which).map(magnitude).collect();
        ascending.sort_by(f64::total_cmp);
        ascending
    });
    let exceeding = |index: usize| ended.iter().filter(|sample| sample.exceeded & (1 << index) != 0).count();
    let excess = |(index, used): (usize, &LimitUse)| LimitExcess {
        limit: used.limit,
        value: used.value,
        sample_count: exceeding(index),
    };
    Ok(Assessment {
        sample_count: input.sample_count,
        success_count,
        interval: statistics::wilson(success_count, input.sample_count),
        refused_count: outcomes.len() - ended.len(),
        separated_count: ended.iter().filter(|sample| sample.separates).count(),
        grid,
        nominal,
        mean: std::array::from_fn(|which| errors(which).sum::<f64>() / ended.len() as f64),
        quantiles: QUANTILES.map(|share| std::array::from_fn(|which| statistics::quantile(&magnitudes[which], share))),
        shares: shares(input, &outcomes),
        excesses: limits.iter().enumerate().map(excess).collect(),
        worst: worst(input, &driven, &outcomes),
    })
}

/// The first grid, up to that of a replay, on which the motion without changes is a success, else the finest.
fn grid(input: &AssessInput, target: &State, stop: Stop) -> Result<(AssessedGrid, Nominal), Stopped> {
    let expected = input.expected_steps();
    let is_within = |factor: usize| {
        let steps = expected * factor as f64;
        steps <= STEP_LIMIT as f64 && steps * input.sample_count as f64 <= MOST_STEPS
    };
    let mut tried = None;
    let factors = successors(Some(1), |factor| Some(2 * factor)).take_while(|factor| *factor <= REPLAY_REFINEMENT);
    for factor in factors.filter(|&factor| factor == 1 || is_within(factor)) {
        let step_count = factor * input.driven.step_count;
        let driven = Undisturbed { step_count, ..input.driven.clone() };
        let (end, separations) = driven.unchanged().end(stop)?;
        let (error, separates) = (error(target, &end), separations > 0);
        let nominal = Nominal { error, separates, is_success: input.is_success(&error, separates) };
        tried = Some((AssessedGrid { step_count, factor }, nominal));
        if nominal.is_success {
            break;
        }
    }
    Ok(tried.expect("the plan's own grid is tried"))
}

/// Shares from the samples whose motions do not diverge.
fn shares(input: &AssessInput, outcomes: &[Outcome]) -> Vec<ParameterShares> {
    let is_finite = |error: &EndError| error.iter().all(|error| error.is_finite());
    let ended = |outcome: &Outcome| outcome.as_ref().map(|sample| sample.error).filter(is_finite);
    let (numbers, errors): (Vec<usize>, Vec<EndError>) =
        outcomes.iter().enumerate().filter_map(|(index, outcome)| Some((index, ended(outcome)?))).unzip();
    let of = |&(parameter, distribution): &(ChangedParameter, Distribution)| {
        let causes: Vec<f64> = numbers.iter().map(|&sample| distribution.draw(input.seed, sample, parameter)).collect();
        let share = |which: usize| {
            let values: Vec<f64> = errors.iter().map(|error| error[which]).collect();
            statistics::share_of_variance(&causes, &values)
        };
        ParameterShares { parameter, shares: std::array::from_fn(share) }
    };
    input.uncertain.iter().map(of).collect()
}

/// The first of the worst.
fn worst(input: &AssessInput, driven: &Undisturbed, outcomes: &[Outcome]) -> Option<WorstSample> {
    let mut worst: Option<(usize, (bool, f64))> = None;
    for (index, sample) in outcomes.iter().enumerate().filter_map(|(index, sample)| Some((index, sample.as_ref()?))) {
        let badness = (sample.separates, input.relative(&sample.error));
        if worst.is_none_or(|(_, known)| badness > known) {
            worst = Some((index, badness));
        }
    }
    let (index, (separates, relative_error)) = worst?;
    let changes = input.changes(index);
    let motion = driven.under_as_asked(&changes).ok()?;
    let error = outcomes[index].as_ref()?.error;
    Some(WorstSample { index, changes, error, relative_error, separates, motion })
}

#[cfg(test)]
mod tests;
