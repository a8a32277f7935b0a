//! The worker threads.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::{io, mem};

use super::bounded_queue::BoundedQueue;
use super::lock::lock;
use super::sync::Mutex;
use super::sync::thread::{Builder, JoinHandle};

/// A fixed number of threads, each running one job after the other.
#[derive(Debug)]
pub(super) struct Workers {
    threads: Mutex<Vec<JoinHandle<()>>>,
}

impl Workers {
    pub(super) fn start(count: NonZeroUsize, queue: &Arc<BoundedQueue>) -> io::Result<Self> {
        let spawn = |number: usize| {
            let queue = Arc::clone(queue);
            let work = move || {
                while let Some(job) = queue.next() {
                    job.run();
                }
            };
            Builder::new().name(format!("slipdrive-worker-{number}")).spawn(work)
        };
        let threads = (0..count.get()).map(spawn).collect::<io::Result<Vec<_>>>()?;
        Ok(Self { threads: Mutex::new(threads) })
    }

    /// Waits until the closed queue is empty and its last job has ended.
    pub(super) fn join(&self) {
        for thread in mem::take(&mut *lock(&self.threads)) {
            // A worker cannot have panicked: panics of the work are caught inside the job.
            let _ = thread.join();
        }
    }
}
