//! Families of the catalogue as entries of a registry.

use prometheus::core::Collector;
use prometheus::{
    Gauge, Histogram, HistogramOpts, HistogramVec, IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry,
};

use super::catalogue::{BUILD_INFO, Family};

/// Optional parts of this build.
const FEATURES: &str = if cfg!(feature = "otel") { "otel" } else { "" };

/// A registry that is being filled.
pub(super) struct Registration {
    registry: Registry,
}

impl Registration {
    pub(super) fn new() -> Self {
        Self { registry: Registry::new() }
    }

    pub(super) fn gauge(&mut self, family: &Family) -> IntGauge {
        self.added(family, IntGauge::with_opts(opts(family)))
    }

    pub(super) fn float_gauge(&mut self, family: &Family) -> Gauge {
        self.added(family, Gauge::with_opts(opts(family)))
    }

    pub(super) fn gauges(&mut self, family: &Family) -> IntGaugeVec {
        self.added(family, IntGaugeVec::new(opts(family), family.labels))
    }

    pub(super) fn counter(&mut self, family: &Family) -> IntCounter {
        self.added(family, IntCounter::with_opts(opts(family)))
    }

    pub(super) fn counters(&mut self, family: &Family) -> IntCounterVec {
        self.added(family, IntCounterVec::new(opts(family), family.labels))
    }

    pub(super) fn histogram(&mut self, family: &Family) -> Histogram {
        self.added(family, Histogram::with_opts(histogram_opts(family)))
    }

    pub(super) fn histograms(&mut self, family: &Family) -> HistogramVec {
        self.added(family, HistogramVec::new(histogram_opts(family), family.labels))
    }

    /// The registry, with what runs and, where the system tells them, the figures of the process.
    pub(super) fn finish(mut self) -> Registry {
        self.gauges(&BUILD_INFO).with_label_values(&[env!("CARGO_PKG_VERSION"), FEATURES]).set(1);
        #[cfg(target_os = "linux")]
        {
            let process = prometheus::process_collector::ProcessCollector::for_self();
            self.registry.register(Box::new(process)).expect("the names of the process figures are free");
        }
        self.registry
    }

    fn added<C: Collector + Clone + 'static>(&mut self, family: &Family, made: prometheus::Result<C>) -> C {
        let collector = made.unwrap_or_else(|error| panic!("`{}` is no sound family: {error}", family.name));
        let added = self.registry.register(Box::new(collector.clone()));
        added.unwrap_or_else(|error| panic!("`{}` is in the catalogue once: {error}", family.name));
        collector
    }
}

fn opts(family: &Family) -> Opts {
    Opts::new(family.name, family.help)
}

fn histogram_opts(family: &Family) -> HistogramOpts {
    HistogramOpts::new(family.name, family.help).buckets(family.buckets.to_vec())
}
