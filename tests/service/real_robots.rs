//! What real robots add to a request: limits, motor, payload, aisle. The same by both transports, and nothing where none is given.

use std::sync::Arc;

use serde_json::{Value, json};
use slipdrive::api::grpc::pb;
use slipdrive::motion::LimitUse;
use slipdrive::solver::{RunControl, SolveInput, StopReason};
use tonic::Code;

use crate::support::protobuf::{code_of, fields_of, solve_request};
use crate::support::{FakeSolver, TestServer, instant_solver, small_solution};

/// Every field that real robots add.
fn everything() -> Value {
    json!({
        "robot": {
            "motor_stall_torque_n_m": 8.0,
            "motor_free_speed_rad_s": 15.0,
            "wheel_viscous_friction_n_m_s": 0.02,
            "footprint": [
                {"right_m": -0.2, "forward_m": -0.1},
                {"right_m": 0.2, "forward_m": -0.1},
                {"right_m": 0.2, "forward_m": 0.4},
                {"right_m": -0.2, "forward_m": 0.4},
            ],
        },
        "payload": {"mass_kg": 3.0, "right_m": 0.01, "forward_m": 0.1, "height_m": 0.2, "yaw_inertia_kg_m2": 0.04},
        "maneuver": {
            "goal": {"y_m": 5.0},
            "slip": "forbidden",
            "limits": {
                "grip_utilization": 0.9,
                "wheel_rate_rad_s": 15.0,
                "speed_m_s": 1.2,
                "yaw_rate_rad_s": 2.0,
                "acceleration_m_s2": 0.8,
                "deceleration_m_s2": 1.0,
                "yaw_acceleration_rad_s2": 4.0,
                "torque_rate_n_m_s": 80.0,
            },
            // Clockwise, as a caller may have it.
            "keep_in": [
                {"x_m": -0.6, "y_m": -1.0},
                {"x_m": -0.6, "y_m": 7.0},
                {"x_m": 0.6, "y_m": 7.0},
                {"x_m": 0.6, "y_m": -1.0},
            ],
        },
    })
}

/// `everything` with one other value at a pointer.
fn spoiled(pointer: &str, value: Value) -> Value {
    let mut body = everything();
    *body.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value;
    body
}

fn without(pointer: &str) -> Value {
    let mut body = everything();
    let (object, name) = pointer.rsplit_once('/').unwrap();
    body.pointer_mut(object).unwrap().as_object_mut().unwrap().remove(name).unwrap();
    body
}

/// Every value of `part` is in `whole`.
fn assert_within(part: &Value, whole: &Value, path: &str) {
    match part {
        Value::Object(fields) => {
            for (name, value) in fields {
                assert_within(value, &whole[name], &format!("{path}/{name}"));
            }
        }
        Value::Array(items) => {
            for (index, value) in items.iter().enumerate() {
                assert_within(value, &whole[index], &format!("{path}/{index}"));
            }
        }
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => assert_eq!(part, whole, "{path}"),
    }
}

/// The dotted paths of the fields at fault, which both transports name.
async fn faults(server: &TestServer, body: &Value) -> Vec<String> {
    let answer = server.post("/validate", body.to_string()).await;
    let errors = answer.json()["errors"].as_array().cloned().unwrap_or_default();
    let by_rest: Vec<_> = errors.iter().map(|error| error["pointer"].as_str().unwrap().to_owned()).collect();
    let by_grpc = server.grpc().await.validate(solve_request(body)).await;
    let by_grpc = by_grpc.map_or_else(|status| fields_of(&status), |_| Vec::new());
    let pointers: Vec<_> =
        by_grpc.iter().map(|field| format!("#/{}", field.replace(['.', '['], "/").replace(']', ""))).collect();
    assert_eq!(by_rest, pointers, "{}", answer.json());
    by_grpc
}

#[tokio::test]
async fn request_with_everything_survives_validation() {
    let server = TestServer::start(4, instant_solver()).await;
    let mut completed = server.post("/validate", everything().to_string()).await.json();
    assert_within(&everything(), &completed, "");
    let hash = completed.as_object_mut().unwrap().remove("input_hash").unwrap();
    let again = server.post("/validate", completed.to_string()).await.json();
    assert_eq!(again["input_hash"], hash);
    let by_grpc = server.grpc().await.validate(solve_request(&everything())).await.unwrap().into_inner();
    assert_eq!(json!(by_grpc.input_hash), hash);
    assert_eq!(by_grpc.payload.unwrap().yaw_inertia_kg_m2, Some(0.04));
}

#[tokio::test]
async fn what_is_not_asked_is_not_in_the_completed_form() {
    let server = TestServer::start(4, instant_solver()).await;
    let plain = server.post("/validate", "{}").await.json();
    let text = plain.to_string();
    for name in ["motor", "viscous", "footprint", "payload", "slip", "keep_in", "grip", "speed_m_s\"", "torque_rate"] {
        assert!(!text.contains(name), "{name} in {text}");
    }
    let neutral = json!({
        "robot": {"wheel_viscous_friction_n_m_s": 0, "footprint": []},
        "maneuver": {"slip": "allowed", "keep_in": [], "limits": {}},
    });
    assert_eq!(server.post("/validate", neutral.to_string()).await.json(), plain);
}

#[tokio::test]
async fn share_of_the_grip_completes_to_forbidden_slip() {
    let server = TestServer::start(4, instant_solver()).await;
    let body = json!({"maneuver": {"limits": {"grip_utilization": 0.9}}});
    let completed = server.post("/validate", body.to_string()).await.json();
    assert_eq!(completed["maneuver"]["slip"], "forbidden");
}

#[tokio::test]
async fn slip_that_is_allowed_contradicts_a_share_of_the_grip() {
    let server = TestServer::start(4, instant_solver()).await;
    let body =
        json!({"maneuver": {"slip": "allowed", "limits": {"grip_utilization": 0.9}, "torque_limit_left_n_m": -1}});
    let problem = server.post("/validate", body.to_string()).await.problem();
    let errors = problem["errors"].as_array().unwrap();
    let rule = "`maneuver.slip` is allowed, must be forbidden, or left out, beside `maneuver.limits.grip_utilization`";
    assert!(errors.iter().any(|error| error["message"] == rule), "{problem}");
    assert_eq!(errors.len(), 2, "all at once: {problem}");
}

#[tokio::test]
async fn torque_limit_is_the_stall_torque_where_none_is_given() {
    let server = TestServer::start(4, instant_solver()).await;
    let limits = async |body: Value| {
        let completed = server.post("/validate", body.to_string()).await.json();
        ["torque_limit_left_n_m", "torque_limit_right_n_m"].map(|field| completed["maneuver"][field].as_f64().unwrap())
    };
    let motor = json!({"motor_stall_torque_n_m": 8, "motor_free_speed_rad_s": 15});
    assert_eq!(limits(json!({})).await, [1.0, 1.0]);
    assert_eq!(limits(json!({"robot": motor})).await, [8.0, 8.0]);
    assert_eq!(limits(json!({"robot": motor, "maneuver": {"torque_limit_left_n_m": 9}})).await, [9.0, 8.0]);
}

#[tokio::test]
async fn each_spoiled_field_is_named() {
    let server = TestServer::start(4, instant_solver()).await;
    assert_eq!(faults(&server, &everything()).await, Vec::<String>::new());
    let limits = everything()["maneuver"]["limits"].clone();
    for name in limits.as_object().unwrap().keys() {
        for value in [-1.0, 0.0, 1e300] {
            let body = spoiled(&format!("/maneuver/limits/{name}"), json!(value));
            assert_eq!(faults(&server, &body).await, [format!("maneuver.limits.{name}")], "{value}");
        }
    }
    let dent = json!({"x_m": 0.0, "y_m": 0.0});
    let cases = [
        (spoiled("/maneuver/limits/grip_utilization", json!(1)), "maneuver.limits.grip_utilization"),
        (spoiled("/robot/motor_stall_torque_n_m", json!(0)), "robot.motor_stall_torque_n_m"),
        (spoiled("/robot/motor_free_speed_rad_s", json!(-15)), "robot.motor_free_speed_rad_s"),
        (without("/robot/motor_stall_torque_n_m"), "robot.motor_stall_torque_n_m"),
        (without("/robot/motor_free_speed_rad_s"), "robot.motor_free_speed_rad_s"),
        (spoiled("/robot/wheel_viscous_friction_n_m_s", json!(-1)), "robot.wheel_viscous_friction_n_m_s"),
        (without("/robot/footprint"), "robot.footprint"),
        (spoiled("/robot/footprint", json!([{}, {"right_m": 1}])), "robot.footprint"),
        (spoiled("/robot/footprint/2/forward_m", json!(101)), "robot.footprint[2].forward_m"),
        (spoiled("/maneuver/keep_in/0/x_m", json!(1e300)), "maneuver.keep_in[0].x_m"),
        (spoiled("/maneuver/keep_in/2", dent), "maneuver.keep_in[2]"),
        (spoiled("/payload/mass_kg", json!(-1)), "payload.mass_kg"),
        (spoiled("/payload/right_m", json!(1)), "payload.right_m"),
        (spoiled("/payload/forward_m", json!(-2)), "payload.forward_m"),
        (spoiled("/payload/height_m", json!(2)), "payload.height_m"),
        (spoiled("/payload/yaw_inertia_kg_m2", json!(-1)), "payload.yaw_inertia_kg_m2"),
        (without("/payload/mass_kg"), "payload.mass_kg"),
        (without("/payload/height_m"), "payload.height_m"),
    ];
    for (body, field) in cases {
        assert_eq!(faults(&server, &body).await, [field]);
    }
}

#[tokio::test]
async fn all_faults_are_named_at_once() {
    let server = TestServer::start(4, instant_solver()).await;
    let body = json!({
        "robot": {"motor_free_speed_rad_s": 15, "wheel_viscous_friction_n_m_s": -1},
        "payload": {"mass_kg": -1, "height_m": -1},
        "maneuver": {"limits": {"speed_m_s": 0, "grip_utilization": 1}, "keep_in": [{}, {"x_m": 1}]},
    });
    let expected = [
        "robot.motor_stall_torque_n_m",
        "robot.wheel_viscous_friction_n_m_s",
        "payload.mass_kg",
        "payload.height_m",
        "maneuver.limits.grip_utilization",
        "maneuver.limits.speed_m_s",
        "maneuver.keep_in",
        "robot.footprint",
    ];
    assert_eq!(faults(&server, &body).await, expected);
}

#[tokio::test]
async fn numbers_that_are_not_finite_are_named() {
    let server = TestServer::start(4, instant_solver()).await;
    let mut client = server.grpc().await;
    for number in [f64::NAN, f64::INFINITY] {
        let mut request = solve_request(&everything());
        let (robot, maneuver) = (request.robot.as_mut().unwrap(), request.maneuver.as_mut().unwrap());
        robot.motor_stall_torque_n_m = Some(number);
        robot.footprint[1].right_m = number;
        request.payload.as_mut().unwrap().height_m = Some(number);
        maneuver.limits.as_mut().unwrap().deceleration_m_s2 = Some(number);
        maneuver.keep_in[3].y_m = number;
        let status = client.validate(request).await.unwrap_err();
        let expected = [
            "robot.motor_stall_torque_n_m",
            "payload.height_m",
            "maneuver.limits.deceleration_m_s2",
            "maneuver.keep_in[3].y_m",
            "robot.footprint[1].right_m",
        ];
        assert_eq!(fields_of(&status), expected, "{number}");
    }
}

#[tokio::test]
async fn too_many_corners_are_refused_by_their_number() {
    let server = TestServer::start(4, instant_solver()).await;
    // No corner is judged: each would be at fault.
    let corners = |count: usize| vec![json!({"x_m": 1e9}); count];
    for count in [65, 10_000] {
        assert_eq!(faults(&server, &spoiled("/maneuver/keep_in", json!(corners(count)))).await, ["maneuver.keep_in"]);
    }
    let body = spoiled("/maneuver/keep_in", json!(corners(100_000)));
    assert_eq!(server.post("/validate", body.to_string()).await.status, 413);
}

#[tokio::test]
async fn corners_are_objects() {
    let server = TestServer::start(4, instant_solver()).await;
    for corners in [json!([[0, 0], [1, 0], [0, 1]]), json!([null, null, null]), json!({}), json!(null)] {
        let answer = server.post("/validate", spoiled("/maneuver/keep_in", corners).to_string()).await;
        let problem = answer.json();
        assert_eq!((answer.status, &problem["code"]), (422, &json!("invalid_field")), "{problem}");
    }
    let unknown = spoiled("/maneuver/keep_in/1", json!({"x": 1}));
    assert_eq!(server.post("/validate", unknown.to_string()).await.status, 422);
    let request = pb::SolveRequest {
        maneuver: Some(pb::Maneuver { slip: 9, ..pb::Maneuver::default() }),
        ..pb::SolveRequest::default()
    };
    let status = server.grpc().await.validate(request).await.unwrap_err();
    assert_eq!((code_of(&status).as_str(), fields_of(&status)), ("invalid_field", vec!["maneuver.slip".to_owned()]));
}

#[tokio::test]
async fn answers_show_the_joined_robot_and_how_far_limits_are_used() {
    let solver = FakeSolver(|input: &SolveInput, _: &RunControl<'_>| {
        let mut solution = small_solution(StopReason::Finished);
        if let Some(value) = input.maneuver.limits.speed {
            let limit = "maneuver.limits.speed_m_s";
            let used = LimitUse { limit, value, largest: 1.2, time: 0.5, excess: 0.0, replay_excess: None };
            let replayed = LimitUse { limit: "maneuver.keep_in", replay_excess: Some(1e-3), ..used };
            solution.report.limits = vec![used, replayed];
        }
        solution
    });
    let server = TestServer::start(4, Arc::new(solver)).await;
    let answer = server.post("/solve", everything().to_string()).await.json();
    let (robot, uses) = (&answer["robot"], &answer["report"]["limits"]);
    assert_eq!(robot["chassis_mass_kg"], 10.33 + 3.0);
    assert_eq!(robot["motor_free_speed_rad_s"], 15.0);
    assert_eq!(robot["footprint"], everything()["robot"]["footprint"]);
    let speed = json!({"limit": "maneuver.limits.speed_m_s", "value": 1.2, "largest": 1.2, "time_s": 0.5, "excess": 0.0,
                       "replay_excess": null});
    assert_eq!((&uses[0], &uses[1]["replay_excess"]), (&speed, &json!(1e-3)));
    let by_grpc = server.grpc().await.solve(solve_request(&everything())).await.unwrap().into_inner();
    assert_eq!(serde_json::to_value(by_grpc.solution.unwrap().report.unwrap().limits).unwrap(), *uses);

    let plain = server.post("/solve", "{}").await.json();
    assert!(plain.get("robot").is_none() && plain["report"].get("limits").is_none(), "{plain}");
}

#[tokio::test]
async fn simulations_take_payload_limits_and_aisle() {
    let server = TestServer::start(4, instant_solver()).await;
    let everything = everything();
    let mut body = json!({
        "robot": everything["robot"],
        "payload": everything["payload"],
        "torque_schedule": {"interval_s": 0.1, "left_n_m": [0], "right_n_m": [0]},
        "limits": everything["maneuver"]["limits"],
        "keep_in": everything["maneuver"]["keep_in"],
    });
    let answer = server.post("/simulate", body.to_string()).await;
    assert_eq!(answer.status, 200, "{}", answer.json());
    body["robot"].as_object_mut().unwrap().remove("footprint");
    body["payload"]["height_m"] = json!(9);
    body["limits"]["speed_m_s"] = json!(0);
    let problem = server.post("/simulate", body.to_string()).await.json();
    let pointers: Vec<_> =
        problem["errors"].as_array().unwrap().iter().map(|error| error["pointer"].as_str().unwrap()).collect();
    assert!(pointers.contains(&"#/payload/height_m"), "{problem}");
    assert!(pointers.ends_with(&["#/limits/speed_m_s", "#/robot/footprint"]), "{problem}");
    let request = serde_json::from_value::<pb::SimulateRequest>(body).unwrap();
    let status = server.grpc().await.simulate(request).await.unwrap_err();
    assert_eq!((status.code(), fields_of(&status).len()), (Code::InvalidArgument, pointers.len()));
}
