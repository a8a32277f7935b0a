//! Facts about borrowed workers, which barriers and channels hold at known points.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Barrier, Mutex};
use std::thread::{current, yield_now};
use std::time::Duration;

use crate::queue::lock::lock;
use crate::queue::{Capacity, Clocks, JobOutcome, Permit, Queue, StopHandle, Ticket};

fn queue(workers: usize, queue_length: usize) -> Queue {
    let capacity = Capacity { permits: workers + queue_length, work: Duration::MAX };
    Queue::start(NonZeroUsize::new(workers).unwrap(), capacity).unwrap()
}

/// Whether a part was done.
#[derive(Clone, Copy, PartialEq)]
enum Done {
    Yes,
    GivenBack,
}

/// Queues a job that shares `count` parts; it answers how often each was done.
fn share_parts(
    permit: Permit,
    count: usize,
    part: impl Fn(usize, &AtomicBool) -> Done + Send + Sync + 'static,
) -> Ticket<Vec<usize>> {
    let idle = permit.idle_workers();
    permit.submit(Clocks::default(), move |_: &StopHandle| {
        let open = Mutex::new((0..count).collect::<Vec<_>>());
        let done: Vec<_> = (0..count).map(|_| AtomicUsize::new(0)).collect();
        let take_part = |is_recalled: &AtomicBool| {
            if is_recalled.load(Ordering::Relaxed) {
                return false;
            }
            let Some(number) = lock(&open).pop() else { return false };
            match part(number, is_recalled) {
                Done::Yes => drop(done[number].fetch_add(1, Ordering::Relaxed)),
                Done::GivenBack => lock(&open).push(number),
            }
            true
        };
        idle.share(&|| lock(&open).len(), &take_part);
        done.into_iter().map(AtomicUsize::into_inner).collect()
    })
}

/// One flag for two owners.
fn flag() -> (Arc<AtomicBool>, Arc<AtomicBool>) {
    let flag = Arc::new(AtomicBool::new(false));
    (Arc::clone(&flag), flag)
}

fn value_of<T>(outcome: JobOutcome<T>) -> T {
    match outcome {
        JobOutcome::Finished { value, .. } => value,
        JobOutcome::Panicked { message } => panic!("the job panicked: {message}"),
        JobOutcome::NeverStarted { cause } => panic!("the job was never started: {cause:?}"),
    }
}

#[test]
fn idle_workers_work_at_the_same_time_as_the_borrower() {
    let queue = queue(3, 0);
    let all_three = Barrier::new(3);
    let part = move |_: usize, _: &AtomicBool| {
        // Nobody passes before three are here.
        all_three.wait();
        Done::Yes
    };
    let ticket = share_parts(queue.reserve().unwrap(), 3, part);
    assert_eq!(value_of(ticket.blocking_outcome()), [1, 1, 1]);
    assert_eq!(queue.helping_workers(), 0);
}

#[test]
fn single_worker_does_all_parts_itself() {
    let queue = queue(1, 0);
    let part = |_: usize, _: &AtomicBool| {
        assert_eq!(current().name(), Some("slipdrive-worker-0"));
        Done::Yes
    };
    let ticket = share_parts(queue.reserve().unwrap(), 5, part);
    assert_eq!(value_of(ticket.blocking_outcome()), [1; 5]);
}

#[test]
fn waiting_job_gets_its_worker_back_while_the_borrower_still_runs() {
    let queue = queue(2, 2);
    let (helping, is_helped) = channel();
    let (release, released) = channel::<()>();
    let released = Mutex::new(released);
    let (is_over, over) = flag();
    let part = move |_: usize, is_recalled: &AtomicBool| {
        if current().name() == Some("slipdrive-helper") {
            helping.send(()).unwrap();
            // Once all are let go, helpers that are asked again do their part.
            while !is_recalled.load(Ordering::Relaxed) {
                if over.load(Ordering::Relaxed) {
                    return Done::Yes;
                }
                yield_now();
            }
            return Done::GivenBack;
        }
        // The borrower's first part outlasts the whole second job.
        let _ = lock(&released).recv();
        Done::Yes
    };
    let borrower = share_parts(queue.reserve().unwrap(), 4, part);
    is_helped.recv().unwrap();
    let second = queue.reserve().unwrap().submit(Clocks::default(), |_| 7);
    assert_eq!(value_of(second.blocking_outcome()), 7);
    is_over.store(true, Ordering::Relaxed);
    drop(release);
    assert_eq!(value_of(borrower.blocking_outcome()), [1; 4], "what was given back is done by the borrower");
}

#[test]
fn only_as_many_loans_are_recalled_as_jobs_wait() {
    let queue = queue(3, 2);
    let (helping, is_helped) = channel();
    let (left, has_left) = channel();
    let (release, released) = channel::<()>();
    let released = Mutex::new(released);
    let (is_over, over) = flag();
    let part = move |_: usize, is_recalled: &AtomicBool| {
        if current().name() != Some("slipdrive-helper") {
            let _ = lock(&released).recv();
            return Done::Yes;
        }
        helping.send(()).unwrap();
        // Once all are let go, helpers that are asked again do their part.
        while !is_recalled.load(Ordering::Relaxed) {
            if over.load(Ordering::Relaxed) {
                return Done::Yes;
            }
            yield_now();
        }
        left.send(()).unwrap();
        Done::GivenBack
    };
    let borrower = share_parts(queue.reserve().unwrap(), 3, part);
    is_helped.recv().unwrap();
    is_helped.recv().unwrap();
    let (hold, held) = channel::<()>();
    let second = queue.reserve().unwrap().submit(Clocks::default(), move |_| {
        let _ = held.recv();
    });
    has_left.recv().unwrap();
    // Whoever has left its part gives its loan back a moment later.
    while queue.helping_workers() > 1 {
        yield_now();
    }
    assert_eq!(queue.helping_workers(), 1);
    assert!(has_left.try_recv().is_err());
    let third = queue.reserve().unwrap().submit(Clocks::default(), |_| ());
    has_left.recv().unwrap();
    value_of(third.blocking_outcome());
    is_over.store(true, Ordering::Relaxed);
    drop((hold, release));
    value_of(second.blocking_outcome());
    assert_eq!(value_of(borrower.blocking_outcome()), [1; 3]);
}

#[test]
fn panic_of_a_helper_is_the_panic_of_the_job_and_all_workers_go_on() {
    let queue = queue(2, 0);
    for culprit in ["slipdrive-helper", "slipdrive-worker"] {
        let both = Barrier::new(2);
        let part = move |_: usize, _: &AtomicBool| {
            both.wait();
            let name = current().name().unwrap().to_owned();
            assert!(!name.starts_with(culprit), "injected into {culprit}");
            Done::Yes
        };
        let outcome = share_parts(queue.reserve().unwrap(), 2, part).blocking_outcome();
        let JobOutcome::Panicked { message } = outcome else { panic!("{outcome:?}") };
        assert_eq!(message, format!("injected into {culprit}"));
        assert_eq!(queue.helping_workers(), 0);
    }
    let both = Barrier::new(2);
    let part = move |_: usize, _: &AtomicBool| {
        both.wait();
        Done::Yes
    };
    let ticket = share_parts(queue.reserve().unwrap(), 2, part);
    assert_eq!(value_of(ticket.blocking_outcome()), [1, 1]);
}

#[test]
fn departed_caller_frees_the_borrowed_workers() {
    let queue = queue(2, 0);
    let (started, has_started) = channel();
    let permit = queue.reserve().unwrap();
    let idle = permit.idle_workers();
    let ticket = permit.submit(Clocks::default(), move |stop| {
        let open = AtomicUsize::new(2);
        let take_part = |_: &AtomicBool| {
            if open.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |open| open.checked_sub(1)).is_err() {
                return false;
            }
            started.send(()).unwrap();
            while !stop.flag().load(Ordering::Relaxed) {
                yield_now();
            }
            true
        };
        idle.share(&|| open.load(Ordering::Relaxed), &take_part);
    });
    has_started.recv().unwrap();
    has_started.recv().unwrap();
    assert_eq!(queue.helping_workers(), 1);
    drop(ticket);
    while queue.in_flight() > 0 {
        yield_now();
    }
    assert_eq!(queue.helping_workers(), 0);
}

#[test]
fn never_more_threads_work_than_there_are_workers() {
    const WORKERS: usize = 3;
    static WORKING: AtomicUsize = AtomicUsize::new(0);
    let queue = queue(WORKERS, 200);
    let part = |number: usize, is_recalled: &AtomicBool| {
        assert!(WORKING.fetch_add(1, Ordering::SeqCst) < WORKERS, "too many threads at once");
        for _ in 0..number * 20 {
            std::hint::spin_loop();
        }
        let is_recalled = is_recalled.load(Ordering::Relaxed);
        WORKING.fetch_sub(1, Ordering::SeqCst);
        if is_recalled { Done::GivenBack } else { Done::Yes }
    };
    for _ in 0..20 {
        // Waves, so that workers are idle at the end of each.
        let tickets: Vec<_> = (0..10).map(|_| share_parts(queue.reserve().unwrap(), 16, part)).collect();
        for ticket in tickets {
            assert_eq!(value_of(ticket.blocking_outcome()), [1; 16]);
        }
    }
    queue.join();
    assert_eq!(queue.helping_workers(), 0);
}
