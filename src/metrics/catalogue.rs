//! The families of metrics of the service and its transports: name, kind, labels, help. Kinds of jobs declare their own.

pub mod sweep_workers;

/// A family of metrics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Family {
    /// Its name.
    pub name: &'static str,
    /// What it counts with.
    pub kind: Kind,
    /// Names of its labels; their values come from closed sets.
    pub labels: &'static [&'static str],
    /// One sentence for people.
    pub help: &'static str,
    /// Upper bounds of its buckets, s; empty unless it is a histogram.
    pub buckets: &'static [f64],
}

/// What a family counts with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Only grows.
    Counter,
    /// Goes up and down.
    Gauge,
    /// Counts durations by size.
    Histogram,
}

impl Kind {
    /// The word of the text format.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Counter => "counter",
            Self::Gauge => "gauge",
            Self::Histogram => "histogram",
        }
    }
}

/// From a solve from one good start to the longest time limit.
pub const JOB_BUCKETS: &[f64] = &[0.005, 0.01, 0.025, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.5, 5.0, 10.0, 20.0, 30.0, 60.0];
/// From an answer without work to the longest time limit with a wait before it.
const REQUEST_BUCKETS: &[f64] =
    &[0.001, 0.002, 0.005, 0.01, 0.025, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0, 120.0];
/// Fine at 1 to 5 ms, where a refusal has to be.
const REJECTION_BUCKETS: &[f64] = &[
    0.0001, 0.00025, 0.0005, 0.001, 0.0015, 0.002, 0.0025, 0.003, 0.0035, 0.004, 0.0045, 0.005, 0.0075, 0.01, 0.025,
    0.05, 0.1, 0.5, 1.0, 10.0, 60.0,
];

/// A family of gauges.
pub const fn gauge(name: &'static str, labels: &'static [&'static str], help: &'static str) -> Family {
    Family { name, kind: Kind::Gauge, labels, help, buckets: &[] }
}

/// A family of counters.
pub const fn counter(name: &'static str, labels: &'static [&'static str], help: &'static str) -> Family {
    Family { name, kind: Kind::Counter, labels, help, buckets: &[] }
}

/// A family of histograms.
pub const fn histogram(
    name: &'static str,
    labels: &'static [&'static str],
    buckets: &'static [f64],
    help: &'static str,
) -> Family {
    Family { name, kind: Kind::Histogram, labels, help, buckets }
}

pub(super) const QUEUE_DEPTH: Family = gauge("slipdrive_queue_depth", &[], "Jobs that wait for a worker.");
pub(super) const QUEUE_CAPACITY: Family =
    gauge("slipdrive_queue_capacity", &[], "Jobs that may wait for a worker; beyond, requests are refused.");
pub(super) const QUEUE_COST: Family =
    gauge("slipdrive_queue_cost_seconds", &[], "Worker time that the jobs in flight are still expected to take.");
pub(super) const QUEUE_WAIT: Family = histogram(
    "slipdrive_queue_wait_seconds",
    &[],
    JOB_BUCKETS,
    "How long jobs waited for a worker; without light jobs.",
);
pub(super) const LIGHT_JOBS: Family =
    gauge("slipdrive_light_jobs", &[], "Light jobs that wait or run, beside the workers.");
pub(super) const JOBS: Family = counter(
    "slipdrive_jobs_total",
    &["job", "outcome"],
    "Jobs that ended, by kind and how: with an answer, or why not.",
);
pub(super) const REJECTED: Family = counter(
    "slipdrive_rejected_total",
    &["code"],
    "Requests and items of batches that were answered with a problem, by its code.",
);
pub(super) const REJECTION_DURATION: Family = histogram(
    "slipdrive_rejection_duration_seconds",
    &["code"],
    REJECTION_BUCKETS,
    "How long problems took from the head of their request, by code.",
);
pub(super) const CANCELLED: Family =
    counter("slipdrive_cancelled_total", &["cause"], "Jobs that ended without an answer, by cause.");
pub(super) const WORKERS: Family = gauge(
    "slipdrive_workers",
    &["state"],
    "Worker threads by state: `busy`, `helping` with the job of another, `stuck` beyond its stop flag, `idle`.",
);
pub(super) const SOLVER_PANICS: Family =
    counter("slipdrive_solver_panics_total", &[], "Jobs in which the solver panicked.");
pub(super) const HTTP_DURATION: Family = histogram(
    "slipdrive_http_request_duration_seconds",
    &["route", "code"],
    REQUEST_BUCKETS,
    "Duration of HTTP requests from their head to the end of their answer, by route and status.",
);
pub(super) const GRPC_DURATION: Family = histogram(
    "slipdrive_grpc_request_duration_seconds",
    &["method", "code"],
    REQUEST_BUCKETS,
    "Duration of gRPC calls from their head to the end of their answer, by method and status.",
);
pub(super) const CONNECTIONS: Family = gauge("slipdrive_connections", &[], "Connections that are open.");
pub(super) const CONNECTIONS_ENDED: Family = counter(
    "slipdrive_connections_ended_total",
    &["cause"],
    "Connections that the server ended or did not take, by cause: all places taken, too much unread, too slow.",
);
pub(super) const HELD_BYTES: Family = gauge(
    "slipdrive_held_bytes",
    &[],
    "Memory that is reserved for requests: bodies being received, and answers not yet taken.",
);
pub(super) const LOG_LINES_DROPPED: Family = counter(
    "slipdrive_log_lines_dropped_total",
    &[],
    "Lines of the log that were lost: nobody read it, or it could not be written.",
);
pub(super) const CALLER_REQUESTS: Family = counter(
    "slipdrive_caller_requests_total",
    &["caller"],
    "Requests with a key that were answered or left, by the name of their caller.",
);
pub(super) const CALLER_JOBS: Family = gauge(
    "slipdrive_caller_jobs",
    &["caller"],
    "Jobs in flight by the name of their caller: reserved, waiting and running.",
);
pub(super) const CALLER_REFUSED: Family = counter(
    "slipdrive_caller_refused_total",
    &["caller"],
    "Requests that were refused because their caller had its whole share in flight.",
);
pub(super) const FILE_READS: Family = counter(
    "slipdrive_file_reads_total",
    &["file", "outcome"],
    "Times that keys or certificate were read again, by outcome: `used`, or `refused` for their faults.",
);
pub(super) const FILE_STALE: Family = gauge(
    "slipdrive_file_stale",
    &["file"],
    "1 while keys or certificate cannot be used as they are, and what was read before is in force.",
);
pub(super) const BUILD_INFO: Family =
    gauge("slipdrive_build_info", &["version", "features"], "Always 1; the labels say what runs.");

/// All families of this module; those of the kinds of jobs and the figures of the process (`process_...`) come beside
/// them.
pub const ALL: &[Family] = &[
    QUEUE_DEPTH,
    QUEUE_CAPACITY,
    QUEUE_COST,
    QUEUE_WAIT,
    LIGHT_JOBS,
    JOBS,
    REJECTED,
    REJECTION_DURATION,
    CANCELLED,
    WORKERS,
    SOLVER_PANICS,
    HTTP_DURATION,
    GRPC_DURATION,
    CONNECTIONS,
    CONNECTIONS_ENDED,
    HELD_BYTES,
    LOG_LINES_DROPPED,
    CALLER_REQUESTS,
    CALLER_JOBS,
    CALLER_REFUSED,
    FILE_READS,
    FILE_STALE,
    BUILD_INFO,
];
