//! Figures and sentences, by both transports: what is taken, what is refused, what is said, and what they wait for.

use std::time::Duration;

use serde_json::{Value, json};
use slipdrive::api::grpc::pb;
use slipdrive::jobs::present::Present;
use slipdrive::jobs::{Kind as _, Limits};
use tokio::time::timeout;

use crate::support::protobuf::{code_of, fields_of};
use crate::support::{HANG_BOUND, TestServer, held_solver, real_solver};

fn maneuver() -> Value {
    json!({"maneuver": {"goal": {"y_m": 2}}, "grid": {"steps": 60, "control_intervals": 12}, "solver": {"starts": 1}, "view": "plan"})
}

async fn solved(server: &TestServer, request: &Value) -> Value {
    let answer = server.post("/solve", request.to_string()).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.json()
}

fn presentation(request: &Value, answer: &Value) -> Value {
    json!({"plans": [{"solve": {"request": request, "answer": answer}}]})
}

async fn presented(server: &TestServer, body: &Value) -> Value {
    let answer = server.post("/present", body.to_string()).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.json()
}

fn texts(value: &Value) -> String {
    value.as_array().unwrap().iter().map(|text| text.as_str().unwrap()).collect::<Vec<_>>().join("\n")
}

#[tokio::test]
async fn plan_has_figures_and_a_certificate_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let request = maneuver();
    let body = presentation(&request, &solved(&server, &request).await);
    let rest = presented(&server, &body).await;
    let message: pb::PresentRequest = serde_json::from_value(body).unwrap();
    let grpc = server.grpc().await.present(message).await.unwrap().into_inner();
    assert_eq!(rest, serde_json::to_value(&grpc).unwrap());
    let names: Vec<_> = grpc.figures.iter().map(|figure| figure.name.as_str()).collect();
    assert_eq!(names, ["path", "contact", "motion", "torques", "normal_forces", "wheel_rates", "friction"]);
    let words = &grpc.plans[0];
    assert_eq!((words.label.as_str(), words.end_difference), ("A", 0.0));
    assert!(words.headline.starts_with("The robot reaches its goal in "), "{}", words.headline);
    let certificate = words.certificate.join("\n");
    for topic in [
        "Goal: ",
        "Contact law: ",
        "Loads: ",
        "Replay: ",
        "Lower bound: ",
        "Criticality: ",
        "Sensitivity: ",
        "Other optima: ",
    ] {
        assert!(certificate.contains(topic), "{topic} in {certificate}");
    }
    let map = &grpc.figures[1].maps[0];
    assert_eq!((map.axes.as_str(), map.x.as_ref().unwrap().quantity.as_str()), ("left_longitudinal_force", "time_s"));
}

#[tokio::test]
async fn report_says_and_quotes_all_where_it_is_asked_for() {
    let server = TestServer::start(4, real_solver()).await;
    let request = maneuver();
    let mut body = presentation(&request, &solved(&server, &request).await);
    let bare = presented(&server, &body).await;
    assert_eq!(bare["report_html"], "");
    body["report"] = json!(true);
    let mut answer = presented(&server, &body).await;
    let report = answer["report_html"].take();
    let report = report.as_str().unwrap();
    assert!(report.starts_with("<!doctype html>") && !report.contains("<script"));
    for figure in answer["figures"].as_array().unwrap() {
        assert!(report.contains(figure["svg"].as_str().unwrap().trim_end()));
    }
    assert!(report.contains(answer["plans"][0]["headline"].as_str().unwrap()) && report.contains("/solve -H"));
    // Everything else is as without it.
    answer["report_html"] = json!("");
    assert_eq!(answer, bare);
}

#[tokio::test]
async fn simulations_and_solves_share_figures() {
    let server = TestServer::start(4, real_solver()).await;
    let request = maneuver();
    let answer = solved(&server, &request).await;
    let simulation =
        json!({"torque_schedule": answer["torque_schedule"], "grid": {"steps": 60}, "limits": {"speed_m_s": 1}});
    let simulated = server.post("/simulate", simulation.to_string()).await.json();
    let body = json!({"plans": [
        {"solve": {"request": request, "answer": answer}},
        {"simulate": {"request": simulation, "answer": simulated}},
    ]});
    let presented = presented(&server, &body).await;
    assert_eq!(presented["plans"][1]["label"], "B");
    assert_eq!(presented["plans"][1]["end_difference"], 0.0);
    assert!(texts(&presented["plans"][1]["certificate"]).contains("Limit limits.speed_m_s = 1: exceeded"));
    let svg = presented["figures"][1]["svg"].as_str().unwrap();
    assert!(svg.contains("sd-plan-a") && svg.contains("sd-plan-b") && svg.contains("B: "), "both are drawn");
}

#[tokio::test]
async fn answers_may_have_nulls_and_unknown_fields_and_requests_may_not() {
    let server = TestServer::start(4, real_solver()).await;
    let request = maneuver();
    let mut answer = solved(&server, &request).await;
    for path in ["", "/report", "/torque_schedule", "/end_state", "/report/replay"] {
        let object = answer.pointer_mut(path).unwrap().as_object_mut().unwrap();
        object.insert("new".to_owned(), json!({"any": [1, null]}));
    }
    answer["robot"] = json!({"chassis_mass_kg": null, "footprint": [{"up_m": 1}], "new": 1});
    for field in ["trajectory", "contact_modes", "solver_version", "applied_limits"] {
        answer[field] = Value::Null;
    }
    answer["report"]["separations"] = Value::Null;
    // As of an older server.
    answer["report"].as_object_mut().unwrap().remove("sensitivity").unwrap();
    let words = presented(&server, &presentation(&request, &answer)).await["plans"][0].clone();
    let certificate = texts(&words["certificate"]);
    assert!(certificate.contains("Replay: ") && !certificate.contains("Sensitivity: "), "{words}");

    let mut strict = presentation(&request, &answer);
    strict["plans"][0]["solve"]["request"]["new"] = json!(1);
    let problem = server.post("/present", strict.to_string()).await.problem();
    assert_eq!((&problem["status"], &problem["code"]), (&422.into(), &"invalid_field".into()));
    let mut negative = presentation(&request, &answer);
    negative["plans"][0]["solve"]["request"]["robot"] = json!({"wheel_radius_m": -1});
    let problem = server.post("/present", negative.to_string()).await.problem();
    assert_eq!(problem["errors"][0]["pointer"], "#/plans/0/solve/request/robot/wheel_radius_m");
    let message: pb::PresentRequest = serde_json::from_value(negative).unwrap();
    let status = server.grpc().await.present(message).await.unwrap_err();
    assert_eq!(
        (code_of(&status).as_str(), fields_of(&status)),
        ("invalid_value", vec!["plans[0].solve.request.robot.wheel_radius_m".to_owned()])
    );
}

#[tokio::test]
async fn certificate_needs_the_end_that_the_answer_states() {
    let server = TestServer::start(4, real_solver()).await;
    let request = maneuver();
    let answer = solved(&server, &request).await;
    let off_by = |difference: f64| {
        let mut answer = answer.clone();
        answer["end_state"]["y_m"] = json!(answer["end_state"]["y_m"].as_f64().unwrap() + difference);
        presentation(&request, &answer)
    };
    let near = presented(&server, &off_by(0.5e-9)).await["plans"][0].clone();
    assert!(!near["certificate"].as_array().unwrap().is_empty(), "{near}");
    let far = presented(&server, &off_by(2e-9)).await["plans"][0].clone();
    assert_eq!(far["certificate"], json!([]));
    assert!(texts(&far["details"]).contains("away from the end_state of the answer"), "{far}");
    // The answer to another goal, and one without an end.
    let mut other = request.clone();
    other["maneuver"]["goal"]["y_m"] = json!(3);
    let other = presented(&server, &presentation(&other, &answer)).await["plans"][0].clone();
    assert_eq!(other["certificate"], json!([]));
    assert!(texts(&other["details"]).contains("away from the goal of the request in y_m"), "{other}");
    assert_eq!(other["headline"], "The answer does not belong to its request.");
    let mut late = answer.clone();
    late["final_time_s"] = json!(99);
    let late = presented(&server, &presentation(&request, &late)).await["plans"][0].clone();
    assert_eq!((&late["certificate"], &late["end_difference"]), (&json!([]), &json!(0.0)));
    assert!(texts(&late["details"]).contains("its final_time_s is 99: they do not belong together"), "{late}");
    let mut endless = answer.clone();
    endless["end_state"] = Value::Null;
    let endless = presented(&server, &presentation(&request, &endless)).await["plans"][0].clone();
    assert_eq!((&endless["certificate"], &endless["end_difference"]), (&json!([]), &Value::Null));
}

#[tokio::test]
async fn nothing_is_claimed_for_a_motion_that_diverges() {
    let server = TestServer::start(4, real_solver()).await;
    let torques = json!({"interval_s": 10, "left_n_m": vec![1.0; 20], "right_n_m": vec![-1.0; 20]});
    let request = json!({"torque_schedule": torques, "grid": {"steps": 60}});
    let answer = server.post("/simulate", request.to_string()).await.json();
    assert_eq!(answer["end_state"]["x_m"], Value::Null);
    let body = json!({"plans": [{"simulate": {"request": request, "answer": answer}}]});
    let presented = presented(&server, &body).await;
    let words = &presented["plans"][0];
    assert_eq!(words["details"], json!(["The motion diverges."]));
    let certificate = texts(&words["certificate"]);
    assert!(!certificate.contains("Contact law") && !certificate.contains("unknown"), "{certificate}");
    assert!(presented["figures"][0]["svg"].as_str().unwrap().contains(">The motion diverges.<"), "{words}");
    let export = json!({"simulate": body["plans"][0]["simulate"], "format": "csv", "rate_hz": 10});
    let refused = server.post("/export", export.to_string()).await;
    assert!(refused.status == 422 && refused.text().contains("The motion diverges, must end."), "{}", refused.text());
}

#[tokio::test]
async fn answer_of_many_slips_is_no_longer_than_what_is_reserved_for_it() {
    let server = TestServer::start(4, real_solver()).await;
    let torques: Vec<_> = (0..1000).map(|interval| [3.0, 0.0, -3.0, 0.0][interval % 4]).collect();
    let torques = json!({"interval_s": 0.01, "left_n_m": torques, "right_n_m": torques});
    let request = json!({"torque_schedule": torques, "grid": {"steps": 4000}});
    let mut answer = server.post("/simulate", request.to_string()).await.json();
    assert!(answer["contact_modes"].as_array().unwrap().len() > 1000, "{}", answer["contact_modes"]);
    answer.as_object_mut().unwrap().retain(|field, _| field != "trajectory" && field != "contacts");
    let plan = json!({"simulate": {"request": request, "answer": answer}});
    for (count, report) in [(1, false), (4, false), (1, true), (4, true)] {
        let body = json!({"plans": vec![&plan; count], "report": report}).to_string();
        let answer = server.post("/present", body.clone()).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        let input = Present::read(body.as_bytes(), &Limits::default()).unwrap();
        let (length, reserved) = (answer.text().len(), Present::answer_bytes(&input, 18));
        assert!(length <= reserved, "{length} bytes, {reserved} reserved");
        // The least memory of a server holds it.
        assert!(reserved <= (24 << 20) / 16 * 3, "{reserved}");
    }
}

#[tokio::test]
async fn impossible_goal_is_one_figure_with_words() {
    let server = TestServer::start(4, real_solver()).await;
    let request = json!({"maneuver": {"goal": {"y_m": 2}, "torque_limit_left_n_m": 0, "torque_limit_right_n_m": 0}, "view": "plan"});
    let answer = solved(&server, &request).await;
    assert_eq!(answer["status"], "infeasible");
    let presented = presented(&server, &presentation(&request, &answer)).await;
    let figures = presented["figures"].as_array().unwrap();
    assert_eq!((figures.len(), &figures[0]["name"]), (1, &"path".into()));
    let words = &presented["plans"][0];
    assert_eq!(words["headline"], "The goal is impossible.");
    assert!(words["details"][0].as_str().unwrap().contains("no torque drives the robot there"), "{words}");
    assert_eq!(words["certificate"], json!([]));
    assert!(figures[0]["svg"].as_str().unwrap().contains("The goal is impossible. maneuver.goal.y_m"));
}

#[tokio::test]
async fn bodies_without_a_plan_are_refused_with_their_place() {
    let server = TestServer::start(4, real_solver()).await;
    let request = maneuver();
    let answer = solved(&server, &request).await;
    let solve = json!({"request": request, "answer": answer});
    let torques = json!({"torque_schedule": {"interval_s": 1, "left_n_m": [0], "right_n_m": [0]}});
    let simulation = json!({"request": torques, "answer": {}});
    let mut long = answer.clone();
    long["torque_schedule"]["left_n_m"] = json!(vec![0.0; 1001]);
    let mut coarse = answer.clone();
    coarse["report"]["steps"] = json!(3);
    let cases = [
        (json!({}), "#/plans", "invalid_value"),
        (json!({"plans": vec![json!({"solve": solve}); 5]}), "#/plans", "invalid_value"),
        (json!({"plans": [{}]}), "#/plans/0", "invalid_field"),
        (json!({"plans": [{"solve": solve, "simulate": simulation}]}), "#/plans/0", "invalid_field"),
        (json!({"plans": [{"solve": {"request": request}}]}), "#/plans/0/solve/answer", "invalid_field"),
        (presentation(&request, &json!({})), "#/plans/0/solve/answer/torque_schedule", "invalid_field"),
        (presentation(&request, &coarse), "#/plans/0/solve/answer/report/steps", "invalid_value"),
        (presentation(&request, &long), "#/plans/0/solve/answer/torque_schedule/left_n_m", "problem_too_large"),
    ];
    for (body, pointer, code) in cases {
        let problem = server.post("/present", body.to_string()).await.problem();
        let error = &problem["errors"][0];
        assert_eq!((&error["pointer"], &problem["code"]), (&pointer.into(), &code.into()), "{problem}");
    }
}

/// An answer of which only the torques count.
fn given_answer() -> Value {
    json!({
        "status": "converged", "final_time_s": 1.5, "report": {"steps": 200},
        "torque_schedule": {"interval_s": 0.75, "left_n_m": [1, -1], "right_n_m": [1, -1]},
    })
}

#[tokio::test]
async fn faults_of_all_plans_are_told_at_once_by_both_transports() {
    let server = TestServer::start(4, real_solver()).await;
    let mut answer = given_answer();
    answer["report"]["steps"] = json!(0);
    let plan = |robot: Value, answer: &Value| json!({"solve": {"request": {"robot": robot}, "answer": answer}});
    let body = json!({"plans": [
        plan(json!({"wheel_radius_m": 0}), &answer),
        plan(json!({}), &given_answer()),
        plan(json!({"gravity_m_s2": 0}), &given_answer()),
    ]});
    let expected = [
        "plans[0].solve.request.robot.wheel_radius_m",
        "plans[0].solve.answer.report.steps",
        "plans[2].solve.request.robot.gravity_m_s2",
    ];
    let problem = server.post("/present", body.to_string()).await.problem();
    assert_eq!((&problem["status"], &problem["detail"]), (&422.into(), &"3 values break their rules".into()));
    let pointers = problem["errors"].as_array().unwrap().iter().map(|error| error["pointer"].as_str().unwrap());
    let pointer = |path: &str| format!("#/{}", path.replace(['.', '['], "/").replace(']', ""));
    assert_eq!(pointers.collect::<Vec<_>>(), expected.map(pointer));
    let message: pb::PresentRequest = serde_json::from_value(body).unwrap();
    let status = server.grpc().await.present(message).await.unwrap_err();
    assert_eq!(
        (code_of(&status).as_str(), fields_of(&status)),
        ("invalid_value", expected.map(str::to_owned).to_vec())
    );
}

#[tokio::test]
async fn objects_and_whole_numbers_of_answers_are_what_they_are_in_requests() {
    let server = TestServer::start(4, real_solver()).await;
    let plan = given_answer().to_string();
    let changed = |from: &str, to: &str| {
        assert!(plan.contains(from), "{from} in {plan}");
        let answer = plan.replacen(from, to, 1);
        format!(r#"{{"plans": [{{"solve": {{"request": {{}}, "answer": {answer}}}}}]}}"#)
    };
    for whole in
        [r#""steps":200.0"#, r#""rollouts":1e3,"steps":2e2"#, r#""distinct_optima":[{"count":2.0}],"steps":200"#]
    {
        let answer = server.post("/present", changed(r#""steps":200"#, whole)).await;
        assert_eq!(answer.status, 200, "{whole}: {}", answer.text());
    }
    let list = r#""torque_schedule":[0.75,[1,-1],[1,-1]],"old":{"#;
    for (from, to, pointer, words) in [
        (r#""steps":200"#, r#""steps":200.5"#, "report/steps", "a whole number, at least 0"),
        (r#""report":{"steps":200}"#, r#""report":[1]"#, "report", "expected an object"),
        (r#""report":{"#, r#""contact_modes":[[]],"report":{"#, "contact_modes/0", "expected an object"),
        (r#""report":{"#, r#""end_state":[0,0,0,0,0,0,0,0,0,0],"report":{"#, "end_state", "expected an object"),
        (r#""torque_schedule":{"#, list, "torque_schedule", "invalid type: list, expected an object"),
        (
            r#""interval_s":0.75"#,
            r#""interval_s":0.75,"interval_s":1"#,
            "torque_schedule/interval_s",
            "duplicate field",
        ),
        (r#""interval_s":0.75,"#, "", "torque_schedule/interval_s", "missing field `interval_s`"),
        ("[1,-1]", r#"[1,"x"]"#, "torque_schedule", "`left_n_m[1]`: invalid type: string \"x\", expected a number"),
    ] {
        let problem = server.post("/present", changed(from, to)).await.problem();
        let error = &problem["errors"][0];
        assert_eq!(error["pointer"], format!("#/plans/0/solve/answer/{pointer}"), "{problem}");
        assert!(error["message"].as_str().unwrap().contains(words), "{problem}");
    }
}

#[tokio::test]
async fn body_may_have_a_mebibyte() {
    let server = TestServer::start(4, real_solver()).await;
    let request = maneuver();
    let body = presentation(&request, &solved(&server, &request).await).to_string();
    let filled = |length: usize| body.clone() + &" ".repeat(length - body.len());
    assert_eq!(server.post("/present", filled(1 << 20)).await.status, 200);
    assert_eq!(server.post("/present", filled((1 << 20) + 1)).await.problem()["code"], "body_too_large");
    assert_eq!(server.post("/solve", filled(1 << 20)).await.status, 413, "it holds no answers");
    let limits = server.get("/limits").await.json();
    let of = |job: &str| limits["jobs"].as_array().unwrap().iter().find(|of| of["job"] == job).cloned().unwrap();
    assert_eq!(of("present"), json!({"job": "present", "max_body_bytes": 1 << 20, "light": true}));
    assert_eq!(of("solve")["light"], false);
    let largest = ["export", "assess", "solve", "simulate"].map(|job| of(job)["max_body_bytes"].clone());
    assert_eq!(largest, [1 << 20, 1 << 20, 1 << 18, 1 << 18].map(|bytes: u32| json!(bytes)));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn picture_does_not_wait_behind_solves() {
    let (gate, mut started, solver) = held_solver();
    let server = std::sync::Arc::new(TestServer::start(1, solver).await);
    let (held, waiting) = (std::sync::Arc::clone(&server), std::sync::Arc::clone(&server));
    let running = tokio::spawn(async move { held.post("/solve", "{}").await.status });
    timeout(HANG_BOUND, started.recv()).await.unwrap().unwrap();
    let queued = tokio::spawn(async move { waiting.post("/solve", "{}").await.status });
    while server.service.jobs_in_flight() < 2 {
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    assert_eq!(server.post("/solve", "{}").await.status, 429, "the queue is full");
    let body = presentation(&json!({}), &given_answer()).to_string();
    let picture = timeout(HANG_BOUND, server.post("/present", body)).await.unwrap();
    assert_eq!(picture.status, 200, "{}", picture.text());
    let metrics = server.get("/metrics").await.text();
    assert!(metrics.contains("slipdrive_jobs_total{job=\"present\",outcome=\"finished\"} 1"), "{metrics}");
    assert!(metrics.contains("slipdrive_light_jobs 0"), "{metrics}");
    gate.open();
    assert_eq!((running.await.unwrap(), queued.await.unwrap()), (200, 200));
}
