//! Plans as files for controllers: frames, times and bytes, what is refused, and both transports.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use slipdrive::api::grpc::pb;
use slipdrive::jobs::export::Export;
use slipdrive::jobs::{Kind as _, Limits};

use crate::support::cdr::Cdr;
use crate::support::protobuf::{code_of, fields_of};
use crate::support::{TestServer, real_solver};

/// Half a second to the left, then back to half the torques, on a grid that 100 Hz does not meet.
fn left_turn() -> Value {
    let torques = json!({"interval_s": 0.12345, "left_n_m": [0.2, 0.2, 0.2, 0.1], "right_n_m": [0.3, 0.3, 0.4, 0.1]});
    let request =
        json!({"torque_schedule": torques, "grid": {"steps": 40}, "start": {"x_m": 1, "velocity_y_m_s": 0.1}});
    json!({"simulate": {"request": request, "answer": {}}})
}

fn body(plan: &Value, further: &Value) -> Value {
    let mut body = plan.clone();
    body.as_object_mut().unwrap().extend(further.as_object().unwrap().clone());
    body
}

/// The files of an export by name, the same by both transports, and the answer.
pub(crate) async fn exported(server: &TestServer, body: &Value) -> (BTreeMap<String, Vec<u8>>, Value) {
    let answer = server.post("/export", body.to_string()).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    let rest = answer.json();
    let message: pb::ExportRequest = serde_json::from_value(body.clone()).unwrap();
    let grpc = server.grpc().await.export(message).await.unwrap().into_inner();
    assert_eq!(rest, serde_json::to_value(&grpc).unwrap());
    (grpc.files.into_iter().map(|file| (file.name, decoded(&file.base64))).collect(), rest)
}

fn decoded(base64: &str) -> Vec<u8> {
    let digit = |byte: u8| match byte {
        b'A'..=b'Z' => byte - b'A',
        b'a'..=b'z' => byte - b'a' + 26,
        b'0'..=b'9' => byte - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        _ => panic!("{byte} in base64"),
    };
    let mut bytes = Vec::new();
    for four in base64.trim_end_matches('=').as_bytes().chunks(4) {
        let bits = four.iter().fold(0_u32, |bits, byte| bits << 6 | u32::from(digit(*byte))) << (6 * (4 - four.len()));
        bytes.extend(&bits.to_be_bytes()[1..four.len()]);
    }
    bytes
}

/// The columns of a file by name.
pub(crate) fn columns(csv: &[u8]) -> BTreeMap<String, Vec<f64>> {
    let text = std::str::from_utf8(csv).unwrap();
    let mut rows = text.lines().map(|row| row.split(',').collect::<Vec<_>>());
    let names = rows.next().unwrap();
    let rows: Vec<Vec<f64>> = rows.map(|row| row.iter().map(|value| value.parse().unwrap()).collect()).collect();
    names.iter().enumerate().map(|(at, name)| ((*name).to_owned(), rows.iter().map(|row| row[at]).collect())).collect()
}

#[tokio::test]
async fn answers_of_hardly_any_time_are_taken_back() {
    let server = TestServer::start(4, real_solver()).await;
    let rolling = json!({"velocity_y_m_s": 2e-6, "wheel_rate_left_rad_s": 3.33e-5, "wheel_rate_right_rad_s": 3.33e-5});
    let coasting = body(&rolling, &json!({"free": ["x_m", "y_m"]}));
    let spinning = json!({"wheel_rate_right_rad_s": -100_000});
    for request in [
        json!({"maneuver": {"goal": {"wheel_rate_right_rad_s": 2e-5}}, "solver": {"starts": 1}, "grid": {"steps": 200}}),
        json!({"maneuver": {"goal": coasting}, "solver": {"starts": 1, "goal_tolerance": 1e-7}}),
        // Its motions diverge.
        json!({"maneuver": {"start": spinning, "goal": {"y_m": -10_000}}, "solver": {"starts": 1}, "grid": {"steps": 200}}),
    ] {
        let answer = server.post("/solve", request.to_string()).await.json();
        assert!(answer["final_time_s"].as_f64().unwrap() < 1e-6, "{answer}");
        let plan = json!({"request": request, "answer": answer});
        let shown = server.post("/present", json!({"plans": [{"solve": plan}]}).to_string()).await;
        assert!(shown.status == 200 && !shown.text().contains("does not belong"), "{}", shown.text());
        let export = json!({"solve": plan, "format": "csv", "rate_hz": 100});
        let exported = server.post("/export", export.to_string()).await;
        // Times in files are whole nanoseconds.
        let has_room = answer["torque_schedule"]["interval_s"].as_f64().unwrap() >= 1e-9;
        assert_eq!(exported.status, if has_room { 200 } else { 422 }, "{}", exported.text());
        let motion = json!({
            "torque_schedule": answer["torque_schedule"],
            "start": request["maneuver"].get("start").unwrap_or(&json!({})),
            "grid": {"steps": answer["report"]["steps"]},
        });
        let simulated = server.post("/simulate", motion.to_string()).await;
        assert_eq!(simulated.json()["end_state"], answer["end_state"], "{}", simulated.text());
    }
}

#[tokio::test]
async fn left_turn_has_the_signs_of_rep_103() {
    let server = TestServer::start(4, real_solver()).await;
    let (files, answer) = exported(&server, &body(&left_turn(), &json!({"format": "csv", "rate_hz": 100}))).await;
    let of = columns(&files["trajectory.csv"]);
    let (first, last) = (|name: &str| of[name][0], |name: &str| *of[name].last().unwrap());
    // It faces +y: the axle midpoint is 7 cm behind the chassis centre of mass, and 2 cm to its right, at +x.
    assert_eq!(first("yaw_rad"), std::f64::consts::FRAC_PI_2);
    assert!((first("x_m") - 1.02).abs() < 1e-12 && (first("y_m") + 0.07).abs() < 1e-12);
    assert_eq!((first("velocity_forward_m_s"), first("velocity_left_m_s")), (0.1, 0.0));
    assert!(last("yaw_rad") > first("yaw_rad") + 0.1 && last("yaw_rate_rad_s") > 0.1, "left is positive");
    assert!(last("x_m") < 1.02 && last("y_m") > 0.0, "left of +y is -x");
    assert!(last("velocity_forward_m_s") > 0.1 && last("wheel_rate_right_rad_s") > last("wheel_rate_left_rad_s"));
    // Wheels that stick: what the axle midpoint moves sideways is of the time steps.
    assert!(of["velocity_left_m_s"].iter().all(|left| left.abs() < 0.01), "{:?}", of["velocity_left_m_s"]);
    assert!(answer["miss_m"].as_f64().unwrap() < 1e-3 && answer["miss_rad"].as_f64().unwrap() < 1e-3, "{answer}");
}

#[tokio::test]
async fn answer_to_another_request_is_refused() {
    let server = TestServer::start(4, real_solver()).await;
    let request = json!({"maneuver": {"goal": {"y_m": 1}}, "grid": {"steps": 40, "control_intervals": 8},
                         "solver": {"starts": 1}, "view": "plan"});
    let answer = server.post("/solve", request.to_string()).await.json();
    let export = json!({"solve": {"request": request, "answer": answer}, "format": "csv", "rate_hz": 100});
    assert_eq!(server.post("/export", export.to_string()).await.status, 200);
    let changed = |pointer: &str, value: Value| {
        let mut export = export.clone();
        *export.pointer_mut(pointer).unwrap() = value;
        export
    };
    let mut wider = export.clone();
    wider["solve"]["request"]["robot"]["wheel_radius_m"] = json!(0.08);
    let far = changed("/solve/answer/end_state/y_m", json!(2));
    for (body, fault) in
        [(wider, "away from the goal of the request in "), (far, "away from the end_state of the answer")]
    {
        let refused = server.post("/export", body.to_string()).await;
        let problem = refused.problem();
        assert_eq!((refused.status, &problem["code"]), (422, &json!("invalid_value")), "{problem}");
        assert_eq!(problem["errors"][0]["pointer"], "#/solve/answer");
        assert!(problem["detail"].as_str().unwrap().contains(fault), "{problem}");
        let message: pb::ExportRequest = serde_json::from_value(body).unwrap();
        let status = server.grpc().await.export(message).await.unwrap_err();
        assert_eq!((code_of(&status).as_str(), fields_of(&status)), ("invalid_value", vec!["solve.answer".to_owned()]));
    }
    // What states no end is not contradicted by that.
    let endless = changed("/solve/answer/end_state", Value::Null);
    assert_eq!(server.post("/export", endless.to_string()).await.status, 200);
}

#[tokio::test]
async fn whole_answer_may_be_handed_on_as_it_came() {
    let server = TestServer::start(4, real_solver()).await;
    let mut request = left_turn()["simulate"]["request"].clone();
    request["grid"]["steps"] = json!(1600);
    let answer = server.post("/simulate", request.to_string()).await.json();
    let plan = json!({"simulate": {"request": request, "answer": answer}});
    let csv = body(&plan, &json!({"format": "csv", "rate_hz": 100}));
    assert!(csv.to_string().len() > Limits::default().max_body_bytes);
    exported(&server, &csv).await;
    let uncertain = json!([{"parameter": "friction", "low": 0, "high": 0}]);
    let assess =
        body(&plan, &json!({"uncertain": uncertain, "tolerances": {"along_m": 1, "distance_m": 1}, "samples": 1}));
    let assessed = server.post("/assess", assess.to_string()).await;
    assert_eq!(assessed.status, 200, "{}", assessed.text());
    let message: pb::AssessRequest = serde_json::from_value(assess).unwrap();
    server.grpc().await.assess(message).await.unwrap();

    let advice =
        "larger than 1048576 bytes; `trajectory` and `contacts` of an answer are not read and need not be sent";
    let large = "x".repeat(1 << 20);
    for path in ["/export", "/assess", "/present"] {
        let problem = server.post(path, format!("\"{large}\"")).await.problem();
        let detail = problem["detail"].as_str().unwrap();
        assert!(problem["code"] == "body_too_large" && detail.ends_with(advice), "{problem}");
    }
    let message = pb::ExportRequest { frame_id: Some(large), ..pb::ExportRequest::default() };
    let status = server.grpc().await.export(message).await.unwrap_err();
    assert!(code_of(&status) == "body_too_large" && status.message().ends_with(advice), "{status}");
}

#[tokio::test]
async fn points_are_at_the_rate_and_the_last_at_the_final_time() {
    let server = TestServer::start(4, real_solver()).await;
    let request = left_turn();
    let simulated = server.post("/simulate", request["simulate"]["request"].to_string()).await.json();
    let end = |name: &str| simulated["trajectory"][name].as_array().unwrap().last().unwrap().as_f64().unwrap();
    let (files, _) = exported(&server, &body(&request, &json!({"format": "csv", "rate_hz": 100}))).await;
    let of = columns(&files["trajectory.csv"]);
    let times = &of["time_s"];
    assert_eq!((times.len(), times[0], *times.last().unwrap()), (51, 0.0, 4.0 * 0.12345));
    assert!(times[..50].iter().enumerate().all(|(index, time)| (time - index as f64 / 100.0).abs() < 1e-15));
    for name in ["wheel_angle_left_rad", "wheel_angle_right_rad", "wheel_rate_left_rad_s", "wheel_rate_right_rad_s"] {
        assert_eq!(*of[name].last().unwrap(), end(name), "{name}");
    }
    // Moved to the axle midpoint and back by rotations: a few roundings.
    assert!((of["yaw_rad"].last().unwrap() - end("heading_rad") - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    // The torque from then on: none at the end.
    let at = |time: f64| times.iter().position(|of| (of - time).abs() < 1e-9).unwrap();
    let right = |time: f64| of["torque_right_n_m"][at(time)];
    assert_eq!([right(0.24), right(0.25), right(0.37), right(0.38)], [0.3, 0.4, 0.4, 0.1]);
    assert_eq!(*of["torque_right_n_m"].last().unwrap(), 0.0);

    // Nodes keep their states, however finely they are asked for.
    let (fine, _) = exported(&server, &body(&request, &json!({"format": "csv", "rate_hz": 10000}))).await;
    let fine = columns(&fine["trajectory.csv"]);
    assert_eq!(fine["time_s"].len(), 4939);
    for name in fine.keys() {
        assert_eq!(fine[name].last(), of[name].last(), "{name}");
    }
}

#[tokio::test]
async fn bag_and_json_have_what_the_columns_have() {
    let server = TestServer::start(4, real_solver()).await;
    let further = |format: &str| {
        json!({"format": format, "rate_hz": 20, "frame_id": "map", "joint_names": ["l", "right"],
               "start_time": {"sec": 7, "nanosec": 999_999_999}})
    };
    let csv = exported(&server, &body(&left_turn(), &further("csv"))).await.0;
    let of = columns(&csv["trajectory.csv"]);
    let bag = exported(&server, &body(&left_turn(), &further("ros2_mcap"))).await.0;
    assert_eq!(bag.keys().collect::<Vec<_>>(), ["metadata.yaml", "plan.mcap"]);
    let metadata = String::from_utf8(bag["metadata.yaml"].clone()).unwrap();
    assert!(metadata.contains("nanoseconds_since_epoch: 7999999999\n"), "{metadata}");
    let messages: Vec<_> = mcap::MessageStream::new(&bag["plan.mcap"]).unwrap().map(Result::unwrap).collect();
    let topics: Vec<_> = messages.iter().map(|message| message.channel.topic.as_str()).collect();
    assert_eq!(topics, ["/plan/trajectory", "/plan/joint_trajectory"]);
    assert!(messages.iter().all(|message| message.log_time == 7_999_999_999));

    let mut cdr = Cdr::new(&messages[0].data);
    assert_eq!(cdr.header(), (7_999_999_999, "map".to_owned()));
    assert_eq!(cdr.uint32() as usize, of["time_s"].len());
    for (point, time) in of["time_s"].iter().enumerate() {
        let (stamp, frame) = cdr.header();
        assert!((stamp as f64 - 7_999_999_999.0 - time * 1e9).abs() < 1.0 && frame == "map", "{stamp}");
        let at = |name: &str| of[name][point];
        let half = 0.5 * at("yaw_rad");
        assert_eq!(cdr.float64s::<7>(), [at("x_m"), at("y_m"), 0.0, 0.0, 0.0, half.sin(), half.cos()]);
        let (forward, left) = (at("velocity_forward_m_s"), at("velocity_left_m_s"));
        assert_eq!(cdr.float64s::<6>(), [forward, left, 0.0, 0.0, 0.0, at("yaw_rate_rad_s")]);
        assert!(cdr.float64s::<12>().iter().all(|absent| absent.is_nan()));
    }
    assert!(cdr.is_at_end());

    let mut cdr = Cdr::new(&messages[1].data);
    assert_eq!(cdr.header(), (7_999_999_999, "map".to_owned()));
    assert_eq!((cdr.uint32(), cdr.text(), cdr.text()), (2, "l".to_owned(), "right".to_owned()));
    let points: Vec<_> =
        (0..cdr.uint32()).map(|_| ([cdr.array(), cdr.array(), cdr.array(), cdr.array()], cdr.time())).collect();
    assert!(cdr.is_at_end());
    assert!(points.windows(2).all(|pair| pair[0].1 < pair[1].1), "times grow");
    let effort_at = |time: u64| points.iter().find(|point| point.1 == time).map(|point| point.0[3].clone());
    // Both torques change together; the torques of the first two intervals are the same.
    for (step, before, after) in [
        (246_900_000, [0.2, 0.3], [0.2, 0.4]),
        (370_350_000, [0.2, 0.4], [0.1, 0.1]),
        (493_800_000, [0.1, 0.1], [0.0; 2]),
    ] {
        assert_eq!((effort_at(step - 1000), effort_at(step)), (Some(before.to_vec()), Some(after.to_vec())), "{step}");
    }
    assert_eq!((effort_at(123_450_000), points.len()), (None, of["time_s"].len() + 2 + 2 + 1));
    let last = &points.last().unwrap().0;
    assert_eq!(last[0], ["wheel_angle_left_rad", "wheel_angle_right_rad"].map(|name| *of[name].last().unwrap()));
    assert_eq!(last[1], ["wheel_rate_left_rad_s", "wheel_rate_right_rad_s"].map(|name| *of[name].last().unwrap()));
    assert!(last[2].is_empty());

    let json = exported(&server, &body(&left_turn(), &further("ros2_json"))).await.0;
    let trajectory: Value = serde_json::from_slice(&json["trajectory.json"]).unwrap();
    let point = trajectory["points"].as_array().unwrap().last().unwrap();
    assert_eq!(point["velocity"]["linear"]["x"], json!(of["velocity_forward_m_s"].last()));
    assert_eq!(point["acceleration"]["linear"], json!({"x": null, "y": null, "z": null}));
    assert_eq!(point["header"]["stamp"], json!({"sec": 8, "nanosec": 493_799_999}));
    let joints: Value = serde_json::from_slice(&json["joint_trajectory.json"]).unwrap();
    assert_eq!(
        (&joints["joint_names"], joints["points"].as_array().unwrap().len()),
        (&json!(["l", "right"]), points.len())
    );
}

#[tokio::test]
async fn every_fault_is_named_at_once_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let mut faulty = left_turn();
    faulty["simulate"]["request"]["robot"] = json!({"wheel_radius_m": 0});
    let fields = json!({"format": "csv", "rate_hz": 0, "frame_id": "", "joint_names": ["a", "a"],
                        "start_time": {"sec": -1, "nanosec": 1_000_000_000}});
    let all = ["rate_hz", "frame_id", "start_time.sec", "start_time.nanosec", "joint_names[1]"];
    let with_robot = [&all[..], &["simulate.request.robot.wheel_radius_m"]].concat();
    let long = "n".repeat(129);
    let of_name =
        |name: &str| json!({"format": "csv", "rate_hz": 9, "frame_id": name, "joint_names": ["a\u{7}", name]});
    let cases = [
        (left_turn(), fields.clone(), all.to_vec()),
        (faulty.clone(), fields, with_robot),
        (faulty, json!({"format": "csv", "rate_hz": 9}), vec!["simulate.request.robot.wheel_radius_m"]),
        (left_turn(), of_name(&long), vec!["frame_id", "joint_names[0]", "joint_names[1]"]),
        (left_turn(), of_name("a\n"), vec!["frame_id", "joint_names[0]", "joint_names[1]"]),
        (left_turn(), json!({"format": "csv", "rate_hz": 1e300}), vec!["rate_hz"]),
        (left_turn(), json!({"format": "csv", "rate_hz": 9, "joint_names": ["a"]}), vec!["joint_names"]),
    ];
    for (plan, further, expected) in cases {
        let body = body(&plan, &further);
        let problem = server.post("/export", body.to_string()).await.problem();
        let pointers: Vec<_> = problem["errors"].as_array().unwrap().iter().map(|error| &error["pointer"]).collect();
        let pointer = |field: &&str| json!(format!("#/{}", field.replace(['.', '['], "/").replace(']', "")));
        assert_eq!(pointers, expected.iter().map(pointer).collect::<Vec<_>>().iter().collect::<Vec<_>>(), "{problem}");
        let message: pb::ExportRequest = serde_json::from_value(body).unwrap();
        let status = server.grpc().await.export(message).await.unwrap_err();
        assert_eq!(
            (code_of(&status).as_str(), fields_of(&status)),
            ("invalid_value", expected.iter().map(ToString::to_string).collect())
        );
    }
    let message: pb::ExportRequest =
        serde_json::from_value(body(&left_turn(), &json!({"format": "csv", "rate_hz": 1}))).unwrap();
    for (message, fields, code) in [
        (pb::ExportRequest { rate_hz: Some(f64::NAN), ..message.clone() }, "rate_hz", "invalid_value"),
        (pb::ExportRequest { rate_hz: None, ..message.clone() }, "rate_hz", "invalid_field"),
        (pb::ExportRequest { format: 0, ..message.clone() }, "format", "invalid_field"),
        (pb::ExportRequest { format: 9, ..message }, "format", "invalid_field"),
    ] {
        let status = server.grpc().await.export(message).await.unwrap_err();
        assert_eq!((code_of(&status).as_str(), fields_of(&status)), (code, vec![fields.to_owned()]));
    }
}

#[tokio::test]
async fn what_is_no_plan_and_what_has_too_many_points_is_refused_by_name() {
    let server = TestServer::start(4, real_solver()).await;
    let csv = json!({"format": "csv", "rate_hz": 100});
    let impossible = json!({"maneuver": {"goal": {"y_m": 1}, "torque_limit_left_n_m": 0, "torque_limit_right_n_m": 0}});
    let answer = server.post("/solve", impossible.to_string()).await.json();
    assert_eq!(answer["status"], "infeasible");
    let impossible = json!({"solve": {"request": impossible, "answer": answer}});
    let mut with_torques = impossible.clone();
    with_torques["solve"]["answer"]["torque_schedule"] = left_turn()["simulate"]["request"]["torque_schedule"].clone();
    with_torques["solve"]["answer"]["report"]["steps"] = json!(40);
    let mut slow = left_turn();
    slow["simulate"]["request"]["torque_schedule"]["interval_s"] = json!(25);
    let both = body(&left_turn(), &impossible);
    let cases = [
        (body(&impossible, &csv), "#/solve/answer/status", "infeasible and there are no torques"),
        (body(&with_torques, &csv), "#/solve/answer/status", "infeasible, must be that of a plan"),
        (
            body(&slow, &csv),
            "#/rate_hz",
            "`rate_hz` is 100, must be at most 99.99 Hz for a plan of 100 s: 10000 points",
        ),
        (csv.clone(), "#", "neither `solve` nor `simulate`"),
        (body(&both, &csv), "#", "both `solve` and `simulate`"),
        (body(&left_turn(), &json!({"format": "xml", "rate_hz": 1})), "#/format", "xml"),
        (body(&left_turn(), &json!({"rate_hz": 1})), "#/format", "missing field"),
        (body(&left_turn(), &json!({"format": "csv", "rate_hz": 1, "new": 1})), "#/new", "unknown field"),
        (body(&left_turn(), &json!({"format": "csv"})), "#/rate_hz", "missing field"),
        (body(&left_turn(), &json!({"format": "csv", "rate_hz": 1, "frame_id": null})), "#/frame_id", "null"),
    ];
    for (body, pointer, words) in cases {
        let problem = server.post("/export", body.to_string()).await.problem();
        let error = &problem["errors"][0];
        assert_eq!((&problem["status"], &error["pointer"]), (&422.into(), &pointer.into()), "{problem}");
        assert!(error["message"].as_str().unwrap().contains(words), "{problem}");
    }
    // As many points as there may be.
    slow["simulate"]["request"]["torque_schedule"]["interval_s"] = json!(24.9975);
    let (files, _) = exported(&server, &body(&slow, &csv)).await;
    assert_eq!(columns(&files["trajectory.csv"])["time_s"].len(), 10_000);
    // The longest format with as many intervals as there may be.
    slow["simulate"]["request"] = many_torques();
    let answer =
        server.post("/export", body(&slow, &json!({"format": "ros2_json", "rate_hz": 1000})).to_string()).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
}

/// As many torques as there may be, all different.
fn many_torques() -> Value {
    let torques: Vec<_> = (0..1000).map(|interval| 0.1 * f64::from(interval).sin()).collect();
    json!({"start": {"x_m": 1234.567, "y_m": -4321.1, "heading_rad": 0.3},
           "torque_schedule": {"interval_s": 0.009_999, "left_n_m": torques, "right_n_m": torques}})
}

#[tokio::test]
async fn answer_is_no_longer_than_what_is_reserved_for_it() {
    let server = TestServer::start(4, real_solver()).await;
    let plan = json!({"simulate": {"request": many_torques(), "answer": {}}});
    for format in ["csv", "ros2_mcap", "ros2_json"] {
        for frame in ["odom", &"\"".repeat(128)] {
            let body = body(&plan, &json!({"format": format, "rate_hz": 100, "frame_id": frame})).to_string();
            let answer = server.post("/export", body.clone()).await;
            assert_eq!(answer.status, 200, "{}", answer.text());
            let input = Export::read(body.as_bytes(), &Limits::default()).unwrap();
            let (length, reserved) = (answer.text().len(), Export::answer_bytes(&input, 18));
            assert!(length <= reserved, "{format}, {frame}: {length} bytes, {reserved} reserved");
        }
    }
}

#[tokio::test]
async fn motion_of_less_than_a_microsecond_begins_at_zero() {
    let server = TestServer::start(4, real_solver()).await;
    let mut short = left_turn();
    short["simulate"]["request"]["torque_schedule"]["interval_s"] = json!(1e-7);
    let (files, _) = exported(&server, &body(&short, &json!({"format": "csv", "rate_hz": 100}))).await;
    assert_eq!(columns(&files["trajectory.csv"])["time_s"], [0.0, 4e-7]);
    let (files, _) = exported(&server, &body(&short, &json!({"format": "ros2_json", "rate_hz": 100}))).await;
    let joints: Value = serde_json::from_slice(&files["joint_trajectory.json"]).unwrap();
    let of = |point: &Value| point["time_from_start"]["nanosec"].as_u64().unwrap();
    let times: Vec<_> = joints["points"].as_array().unwrap().iter().map(of).collect();
    assert!(times[0] == 0 && times.is_sorted_by(|a, b| a < b) && times.last() == Some(&400), "{times:?}");
}

#[tokio::test]
async fn start_that_is_the_goal_is_a_plan_of_one_point() {
    let server = TestServer::start(4, real_solver()).await;
    let answer = server.post("/solve", "{}").await.json();
    assert_eq!((&answer["status"], &answer["final_time_s"]), (&"converged".into(), &0.0.into()));
    let plan = json!({"solve": {"request": {}, "answer": answer}});
    let (files, answer) = exported(&server, &body(&plan, &json!({"format": "csv", "rate_hz": 1}))).await;
    let of = columns(&files["trajectory.csv"]);
    assert_eq!((&of["time_s"], &of["torque_left_n_m"], &answer["miss_m"]), (&vec![0.0], &vec![0.0], &json!(0.0)));
    let (files, _) = exported(&server, &body(&plan, &json!({"format": "ros2_json", "rate_hz": 1}))).await;
    let joints: Value = serde_json::from_slice(&files["joint_trajectory.json"]).unwrap();
    assert_eq!(joints["points"].as_array().unwrap().len(), 1);
}
