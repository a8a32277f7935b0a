//! W3C trace context: the trace that a request belongs to, as its caller sends it, and as the answer returns it.
//!
//! The header `traceparent` (metadata of the same name over gRPC) is `00-TRACE-PARENT-FLAGS` in lower-case hexadecimal
//! digits: 32, 16 and 2 of them. A header that breaks the rules is ignored, as the recommendation wants it.

use axum::http::{HeaderMap, HeaderName, HeaderValue};
use tracing::Span;
use uuid::Uuid;

/// Carries the trace in both directions.
pub(super) const TRACEPARENT: HeaderName = HeaderName::from_static("traceparent");

/// A span within a trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TraceContext {
    trace_id: u128,
    span_id: u64,
    flags: u8,
}

impl TraceContext {
    /// The context of a request within its caller's trace, or within one of its own. With the feature `otel` the
    /// ids are those under which `span` is exported.
    pub(super) fn of_request(span: &Span, headers: &HeaderMap) -> Self {
        let caller = headers.get(TRACEPARENT).and_then(|value| value.to_str().ok()).and_then(Self::parse);
        let context = Self::exported(span, caller).unwrap_or_else(|| Self {
            trace_id: caller.map_or_else(|| Uuid::now_v7().as_u128(), |caller| caller.trace_id),
            span_id: new_span_id(),
            flags: caller.map_or(0, |caller| caller.flags),
        });
        span.record("trace.id", context.trace_id());
        context
    }

    /// 32 hexadecimal digits.
    pub(super) fn trace_id(&self) -> String {
        format!("{:032x}", self.trace_id)
    }

    /// The header of this context.
    pub(super) fn header(&self) -> Option<HeaderValue> {
        let Self { trace_id, span_id, flags } = self;
        HeaderValue::try_from(format!("00-{trace_id:032x}-{span_id:016x}-{flags:02x}")).ok()
    }

    fn parse(text: &str) -> Option<Self> {
        let mut parts = text.split('-');
        let version = digits(parts.next()?, 2)?;
        let trace_id = digits(parts.next()?, 32)?;
        let span_id = u64::try_from(digits(parts.next()?, 16)?).ok()?;
        let flags = u8::try_from(digits(parts.next()?, 2)?).ok()?;
        // Later versions may append parts; version ff is forbidden.
        let is_sound = version != 0xff && (version != 0 || parts.next().is_none());
        (is_sound && trace_id != 0 && span_id != 0).then_some(Self { trace_id, span_id, flags })
    }

    #[cfg(not(feature = "otel"))]
    fn exported(_span: &Span, _caller: Option<Self>) -> Option<Self> {
        None
    }

    /// Puts the span under its caller's; none where nothing is exported.
    #[cfg(feature = "otel")]
    fn exported(span: &Span, caller: Option<Self>) -> Option<Self> {
        use opentelemetry::trace::{SpanContext, SpanId, TraceContextExt as _, TraceFlags, TraceId, TraceState};
        use tracing_opentelemetry::OpenTelemetrySpanExt as _;

        if let Some(Self { trace_id, span_id, flags }) = caller {
            let (trace_id, span_id) = (TraceId::from(trace_id), SpanId::from(span_id));
            let remote = SpanContext::new(trace_id, span_id, TraceFlags::new(flags), true, TraceState::NONE);
            // Refused only for a span that has begun or is not exported: then its own ids say so.
            let _ = span.set_parent(opentelemetry::Context::new().with_remote_span_context(remote));
        }
        let context = span.context();
        let own = context.span().span_context().clone();
        own.is_valid().then(|| Self {
            trace_id: u128::from_be_bytes(own.trace_id().to_bytes()),
            span_id: u64::from_be_bytes(own.span_id().to_bytes()),
            flags: own.trace_flags().to_u8(),
        })
    }
}

/// Never 0: an id of version 7 has variant bits in its lower half.
fn new_span_id() -> u64 {
    Uuid::now_v7().as_u64_pair().1
}

fn digits(text: &str, count: usize) -> Option<u128> {
    let is_digit = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
    (text.len() == count && text.bytes().all(is_digit)).then(|| u128::from_str_radix(text, 16).ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRACE: &str = "0af7651916cd43dd8448eb211c80319c";

    fn of(traceparent: Option<&str>) -> TraceContext {
        let value = traceparent.map(|text| HeaderValue::from_str(text).unwrap());
        let headers: HeaderMap = value.into_iter().map(|value| (TRACEPARENT, value)).collect();
        TraceContext::of_request(&Span::none(), &headers)
    }

    #[test]
    fn caller_trace_is_kept_under_a_new_span() {
        let context = of(Some(&format!("00-{TRACE}-b7ad6b7169203331-01")));
        assert_eq!(context.trace_id(), TRACE);
        let header = context.header().unwrap();
        let header = header.to_str().unwrap();
        assert!(header.starts_with(&format!("00-{TRACE}-")) && header.ends_with("-01"), "{header}");
        assert!(!header.contains("b7ad6b7169203331"), "the caller's span is not this one: {header}");
    }

    #[test]
    fn later_versions_may_have_more_parts() {
        assert_eq!(of(Some(&format!("01-{TRACE}-b7ad6b7169203331-01-more"))).trace_id(), TRACE);
    }

    #[test]
    fn unsound_header_is_ignored() {
        let zero = "0".repeat(32);
        for invalid in [
            "",
            "00",
            &format!("00-{TRACE}-b7ad6b7169203331"),
            &format!("00-{TRACE}-b7ad6b7169203331-01-more"),
            &format!("ff-{TRACE}-b7ad6b7169203331-01"),
            &format!("00-{}-b7ad6b7169203331-01", TRACE.to_uppercase()),
            &format!("00-{zero}-b7ad6b7169203331-01"),
            &format!("00-{TRACE}-0000000000000000-01"),
            &format!("00-+{}-b7ad6b7169203331-01", &TRACE[1..]),
        ] {
            let context = of(Some(invalid));
            assert!(context.trace_id() != TRACE && context.trace_id() != zero, "{invalid}");
        }
    }

    #[test]
    fn request_without_a_trace_begins_one() {
        assert_ne!(of(None).trace_id(), of(None).trace_id());
    }
}
