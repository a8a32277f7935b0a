//! Streams that belong to no job, watches of the health and reflection, end when no more work is taken: nobody waits for them.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use axum::Error;
use axum::body::{Body, Bytes, HttpBody};
use axum::http::HeaderMap;
use hyper::body::{Frame, SizeHint};
use tonic::Status;

use crate::api::server::Connection;

/// A body until then.
pub(super) struct UntilClosing {
    body: Body,
    closing: Pin<Box<dyn Future<Output = ()> + Send>>,
    has_ended: bool,
}

impl UntilClosing {
    pub(super) fn of(body: Body, connection: Arc<Connection>) -> Self {
        Self { body, closing: Box::pin(connection.closing()), has_ended: false }
    }
}

impl HttpBody for UntilClosing {
    type Data = Bytes;
    type Error = Error;

    fn poll_frame(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Error>>> {
        if self.has_ended {
            return Poll::Ready(None);
        }
        // What is ready is still said: that nothing is served any more.
        if let Poll::Ready(frame) = Pin::new(&mut self.body).poll_frame(context) {
            return Poll::Ready(frame);
        }
        self.closing.as_mut().poll(context).map(|()| {
            self.has_ended = true;
            let mut trailers = HeaderMap::new();
            let ended = Status::unavailable("the server is shutting down").add_header(&mut trailers);
            Some(ended.map(|()| Frame::trailers(trailers)).map_err(Error::new))
        })
    }

    fn is_end_stream(&self) -> bool {
        self.has_ended || self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
