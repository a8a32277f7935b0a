//! One handler per endpoint.
//!
//! The checks come in the order of the contract: readiness, size and type, a place in the queue, syntax, values.

use std::sync::Arc;

use axum::Extension;
use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::response::Response;

use super::coding::{Coded, Coding};
use super::document::Document;
use super::events;
use super::extract::{JSON, deadline, json_body};
use crate::api::ApiState;
use crate::api::access::RequestContext;
use crate::api::auth::Credential;
use crate::api::receive::{connection_of, memory_full};
use crate::api::submit::{Caller, Written, start};
use crate::contract::{Problem, json};
use crate::jobs::solve::{Solve, validated};
use crate::jobs::{Kind, limits_message};
use crate::metrics::CONTENT_TYPE;

/// Length of a number in a full answer with the comma after it, bytes: the mean over plans; the rest is settled when the
/// answer is written.
pub(super) const NUMBER_BYTES: usize = 18;

/// How the outcome of a job is delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Delivery {
    /// As server-sent events where the caller accepts them, else as one answer.
    AsAccepted,
    /// As server-sent events.
    Events,
}

/// `POST` to the route of a kind of job. When the caller leaves, the server drops this future or the event stream, which
/// stops the job.
pub(super) async fn run<K: Kind>(
    kind: Arc<K>,
    delivery: Delivery,
    State(state): State<ApiState>,
    (Extension(context), Extension(credential)): (Extension<RequestContext>, Extension<Credential>),
    request: Request,
) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let limit = K::body_limit(state.jobs.limits());
    let (body, of_body) = json_body(&state, &head, body, limit).await?;
    let permit = state.service.reserve_in(credential.share(), K::CLASS)?;
    let input = K::read(&body, state.jobs.limits())?;
    drop((body, of_body));
    let connection = connection_of(&head.extensions);
    let lease = connection.lease_soon(K::answer_bytes(&input, NUMBER_BYTES)).await.ok_or_else(memory_full)?;
    let lease = Arc::new(lease);
    let deadline = deadline(&head.headers, context.arrival)?;
    let caller = Caller { notes: context.notes.clone(), deadline, connection, credential };
    let has_events = delivery == Delivery::Events || K::REPORTS_PROGRESS && events::are_accepted(&head.headers);
    let coding = if has_events { Coding::Identity } else { Coding::accepted(&head.headers) };
    let running = start(&kind, permit, input, (&caller, &lease), move |answer| {
        let answer = Coded::new(json::write(&answer), coding);
        Written { bytes: answer.bytes.len(), answer }
    })?;
    let mut response =
        if has_events { events::respond::<K, _>(running, context) } else { running.outcome().await?.respond(JSON) };
    response.extensions_mut().insert(lease);
    Ok(response)
}

/// `POST /validate`: nothing is queued.
pub(super) async fn validate(State(state): State<ApiState>, request: Request) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let limit = Solve::body_limit(state.jobs.limits());
    let (body, _lease) = json_body(&state, &head, body, limit).await?;
    let accepted = Solve::read(&body, state.jobs.limits())?;
    Ok(json_answer(json::write(&validated(accepted)), &head.headers))
}

/// `GET /limits`: what this server accepts at most.
pub(super) async fn limits(State(state): State<ApiState>, asked: HeaderMap) -> Response {
    let limits = state.documents.limits.get_or_init(|| {
        let limits = limits_message(&state.jobs, state.service.settings(), state.settings.batch_window.get());
        Document::new("application/json", json::write(&limits))
    });
    limits.answer(&asked)
}

/// `GET /livez`: the process answers, and a worker is there to end its job.
pub(super) async fn livez(State(state): State<ApiState>) -> Result<Response, Problem> {
    state.service.check_alive()?;
    Ok(json_answer(br#"{"status":"live"}"#.to_vec(), &HeaderMap::new()))
}

/// `GET /readyz`: the service takes work; a full queue is ready too.
pub(super) async fn readyz(State(state): State<ApiState>) -> Result<Response, Problem> {
    state.service.check_ready()?;
    Ok(json_answer(br#"{"status":"ready"}"#.to_vec(), &HeaderMap::new()))
}

/// `GET /metrics`: counts and levels in the text format of Prometheus.
pub(super) async fn metrics(State(state): State<ApiState>, asked: HeaderMap) -> Response {
    Coded::new(state.service.metrics_text(), Coding::accepted(&asked)).respond(CONTENT_TYPE)
}

pub(super) fn json_answer(body: Vec<u8>, asked: &HeaderMap) -> Response {
    Coded::new(body, Coding::accepted(asked)).respond(JSON)
}
