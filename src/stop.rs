//! How running work is asked to end early. The numerics see no clock: someone else sets the flags.

use std::sync::atomic::{AtomicBool, Ordering};

/// The flags that end work early; a flag that is set stays set.
///
/// Loops that can take more than some milliseconds ask at every time step or iteration, and every [`Stop::PERIOD`] cheap
/// ones within a step.
#[derive(Clone, Copy)]
pub struct Stop<'a> {
    flag: &'a AtomicBool,
    /// Flags of a part of the work; the flag above where there are none, since loading it again costs less than a branch.
    interrupts: [&'a AtomicBool; 2],
}

/// Work was asked to end before it had a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stopped;

impl<'a> Stop<'a> {
    /// Sweeps of a contact solver between two questions: together they take about as long as some tens of time steps.
    pub const PERIOD: usize = 64;

    /// Ends work once the flag is set.
    pub const fn at(flag: &'a AtomicBool) -> Self {
        Self { flag, interrupts: [flag; 2] }
    }

    /// Never ends any work.
    pub fn never() -> Stop<'static> {
        static NEVER: AtomicBool = AtomicBool::new(false);
        Stop::at(&NEVER)
    }

    /// The same for a part of the work, which these flags end too.
    #[must_use]
    pub const fn interrupted_by(self, interrupts: [&'a AtomicBool; 2]) -> Self {
        Self { interrupts, ..self }
    }

    /// Whether the work is to end.
    #[inline]
    pub fn is_set(self) -> bool {
        #[cfg(test)]
        probe::ask(self.flag);
        let [first, second] = self.interrupts;
        // Without branches between the loads: a rollout asks at every step.
        self.flag.load(Ordering::Relaxed) | first.load(Ordering::Relaxed) | second.load(Ordering::Relaxed)
    }

    /// Goes on unless the work is to end.
    ///
    /// # Errors
    /// When it is.
    #[inline]
    pub fn check(self) -> Result<(), Stopped> {
        if self.is_set() { Err(Stopped) } else { Ok(()) }
    }
}

impl<'a> From<&'a AtomicBool> for Stop<'a> {
    fn from(flag: &'a AtomicBool) -> Self {
        Self::at(flag)
    }
}

impl std::fmt::Display for Stopped {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("stopped before there was a result")
    }
}

impl std::error::Error for Stopped {}

/// Counts the questions of a test's thread and sets the flag at a chosen one.
#[cfg(test)]
pub(crate) mod probe {
    use std::cell::Cell;
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::Stop;

    thread_local! {
        /// (address of the flag, questions so far, the one at which it is set).
        static WATCHED: Cell<(usize, u64, u64)> = const { Cell::new((0, 0, 0)) };
    }

    pub(super) fn ask(flag: &AtomicBool) {
        let (address, asked, last) = WATCHED.get();
        if address != std::ptr::from_ref(flag).addr() {
            return;
        }
        WATCHED.set((address, asked + 1, last));
        if asked + 1 == last {
            flag.store(true, Ordering::Relaxed);
        }
    }

    /// Runs work that is stopped at question `last`, from 1; gives how often it has asked.
    pub(crate) fn stopped_at<T>(last: u64, work: impl FnOnce(Stop) -> T) -> (T, u64) {
        let flag = AtomicBool::new(false);
        WATCHED.set((std::ptr::from_ref(&flag).addr(), 0, last));
        let result = work(Stop::at(&flag));
        (result, WATCHED.replace((0, 0, 0)).1)
    }

    /// Runs work to its end; gives how often it has asked.
    pub(crate) fn unstopped<T>(work: impl FnOnce(Stop) -> T) -> (T, u64) {
        stopped_at(0, work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_flag_ends_work() {
        let flags = [const { AtomicBool::new(false) }; 3];
        let stop = Stop::at(&flags[0]).interrupted_by([&flags[1], &flags[2]]);
        assert_eq!((stop.check(), Stop::never().check()), (Ok(()), Ok(())));
        for flag in &flags {
            flag.store(true, Ordering::Relaxed);
            assert_eq!(stop.check(), Err(Stopped));
            flag.store(false, Ordering::Relaxed);
        }
    }
}
