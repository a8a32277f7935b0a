//! When a worker will probably be free for one more job.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::time::Instant;

use super::clocks::Clocks;

/// When the last of these jobs has probably left a worker free.
///
/// The running jobs end at `running`, the `waiting` ones start in this order, each on the first worker that is free by
/// then; one whose deadline has passed by then is never started.
pub(super) fn expected_start<'a>(
    now: Instant,
    workers: usize,
    running: impl Iterator<Item = Instant>,
    waiting: impl Iterator<Item = &'a Clocks>,
) -> Instant {
    let mut free: BinaryHeap<_> = running.map(Reverse).collect();
    free.extend((free.len()..workers).map(|_| Reverse(now)));
    for clocks in waiting {
        // There is always a first worker: each that is taken is put back.
        let Some(Reverse(start)) = free.peek().copied() else { break };
        if clocks.last_start().is_none_or(|last_start| start < last_start) {
            free.pop();
            // Beyond the range of the clock nothing ends.
            free.push(Reverse(start.checked_add(clocks.expected_rest(start, now)).unwrap_or(start)));
        }
    }
    free.peek().map_or(now, |&Reverse(start)| start)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn jobs_follow_each_other_on_the_first_free_worker() {
        let now = Instant::now();
        let of = |seconds: u32| Clocks { estimate: seconds * SECOND, ..Clocks::default() };
        let start = |workers: usize, running: &[u32], waiting: &[u32]| {
            let running = running.iter().map(|&seconds| now + seconds * SECOND);
            let waiting: Vec<_> = waiting.iter().copied().map(of).collect();
            (expected_start(now, workers, running, waiting.iter()) - now).as_secs()
        };
        assert_eq!(start(1, &[], &[]), 0);
        assert_eq!(start(2, &[5], &[]), 0, "one worker is idle");
        assert_eq!(start(1, &[2], &[3, 4]), 9);
        assert_eq!(start(2, &[2, 5], &[4, 1]), 6, "the first ends at 6 s, the second at 6 s");
    }

    #[test]
    fn job_whose_deadline_passes_in_the_line_takes_no_time() {
        let now = Instant::now();
        let until = |seconds: u32| Clocks {
            estimate: 10 * SECOND,
            deadline: Some(now + seconds * SECOND),
            ..Clocks::default()
        };
        let waiting = [until(1), until(5), until(4)];
        let start = expected_start(now, 1, [now + 2 * SECOND].into_iter(), waiting.iter());
        assert_eq!(start, now + 5 * SECOND, "the second ends at its deadline, and so late the third is not started");
    }
}
