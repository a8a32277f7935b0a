//! The same requests by both transports: the same plan, the same code, the same fields at fault.

use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
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
        "solver": {"rollout_limit": 200, "seed": 7, "starts": 2},
        "initial_guess": {"final_time_s": 3.0 + within(1.0), "torque_left_n_m": [0.1, 0.2], "torque_right_n_m": [0.3, -0.1]},
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
        json!({"initial_guess": {"final_time_s": 1, "torque_left_n_m": [0, 9], "torque_right_n_m": [0, 0]}}),
        json!({"initial_guess": {"final_time_s": 1, "torque_left_n_m": [0], "torque_right_n_m": [0, 0]}}),
    ];
    faults[index % faults.len()].clone()
}

fn enum_name(name: &str, prefix: &str) -> String {
    name.strip_prefix(prefix).unwrap().to_lowercase()
}

fn assert_same_plan(rest: &Value, grpc: &pb::Solution) {
    assert_eq!(rest["input_hash"], grpc.input_hash);
    assert_eq!(rest["status"], enum_name(grpc.status().as_str_name(), "STATUS_"));
    assert_eq!(rest["stop_reason"], enum_name(grpc.stop_reason().as_str_name(), "STOP_REASON_"));
    assert_eq!(rest["replay_confirmed"], grpc.replay_confirmed);
    assert_eq!(rest["final_time_s"], grpc.final_time_s);
    let schedule = grpc.torque_schedule.as_ref().unwrap();
    assert_eq!(rest["torque_schedule"]["left_n_m"], json!(schedule.left_n_m));
    assert_eq!(rest["torque_schedule"]["right_n_m"], json!(schedule.right_n_m));
    assert_eq!(rest["torque_schedule"]["interval_s"], json!(schedule.interval_s));
    let (trajectory, contacts) = (grpc.trajectory.as_ref(), grpc.contacts.as_ref());
    assert_eq!(rest.get("trajectory").map(|all| &all["x_m"]), trajectory.map(|all| json!(all.x_m)).as_ref());
    assert_eq!(rest.get("trajectory").map(|all| &all["time_s"]), trajectory.map(|all| json!(all.time_s)).as_ref());
    let front = contacts.map(|all| json!(all.front.as_ref().unwrap().normal_force_n));
    assert_eq!(rest.get("contacts").map(|all| &all["front"]["normal_force_n"]), front.as_ref());
    assert_eq!(rest["contact_modes"].as_array().unwrap().len(), grpc.contact_modes.len());
    for (rest, grpc) in rest["contact_modes"].as_array().unwrap().iter().zip(&grpc.contact_modes) {
        assert_eq!(rest["front"], enum_name(grpc.front().as_str_name(), "CONTACT_MODE_"));
        assert_eq!(
            (&rest["end_s"], &rest["degrees_of_freedom"]),
            (&json!(grpc.end_s), &json!(grpc.degrees_of_freedom))
        );
    }
    let report = grpc.report.as_ref().unwrap();
    assert_eq!(rest["report"]["rollouts"], report.rollouts);
    assert_eq!(rest["report"]["lower_bound_s"], report.lower_bound_s);
    let assumption = enum_name(report.lower_bound_assumption().as_str_name(), "LOWER_BOUND_ASSUMPTION_");
    assert_eq!(rest["report"]["lower_bound_assumption"], assumption);
    assert_eq!(rest["report"]["switching_sign_violations"], report.switching_sign_violations);
    assert_eq!(rest["report"]["replay"]["miss_m"], report.replay.as_ref().unwrap().miss_m);
    assert_eq!(rest["goal_error"]["y_m"], grpc.goal_error.as_ref().unwrap().y_m);
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
                assert_same_plan(&rest.json(), response.get_ref().solution.as_ref().unwrap());
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
    for (maneuver, code) in [(no_torque, "no_torque"), (lifted, "start_separates")] {
        let body = json!({"maneuver": maneuver});
        let rest = server.post("/solve", body.to_string()).await.json();
        let grpc = client.solve(solve_request(&body)).await.unwrap().into_inner().solution.unwrap();
        assert_same_plan(&rest, &grpc);
        assert_eq!((&rest["status"], &rest["reason"]["code"]), (&json!("infeasible"), &json!(code)));
        let reason = grpc.reason.unwrap();
        let told = json!({
            "code": reason.code, "field": reason.field, "time_s": reason.time_s, "value": reason.value,
            "limit": reason.limit, "message": reason.message,
        });
        assert_eq!(rest["reason"], told);
    }
}

#[tokio::test]
async fn empty_requests_complete_to_the_same_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let mut client = server.grpc().await;
    let rest = server.post("/validate", "{}").await.json();
    let grpc = client.validate(pb::ValidateRequest::default()).await.unwrap().into_inner();
    assert_eq!(rest["input_hash"], grpc.input_hash);
    assert_eq!(rest["robot"]["wheel_radius_m"], json!(grpc.robot.unwrap().wheel_radius_m));
    assert_eq!(rest["grid"]["steps"], json!(grpc.grid.unwrap().steps));
    assert_eq!(rest["solver"]["time_limit_s"], json!(grpc.solver.unwrap().time_limit_s));
    let goal = grpc.maneuver.unwrap().goal.unwrap();
    assert_eq!(rest["maneuver"]["goal"]["free"], json!(goal.free));
    assert_eq!(rest["maneuver"]["goal"]["y_m"], json!(goal.y_m));
}

#[tokio::test]
async fn limits_are_told_the_same_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let rest = server.get("/limits").await.json();
    let grpc = server.grpc().await.get_limits(pb::GetLimitsRequest {}).await.unwrap().into_inner();
    assert_eq!(rest["max_steps"], grpc.max_steps);
    assert_eq!(rest["queue_length"], grpc.queue_length);
    assert_eq!(rest["batch_window"], grpc.batch_window);
    assert_eq!(rest["rules"].as_array().unwrap().len(), grpc.rules.len());
    assert_eq!(rest["rules"][0]["field"], grpc.rules[0].field);
}
