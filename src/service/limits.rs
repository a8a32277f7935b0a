//! What this server accepts at most. A request above a limit is refused with the limit, never cut down silently.

use super::domain::{SolverSettings, TorqueSchedule};
use crate::violation::Checks;

/// Most time steps: a full answer of 26 arrays of 10,000 numbers still fits 4 MB, gRPC's default message.
pub const MAX_STEPS: usize = SolverSettings::STEP_LIMIT;
/// Most control intervals per wheel.
pub const MAX_CONTROL_INTERVALS: usize = 1_000;
/// Most starts of one search.
pub const MAX_STARTS: usize = 64;
/// Longest time limit, s: one caller holds a worker no longer than this.
pub const MAX_TIME_LIMIT_S: f64 = 60.0;
/// Most rollouts of one search: beyond what the longest time limit lets any worker spend.
pub const MAX_ROLLOUT_LIMIT: u64 = 100_000_000;
/// Time limit when the caller names none, s.
pub const DEFAULT_TIME_LIMIT_S: f64 = 10.0;
/// Longest number in JSON with the comma after it, characters: 17 digits, signs, point and exponent.
const NUMBER_BYTES: usize = 25;
/// Largest request body, bytes: two torque arrays with the most intervals, as much again for white space, and 32 KiB for
/// the rest of the request, rounded up to a power of two.
pub const MAX_BODY_BYTES: usize = (2 * 2 * MAX_CONTROL_INTERVALS * NUMBER_BYTES + 32 * 1024).next_power_of_two();

/// The limits of one server.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Most time steps of a grid.
    pub max_steps: usize,
    /// Most control intervals per wheel, of a grid, an initial guess or a torque schedule.
    pub max_control_intervals: usize,
    /// Most starts of one search.
    pub max_starts: usize,
    /// Longest time limit of a solve, s.
    pub max_time_limit_s: f64,
    /// Most rollouts of one search.
    pub max_rollout_limit: u64,
    /// Largest request body, bytes.
    pub max_body_bytes: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_steps: MAX_STEPS,
            max_control_intervals: MAX_CONTROL_INTERVALS,
            max_starts: MAX_STARTS,
            max_time_limit_s: MAX_TIME_LIMIT_S,
            max_rollout_limit: MAX_ROLLOUT_LIMIT,
            max_body_bytes: MAX_BODY_BYTES,
        }
    }
}

impl Limits {
    /// Adds what a solve asks above the limits to `checks`, and what is wrong with its time limit (s).
    pub fn check_solve(
        &self,
        settings: &SolverSettings,
        initial_guess: Option<&TorqueSchedule>,
        time_limit_s: f64,
        checks: &mut Checks,
    ) {
        checks.within("grid", |checks| {
            checks.at_most("steps", settings.step_count as f64, self.max_steps as f64);
            self.check_interval_count("control_intervals", settings.control_count, checks);
        });
        checks.within("solver", |checks| {
            checks.at_most("starts", settings.start_count as f64, self.max_starts as f64);
            checks.at_most("rollout_limit", settings.rollout_limit as f64, self.max_rollout_limit as f64);
            checks.positive("time_limit_s", time_limit_s, "s");
            checks.at_most("time_limit_s", time_limit_s, self.max_time_limit_s);
        });
        if let Some(guess) = initial_guess {
            checks.within("initial_guess", |checks| {
                self.check_torque_arrays(guess, ("torque_left_n_m", "torque_right_n_m"), checks);
            });
        }
    }

    /// Adds what a simulation asks above the limits to `checks`.
    pub fn check_simulate(&self, step_count: usize, schedule: &TorqueSchedule, checks: &mut Checks) {
        checks.within("grid", |checks| checks.at_most("steps", step_count as f64, self.max_steps as f64));
        checks.within("torque_schedule", |checks| {
            self.check_torque_arrays(schedule, ("left_n_m", "right_n_m"), checks);
        });
    }

    /// Whether both torque arrays are short enough to be judged number by number.
    pub fn admits_torque_arrays(&self, schedule: &TorqueSchedule) -> bool {
        schedule.left.len().max(schedule.right.len()) <= self.max_control_intervals
    }

    fn check_torque_arrays(&self, schedule: &TorqueSchedule, (left, right): (&str, &str), checks: &mut Checks) {
        self.check_interval_count(left, schedule.left.len(), checks);
        self.check_interval_count(right, schedule.right.len(), checks);
    }

    fn check_interval_count(&self, field: &str, count: usize, checks: &mut Checks) {
        checks.at_most(field, count as f64, self.max_control_intervals as f64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::violation::ViolationCode;

    fn violations_of(settings: &SolverSettings, time_limit_s: f64) -> Vec<(String, ViolationCode)> {
        let mut checks = Checks::new();
        Limits::default().check_solve(settings, None, time_limit_s, &mut checks);
        match checks.into_result(()) {
            Ok(()) => Vec::new(),
            Err(violations) => violations.list().iter().map(|v| (v.field.clone(), v.code)).collect(),
        }
    }

    #[test]
    fn defaults_are_within_the_limits() {
        assert_eq!(violations_of(&SolverSettings::default(), DEFAULT_TIME_LIMIT_S), []);
    }

    #[test]
    fn every_limit_is_named_with_its_field() {
        let settings = SolverSettings {
            step_count: MAX_STEPS + 1,
            control_count: MAX_CONTROL_INTERVALS + 1,
            start_count: MAX_STARTS + 1,
            rollout_limit: MAX_ROLLOUT_LIMIT + 1,
            ..SolverSettings::default()
        };
        let fields: Vec<_> = violations_of(&settings, 61.0)
            .into_iter()
            .map(|(field, code)| {
                assert_eq!(code, ViolationCode::ProblemTooLarge, "{field}");
                field
            })
            .collect();
        let expected = ["grid.steps", "grid.control_intervals", "solver.starts", "solver.rollout_limit"];
        assert_eq!(fields[..4], expected);
        assert_eq!(fields[4], "solver.time_limit_s");
    }

    #[test]
    fn longest_torque_arrays_fit_the_largest_body() {
        // As serde writes it, with a comma.
        let longest = format!("{:e},", -f64::MIN_POSITIVE.next_up());
        assert!(longest.len() <= NUMBER_BYTES, "{longest}");
        const { assert!(2 * 2 * MAX_CONTROL_INTERVALS * NUMBER_BYTES < MAX_BODY_BYTES) };
    }

    #[test]
    fn time_limit_must_be_positive() {
        let found = violations_of(&SolverSettings::default(), 0.0);
        assert_eq!(found, [("solver.time_limit_s".to_owned(), ViolationCode::InvalidValue)]);
    }

    #[test]
    fn long_guess_is_refused_with_its_array() {
        let guess = TorqueSchedule { final_time: 1.0, left: vec![0.0; MAX_CONTROL_INTERVALS + 1], right: vec![0.0] };
        let mut checks = Checks::new();
        Limits::default().check_solve(&SolverSettings::default(), Some(&guess), 1.0, &mut checks);
        let violations = checks.into_result(()).unwrap_err();
        assert_eq!(violations.list()[0].field, "initial_guess.torque_left_n_m");
        assert!(!Limits::default().admits_torque_arrays(&guess));
    }
}
