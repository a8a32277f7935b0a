//! One method per call.
//!
//! What comes before the message is read is decided in [`super::admission`]; here come syntax, values and deadline.

use std::pin::Pin;

use futures_util::stream::{Stream, unfold};
use tonic::{Request, Response, Status, Streaming};

use super::admission::Call;
use super::batch::Batch;
use super::pb::maneuver_service_server::ManeuverService;
use super::pb::solve_stream_response::Event;
use super::{convert_request, convert_response, pb, status};
use crate::api::Door;
use crate::api::error_table::ErrorCode;
use crate::api::message::accept::{AcceptedSolve, accept_simulate, accept_solve};
use crate::api::message::answer::{simulate_message, solve_message};
use crate::api::message::limits::LimitsMessage;
use crate::api::message::response::ProgressEvent;
use crate::api::problem::Problem;
use crate::service::{Place, RunningSolve, Simulated, SolveClocks, SolveEvent};

/// The calls over one service.
pub(super) struct Handlers(pub(super) Door);

impl Door {
    /// The message, completed and checked.
    pub(super) fn accept(&self, message: pb::SolveRequest) -> Result<AcceptedSolve, Problem> {
        accept_solve(convert_request::solve(message)?, self.service.limits())
    }
}

/// Queues an accepted solve; its answer is written on the worker.
pub(super) fn start(place: Place, accepted: AcceptedSolve, call: &Call) -> Result<RunningSolve<pb::Solution>, Problem> {
    let clocks = SolveClocks { time_limit: accepted.time_limit, deadline: call.deadline };
    let notes = call.notes.clone();
    let running = place.start_solve(accepted.input.clone(), clocks, move |solved| {
        notes.job(solved.queue_wait, solved.solve_time);
        convert_response::solution(solve_message(&accepted, &solved))
    });
    Ok(running?)
}

/// The call's id, deadline and place, as its admission left them.
fn call_of<T>(request: &Request<T>) -> Result<Call, Status> {
    let call = request.extensions().get::<Call>().cloned();
    call.ok_or_else(|| status::of_problem(&Problem::new(ErrorCode::Internal, "the log holds the cause"), ""))
}

#[tonic::async_trait]
impl ManeuverService for Handlers {
    /// When the caller leaves, the server drops this future, which stops the solve.
    async fn solve(&self, request: Request<pb::SolveRequest>) -> Result<Response<pb::SolveResponse>, Status> {
        let call = call_of(&request)?;
        let solution = async {
            let accepted = self.0.accept(request.into_inner())?;
            Ok(start(call.take_place()?, accepted, &call)?.outcome().await?)
        };
        let solution = solution.await.map_err(|problem| status::of_problem(&problem, &call.request_id))?;
        Ok(Response::new(pb::SolveResponse { solution: Some(solution) }))
    }

    type SolveStreamStream = Pin<Box<dyn Stream<Item = Result<pb::SolveStreamResponse, Status>> + Send>>;

    /// When the caller leaves, the server drops the stream, which stops the solve.
    async fn solve_stream(
        &self,
        request: Request<pb::SolveStreamRequest>,
    ) -> Result<Response<Self::SolveStreamStream>, Status> {
        let call = call_of(&request)?;
        let started = || {
            let accepted = self.0.accept(request.into_inner().into())?;
            start(call.take_place()?, accepted, &call)
        };
        let running = started().map_err(|problem| status::of_problem(&problem, &call.request_id))?;
        Ok(Response::new(Box::pin(events_of(running, call.request_id))))
    }

    type SolveBatchStream = Pin<Box<dyn Stream<Item = Result<pb::SolveBatchResponse, Status>> + Send>>;

    async fn solve_batch(
        &self,
        request: Request<Streaming<pb::SolveBatchRequest>>,
    ) -> Result<Response<Self::SolveBatchStream>, Status> {
        let call = call_of(&request)?;
        let batch = Batch::new(self.0.clone(), call, request.into_inner());
        Ok(Response::new(Box::pin(batch.into_answers())))
    }

    async fn simulate(&self, request: Request<pb::SimulateRequest>) -> Result<Response<pb::SimulateResponse>, Status> {
        let call = call_of(&request)?;
        let simulation = async {
            let input = accept_simulate(convert_request::simulate(request.into_inner())?, self.0.service.limits())?;
            let notes = call.notes.clone();
            let write = move |simulated: Simulated| {
                notes.job(simulated.queue_wait, simulated.duration);
                convert_response::simulation(simulate_message(&simulated))
            };
            Ok(call.take_place()?.simulate(input, call.deadline, write).await?)
        };
        let simulation: Result<_, Problem> = simulation.await;
        simulation.map(Response::new).map_err(|problem| status::of_problem(&problem, &call.request_id))
    }

    async fn validate(&self, request: Request<pb::ValidateRequest>) -> Result<Response<pb::ValidateResponse>, Status> {
        let call = call_of(&request)?;
        let accepted = self.0.accept(request.into_inner().into());
        let accepted = accepted.map_err(|problem| status::of_problem(&problem, &call.request_id))?;
        Ok(Response::new(convert_response::validated(accepted)))
    }

    async fn get_limits(
        &self,
        _request: Request<pb::GetLimitsRequest>,
    ) -> Result<Response<pb::GetLimitsResponse>, Status> {
        let Door { service, settings } = &self.0;
        let message = LimitsMessage::new(service.settings(), settings.batch_window.get());
        Ok(Response::new(convert_response::limits(message)))
    }
}

/// What is to be told next of a streamed solve.
enum Stage {
    Queued(RunningSolve<pb::Solution>),
    Running(RunningSolve<pb::Solution>),
    Ended,
}

fn events_of(
    running: RunningSolve<pb::Solution>,
    request_id: String,
) -> impl Stream<Item = Result<pb::SolveStreamResponse, Status>> + Send {
    unfold((Stage::Queued(running), request_id), |(stage, request_id)| async move {
        let (event, stage) = match stage {
            Stage::Queued(running) => {
                (Ok(Event::Queued(convert_response::queued(running.position()))), Stage::Running(running))
            }
            Stage::Running(mut running) => match running.next_event().await {
                SolveEvent::Progress(progress) => {
                    let progress = convert_response::progress(&ProgressEvent::from(progress));
                    (Ok(Event::Progress(progress)), Stage::Running(running))
                }
                SolveEvent::Ended(Ok(solution)) => (Ok(Event::Solution(solution)), Stage::Ended),
                SolveEvent::Ended(Err(error)) => {
                    (Err(status::of_problem(&Problem::from(error), &request_id)), Stage::Ended)
                }
            },
            Stage::Ended => return None,
        };
        let response = event.map(|event| pb::SolveStreamResponse { event: Some(event) });
        Some((response, (stage, request_id)))
    })
}
