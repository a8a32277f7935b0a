//! Lets a running job use the threads of idle workers.
//!
//! Never more threads work than there are workers. A job that finds idle workers borrows them: each loan keeps one worker
//! from taking a job, and a helper thread of the borrowing job works in its stead. A loan is recalled as soon as a job
//! waits for which no other worker is idle. The helper then leaves its part of the work to the borrower, and the waiting
//! job starts.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::Result as HelperResult;
use std::time::{Duration, Instant};

use super::bounded_queue::BoundedQueue;
use super::sync::mpsc::{Sender, channel};
use super::sync::spawn_scoped;
use super::sync::thread::{Scope, scope};

#[cfg(test)]
#[cfg(not(shuttle))]
mod tests;

/// The workers that may be idle while a job runs.
#[derive(Debug)]
pub struct IdleWorkers {
    queue: Arc<BoundedQueue>,
    /// How long workers were lent, ns.
    lent: AtomicU64,
}

/// One worker that is kept from taking a job; given back on drop.
struct Loan<'a> {
    lender: &'a IdleWorkers,
    number: u64,
    is_recalled: Arc<AtomicBool>,
    since: Instant,
}

impl Drop for Loan<'_> {
    fn drop(&mut self) {
        let Self { lender, number, since, .. } = self;
        // 500 years fit.
        lender.lent.fetch_add(u64::try_from(since.elapsed().as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
        lender.queue.give_back_loan(*number);
    }
}

impl IdleWorkers {
    pub(super) fn new(queue: Arc<BoundedQueue>) -> Self {
        Self { queue, lent: AtomicU64::new(0) }
    }

    /// How long workers were lent so far, added up over all of them.
    pub fn lent_time(&self) -> Duration {
        Duration::from_nanos(self.lent.load(Ordering::Relaxed))
    }

    /// Does work in parts on the calling thread and on helpers; before each part more idle workers are borrowed.
    ///
    /// `take_part` begins and ends one open part, or returns false when there is none; once its flag is set it returns
    /// soon and leaves the part open. `open_parts` counts the open parts. Returns when none is open or under way.
    ///
    /// # Panics
    /// When a part panics, on whatever thread.
    pub fn share(&self, open_parts: &(dyn Fn() -> usize + Sync), take_part: &(dyn Fn(&AtomicBool) -> bool + Sync)) {
        static NEVER: AtomicBool = AtomicBool::new(false);
        let (end, ended) = channel();
        scope(|threads| {
            let mut helpers = 0_usize;
            loop {
                // One part is the calling thread's own.
                helpers += (1..open_parts()).take_while(|_| self.start_helper(threads, take_part, &end)).count();
                if take_part(&NEVER) {
                    continue;
                }
                if helpers == 0 {
                    return;
                }
                // A helper that ends may have left a part open: look again.
                match ended.recv() {
                    Ok(Err(panic)) => resume_unwind(panic),
                    Ok(Ok(())) | Err(_) => helpers -= 1,
                }
            }
        });
    }

    /// Starts a helper on an idle worker, which works until no part is open; false when no worker is idle.
    fn start_helper<'scope>(
        &'scope self,
        threads: &'scope Scope<'scope, '_>,
        take_part: &'scope (dyn Fn(&AtomicBool) -> bool + Sync),
        end: &Sender<HelperResult<()>>,
    ) -> bool {
        let Some((number, is_recalled)) = self.queue.lend() else { return false };
        let loan = Loan { lender: self, number, is_recalled, since: Instant::now() };
        let end = end.clone();
        let help = move || {
            // State that a panic leaves half changed is not used again: the borrower panics too.
            let result = catch_unwind(AssertUnwindSafe(|| while take_part(&loan.is_recalled) {}));
            // Before the result is sent, so that the loan ends before the borrower returns.
            drop(loan);
            // Sending fails when the borrower has panicked itself.
            let _ = end.send(result);
        };
        // When the system refuses the thread, the calling one works on alone.
        spawn_scoped(threads, "slipdrive-helper", help)
    }
}
