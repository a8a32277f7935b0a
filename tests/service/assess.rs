//! How often plans succeed: closed forms, the worst sample as a simulation, any number of workers, refusals, both transports.

use std::num::NonZeroUsize;
use std::sync::Arc;

use futures_util::stream;
use serde_json::{Value, json};
use slipdrive::api::grpc::pb;
use slipdrive::contract::json as wire;
use slipdrive::jobs::assess::Assess;
use slipdrive::jobs::{Jobs, Kind as _, Limits};
use slipdrive::service::{Class, Service, ServiceSettings};

use crate::support::protobuf::{code_of, fields_of};
use crate::support::{TestServer, real_solver};

/// A straight drive without slip of 0.8 m from rest to rest.
fn straight() -> Value {
    let torques = json!({"interval_s": 1, "left_n_m": [0.3, -0.3], "right_n_m": [0.3, -0.3]});
    let request = json!({"robot": {"center_of_mass_right_m": 0}, "torque_schedule": torques, "grid": {"steps": 40},
                         "reference_point": "axle_midpoint"});
    json!({"simulate": {"request": request, "answer": {}}})
}

/// The paper's plan on the paper's grid.
fn drifting() -> Value {
    let schedule: Value = serde_json::from_str(include_str!("../data/schedules/drifting.json")).unwrap();
    json!({"simulate": {"request": {"torque_schedule": schedule}, "answer": {}}})
}

fn body(plan: &Value, further: &Value) -> Value {
    let mut body = plan.clone();
    body.as_object_mut().unwrap().extend(further.as_object().unwrap().clone());
    body
}

/// The answer, the same by both transports, alone and in a batch.
async fn assessed(server: &TestServer, body: &Value) -> Value {
    let answer = server.post("/assess", body.to_string()).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    let rest = answer.json();
    let message: pb::AssessRequest = serde_json::from_value(body.clone()).unwrap();
    let mut client = server.grpc().await;
    let grpc = client.assess(message.clone()).await.unwrap().into_inner();
    assert_eq!(rest, serde_json::to_value(&grpc).unwrap());
    let request = Some(pb::batch_request::Request::Assess(message));
    let item = pb::BatchRequest { request_id: "one".to_owned(), request, timeout_ms: None };
    let mut answers = client.batch(stream::iter([item])).await.unwrap().into_inner();
    let Some(pb::batch_response::Answer::Assess(batched)) = answers.message().await.unwrap().unwrap().answer else {
        panic!("no assessment")
    };
    assert_eq!(rest, serde_json::to_value(&batched).unwrap());
    rest
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[tokio::test]
async fn heading_of_a_straight_drive_decides_by_its_sine() {
    let server = TestServer::start(4, real_solver()).await;
    let simulated = server.post("/simulate", straight()["simulate"]["request"].to_string()).await.json();
    let distance = number(&simulated["end_state"]["y_m"]);
    let uncertain = json!([{"parameter": "start_heading", "low": 0.05, "high": 0.05},
                           {"parameter": "friction", "low": -0.1, "high": 0.1}]);
    let further = json!({"uncertain": uncertain, "tolerances": {"across_m": 0.03}, "samples": 100});
    let answer = assessed(&server, &body(&straight(), &further)).await;
    // Sums of some dozen numbers of the size of the distance.
    assert!((number(&answer["mean"]["across_m"]) - distance * 0.05_f64.sin()).abs() < 1e-12, "{answer}");
    assert!((number(&answer["mean"]["along_m"]) - distance * (0.05_f64.cos() - 1.0)).abs() < 1e-12, "{answer}");
    assert_eq!((&answer["successes"], &answer["samples"], &answer["steps"]), (&json!(0), &json!(100), &json!(40)));
    assert_eq!((&answer["nominal_success"], &answer["nominal"]["distance_m"]), (&json!(true), &json!(0.0)));
    assert_eq!(answer["quantiles"].as_array().unwrap().len(), 6);
    // All samples end alike: nothing varies.
    assert_eq!(answer["shares"][1]["across"], Value::Null, "{answer}");
}

#[tokio::test]
async fn answer_to_another_request_is_refused() {
    let server = TestServer::start(4, real_solver()).await;
    let mut plan = straight();
    let simulated = server.post("/simulate", plan["simulate"]["request"].to_string()).await.json();
    plan["simulate"]["answer"] = json!({"end_state": simulated["end_state"]});
    let uncertain = json!([{"parameter": "friction", "low": -0.1, "high": 0.1}]);
    let further = json!({"uncertain": uncertain, "tolerances": {"across_m": 0.03}, "samples": 10});
    assert_eq!(assessed(&server, &body(&plan, &further)).await["samples"], 10);
    plan["simulate"]["request"]["robot"]["wheel_radius_m"] = json!(0.08);
    let refused = server.post("/assess", body(&plan, &further).to_string()).await;
    assert_eq!((refused.status, &refused.problem()["errors"][0]["pointer"]), (422, &json!("#/simulate/answer")));
    assert!(refused.text().contains("request and answer do not belong together"), "{}", refused.text());
}

#[tokio::test]
async fn worst_sample_is_a_simulation_that_ends_as_told() {
    let server = TestServer::start(4, real_solver()).await;
    let normal = |name: &str, size: f64| json!({"parameter": name, "mean": 0, "standard_deviation": size});
    let band = |name: &str, size: f64| json!({"parameter": name, "low": -size, "high": size});
    let uncertain = json!([
        normal("friction", 0.05), band("mass", 0.05), band("payload_mass", 0.5), band("payload_right", 0.01),
        band("payload_forward", 0.02), normal("center_of_mass_right", 0.002), normal("center_of_mass_forward", 0.002),
        band("torque", 0.02), band("torque_left", 0.01), normal("torque_right", 0.01), band("start_x", 0.01),
        normal("start_y", 0.01), normal("start_heading", 0.01), {"parameter": "delay_left", "low": 0, "high": 0.03},
        {"parameter": "delay_right", "low": 0, "high": 0.03},
    ]);
    let mut plan = drifting()["simulate"]["request"].clone();
    let end = |simulated: &Value, field: &str| number(&simulated["end_state"][field]);
    // The plan's own end at the axle midpoint, which the robot without load starts 7 cm behind its centre of mass.
    plan["reference_point"] = json!("axle_midpoint");
    plan["start"] = json!({"x_m": 0.02, "y_m": -0.07});
    let planned = server.post("/simulate", plan.to_string()).await.json();
    // On the plan's own grid to rounding, which a drift makes some thousand times larger; on one of more steps than a request may have
    // intervals some of them share a mean torque.
    for (tolerance, apart, is_fine) in [(10.0, 1e-9, false), (0.3, 1e-4, true)] {
        let further = json!({"uncertain": uncertain, "tolerances": {"distance_m": tolerance, "heading_rad": 0.5},
                             "samples": 200, "payload": {"mass_kg": 1, "forward_m": 0.1, "height_m": 0.1}, "seed": 5});
        let answer = assessed(&server, &body(&drifting(), &further)).await;
        assert_eq!(answer["steps"].as_u64().unwrap() > 1000, is_fine, "{}", answer["steps"]);
        let worst = &answer["worst"];
        assert_eq!(worst["changes"].as_array().unwrap().len(), 15);
        assert_eq!(answer["quantiles"][5]["share"], 1.0);
        let simulated = server.post("/simulate", worst["simulate"].to_string()).await.json();
        let away = (end(&simulated, "x_m") - end(&planned, "x_m")).hypot(end(&simulated, "y_m") - end(&planned, "y_m"));
        let errors = &worst["errors"];
        assert!((away - number(&errors["distance_m"])).abs() < apart, "{away} {errors}");
        let turned = number(&errors["heading_rad"]);
        let relative = (number(&errors["distance_m"]) / tolerance).max(turned.abs() / 0.5);
        assert_eq!(number(&worst["relative_error"]), relative);
    }
}

#[tokio::test]
async fn solved_plan_is_compared_with_its_goal_and_its_limits() {
    let server = TestServer::start(4, real_solver()).await;
    let request = json!({"maneuver": {"goal": {"y_m": 3}, "limits": {"grip_utilization": 0.9, "speed_m_s": 1.5}},
                         "grid": {"steps": 60, "control_intervals": 12}, "solver": {"starts": 1}, "view": "plan"});
    let answer = server.post("/solve", request.to_string()).await.json();
    assert_eq!(answer["status"], "converged", "{answer}");
    let plan = json!({"solve": {"request": request, "answer": answer}});
    let further = json!({"uncertain": [{"parameter": "friction", "low": -0.2, "high": 0}], "samples": 200,
                         "tolerances": {"distance_m": 1e-3}});
    let answer = assessed(&server, &body(&plan, &further)).await;
    assert!(number(&answer["nominal"]["distance_m"]) < 1e-5, "{answer}");
    // The margin is enough for about half of the floors; beyond, the grip that is asked for is not there.
    let rate = number(&answer["success_rate"]);
    assert!((0.5..0.9).contains(&rate), "{answer}");
    let [grip, speed] = answer["limits"].as_array().unwrap().as_slice() else { panic!("{answer}") };
    assert_eq!(
        (&grip["limit"], &speed["limit"]),
        (&json!("maneuver.limits.grip_utilization"), &json!("maneuver.limits.speed_m_s"))
    );
    assert!(number(&grip["samples"]) > 100.0 && number(&speed["samples"]) < 100.0, "{answer}");
}

#[tokio::test]
async fn worst_sample_can_be_judged_by_the_aisle_of_the_plan() {
    let server = TestServer::start(4, real_solver()).await;
    let mut plan = straight();
    let point = |[x_m, y_m]: [f64; 2]| json!({"x_m": x_m, "y_m": y_m});
    let corner = |[right_m, forward_m]: [f64; 2]| json!({"right_m": right_m, "forward_m": forward_m});
    let footprint = json!([[-0.2, -0.1], [0.2, -0.1], [0.2, 0.3], [-0.2, 0.3]].map(corner));
    let keep_in = json!([[-0.22, -1.0], [0.22, -1.0], [0.22, 3.0], [-0.22, 3.0]].map(point));
    plan["simulate"]["request"]["robot"]["footprint"] = footprint.clone();
    plan["simulate"]["request"]["keep_in"] = keep_in.clone();
    let further = json!({"uncertain": [{"parameter": "start_heading", "low": 0.1, "high": 0.1}], "samples": 1,
                         "tolerances": {"distance_m": 0.1}});
    let triangle = [[-0.3, -0.1], [0.3, -0.1], [0.0, 0.3]].map(corner);
    let wider = json!({"footprint": triangle, "center_of_mass_right_m": 0});
    // That of the robot which drives the plan, where it is another one.
    for (own, footprint) in [(None, &footprint), (Some(&wider), &wider["footprint"])] {
        let mut body = body(&plan, &further);
        if let Some(own) = own {
            body["robot"] = own.clone();
        }
        let mut worst = assessed(&server, &body).await["worst"]["simulate"].take();
        assert_eq!(&worst["robot"]["footprint"], footprint);
        worst["keep_in"] = keep_in.clone();
        let simulated = server.post("/simulate", worst.to_string()).await;
        assert_eq!(simulated.status, 200, "{}", simulated.text());
        let used = &simulated.json()["limits"][0];
        assert!(used["limit"] == "keep_in" && number(&used["excess"]) > 0.0, "{used}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn any_number_of_workers_gives_the_same_bytes() {
    let further = json!({"uncertain": [{"parameter": "friction", "mean": 0, "standard_deviation": 0.1},
                                       {"parameter": "mass", "low": -0.1, "high": 0.1}],
                         "tolerances": {"distance_m": 0.1}, "samples": 300, "seed": 11});
    let body = body(&drifting(), &further).to_string();
    let mut answers = Vec::new();
    for workers in [1, 4] {
        let workers = NonZeroUsize::new(workers).unwrap();
        let service = Service::start(ServiceSettings { workers, ..ServiceSettings::default() }).unwrap();
        let jobs = Jobs::new(Limits::default(), real_solver(), service.metrics());
        let accepted = Assess::read(body.as_bytes(), jobs.limits()).unwrap();
        let answer = |accepted: &_, done: &_| wire::write(&Assess::answer(accepted, done));
        let running = service.reserve(Class::Heavy).unwrap().submit(Arc::clone(&jobs.assess), accepted, None, answer);
        answers.push(running.unwrap().outcome().await.unwrap());
    }
    assert!(answers[0] == answers[1]);
}

#[tokio::test]
async fn what_makes_no_sense_is_refused_by_name() {
    let server = TestServer::start(4, real_solver()).await;
    let tolerances = json!({"distance_m": 0.1});
    let of = |uncertain: Value| body(&straight(), &json!({"uncertain": uncertain, "tolerances": tolerances}));
    // Its start is its goal.
    let still = json!({"solve": {"request": {}, "answer": server.post("/solve", "{}").await.json()}});
    let mut long = straight();
    long["simulate"]["request"]["grid"]["steps"] = json!(10_000);
    let mut short = straight();
    short["simulate"]["request"]["torque_schedule"]["interval_s"] = json!(1e-3);
    let mass = json!([{"parameter": "mass", "low": 0, "high": 0}]);
    let further = json!({"uncertain": mass, "tolerances": tolerances});
    let cases = [
        (of(json!([])), "#/uncertain", "0 items long"),
        (of(json!([{"parameter": "luck", "low": 0, "high": 0}])), "#/uncertain/0/parameter", "luck"),
        (of(json!([{"low": 0, "high": 0}])), "#/uncertain/0/parameter", "missing field"),
        (of(json!([{"parameter": "mass", "low": 0}])), "#/uncertain/0/parameter", "given with low"),
        (
            of(json!([{"parameter": "mass", "low": 0, "high": 1, "mean": 0}])),
            "#/uncertain/0/parameter",
            "low, high, mean",
        ),
        (of(json!([{"parameter": "mass", "low": 0.2, "high": 0.1}])), "#/uncertain/0/low", "at most `high` (0.1)"),
        (of(json!([{"parameter": "mass", "low": -11, "high": 0.1}])), "#/uncertain/0/low", "between -10 and 10"),
        (
            of(json!([{"parameter": "mass", "mean": 0, "standard_deviation": -1}])),
            "#/uncertain/0/standard_deviation",
            "between 0",
        ),
        (of(json!([mass[0], mass[0]])), "#/uncertain/1/parameter", "not given before"),
        (of(json!([{"parameter": "payload_mass", "low": 0, "high": 0}])), "#/uncertain/0/parameter", "payload"),
        (of(json!([{"parameter": "delay_left", "low": -0.1, "high": 0}])), "#/uncertain/0/low", "between 0 and 10 s"),
        (
            body(
                &short,
                &json!({"uncertain": [{"parameter": "delay_left", "mean": 0, "standard_deviation": 0.5}],
                        "tolerances": tolerances}),
            ),
            "#/uncertain/0/standard_deviation",
            "four standard deviations",
        ),
        (body(&straight(), &json!({"uncertain": mass, "tolerances": {}})), "#/tolerances", "at least one"),
        (body(&straight(), &json!({"uncertain": mass})), "#/tolerances", "missing field"),
        (body(&straight(), &json!({"tolerances": tolerances})), "#/uncertain", "missing field"),
        (body(&still, &further), "#/solve/answer/torque_schedule", "a plan that moves"),
        (body(&body(&long, &further), &json!({"samples": 2001})), "#/samples", "at most 2000"),
        (
            body(&body(&straight(), &further), &json!({"robot": {"chassis_mass_kg": -1}})),
            "#/robot/chassis_mass_kg",
            "-1",
        ),
        (further.clone(), "#", "neither `solve` nor `simulate`"),
    ];
    for (body, pointer, words) in cases {
        let problem = server.post("/assess", body.to_string()).await.problem();
        let error = &problem["errors"][0];
        assert_eq!((&problem["status"], &error["pointer"]), (&422.into(), &pointer.into()), "{problem}");
        assert!(error["message"].as_str().unwrap().contains(words), "{problem}");
    }
    // The robot of the plan is another field than that of the assessment.
    let mut wrong = straight();
    wrong["simulate"]["request"]["robot"]["wheel_radius_m"] = json!(0);
    let problem = server.post("/assess", body(&wrong, &further).to_string()).await.problem();
    let expected = "`simulate.request.robot.wheel_radius_m` is 0, must be between 0.001 and 10 m";
    assert_eq!((&problem["detail"], &problem["errors"][0]["message"]), (&expected.into(), &expected.into()));
    // All at once, of the plan too.
    let mut wrong = straight();
    wrong["simulate"]["request"]["grid"]["steps"] = json!(0);
    let further = json!({"uncertain": [{"parameter": "mass", "low": 20, "high": 21}], "tolerances": {"along_m": -1}, "samples": 0});
    let further = body(&further, &json!({"robot": {"wheel_radius_m": 0}, "payload": {"mass_kg": -1, "height_m": 0.1}}));
    let problem = server.post("/assess", body(&wrong, &further).to_string()).await.problem();
    let pointers = problem["errors"].as_array().unwrap().iter().map(|error| error["pointer"].as_str().unwrap());
    let expected = [
        "#/samples",
        "#/tolerances/along_m",
        "#/uncertain/0/low",
        "#/uncertain/0/high",
        "#/robot/wheel_radius_m",
        "#/payload/mass_kg",
        // No step, and fewer than torques.
        "#/simulate/request/grid/steps",
        "#/simulate/request/grid/steps",
    ];
    assert_eq!(pointers.collect::<Vec<_>>(), expected);
}

#[tokio::test]
async fn numbers_that_json_does_not_have_are_refused_over_grpc() {
    let server = TestServer::start(4, real_solver()).await;
    let further = json!({"uncertain": [{"parameter": "mass", "low": 0, "high": 0}], "tolerances": {"distance_m": 0.1}});
    let message: pb::AssessRequest = serde_json::from_value(body(&straight(), &further)).unwrap();
    let uncertain = |parameter, low| {
        vec![pb::Uncertainty { parameter, low: Some(low), high: Some(0.0), ..pb::Uncertainty::default() }]
    };
    let tolerances = Some(pb::Tolerances { distance_m: Some(f64::NAN), ..pb::Tolerances::default() });
    for (message, field, code) in [
        (pb::AssessRequest { tolerances, ..message.clone() }, "tolerances.distance_m", "invalid_value"),
        (
            pb::AssessRequest { uncertain: uncertain(2, f64::NAN), ..message.clone() },
            "uncertain[0].low",
            "invalid_value",
        ),
        (
            pb::AssessRequest { uncertain: uncertain(99, 0.0), ..message.clone() },
            "uncertain[0].parameter",
            "invalid_field",
        ),
        (
            pb::AssessRequest { uncertain: uncertain(0, 0.0), ..message.clone() },
            "uncertain[0].parameter",
            "invalid_field",
        ),
        (pb::AssessRequest { tolerances: None, ..message }, "tolerances", "invalid_field"),
    ] {
        let status = server.grpc().await.assess(message).await.unwrap_err();
        assert_eq!((code_of(&status).as_str(), fields_of(&status)[0].as_str()), (code, field));
    }
}
