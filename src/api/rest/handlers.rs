//! One handler per endpoint.
//!
//! The checks come in the order of the contract: readiness, size and type, queue room, syntax, values.

use axum::Extension;
use axum::body::Bytes;
use axum::extract::{Request, State};
use axum::http::header;
use axum::response::{IntoResponse, Response};

use super::events;
use super::extract::{deadline, receive};
use crate::api::Door;
use crate::api::access::RequestContext;
use crate::api::message::accept::{forward_drive_body, read_simulate, read_solve};
use crate::api::message::answer::{limits_answer, simulate_answer, solve_answer, validate_answer};
use crate::api::message::limits::LimitsMessage;
use crate::api::problem::Problem;
use crate::service::{SolveClocks, Solved};

/// `POST /solve`. When the caller leaves, the server drops this future or the event stream, which stops the solve.
pub(super) async fn solve(
    State(door): State<Door>,
    Extension(context): Extension<RequestContext>,
    request: Request,
) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let body = receive(&door, &head, body).await?;
    let place = door.service.reserve()?;
    let accepted = read_solve(&body, door.service.limits())?;
    let clocks = SolveClocks { time_limit: accepted.time_limit, deadline: deadline(&head.headers, context.arrival)? };
    let running = place.start_solve(accepted.input.clone(), clocks, move |solved| {
        log_solved(&solved);
        solve_answer(&accepted, &solved)
    })?;
    if events::are_accepted(&head.headers) {
        return Ok(events::respond(running, context));
    }
    Ok(json(running.outcome().await?))
}

fn log_solved(solved: &Solved) {
    let (report, time) = (&solved.solution.report, solved.solve_time);
    tracing::debug!(
        solution.status = solved.solution.status.as_str(),
        solve.stop_reason = solved.stop_reason.as_str(),
        solve.rollouts = report.rollouts,
        solve.duration_ms = time.as_secs_f64() * 1e3,
        "solved"
    );
}

/// `POST /simulate`.
pub(super) async fn simulate(
    State(door): State<Door>,
    Extension(context): Extension<RequestContext>,
    request: Request,
) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let body = receive(&door, &head, body).await?;
    let place = door.service.reserve()?;
    let input = read_simulate(&body, door.service.limits())?;
    let deadline = deadline(&head.headers, context.arrival)?;
    Ok(json(place.simulate(input, deadline, |simulated| simulate_answer(&simulated)).await?))
}

/// `POST /validate`: nothing is queued.
pub(super) async fn validate(State(door): State<Door>, request: Request) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let body = receive(&door, &head, body).await?;
    let accepted = read_solve(&body, door.service.limits())?;
    Ok(json(validate_answer(&accepted)))
}

/// `GET /limits`: what this server accepts at most.
pub(super) async fn limits(State(door): State<Door>) -> Response {
    let message = LimitsMessage::new(door.service.settings(), door.settings.batch_window.get());
    json(limits_answer(&message))
}

/// `GET /examples/forward-drive`: a complete body for `/solve`.
pub(super) async fn forward_drive() -> Response {
    json(forward_drive_body())
}

/// `GET /openapi.json`: this API for machines.
pub(super) fn openapi(document: Bytes) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], document).into_response()
}

/// `GET /docs`: this API for people. The page loads nothing but `/openapi.json`.
pub(super) async fn docs() -> Response {
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (
            header::CONTENT_SECURITY_POLICY,
            "default-src 'none'; connect-src 'self'; style-src 'unsafe-inline'; script-src 'unsafe-inline'",
        ),
    ];
    (headers, include_str!("docs.html")).into_response()
}

/// `GET /livez`: the process answers, and a worker is there to end its job.
pub(super) async fn livez(State(door): State<Door>) -> Result<Response, Problem> {
    door.service.check_alive()?;
    Ok(json(br#"{"status":"live"}"#.to_vec()))
}

/// `GET /readyz`: the service takes work; a full queue is ready too.
pub(super) async fn readyz(State(door): State<Door>) -> Result<Response, Problem> {
    door.service.check_ready()?;
    Ok(json(br#"{"status":"ready"}"#.to_vec()))
}

fn json(body: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], body).into_response()
}
