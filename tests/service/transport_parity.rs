//! The same requests by both transports: the same answer to its last field, the same code, the same fields at fault.

use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;
use serde_json::{Value, json};
use slipdrive::api::grpc::pb;

use crate::support::protobuf::{code_of, fields_of, solve_request};
use crate::support::{TestServer, real_solver};

const SEED: u64 = 4;

/// A small solve with random values.
fn valid(random: &mut impl Rng) -> Value {
    let mut within = |limit: f64| random.random_range(-limit..limit);
    json!({
        "robot": {"wheel_friction_coefficient": 0.5 + within(0.2), "center_of_mass_right_m": within(0.02)},
        "maneuver": {
            "reference_point": if within(1.0) < 0.0 { "axle_midpoint" } else { "chassis_center_of_mass" },
            "start": {"x_m": within(1.0), "velocity_y_m_s": within(0.2)},
            "goal": {"y_m": within(4.0), "heading_rad": within(1.0), "free": ["x_m", "yaw_rate_rad_s"]},
            "torque_limit_left_n_m": 1.0 + within(0.3),
        },
        "grid": {"steps": 40, "control_intervals": 8},
        "solver": {"rollout_limit": 200, "seed": 7, "starts": 2, "choose": "steadiest", "choose_within": 0.05 + within(0.05)},
        "initial_guess": {"final_time_s": 3.0 + within(1.0), "torque_left_n_m": [0.1, 0.2], "torque_right_n_m": [0.3, -0.1]},
        "payload": {"mass_kg": 0.5 + within(0.2), "right_m": within(0.02), "forward_m": 0.08, "height_m": 0.1},
        "view": if within(1.0) < 0.0 { "plan" } else { "full" },
    })
}

/// A request with one or two faults.
fn invalid(index: usize) -> Value {
    let faults = [
        json!({"robot": {"chassis_mass_kg": -1}}),
        json!({"robot": {"wheel_radius_m": 0, "gravity_m_s2": -9.81}}),
        json!({"robot": {"tangential_restitution": 2}}),
        json!({"maneuver": {"torque_limit_right_n_m": -1}}),
        json!({"maneuver": {"goal": {"y_m": 1e9, "free": ["speed"]}}}),
        json!({"maneuver": {"goal": {"y_m": 1, "free": ["y_m"]}}}),
        json!({"maneuver": {"start": {"x_m": 2e4, "yaw_rate_rad_s": 1e5}}}),
        json!({"grid": {"steps": 0}}),
        json!({"grid": {"steps": 10001}}),
        json!({"grid": {"steps": 40, "control_intervals": 41}}),
        json!({"solver": {"starts": 65, "time_limit_s": 61}}),
        json!({"solver": {"time_limit_s": 0}}),
        json!({"solver": {"goal_tolerance": 2}}),
        json!({"solver": {"choose_within": 2}}),
        json!({"initial_guess": {"final_time_s": 1, "torque_left_n_m": [0, 9], "torque_right_n_m": [0, 0]}}),
        json!({"initial_guess": {"final_time_s": 1, "torque_left_n_m": [0], "torque_right_n_m": [0, 0]}}),
        json!({"maneuver": {"limits": {"speed_m_s": 0, "grip_utilization": 1}}}),
        json!({"robot": {"motor_stall_torque_n_m": 8}, "payload": {"mass_kg": -1, "height_m": 0.3}}),
        json!({"maneuver": {"keep_in": [{}, {"x_m": 1}, {"y_m": 1}]}}),
    ];
    faults[index % faults.len()].clone()
}

/// The same tree, whatever way it travelled; the time that a solve took is its own.
fn assert_same(mut rest: Value, grpc: &impl Serialize) {
    let mut grpc = serde_json::to_value(grpc).unwrap();
    for answer in [&mut rest, &mut grpc] {
        if let Some(report) = answer.get_mut("report") {
            assert!(report["solve_time_s"].take().as_f64().is_some_and(|time| time >= 0.0));
        }
    }
    assert_eq!(rest, grpc);
}

#[tokio::test]
async fn fifty_requests_get_the_same_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let mut client = server.grpc().await;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED);
    let mut plans = 0;
    for index in 0..50 {
        let body = if index % 2 == 0 { valid(&mut random) } else { invalid(index / 2) };
        let rest = server.post("/solve", body.to_string()).await;
        let grpc = client.solve(solve_request(&body)).await;
        match grpc {
            Ok(response) => {
                assert_eq!(rest.status, 200, "seed {SEED}, {body}: {}", rest.text());
                assert_same(rest.json(), response.get_ref().solution.as_ref().unwrap());
                plans += 1;
            }
            Err(status) => {
                let problem = rest.problem();
                assert_eq!(problem["code"], code_of(&status), "{body}");
                assert_eq!(problem["detail"], status.message(), "{body}");
                let pointers = problem["errors"].as_array().unwrap().iter();
                let fields: Vec<_> = pointers
                    .map(|error| error["pointer"].as_str().unwrap().trim_start_matches("#/").replace('/', "."))
                    .collect();
                let grpc_fields: Vec<_> =
                    fields_of(&status).iter().map(|field| field.replace('[', ".").replace(']', "")).collect();
                assert_eq!(fields, grpc_fields, "{body}");
            }
        }
    }
    assert!(plans >= 20, "{plans} of the valid requests have a plan");
}

#[tokio::test]
async fn infeasible_requests_get_the_same_reason_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let mut client = server.grpc().await;
    let no_torque = json!({"torque_limit_left_n_m": 0, "torque_limit_right_n_m": 0, "goal": {"y_m": 5}});
    let lifted = json!({"start": {"yaw_rate_rad_s": 100}});
    let fast = json!({"goal": {"yaw_rate_rad_s": 2}, "limits": {"yaw_rate_rad_s": 1}});
    for (maneuver, code, time) in [
        (no_torque, "no_torque", Some(0.0)),
        (lifted, "start_separates", Some(0.0)),
        (fast, "goal_exceeds_limit", None),
    ] {
        let body = json!({"maneuver": maneuver});
        let rest = server.post("/solve", body.to_string()).await.json();
        let grpc = client.solve(solve_request(&body)).await.unwrap().into_inner().solution.unwrap();
        assert_eq!((&rest["status"], &rest["reason"]["code"]), (&json!("infeasible"), &json!(code)));
        assert_eq!(rest["reason"].get("time_s").and_then(Value::as_f64), time);
        assert_same(rest, &grpc);
    }
}

#[tokio::test]
async fn motions_are_the_same_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let (left_n_m, right_n_m) = (vec![1.0, -0.5, 0.25], vec![-1.0, 0.125, 1.0]);
    for (contact_solver, name) in [(pb::ContactSolver::Exact, "exact"), (pb::ContactSolver::FixedPoint, "fixed_point")]
    {
        let schedule = json!({"interval_s": 0.4, "left_n_m": left_n_m, "right_n_m": right_n_m});
        let body = json!({"torque_schedule": schedule, "grid": {"steps": 60}, "contact_solver": name});
        let rest = server.post("/simulate", body.to_string()).await.json();
        let torque_schedule = Some(pb::TorqueSchedule {
            interval_s: Some(0.4),
            left_n_m: left_n_m.clone(),
            right_n_m: right_n_m.clone(),
        });
        let grid = Some(pb::SimulateGrid { steps: Some(60) });
        let contact_solver = contact_solver.into();
        let request = pb::SimulateRequest { torque_schedule, grid, contact_solver, ..pb::SimulateRequest::default() };
        assert_eq!(rest["trajectory"]["time_s"].as_array().unwrap().len(), 61);
        assert_same(rest, &server.grpc().await.simulate(request).await.unwrap().into_inner());
    }
}

#[tokio::test]
async fn empty_requests_complete_to_the_same_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let mut client = server.grpc().await;
    let rest = server.post("/validate", "{}").await.json();
    let grpc = client.validate(pb::ValidateRequest::default()).await.unwrap().into_inner();
    assert_eq!(rest["input_hash"].as_str().map(str::len), Some(64), "{rest}");
    assert_same(rest, &grpc);
}

#[tokio::test]
async fn limits_are_told_the_same_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let rest = server.get("/limits").await.json();
    let grpc = server.grpc().await.get_limits(pb::GetLimitsRequest {}).await.unwrap().into_inner();
    assert!(rest["rules"].as_array().is_some_and(|rules| rules.len() > 30), "{rest}");
    assert_same(rest, &grpc);
}
