//! The caller over gRPC.

use anyhow::{Context as _, Result, ensure};
use prost::Message as _;
use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use slipdrive::api::grpc::pb::{
    ContactSolver, SimulateGrid, SimulateRequest, SolveRequest, SolveResponse, StopReason, TorqueSchedule,
};
use tonic::transport::{Channel, Endpoint};

use super::requests::{COASTING_S, COASTING_STEPS, Request};
use crate::values::digest;

/// Asks over gRPC.
pub(super) struct GrpcCaller(ManeuverServiceClient<Channel>);

impl GrpcCaller {
    pub(super) async fn connect(address: String) -> Result<Self> {
        let channel = Endpoint::from_shared(address)?.connect().await?;
        Ok(Self(ManeuverServiceClient::new(channel)))
    }

    /// Asks for a plan and for the motion under its torques: the digests of both.
    pub(super) async fn ask(&self, request: &Request) -> Result<[String; 2]> {
        let mut client = self.0.clone();
        let asked: SolveRequest = serde_json::from_value(request.body.clone())?;
        let plan = client.solve(asked.clone()).await?.into_inner();
        let motion = client.simulate(motion_of(request, asked, &plan)?).await?.into_inner();
        Ok([digest(comparable(plan)?.encode_to_vec()), digest(motion.encode_to_vec())])
    }
}

/// An answer without what differs between equal answers: wall time, and the version that a release changes.
fn comparable(mut answer: SolveResponse) -> Result<SolveResponse> {
    let plan = answer.solution.as_mut().context("no solution")?;
    let is_out_of_time = matches!(plan.stop_reason(), StopReason::TimeLimit | StopReason::Deadline);
    ensure!(!is_out_of_time, "gRPC: stopped by wall time");
    plan.solver_version.clear();
    plan.report.as_mut().context("no report")?.solve_time_s = 0.0;
    Ok(answer)
}

/// The request of the motion under a plan's torques.
fn motion_of(request: &Request, asked: SolveRequest, answer: &SolveResponse) -> Result<SimulateRequest> {
    let plan = answer.solution.as_ref().context("no solution")?;
    let schedule = plan.torque_schedule.clone().context("no torques")?;
    let coasting = TorqueSchedule { interval_s: Some(COASTING_S), left_n_m: vec![0.0], right_n_m: vec![0.0] };
    let steps = plan.report.as_ref().context("no report")?.steps;
    let (schedule, steps) = if schedule.left_n_m.is_empty() { (coasting, COASTING_STEPS) } else { (schedule, steps) };
    let maneuver = asked.maneuver.unwrap_or_default();
    let contact_solver = request.fixed_point_steps.map_or(ContactSolver::Unspecified, |_| ContactSolver::FixedPoint);
    Ok(SimulateRequest {
        robot: asked.robot,
        payload: asked.payload,
        reference_point: maneuver.reference_point,
        start: maneuver.start,
        torque_schedule: Some(schedule),
        grid: Some(SimulateGrid { steps: Some(request.fixed_point_steps.unwrap_or(steps)) }),
        contact_solver: contact_solver.into(),
        ..SimulateRequest::default()
    })
}
