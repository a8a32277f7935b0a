//! The one list of endpoints: the router, the counts and the OpenAPI document are made from it.

use std::sync::Arc;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use axum::routing::{MethodRouter, get, post};
use utoipa::ToSchema as _;

use super::batch::{self, Kinds};
use super::document::Document;
use super::handlers::{self, Delivery};
use super::operation::{Access, Answer, Job, Operation, Request};
use super::{openapi, page};
use crate::api::{ApiState, Probes};
use crate::contract::message::{GetLimitsResponse, SolveRequest, ValidateResponse};
use crate::contract::{ErrorCode, json};
use crate::jobs::{Example, Kind, Visitor};

/// One endpoint.
pub(super) struct Endpoint {
    pub(super) path: String,
    pub(super) access: Access,
    pub(super) handler: MethodRouter<ApiState>,
    /// What the document says of it; the document and the pages are not described.
    pub(super) operation: Option<Operation>,
}

impl Endpoint {
    fn get(path: &str, handler: MethodRouter<ApiState>, summary: &str, answer: Answer) -> Self {
        let id = path.trim_start_matches('/').replace(['/', '-'], "_");
        let operation =
            Operation { id, summary: summary.to_owned(), request: None, answer, has_events: false, errors: Vec::new() };
        Self { path: path.to_owned(), access: Access::WithKey, handler, operation: Some(operation) }
    }

    fn post(path: String, handler: MethodRouter<ApiState>, operation: Operation) -> Self {
        Self { path, access: Access::WithKey, handler, operation: Some(operation) }
    }

    fn probe(path: &str, handler: MethodRouter<ApiState>, summary: &str, answer: Answer, errors: &[ErrorCode]) -> Self {
        let endpoint = Self::get(path, handler, summary, answer);
        let operation = endpoint.operation.map(|operation| Operation { errors: errors.to_vec(), ..operation });
        Self { access: Access::Probe, operation, ..endpoint }
    }
}

fn undescribed(path: &str, handler: MethodRouter<ApiState>) -> Endpoint {
    Endpoint { path: path.to_owned(), access: Access::Open, handler, operation: None }
}

/// All endpoints of a server, on whatever port.
pub(super) fn endpoints(state: &ApiState) -> Vec<Endpoint> {
    let mut of_jobs = OfJobs { endpoints: Vec::new(), jobs: Vec::new() };
    state.jobs.each(&mut of_jobs);
    let batch = batch(Arc::new(Kinds::of(&state.jobs)), of_jobs.jobs);
    let pages = page::files()
        .iter()
        .map(|(path, file)| undescribed(path, get(move |asked: HeaderMap| async move { file.answer(&asked) })));
    of_jobs.endpoints.into_iter().chain([batch]).chain(beside_jobs()).chain(pages).collect()
}

/// `GET /openapi.json`: this API for machines.
async fn document(State(state): State<ApiState>, asked: HeaderMap) -> Response {
    let document = state.documents.openapi.get_or_init(|| {
        let with_probes = state.settings.probes == Probes::WithApi;
        let served = endpoints(&state).into_iter().filter(|endpoint| with_probes || endpoint.access != Access::Probe);
        let described = served.filter_map(|Endpoint { path, access, operation, .. }| Some((path, access, operation?)));
        Document::new("application/json", openapi::document(&state, described))
    });
    document.answer(&asked)
}

/// Jobs of all kinds together.
fn batch(kinds: Arc<Kinds>, jobs: Vec<Job>) -> Endpoint {
    let operation = Operation {
        id: "batch".to_owned(),
        summary: "answers many jobs of any kind, each as it ends".to_owned(),
        request: Some(Request::Lines(jobs.clone())),
        answer: Answer::Lines(jobs),
        has_events: false,
        errors: Vec::new(),
    };
    let handler = post(move |state, context, request| batch::run(Arc::clone(&kinds), state, context, request));
    Endpoint::post("/batch".to_owned(), handler, operation)
}

fn beside_jobs() -> [Endpoint; 6] {
    let validate = Operation {
        id: "validate".to_owned(),
        summary: "checks and completes a maneuver".to_owned(),
        request: Some(Request::Immediate(SolveRequest::name())),
        answer: Answer::Json(ValidateResponse::name()),
        has_events: false,
        errors: Vec::new(),
    };
    let about_limits = Answer::Json(GetLimitsResponse::name());
    let limits = Endpoint::get("/limits", get(handlers::limits), "what this server accepts at most", about_limits);
    let unavailable = [ErrorCode::Unavailable];
    [
        Endpoint::post("/validate".to_owned(), post(handlers::validate), validate),
        Endpoint { access: Access::Open, ..limits },
        undescribed("/openapi.json", get(document)),
        Endpoint::probe(
            "/livez",
            get(handlers::livez),
            "whether the process lives",
            Answer::Object("it does"),
            &unavailable,
        ),
        Endpoint::probe(
            "/readyz",
            get(handlers::readyz),
            "whether new callers are welcome",
            Answer::Object("they are"),
            &unavailable,
        ),
        Endpoint::probe(
            "/metrics",
            get(handlers::metrics),
            "counts and levels in the text format of Prometheus",
            Answer::Text("families with their samples"),
            &[],
        ),
    ]
}

/// The endpoints of the kinds of jobs, and what lines say of them.
struct OfJobs {
    endpoints: Vec<Endpoint>,
    jobs: Vec<Job>,
}

impl Visitor for OfJobs {
    fn visit<K: Kind>(&mut self, kind: &Arc<K>) {
        let handler = |delivery| {
            let kind = Arc::clone(kind);
            post(move |state, context, request| handlers::run(kind, delivery, state, context, request))
        };
        let operation = |id: String, summary: String, answer| {
            let request = Some(Request::Queued(K::Request::name()));
            Operation { id, summary, request, answer, has_events: false, errors: Vec::new() }
        };
        self.jobs.push(Job { name: K::NAME, request: K::Request::name(), answer: K::Answer::name() });
        let answer = Answer::Json(K::Answer::name());
        let path = format!("/{}", K::NAME);
        if K::REPORTS_PROGRESS {
            let events = Answer::Events { progress: K::Report::name(), result: K::Answer::name() };
            let summary = format!("{} and reports progress as server-sent events", K::SUMMARY);
            let operation = operation(format!("{}_events", K::NAME), summary, events);
            self.endpoints.push(Endpoint::post(format!("{path}/events"), handler(Delivery::Events), operation));
        }
        let operation = operation(K::NAME.to_owned(), K::SUMMARY.to_owned(), answer);
        let operation = Operation { has_events: K::REPORTS_PROGRESS, ..operation };
        self.endpoints.push(Endpoint::post(path, handler(Delivery::AsAccepted), operation));
        for Example { name, request, .. } in K::EXAMPLES {
            let body = move |asked: HeaderMap| async move { handlers::json_answer(json::write(&request()), &asked) };
            let summary = format!("an example of a complete body for `/{}`", K::NAME);
            let answer = Answer::Json(K::Request::name());
            self.endpoints.push(Endpoint::get(&format!("/examples/{name}"), get(body), &summary, answer));
        }
    }
}
