//! Every error that a caller can meet, in one table for all transports.

/// The code of an error; stable, new ones may be added.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorCode {
    /// The queue is full.
    QueueFull,
    /// The byte budget for bodies and answers is used up; the service stays ready.
    MemoryFull,
    /// The wait for a worker would outlast the deadline.
    DeadlineUnreachable,
    /// The deadline passed before there was an answer.
    DeadlineExceeded,
    /// The server's own limit passed before there was an answer.
    TimeLimitExceeded,
    /// Starting or draining.
    Unavailable,
    /// The caller left.
    Cancelled,
    /// Not JSON, or a number that no double holds.
    MalformedBody,
    /// A field that is unknown, missing, repeated or of the wrong type.
    InvalidField,
    /// A value outside its rule.
    InvalidValue,
    /// Valid, but above what this server accepts.
    ProblemTooLarge,
    /// The request body has too many bytes.
    BodyTooLarge,
    /// The request body took too long to arrive.
    BodyTimeout,
    /// Media type or encoding that is not understood.
    UnsupportedMedia,
    /// No such path.
    NotFound,
    /// The path has no such method.
    MethodNotAllowed,
    /// The solver failed on this input.
    SolverPanic,
    /// A fault of this server outside the solver.
    Internal,
    /// The API key is missing or wrong.
    Unauthenticated,
}

/// Status codes of gRPC by their numbers, without its library.
#[allow(missing_docs, reason = "names of the specification")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GrpcCode {
    Cancelled = 1,
    InvalidArgument = 3,
    DeadlineExceeded = 4,
    ResourceExhausted = 8,
    Unimplemented = 12,
    Internal = 13,
    Unavailable = 14,
    Unauthenticated = 16,
}

/// One row of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ErrorEntry {
    /// The `snake_case` code that callers see.
    pub code: &'static str,
    /// HTTP status.
    pub http_status: u16,
    /// gRPC status.
    pub grpc_code: GrpcCode,
    /// Whether the same request may succeed later.
    pub retryable: bool,
    /// One line for people, the same for every occurrence.
    pub title: &'static str,
}

impl ErrorCode {
    /// All codes.
    pub const ALL: [Self; 19] = [
        Self::QueueFull,
        Self::MemoryFull,
        Self::DeadlineUnreachable,
        Self::DeadlineExceeded,
        Self::TimeLimitExceeded,
        Self::Unavailable,
        Self::Cancelled,
        Self::MalformedBody,
        Self::InvalidField,
        Self::InvalidValue,
        Self::ProblemTooLarge,
        Self::BodyTooLarge,
        Self::BodyTimeout,
        Self::UnsupportedMedia,
        Self::NotFound,
        Self::MethodNotAllowed,
        Self::SolverPanic,
        Self::Internal,
        Self::Unauthenticated,
    ];

    /// The row of this code.
    #[rustfmt::skip] // one row per line reads as the table that it is
    pub const fn entry(self) -> ErrorEntry {
        match self {
            Self::QueueFull           => row("queue_full",           429, GrpcCode::ResourceExhausted, true,  "the queue is full"),
            Self::MemoryFull          => row("memory_full",          429, GrpcCode::ResourceExhausted, true,  "the memory for bodies and answers is full"),
            Self::DeadlineUnreachable => row("deadline_unreachable", 429, GrpcCode::ResourceExhausted, true,  "the wait for a worker would outlast the deadline"),
            Self::DeadlineExceeded    => row("deadline_exceeded",    504, GrpcCode::DeadlineExceeded,  true,  "the deadline passed before there was an answer"),
            Self::TimeLimitExceeded   => row("time_limit_exceeded",  504, GrpcCode::DeadlineExceeded,  false, "the time limit passed before there was an answer"),
            Self::Unavailable         => row("unavailable",          503, GrpcCode::Unavailable,       true,  "the server takes no work at present"),
            // Nobody reads this status; 499 is what access logs say for it.
            Self::Cancelled           => row("cancelled",            499, GrpcCode::Cancelled,         false, "the caller left"),
            Self::MalformedBody       => row("malformed_body",       400, GrpcCode::InvalidArgument,   false, "the body cannot be read"),
            Self::InvalidField        => row("invalid_field",        422, GrpcCode::InvalidArgument,   false, "the body does not have the expected fields"),
            Self::InvalidValue        => row("invalid_value",        422, GrpcCode::InvalidArgument,   false, "some values break their rules"),
            Self::ProblemTooLarge     => row("problem_too_large",    422, GrpcCode::InvalidArgument,   false, "the problem is larger than is accepted here"),
            Self::BodyTooLarge        => row("body_too_large",       413, GrpcCode::ResourceExhausted, false, "the body is too large"),
            Self::BodyTimeout         => row("body_timeout",         408, GrpcCode::DeadlineExceeded,  true,  "the body took too long to arrive"),
            Self::UnsupportedMedia    => row("unsupported_media",    415, GrpcCode::Unimplemented,     false, "the media type is not supported"),
            Self::NotFound            => row("not_found",            404, GrpcCode::Unimplemented,     false, "there is nothing at this path"),
            Self::MethodNotAllowed    => row("method_not_allowed",   405, GrpcCode::Unimplemented,     false, "the path does not take this method"),
            Self::SolverPanic         => row("solver_panic",         500, GrpcCode::Internal,          false, "the solver failed on this input"),
            Self::Internal            => row("internal",             500, GrpcCode::Internal,          false, "the server failed"),
            Self::Unauthenticated     => row("unauthenticated",      401, GrpcCode::Unauthenticated,   false, "the API key is missing or wrong"),
        }
    }
}

const fn row(
    code: &'static str,
    http_status: u16,
    grpc_code: GrpcCode,
    retryable: bool,
    title: &'static str,
) -> ErrorEntry {
    ErrorEntry { code, http_status, grpc_code, retryable, title }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_distinct() {
        let mut codes: Vec<_> = ErrorCode::ALL.iter().map(|code| code.entry().code).collect();
        codes.sort_unstable();
        codes.dedup();
        assert_eq!(codes.len(), ErrorCode::ALL.len());
    }

    #[test]
    fn only_overload_drain_and_slowness_are_worth_a_retry() {
        for code in ErrorCode::ALL {
            let entry = code.entry();
            // The same request takes as long the next time.
            let is_too_long = code == ErrorCode::TimeLimitExceeded;
            let is_slow_or_busy = matches!(entry.http_status, 408 | 429 | 503 | 504);
            assert_eq!(entry.retryable, is_slow_or_busy && !is_too_long, "{}", entry.code);
        }
    }
}
