//! A search with helpers gives the answer of a search without: whoever helps, is recalled, and whatever limit cuts it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;

use slipdrive::robot::RobotParameters;
use slipdrive::shooting::{Goal, Maneuver};
use slipdrive::solver::{
    Helpers, NoProgress, ProgressObserver, Refinement, RunControl, SharedWork, Solution, SolveInput, SolveParameters,
    SolveProgress, SolverSettings, StopReason, solve,
};

use crate::random::RandomCases;

/// Helpers that are recalled again and again.
struct RestlessCrew {
    helpers: usize,
    /// Parts that the calling thread does between two recalls.
    patience: usize,
}

impl Helpers for RestlessCrew {
    fn share(&self, work: &dyn SharedWork) {
        static NEVER: AtomicBool = AtomicBool::new(false);
        let flags: Vec<_> = (0..self.helpers).map(|_| AtomicBool::new(false)).collect();
        thread::scope(|threads| {
            for flag in &flags {
                threads.spawn(|| while work.take_part(flag) {});
            }
            let mut own = 0;
            while work.take_part(&NEVER) {
                own += 1;
                if own % self.patience == 0 {
                    flags[(own / self.patience) % self.helpers].store(true, Ordering::Relaxed);
                }
            }
            for flag in &flags {
                flag.store(own % 2 == 0, Ordering::Relaxed);
            }
        });
        // Whoever was recalled at the very end has left its part open.
        while work.take_part(&NEVER) {}
    }
}

fn crews() -> [RestlessCrew; 3] {
    [(1, usize::MAX), (2, 1), (7, 2)].map(|(helpers, patience)| RestlessCrew { helpers, patience })
}

fn alone(input: &SolveInput) -> Solution {
    solve(input, &RunControl::unattended()).unwrap()
}

fn helped(input: &SolveInput, crew: &RestlessCrew) -> Solution {
    solve(input, &RunControl::unattended().helped_by(crew)).unwrap()
}

fn small_settings() -> SolverSettings {
    // As many starts as make two finals.
    SolverSettings {
        step_count: 24,
        refinement: Refinement::Fixed,
        control_count: 6,
        start_count: 12,
        ..SolverSettings::default()
    }
}

fn inputs() -> Vec<SolveInput> {
    let mut cases = RandomCases::new(31);
    let mut inputs = Vec::new();
    for number in 0..3 {
        let goal = Goal::at_rest(cases.between(-2.0, 2.0), cases.between(-2.0, 4.0), cases.between(-3.0, 3.0));
        let maneuver = Maneuver { goal, ..Maneuver::forward_drive() };
        let robot = if number == 0 { RobotParameters::default() } else { *cases.robot().parameters() };
        inputs.push(
            SolveInput::new(SolveParameters {
                robot,
                maneuver,
                settings: small_settings(),
                ..SolveParameters::default()
            })
            .unwrap(),
        );
    }
    inputs
}

/// Equal bytes: the shortest decimal of a number tells all its bits.
fn assert_same(input: &SolveInput, expected: &Solution, what: &str) {
    let expected = format!("{expected:?}");
    for crew in crews() {
        let found = format!("{:?}", helped(input, &crew));
        assert!(found == expected, "{what}, {} helpers, patience {}", crew.helpers, crew.patience);
    }
}

#[test]
fn answer_does_not_depend_on_the_helpers() {
    for (number, input) in inputs().iter().enumerate() {
        let expected = alone(input);
        assert_eq!(expected.stop_reason, StopReason::Finished);
        assert_same(input, &expected, &format!("maneuver {number}"));
    }
}

#[test]
fn answer_under_any_rollout_limit_does_not_depend_on_the_helpers() {
    let mut cases = RandomCases::new(32);
    let input = &inputs()[0];
    let rollouts = alone(input).report.rollouts;
    // At both ends, where the last polish is cut, and anywhere between.
    let mut limits = vec![1, 2, rollouts - 60, rollouts - 1, rollouts];
    limits.extend((0..3).map(|_| cases.whole(1, rollouts)));
    for limit in limits {
        let mut input = input.clone();
        input.settings.rollout_limit = limit;
        let expected = alone(&input);
        let is_cut = expected.stop_reason == StopReason::RolloutLimit;
        assert_eq!(is_cut, limit < rollouts, "limit {limit} of {rollouts}");
        assert!(expected.report.rollouts <= limit);
        assert_same(&input, &expected, &format!("limit {limit} of {rollouts}"));
    }
}

#[test]
fn search_that_is_cut_keeps_the_best_of_the_starts_before() {
    let input = &inputs()[0];
    let mut fastest = f64::INFINITY;
    let rollouts = alone(input).report.rollouts;
    for limit in (1..rollouts).step_by(151) {
        let mut input = input.clone();
        input.settings.rollout_limit = limit;
        let solution = alone(&input);
        if solution.reason.is_none() {
            // A plan that is cut before its goal is restored may be a little faster, within the goal tolerance.
            let final_time = solution.schedule.final_time;
            assert!(final_time <= fastest * (1.0 + 1e-5), "limit {limit}: {final_time} after {fastest}");
            fastest = final_time.min(fastest);
        }
        assert!(fastest.is_infinite() || solution.reason.is_none(), "limit {limit}: a plan was lost");
    }
    assert!(fastest.is_finite());
}

struct Record(Mutex<Vec<SolveProgress>>);

impl ProgressObserver for Record {
    fn progress(&self, progress: &SolveProgress) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(*progress);
    }
}

#[test]
fn progress_of_all_starts_together_only_gets_better() {
    let input = &inputs()[0];
    let tolerance = input.settings.goal_tolerance;
    for crew in crews() {
        let (record, flag) = (Record(Mutex::new(Vec::new())), AtomicBool::new(false));
        let solution = solve(input, &RunControl::new(&flag, &record).helped_by(&crew)).unwrap();
        let reported = record.0.into_inner().unwrap();
        for pair in reported.windows(2) {
            let (before, after) = (&pair[0], &pair[1]);
            let (had_plan, has_plan) = (before.best_goal_error <= tolerance, after.best_goal_error <= tolerance);
            assert!(before.start <= after.start && (!had_plan || has_plan), "{after:?} after {before:?}");
            assert!(had_plan != has_plan || !has_plan || after.best_final_time <= before.best_final_time);
            assert!(had_plan || has_plan || after.best_goal_error <= before.best_goal_error);
        }
        let last = reported[reported.len() - 1];
        // A point on the way may be a little faster, within the goal tolerance.
        let gap = (last.best_final_time - solution.schedule.final_time).abs();
        assert!(gap <= 1e-6 * last.best_final_time, "the last word is the answer, but for {gap} s");
    }
}

/// Stops the solve once a plan is known.
struct StopAtPlan<'a> {
    stop: &'a AtomicBool,
    tolerance: f64,
    best: Mutex<f64>,
}

impl ProgressObserver for StopAtPlan<'_> {
    fn progress(&self, progress: &SolveProgress) {
        if progress.best_goal_error <= self.tolerance {
            *self.best.lock().unwrap() = progress.best_final_time;
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

#[test]
fn stopped_search_answers_with_the_best_that_it_reported() {
    let input = &inputs()[0];
    for crew in crews() {
        let stop = AtomicBool::new(false);
        let observer = StopAtPlan { stop: &stop, tolerance: input.settings.goal_tolerance, best: Mutex::new(f64::NAN) };
        let solution = solve(input, &RunControl::new(&stop, &observer).helped_by(&crew)).unwrap();
        assert_eq!((solution.stop_reason, solution.reason.is_none()), (StopReason::Stopped, true));
        assert_eq!(solution.schedule.final_time, *observer.best.lock().unwrap());
    }
}

struct PanicAtStart(usize);

impl ProgressObserver for PanicAtStart {
    fn progress(&self, progress: &SolveProgress) {
        assert!(progress.start < self.0, "injected");
    }
}

#[test]
fn panic_in_a_part_ends_the_search_with_a_panic() {
    let (input, stop) = (&inputs()[0], AtomicBool::new(false));
    for crew in crews() {
        let observer = PanicAtStart(2);
        let control = RunControl::new(&stop, &observer).helped_by(&crew);
        let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| solve(input, &control)));
        assert!(outcome.is_err());
    }
    // Nothing is left behind.
    assert_eq!(solve(input, &RunControl::new(&stop, &NoProgress)).unwrap().stop_reason, StopReason::Finished);
}
