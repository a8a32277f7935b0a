//! Facts about the whole queue, with jobs that channels hold at known points.

use std::num::NonZeroUsize;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use super::*;

fn one_worker(queue_length: usize) -> Queue {
    with_capacity(1 + queue_length, Duration::MAX)
}

fn with_capacity(permits: usize, work: Duration) -> Queue {
    Queue::start(NonZeroUsize::MIN, Capacity { permits, work }).unwrap()
}

/// Capacity for so many jobs, however long they are expected to run.
fn permits(permits: usize) -> Capacity {
    Capacity { permits, work: Duration::MAX }
}

/// Occupies the only worker until the returned sender is dropped.
fn hold_worker(queue: &Queue) -> (Ticket<()>, Sender<()>) {
    let (release, released): (Sender<()>, Receiver<()>) = channel();
    let (started, has_started) = channel();
    let ticket = queue.reserve().unwrap().submit(Clocks::default(), move |_| {
        started.send(()).unwrap();
        let _ = released.recv();
    });
    has_started.recv().unwrap();
    (ticket, release)
}

fn value_of<T>(outcome: JobOutcome<T>) -> T {
    match outcome {
        JobOutcome::Finished { value, .. } => value,
        JobOutcome::Panicked { message } => panic!("the job panicked: {message}"),
        JobOutcome::NeverStarted { cause } => panic!("the job was never started: {cause:?}"),
    }
}

fn spin_until_stopped(stop: &StopHandle) {
    while !stop.flag().load(Ordering::Acquire) {
        std::thread::yield_now();
    }
}

#[test]
fn permits_are_workers_plus_queue_length() {
    let queue = one_worker(4);
    let permits: Vec<_> = (0..5).map(|_| queue.reserve().unwrap()).collect();
    assert_eq!(queue.reserve().unwrap_err(), Refusal::Full);
    drop(permits);
    assert_eq!(queue.in_flight(), 0);
    assert!(queue.reserve().is_ok());
}

#[test]
fn answered_caller_finds_its_permit_free() {
    let queue = one_worker(0);
    for round in 0..100 {
        let permit = queue.reserve().expect("the permit of the round before is free");
        assert_eq!(value_of(permit.submit(Clocks::default(), move |_| round).blocking_outcome()), round);
    }
}

#[test]
fn jobs_start_in_order_of_arrival() {
    let queue = one_worker(8);
    let (_held, release) = hold_worker(&queue);
    let (order, seen) = channel();
    let tickets: Vec<_> = (0..8)
        .map(|number| {
            let order = order.clone();
            queue.reserve().unwrap().submit(Clocks::default(), move |_| order.send(number).unwrap())
        })
        .collect();
    drop((release, order));
    assert_eq!(seen.iter().collect::<Vec<_>>(), (0..8).collect::<Vec<_>>());
    drop(tickets);
}

#[test]
fn panicking_job_leaves_the_worker_alive() {
    let queue = one_worker(0);
    let outcome = queue.reserve().unwrap().submit(Clocks::default(), |_| panic!("injected")).blocking_outcome();
    assert_eq!(outcome, JobOutcome::<()>::Panicked { message: "injected".to_owned() });
    assert_eq!(value_of(queue.reserve().unwrap().submit(Clocks::default(), |_| 7).blocking_outcome()), 7);
}

#[test]
fn time_limit_counts_from_the_start_and_sets_the_flag() {
    let queue = one_worker(1);
    let (_held, release) = hold_worker(&queue);
    let clocks = Clocks { time_limit: Some(Duration::ZERO), ..Clocks::default() };
    let ticket = queue.reserve().unwrap().submit(clocks, |stop| {
        // Even a limit of nothing does not pass while the job waits.
        spin_until_stopped(stop);
        stop.cause()
    });
    drop(release);
    assert_eq!(value_of(ticket.blocking_outcome()), Some(StopCause::TimeLimit));
}

#[test]
fn dropped_ticket_stops_the_running_job() {
    let queue = one_worker(0);
    let (started, has_started) = channel();
    let (ended, end) = channel();
    let ticket = queue.reserve().unwrap().submit(Clocks::default(), move |stop| {
        started.send(()).unwrap();
        spin_until_stopped(stop);
        ended.send(stop.cause()).unwrap();
    });
    has_started.recv().unwrap();
    drop(ticket);
    assert_eq!(end.recv().unwrap(), Some(StopCause::CallerGone));
}

#[test]
fn waiting_job_whose_caller_left_is_never_started_and_frees_its_permit_at_once() {
    let queue = one_worker(1);
    let (_held, release) = hold_worker(&queue);
    let (started, has_started) = channel();
    let ticket = queue.reserve().unwrap().submit(Clocks::default(), move |_| started.send(()).unwrap());
    assert_eq!(queue.reserve().unwrap_err(), Refusal::Full);
    drop(ticket);
    let permit = queue.reserve().expect("the permit of the caller who left is free");
    drop(release);
    assert_eq!(value_of(permit.submit(Clocks::default(), |_| 1).blocking_outcome()), 1);
    // The sender was dropped with the job that never ran.
    assert!(has_started.recv().is_err());
}

#[test]
fn join_finishes_what_is_in_flight() {
    let queue = one_worker(1);
    let (held, release) = hold_worker(&queue);
    let waiting = queue.reserve().unwrap().submit(Clocks::default(), |_| 3);
    queue.close();
    assert_eq!(queue.reserve().unwrap_err(), Refusal::Closed);
    drop(release);
    queue.join();
    assert_eq!((value_of(held.blocking_outcome()), value_of(waiting.blocking_outcome())), ((), 3));
}

#[test]
fn permit_reserved_before_closing_may_still_be_used() {
    let queue = one_worker(0);
    let permit = queue.reserve().unwrap();
    queue.close();
    assert_eq!(value_of(permit.submit(Clocks::default(), |_| 5).blocking_outcome()), 5);
    queue.join();
}

#[test]
fn cancelling_stops_running_waiting_and_reserved_jobs() {
    let queue = one_worker(2);
    let (started, has_started) = channel();
    let running = queue.reserve().unwrap().submit(Clocks::default(), move |stop| {
        started.send(()).unwrap();
        spin_until_stopped(stop);
        stop.cause()
    });
    has_started.recv().unwrap();
    let waiting = queue.reserve().unwrap().submit(Clocks::default(), |_| ());
    let reserved = queue.reserve().unwrap();
    queue.cancel_all(StopCause::Shutdown);
    let never = JobOutcome::NeverStarted { cause: StopCause::Shutdown };
    assert_eq!(value_of(running.blocking_outcome()), Some(StopCause::Shutdown));
    assert_eq!(waiting.blocking_outcome(), never);
    assert_eq!(reserved.submit(Clocks::default(), |_| ()).blocking_outcome(), never);
    queue.join();
}

fn until(deadline: Instant) -> Clocks {
    Clocks { deadline: Some(deadline), ..Clocks::default() }
}

#[test]
fn deadline_stops_the_running_job() {
    let queue = one_worker(0);
    let deadline = Instant::now() + ANSWER_MARGIN + Duration::from_millis(50);
    let ticket = queue.reserve().unwrap().submit(until(deadline), |stop| {
        spin_until_stopped(stop);
        stop.cause()
    });
    assert_eq!(value_of(ticket.blocking_outcome()), Some(StopCause::Deadline));
}

#[test]
fn waiting_job_whose_deadline_passes_is_answered_at_once_and_never_started() {
    let queue = one_worker(1);
    let (held, release) = hold_worker(&queue);
    let (started, has_started) = channel::<()>();
    let permit = queue.reserve().unwrap();
    let ticket = permit.submit(until(Instant::now() + ANSWER_MARGIN), move |_| started.send(()).unwrap());
    // The worker is still held: the watchdog alone ends the wait and frees the permit.
    assert_eq!(ticket.blocking_outcome(), JobOutcome::NeverStarted { cause: StopCause::Deadline });
    assert!(queue.reserve().is_ok());
    drop(release);
    value_of(held.blocking_outcome());
    assert!(has_started.recv().is_err());
}

#[test]
fn deadline_in_the_past_is_never_started_on_an_idle_worker() {
    let queue = one_worker(0);
    let ticket = queue.reserve().unwrap().submit(until(Instant::now()), |_| ());
    assert_eq!(ticket.blocking_outcome(), JobOutcome::NeverStarted { cause: StopCause::Deadline });
    assert_eq!(queue.backlog(), Backlog { jobs: 0, work: Duration::ZERO });
}

#[tokio::test]
async fn permit_below_a_bound_is_given_once_enough_are_given_back() {
    let queue = one_worker(3);
    let mut taken: Vec<_> = (0..3).map(|_| queue.reserve().unwrap()).collect();
    let waiting = queue.wait_for_permit(permits(2));
    let free_two = async {
        tokio::task::yield_now().await;
        taken.pop();
        tokio::task::yield_now().await;
        taken.pop();
    };
    let (permit, ()) = tokio::join!(waiting, free_two);
    assert!(permit.is_ok());
    assert_eq!(queue.in_flight(), 2);
}

#[tokio::test]
async fn closing_ends_the_wait_for_a_permit() {
    let queue = one_worker(0);
    let _taken = queue.reserve().unwrap();
    let close = async {
        tokio::task::yield_now().await;
        queue.close();
    };
    let (refused, ()) = tokio::join!(queue.wait_for_permit(permits(1)), close);
    assert_eq!(refused.unwrap_err(), Refusal::Closed);
}

/// An hour of expected work.
fn hour() -> Clocks {
    Clocks { estimate: Duration::from_secs(3600), ..Clocks::default() }
}

#[test]
fn expected_work_is_bounded_beside_the_permits_but_never_keeps_a_worker_idle() {
    let queue = with_capacity(10, Duration::from_secs(3600));
    let (release, released): (Sender<()>, Receiver<()>) = channel();
    let (started, has_started) = channel();
    // Nothing is in flight: a job of any length is taken.
    let running = queue.reserve().unwrap().submit(Clocks { estimate: Duration::MAX, ..hour() }, move |_| {
        started.send(()).unwrap();
        let _ = released.recv();
    });
    has_started.recv().unwrap();
    assert_eq!(queue.reserve().unwrap_err(), Refusal::Full, "its work fills the capacity");
    drop(release);
    value_of(running.blocking_outcome());

    let (_held, release) = hold_worker(&queue);
    let permit = queue.reserve().expect("nothing is expected of the running job");
    let waiting = permit.submit(hour(), |_| ());
    assert_eq!(queue.backlog(), Backlog { jobs: 2, work: Duration::from_secs(3600) });
    assert_eq!(queue.reserve().unwrap_err(), Refusal::Full);
    drop(waiting);
    assert!(queue.reserve().is_ok(), "the work of a caller who left is forgotten");
    drop(release);
}

#[test]
fn work_of_a_running_job_shrinks_with_time() {
    let queue = one_worker(1);
    let (started, has_started) = channel();
    let running = queue.reserve().unwrap().submit(hour(), move |stop| {
        started.send(()).unwrap();
        spin_until_stopped(stop);
    });
    has_started.recv().unwrap();
    let first = queue.backlog().work;
    while queue.backlog().work >= first {
        std::thread::yield_now();
    }
    drop(running);
}

#[tokio::test]
async fn wait_for_capacity_ends_when_the_work_does() {
    let queue = with_capacity(10, Duration::from_secs(3600));
    let (held, release) = hold_worker(&queue);
    let waiting = queue.reserve().unwrap().submit(hour(), |_| ());
    let capacity = Capacity { permits: 10, work: Duration::from_secs(1) };
    let end = async {
        tokio::task::yield_now().await;
        drop((waiting, release));
        held.outcome().await
    };
    let (permit, _) = tokio::join!(queue.wait_for_permit(capacity), end);
    assert!(permit.is_ok());
}

#[test]
fn worker_that_does_not_obey_its_stop_flag_is_stuck_until_its_job_ends() {
    let queue = one_worker(1);
    let (held, release) = hold_worker(&queue);
    assert_eq!(queue.stuck_workers(Duration::ZERO), 0, "it was not signalled to stop");
    drop(held);
    while queue.stuck_workers(Duration::ZERO) == 0 {
        std::thread::yield_now();
    }
    assert_eq!(queue.stuck_workers(Duration::from_secs(3600)), 0, "it has time to end");
    drop(release);
    while queue.in_flight() > 0 {
        std::thread::yield_now();
    }
    assert_eq!(queue.stuck_workers(Duration::ZERO), 0);
}
