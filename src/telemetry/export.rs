//! Exports spans over OTLP (HTTP, protobuf) to the collector that `OTEL_EXPORTER_OTLP_ENDPOINT` names.
//!
//! The other variables of the OpenTelemetry specification apply too, such as `OTEL_SERVICE_NAME` and
//! `OTEL_TRACES_SAMPLER`. Without an endpoint nothing is exported: an exporter without a collector would log an error
//! every few seconds.

use std::env;

use anyhow::Context as _;
use opentelemetry::trace::TracerProvider as _;
use opentelemetry_otlp::SpanExporter;
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::SdkTracerProvider;
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::{Layer, Registry};

const ENDPOINTS: [&str; 2] = ["OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"];
const SERVICE_NAME: &str = "OTEL_SERVICE_NAME";

/// The pipeline from spans to the collector.
pub(super) struct Provider(SdkTracerProvider);

/// The pipeline; none where no collector is named.
///
/// # Errors
/// When the exporter cannot be built, such as for an invalid endpoint.
pub(super) fn provider() -> anyhow::Result<Option<Provider>> {
    if ENDPOINTS.iter().all(|name| env::var_os(name).is_none()) {
        return Ok(None);
    }
    let exporter = SpanExporter::builder().with_http().build().context("the exporter of spans cannot be built")?;
    let resource = Resource::builder();
    let resource = match env::var_os(SERVICE_NAME) {
        Some(_) => resource,
        None => resource.with_service_name(env!("CARGO_PKG_NAME")),
    };
    let provider = SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource.build());
    Ok(Some(Provider(provider.build())))
}

impl Provider {
    /// Exports the spans of this crate alone: spans of the exporter's own HTTP client would cause further exports.
    pub(super) fn layer(&self) -> impl Layer<Registry> + Send + Sync + use<> {
        let tracer = self.0.tracer(env!("CARGO_PKG_NAME"));
        let own = filter_fn(|metadata| metadata.is_span() && metadata.target().starts_with(env!("CARGO_PKG_NAME")));
        tracing_opentelemetry::layer::<Registry>().with_tracer(tracer).with_filter(own)
    }
}

impl Drop for Provider {
    fn drop(&mut self) {
        if let Err(error) = self.0.shutdown() {
            tracing::warn!(error = %error, "the last spans were not sent");
        }
    }
}
