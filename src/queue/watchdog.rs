//! One thread that stops jobs and cuts them off when their time limit or deadline has come.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};
use std::time::Instant;
use std::{io, mem};

use super::bounded_queue::BoundedQueue;
use super::lock::lock;
use super::stop::{StopCause, StopHandle};
use super::sync::thread::{Builder, JoinHandle};
use super::sync::{Condvar, Mutex, PoisonError};

/// The watchdog thread and the times that it watches.
#[derive(Debug)]
pub(super) struct Watchdog {
    watched: Arc<Watched>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

#[derive(Debug, Default)]
struct Watched {
    state: Mutex<State>,
    changed: Condvar,
}

/// Sorted by time, so that the first entry is the next one due; the number distinguishes equal times.
type Due = BTreeMap<(Instant, u64), Alarm>;

/// How a job is signalled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Signal {
    /// It completes its answer.
    Stop,
    /// It returns at once.
    CutOff,
}

/// What is done at a watched time.
#[derive(Debug)]
struct Alarm {
    stop: StopHandle,
    signal: Signal,
    cause: StopCause,
    /// The queue that the job may still wait in, and its number there.
    queued: Option<(Weak<BoundedQueue>, u64)>,
}

impl Alarm {
    fn fire(self) {
        let Self { stop, signal, cause, queued } = self;
        match signal {
            Signal::Stop => stop.stop(cause),
            Signal::CutOff => stop.cut_off(cause),
        }
        if let Some((queue, id)) = queued
            && let Some(queue) = queue.upgrade()
        {
            queue.remove(id);
        }
    }
}

#[derive(Debug, Default)]
struct State {
    due: Due,
    next_number: u64,
    closed: bool,
}

impl Watchdog {
    pub(super) fn start() -> io::Result<Self> {
        let watched = Arc::new(Watched::default());
        let thread = {
            let watched = Arc::clone(&watched);
            Builder::new().name("slipdrive-watchdog".to_owned()).spawn(move || watched.watch_until_closed())?
        };
        Ok(Self { watched, thread: Mutex::new(Some(thread)) })
    }

    /// Signals the job at `time` for `cause`, unless the watch is dropped before.
    pub(super) fn watch(&self, stop: &StopHandle, (time, signal, cause): (Instant, Signal, StopCause)) -> Watch {
        self.set(time, Alarm { stop: stop.clone(), signal, cause, queued: None })
    }

    /// Cuts the job off at `time` for `cause`, and removes it from its queue if it still waits there.
    pub(super) fn watch_queued(
        &self,
        stop: &StopHandle,
        (time, cause): (Instant, StopCause),
        queued: (Weak<BoundedQueue>, u64),
    ) -> Watch {
        self.set(time, Alarm { stop: stop.clone(), signal: Signal::CutOff, cause, queued: Some(queued) })
    }

    fn set(&self, time: Instant, alarm: Alarm) -> Watch {
        let mut state = lock(&self.watched.state);
        let key = (time, state.next_number);
        state.next_number += 1;
        state.due.insert(key, alarm);
        drop(state);
        self.watched.changed.notify_one();
        Watch { watched: Arc::clone(&self.watched), key }
    }

    pub(super) fn join(&self) {
        self.close();
        if let Some(thread) = mem::take(&mut *lock(&self.thread)) {
            // The thread runs no foreign code: it cannot have panicked.
            let _ = thread.join();
        }
    }

    fn close(&self) {
        lock(&self.watched.state).closed = true;
        self.watched.changed.notify_one();
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.close();
    }
}

impl Watched {
    fn watch_until_closed(&self) {
        let mut state = lock(&self.state);
        while !state.closed {
            let now = Instant::now();
            if let Some(entry) = state.due.first_entry().filter(|entry| entry.key().0 <= now) {
                let alarm = entry.remove();
                // Outside the lock: a job that the alarm removes drops its own watches, which take it.
                drop(state);
                alarm.fire();
                state = lock(&self.state);
                continue;
            }
            state = match state.due.first_key_value() {
                Some(((time, _), _)) => {
                    let wait = time.saturating_duration_since(now);
                    self.changed.wait_timeout(state, wait).unwrap_or_else(PoisonError::into_inner).0
                }
                None => self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
            };
        }
    }
}

/// One watched time; dropping it ends the watch.
#[derive(Debug)]
pub(super) struct Watch {
    watched: Arc<Watched>,
    key: (Instant, u64),
}

impl Drop for Watch {
    fn drop(&mut self) {
        lock(&self.watched.state).due.remove(&self.key);
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn dropped_watch_is_forgotten() {
        let watchdog = Watchdog::start().unwrap();
        let stop = StopHandle::new();
        let watch =
            watchdog.watch(&stop, (Instant::now() + Duration::from_secs(3600), Signal::Stop, StopCause::TimeLimit));
        drop(watch);
        assert!(lock(&watchdog.watched.state).due.is_empty());
        watchdog.join();
        assert_eq!(stop.cause(), None);
    }

    #[test]
    fn earlier_time_overtakes_a_later_one() {
        let watchdog = Watchdog::start().unwrap();
        let (late, early) = (StopHandle::new(), StopHandle::new());
        let _late =
            watchdog.watch(&late, (Instant::now() + Duration::from_secs(3600), Signal::Stop, StopCause::TimeLimit));
        let _early = watchdog.watch(&early, (Instant::now(), Signal::CutOff, StopCause::Deadline));
        while early.cut_cause().is_none() {
            std::thread::yield_now();
        }
        assert_eq!((early.cut_cause(), late.cause()), (Some(StopCause::Deadline), None));
    }
}
