//! Counted admission and the waiting jobs.

use std::collections::{BTreeMap, VecDeque};
use std::mem;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use super::caller::{CallerId, turn};
use super::clocks::Clocks;
use super::expected_start::expected_start;
use super::job::Job;
use super::lock::lock;
use super::stop::{StopCause, StopHandle};
use super::sync::{Condvar, Mutex, PoisonError};
use super::worker_slots::WorkerSlots;

/// How much may be in flight at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capacity {
    /// Jobs that may be in flight, each with a permit.
    pub permits: usize,
    /// Total remaining time that the jobs in flight may be expected to take; does not bind while fewer jobs are in
    /// flight than there are workers, so that a job of any length can run on an idle worker.
    pub work: Duration,
}

/// The jobs in the queue at one moment, waiting and running.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Backlog {
    /// Jobs that wait or run.
    pub jobs: usize,
    /// Total remaining time that they are expected to take, one after the other.
    pub work: Duration,
}

/// Why no permit was issued.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// The capacity is used up.
    Full,
    /// The queue is closed.
    Closed,
}

/// The issued permits, and the jobs that wait for a worker.
#[derive(Debug)]
pub(super) struct BoundedQueue {
    state: Mutex<State>,
    /// Wakes workers: a job was submitted, a loan was given back, or the last job ended after closing.
    changed: Condvar,
    /// Wakes those who wait for a permit: one was released, or the queue was closed.
    permit_released: Notify,
    workers: usize,
    capacity: Capacity,
}

#[derive(Debug)]
struct State {
    open: bool,
    /// Set once everything in flight has to stop, also jobs that are submitted with a permit issued before.
    cancelled: Option<StopCause>,
    in_flight: usize,
    next_id: u64,
    waiting: VecDeque<Job>,
    slots: WorkerSlots,
    /// All submitted jobs, waiting and running.
    submitted: BTreeMap<u64, Submitted>,
}

/// A job that was submitted and has not ended.
#[derive(Debug)]
struct Submitted {
    caller: CallerId,
    stop: StopHandle,
    clocks: Clocks,
    /// When a worker took the job.
    started: Option<Instant>,
}

impl Submitted {
    /// How long it will probably run from now on, or from its start.
    fn expected_rest(&self, now: Instant) -> Duration {
        self.clocks.expected_rest(self.started.unwrap_or(now), now)
    }
}

impl State {
    /// The submitted jobs, and how long they are expected to take.
    fn backlog(&self) -> Backlog {
        let now = Instant::now();
        let rests = self.submitted.values().map(|submitted| submitted.expected_rest(now));
        Backlog { jobs: self.submitted.len(), work: rests.fold(Duration::ZERO, Duration::saturating_add) }
    }

    /// Where one more job of a caller comes among those that wait.
    fn turn(&self, caller: CallerId) -> usize {
        // A job whose permit is being released has no entry any more, and is about to leave.
        let caller_of = |job: &Job| self.submitted.get(&job.id()).map(|submitted| submitted.caller);
        turn(self.waiting.iter().map(|job| caller_of(job).unwrap_or_default()), caller)
    }

    /// When a worker will probably be free for one more job of a caller.
    fn expected_start(&self, now: Instant, workers: usize, caller: CallerId) -> Instant {
        let running = self.submitted.values().filter(|submitted| submitted.started.is_some());
        // Beyond the range of the clock nothing ends.
        let ends = running.map(|submitted| now.checked_add(submitted.expected_rest(now)).unwrap_or(now));
        let before = self.waiting.iter().take(self.turn(caller));
        let waiting = before.filter_map(|job| self.submitted.get(&job.id()));
        expected_start(now, workers, ends, waiting.map(|submitted| &submitted.clocks))
    }
}

/// How many jobs the queue holds at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Load {
    /// Jobs that wait for a worker.
    pub waiting: usize,
    /// Jobs that run.
    pub running: usize,
}

impl BoundedQueue {
    pub(super) fn new(workers: usize, capacity: Capacity) -> Self {
        let state = State {
            open: true,
            cancelled: None,
            in_flight: 0,
            next_id: 0,
            waiting: VecDeque::new(),
            slots: WorkerSlots::new(workers),
            submitted: BTreeMap::new(),
        };
        Self { state: Mutex::new(state), changed: Condvar::new(), permit_released: Notify::new(), workers, capacity }
    }

    /// Counts one more job in flight and gives its number, until [`BoundedQueue::release`].
    pub(super) fn reserve(&self) -> Result<u64, Refusal> {
        self.reserve_within(self.capacity)
    }

    /// Reserves while there are permits.
    pub(super) fn reserve_for_any_work(&self) -> Result<u64, Refusal> {
        self.reserve_within(Capacity { work: Duration::MAX, ..self.capacity })
    }

    /// Reserves while less is in flight than `capacity`.
    fn reserve_within(&self, capacity: Capacity) -> Result<u64, Refusal> {
        let mut state = lock(&self.state);
        if !state.open {
            return Err(Refusal::Closed);
        }
        let has_work = || state.in_flight >= self.workers && state.backlog().work >= capacity.work;
        if state.in_flight >= capacity.permits.min(self.capacity.permits) || has_work() {
            return Err(Refusal::Full);
        }
        state.in_flight += 1;
        let id = state.next_id;
        state.next_id += 1;
        Ok(id)
    }

    /// Waits until less is in flight than `capacity` and reserves; fails only when the queue is closed.
    pub(super) async fn wait_for_permit(&self, capacity: Capacity) -> Result<u64, Refusal> {
        loop {
            let freed = self.permit_released.notified();
            match self.reserve_within(capacity) {
                Err(Refusal::Full) => freed.await,
                decided => {
                    // The end of one long job may free capacity for several short ones: wake the next waiter too.
                    self.permit_released.notify_one();
                    return decided;
                }
            }
        }
    }

    /// The jobs that wait or run, and how long they are expected to take.
    pub(super) fn backlog(&self) -> Backlog {
        lock(&self.state).backlog()
    }

    /// How long one more job of a caller will probably wait for a worker.
    pub(super) fn expected_wait(&self, caller: CallerId) -> Duration {
        let now = Instant::now();
        lock(&self.state).expected_start(now, self.workers, caller).saturating_duration_since(now)
    }

    /// Which in the queue one more job of a caller would be: 0 where a worker is idle, 1 where it is the next to start.
    pub(super) fn position(&self, caller: CallerId) -> usize {
        let state = lock(&self.state);
        let before = state.submitted.len().saturating_sub(state.waiting.len()) + state.turn(caller);
        (before + 1).saturating_sub(self.workers)
    }

    /// Workers whose job still runs although it was signalled to stop longer than `timeout` ago.
    pub(super) fn stuck(&self, timeout: Duration) -> usize {
        let state = lock(&self.state);
        let is_stuck = |submitted: &Submitted| submitted.stop.stopped_at().is_some_and(|time| time.elapsed() > timeout);
        let running = || state.submitted.values().filter(|submitted| submitted.started.is_some());
        let stuck = running().filter(|submitted| is_stuck(submitted)).count();
        // When all jobs are stuck, so are the workers that they have borrowed.
        if stuck > 0 && stuck == running().count() { stuck + state.slots.lent() } else { stuck }
    }

    /// Jobs that wait, and jobs that run.
    pub(super) fn load(&self) -> Load {
        let state = lock(&self.state);
        let waiting = state.waiting.len();
        // A job that was removed from the queue releases its permit a moment later.
        Load { waiting, running: state.submitted.len().saturating_sub(waiting) }
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
        self.permit_released.notify_waiters();
    }

    pub(super) fn cancel_all(&self, cause: StopCause) {
        let (waiting, stops) = {
            let mut state = lock(&self.state);
            state.open = false;
            state.cancelled = Some(cause);
            (
                mem::take(&mut state.waiting),
                state.submitted.values().map(|submitted| submitted.stop.clone()).collect::<Vec<_>>(),
            )
        };
        for stop in stops {
            stop.cut_off(cause);
        }
        // Outside the lock: the dropped jobs release their permits, which takes it.
        drop(waiting);
        self.changed.notify_all();
        self.permit_released.notify_waiters();
    }

    /// The first waiting job; blocks until there is one and a worker to run it. `None` once the queue is closed and nothing
    /// is in flight.
    pub(super) fn next(&self) -> Option<Job> {
        let mut state = lock(&self.state);
        loop {
            if state.slots.has_idle()
                && let Some(job) = state.waiting.pop_front()
            {
                state.slots.begin_job(job.id());
                if let Some(submitted) = state.submitted.get_mut(&job.id()) {
                    submitted.started = Some(Instant::now());
                }
                return Some(job);
            }
            // A job may yet be submitted with an issued permit: workers stay until the last one is released.
            if !state.open && state.in_flight == 0 {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Borrows an idle worker, unless a job waits for one.
    pub(super) fn lend(&self) -> Option<(u64, Arc<AtomicBool>)> {
        let mut state = lock(&self.state);
        (state.waiting.is_empty() && state.slots.has_idle()).then(|| state.slots.lend())
    }

    pub(super) fn give_back_loan(&self, loan: u64) {
        lock(&self.state).slots.give_back(loan);
        self.changed.notify_one();
    }

    pub(super) fn lent(&self) -> usize {
        lock(&self.state).slots.lent()
    }

    /// Removes a job if it still waits; its permit is released.
    pub(super) fn remove(&self, id: u64) {
        let removed = {
            let mut state = lock(&self.state);
            let position = state.waiting.iter().position(|job| job.id() == id);
            position.and_then(|position| state.waiting.remove(position))
        };
        // Outside the lock: the dropped job releases its permit, which takes it.
        drop(removed);
    }

    /// Queues a job of a caller at its turn; `stop` and `clocks` are kept until its permit is released.
    pub(super) fn push(&self, job: Job, stop: StopHandle, clocks: Clocks, caller: CallerId) {
        let mut state = lock(&self.state);
        if let Some(cause) = state.cancelled {
            stop.cut_off(cause);
        }
        state.submitted.insert(job.id(), Submitted { caller, stop, clocks, started: None });
        let turn = state.turn(caller);
        state.waiting.insert(turn, job);
        state.slots.recall_for(state.waiting.len());
        drop(state);
        self.changed.notify_one();
    }

    /// Ends what [`BoundedQueue::reserve`] has begun.
    pub(super) fn release(&self, id: u64) {
        let mut state = lock(&self.state);
        state.in_flight -= 1;
        state.slots.end_job(id);
        // Bound to a name so that it is dropped after the lock.
        let _submitted = state.submitted.remove(&id);
        let was_last = !state.open && state.in_flight == 0;
        drop(state);
        if was_last {
            self.changed.notify_all();
        }
        self.permit_released.notify_one();
    }
}
