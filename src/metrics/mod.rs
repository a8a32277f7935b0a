//! What the process counts about itself, in the Prometheus text format 0.0.4.
//!
//! One registry per server, so that servers in one process (tests) count apart. All labels come from closed sets:
//! names of the contract, routes and status codes, names of the configuration, never words of a caller. The names are listed in [`catalogue`] and by
//! each kind of job; `docs/operations.md` repeats them.

mod callers;
pub mod catalogue;
mod files;
mod registration;

use std::sync::OnceLock;
use std::time::Duration;

use prometheus::{Encoder as _, Gauge, Histogram, HistogramVec, IntCounter, IntCounterVec, IntGaugeVec, TextEncoder};
use prometheus::{IntGauge, Registry};

use callers::Callers;
use files::Files;
pub use files::SecretFile;
pub use registration::Registration;

/// The content type of [`Metrics::render`].
pub const CONTENT_TYPE: &str = prometheus::TEXT_FORMAT;

/// The counters of one server.
pub struct Metrics {
    registry: Registry,
    queue_depth: IntGauge,
    queue_capacity: IntGauge,
    queue_cost: Gauge,
    queue_wait: Histogram,
    light_jobs: IntGauge,
    jobs: IntCounterVec,
    rejected: IntCounterVec,
    rejection_duration: HistogramVec,
    cancelled: IntCounterVec,
    workers: IntGaugeVec,
    solver_panics: IntCounter,
    http_duration: HistogramVec,
    grpc_duration: HistogramVec,
    connections: IntGauge,
    connections_ended: IntCounterVec,
    held_bytes: IntGauge,
    log_lines_dropped: IntCounter,
    callers: Callers,
    files: Files,
    /// What counts the dropped lines.
    dropped_lines: OnceLock<Box<dyn Fn() -> u64 + Send + Sync>>,
}

/// Why the server ended a connection that its peer would have kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConnectionEnd {
    /// All places were taken.
    NoPlace,
    /// Its unread answers or half-sent bodies held memory that others needed.
    Unread,
    /// Its peer was too slow: to speak, or to take an answer.
    Slow,
}

impl ConnectionEnd {
    /// All ends.
    pub const ALL: [Self; 3] = [Self::NoPlace, Self::Unread, Self::Slow];

    /// The label.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::NoPlace => "no_place",
            Self::Unread => "unread",
            Self::Slow => "slow",
        }
    }
}

/// What the queue holds at one moment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct QueueLevels {
    /// Jobs that wait for a worker.
    pub waiting: usize,
    /// Jobs that may wait.
    pub capacity: usize,
    /// Worker time that the jobs in flight are still expected to take, s.
    pub cost_s: f64,
    /// Workers that run a job.
    pub busy_workers: usize,
    /// Workers that do not obey the stop flag of their job.
    pub stuck_workers: usize,
    /// Workers that help with the job of another.
    pub helping_workers: usize,
    /// Workers that do nothing.
    pub idle_workers: usize,
    /// Light jobs that wait or run.
    pub light_jobs: usize,
}

/// How a job ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobEnd {
    /// With an answer.
    Finished,
    /// The deadline passed before there was an answer.
    Deadline,
    /// The server's own limit passed before there was an answer.
    TimeLimit,
    /// The caller left.
    CallerGone,
    /// The process ends.
    Shutdown,
    /// The work panicked.
    Panicked,
}

impl JobEnd {
    /// All ends.
    pub const ALL: [Self; 6] =
        [Self::Finished, Self::Deadline, Self::TimeLimit, Self::CallerGone, Self::Shutdown, Self::Panicked];
    /// Those for which nobody in the server is to blame.
    const CANCELLED: [Self; 4] = [Self::Deadline, Self::TimeLimit, Self::CallerGone, Self::Shutdown];

    /// The label.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Finished => "finished",
            Self::Deadline => "deadline",
            Self::TimeLimit => "time_limit",
            Self::CallerGone => "caller_gone",
            Self::Shutdown => "shutdown",
            Self::Panicked => "panicked",
        }
    }
}

/// One answered request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answered<'a> {
    /// Over HTTP: the route and the status.
    Http {
        /// A route of the server, never the caller's path.
        route: &'a str,
        /// Such as `200`.
        status: &'a str,
    },
    /// Over gRPC: the method and the name of the status.
    Grpc {
        /// A method of the server, never the caller's path.
        method: &'static str,
        /// Such as `RESOURCE_EXHAUSTED`.
        code: &'static str,
    },
}

impl Metrics {
    /// Counters at zero.
    ///
    /// # Panics
    /// When two families have the same name, which `catalogue` rules out.
    pub fn new() -> Self {
        let registry = Registry::new();
        let registration = Registration::of(&registry);
        registration.process();
        let metrics = Self {
            queue_depth: registration.gauge(&catalogue::QUEUE_DEPTH),
            queue_capacity: registration.gauge(&catalogue::QUEUE_CAPACITY),
            queue_cost: registration.float_gauge(&catalogue::QUEUE_COST),
            queue_wait: registration.histogram(&catalogue::QUEUE_WAIT),
            light_jobs: registration.gauge(&catalogue::LIGHT_JOBS),
            jobs: registration.counters(&catalogue::JOBS),
            rejected: registration.counters(&catalogue::REJECTED),
            rejection_duration: registration.histograms(&catalogue::REJECTION_DURATION),
            cancelled: registration.counters(&catalogue::CANCELLED),
            workers: registration.gauges(&catalogue::WORKERS),
            solver_panics: registration.counter(&catalogue::SOLVER_PANICS),
            http_duration: registration.histograms(&catalogue::HTTP_DURATION),
            grpc_duration: registration.histograms(&catalogue::GRPC_DURATION),
            connections: registration.gauge(&catalogue::CONNECTIONS),
            connections_ended: registration.counters(&catalogue::CONNECTIONS_ENDED),
            held_bytes: registration.gauge(&catalogue::HELD_BYTES),
            log_lines_dropped: registration.counter(&catalogue::LOG_LINES_DROPPED),
            callers: Callers::of(registration),
            files: Files::of(registration),
            dropped_lines: OnceLock::new(),
            registry,
        };
        for end in ConnectionEnd::ALL {
            metrics.connections_ended.with_label_values(&[end.as_str()]);
        }
        for end in JobEnd::CANCELLED {
            metrics.cancelled.with_label_values(&[end.as_str()]);
        }
        metrics
    }

    /// Reports these codes as 0 until they come: a rate over a counter that appears with its first event misses it.
    pub fn expect_rejections(&self, codes: impl IntoIterator<Item = &'static str>) {
        for code in codes {
            self.rejected.with_label_values(&[code]);
        }
    }

    /// Where kinds of jobs register families of their own.
    pub fn registration(&self) -> Registration<'_> {
        Registration::of(&self.registry)
    }

    /// Reports a kind of job as 0 until it comes.
    pub fn expect_jobs(&self, kind: &'static str) {
        for end in JobEnd::ALL {
            self.jobs.with_label_values(&[kind, end.as_str()]);
        }
    }

    /// Counts the wait of a job that starts on a worker.
    pub fn waited(&self, wait: Duration) {
        self.queue_wait.observe(wait.as_secs_f64());
    }

    /// Counts the end of a job.
    pub fn job_ended(&self, kind: &'static str, end: JobEnd) {
        self.jobs.with_label_values(&[kind, end.as_str()]).inc();
        if JobEnd::CANCELLED.contains(&end) {
            self.cancelled.with_label_values(&[end.as_str()]).inc();
        }
    }

    /// Counts a panic of the solver.
    pub fn panicked(&self) {
        self.solver_panics.inc();
    }

    /// Counts an answer that is a problem; none of those has a plan.
    pub fn rejected(&self, code: &'static str) {
        self.rejected.with_label_values(&[code]).inc();
    }

    /// Counts how long a problem took from the head of its request.
    pub fn rejected_after(&self, code: &'static str, duration: Duration) {
        self.rejected(code);
        self.rejection_duration.with_label_values(&[code]).observe(duration.as_secs_f64());
    }

    /// Counts a request from its head to the end of its answer.
    pub fn answered(&self, answered: Answered<'_>, duration: Duration) {
        let histogram = match answered {
            Answered::Http { route, status } => self.http_duration.with_label_values(&[route, status]),
            Answered::Grpc { method, code } => self.grpc_duration.with_label_values(&[method, code]),
        };
        histogram.observe(duration.as_secs_f64());
    }

    /// Counts a connection as open.
    pub fn connection_opened(&self) {
        self.connections.inc();
    }

    /// Counts a connection as open no more.
    pub fn connection_closed(&self) {
        self.connections.dec();
    }

    /// Counts a connection that the server ended, or did not take.
    pub fn connection_ended(&self, cause: ConnectionEnd) {
        self.connections_ended.with_label_values(&[cause.as_str()]).inc();
    }

    /// So many bytes more are reserved for requests than before.
    pub fn held_changed(&self, difference: i64) {
        self.held_bytes.add(difference);
    }

    /// Reports the lines that this log has dropped so far; only the first log is followed.
    pub fn follow_dropped_lines(&self, dropped_lines: impl Fn() -> u64 + Send + Sync + 'static) {
        // A second log of one process would count the same lines.
        let _ = self.dropped_lines.set(Box::new(dropped_lines));
    }

    /// All families as text, with these levels of the queue.
    pub fn render(&self, levels: &QueueLevels) -> Vec<u8> {
        let as_gauge = |count: usize| i64::try_from(count).unwrap_or(i64::MAX);
        self.queue_depth.set(as_gauge(levels.waiting));
        self.queue_capacity.set(as_gauge(levels.capacity));
        self.queue_cost.set(levels.cost_s);
        self.light_jobs.set(as_gauge(levels.light_jobs));
        self.workers.with_label_values(&["busy"]).set(as_gauge(levels.busy_workers));
        self.workers.with_label_values(&["stuck"]).set(as_gauge(levels.stuck_workers));
        self.workers.with_label_values(&["helping"]).set(as_gauge(levels.helping_workers));
        self.workers.with_label_values(&["idle"]).set(as_gauge(levels.idle_workers));
        if let Some(dropped_lines) = self.dropped_lines.get() {
            self.log_lines_dropped.inc_by(dropped_lines().saturating_sub(self.log_lines_dropped.get()));
        }
        let mut text = Vec::new();
        if let Err(error) = TextEncoder::new().encode(&self.registry.gather(), &mut text) {
            tracing::error!(error = %error, "the metrics cannot be written");
        }
        text
    }
}

impl std::fmt::Debug for Metrics {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Metrics").finish_non_exhaustive()
    }
}

impl Default for Metrics {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEVELS: QueueLevels = QueueLevels {
        waiting: 3,
        capacity: 64,
        cost_s: 1.5,
        busy_workers: 1,
        stuck_workers: 0,
        helping_workers: 0,
        idle_workers: 0,
        light_jobs: 0,
    };

    fn filled() -> Metrics {
        let metrics = Metrics::new();
        metrics.waited(Duration::from_millis(30));
        metrics.rejected_after("queue_full", Duration::from_micros(1200));
        metrics.job_ended("solve", JobEnd::CallerGone);
        metrics.job_ended("solve", JobEnd::Finished);
        metrics.answered(Answered::Http { route: "/solve", status: "200" }, Duration::from_millis(230));
        metrics.answered(Answered::Grpc { method: "Solve", code: "OK" }, Duration::from_millis(230));
        metrics.expect_caller("fleet");
        metrics.expect_file(SecretFile::ApiKeys);
        metrics
    }

    fn text(metrics: &Metrics) -> String {
        String::from_utf8(metrics.render(&LEVELS)).unwrap()
    }

    #[test]
    fn families_are_those_of_the_catalogue_with_their_words() {
        let text = text(&filled());
        for family in catalogue::ALL {
            assert!(text.contains(&format!("# HELP {} {}\n", family.name, family.help)), "{} in {text}", family.name);
            assert!(text.contains(&format!("# TYPE {} {}\n", family.name, family.kind.as_str())), "{}", family.name);
        }
        let own = |line: &&str| line.starts_with("# TYPE slipdrive_");
        assert_eq!(
            text.lines().filter(own).count(),
            catalogue::ALL.iter().filter(|f| f.name.starts_with("slipdrive_")).count()
        );
    }

    #[test]
    fn dropped_lines_are_those_of_the_log() {
        let metrics = filled();
        metrics.follow_dropped_lines(|| 7);
        for _ in 0..2 {
            assert!(text(&metrics).contains("\nslipdrive_log_lines_dropped_total 7\n"));
        }
    }

    #[test]
    fn every_histogram_ends_in_infinity_and_counts_what_was_seen() {
        let text = text(&filled());
        for family in catalogue::ALL.iter().filter(|family| family.kind == catalogue::Kind::Histogram) {
            let infinite =
                |line: &&str| line.starts_with(&format!("{}_bucket{{", family.name)) && line.contains("le=\"+Inf\"}");
            assert_eq!(text.lines().filter(infinite).map(|line| line.rsplit(' ').next()).next(), Some(Some("1")));
        }
    }

    #[test]
    fn refusals_have_buckets_around_the_first_milliseconds() {
        let text = text(&filled());
        let bucket = |bound: &str| {
            let line = format!("slipdrive_rejection_duration_seconds_bucket{{code=\"queue_full\",le=\"{bound}\"}} ");
            text.lines().find_map(|found| found.strip_prefix(&line).map(str::to_owned)).unwrap()
        };
        assert_eq!((bucket("0.001"), bucket("0.0015")), ("0".to_owned(), "1".to_owned()));
        assert_eq!((bucket("0.002"), bucket("0.005")), ("1".to_owned(), "1".to_owned()));
    }

    #[test]
    fn levels_and_counts_are_reported_as_they_are() {
        let text = text(&filled());
        for line in [
            "slipdrive_queue_depth 3",
            "slipdrive_queue_cost_seconds 1.5",
            "slipdrive_workers{state=\"busy\"} 1",
            "slipdrive_jobs_total{job=\"solve\",outcome=\"finished\"} 1",
            "slipdrive_jobs_total{job=\"solve\",outcome=\"caller_gone\"} 1",
            "slipdrive_cancelled_total{cause=\"caller_gone\"} 1",
            "slipdrive_cancelled_total{cause=\"deadline\"} 0",
            "slipdrive_rejected_total{code=\"queue_full\"} 1",
            "slipdrive_solver_panics_total 0",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} in {text}");
        }
    }
}
