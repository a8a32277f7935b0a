//! Threads that may work on a solve beside its own. The solver has none: whoever calls it may lend some.

use std::sync::atomic::AtomicBool;

/// Work in independent parts that several threads may do at once.
pub trait SharedWork: Sync {
    /// Parts that nobody has begun.
    fn open_parts(&self) -> usize;

    /// Begins the first open part and does it; false when there is none, which need not be the end: a part that is
    /// given back is open again. A helper that finds `recalled` set gives its part back within a rollout.
    ///
    /// # Panics
    /// When the part panics; the other parts then end within a rollout.
    fn take_part(&self, recalled: &AtomicBool) -> bool;
}

/// Who does shared work.
pub trait Helpers: Sync {
    /// Does the work on the calling thread, and on any others; returns when no part is open and none is under way.
    ///
    /// # Panics
    /// When a part panics, on whatever thread.
    fn share(&self, work: &dyn SharedWork);
}

/// No helpers: the calling thread does one part after the other.
#[derive(Debug, Clone, Copy, Default)]
pub struct Alone;

impl Helpers for Alone {
    fn share(&self, work: &dyn SharedWork) {
        static NEVER: AtomicBool = AtomicBool::new(false);
        while work.take_part(&NEVER) {}
    }
}
