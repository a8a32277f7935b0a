//! The starts of the search: bang-bang legs that would reach the goal if the wheels rolled without slip.
//!
//! A maneuver from rest to rest is a turn, a drive and a turn, each with full effort and full braking. Forwards and
//! backwards, either way round, gives several such plans; there and back again in two directions moves a robot aside by little.
//! A moving start brakes first, a moving goal accelerates last.
//! These are only first guesses: they neglect slip, the shift of normal forces and the centre of mass ahead of the axle.

mod rolling;
mod routes;
mod spins;

use std::f64::consts::TAU;
use std::iter::repeat_n;

use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use rolling::{AMPLITUDES, Rolling};
use routes::rolling_plans;
use spins::Spins;

use super::segments::{or_coasting, resampled, schedule_from_segments};
use super::settings::{Method, SolveInput};
use crate::robot::PerWheel;
use crate::shooting::{StateComponent, wrapped_angle};
use crate::simulation::TorqueSchedule;

/// A first guess, with the winding of the goal heading that it aims at.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Start {
    pub(super) schedule: TorqueSchedule,
    /// The goal heading, or none where it is free.
    pub(super) goal_heading: Option<f64>,
    pub(super) strategy: Strategy,
}

/// The strategy from a start to a local optimum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Strategy {
    /// As [`Strategy::Direct`] with the least effort: the start is the plan of a similar maneuver.
    Warm,
    /// Under the exact friction law at once: to the nearest local optimum, the paper's family on the paper's case.
    Direct,
    /// Through smoothed laws: slower, and often to a much better local optimum.
    Smoothed,
    /// From the second of these on: the first one merges optima, and which of them it leads to is not always the best.
    Sharper,
}

/// Plans that are tried with spins: the fastest ones.
const SPUN_PLANS: usize = 2;
/// Coasting times: the time to the goal at the speed of the start times powers of two, up to so many.
const COASTING_DOUBLINGS: i32 = 4;
/// One in so many: a round of spins has one for so many starts, one optimum for so many is polished, one start in so many begins under
/// the second law, and one, of those with the worst merits, is left out of the thorough heats.
pub(super) const ONE_IN: usize = 3;

/// The first starts of a search, at most `count`, in the order in which they are tried: the caller's guess, the fastest
/// plan directly and through smoothing, then the other plans in turn with spins drawn at random.
pub(super) fn starts(input: &SolveInput, count: usize) -> Vec<Start> {
    let guess = input.initial_guess.iter().map(|guess| Start {
        schedule: resampled(guess, input.settings.control_count),
        goal_heading: input.maneuver.nearest_goal_heading(),
        strategy: Strategy::Warm,
    });
    let mut starts: Vec<Start> = guess.collect();
    if starts.len() >= count {
        return starts;
    }
    let is_nelder_mead = input.settings.method == Method::NelderMead;
    if input.maneuver.torque_limit == PerWheel::new(0.0, 0.0) {
        starts.extend(coasting(input));
    } else if is_nelder_mead {
        starts.push(straight(input));
    } else {
        let plans = rolling_plans(input);
        starts.push(Start { strategy: Strategy::Direct, ..plans[0].clone() });
        starts.push(plans[0].clone());
        let mut others = plans.iter().skip(1);
        let mut spun = plans.iter().take(SPUN_PLANS).cycle().map(spinning(input, 0));
        while starts.len() < count {
            starts.extend(others.next().cloned());
            starts.extend(spun.next());
        }
    }
    starts.truncate(if is_nelder_mead { 1 } else { count });
    sharpen(&mut starts);
    starts
}

/// So many spins of a plan, drawn from a stream of their own.
pub(super) fn spun(input: &SolveInput, plan: &Start, (count, stream): (usize, u64)) -> Vec<Start> {
    let mut starts: Vec<_> = repeat_n(plan, count).map(spinning(input, stream)).collect();
    sharpen(&mut starts);
    starts
}

/// One smoothed start in three, but not the first, begins under the second law.
fn sharpen(starts: &mut [Start]) {
    let smoothed = starts.iter_mut().filter(|start| start.strategy == Strategy::Smoothed);
    let chosen = smoothed.skip(ONE_IN - 1).step_by(ONE_IN);
    chosen.for_each(|start| start.strategy = Strategy::Sharper);
}

/// Draws spins of plans from a stream of the seed, under as much torque as the wheels bring to the floor under their loads at rest: more
/// spins them up, which makes slower plans of strong motors.
fn spinning(input: &SolveInput, stream: u64) -> impl FnMut(&Start) -> Start {
    let torque = Rolling::new(input, 1.0).largest_torques();
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(input.settings.seed.wrapping_add(stream));
    move |plan| Spins::drawn(&mut rng).of(plan, torque)
}

/// Without torque there is only the final time to choose: those of the start's speed, the most likely first. A start that turns meets a
/// heading on its way round, which may be the longer one.
fn coasting(input: &SolveInput) -> impl Iterator<Item = Start> {
    let (control_count, maneuver) = (input.settings.control_count, &input.maneuver);
    let (velocity, error) = (maneuver.start.velocity, maneuver.goal_error(&maneuver.start));
    let yaw_rate = velocity.yaw_rate;
    let turn = (-error[2] * yaw_rate.signum()).rem_euclid(TAU);
    let goal_heading = move |time: f64| {
        let heading = maneuver.start.configuration.heading + yaw_rate * time;
        maneuver.goal.value(StateComponent::Heading).map(|goal| heading + wrapped_angle(goal - heading))
    };
    let ways = [(velocity.x, -error[0]), (velocity.y, -error[1]), (yaw_rate.abs(), turn)];
    let times = ways.into_iter().map(|(rate, way)| way / rate);
    let time = times.filter(|time| time.is_finite()).fold(0.0, f64::max);
    let time = if time > 0.0 { time } else { 1.0 };
    let doublings = (0..=COASTING_DOUBLINGS).flat_map(|doublings| [doublings, -doublings]).skip(1);
    doublings.map(move |doublings| {
        let time = time * 2.0_f64.powi(doublings);
        let schedule = TorqueSchedule::without_torque(time, control_count);
        Start { schedule, goal_heading: goal_heading(time), strategy: Strategy::Direct }
    })
}

/// Full effort towards the goal in the first half, full braking in the second, as if the goal lay straight ahead. From a plan that already
/// meets the goal, Nelder-Mead does not come as near to the paper's: 3.31 in place of 2.95 s.
fn straight(input: &SolveInput) -> Start {
    let maneuver = &input.maneuver;
    let rolling = Rolling::new(input, AMPLITUDES[0]).with_largest_torques();
    let start = &maneuver.start.configuration;
    let x = maneuver.goal.value(StateComponent::X).unwrap_or(start.x) - start.x;
    let y = maneuver.goal.value(StateComponent::Y).unwrap_or(start.y) - start.y;
    let ahead = y * start.heading.cos() - x * start.heading.sin();
    let mut segments = Vec::new();
    rolling.go(&rolling.drive, x.hypot(y).copysign(ahead), &mut segments);
    let segments = or_coasting(segments, input.robot.parameters().natural_time());
    Start {
        schedule: schedule_from_segments(&segments, input.settings.control_count),
        goal_heading: maneuver.nearest_goal_heading(),
        strategy: Strategy::Direct,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::settings::SolveParameters;

    pub(super) fn plan(goal_heading: Option<f64>) -> Start {
        let torques = [1.0, 1.0, -1.0, -1.0].to_vec();
        let schedule = TorqueSchedule { final_time: 2.0, left: torques.clone(), right: torques };
        Start { schedule, goal_heading, strategy: Strategy::Smoothed }
    }

    #[test]
    fn one_smoothed_start_in_three_begins_sharper() {
        let mut starts = vec![plan(None); 6];
        starts.insert(1, Start { strategy: Strategy::Direct, ..plan(None) });
        sharpen(&mut starts);
        let sharper: Vec<_> = (0..7).filter(|index| starts[*index].strategy == Strategy::Sharper).collect();
        assert_eq!(sharper, [3, 6]);
    }

    #[test]
    fn spins_of_a_plan_are_drawn_by_seed_and_stream() {
        let input = SolveInput::new(SolveParameters::default()).unwrap();
        let spins = |stream| spun(&input, &plan(None), (3, stream));
        assert_eq!(spins(24).len(), 3);
        assert_eq!(spins(24), spins(24));
        assert_ne!(spins(24), spins(30));
    }
}
