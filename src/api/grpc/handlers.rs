//! One method per call.
//!
//! What comes before the message is read is decided in [`super::admission`]; here come syntax, values and deadline.

use std::sync::Arc;

use futures_util::future::BoxFuture;
use futures_util::stream::{BoxStream, StreamExt as _, TryStreamExt as _};
use tonic::{Request, Response, Status, Streaming};

use super::admission::Call;
use super::batch::{answers, batch};
use super::pb::batch_request::Request as Item;
use super::pb::batch_response::Answer as ItemAnswer;
use super::pb::maneuver_service_server::ManeuverService;
use super::pb::solve_stream_response::Event as SolveEvent;
use super::{pb, status};
use crate::api::batch::ItemResult;
use crate::api::receive::memory_full;
use crate::api::server::Lease;
use crate::api::submit::{Caller, Entry, Written, answer_of_item, start};
use crate::api::{ApiState, CAUSE_IS_LOGGED};
use crate::contract::convert::count;
use crate::contract::{ErrorCode, Problem};
use crate::jobs::solve::{Solve, validated};
use crate::jobs::{Kind, limits_message};
use crate::service::{Event, Job, Running};

/// Length of a number in an answer, bytes.
const NUMBER_BYTES: usize = size_of::<f64>();

/// The calls of one server.
pub(super) struct Handlers(pub(super) ApiState);

type Answers<T> = BoxStream<'static, Result<T, Status>>;

#[tonic::async_trait]
impl ManeuverService for Handlers {
    type BatchStream = Answers<pb::BatchResponse>;
    type SolveBatchStream = Answers<pb::SolveBatchResponse>;
    type SolveStreamStream = Answers<pb::SolveStreamResponse>;

    async fn solve(&self, request: Request<pb::SolveRequest>) -> Result<Response<pb::SolveResponse>, Status> {
        let answered = self.unary(&self.0.jobs.solve, request).await?;
        Ok(answered.map(|solution| pb::SolveResponse { solution: Some(solution) }))
    }

    async fn solve_stream(
        &self,
        request: Request<pb::SolveRequest>,
    ) -> Result<Response<Self::SolveStreamStream>, Status> {
        let (running, call, lease) = self.started(&self.0.jobs.solve, request).await?;
        // When the caller leaves, the server drops the stream, which stops the job.
        let events = running.events().map(move |event| {
            let event = match event {
                Event::Queued(position) => SolveEvent::Queued(pb::Queued { position: count(position) }),
                Event::Progress(progress) => SolveEvent::Progress(progress.into()),
                Event::Ended(Ok(solution)) => SolveEvent::Solution(solution),
                Event::Ended(Err(error)) => return Err(status::of_problem(&error.into(), &call.request_id)),
            };
            Ok(pb::SolveStreamResponse { event: Some(event) })
        });
        Ok(holding(Response::new(events.boxed()), lease))
    }

    async fn solve_batch(
        &self,
        request: Request<Streaming<pb::SolveBatchRequest>>,
    ) -> Result<Response<Self::SolveBatchStream>, Status> {
        let call = call_of(&request)?;
        let batch = batch(self.0.clone(), &call, request.into_inner(), answer_to);
        Ok(Response::new(answers(batch, call.request_id).map_ok(Into::into).boxed()))
    }

    async fn batch(
        &self,
        request: Request<Streaming<pb::BatchRequest>>,
    ) -> Result<Response<Self::BatchStream>, Status> {
        let call = call_of(&request)?;
        let batch = batch(self.0.clone(), &call, request.into_inner(), answer_to);
        Ok(Response::new(answers(batch, call.request_id).boxed()))
    }

    async fn simulate(&self, request: Request<pb::SimulateRequest>) -> Result<Response<pb::SimulateResponse>, Status> {
        self.unary(&self.0.jobs.simulate, request).await
    }

    async fn present(&self, request: Request<pb::PresentRequest>) -> Result<Response<pb::PresentResponse>, Status> {
        self.unary(&self.0.jobs.present, request).await
    }

    async fn export(&self, request: Request<pb::ExportRequest>) -> Result<Response<pb::ExportResponse>, Status> {
        self.unary(&self.0.jobs.export, request).await
    }

    async fn assess(&self, request: Request<pb::AssessRequest>) -> Result<Response<pb::AssessResponse>, Status> {
        self.unary(&self.0.jobs.assess, request).await
    }

    async fn validate(&self, request: Request<pb::SolveRequest>) -> Result<Response<pb::ValidateResponse>, Status> {
        let call = call_of(&request)?;
        let accepted = Solve::accept(request.into_inner(), self.0.jobs.limits());
        let accepted = accepted.map_err(|problem| status::of_problem(&problem, &call.request_id))?;
        Ok(Response::new(validated(accepted)))
    }

    async fn get_limits(
        &self,
        _request: Request<pb::GetLimitsRequest>,
    ) -> Result<Response<pb::GetLimitsResponse>, Status> {
        let ApiState { service, jobs, settings, .. } = &self.0;
        Ok(Response::new(limits_message(jobs, service.settings(), settings.batch_window.get())))
    }
}

/// The answer to one item of a batch, by its kind.
fn answer_to<'a>(
    state: &'a ApiState,
    item: Item,
    caller: (&'a Caller, Entry<'a>),
) -> BoxFuture<'a, ItemResult<ItemAnswer>> {
    let bytes = item.encoded_len();
    match item {
        Item::Solve(request) => of_kind(&state.jobs.solve, state, (request, bytes), caller, ItemAnswer::Solve),
        Item::Simulate(request) => of_kind(&state.jobs.simulate, state, (request, bytes), caller, ItemAnswer::Simulate),
        Item::Present(request) => of_kind(&state.jobs.present, state, (request, bytes), caller, ItemAnswer::Present),
        Item::Export(request) => of_kind(&state.jobs.export, state, (request, bytes), caller, ItemAnswer::Export),
        Item::Assess(request) => of_kind(&state.jobs.assess, state, (request, bytes), caller, ItemAnswer::Assess),
    }
}

fn of_kind<'a, K: Kind>(
    kind: &'a Arc<K>,
    state: &'a ApiState,
    (request, bytes): (K::Request, usize),
    (caller, entry): (&'a Caller, Entry<'a>),
    wrap: fn(K::Answer) -> ItemAnswer,
) -> BoxFuture<'a, ItemResult<ItemAnswer>> {
    Box::pin(async move {
        let input = (K::accept(request, state.jobs.limits())?, bytes);
        let (answer, lease) = answer_of_item(kind, state, input, (caller, entry, NUMBER_BYTES), measured).await?;
        Ok((wrap(answer), lease))
    })
}

/// A message with its length when it is encoded.
fn measured<M: prost::Message>(answer: M) -> Written<M> {
    Written { bytes: answer.encoded_len(), answer }
}

/// A job that was queued, its call, and the memory that is reserved for its answer.
type Started<K> = (Running<<K as Kind>::Answer, <K as Job>::Progress>, Call, Arc<Lease>);

impl Handlers {
    async fn started<K: Kind>(&self, kind: &Arc<K>, request: Request<K::Request>) -> Result<Started<K>, Status> {
        let call = call_of(&request)?;
        let started = async {
            let input = K::accept(request.into_inner(), self.0.jobs.limits())?;
            let bytes = K::answer_bytes(&input, NUMBER_BYTES);
            let lease = Arc::new(call.caller.connection.lease_soon(bytes).await.ok_or_else(memory_full)?);
            Ok((start(kind, call.take_permit()?, input, (&call.caller, &lease), measured)?, lease))
        };
        match started.await {
            Ok((running, lease)) => Ok((running, call, lease)),
            Err(problem) => Err(status::of_problem(&problem, &call.request_id)),
        }
    }

    /// When the caller leaves, the server drops this future, which stops the job.
    async fn unary<K: Kind>(&self, kind: &Arc<K>, request: Request<K::Request>) -> Result<Response<K::Answer>, Status> {
        let (running, call, lease) = self.started(kind, request).await?;
        let answer = running.outcome().await.map_err(|error| status::of_problem(&error.into(), &call.request_id))?;
        Ok(holding(Response::new(answer), lease))
    }
}

/// The answer, which holds the lease until it is taken.
fn holding<T>(mut response: Response<T>, lease: Arc<Lease>) -> Response<T> {
    response.extensions_mut().insert(lease);
    response
}

/// The call's id, deadline and permit, as its admission left them.
fn call_of<T>(request: &Request<T>) -> Result<Call, Status> {
    let call = request.extensions().get::<Call>().cloned();
    call.ok_or_else(|| status::of_problem(&Problem::new(ErrorCode::Internal, CAUSE_IS_LOGGED), ""))
}
