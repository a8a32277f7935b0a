//! A body that keeps the line of its request until its last byte: streams end long after their head.

use std::pin::Pin;
use std::task::{Context, Poll, ready};

use axum::body::{Body, Bytes, HttpBody};
use axum::http::HeaderMap;
use axum::response::Response;
use hyper::body::{Frame, SizeHint};

use super::access::AccessLine;

/// Reads the outcome in the trailers of an answer into its line.
pub(super) type ReadTrailers = fn(&HeaderMap, &mut AccessLine);

/// Writes `line` when the last byte of the answer has been taken, or its caller has left.
pub(super) fn follow(response: Response, line: AccessLine, read_trailers: ReadTrailers) -> Response {
    response.map(|body| {
        let mut observed = ObservedBody { body, line: Some(line), read_trailers, is_begun: false };
        observed.note_end();
        Body::new(observed)
    })
}

struct ObservedBody {
    body: Body,
    /// None once it is written.
    line: Option<AccessLine>,
    read_trailers: ReadTrailers,
    is_begun: bool,
}

impl ObservedBody {
    /// Writes the line if nothing is left of the body; servers do not ask again then.
    fn note_end(&mut self) {
        if self.body.is_end_stream() {
            self.line = None;
        }
    }
}

impl HttpBody for ObservedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        self.is_begun = true;
        let frame = ready!(Pin::new(&mut self.body).poll_frame(context));
        match &frame {
            Some(Ok(frame)) => {
                let read_trailers = self.read_trailers;
                if let (Some(trailers), Some(line)) = (frame.trailers_ref(), &mut self.line) {
                    read_trailers(trailers, line);
                }
                self.note_end();
            }
            Some(Err(_)) => {}
            None => self.line = None,
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for ObservedBody {
    fn drop(&mut self) {
        // A body that nobody began to read is that of a HEAD, or as short as its head.
        if let Some(line) = self.line.as_mut().filter(|_| self.is_begun) {
            line.abandon();
        }
    }
}

/// Bodies without trailers.
pub(super) fn no_trailers(_: &HeaderMap, _: &mut AccessLine) {}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use axum::http::Method;
    use futures_util::stream;
    use http_body_util::BodyExt as _;

    use super::*;
    use crate::api::access::{Endpoint, RequestContext};
    use crate::metrics::Metrics;

    fn response(body: Body) -> (Response, Arc<Metrics>) {
        let metrics = Arc::new(Metrics::new());
        let (context, span) = RequestContext::open("/solve", &HeaderMap::new(), None);
        let mut line =
            AccessLine::open(Method::POST, context, span, Endpoint::Http("/solve".into()), Arc::clone(&metrics));
        line.status = Some(200);
        (follow(Response::new(body), line, no_trailers), metrics)
    }

    fn requests(metrics: &Metrics) -> Vec<String> {
        let text = String::from_utf8(metrics.render(&crate::metrics::QueueLevels::default())).unwrap();
        text.lines()
            .filter(|line| line.starts_with("slipdrive_http_request_duration_seconds_count"))
            .map(str::to_owned)
            .collect()
    }

    #[tokio::test]
    async fn request_counts_when_its_body_has_been_read() {
        let (answer, metrics) = response(Body::from("text"));
        assert_eq!(answer.body().size_hint().exact(), Some(4), "the length is still known");
        assert!(requests(&metrics).is_empty());
        assert_eq!(answer.into_body().collect().await.unwrap().to_bytes(), "text");
        assert_eq!(requests(&metrics).len(), 1);
        assert!(requests(&metrics)[0].contains("code=\"200\""));
    }

    #[tokio::test]
    async fn stream_that_is_dropped_half_way_counts_as_cancelled() {
        let pieces = stream::iter([Ok::<_, std::io::Error>("first"), Ok("second")]);
        let (answer, metrics) = response(Body::from_stream(pieces));
        let mut body = answer.into_body();
        assert!(body.frame().await.is_some());
        drop(body);
        assert!(requests(&metrics)[0].contains("code=\"499\""));
    }
}
