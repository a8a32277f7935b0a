//! Threads that share the work of a solve. The solver starts none: its caller may lend some.

use std::sync::atomic::{AtomicBool, Ordering};

/// Work in independent parts that several threads may do at once.
pub trait SharedWork: Sync {
    /// Number of parts that no thread has begun.
    fn open_parts(&self) -> usize;

    /// Takes the first open part and runs it; false when there is none. That need not be the end: a part that is given back
    /// is open again. A helper whose `recalled` flag is set gives its part back within a time step.
    ///
    /// # Panics
    /// When the part panics; the other parts then end within a time step.
    fn take_part(&self, recalled: &AtomicBool) -> bool;
}

/// The threads that run shared work.
pub trait Helpers: Sync {
    /// Runs the work on the calling thread and on any helpers; returns when no part is open or running.
    ///
    /// # Panics
    /// When a part panics, on any thread.
    fn share(&self, work: &dyn SharedWork);
}

/// No helpers: the calling thread runs one part after the other.
#[derive(Debug, Clone, Copy, Default)]
pub struct Alone;

impl Helpers for Alone {
    fn share(&self, work: &dyn SharedWork) {
        static NEVER: AtomicBool = AtomicBool::new(false);
        while work.take_part(&NEVER) {}
    }
}

/// Cancels the other parts of shared work when one panics.
pub(crate) struct CancelOnPanic<'a>(&'a AtomicBool);

impl<'a> CancelOnPanic<'a> {
    /// Sets the flag where it is dropped before [`Self::disarm`].
    pub(crate) fn new(is_cancelled: &'a AtomicBool) -> Self {
        Self(is_cancelled)
    }

    /// The part has ended by itself.
    pub(crate) fn disarm(self) {
        std::mem::forget(self);
    }
}

impl Drop for CancelOnPanic<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
