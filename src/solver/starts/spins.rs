//! Spins: wheels driven against each other for a part of a plan, which leads to drifting turns.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::Start;
use crate::robot::PerWheel;
use crate::simulation::TorqueSchedule;

/// Wheels driven against each other for one or two parts of a plan: leads to drifting turns.
#[derive(Debug, Clone)]
pub(super) struct Spins {
    /// One after the other.
    parts: Vec<Spin>,
    /// Whether all torques are reversed after each spin: turned round, the robot brakes by driving forwards.
    turns_round: bool,
    /// Whole turns by which the heading at the goal changes, positive to the left.
    revolutions: f64,
}

/// Wheels driven against each other.
#[derive(Debug, Clone, Copy)]
struct Spin {
    /// Begin and end, as shares of the final time.
    begin: f64,
    end: f64,
    /// 1 to the left, -1 to the right.
    turn: f64,
}

impl Spins {
    /// One or two, as often. After one the robot is turned round two times in three, and in one of three with a turn more or less. With
    /// two it drives turned round in between, then turns back or right round.
    pub(super) fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
        let turns = [drawn_from(&[1.0, -1.0], rng), drawn_from(&[1.0, -1.0], rng)];
        let count = drawn_from(&[1, 2], rng);
        let mut times: Vec<f64> = (0..2 * count).map(|_| rng.random()).collect();
        times.sort_by(f64::total_cmp);
        let spin = |(times, turn): (&[f64], f64)| Spin { begin: times[0], end: times[1], turn };
        let parts = times.chunks(2).zip(turns).map(spin).collect();
        let is_twice = count == 2;
        let revolutions = [0.0, 0.0, 0.0, 0.0, 1.0, -1.0];
        let revolutions = if is_twice { 0.5 * (turns[0] + turns[1]) } else { drawn_from(&revolutions, rng) };
        Self { parts, turns_round: is_twice || drawn_from(&[false, true, true], rng), revolutions }
    }

    /// The plan with these spins under as much torque.
    pub(super) fn of(&self, plan: &Start, torque: PerWheel<f64>) -> Start {
        let goal_heading = plan.goal_heading.map(|heading| heading + self.revolutions * TAU);
        let mut spun = Start { goal_heading, ..plan.clone() };
        for spin in &self.parts {
            spin.enter(&mut spun.schedule, torque, self.turns_round);
        }
        spun
    }
}

impl Spin {
    /// Takes the place of what the wheels do meanwhile.
    fn enter(&self, schedule: &mut TorqueSchedule, torque: PerWheel<f64>, turns_round: bool) {
        let count = schedule.control_count();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the intervals")]
        let interval = |share: f64| (share * count as f64) as usize;
        let begin = interval(self.begin).min(count - 1);
        let end = interval(self.end).clamp(begin + 1, count);
        // The left wheel forwards turns to the right.
        for (torques, torque) in
            [(&mut schedule.left, -self.turn * torque.left), (&mut schedule.right, self.turn * torque.right)]
        {
            torques[begin..end].fill(torque);
            if turns_round {
                torques[end..].iter_mut().for_each(|torque| *torque = -*torque);
            }
        }
    }
}

fn drawn_from<T: Copy>(values: &[T], rng: &mut Xoshiro256PlusPlus) -> T {
    values[rng.random_range(0..values.len())]
}

#[cfg(test)]
mod tests {
    use super::super::tests::plan;
    use super::*;

    #[test]
    fn a_robot_that_turned_round_brakes_by_driving_forwards() {
        let limit = PerWheel::new(3.0, 2.0);
        let once = |turn| {
            let spin = Spin { begin: 0.5, end: 0.75, turn };
            Spins { parts: vec![spin], turns_round: true, revolutions: -turn }.of(&plan(Some(0.1)), limit)
        };
        let (left, right) = (once(1.0), once(-1.0));
        assert_eq!(right.schedule.left, [1.0, 1.0, 3.0, 1.0]);
        assert_eq!(right.schedule.right, [1.0, 1.0, -2.0, 1.0]);
        assert_eq!(right.goal_heading, Some(0.1 + TAU));
        assert_eq!(left.schedule.left, [1.0, 1.0, -3.0, 1.0]);
        assert_eq!(left.goal_heading, Some(0.1 - TAU));
    }

    #[test]
    fn between_two_spins_the_robot_drives_turned_round() {
        let torques = [1.0; 8].to_vec();
        let schedule = TorqueSchedule { final_time: 2.0, left: torques.clone(), right: torques };
        let parts =
            [(0.125, 0.25, 1.0), (0.5, 0.75, -1.0)].map(|(begin, end, turn)| Spin { begin, end, turn }).to_vec();
        let back = Spins { parts, turns_round: true, revolutions: 0.0 };
        let spun = back.of(&Start { schedule, ..plan(None) }, PerWheel::new(3.0, 2.0)).schedule;
        assert_eq!(spun.left, [1.0, -3.0, -1.0, -1.0, 3.0, 3.0, 1.0, 1.0]);
        assert_eq!(spun.right, [1.0, 2.0, -1.0, -1.0, -2.0, -2.0, 1.0, 1.0]);
    }

    #[test]
    fn spins_fit_into_the_coarsest_grid() {
        let mut plan = plan(None);
        plan.schedule.left.truncate(1);
        plan.schedule.right.truncate(1);
        let spin = Spin { begin: 1.0, end: 1.0, turn: -1.0 };
        let twice = Spins { parts: vec![spin; 2], turns_round: true, revolutions: -1.0 };
        assert_eq!(twice.of(&plan, PerWheel::new(1.0, 1.0)).schedule.left, [1.0]);
    }
}
