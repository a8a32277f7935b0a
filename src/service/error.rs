//! Why the service gives no answer.

use std::time::Duration;

/// A refusal or a failure; none but [`ServiceError::Contradicted`] is the fault of the values asked.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ServiceError {
    /// All places of the queue are taken.
    #[error("the queue is full: {capacity} jobs run or wait, try again in {} s", seconds(.retry_after))]
    QueueFull {
        /// When it is worth trying again.
        retry_after: Duration,
        /// Jobs that may run and wait at once.
        capacity: usize,
    },
    /// One of several callers has all in flight that it may.
    #[error(
        "the share of this caller is used up: {capacity} of its jobs may run and wait beside those of others, try again in \
         {} s", seconds(.retry_after)
    )]
    ShareUsedUp {
        /// When it is worth trying again.
        retry_after: Duration,
        /// Jobs of one caller that may run and wait at once; fewer where they are long.
        capacity: usize,
    },
    /// The wait for a worker would outlast the caller's deadline.
    #[error(
        "up to {} ms may pass until a worker is free, and {} ms are kept to finish and send the answer, but the deadline is in \
         {} ms", milliseconds(.estimated_wait), milliseconds(.kept), .remaining.as_millis()
    )]
    DeadlineUnreachable {
        /// When it is worth trying again.
        retry_after: Duration,
        /// How long a worker may not be free.
        estimated_wait: Duration,
        /// How long before the deadline a search ends, so that its answer is there in time.
        kept: Duration,
        /// How long the deadline was away.
        remaining: Duration,
    },
    /// The deadline passed before the job could start, or before it had anything to answer.
    #[error("the deadline passed before there was an answer")]
    DeadlineExceeded,
    /// The time limit of the request, or that of the server, passed before there was an answer.
    #[error("the time limit passed before there was an answer")]
    TimeLimitExceeded,
    /// The service starts or drains.
    #[error("the server takes no work at present, try again in {} s", seconds(.retry_after))]
    Unavailable {
        /// When it is worth trying again, at another replica or after the restart.
        retry_after: Duration,
    },
    /// The caller left; nobody reads this answer.
    #[error("the caller left before the answer")]
    Cancelled,
    /// The solver panicked or broke its promise; the log has the cause.
    #[error("the solver gave no answer; the log of the server has the cause")]
    SolverPanic,
    /// What was asked contradicts itself, or is of no use, which only running it shows.
    #[error("{fault}")]
    Contradicted {
        /// The path of the field that is at fault.
        field: &'static str,
        /// What speaks against it.
        fault: String,
    },
}

/// Whole seconds: who waits as long as the text says is not too early.
pub(crate) fn seconds(wait: &Duration) -> u64 {
    wait.as_secs() + u64::from(wait.subsec_nanos() > 0)
}

/// Whole milliseconds, rounded up: the texts never say less than is needed.
fn milliseconds(needed: &Duration) -> u128 {
    needed.as_nanos().div_ceil(1_000_000)
}

impl ServiceError {
    /// When it is worth trying again, where that is known.
    pub fn retry_after(&self) -> Option<Duration> {
        match *self {
            Self::QueueFull { retry_after, .. }
            | Self::ShareUsedUp { retry_after, .. }
            | Self::DeadlineUnreachable { retry_after, .. }
            | Self::Unavailable { retry_after } => Some(retry_after),
            Self::DeadlineExceeded
            | Self::TimeLimitExceeded
            | Self::Cancelled
            | Self::SolverPanic
            | Self::Contradicted { .. } => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_an_unreachable_deadline_explain_the_refusal() {
        let microseconds = Duration::from_micros;
        let refused = ServiceError::DeadlineUnreachable {
            retry_after: Duration::ZERO,
            estimated_wait: microseconds(166_400),
            kept: microseconds(33_000),
            remaining: microseconds(199_300),
        };
        let text = "up to 167 ms may pass until a worker is free, and 33 ms are kept to finish and send the answer, but the \
                    deadline is in 199 ms";
        assert_eq!(refused.to_string(), text);
    }
}
