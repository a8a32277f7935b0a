//! Progress of several searches at once: the best of all of them is reported.

use std::sync::{Mutex, PoisonError};

use super::candidate::is_better;
use super::run_control::{Phase, ProgressObserver, RunControl, SolveProgress};

/// Forwards progress that is better than all reported before, and the latest start that has begun.
pub(super) struct BestProgress<'a> {
    pub(super) control: &'a RunControl<'a>,
    goal_tolerance: f64,
    reported: Mutex<Option<SolveProgress>>,
}

impl<'a> BestProgress<'a> {
    pub(super) fn new(control: &'a RunControl<'a>, goal_tolerance: f64) -> Self {
        Self { control, goal_tolerance, reported: Mutex::new(None) }
    }

    /// What is to be reported next, if anything.
    fn next(&self, reported: Option<SolveProgress>, progress: &SolveProgress) -> Option<SolveProgress> {
        let Some(best) = reported else { return Some(*progress) };
        // A polish has start numbers 0. The count grows where more starts are tried than were asked for.
        let (start, start_count) = (best.start.max(progress.start), best.start_count.max(progress.start_count));
        let of = |progress: &SolveProgress| (progress.best_final_time, progress.best_goal_error);
        if is_better(of(progress), of(&best), self.goal_tolerance) {
            return Some(SolveProgress { start, start_count, ..*progress });
        }
        (start > best.start).then_some(SolveProgress { start, start_count, ..best })
    }
}

impl ProgressObserver for BestProgress<'_> {
    fn progress(&self, progress: &SolveProgress) {
        let mut reported = self.reported.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(next) = self.next(*reported, progress) {
            *reported = Some(next);
            // Under the lock, so that the best is reported last.
            self.control.report(&next);
        }
    }

    fn begins(&self, phase: Phase) {
        self.control.observer.begins(phase);
    }

    fn ends(&self, phase: Phase) {
        self.control.observer.ends(phase);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;

    struct Record(Mutex<Vec<(f64, f64, usize)>>);

    impl ProgressObserver for Record {
        fn progress(&self, progress: &SolveProgress) {
            let reported = (progress.best_final_time, progress.best_goal_error, progress.start);
            self.0.lock().unwrap().push(reported);
        }
    }

    #[test]
    fn only_better_points_are_reported_and_starts_only_count_up() {
        let (record, flag) = (Record(Mutex::new(Vec::new())), AtomicBool::new(false));
        let control = RunControl::new(&flag, &record);
        let best = BestProgress::new(&control, 1e-6);
        for (best_final_time, best_goal_error, start) in [
            (2.0, 0.5, 1),
            (1.0, f64::NAN, 1),
            (3.0, 0.1, 2),
            (2.5, 0.3, 1),
            (2.6, 0.4, 3),
            (4.0, 0.0, 2),
            (3.0, 0.01, 3),
            (3.5, 1e-7, 1),
        ] {
            best.progress(&SolveProgress { best_final_time, best_goal_error, start, start_count: 0 });
        }
        let reported = record.0.into_inner().unwrap();
        assert_eq!(reported, [(2.0, 0.5, 1), (3.0, 0.1, 2), (3.0, 0.1, 3), (4.0, 0.0, 3), (3.5, 1e-7, 3)]);
    }
}
