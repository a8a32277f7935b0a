//! Bad input over real HTTP: each fault is refused as a problem that names field, value and rule.

use serde_json::{Value, json};
use slipdrive::jobs::Limits;

use crate::support::{Answer, TestServer, instant_solver};

async fn server() -> TestServer {
    TestServer::start(4, instant_solver()).await
}

/// What a caller sends wrongly, and what the refusal must say of it.
struct Fault {
    body: String,
    status: u16,
    code: &'static str,
    pointer: &'static str,
    /// Parts of the message: value and rule.
    says: &'static [&'static str],
}

fn fault(
    body: impl Into<String>,
    (status, code): (u16, &'static str),
    pointer: &'static str,
    says: &'static [&'static str],
) -> Fault {
    Fault { body: body.into(), status, code, pointer, says }
}

const FIELD: (u16, &str) = (422, "invalid_field");
const VALUE: (u16, &str) = (422, "invalid_value");
const LARGE: (u16, &str) = (422, "problem_too_large");

fn field_faults() -> Vec<Fault> {
    vec![
        fault(r#"{"robt": {}}"#, FIELD, "#/robt", &["unknown field `robt`", "`robot`"]),
        fault(
            r#"{"robot": {"wheel_radius": 1}}"#,
            FIELD,
            "#/robot/wheel_radius",
            &["unknown field", "`wheel_radius_m`"],
        ),
        fault(
            r#"{"robot": {"wheel_radius_m": 1, "wheel_radius_m": 1}}"#,
            FIELD,
            "#/robot/wheel_radius_m",
            &["duplicate field `wheel_radius_m`"],
        ),
        fault(r#"{"view": "full", "view": "full"}"#, FIELD, "#/view", &["duplicate field"]),
        fault(r#"{"robot": {"wheel_radius_m": "1"}}"#, FIELD, "#/robot/wheel_radius_m", &["string \"1\"", "a number"]),
        fault(r#"{"robot": {"wheel_radius_m": null}}"#, FIELD, "#/robot/wheel_radius_m", &["null"]),
        fault(r#"{"robot": null}"#, FIELD, "#/robot", &["null", "an object"]),
        fault(r#"{"robot": [10.33]}"#, FIELD, "#/robot", &["list", "an object"]),
        fault(r#"{"initial_guess": null}"#, FIELD, "#/initial_guess", &["null"]),
        fault(r#"{"maneuver": {"goal": {"y_m": null}}}"#, FIELD, "#/maneuver/goal/y_m", &["null"]),
        fault(r#"{"maneuver": {"goal": {"free": "y_m"}}}"#, FIELD, "#/maneuver/goal/free", &["string", "a list"]),
        fault(r#"{"maneuver": {"goal": {"free": [1]}}}"#, FIELD, "#/maneuver/goal/free/0", &["integer `1`"]),
        fault(r#"{"grid": {"steps": 200.5}}"#, FIELD, "#/grid/steps", &["200.5"]),
        fault(r#"{"grid": {"steps": -1}}"#, FIELD, "#/grid/steps", &["-1"]),
        fault(r#"{"solver": {"method": "magic"}}"#, FIELD, "#/solver/method", &["magic", "\"nelder_mead\""]),
        fault(r#"{"solver": {"method": {"nelder_mead": null}}}"#, FIELD, "#/solver/method", &["object"]),
        fault(
            r#"{"initial_guess": {"final_time_s": 1}}"#,
            FIELD,
            "#/initial_guess/torque_left_n_m",
            &["missing field"],
        ),
        fault("[]", FIELD, "#", &["list", "an object"]),
        fault("null", FIELD, "#", &["null", "an object"]),
        fault("5", FIELD, "#", &["integer `5`", "an object"]),
    ]
}

fn value_faults() -> Vec<Fault> {
    vec![
        fault(
            r#"{"robot": {"chassis_mass_kg": -1}}"#,
            VALUE,
            "#/robot/chassis_mass_kg",
            &["is -1, must be between 0.001 and 100000 kg"],
        ),
        fault(
            r#"{"robot": {"wheel_radius_m": 0}}"#,
            VALUE,
            "#/robot/wheel_radius_m",
            &["is 0, must be between 0.001 and 10 m"],
        ),
        fault(
            r#"{"robot": {"tangential_restitution": 2}}"#,
            VALUE,
            "#/robot/tangential_restitution",
            &["is 2, must be between 0 and 1"],
        ),
        fault(
            r#"{"maneuver": {"torque_limit_left_n_m": -1}}"#,
            VALUE,
            "#/maneuver/torque_limit_left_n_m",
            &["is -1, must be between 0 and 1000000 N m"],
        ),
        fault(r#"{"maneuver": {"goal": {"free": ["speed"]}}}"#, VALUE, "#/maneuver/goal/free", &["\"speed\""]),
        fault(
            r#"{"maneuver": {"goal": {"y_m": 1, "free": ["y_m"]}}}"#,
            VALUE,
            "#/maneuver/goal/free",
            &["a field without a value"],
        ),
        fault(r#"{"maneuver": {"goal": {"free": ["y_m", "y_m"]}}}"#, VALUE, "#/maneuver/goal/free", &["named once"]),
        fault(r#"{"grid": {"steps": 0}}"#, VALUE, "#/grid/steps", &["is 0, must be >= 1"]),
        fault(r#"{"solver": {"time_limit_s": 0}}"#, VALUE, "#/solver/time_limit_s", &["is 0, must be > 0 s"]),
        fault(
            r#"{"initial_guess": {"final_time_s": 1, "torque_left_n_m": [0, 1e300], "torque_right_n_m": [0, 0]}}"#,
            VALUE,
            "#/initial_guess/torque_left_n_m/1",
            &["is 1e300, must be within the torque limit"],
        ),
        fault(r#"{"grid": {"steps": 1000000000}}"#, LARGE, "#/grid/steps", &["1000000000", "at most 10000"]),
        fault(r#"{"grid": {"steps": 18446744073709551615}}"#, LARGE, "#/grid/steps", &["at most 10000"]),
        fault(r#"{"solver": {"starts": 65}}"#, LARGE, "#/solver/starts", &["is 65, must be at most 64"]),
        fault(r#"{"solver": {"time_limit_s": 61}}"#, LARGE, "#/solver/time_limit_s", &["is 61, must be at most 60"]),
    ]
}

fn assert_refused(answer: &Answer, fault: &Fault) {
    assert_eq!(answer.status, fault.status, "{}: {}", fault.body, answer.text());
    let problem = answer.problem();
    assert_eq!(problem["code"], fault.code, "{}: {problem}", fault.body);
    let error = &problem["errors"][0];
    assert_eq!((&error["pointer"], &error["code"]), (&fault.pointer.into(), &fault.code.into()), "{problem}");
    let message = error["message"].as_str().unwrap();
    let path = fault.pointer.trim_start_matches(['#', '/']);
    let field = path.rsplit('/').find(|segment| segment.parse::<usize>().is_err()).unwrap_or("body");
    for part in fault.says.iter().copied().chain([field]) {
        assert!(message.contains(part) || field.is_empty(), "{part:?} is missing in: {message}");
    }
}

#[tokio::test]
async fn wrong_fields_are_named_with_pointer_and_rule() {
    let server = server().await;
    for fault in field_faults() {
        for path in ["/solve", "/validate"] {
            assert_refused(&server.post(path, fault.body.clone()).await, &fault);
        }
    }
}

#[tokio::test]
async fn wrong_values_are_named_with_pointer_and_rule() {
    let server = server().await;
    for fault in value_faults() {
        for path in ["/solve", "/validate"] {
            assert_refused(&server.post(path, fault.body.clone()).await, &fault);
        }
    }
}

#[tokio::test]
async fn limits_are_reported_as_numbers() {
    let problem = server().await.post("/solve", r#"{"grid": {"steps": 1000000000}}"#).await.problem();
    assert_eq!(problem["errors"][0]["limit"], 10_000.0);
}

#[tokio::test]
async fn all_value_violations_come_at_once() {
    let body = json!({
        "robot": {"chassis_mass_kg": -1, "wheel_radius_m": 0},
        "maneuver": {"torque_limit_right_n_m": -0.5, "goal": {"free": ["speed"]}},
        "grid": {"steps": 1_000_000_000},
        "solver": {"goal_tolerance": 0, "time_limit_s": -1},
    });
    let problem = server().await.post("/solve", body.to_string()).await.problem();
    let mut pointers: Vec<_> =
        problem["errors"].as_array().unwrap().iter().map(|error| error["pointer"].as_str().unwrap()).collect();
    pointers.sort_unstable();
    let expected = [
        "#/grid/steps",
        "#/maneuver/goal/free",
        "#/maneuver/torque_limit_right_n_m",
        "#/robot/chassis_mass_kg",
        "#/robot/wheel_radius_m",
        "#/solver/goal_tolerance",
        "#/solver/time_limit_s",
    ];
    assert_eq!(pointers, expected);
    assert_eq!(problem["code"], "invalid_value");
}

#[tokio::test]
async fn malformed_json_is_refused_with_line_and_column() {
    let server = server().await;
    let nested = format!(r#"{{"maneuver": {}"#, "{\"goal\":".repeat(100_000));
    let bodies = [
        ("", "it is empty"),
        ("{", "line 1 column 1"),
        ("{\"grid\":\n{,}}", "line 2 column 2"),
        (r#"{"robot": {"wheel_radius_m": 1e400}}"#, "number out of range at line 1"),
        (r#"{"robot": {"wheel_radius_m": NaN}}"#, "line 1"),
        ("{} {}", "trailing characters at line 1 column 4"),
        ("\u{feff}{}", "line 1 column 1"),
    ];
    for (body, says) in bodies {
        let answer = server.post("/solve", body).await;
        assert_eq!(answer.status, 400, "{body}: {}", answer.text());
        let problem = answer.problem();
        assert_eq!(problem["code"], "malformed_body");
        assert!(problem["detail"].as_str().unwrap().contains(says), "{body}: {problem}");
    }
    for (body, statuses) in [
        ("[".repeat(100_000), [400, 422].as_slice()),
        (format!(r#"{{"maneuver": {}"#, "[".repeat(100_000)), &[400, 422]),
        (nested, &[400, 413, 422]),
        ("{".repeat(100_000), &[400]),
    ] {
        let answer = server.post("/solve", body).await;
        assert!(statuses.contains(&answer.status), "{}", answer.text());
        answer.problem();
    }
    let not_utf8 = server.post("/solve", b"{\"\xff\": 1}".to_vec()).await;
    assert_eq!((not_utf8.status, not_utf8.problem()["code"].as_str()), (400, Some("malformed_body")));
}

#[tokio::test]
async fn body_above_the_limit_is_refused_whole_or_in_chunks() {
    let server = server().await;
    let limit = Limits::default().max_body_bytes;
    let largest = format!("{{}}{}", " ".repeat(limit - 2));
    assert_eq!(server.post("/validate", largest.clone()).await.status, 200);
    let declared = server.post("/validate", format!("{largest} ")).await;
    assert_eq!((declared.status, declared.problem()["code"].as_str()), (413, Some("body_too_large")));
    let chunked = raw_chunked(&server, limit + 1).await;
    assert!(chunked.starts_with("HTTP/1.1 413 "), "{chunked}");
    assert!(chunked.contains("application/problem+json") && chunked.contains("body_too_large"), "{chunked}");
}

/// Sends spaces in chunks, without a declared length, and reads the answer as text.
async fn raw_chunked(server: &TestServer, size: usize) -> String {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

    let mut stream = tokio::net::TcpStream::connect(server.address).await.unwrap();
    let head = "POST /validate HTTP/1.1\r\nhost: h\r\nconnection: close\r\ncontent-type: application/json\r\n\
                transfer-encoding: chunked\r\n\r\n";
    stream.write_all(head.as_bytes()).await.unwrap();
    stream.write_all(format!("{size:x}\r\n{}\r\n0\r\n\r\n", " ".repeat(size)).as_bytes()).await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    answer
}

#[tokio::test]
async fn other_media_types_are_refused() {
    let server = server().await;
    let request = || server.client.post(server.url("/solve")).body("{}");
    let cases = [
        request(),
        request().header("content-type", "text/plain"),
        request().header("content-type", "application/json; charset=utf-16"),
        request().header("content-type", "application/json").header("content-encoding", "gzip"),
    ];
    for case in cases {
        let answer = Answer::of(case).await;
        assert_eq!((answer.status, answer.problem()["code"].as_str()), (415, Some("unsupported_media")));
    }
}

#[tokio::test]
async fn motor_that_is_half_given_is_judged_all_the_same() {
    let server = server().await;
    let problem =
        server.post("/validate", r#"{"robot": {"motor_stall_torque_n_m": -5, "wheel_radius_m": 0}}"#).await.problem();
    let pointers: Vec<_> =
        problem["errors"].as_array().unwrap().iter().map(|error| error["pointer"].as_str().unwrap()).collect();
    let expected = ["motor_stall_torque_n_m", "motor_free_speed_rad_s", "wheel_radius_m"];
    assert_eq!(pointers, expected.map(|field| format!("#/robot/{field}")), "{problem}");
}

#[tokio::test]
async fn unknown_paths_and_methods_are_problems() {
    let server = server().await;
    let missing = server.get("/nowhere").await;
    assert_eq!((missing.status, missing.problem()["instance"].as_str()), (404, Some("/nowhere")));
    let wrong_method = server.get("/solve").await;
    assert_eq!((wrong_method.status, wrong_method.header("allow")), (405, "POST"));
    assert_eq!(wrong_method.problem()["code"], "method_not_allowed");
    let deleted = Answer::of(server.client.delete(server.url("/livez"))).await;
    assert_eq!((deleted.status, deleted.header("allow")), (405, "GET,HEAD"));
}

#[tokio::test]
async fn simulate_refuses_as_solve_does() {
    let server = server().await;
    let schedule = |interval: Value, left: Value, right: Value| {
        json!({"torque_schedule": {"interval_s": interval, "left_n_m": left, "right_n_m": right}}).to_string()
    };
    let with_steps =
        r#"{"grid": {"steps": 1}, "torque_schedule": {"interval_s": 1, "left_n_m": [0, 0], "right_n_m": [0, 0]}}"#;
    let faults = [
        fault("{}", FIELD, "#/torque_schedule", &["missing field"]),
        fault(
            schedule(json!(-1), json!([1]), json!([1])),
            VALUE,
            "#/torque_schedule/interval_s",
            &["-1", ">= 1e-12 s"],
        ),
        fault(schedule(json!(1), json!([1]), json!([1, 2])), VALUE, "#/torque_schedule/right_n_m", &["2 items long"]),
        fault(with_steps, VALUE, "#/grid/steps", &["is 1, must be at least"]),
        fault(
            schedule(json!(1), json!(vec![0; 1001]), json!([0])),
            LARGE,
            "#/torque_schedule/left_n_m",
            &["1001", "1000"],
        ),
    ];
    for fault in faults {
        let answer = server.post("/simulate", fault.body.clone()).await;
        let code = answer.problem()["errors"][0]["code"].clone();
        assert_eq!(code, fault.code, "{}", answer.text());
        if fault.code == "problem_too_large" {
            assert_eq!(answer.problem()["errors"][0]["limit"], 1000.0);
        } else {
            assert_refused(&answer, &fault);
        }
    }
}

#[tokio::test]
async fn defaults_that_break_rules_are_told_to_be_such() {
    let server = server().await;
    let message = async |grid: &str| {
        let problem = server.post("/solve", format!(r#"{{"grid": {grid}}}"#)).await.problem();
        problem["detail"].as_str().unwrap().to_owned()
    };
    let of_default = message(r#"{"steps": 10}"#).await;
    assert!(of_default.contains("is 40, must be at most grid.steps (10)"), "{of_default}");
    assert!(of_default.ends_with("; it was not given, this is its default"), "{of_default}");
    let given = message(r#"{"steps": 10, "control_intervals": 40}"#).await;
    assert!(!given.contains("default"), "{given}");
}

#[tokio::test]
async fn long_words_of_the_caller_are_not_echoed_in_full() {
    let server = server().await;
    let word = "x".repeat(100_000);
    for body in [format!(r#"{{"{word}": 1}}"#), format!(r#"{{"view": "{word}"}}"#)] {
        let answer = server.post("/solve", body).await;
        assert_eq!(answer.problem()["code"], "invalid_field");
        assert!(answer.bytes.len() < 3000, "{} bytes", answer.bytes.len());
    }
}

#[tokio::test]
async fn unknown_fields_are_answered_with_all_that_there_are() {
    let server = server().await;
    let word = "x".repeat(1_000);
    let document = server.get("/openapi.json").await.json();
    let fields = |object: &str| {
        let schema = &document["components"]["schemas"][object]["properties"];
        schema.as_object().unwrap().keys().map(|field| format!("`{field}`")).collect::<Vec<_>>()
    };
    for (path, object) in [("robot", "Robot"), ("solver", "Solver"), ("maneuver", "Maneuver")] {
        let answer = server.post("/solve", format!(r#"{{"{path}": {{"{word}": 1}}}}"#)).await;
        let detail = answer.problem()["detail"].as_str().unwrap().to_owned();
        let missing: Vec<_> = fields(object).into_iter().filter(|field| !detail.contains(field)).collect();
        assert!(missing.is_empty() && !detail.contains(&word), "{missing:?} in {detail}");
    }
}
