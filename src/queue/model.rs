//! The protocol of the queue under schedules of threads that `shuttle` chooses: at random, and by random priorities with
//! few changes (PCT), which finds races of few steps with a known probability.
//!
//! A schedule fails when its threads block each other, or when one of the facts below does not hold. Each model ends with
//! [`Queue::join`], so a job that is lost or a permit that is kept blocks it.
//!
//! Outside the model: time (a watch fires at once or never), panics of jobs, and what happens within an operation of
//! tokio's `oneshot` and `Notify`, of `OnceLock` and of the stop and recall flags: threads change at the locks,
//! condition variables, channels and yields around them, as if each of these operations were one step.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use shuttle::future::block_on;
use shuttle::thread::{spawn, yield_now};
use shuttle::{check_pct, check_random};

use super::{Capacity, Clocks, JobOutcome, Permit, Queue, Refusal, StopCause, StopHandle, Ticket};

/// Schedules per model and kind.
const SCHEDULES: usize = 3000;
/// Changes of priority: most races need two or three.
const CHANGES: usize = 3;

/// Runs the model under many schedules.
fn explore(model: impl Fn() + Copy + Send + Sync + 'static) {
    check_random(model, SCHEDULES);
    check_pct(model, SCHEDULES, CHANGES);
}

fn capacity(permits: usize) -> Capacity {
    Capacity { permits, work: Duration::MAX }
}

/// A queue, the threads that work at one moment, and the jobs that were begun.
struct Model {
    queue: Queue,
    workers: usize,
    working: AtomicUsize,
    begun: AtomicUsize,
}

impl Model {
    fn start(workers: usize, permits: usize) -> Arc<Self> {
        let queue = Queue::start(NonZeroUsize::new(workers).unwrap(), capacity(permits)).unwrap();
        Arc::new(Self { queue, workers, working: AtomicUsize::new(0), begun: AtomicUsize::new(0) })
    }

    /// Work of some steps, never on more threads than there are workers.
    fn work(&self) {
        assert!(self.working.fetch_add(1, Ordering::SeqCst) < self.workers, "too many threads work at once");
        yield_now();
        self.working.fetch_sub(1, Ordering::SeqCst);
    }

    /// Submits a job that answers with its number.
    fn submit(self: &Arc<Self>, permit: Permit, clocks: Clocks, number: usize) -> Ticket<usize> {
        let model = Arc::clone(self);
        permit.submit(clocks, move |_| {
            model.begun.fetch_add(1, Ordering::SeqCst);
            model.work();
            number
        })
    }

    /// Submits a job that shares `count` parts with idle workers, and answers how often each was done.
    fn submit_shared(self: &Arc<Self>, permit: Permit, count: usize) -> Ticket<Vec<usize>> {
        let (model, idle) = (Arc::clone(self), permit.idle_workers());
        permit.submit(Clocks::default(), move |_| {
            model.begun.fetch_add(1, Ordering::SeqCst);
            let open = super::sync::Mutex::new((0..count).collect::<Vec<_>>());
            let done: Vec<_> = (0..count).map(|_| AtomicUsize::new(0)).collect();
            let take_part = |is_recalled: &AtomicBool| {
                if is_recalled.load(Ordering::Relaxed) {
                    return false;
                }
                let Some(number) = super::lock::lock(&open).pop() else { return false };
                model.work();
                if is_recalled.load(Ordering::Relaxed) {
                    super::lock::lock(&open).push(number);
                } else {
                    done[number].fetch_add(1, Ordering::SeqCst);
                }
                true
            };
            idle.share(&|| super::lock::lock(&open).len(), &take_part);
            done.into_iter().map(AtomicUsize::into_inner).collect()
        })
    }

    /// Closes the queue; nothing is left in it.
    fn end(&self) {
        self.queue.join();
        let load = self.queue.load();
        assert_eq!((self.queue.in_flight(), load.waiting, load.running, self.queue.helping_workers()), (0, 0, 0, 0));
    }
}

/// A job that goes on until it is stopped.
fn until_stopped(stop: &StopHandle) -> Option<StopCause> {
    while !stop.flag().load(Ordering::Acquire) {
        yield_now();
    }
    stop.cause()
}

fn value_of<T: std::fmt::Debug>(outcome: JobOutcome<T>) -> T {
    match outcome {
        JobOutcome::Finished { value, .. } => value,
        JobOutcome::Panicked { .. } | JobOutcome::NeverStarted { .. } => panic!("not finished: {outcome:?}"),
    }
}

#[test]
fn every_job_is_done_once_and_every_permit_comes_back() {
    explore(|| {
        let model = Model::start(2, 4);
        let caller = |first: usize| {
            let model = Arc::clone(&model);
            spawn(move || {
                for number in first..first + 2 {
                    let permit = model.queue.reserve().unwrap();
                    let ticket = model.submit(permit, Clocks::default(), number);
                    assert_eq!(value_of(block_on(ticket.outcome())), number);
                }
            })
        };
        for caller in [caller(0), caller(10)] {
            caller.join().unwrap();
        }
        assert_eq!((model.begun.load(Ordering::SeqCst), model.queue.in_flight()), (4, 0));
        model.end();
    });
}

#[test]
fn lent_workers_are_recalled_for_a_job_that_waits() {
    explore(|| {
        let model = Model::start(2, 3);
        let borrower = model.submit_shared(model.queue.reserve().unwrap(), 3);
        let second = {
            let model = Arc::clone(&model);
            spawn(move || {
                let permit = model.queue.reserve().unwrap();
                let ticket = model.submit(permit, Clocks::default(), 7);
                assert_eq!(value_of(block_on(ticket.outcome())), 7);
            })
        };
        assert_eq!(value_of(block_on(borrower.outcome())), [1; 3]);
        second.join().unwrap();
        model.end();
    });
}

#[test]
fn waiting_job_is_served_while_the_borrower_goes_on() {
    explore(|| {
        let model = Model::start(2, 3);
        let (permit, is_over) = (model.queue.reserve().unwrap(), Arc::new(AtomicBool::new(false)));
        let (idle, over) = (permit.idle_workers(), Arc::clone(&is_over));
        // Its parts end only when they are recalled or the second job is done: it must not wait for them.
        let borrower = permit.submit(Clocks::default(), move |_| {
            let open = AtomicUsize::new(2);
            let take_part = |is_recalled: &AtomicBool| {
                if open.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |open| open.checked_sub(1)).is_err() {
                    return false;
                }
                while !over.load(Ordering::SeqCst) {
                    if is_recalled.load(Ordering::Relaxed) {
                        open.fetch_add(1, Ordering::SeqCst);
                        return false;
                    }
                    yield_now();
                }
                true
            };
            idle.share(&|| open.load(Ordering::SeqCst), &take_part);
        });
        let second = model.submit(model.queue.reserve().unwrap(), Clocks::default(), 7);
        assert_eq!(value_of(block_on(second.outcome())), 7);
        is_over.store(true, Ordering::SeqCst);
        value_of(block_on(borrower.outcome()));
        model.end();
    });
}

#[test]
fn departed_callers_free_their_permits() {
    explore(|| {
        let model = Model::start(1, 2);
        let running = model.queue.reserve().unwrap().submit(Clocks::default(), until_stopped);
        let waiting = model.submit(model.queue.reserve().unwrap(), Clocks::default(), 1);
        let departing = [spawn(move || drop(running)), spawn(move || drop(waiting))];
        for caller in departing {
            caller.join().unwrap();
        }
        // Who comes next is served as soon as both are gone.
        let permit = block_on(model.queue.wait_for_permit(capacity(1))).unwrap();
        assert_eq!(value_of(block_on(model.submit(permit, Clocks::default(), 2).outcome())), 2);
        model.end();
    });
}

#[test]
fn caller_who_leaves_the_line_frees_its_permit_beside_a_busy_worker() {
    explore(|| {
        let model = Model::start(1, 2);
        let running = model.queue.reserve().unwrap().submit(Clocks::default(), until_stopped);
        let waiting = model.submit(model.queue.reserve().unwrap(), Clocks::default(), 1);
        drop(waiting);
        assert_eq!((model.queue.in_flight(), model.begun.load(Ordering::SeqCst)), (1, 0));
        drop(running);
        model.end();
    });
}

#[test]
fn those_who_wait_for_a_permit_are_told_when_the_queue_closes() {
    let closings: [fn(&Queue); 2] = [Queue::close, |queue| queue.cancel_all(StopCause::Shutdown)];
    for close in closings {
        explore(move || {
            let model = Model::start(1, 1);
            let permit = model.queue.reserve().unwrap();
            let waiting = {
                let model = Arc::clone(&model);
                spawn(move || block_on(model.queue.wait_for_permit(capacity(1))).unwrap_err())
            };
            close(&model.queue);
            // The permit is still held: nothing else wakes who waits.
            assert_eq!(waiting.join().unwrap(), Refusal::Closed);
            drop(permit);
            model.end();
        });
    }
}

#[test]
fn those_who_wait_for_a_permit_are_all_served() {
    explore(|| {
        let model = Model::start(2, 2);
        let caller = |number: usize| {
            let model = Arc::clone(&model);
            spawn(move || {
                let permit = block_on(model.queue.wait_for_permit(capacity(2))).unwrap();
                let ticket = model.submit(permit, Clocks::default(), number);
                // One leaves at once.
                if number > 0 {
                    assert_eq!(value_of(block_on(ticket.outcome())), number);
                }
            })
        };
        for caller in [caller(0), caller(1), caller(2), caller(3)] {
            caller.join().unwrap();
        }
        model.end();
    });
}

#[test]
fn drain_ends_what_was_accepted_and_refuses_the_rest() {
    explore(|| {
        let model = Model::start(2, 3);
        let caller = |number: usize| {
            let model = Arc::clone(&model);
            spawn(move || match block_on(model.queue.wait_for_permit(capacity(1))) {
                Ok(permit) => {
                    let ticket = model.submit(permit, Clocks::default(), number);
                    assert_eq!(value_of(block_on(ticket.outcome())), number);
                }
                Err(refusal) => assert_eq!(refusal, Refusal::Closed),
            })
        };
        let callers = [caller(1), caller(2), caller(3)];
        model.end();
        for caller in callers {
            caller.join().unwrap();
        }
    });
}

#[test]
fn shutdown_ends_every_job_with_one_outcome() {
    explore(|| {
        let model = Model::start(1, 3);
        let caller = |number: usize| {
            let model = Arc::clone(&model);
            spawn(move || {
                let Ok(permit) = model.queue.reserve() else { return };
                let begun = Arc::new(AtomicUsize::new(0));
                let counted = Arc::clone(&begun);
                let ticket = permit.submit(Clocks::default(), move |stop| {
                    counted.fetch_add(1, Ordering::SeqCst);
                    if number == 0 { until_stopped(stop) } else { None }
                });
                let outcome = block_on(ticket.outcome());
                let has_begun = begun.load(Ordering::SeqCst);
                match outcome {
                    JobOutcome::Finished { value, .. } => {
                        assert_eq!((has_begun, value), (1, (number == 0).then_some(StopCause::Shutdown)));
                    }
                    JobOutcome::NeverStarted { cause } => assert_eq!((has_begun, cause), (0, StopCause::Shutdown)),
                    JobOutcome::Panicked { message } => panic!("{message}"),
                }
            })
        };
        let callers = [caller(0), caller(1), caller(2)];
        model.queue.cancel_all(StopCause::Shutdown);
        for caller in callers {
            caller.join().unwrap();
        }
        model.end();
    });
}

#[test]
fn deadline_that_has_passed_starts_nothing() {
    explore(|| {
        let model = Model::start(1, 3);
        let passed = Clocks { deadline: Some(Instant::now()), ..Clocks::default() };
        let late = model.submit(model.queue.reserve().unwrap(), passed, 1);
        let leaving = model.submit(model.queue.reserve().unwrap(), passed, 2);
        let departing = spawn(move || drop(leaving));
        let served = model.submit(model.queue.reserve().unwrap(), Clocks::default(), 3);
        assert_eq!(block_on(late.outcome()), JobOutcome::NeverStarted { cause: StopCause::Deadline });
        assert_eq!(value_of(block_on(served.outcome())), 3);
        departing.join().unwrap();
        assert_eq!(model.begun.load(Ordering::SeqCst), 1);
        model.end();
    });
}
