//! gRPC requests made from the JSON that REST takes, and what errors tell.

use std::time::Duration;

use axum::body::Bytes;
use http_body_util::BodyExt as _;
use prost::Message as _;
use serde_json::Value;
use slipdrive::api::grpc::pb;
use tonic::{Code, Status};
use tonic_types::StatusExt as _;

use super::{HANG_BOUND, TestServer};

/// The protobuf form of a JSON body of `/solve`; panics where protobuf cannot say the same.
pub(crate) fn solve_request(body: &Value) -> pb::SolveRequest {
    pb::SolveRequest {
        robot: present(&body["robot"]).map(robot),
        payload: present(&body["payload"]).map(payload),
        maneuver: present(&body["maneuver"]).map(maneuver),
        grid: present(&body["grid"]).map(|grid| pb::SolveGrid {
            steps: count(&grid["steps"]),
            control_intervals: count(&grid["control_intervals"]),
        }),
        solver: present(&body["solver"]).map(solver),
        initial_guess: present(&body["initial_guess"]).map(|guess| pb::InitialGuess {
            final_time_s: guess["final_time_s"].as_f64(),
            torque_left_n_m: numbers(&guess["torque_left_n_m"]),
            torque_right_n_m: numbers(&guess["torque_right_n_m"]),
        }),
        view: named(&body["view"], "VIEW", pb::View::from_str_name).map_or(0, i32::from),
    }
}

fn present(value: &Value) -> Option<&Value> {
    (!value.is_null()).then_some(value)
}

fn count(value: &Value) -> Option<u32> {
    value.as_u64().map(|count| u32::try_from(count).unwrap())
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().map(|number| number.as_f64().unwrap()).collect()
}

fn named<T>(value: &Value, prefix: &str, from_name: impl Fn(&str) -> Option<T>) -> Option<T> {
    let name = value.as_str()?;
    Some(from_name(&format!("{prefix}_{}", name.to_uppercase())).unwrap())
}

fn robot(robot: &Value) -> pb::Robot {
    let number = |field: &str| robot[field].as_f64();
    pb::Robot {
        chassis_mass_kg: number("chassis_mass_kg"),
        wheel_mass_kg: number("wheel_mass_kg"),
        chassis_yaw_inertia_kg_m2: number("chassis_yaw_inertia_kg_m2"),
        wheel_diametral_inertia_kg_m2: number("wheel_diametral_inertia_kg_m2"),
        wheel_spin_inertia_kg_m2: number("wheel_spin_inertia_kg_m2"),
        wheel_radius_m: number("wheel_radius_m"),
        track_width_m: number("track_width_m"),
        axle_to_front_support_m: number("axle_to_front_support_m"),
        front_support_right_m: number("front_support_right_m"),
        center_of_mass_right_m: number("center_of_mass_right_m"),
        center_of_mass_forward_m: number("center_of_mass_forward_m"),
        center_of_mass_height_m: number("center_of_mass_height_m"),
        wheel_friction_coefficient: number("wheel_friction_coefficient"),
        front_friction_coefficient: number("front_friction_coefficient"),
        tangential_restitution: number("tangential_restitution"),
        gravity_m_s2: number("gravity_m_s2"),
        motor_stall_torque_n_m: number("motor_stall_torque_n_m"),
        motor_free_speed_rad_s: number("motor_free_speed_rad_s"),
        wheel_viscous_friction_n_m_s: number("wheel_viscous_friction_n_m_s"),
        footprint: pairs(&robot["footprint"], ["right_m", "forward_m"])
            .map(|[right_m, forward_m]| pb::BodyPoint { right_m, forward_m })
            .collect(),
    }
}

fn maneuver(maneuver: &Value) -> pb::Maneuver {
    let point = named(&maneuver["reference_point"], "REFERENCE_POINT", pb::ReferencePoint::from_str_name);
    let slip = named(&maneuver["slip"], "SLIP_POLICY", pb::SlipPolicy::from_str_name);
    pb::Maneuver {
        reference_point: point.map_or(0, i32::from),
        start: present(&maneuver["start"]).map(state),
        goal: present(&maneuver["goal"]).map(goal),
        torque_limit_left_n_m: maneuver["torque_limit_left_n_m"].as_f64(),
        torque_limit_right_n_m: maneuver["torque_limit_right_n_m"].as_f64(),
        limits: present(&maneuver["limits"]).map(limits),
        slip: slip.map_or(0, i32::from),
        keep_in: pairs(&maneuver["keep_in"], ["x_m", "y_m"]).map(|[x_m, y_m]| pb::WorldPoint { x_m, y_m }).collect(),
    }
}

fn limits(limits: &Value) -> pb::ManeuverLimits {
    let number = |field: &str| limits[field].as_f64();
    pb::ManeuverLimits {
        normal_load_share: number("normal_load_share"),
        grip_utilization: number("grip_utilization"),
        wheel_rate_rad_s: number("wheel_rate_rad_s"),
        speed_m_s: number("speed_m_s"),
        yaw_rate_rad_s: number("yaw_rate_rad_s"),
        acceleration_m_s2: number("acceleration_m_s2"),
        deceleration_m_s2: number("deceleration_m_s2"),
        yaw_acceleration_rad_s2: number("yaw_acceleration_rad_s2"),
        torque_rate_n_m_s: number("torque_rate_n_m_s"),
    }
}

fn payload(payload: &Value) -> pb::Payload {
    let number = |field: &str| payload[field].as_f64();
    pb::Payload {
        mass_kg: number("mass_kg"),
        right_m: number("right_m"),
        forward_m: number("forward_m"),
        height_m: number("height_m"),
        yaw_inertia_kg_m2: number("yaw_inertia_kg_m2"),
    }
}

fn pairs<'a>(points: &'a Value, fields: [&'a str; 2]) -> impl Iterator<Item = [f64; 2]> + 'a {
    let points = points.as_array().into_iter().flatten();
    points.map(move |point| fields.map(|field| point[field].as_f64().unwrap_or_default()))
}

fn state(state: &Value) -> pb::State {
    let number = |field: &str| state[field].as_f64().unwrap_or_default();
    pb::State {
        x_m: number("x_m"),
        y_m: number("y_m"),
        heading_rad: number("heading_rad"),
        wheel_angle_left_rad: number("wheel_angle_left_rad"),
        wheel_angle_right_rad: number("wheel_angle_right_rad"),
        velocity_x_m_s: number("velocity_x_m_s"),
        velocity_y_m_s: number("velocity_y_m_s"),
        yaw_rate_rad_s: number("yaw_rate_rad_s"),
        wheel_rate_left_rad_s: number("wheel_rate_left_rad_s"),
        wheel_rate_right_rad_s: number("wheel_rate_right_rad_s"),
    }
}

fn goal(goal: &Value) -> pb::Goal {
    let number = |field: &str| goal[field].as_f64();
    let names = goal["free"].as_array().into_iter().flatten();
    pb::Goal {
        x_m: number("x_m"),
        y_m: number("y_m"),
        heading_rad: number("heading_rad"),
        wheel_angle_left_rad: number("wheel_angle_left_rad"),
        wheel_angle_right_rad: number("wheel_angle_right_rad"),
        velocity_x_m_s: number("velocity_x_m_s"),
        velocity_y_m_s: number("velocity_y_m_s"),
        yaw_rate_rad_s: number("yaw_rate_rad_s"),
        wheel_rate_left_rad_s: number("wheel_rate_left_rad_s"),
        wheel_rate_right_rad_s: number("wheel_rate_right_rad_s"),
        free: names.map(|name| name.as_str().unwrap().to_owned()).collect(),
    }
}

fn solver(solver: &Value) -> pb::Solver {
    pb::Solver {
        method: named(&solver["method"], "METHOD", pb::Method::from_str_name).map_or(0, i32::from),
        starts: count(&solver["starts"]),
        seed: solver["seed"].as_u64().unwrap_or_default(),
        time_limit_s: solver["time_limit_s"].as_f64(),
        rollout_limit: solver["rollout_limit"].as_u64(),
        goal_tolerance: solver["goal_tolerance"].as_f64(),
        replay_tolerance_m: solver["replay_tolerance_m"].as_f64(),
        replay_tolerance_rad: solver["replay_tolerance_rad"].as_f64(),
        choose: named(&solver["choose"], "CHOICE", pb::Choice::from_str_name).map_or(0, i32::from),
        choose_within: solver["choose_within"].as_f64(),
    }
}

/// The media type of gRPC, which generated clients add by themselves.
/// Media type and path of a solve.
pub(crate) const SOLVE: &str = "/slipdrive.v1.ManeuverService/Solve";
pub(crate) const GRPC: (&str, &str) = ("content-type", "application/grpc");

/// The bytes of a message with its head.
pub(crate) fn framed(flag: u8, message: &[u8]) -> Vec<u8> {
    let mut frame = vec![flag];
    frame.extend(u32::try_from(message.len()).unwrap().to_be_bytes());
    frame.extend(message);
    frame
}

/// The status of what is sent as bytes over HTTP/2 to the gRPC port, as no generated client would send it.
pub(crate) async fn raw_call(server: &TestServer, path: &str, headers: &[(&str, &str)], body: Vec<u8>) -> Status {
    raw_answer(server, path, headers, body).await.0
}

/// The solution that comes by a deadline. tonic's own client gives up by itself at that time.
pub(crate) async fn solved_by(server: &TestServer, request: &pb::SolveRequest, timeout: Duration) -> pb::Solution {
    let (timeout, message) = (format!("{}m", timeout.as_millis()), framed(0, &request.encode_to_vec()));
    let (status, body) = raw_answer(server, SOLVE, &[GRPC, ("grpc-timeout", &timeout)], message).await;
    assert_eq!(status.code(), Code::Ok, "{status:?}");
    let answer = pb::SolveResponse::decode(&body[framed(0, &[]).len()..]).unwrap();
    answer.solution.expect("it is answered with its best plan")
}

async fn raw_answer(server: &TestServer, path: &str, headers: &[(&str, &str)], body: Vec<u8>) -> (Status, Bytes) {
    let client = reqwest::Client::builder().http2_prior_knowledge().no_proxy().timeout(HANG_BOUND).build().unwrap();
    let method = headers.iter().find(|(name, _)| *name == ":method").map_or("POST", |(_, method)| method);
    let url = format!("http://{}{path}", server.grpc_address);
    let mut request = client.request(method.parse().unwrap(), url).header("te", "trailers");
    for (name, value) in headers.iter().filter(|(name, _)| *name != ":method") {
        request = request.header(*name, *value);
    }
    let (head, body) = axum::http::Response::from(request.body(body).send().await.unwrap()).into_parts();
    let body = body.collect().await.expect("the answer is complete");
    // In the head if there is no message, else at the end.
    let in_trailers = body.trailers().and_then(Status::from_header_map);
    let status = Status::from_header_map(&head.headers).or(in_trailers).expect("every answer has a status");
    (status, body.to_bytes())
}

/// The code of an error as REST writes it, after checking that all details are there.
pub(crate) fn code_of(status: &Status) -> String {
    let details = status.get_error_details();
    let info = details.error_info().unwrap_or_else(|| panic!("no error info in {status:?}"));
    assert_eq!(info.domain, "slipdrive");
    assert!(!details.request_info().unwrap().request_id.is_empty());
    let is_retryable = info.metadata["retryable"] == "true";
    let pushback = status.metadata().get("grpc-retry-pushback-ms").map(|value| value.to_str().unwrap());
    let delay = details.retry_info().map(|info| info.retry_delay.unwrap().as_millis().to_string());
    match pushback {
        Some("-1") => assert!(!is_retryable && delay.is_none(), "{status:?}"),
        Some(pushback) => assert_eq!((is_retryable, Some(pushback)), (true, delay.as_deref())),
        None => assert!(is_retryable && delay.is_none(), "{status:?}"),
    }
    info.reason.to_lowercase()
}

/// The dotted paths of the fields that an error speaks of.
pub(crate) fn fields_of(status: &Status) -> Vec<String> {
    let details = status.get_error_details();
    let violations = details.bad_request().map(|request| request.field_violations.clone()).unwrap_or_default();
    violations.into_iter().map(|violation| violation.field).collect()
}

/// Code and details of an error.
pub(crate) fn refusal<T: std::fmt::Debug>(result: Result<T, Status>) -> (Code, String) {
    let status = result.unwrap_err();
    (status.code(), code_of(&status))
}
