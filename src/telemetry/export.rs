//! Exports spans over OTLP (HTTP, protobuf) to the collector that `OTEL_EXPORTER_OTLP_ENDPOINT` names.
//!
//! The other variables of the OpenTelemetry specification apply too, such as `OTEL_SERVICE_NAME` and
//! `OTEL_TRACES_SAMPLER`. Without an endpoint nothing is exported: an exporter without a collector would log an error
//! every few seconds. An empty variable is one that is not set.

use std::env;

use anyhow::Context as _;
use axum::http::Uri;
use opentelemetry::trace::TracerProvider as _;
use opentelemetry_otlp::SpanExporter;
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::SdkTracerProvider;
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::{Layer, Registry};

use crate::config::Faults;

const ENDPOINTS: [&str; 2] = ["OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"];
const SERVICE_NAME: &str = "OTEL_SERVICE_NAME";

/// The pipeline from spans to the collector.
pub(super) struct Provider(SdkTracerProvider);

/// Adds the endpoints that are no URLs.
pub(crate) fn check(faults: &mut Faults) {
    for (name, value) in endpoints().into_iter().filter(|(_, value)| !is_url(value)) {
        faults.add(format!("`{name}` is \"{value}\", must be a URL, such as http://localhost:4318"));
    }
}

/// The pipeline; none where no collector is named, or where nothing is to be exported.
///
/// # Errors
/// When the exporter cannot be built.
pub(super) fn provider() -> anyhow::Result<Option<Provider>> {
    if endpoints().is_empty() {
        return Ok(None);
    }
    let exporter = SpanExporter::builder().with_http().build().context("the exporter of spans cannot be built")?;
    let resource = Resource::builder();
    let resource = match given(SERVICE_NAME) {
        Some(_) => resource,
        None => resource.with_service_name(env!("CARGO_PKG_NAME")),
    };
    let provider = SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource.build());
    Ok(Some(Provider(provider.build())))
}

/// The variables that name a collector, where anything is to be exported.
fn endpoints() -> Vec<(&'static str, String)> {
    let is_off = given("OTEL_SDK_DISABLED").is_some_and(|value| value.eq_ignore_ascii_case("true"));
    let is_for_nobody = given("OTEL_TRACES_EXPORTER").is_some_and(|value| value == "none");
    let named = ENDPOINTS.into_iter().filter_map(|name| Some((name, given(name)?)));
    named.filter(|_| !is_off && !is_for_nobody).collect()
}

/// The value of a variable that is set and not empty.
fn given(name: &str) -> Option<String> {
    env::var_os(name).filter(|value| !value.is_empty()).map(|value| value.to_string_lossy().into_owned())
}

fn is_url(text: &str) -> bool {
    let uri = text.parse::<Uri>().ok();
    uri.is_some_and(|uri| matches!(uri.scheme_str(), Some("http" | "https")) && uri.authority().is_some())
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
