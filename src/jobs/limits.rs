//! What this server accepts at most. A request above a limit is refused with the limit, never cut down silently.

use std::sync::Arc;
use std::time::Duration;

use super::{Jobs, Kind, Visitor};
use crate::contract::BodyLimit;
use crate::contract::convert::count;
use crate::contract::message::{CrossFieldRule, FieldRule, GetLimitsResponse, JobLimits};
use crate::motion;
use crate::rules::{self, Checks, RuleSet};
use crate::service::{Class, LIGHT_QUEUE_LENGTH, ServiceSettings};

/// Most time steps: a full answer of 26 arrays of 10,000 numbers still fits 4 MB, gRPC's default message.
pub(super) const MAX_STEPS: usize = motion::STEP_LIMIT;
/// Most control intervals per wheel.
pub(super) const MAX_CONTROL_INTERVALS: usize = 1_000;
/// Most starts of one search.
pub(super) const MAX_STARTS: usize = 64;
/// Longest time limit, s: one caller holds a worker no longer than this.
pub(super) const MAX_TIME_LIMIT_S: f64 = 60.0;
/// Most rollouts of one search: beyond what the longest time limit lets any worker spend.
pub(super) const MAX_ROLLOUT_LIMIT: u64 = 100_000_000;
/// Time limit when the caller names none, s.
pub const DEFAULT_TIME_LIMIT_S: f64 = 10.0;
/// Longest number in JSON with the comma after it, characters: 17 digits, signs, point and exponent.
const NUMBER_BYTES: usize = 25;
/// How long a light job with rollouts may run: one that meets friction which is hard to resolve is cut off, others wait.
const LIGHT_TIME_LIMIT: Duration = Duration::from_secs(2);
/// Largest request body, bytes: two torque arrays with the most intervals, as much again for white space, and 32 KiB for
/// the rest of the request, rounded up to a power of two.
pub(super) const MAX_BODY_BYTES: usize = (2 * 2 * MAX_CONTROL_INTERVALS * NUMBER_BYTES + 32 * 1024).next_power_of_two();

/// Largest body of a request that holds answers. Of as many bytes are four plans with the most torques in their request and
/// in their answer, twice over; or a whole answer of 2,000 steps, so that most may be handed on as they came.
pub(super) const BODY_WITH_ANSWERS: BodyLimit =
    BodyLimit { bytes: 1 << 20, advice: "`trajectory` and `contacts` of an answer are not read and need not be sent" };

/// Whether a clock may end jobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// Each job has a time limit.
    Limits,
    /// None ever does, and one that is asked for is refused: answers are functions of their requests.
    Rests,
}

/// The limits of one server.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Most time steps of a grid.
    pub max_steps: usize,
    /// Most control intervals per wheel, of a grid, an initial guess or a torque schedule.
    pub max_control_intervals: usize,
    /// Most starts of one search.
    pub max_starts: usize,
    /// Longest time limit of a solve, and that of each simulation, s.
    pub max_time_limit_s: f64,
    /// Most rollouts of one search.
    pub max_rollout_limit: u64,
    /// Largest request body, bytes.
    pub max_body_bytes: usize,
    /// Whether a clock may end jobs.
    pub clock: Clock,
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
            clock: Clock::Limits,
        }
    }
}

impl Limits {
    /// The same, where no clock ends a job.
    #[must_use]
    pub fn without_clock(self) -> Self {
        Self { clock: Clock::Rests, ..self }
    }

    /// The largest body of a kind that has no other limit.
    pub(crate) fn body(&self) -> BodyLimit {
        BodyLimit::of(self.max_body_bytes)
    }

    /// How long the server itself lets a job run.
    pub(super) fn time_limit(&self) -> Option<Duration> {
        match self.clock {
            Clock::Limits => Some(Duration::from_secs_f64(self.max_time_limit_s)),
            Clock::Rests => None,
        }
    }

    /// The same of a light job with rollouts.
    pub(super) fn light_time_limit(&self) -> Option<Duration> {
        self.time_limit().map(|_| LIGHT_TIME_LIMIT)
    }

    /// Rules of a request, with the limits on two arrays of torques.
    pub(super) fn on_arrays(&self, rules: RuleSet, arrays: [&str; 2]) -> RuleSet {
        arrays.into_iter().fold(rules, |rules, array| rules.at_most(array, self.max_control_intervals as f64))
    }

    /// Adds an array of torques above the limit to `checks`, and says whether it is within it: judging each number of an
    /// array that is refused already would only grow the answer.
    pub(super) fn check_arrays(&self, checks: &mut Checks, arrays: [(&str, &[f64]); 2]) -> bool {
        let before = checks.count();
        for (field, torques) in arrays {
            checks.server_limit(field, torques.len() as f64, self.max_control_intervals as f64);
        }
        checks.count() == before
    }
}

/// What a server accepts: its own limits, and the rules of every kind of job.
pub fn limits_message(jobs: &Jobs, settings: &ServiceSettings, batch_window: usize) -> GetLimitsResponse {
    // How long a worker may take to stop is no matter of callers.
    let ServiceSettings { workers, queue_length, queue_work, stuck_after: _ } = settings;
    let Limits {
        max_steps,
        max_control_intervals,
        max_starts,
        max_time_limit_s,
        max_rollout_limit,
        max_body_bytes,
        clock: _,
    } = *jobs.limits();
    let mut listed =
        Listed { limits: *jobs.limits(), rules: Vec::new(), cross_field_rules: Vec::new(), kinds: Vec::new() };
    jobs.each(&mut listed);
    GetLimitsResponse {
        max_steps: count(max_steps),
        max_control_intervals: count(max_control_intervals),
        max_starts: count(max_starts),
        max_time_limit_s,
        default_time_limit_s: DEFAULT_TIME_LIMIT_S,
        max_rollout_limit,
        max_body_bytes: max_body_bytes as u64,
        workers: count(workers.get()),
        queue_length: count(*queue_length),
        light_queue_length: count(LIGHT_QUEUE_LENGTH),
        queue_work_s: queue_work.as_secs_f64(),
        batch_window: count(batch_window),
        rules: listed.rules,
        cross_field_rules: listed.cross_field_rules,
        jobs: listed.kinds,
    }
}

/// The rules of all kinds as messages.
struct Listed {
    limits: Limits,
    rules: Vec<FieldRule>,
    cross_field_rules: Vec<CrossFieldRule>,
    kinds: Vec<JobLimits>,
}

impl Visitor for Listed {
    fn visit<K: Kind>(&mut self, _kind: &Arc<K>) {
        let job = || K::NAME.to_owned();
        let max_body_bytes = K::body_limit(&self.limits).bytes as u64;
        self.kinds.push(JobLimits { job: job(), max_body_bytes, light: K::CLASS == Class::Light });
        let RuleSet { fields, cross_field } = K::rules(&self.limits);
        self.rules.extend(fields.into_iter().map(|(field, rule)| FieldRule {
            field,
            rule: rule.to_string(),
            job: job(),
            minimum: (!rule.exclusive_minimum).then_some(rule.minimum),
            exclusive_minimum: rule.exclusive_minimum.then_some(rule.minimum),
            maximum: (rule.maximum.is_finite() && !rule.exclusive_maximum).then_some(rule.maximum),
            exclusive_maximum: rule.exclusive_maximum.then_some(rule.maximum),
            unit: rule.unit.to_owned(),
        }));
        self.cross_field_rules.extend(cross_field.into_iter().map(|rules::CrossFieldRule { fields, rule }| {
            CrossFieldRule { job: job(), fields, rule: rule.to_owned() }
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::InProcessSolver;
    use crate::metrics::Metrics;

    #[test]
    fn all_kinds_with_a_robot_list_the_rules_of_its_footprint() {
        let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), &Metrics::new());
        let message = limits_message(&jobs, &ServiceSettings::default(), 1);
        let kinds_with = |field: &str| -> Vec<_> {
            message.rules.iter().filter(|rule| rule.field == field).map(|rule| rule.job.as_str()).collect()
        };
        assert_eq!(kinds_with("robot.wheel_radius_m"), ["solve", "simulate", "assess"]);
        assert_eq!(kinds_with("robot.footprint"), kinds_with("robot.wheel_radius_m"));
    }

    #[test]
    fn longest_torque_arrays_fit_the_largest_body() {
        // As serde writes it, with a comma.
        let longest = format!("{:e},", -f64::MIN_POSITIVE.next_up());
        assert!(longest.len() <= NUMBER_BYTES, "{longest}");
        const { assert!(2 * 2 * MAX_CONTROL_INTERVALS * NUMBER_BYTES < MAX_BODY_BYTES) };
    }

    #[test]
    fn long_array_is_refused_with_its_name() {
        let mut checks = Checks::new();
        let long = vec![0.0; MAX_CONTROL_INTERVALS + 1];
        assert!(!Limits::default().check_arrays(&mut checks, [("left_n_m", &long), ("right_n_m", &[0.0])]));
        assert_eq!(checks.finish().unwrap_err().list()[0].field, "left_n_m");
    }
}
