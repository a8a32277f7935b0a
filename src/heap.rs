//! Gives memory that is not used any more back to the system.
//!
//! The system's allocator keeps whole pages that lie between used ones, so that a flood of requests would leave the
//! process as large as it was at its height. Allocators that return pages by themselves (mimalloc was tried) have a larger
//! base and kept more.
//!
//! Each thread has a heap of its own. `malloc_trim` gives back what is free inside all of them, but at the end of the main
//! one alone: the others shrink as blocks are freed, above a threshold. The allocator raises it to twice the largest block
//! that was ever freed, up to 64 MiB, and with it the size from which blocks have pages of their own, which go back at
//! once. Small blocks that it sets aside unmerged hide what lies below them until `malloc_trim` merges them, at the end of
//! a heap for good. So all three are set.

use std::time::Duration;

use tokio::time::interval;

/// How often: within the time in which a few large jobs follow each other, which else leave what they used in turn.
const INTERVAL: Duration = Duration::from_secs(1);
/// What the allocator is told, whatever was freed before, bytes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const BOUNDS: [(libc::c_int, libc::c_int); 3] = [
    // Blocks from this size on have pages of their own: the columns of the largest trajectories among them.
    (libc::M_MMAP_THRESHOLD, 64 * 1024),
    // What a heap may keep free at its end.
    (libc::M_TRIM_THRESHOLD, 128 * 1024),
    // Blocks up to this size are set aside unmerged: none.
    (libc::M_MXFAST, 0),
];

/// Gives memory back as long as the runtime lives.
pub(crate) async fn give_back_regularly() {
    bound_kept();
    let mut ticks = interval(INTERVAL);
    loop {
        ticks.tick().await;
        // On a thread that may block: a large heap takes some milliseconds.
        let _ = tokio::task::spawn_blocking(give_back).await;
    }
}

/// Has heaps keep little of what is free.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "the allocator has no safe interface")]
fn bound_kept() {
    for (parameter, bytes) in BOUNDS {
        // SAFETY: the function takes two numbers, and keeps its own locks.
        let is_set = unsafe { libc::mallopt(parameter, bytes) } == 1;
        debug_assert!(is_set, "the allocator knows {parameter}");
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn bound_kept() {}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "the allocator has no safe interface")]
fn give_back() {
    // SAFETY: the function takes a number, keeps its own locks, and touches only pages that are not in use.
    unsafe { libc::malloc_trim(0) };
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn give_back() {}

#[cfg(test)]
#[cfg(all(target_os = "linux", target_env = "gnu"))]
mod tests {
    use super::*;

    /// Below what the allocator adapts to.
    const ALL_BYTES: usize = 24 << 20;
    /// Part of a heap.
    const SMALL_BYTES: usize = 60_000;
    /// With pages of its own.
    const LARGE_BYTES: usize = 80_000;

    fn resident_bytes() -> usize {
        let statm = std::fs::read_to_string("/proc/self/statm").unwrap();
        // Pages of 4 KiB.
        statm.split(' ').nth(1).unwrap().parse::<usize>().unwrap() * 4096
    }

    /// What stays resident of freed blocks of this size, bytes, on a thread of their own. They lie below one that is used
    /// for longer, or at the end of the heap.
    fn kept_bytes(block_bytes: usize, is_at_end: bool, give_back: fn()) -> usize {
        let kept = std::thread::spawn(move || {
            // Left to itself, the allocator would keep twice as much from here on.
            drop(vec![1_u8; ALL_BYTES]);
            give_back();
            let before = resident_bytes();
            let blocks: Vec<_> = (0..ALL_BYTES / block_bytes).map(|_| vec![1_u8; block_bytes]).collect();
            let end = (!is_at_end).then(|| vec![1_u8; SMALL_BYTES]);
            drop(blocks);
            give_back();
            let kept = resident_bytes().saturating_sub(before);
            drop(end);
            kept
        });
        kept.join().unwrap()
    }

    /// One test: several at once would count each other's memory.
    #[test]
    fn heap_of_a_thread_keeps_little() {
        bound_kept();
        let kept = kept_bytes(SMALL_BYTES, true, give_back);
        assert!(kept < ALL_BYTES / 4, "{kept} bytes at its end");
        let kept = kept_bytes(LARGE_BYTES, false, || ());
        assert!(kept < ALL_BYTES / 4, "{kept} bytes of large blocks");
    }
}
