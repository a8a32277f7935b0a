//! Solves a maneuver over gRPC and shows its progress: `cargo run --example grpc_client [http://127.0.0.1:50051]`.

use std::time::Duration;

use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use slipdrive::api::grpc::pb::solve_stream_response::Event;
use slipdrive::api::grpc::pb::{Goal, Maneuver, SolveStreamRequest, View};
use tonic::Request;
use tonic::transport::Endpoint;

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let address = std::env::args().nth(1).unwrap_or_else(|| "http://127.0.0.1:50051".to_owned());
    let mut client = ManeuverServiceClient::new(Endpoint::from_shared(address)?.connect().await?);
    let goal = Goal { y_m: Some(5.0), ..Goal::default() };
    let mut request = Request::new(SolveStreamRequest {
        maneuver: Some(Maneuver { goal: Some(goal), ..Maneuver::default() }),
        view: View::Plan.into(),
        ..SolveStreamRequest::default()
    });
    // Waiting included; near it the best plan so far is answered.
    request.set_timeout(Duration::from_secs(10));
    let mut events = client.solve_stream(request).await?.into_inner();
    while let Some(response) = events.message().await? {
        match response.event {
            Some(Event::Queued(queued)) => println!("queued at {}", queued.position),
            Some(Event::Progress(progress)) => println!(
                "start {} of {}: {:.3} s, goal missed by {:.1e}",
                progress.start, progress.start_count, progress.best_final_time_s, progress.best_goal_error
            ),
            Some(Event::Solution(plan)) => println!("{}: {:.3} s", plan.status().as_str_name(), plan.final_time_s),
            // A newer server may tell more.
            None => {}
        }
    }
    Ok(())
}
