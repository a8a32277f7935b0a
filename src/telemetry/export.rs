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

const ENDPOINTS: [&str; 2] = ["OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"];
const SERVICE_NAME: &str = "OTEL_SERVICE_NAME";

/// The pipeline from spans to the collector.
pub(super) struct Provider(SdkTracerProvider);

/// A variable whose value cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("`{name}` is \"{value}\", must be a URL, such as http://localhost:4318")]
pub(crate) struct NoUrl {
    name: &'static str,
    value: String,
}

/// The pipeline; none where no collector is named, or where nothing is to be exported.
///
/// # Errors
/// [`NoUrl`] of an endpoint, and when the exporter cannot be built.
pub(super) fn provider() -> anyhow::Result<Option<Provider>> {
    let endpoints: Vec<_> = ENDPOINTS.iter().filter_map(|name| Some((*name, given(name)?))).collect();
    let is_off = given("OTEL_SDK_DISABLED").is_some_and(|value| value.eq_ignore_ascii_case("true"));
    let is_for_nobody = given("OTEL_TRACES_EXPORTER").is_some_and(|value| value == "none");
    if endpoints.is_empty() || is_off || is_for_nobody {
        return Ok(None);
    }
    if let Some((name, value)) = endpoints.into_iter().find(|(_, value)| !is_url(value)) {
        return Err(NoUrl { name, value }.into());
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
