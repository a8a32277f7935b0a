//! The locks and threads of the queue: those of std, or those of `shuttle`, whose schedules [`super::model`] explores.

#[cfg(all(test, shuttle))]
pub(super) use shuttle::{
    sync::{Condvar, Mutex, MutexGuard, mpsc},
    thread,
};
pub(super) use std::sync::PoisonError;
#[cfg(not(all(test, shuttle)))]
pub(super) use std::{
    sync::{Condvar, Mutex, MutexGuard, mpsc},
    thread,
};

/// Starts a thread within the scope; false when the system refuses it.
#[cfg(not(all(test, shuttle)))]
pub(super) fn spawn_scoped<'scope>(
    threads: &'scope thread::Scope<'scope, '_>,
    name: &str,
    work: impl FnOnce() + Send + 'scope,
) -> bool {
    thread::Builder::new().name(name.to_owned()).spawn_scoped(threads, work).is_ok()
}

/// As above; `shuttle` refuses none, and has no names for them.
#[cfg(all(test, shuttle))]
pub(super) fn spawn_scoped<'scope>(
    threads: &'scope thread::Scope<'scope, '_>,
    _name: &str,
    work: impl FnOnce() + Send + 'scope,
) -> bool {
    threads.spawn(work);
    true
}
