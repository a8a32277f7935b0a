//! Each number of an answer, and of a completed request, is in the field that names it.

use std::sync::{Arc, Mutex};

use nalgebra::SVector;
use serde_json::json;
use slipdrive::contact::{ContactMode, PerContact};
use slipdrive::motion::{ChangedParameter, EndShift, Sensitivity};
use slipdrive::robot::PerWheel;
use slipdrive::simulation::ContactSample;
use slipdrive::solver::{DistinctOptimum, LowerBoundAssumption, Replay, RunControl, Solution, SolveInput, StopReason};

use crate::support::{FakeSolver, TestServer, small_solution};

/// A solution in which every number of the report is another one.
fn numbered() -> Solution {
    let mut solution = small_solution(StopReason::Finished);
    solution.goal_error = SVector::from_fn(|row, _| 1e-3 * (row + 1) as f64);
    let report = &mut solution.report;
    report.predicted_decrease = 0.11;
    (report.lower_bound, report.lower_bound_assumption) = (Some(0.13), Some(LowerBoundAssumption::Friction));
    let shift = EndShift { distance: 0.21, angle: 0.22, separates: true };
    report.distinct_optima = vec![DistinctOptimum { final_time: 0.23, count: 24, friction_shift: Some(shift) }];
    report.sensitivity = vec![Sensitivity { parameter: ChangedParameter::Mass, change: 0.25, outcome: Ok(shift) }];
    report.replay = Some(Replay {
        step_count: 31,
        miss_position: 0.32,
        miss_heading: 0.33,
        miss_speed: 0.34,
        miss_yaw_rate: 0.35,
        miss_wheel_speed: 0.36,
        separations: 37,
        limit_excess: 0.38,
        within_tolerance: false,
    });
    let sample = |first: f64| ContactSample {
        normal_force: first,
        lateral_force: first + 0.1,
        longitudinal_force: first + 0.2,
        lateral_slip: first + 0.3,
        longitudinal_slip: first + 0.4,
        mode: ContactMode::Slip,
    };
    solution.trajectory.worst_contact_residual = 0.12;
    (solution.trajectory.time, solution.trajectory.degrees_of_freedom) = (vec![0.0, 1.0], vec![5]);
    solution.trajectory.contact = vec![PerContact { left: sample(1.0), right: sample(2.0), front: sample(3.0) }];
    solution
}

#[tokio::test]
async fn each_number_of_an_answer_is_in_the_field_that_names_it() {
    let server = TestServer::start(1, Arc::new(FakeSolver(|_: &SolveInput, _: &RunControl<'_>| numbered()))).await;
    let free = json!(["wheel_rate_left_rad_s"]);
    let goal = json!({"wheel_angle_left_rad": 1, "wheel_angle_right_rad": 2, "free": free});
    let answer = server.post("/solve", json!({"maneuver": {"goal": goal}}).to_string()).await.json();
    let error = &answer["goal_error"];
    for (place, field) in [
        "x_m",
        "y_m",
        "heading_rad",
        "wheel_angle_left_rad",
        "wheel_angle_right_rad",
        "velocity_x_m_s",
        "velocity_y_m_s",
        "yaw_rate_rad_s",
        "wheel_rate_left_rad_s",
        "wheel_rate_right_rad_s",
    ]
    .into_iter()
    .enumerate()
    {
        assert_eq!(error[field], json!(1e-3 * (place + 1) as f64), "{field}");
    }
    let report = &answer["report"];
    for (pointer, value) in [
        ("/predicted_decrease_s", json!(0.11)),
        ("/worst_contact_residual", json!(0.12)),
        ("/lower_bound_s", json!(0.13)),
        ("/distinct_optima/0/final_time_s", json!(0.23)),
        ("/distinct_optima/0/count", json!(24)),
        ("/distinct_optima/0/friction_shift_m", json!(0.21)),
        ("/distinct_optima/0/friction_shift_rad", json!(0.22)),
        ("/sensitivity/0/change", json!(0.25)),
        ("/sensitivity/0/end_shift_m", json!(0.21)),
        ("/sensitivity/0/end_shift_rad", json!(0.22)),
        ("/replay/steps", json!(31)),
        ("/replay/miss_m", json!(0.32)),
        ("/replay/miss_heading_rad", json!(0.33)),
        ("/replay/miss_speed_m_s", json!(0.34)),
        ("/replay/miss_yaw_rate_rad_s", json!(0.35)),
        ("/replay/miss_wheel_speed_m_s", json!(0.36)),
        ("/replay/separations", json!(37)),
    ] {
        assert_eq!(report.pointer(pointer), Some(&value), "{pointer}");
    }
    for (contact, first) in [("left", 1.0), ("right", 2.0), ("front", 3.0)] {
        for (further, field) in [
            (0.0, "normal_force_n"),
            (0.1, "lateral_force_n"),
            (0.2, "longitudinal_force_n"),
            (0.3, "lateral_slip_m_s"),
            (0.4, "longitudinal_slip_m_s"),
        ] {
            assert_eq!(answer["contacts"][contact][field], json!([first + further]), "{contact} {field}");
        }
    }
}

#[tokio::test]
async fn each_wheel_and_each_tolerance_has_the_number_that_was_given() {
    let seen: Arc<Mutex<Vec<SolveInput>>> = Arc::default();
    let noted = Arc::clone(&seen);
    let solver = FakeSolver(move |input: &SolveInput, _: &RunControl<'_>| {
        noted.lock().unwrap().push(input.clone());
        small_solution(StopReason::Finished)
    });
    let server = TestServer::start(1, Arc::new(solver)).await;
    let body = json!({
        "maneuver": {"goal": {"y_m": 1}, "torque_limit_left_n_m": 0.5, "torque_limit_right_n_m": 2},
        "solver": {"replay_tolerance_m": 0.011, "replay_tolerance_rad": 0.022, "goal_tolerance": 1e-7},
    });
    assert_eq!(server.post("/solve", body.to_string()).await.status, 200);
    let input = seen.lock().unwrap()[0].clone();
    assert_eq!(input.maneuver.torque_limit, PerWheel::new(0.5, 2.0));
    let settings = input.settings;
    assert_eq!(
        (settings.replay_tolerance_position, settings.replay_tolerance_heading, settings.goal_tolerance),
        (0.011, 0.022, 1e-7)
    );
    let completed = server.post("/validate", body.to_string()).await.json();
    assert_eq!(completed["maneuver"]["torque_limit_left_n_m"], 0.5);
    assert_eq!(
        (&completed["solver"]["replay_tolerance_m"], &completed["solver"]["replay_tolerance_rad"]),
        (&json!(0.011), &json!(0.022))
    );
}
