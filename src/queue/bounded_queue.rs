//! Counted admission and the line of waiting jobs.

use std::collections::{BTreeMap, VecDeque};
use std::mem;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use super::job::{self, Clocks, Departure, Job, Ticket};
use super::lending::{IdleWorkers, Turns};
use super::lock;
use super::stop::{StopCause, StopHandle};
use super::watchdog::Watchdog;

/// How much may be in flight at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// Places that may be taken.
    pub places: usize,
    /// What the jobs in flight may still be expected to take, all together; does not bind while fewer jobs are in flight
    /// than there are workers, so that a job of any length finds its worker.
    pub work: Duration,
}

/// What is in flight before a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ahead {
    /// Jobs that wait or run.
    pub jobs: usize,
    /// What they are expected to take until they have ended, one after the other.
    pub work: Duration,
}

/// Why no place was given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// All places are taken.
    Full,
    /// The queue was closed.
    Closed,
}

/// The places, and the jobs that wait for a worker.
#[derive(Debug)]
pub(super) struct BoundedQueue {
    state: Mutex<State>,
    /// Wakes workers: a job came, a loan was given back, or the last job ended after closing.
    changed: Condvar,
    /// Wakes those who wait for a place: one was given back, or the queue was closed.
    place_freed: Notify,
    workers: usize,
    room: Room,
}

#[derive(Debug)]
struct State {
    open: bool,
    /// Set once everything in flight has to stop, also places that are filled later.
    cancelled: Option<StopCause>,
    in_flight: usize,
    next_id: u64,
    waiting: VecDeque<Job>,
    turns: Turns,
    /// All filled places, waiting and running.
    filled: BTreeMap<u64, Filled>,
}

/// A place with its job.
#[derive(Debug)]
struct Filled {
    stop: StopHandle,
    estimate: Duration,
    /// When a worker took the job.
    started: Option<Instant>,
}

impl State {
    /// What the filled places are expected to take.
    fn ahead(&self) -> Ahead {
        let rest = |filled: &Filled| match filled.started {
            Some(started) => filled.estimate.saturating_sub(started.elapsed()),
            None => filled.estimate,
        };
        let work = self.filled.values().map(rest).fold(Duration::ZERO, Duration::saturating_add);
        Ahead { jobs: self.filled.len(), work }
    }
}

/// What the queue holds at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Load {
    /// Jobs that wait for a worker.
    pub waiting: usize,
    /// Jobs that run.
    pub running: usize,
}

impl BoundedQueue {
    pub(super) fn new(workers: usize, room: Room) -> Self {
        let state = State {
            open: true,
            cancelled: None,
            in_flight: 0,
            next_id: 0,
            waiting: VecDeque::new(),
            turns: Turns::new(workers),
            filled: BTreeMap::new(),
        };
        Self { state: Mutex::new(state), changed: Condvar::new(), place_freed: Notify::new(), workers, room }
    }

    pub(super) fn reserve(self: &Arc<Self>, watchdog: &Arc<Watchdog>) -> Result<Place, Refusal> {
        self.reserve_within(self.room, watchdog)
    }

    /// Reserves a place while less is in flight than `room`.
    fn reserve_within(self: &Arc<Self>, room: Room, watchdog: &Arc<Watchdog>) -> Result<Place, Refusal> {
        let mut state = lock(&self.state);
        if !state.open {
            return Err(Refusal::Closed);
        }
        let has_work = || state.in_flight >= self.workers && state.ahead().work >= room.work;
        if state.in_flight >= room.places.min(self.room.places) || has_work() {
            return Err(Refusal::Full);
        }
        state.in_flight += 1;
        let id = state.next_id;
        state.next_id += 1;
        Ok(Place { queue: Arc::clone(self), watchdog: Arc::clone(watchdog), id })
    }

    /// Waits until less is in flight than `room` and reserves a place; fails only when the queue is closed.
    pub(super) async fn wait_for_place(
        self: &Arc<Self>,
        room: Room,
        watchdog: &Arc<Watchdog>,
    ) -> Result<Place, Refusal> {
        loop {
            let freed = self.place_freed.notified();
            match self.reserve_within(room, watchdog) {
                Err(Refusal::Full) => freed.await,
                decided => {
                    // One long job that ended may leave room for several short ones.
                    self.place_freed.notify_one();
                    return decided;
                }
            }
        }
    }

    /// What waits or runs.
    pub(super) fn ahead(&self) -> Ahead {
        lock(&self.state).ahead()
    }

    /// Workers whose job still runs although it was told to stop longer than `patience` ago.
    pub(super) fn stuck(&self, patience: Duration) -> usize {
        let state = lock(&self.state);
        let is_stuck = |filled: &Filled| filled.stop.stopped_at().is_some_and(|time| time.elapsed() > patience);
        let running = || state.filled.values().filter(|filled| filled.started.is_some());
        let stuck = running().filter(|filled| is_stuck(filled)).count();
        // Where all jobs are stuck, so are the workers that they have borrowed.
        if stuck > 0 && stuck == running().count() { stuck + state.turns.lent() } else { stuck }
    }

    /// Jobs that wait, and jobs that run.
    pub(super) fn load(&self) -> Load {
        let state = lock(&self.state);
        let waiting = state.waiting.len();
        // A job that was taken out of the line gives its place back a moment later.
        Load { waiting, running: state.filled.len().saturating_sub(waiting) }
    }

    pub(super) fn is_open(&self) -> bool {
        lock(&self.state).open
    }

    pub(super) fn in_flight(&self) -> usize {
        lock(&self.state).in_flight
    }

    pub(super) fn close(&self) {
        lock(&self.state).open = false;
        self.changed.notify_all();
        self.place_freed.notify_waiters();
    }

    pub(super) fn cancel_all(&self, cause: StopCause) {
        let (waiting, stops) = {
            let mut state = lock(&self.state);
            state.open = false;
            state.cancelled = Some(cause);
            (mem::take(&mut state.waiting), state.filled.values().map(|filled| filled.stop.clone()).collect::<Vec<_>>())
        };
        for stop in stops {
            stop.stop(cause);
        }
        // Outside the lock: the jobs give their places back.
        drop(waiting);
        self.changed.notify_all();
        self.place_freed.notify_waiters();
    }

    /// The oldest waiting job; blocks until there is one and a worker to run it. `None` once the queue is closed and nothing
    /// is in flight.
    pub(super) fn next(&self) -> Option<Job> {
        let mut state = lock(&self.state);
        loop {
            if state.turns.has_idle()
                && let Some(job) = state.waiting.pop_front()
            {
                state.turns.begin_job(job.id());
                if let Some(filled) = state.filled.get_mut(&job.id()) {
                    filled.started = Some(Instant::now());
                }
                return Some(job);
            }
            // A reserved place may yet be filled: workers stay until the last one is given back.
            if !state.open && state.in_flight == 0 {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Borrows an idle worker, unless a job waits for one.
    pub(super) fn lend(&self) -> Option<(u64, Arc<AtomicBool>)> {
        let mut state = lock(&self.state);
        (state.waiting.is_empty() && state.turns.has_idle()).then(|| state.turns.lend())
    }

    pub(super) fn give_back_loan(&self, loan: u64) {
        lock(&self.state).turns.give_back(loan);
        self.changed.notify_one();
    }

    pub(super) fn lent(&self) -> usize {
        lock(&self.state).turns.lent()
    }

    /// Takes a job out of the line, if it still waits there.
    pub(super) fn remove(&self, id: u64) {
        let removed = {
            let mut state = lock(&self.state);
            let position = state.waiting.iter().position(|job| job.id() == id);
            position.and_then(|position| state.waiting.remove(position))
        };
        // Outside the lock: the job gives its place back.
        drop(removed);
    }

    fn push(&self, job: Job, stop: StopHandle, estimate: Duration) {
        let mut state = lock(&self.state);
        if let Some(cause) = state.cancelled {
            stop.stop(cause);
        }
        state.filled.insert(job.id(), Filled { stop, estimate, started: None });
        state.waiting.push_back(job);
        state.turns.recall_for(state.waiting.len());
        drop(state);
        self.changed.notify_one();
    }

    fn give_back(&self, id: u64) {
        let mut state = lock(&self.state);
        state.in_flight -= 1;
        state.turns.end_job(id);
        // Bound to a name so that it is dropped after the lock.
        let _filled = state.filled.remove(&id);
        let was_last = !state.open && state.in_flight == 0;
        drop(state);
        if was_last {
            self.changed.notify_all();
        }
        self.place_freed.notify_one();
    }
}

/// The right to put one job into the queue; given back on drop.
#[derive(Debug)]
pub struct Place {
    queue: Arc<BoundedQueue>,
    watchdog: Arc<Watchdog>,
    id: u64,
}

impl Place {
    /// The number of the job in this process, for logs.
    pub fn job_id(&self) -> u64 {
        self.id
    }

    /// What waits or runs ahead of this place.
    pub fn ahead(&self) -> Ahead {
        self.queue.ahead()
    }

    /// The workers that the job of this place may borrow while it runs.
    pub fn idle_workers(&self) -> IdleWorkers {
        IdleWorkers::new(Arc::clone(&self.queue))
    }

    /// Queues `work`; it hears of its clocks through the stop handle.
    pub fn fill<T: Send + 'static>(
        self,
        clocks: Clocks,
        work: impl FnOnce(&StopHandle) -> T + Send + 'static,
    ) -> Ticket<T> {
        let (queue, watchdog) = (Arc::clone(&self.queue), Arc::clone(&self.watchdog));
        let (id, stop) = (self.id, StopHandle::new());
        let departure = Departure::new(stop.clone(), Arc::downgrade(&queue), id);
        let (job, ticket) = job::pair(self, id, (stop.clone(), departure), clocks, work);
        queue.push(job, stop.clone(), clocks.estimate);
        // After the job is in the line, so that a time that has passed already finds it there.
        let watch = clocks.stop_time().map(|time| {
            let line = (Arc::downgrade(&queue), id);
            watchdog.watch_waiting(&stop, (time, StopCause::Deadline), line)
        });
        ticket.watched_by(watch)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.queue.give_back(self.id);
    }
}
