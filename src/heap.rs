//! Gives memory that is not used any more back to the system.
//!
//! The system's allocator keeps whole pages that lie between used ones, so that a flood of requests would leave the
//! process as large as it was at its height. Allocators that return pages by themselves (mimalloc was tried) have a larger
//! base and kept more.

use std::time::Duration;

use tokio::time::interval;

/// How often: well within the time after which operators look again.
const INTERVAL: Duration = Duration::from_secs(5);

/// Gives memory back as long as the runtime lives.
pub(crate) async fn give_back_regularly() {
    let mut ticks = interval(INTERVAL);
    loop {
        ticks.tick().await;
        // On a thread that may block: a large heap takes some milliseconds.
        let _ = tokio::task::spawn_blocking(give_back).await;
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "the allocator has no safe interface")]
fn give_back() {
    // SAFETY: the function takes a number, keeps its own locks, and touches only pages that are not in use.
    unsafe { libc::malloc_trim(0) };
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn give_back() {}
