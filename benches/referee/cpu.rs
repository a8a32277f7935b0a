//! CPU time of programs that were run, user and system, whatever else the machine does.

use std::time::Duration;

/// CPU time of all children that have ended; one child at a time, the difference is that child's.
#[cfg(unix)]
pub(crate) fn children_cpu_time() -> Duration {
    use nix::sys::resource::{UsageWho, getrusage};
    use nix::sys::time::TimeValLike as _;
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN).expect("every process may ask for its own use");
    let microseconds = (usage.user_time() + usage.system_time()).num_microseconds();
    Duration::from_micros(microseconds.unsigned_abs())
}

/// Wall time stands in where there is no such account.
#[cfg(not(unix))]
pub(crate) fn children_cpu_time() -> Duration {
    use std::sync::LazyLock;
    use std::time::Instant;
    static ORIGIN: LazyLock<Instant> = LazyLock::new(Instant::now);
    ORIGIN.elapsed()
}
