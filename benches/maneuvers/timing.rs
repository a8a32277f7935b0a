//! CPU time of this thread: what a solve costs, whatever else the machine does.

use std::time::Duration;

/// CPU time that this thread has used.
#[cfg(unix)]
pub(crate) fn thread_cpu_time() -> Duration {
    use rustix::time::{ClockId, clock_gettime};
    let time = clock_gettime(ClockId::ThreadCPUTime);
    let seconds = u64::try_from(time.tv_sec).unwrap_or_default();
    let nanoseconds = u32::try_from(time.tv_nsec).unwrap_or_default();
    Duration::new(seconds, nanoseconds)
}

/// Wall time stands in where there is no such clock.
#[cfg(not(unix))]
pub(crate) fn thread_cpu_time() -> Duration {
    use std::sync::LazyLock;
    use std::time::Instant;
    static ORIGIN: LazyLock<Instant> = LazyLock::new(Instant::now);
    ORIGIN.elapsed()
}

/// Does the same work several times: its result, and the shortest CPU time in ms.
pub(crate) fn shortest_ms<T>(repetitions: usize, work: impl Fn() -> T) -> (T, f64) {
    let timed = || {
        let begin = thread_cpu_time();
        let result = work();
        (result, thread_cpu_time().saturating_sub(begin).as_secs_f64() * 1e3)
    };
    let first = timed();
    (1..repetitions).map(|_| timed()).fold(first, |best, next| if next.1 < best.1 { next } else { best })
}
