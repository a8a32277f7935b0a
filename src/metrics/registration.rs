//! Families of the catalogue as entries of a registry.

use prometheus::core::Collector;
use prometheus::{
    Gauge, Histogram, HistogramOpts, HistogramVec, IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry,
};

use super::catalogue::{BUILD_INFO, Family};

/// Optional parts, and whether this build has them.
const FEATURES: [(&str, bool); 3] =
    [("nats", cfg!(feature = "nats")), ("otel", cfg!(feature = "otel")), ("tls", cfg!(feature = "tls"))];

/// A registry that is being filled.
#[derive(Clone, Copy)]
pub struct Registration<'a>(&'a Registry);

impl<'a> Registration<'a> {
    pub(super) fn of(registry: &'a Registry) -> Self {
        Self(registry)
    }

    /// A gauge without labels.
    pub fn gauge(self, family: &Family) -> IntGauge {
        self.added(family, IntGauge::with_opts(opts(family)))
    }

    pub(super) fn float_gauge(self, family: &Family) -> Gauge {
        self.added(family, Gauge::with_opts(opts(family)))
    }

    pub(super) fn gauges(self, family: &Family) -> IntGaugeVec {
        self.added(family, IntGaugeVec::new(opts(family), family.labels))
    }

    /// A counter without labels.
    pub fn counter(self, family: &Family) -> IntCounter {
        self.added(family, IntCounter::with_opts(opts(family)))
    }

    /// A counter per value of the labels.
    pub fn counters(self, family: &Family) -> IntCounterVec {
        self.added(family, IntCounterVec::new(opts(family), family.labels))
    }

    pub(super) fn histogram(self, family: &Family) -> Histogram {
        self.added(family, Histogram::with_opts(histogram_opts(family)))
    }

    /// A histogram per value of the labels.
    pub fn histograms(self, family: &Family) -> HistogramVec {
        self.added(family, HistogramVec::new(histogram_opts(family), family.labels))
    }

    /// What runs and, where the system knows them, the figures of the process.
    pub(super) fn process(self) {
        let features: Vec<_> = FEATURES.iter().filter(|(_, is_built)| *is_built).map(|(name, _)| *name).collect();
        self.gauges(&BUILD_INFO).with_label_values(&[env!("CARGO_PKG_VERSION"), &features.join(",")]).set(1);
        #[cfg(target_os = "linux")]
        {
            let process = prometheus::process_collector::ProcessCollector::for_self();
            self.0.register(Box::new(process)).expect("the names of the process figures are free");
        }
    }

    fn added<C: Collector + Clone + 'static>(self, family: &Family, made: prometheus::Result<C>) -> C {
        let collector = made.unwrap_or_else(|error| panic!("`{}` is no valid family: {error}", family.name));
        let added = self.0.register(Box::new(collector.clone()));
        added.unwrap_or_else(|error| panic!("`{}` is registered once: {error}", family.name));
        collector
    }
}

fn opts(family: &Family) -> Opts {
    Opts::new(family.name, family.help)
}

fn histogram_opts(family: &Family) -> HistogramOpts {
    HistogramOpts::new(family.name, family.help).buckets(family.buckets.to_vec())
}
