//! A body that comes back where it is not read to its end: a connection that is closed with unread bytes is reset, and the caller never
//! sees why it was refused.

use std::mem;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::Request;
use axum::http::header;
use hyper::body::{Frame, SizeHint};

use crate::api::receive::discard;

/// Where the body comes back to.
pub(super) struct Lender {
    back: Arc<Mutex<Option<Body>>>,
}

struct LentBody {
    body: Body,
    /// Whether its caller sends it without being asked.
    is_sent: bool,
    back: Arc<Mutex<Option<Body>>>,
}

/// The request, with its body to be taken back.
pub(super) fn lend(request: Request) -> (Request, Lender) {
    let back = Arc::<Mutex<Option<Body>>>::default();
    // A caller who waits for `100 Continue` has sent nothing yet.
    let is_sent = !request.headers().contains_key(header::EXPECT);
    let lent = request.map(|body| Body::new(LentBody { body, is_sent, back: Arc::clone(&back) }));
    (lent, Lender { back })
}

impl Lender {
    /// Reads on for a moment what of the body nobody reads any more.
    pub(super) async fn discard_rest(self) {
        let rest = self.back.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(mut rest) = rest {
            discard(&mut rest).await;
        }
    }
}

impl HttpBody for LentBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        self.is_sent = true;
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for LentBody {
    fn drop(&mut self) {
        if self.is_sent && !self.body.is_end_stream() {
            *self.back.lock().unwrap_or_else(PoisonError::into_inner) = Some(mem::take(&mut self.body));
        }
    }
}
