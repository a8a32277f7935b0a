//! Why the service gives no answer.

use std::time::Duration;

/// A refusal or a failure; none of them is the fault of the values asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ServiceError {
    /// All places of the queue are taken.
    #[error("all {capacity} places are taken, try again in {} s", .retry_after.as_secs())]
    QueueFull {
        /// When it is worth trying again.
        retry_after: Duration,
        /// Jobs that may run and wait at once.
        capacity: usize,
    },
    /// The service starts or drains.
    #[error("the server takes no work at present, try again in {} s", .retry_after.as_secs())]
    Unavailable {
        /// When it is worth trying again, at another replica or after the restart.
        retry_after: Duration,
    },
    /// The caller left; nobody reads this answer.
    #[error("the caller left before the answer")]
    Cancelled,
    /// The solver panicked or broke its promise; the log holds the cause.
    #[error("the solver gave no answer; the log of the server holds the cause")]
    SolverPanic,
}
