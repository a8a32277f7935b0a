//! Threads that share the work of a solve. The solver starts none: its caller may lend some.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::run_control::RunControl;
use crate::stop::Stop;

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

/// Runs parts by their numbers on the calling thread and on the helpers of the control, in any order; what each came to, none where the
/// control ended it. A part that comes to nothing before, since its helper was recalled, is run again.
///
/// # Panics
/// When a part panics, on any thread.
pub(crate) fn in_parts<T: Send>(
    control: &RunControl,
    count: usize,
    run: &(dyn Fn(usize, Stop) -> Option<T> + Sync),
) -> Vec<Option<T>> {
    let parts = Slots { open: (0..count).collect(), outcomes: (0..count).map(|_| None).collect() };
    let parts = Parts { control, run, slots: Mutex::new(parts), is_cancelled: AtomicBool::new(false) };
    control.share(&parts);
    parts.slots.into_inner().unwrap_or_else(PoisonError::into_inner).outcomes
}

struct Parts<'a, T> {
    control: &'a RunControl<'a>,
    run: &'a (dyn Fn(usize, Stop) -> Option<T> + Sync),
    slots: Mutex<Slots<T>>,
    /// Set when a part panics: the others are no longer needed.
    is_cancelled: AtomicBool,
}

struct Slots<T> {
    /// The parts that nobody has begun, or that were given back.
    open: BTreeSet<usize>,
    /// What each of the others came to.
    outcomes: Vec<Option<T>>,
}

impl<T> Parts<'_, T> {
    fn slots(&self) -> MutexGuard<'_, Slots<T>> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_over(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed) || self.control.is_stopped()
    }
}

impl<T: Send> SharedWork for Parts<'_, T> {
    fn open_parts(&self) -> usize {
        if self.is_over() { 0 } else { self.slots().open.len() }
    }

    fn take_part(&self, recalled: &AtomicBool) -> bool {
        if self.is_over() || recalled.load(Ordering::Relaxed) {
            return false;
        }
        let Some(index) = self.slots().open.pop_first() else { return false };
        let alarm = CancelOnPanic(&self.is_cancelled);
        let outcome = (self.run)(index, self.control.stop().interrupted_by([&self.is_cancelled, recalled]));
        // The part has ended by itself.
        std::mem::forget(alarm);
        let mut slots = self.slots();
        if outcome.is_none() {
            slots.open.insert(index);
        }
        slots.outcomes[index] = outcome;
        true
    }
}

/// Cancels the other parts where it is dropped, which it is by a panic alone.
struct CancelOnPanic<'a>(&'a AtomicBool);

impl Drop for CancelOnPanic<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
