//! What one caller may have in flight where there are several: one that floods the queue leaves room for the others.
//!
//! Each caller may use all workers and half of the queue. Half, since one caller alone then still keeps every worker busy
//! with jobs that follow each other, and since beside one that floods the others find as much room as it has. Where more
//! than two flood, the queue is full for all, and callers take turns in it ([`crate::queue`]).

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::Notify;

use super::Class;
use crate::metrics::Metrics;
use crate::queue::{CallerId, Capacity};

/// The share of one caller, and what is taken of it.
#[derive(Debug)]
pub struct Share {
    caller: CallerId,
    label: Box<str>,
    is_bounded: AtomicBool,
    heavy: Used,
    light: Used,
}

/// What is taken of a share by jobs of one class.
#[derive(Debug, Default)]
struct Used {
    load: Mutex<Load>,
    /// Wakes those who wait for their share: some of it was given back.
    released: Notify,
}

#[derive(Debug, Clone, Copy, Default)]
struct Load {
    jobs: usize,
    /// What the submitted ones were expected to take when they came.
    work: Duration,
}

impl Share {
    /// The share of a caller that metrics call by this label; without bound until [`Share::set_bounded`].
    pub fn of(label: &str) -> Self {
        let (heavy, light) = (Used::default(), Used::default());
        Self { caller: CallerId::unique(), label: label.into(), is_bounded: AtomicBool::new(false), heavy, light }
    }

    /// Whether there are others to leave room for: a caller alone may take everything.
    pub fn set_bounded(&self, is_bounded: bool) {
        self.is_bounded.store(is_bounded, Ordering::Relaxed);
    }

    /// Whether the share is all that the caller may take.
    pub fn is_bounded(&self) -> bool {
        self.is_bounded.load(Ordering::Relaxed)
    }

    /// What logs and metrics call the caller.
    pub fn label(&self) -> &str {
        &self.label
    }

    pub(super) fn caller(&self) -> CallerId {
        self.caller
    }

    fn used(&self, class: Class) -> &Used {
        match class {
            Class::Heavy => &self.heavy,
            Class::Light => &self.light,
        }
    }

    /// Whether the caller has no job of this class in flight.
    pub(super) fn is_untouched(&self, class: Class) -> bool {
        self.used(class).load().jobs == 0
    }

    /// Takes the place of one job, while less than `most` is taken by more jobs than there are workers.
    pub(super) fn take(self: &Arc<Self>, class: Class, most: &ShareSize, metrics: &Arc<Metrics>) -> Option<Taken> {
        let mut load = self.used(class).load();
        let Capacity { permits, work } = most.capacity;
        let is_used_up = load.jobs >= permits || load.jobs >= most.workers && load.work >= work;
        if self.is_bounded() && is_used_up {
            return None;
        }
        load.jobs += 1;
        metrics.caller_jobs_changed(&self.label, 1);
        Some(Taken { share: Arc::clone(self), class, work: Duration::ZERO, metrics: Arc::clone(metrics) })
    }

    /// The same, after as long a wait as it takes.
    pub(super) async fn taken(self: &Arc<Self>, class: Class, most: &ShareSize, metrics: &Arc<Metrics>) -> Taken {
        let used = self.used(class);
        loop {
            let released = used.released.notified();
            if let Some(taken) = self.take(class, most, metrics) {
                // The end of one long job may make room for several short ones: wake the next waiter too.
                used.released.notify_one();
                return taken;
            }
            released.await;
        }
    }
}

/// How large a share is.
#[derive(Debug, Clone, Copy)]
pub(super) struct ShareSize {
    pub(super) capacity: Capacity,
    /// The expected work does not bind while fewer jobs are in flight than there are workers.
    pub(super) workers: usize,
}

impl Used {
    fn load(&self) -> MutexGuard<'_, Load> {
        self.load.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The place of one job in the share of its caller; given back on drop.
#[derive(Debug)]
pub(super) struct Taken {
    share: Arc<Share>,
    class: Class,
    work: Duration,
    metrics: Arc<Metrics>,
}

impl Taken {
    /// Counts what the job is expected to take.
    pub(super) fn expect(&mut self, work: Duration) {
        let mut load = self.share.used(self.class).load();
        load.work = load.work.saturating_sub(self.work).saturating_add(work);
        self.work = work;
    }
}

impl Drop for Taken {
    fn drop(&mut self) {
        let used = self.share.used(self.class);
        let mut load = used.load();
        load.jobs -= 1;
        // Sums that have reached the end of the range start again once nothing is in flight.
        load.work = if load.jobs == 0 { Duration::ZERO } else { load.work.saturating_sub(self.work) };
        drop(load);
        self.metrics.caller_jobs_changed(&self.share.label, -1);
        used.released.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size(permits: usize, work_s: u64) -> ShareSize {
        ShareSize { capacity: Capacity { permits, work: Duration::from_secs(work_s) }, workers: 1 }
    }

    fn bounded() -> (Arc<Share>, Arc<Metrics>) {
        let share = Arc::new(Share::of("fleet"));
        share.set_bounded(true);
        (share, Arc::default())
    }

    #[test]
    fn share_ends_with_its_places_or_with_its_work() {
        let (share, metrics) = bounded();
        let take = |most: &ShareSize| share.take(Class::Heavy, most, &metrics);
        let mut first = take(&size(2, 10)).unwrap();
        let second = take(&size(2, 10)).unwrap();
        assert!(take(&size(2, 10)).is_none());
        assert!(share.take(Class::Light, &size(1, 1), &metrics).is_some(), "each class has its own");
        drop(second);
        first.expect(Duration::from_secs(10));
        assert!(take(&size(2, 10)).is_none() && take(&size(2, 11)).is_some());
        drop(first);
        assert!(take(&size(1, 0)).is_some(), "a job of any length may run on an idle worker");
    }

    #[test]
    fn caller_without_others_takes_everything() {
        let (share, metrics) = bounded();
        share.set_bounded(false);
        let taken: Vec<_> = (0..5).map(|_| share.take(Class::Heavy, &size(1, 1), &metrics).unwrap()).collect();
        assert!(!share.is_untouched(Class::Heavy));
        drop(taken);
        assert!(share.is_untouched(Class::Heavy));
    }

    #[tokio::test(start_paused = true)]
    async fn those_who_wait_for_their_share_come_one_after_the_other() {
        let (share, metrics) = bounded();
        let first = share.take(Class::Heavy, &size(1, 10), &metrics).unwrap();
        let waiting: Vec<_> = (0..3)
            .map(|_| {
                let (share, metrics) = (Arc::clone(&share), Arc::clone(&metrics));
                tokio::spawn(async move { drop(share.taken(Class::Heavy, &size(1, 10), &metrics).await) })
            })
            .collect();
        tokio::task::yield_now().await;
        assert!(waiting.iter().all(|task| !task.is_finished()));
        drop(first);
        for task in waiting {
            task.await.unwrap();
        }
    }
}
