//! The starts of the search: bang-bang legs that would reach the goal if the wheels rolled without slip.
//!
//! A maneuver from rest to rest is a turn, a drive and a turn, each with full effort and full braking. Forwards and
//! backwards, either way round, gives several such plans; there and back again in two directions moves a robot aside by little.
//! A moving start brakes first, a moving goal accelerates last.
//! These are only first guesses: they neglect slip, the shift of normal forces and the centre of mass off the axle.

mod rolling;
mod routes;

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use rolling::{AMPLITUDES, Rolling};
use routes::rolling_plans;

use super::segments::{resampled, schedule_from_segments};
use super::settings::{Method, SolveInput};
use crate::robot::PerWheel;
use crate::shooting::StateComponent;
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
}

/// Plans that are tried with spins: the fastest ones.
const SPUN_PLANS: usize = 2;
/// Coasting times: the time to the goal at the speed of the start times powers of two, up to so many.
const COASTING_DOUBLINGS: i32 = 4;

/// Wheels driven against each other for a part of a plan: leads to drifting turns.
#[derive(Debug, Clone, Copy)]
struct Spin {
    /// Begin and end, as shares of the final time.
    begin: f64,
    end: f64,
    /// 1 to the left, -1 to the right.
    turn: f64,
    /// Whether all torques are reversed afterwards: turned round, the robot brakes by driving forwards.
    turns_round: bool,
    /// Whole turns by which the heading at the goal changes, positive in the sense of the spin.
    revolutions: f64,
}

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
        let (torque, mut rng) = (spin_torque(input), Xoshiro256PlusPlus::seed_from_u64(input.settings.seed));
        for plan in plans[..SPUN_PLANS.min(plans.len())].iter().cycle() {
            if starts.len() >= count {
                break;
            }
            starts.extend(others.next().cloned());
            starts.push(Spin::drawn(&mut rng).of(plan, torque));
        }
    }
    starts.truncate(if is_nelder_mead { 1 } else { count });
    starts
}

/// So many spins of a plan, drawn from a stream of their own.
pub(super) fn spun(input: &SolveInput, plan: &Start, (count, stream): (usize, u64)) -> Vec<Start> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(input.settings.seed.wrapping_add(stream));
    let torque = spin_torque(input);
    (0..count).map(|_| Spin::drawn(&mut rng).of(plan, torque)).collect()
}

/// As much as the wheels bring to the floor under their loads at rest: more spins them up, which makes slower plans of strong motors.
fn spin_torque(input: &SolveInput) -> PerWheel<f64> {
    Rolling::new(input, 1.0).torque
}

/// Without torque there is only the final time to choose: those of the start's speed, the most likely first.
fn coasting(input: &SolveInput) -> impl Iterator<Item = Start> {
    let zeros = vec![0.0; input.settings.control_count];
    let goal_heading = input.maneuver.nearest_goal_heading();
    let (velocity, error) = (input.maneuver.start.velocity, input.maneuver.goal_error(&input.maneuver.start));
    let times =
        [velocity.x, velocity.y, velocity.yaw_rate].into_iter().zip(error.iter()).map(|(rate, error)| -error / rate);
    let time = times.filter(|time| time.is_finite()).fold(0.0, f64::max);
    let time = if time > 0.0 { time } else { 1.0 };
    let doublings = (0..=COASTING_DOUBLINGS).flat_map(|doublings| [doublings, -doublings]).skip(1);
    doublings.map(move |doublings| Start {
        schedule: TorqueSchedule {
            final_time: time * 2.0_f64.powi(doublings),
            left: zeros.clone(),
            right: zeros.clone(),
        },
        goal_heading,
        strategy: Strategy::Direct,
    })
}

impl Spin {
    /// One after which the robot is turned round two times in three, and in one of three with a turn more or less.
    fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
        let (one, other) = (rng.random::<f64>(), rng.random::<f64>());
        Self {
            begin: one.min(other),
            end: one.max(other),
            turn: drawn_from(&[1.0, -1.0], rng),
            turns_round: drawn_from(&[false, true, true], rng),
            revolutions: drawn_from(&[0.0, 0.0, 0.0, 0.0, 1.0, -1.0], rng),
        }
    }

    /// The plan with this spin under as much torque.
    fn of(&self, plan: &Start, torque: PerWheel<f64>) -> Start {
        // The left wheel forwards turns to the right.
        let torque = PerWheel::new(-self.turn * torque.left, self.turn * torque.right);
        Start {
            schedule: self.in_schedule(&plan.schedule, torque),
            goal_heading: plan.goal_heading.map(|heading| heading + self.turn * self.revolutions * TAU),
            strategy: plan.strategy,
        }
    }

    fn in_schedule(&self, schedule: &TorqueSchedule, torque: PerWheel<f64>) -> TorqueSchedule {
        let mut schedule = schedule.clone();
        let count = schedule.control_count();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the intervals")]
        let interval = |share: f64| (share * count as f64) as usize;
        let begin = interval(self.begin).min(count - 1);
        let end = interval(self.end).clamp(begin + 1, count);
        for (torques, torque) in [(&mut schedule.left, torque.left), (&mut schedule.right, torque.right)] {
            torques[begin..end].fill(torque);
            if self.turns_round {
                torques[end..].iter_mut().for_each(|torque| *torque = -*torque);
            }
        }
        schedule
    }
}

fn drawn_from<T: Copy>(values: &[T], rng: &mut Xoshiro256PlusPlus) -> T {
    values[rng.random_range(0..values.len())]
}

/// Full effort towards the goal in the first half, full braking in the second, as if the goal lay straight ahead.
fn straight(input: &SolveInput) -> Start {
    let maneuver = &input.maneuver;
    let rolling = Rolling::new(input, AMPLITUDES[0]);
    let start = &maneuver.start.configuration;
    let x = maneuver.goal.value(StateComponent::X).unwrap_or(start.x) - start.x;
    let y = maneuver.goal.value(StateComponent::Y).unwrap_or(start.y) - start.y;
    let ahead = y * start.heading.cos() - x * start.heading.sin();
    let mut segments = Vec::new();
    rolling.drive(x.hypot(y).copysign(ahead), &mut segments);
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

    fn plan(goal_heading: Option<f64>) -> Start {
        let torques = [1.0, 1.0, -1.0, -1.0].to_vec();
        let schedule = TorqueSchedule { final_time: 2.0, left: torques.clone(), right: torques };
        Start { schedule, goal_heading, strategy: Strategy::Smoothed }
    }

    #[test]
    fn a_robot_that_turned_round_brakes_by_driving_forwards() {
        let limit = PerWheel::new(3.0, 2.0);
        let right = Spin { begin: 0.5, end: 0.75, turn: -1.0, turns_round: true, revolutions: -1.0 };
        let left = Spin { turn: 1.0, ..right }.of(&plan(Some(0.1)), limit);
        let right = right.of(&plan(Some(0.1)), limit);
        assert_eq!(right.schedule.left, [1.0, 1.0, 3.0, 1.0]);
        assert_eq!(right.schedule.right, [1.0, 1.0, -2.0, 1.0]);
        assert_eq!(right.goal_heading, Some(0.1 + TAU));
        assert_eq!(left.schedule.left, [1.0, 1.0, -3.0, 1.0]);
        assert_eq!(left.goal_heading, Some(0.1 - TAU));
    }

    #[test]
    fn spins_of_a_plan_are_drawn_by_seed_and_stream() {
        let input = SolveInput::new(SolveParameters::default()).unwrap();
        let spins = |stream| spun(&input, &plan(None), (3, stream));
        assert_eq!(spins(24).len(), 3);
        assert_eq!(spins(24), spins(24));
        assert_ne!(spins(24), spins(30));
    }

    #[test]
    fn spins_fit_into_the_coarsest_grid() {
        let mut plan = plan(None);
        plan.schedule.left.truncate(1);
        plan.schedule.right.truncate(1);
        let spin = Spin { begin: 1.0, end: 1.0, turn: -1.0, turns_round: false, revolutions: 0.0 };
        let spun = spin.of(&plan, PerWheel::new(1.0, 1.0));
        assert_eq!(spun.schedule.left, [1.0]);
    }
}
