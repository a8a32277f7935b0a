//! Locking that ignores poisoning.
//!
//! A poisoned lock is safe to use throughout the queue: no foreign code runs while one of its locks is held, and each
//! critical section leaves the state valid after every statement.

use super::sync::{Mutex, MutexGuard, PoisonError};

/// Locks the mutex, also after a panic of another holder.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
