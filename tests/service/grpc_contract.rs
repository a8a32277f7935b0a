//! What callers of gRPC get, over real sockets.

use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::{StreamExt as _, stream};
use slipdrive::api::grpc::pb;
use slipdrive::api::grpc::pb::solve_batch_response::Answer;
use slipdrive::api::grpc::pb::solve_stream_response::Event;
use slipdrive::solver::{RunControl, StopReason};
use slipdrive::solver::{SolveInput, SolveProgress};
use tokio::sync::mpsc::unbounded_channel;
use tokio::time::timeout;
use tonic::Code;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use crate::support::protobuf::{code_of, fields_of, refusal, solved_by};
use crate::support::{FakeSolver, Gate, HANG_BOUND, TestServer, held_solver, instant_solver, small_solution};

fn spin_until_stopped(control: &RunControl<'_>) {
    while !control.is_stopped() {
        std::thread::yield_now();
    }
}

fn seeded(seed: u64) -> pb::SolveRequest {
    let solver = pb::Solver { seed, time_limit_s: Some(60.0), ..pb::Solver::default() };
    pb::SolveRequest { solver: Some(solver), ..pb::SolveRequest::default() }
}

fn item(request_id: &str, seed: u64) -> pb::SolveBatchRequest {
    let solver = seeded(seed).solver;
    pb::SolveBatchRequest { request_id: request_id.to_owned(), solver, ..pb::SolveBatchRequest::default() }
}

#[tokio::test]
async fn streamed_solve_tells_queued_then_progress_then_the_solution() {
    let gate = Arc::new(Gate::default());
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |_: &SolveInput, control: &RunControl<'_>| {
        control.report(&SolveProgress { best_final_time: 2.5, best_goal_error: 0.5, start: 1, start_count: 8 });
        held.wait();
        small_solution(StopReason::Finished)
    });
    let server = TestServer::start(4, Arc::new(solver)).await;
    let request = pb::SolveStreamRequest::default();
    let mut events = server.grpc().await.solve_stream(request).await.unwrap().into_inner();
    let mut next = async || timeout(HANG_BOUND, events.message()).await.unwrap().unwrap().and_then(|next| next.event);
    assert_eq!(next().await, Some(Event::Queued(pb::Queued { position: 0 })));
    let phase = pb::SearchPhase::Start.into();
    let progress = pb::Progress { best_final_time_s: 2.5, best_goal_error: 0.5, start: 1, start_count: 8, phase };
    assert_eq!(next().await, Some(Event::Progress(progress)));
    gate.open();
    let Some(Event::Solution(solution)) = next().await else { panic!("the solution is last") };
    assert_eq!(solution.final_time_s, 1.5);
    assert_eq!(next().await, None);
}

#[tokio::test]
async fn deadline_of_a_call_ends_the_solve_with_its_best_plan() {
    let solver = FakeSolver(|_: &SolveInput, control: &RunControl<'_>| {
        spin_until_stopped(control);
        small_solution(StopReason::Stopped)
    });
    let server = TestServer::start(4, Arc::new(solver)).await;
    let solution = solved_by(&server, &seeded(1), Duration::from_millis(200)).await;
    assert_eq!(solution.stop_reason(), pb::StopReason::Deadline);
}

#[tokio::test]
async fn dropped_calls_and_streams_stop_their_solves() {
    let begin = Instant::now();
    let (started, mut has_started) = unbounded_channel();
    let (stopped, mut has_stopped) = unbounded_channel();
    let solver = FakeSolver(move |input: &SolveInput, control: &RunControl<'_>| {
        started.send(input.settings.seed).unwrap();
        spin_until_stopped(control);
        // The time limit is 60 s: only the departure comes before that.
        stopped.send(input.settings.seed).unwrap();
        small_solution(StopReason::Stopped)
    });
    let server = TestServer::start(4, Arc::new(solver)).await;
    let mut unary = server.grpc().await;
    // The connection stays: only the stream of the call is reset.
    let call = tokio::spawn({
        let mut client = unary.clone();
        async move { client.solve(seeded(1)).await }
    });
    assert_eq!(timeout(HANG_BOUND, has_started.recv()).await.unwrap(), Some(1));
    call.abort();
    assert_eq!(timeout(HANG_BOUND, has_stopped.recv()).await.unwrap(), Some(1));

    let request = pb::SolveStreamRequest { solver: seeded(2).solver, ..pb::SolveStreamRequest::default() };
    let mut events = unary.solve_stream(request).await.unwrap().into_inner();
    assert!(events.message().await.unwrap().is_some());
    assert_eq!(timeout(HANG_BOUND, has_started.recv()).await.unwrap(), Some(2));
    drop(events);
    assert_eq!(timeout(HANG_BOUND, has_stopped.recv()).await.unwrap(), Some(2));

    let (items, sent) = unbounded_channel();
    items.send(item("only", 3)).unwrap();
    let sent = stream::unfold(sent, async |mut sent| sent.recv().await.map(|item| (item, sent)));
    let answers = unary.solve_batch(sent).await.unwrap().into_inner();
    assert_eq!(timeout(HANG_BOUND, has_started.recv()).await.unwrap(), Some(3));
    // The client library resets the stream once both directions are dropped.
    drop((answers, items));
    assert_eq!(timeout(HANG_BOUND, has_stopped.recv()).await.unwrap(), Some(3));
    assert!(begin.elapsed() < HANG_BOUND, "departures stopped the solves, not their time limits");
    assert_eq!(unary.get_limits(pb::GetLimitsRequest {}).await.unwrap().get_ref().max_steps, 10_000);
}

#[tokio::test]
async fn batch_answers_every_item_once_solved_or_refused() {
    let server = TestServer::start(4, instant_solver()).await;
    let mut items: Vec<_> = (0..200).map(|index| item(&format!("item-{index}"), index)).collect();
    items[7].robot = Some(pb::Robot { wheel_radius_m: Some(f64::NAN), ..pb::Robot::default() });
    let mut answers = server.grpc().await.solve_batch(stream::iter(items)).await.unwrap().into_inner();
    let mut ids = Vec::new();
    while let Some(response) = timeout(HANG_BOUND, answers.message()).await.unwrap().unwrap() {
        match response.answer.unwrap() {
            Answer::Solution(solution) => assert_eq!(solution.final_time_s, 1.5),
            Answer::Error(error) => {
                assert_eq!((response.request_id.as_str(), error.code), ("item-7", Code::InvalidArgument.into()));
                assert!(error.message.contains("wheel_radius_m") && !error.details.is_empty(), "{error:?}");
            }
        }
        ids.push(response.request_id);
    }
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), 200);
}

#[tokio::test]
async fn batch_leaves_the_last_quarter_of_the_queue_to_single_callers() {
    let gate = Arc::new(Gate::default());
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |_: &SolveInput, _: &RunControl<'_>| {
        held.wait();
        small_solution(StopReason::Finished)
    });
    // One runs and eight wait; two of the eight places are not for batches.
    let server = TestServer::start(8, Arc::new(solver)).await;
    let items: Vec<_> = (0..30).map(|index| item(&format!("item-{index}"), index)).collect();
    let mut client = server.grpc().await;
    let mut answers = client.solve_batch(stream::iter(items)).await.unwrap().into_inner();
    let batch = tokio::spawn(async move {
        let mut count = 0;
        while let Some(response) = answers.message().await.unwrap() {
            assert!(matches!(response.answer, Some(Answer::Solution(_))), "{response:?}");
            count += 1;
        }
        count
    });
    let in_flight = async |count: usize| {
        while server.service.jobs_in_flight() != count {
            tokio::task::yield_now().await;
        }
    };
    timeout(HANG_BOUND, in_flight(7)).await.unwrap();
    let singles: Vec<_> = (0..2)
        .map(|seed| {
            let mut client = client.clone();
            tokio::spawn(async move { client.solve(seeded(seed)).await })
        })
        .collect();
    timeout(HANG_BOUND, in_flight(9)).await.unwrap();
    assert_eq!(refusal(client.solve(seeded(9)).await), (Code::ResourceExhausted, "queue_full".to_owned()));
    gate.open();
    for single in singles {
        assert!(single.await.unwrap().is_ok());
    }
    assert_eq!(timeout(HANG_BOUND, batch).await.unwrap().unwrap(), 30);
}

#[tokio::test]
async fn batch_item_without_a_fresh_id_is_refused() {
    let gate = Arc::new(Gate::default());
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |_: &SolveInput, _: &RunControl<'_>| {
        held.wait();
        small_solution(StopReason::Finished)
    });
    let server = TestServer::start(8, Arc::new(solver)).await;
    let items = vec![item("twice", 1), item("twice", 2), item("", 3), item(&"x".repeat(129), 4)];
    let mut answers = server.grpc().await.solve_batch(stream::iter(items)).await.unwrap().into_inner();
    for _ in 0..3 {
        let refused = answers.message().await.unwrap().unwrap();
        assert_eq!(refused.request_id, "", "whoever matches by id keeps the first of the two");
        let Some(Answer::Error(error)) = refused.answer else { panic!("{refused:?}") };
        assert!(error.message.contains("`request_id`"), "{error:?}");
    }
    gate.open();
    let solved = answers.message().await.unwrap().unwrap();
    assert!(matches!(solved.answer, Some(Answer::Solution(_))) && solved.request_id == "twice");
    assert!(answers.message().await.unwrap().is_none());
}

#[tokio::test]
async fn draining_server_ends_batches_after_the_answers_in_flight() {
    let (gate, mut has_started, solver) = held_solver();
    let server = TestServer::start(8, solver).await;
    let mut client = server.grpc().await;
    let items = stream::iter([item("first", 1)]).chain(stream::pending());
    let mut answers = client.solve_batch(items).await.unwrap().into_inner();
    has_started.recv().await.unwrap();
    server.service.close();
    gate.open();
    assert_eq!(answers.message().await.unwrap().unwrap().request_id, "first");
    assert_eq!(refusal(answers.message().await), (Code::Unavailable, "unavailable".to_owned()));
    assert_eq!(refusal(client.solve(seeded(1)).await), (Code::Unavailable, "unavailable".to_owned()));
}

#[tokio::test]
async fn plain_http_on_this_port_is_no_success() {
    let server = TestServer::start(4, instant_solver()).await;
    let url = |path: &str| format!("http://{}{path}", server.grpc_address);
    for path in ["/", "/readyz", "/solve", "/slipdrive.v1.ManeuverService/None"] {
        assert_eq!(server.client.get(url(path)).send().await.unwrap().status(), 404, "{path}");
    }
    let solve = server.client.post(url("/slipdrive.v1.ManeuverService/Solve")).body("{}").send().await.unwrap();
    assert_eq!(
        (solve.status().as_u16(), &solve.headers()["grpc-accept-encoding"]),
        (415, &"identity".parse().unwrap())
    );
}

#[tokio::test]
async fn health_is_told_for_the_server_and_the_service_and_ends_first() {
    let server = TestServer::start(4, instant_solver()).await;
    let mut health = HealthClient::new(server.channel().await);
    let mut status = async |service: &str| {
        let request = HealthCheckRequest { service: service.to_owned() };
        health.check(request).await.map(|response| response.into_inner().status())
    };
    for name in ["", "slipdrive.v1.ManeuverService"] {
        assert_eq!(status(name).await.unwrap(), ServingStatus::Serving, "{name}");
    }
    assert_eq!(status("no.such.Service").await.unwrap_err().code(), Code::NotFound);
    server.health.announce_end().await;
    server.service.announce_end();
    for name in ["", "slipdrive.v1.ManeuverService"] {
        assert_eq!(status(name).await.unwrap(), ServingStatus::NotServing, "{name}");
    }
    assert_eq!(server.get("/readyz").await.status, 503);
    assert!(server.grpc().await.solve(seeded(1)).await.is_ok(), "work is still taken");
    assert_eq!(server.post("/solve", "{}").await.status, 200, "work is still taken");
}

#[tokio::test]
async fn numbers_that_are_not_finite_are_refused_wherever_they_stand() {
    let server = TestServer::start(4, instant_solver()).await;
    let mut client = server.grpc().await;
    for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut cases = vec![
            (pb::SolveRequest::default(), "robot.gravity_m_s2"),
            (pb::SolveRequest::default(), "maneuver.start.yaw_rate_rad_s"),
            (pb::SolveRequest::default(), "maneuver.goal.heading_rad"),
            (pb::SolveRequest::default(), "maneuver.torque_limit_left_n_m"),
            (pb::SolveRequest::default(), "solver.goal_tolerance"),
            (pb::SolveRequest::default(), "initial_guess.torque_left_n_m[1]"),
        ];
        cases[0].0.robot = Some(pb::Robot { gravity_m_s2: Some(number), ..pb::Robot::default() });
        let start = pb::State { yaw_rate_rad_s: number, ..pb::State::default() };
        cases[1].0.maneuver = Some(pb::Maneuver { start: Some(start), ..pb::Maneuver::default() });
        let goal = pb::Goal { heading_rad: Some(number), ..pb::Goal::default() };
        cases[2].0.maneuver = Some(pb::Maneuver { goal: Some(goal), ..pb::Maneuver::default() });
        cases[3].0.maneuver = Some(pb::Maneuver { torque_limit_left_n_m: Some(number), ..pb::Maneuver::default() });
        cases[4].0.solver = Some(pb::Solver { goal_tolerance: Some(number), ..pb::Solver::default() });
        let (torque_left_n_m, torque_right_n_m) = (vec![0.0, number], vec![0.0, 0.0]);
        cases[5].0.initial_guess =
            Some(pb::InitialGuess { final_time_s: Some(1.0), torque_left_n_m, torque_right_n_m });
        for (request, field) in cases {
            let status = client.solve(request).await.unwrap_err();
            assert_eq!((status.code(), code_of(&status).as_str()), (Code::InvalidArgument, "invalid_value"));
            assert_eq!(fields_of(&status)[0], field, "{number}");
        }
    }
}

#[tokio::test]
async fn unknown_enum_values_and_missing_messages_are_invalid_fields() {
    let server = TestServer::start(4, instant_solver()).await;
    let mut client = server.grpc().await;
    let unknown = client.solve(pb::SolveRequest { view: 99, ..pb::SolveRequest::default() }).await.unwrap_err();
    assert_eq!((code_of(&unknown).as_str(), fields_of(&unknown)), ("invalid_field", vec!["view".to_owned()]));
    let missing = client.simulate(pb::SimulateRequest::default()).await.unwrap_err();
    assert_eq!(
        (code_of(&missing).as_str(), fields_of(&missing)),
        ("invalid_field", vec!["torque_schedule".to_owned()])
    );
    let schedule = pb::TorqueSchedule { interval_s: Some(0.5), left_n_m: vec![1.0, -1.0], right_n_m: vec![1.0, -1.0] };
    let request = pb::SimulateRequest { torque_schedule: Some(schedule), ..pb::SimulateRequest::default() };
    assert!(client.simulate(request).await.unwrap().into_inner().trajectory.is_some());
}

#[tokio::test]
async fn largest_answer_fits_the_default_message_of_four_megabytes() {
    let server = TestServer::start(4, crate::support::real_solver()).await;
    let mut client = pb::maneuver_service_client::ManeuverServiceClient::new(server.channel().await);
    let request = pb::SolveRequest {
        grid: Some(pb::SolveGrid { steps: Some(10_000), control_intervals: Some(1_000) }),
        solver: Some(pb::Solver { rollout_limit: Some(1), ..pb::Solver::default() }),
        ..pb::SolveRequest::default()
    };
    let mut request = tonic::Request::new(request);
    request.get_mut().maneuver = Some(pb::Maneuver {
        goal: Some(pb::Goal { y_m: Some(5.0), ..pb::Goal::default() }),
        ..pb::Maneuver::default()
    });
    let solution = timeout(Duration::from_secs(120), client.solve(request)).await.unwrap().unwrap();
    assert_eq!(solution.into_inner().solution.unwrap().trajectory.unwrap().time_s.len(), 10_001);
}

/// What a version of reflection tells: the services, and how many bytes describe ours.
macro_rules! reflected {
    ($version:ident, $server:expr) => {{
        use tonic_reflection::pb::$version::ServerReflectionRequest;
        use tonic_reflection::pb::$version::server_reflection_client::ServerReflectionClient;
        use tonic_reflection::pb::$version::server_reflection_request::MessageRequest;
        use tonic_reflection::pb::$version::server_reflection_response::MessageResponse;

        let ask =
            |message_request| ServerReflectionRequest { host: String::new(), message_request: Some(message_request) };
        let symbol = "slipdrive.v1.ManeuverService".to_owned();
        let questions = [MessageRequest::ListServices(String::new()), MessageRequest::FileContainingSymbol(symbol)];
        let mut client = ServerReflectionClient::new($server.channel().await);
        let answers = client.server_reflection_info(stream::iter(questions.map(ask))).await.unwrap();
        let mut answers = answers.into_inner();
        let mut next = async || answers.message().await.unwrap().unwrap().message_response.unwrap();
        let MessageResponse::ListServicesResponse(list) = next().await else { panic!("the services are listed") };
        let MessageResponse::FileDescriptorResponse(files) = next().await else { panic!("the file is told") };
        let names: Vec<_> = list.service.into_iter().map(|service| service.name).collect();
        (names, files.file_descriptor_proto.concat())
    }};
}

#[tokio::test]
async fn both_versions_of_reflection_tell_the_same_service() {
    let server = TestServer::start(4, instant_solver()).await;
    let (names, files) = reflected!(v1, server);
    let (older_names, older_files) = reflected!(v1alpha, server);
    assert_eq!(files, older_files);
    let text = String::from_utf8_lossy(&files);
    for method in ["Solve", "SolveStream", "SolveBatch", "Simulate", "Validate", "GetLimits"] {
        assert!(text.contains(method), "{method}");
    }
    for names in [&names, &older_names] {
        for name in ["slipdrive.v1.ManeuverService", "grpc.health.v1.Health"] {
            assert!(names.iter().any(|known| known == name), "{name} in {names:?}");
        }
    }
}
