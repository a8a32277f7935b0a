//! What an answer claims, requirement by requirement.

use super::*;
use crate::contact::PerContact;
use crate::shooting::{Goal, decision_len};
use crate::solver::settings::SolveParameters;

#[test]
fn a_certificate_that_is_cut_off_counts_every_torque() {
    let decision = DVector::from_element(decision_len(40), 1.5);
    let unknown = Optimality::unknown(&decision);
    assert_eq!((unknown.measure, unknown.is_stationary, unknown.sign_violations), (1.5, false, 80));
}

#[test]
fn an_end_that_is_not_a_number_misses_the_goal() {
    let input = SolveInput::new(SolveParameters::forward_drive()).unwrap();
    let end = Trajectory::default();
    let goal_error = input.maneuver.goal_error(&end.end_state).map(|_| f64::NAN);
    let (schedule, limits) = (TorqueSchedule::empty(), Vec::new());
    let motion = Motion { schedule, trajectory: end, goal_error, limits };
    let reason = motion.missed(&input, StopReason::Finished).unwrap();
    assert!(reason.field.starts_with("maneuver.goal.") && reason.value.is_nan(), "{reason:?}");
}

#[test]
fn a_standstill_is_refined_where_its_replay_is_within_tolerance() {
    for (goal_tolerance, outcome) in [(1.0, RefinementOutcome::StepLimit), (1e-6, RefinementOutcome::WithinTolerance)] {
        let mut parameters = SolveParameters::default();
        parameters.settings.goal_tolerance = goal_tolerance;
        parameters.maneuver.goal = Goal::at_rest(0.0, goal_tolerance, 0.0);
        let solution = certified_standstill(&SolveInput::new(parameters).unwrap());
        assert_eq!((solution.status, solution.report.refinement), (Status::Converged, outcome));
        assert_eq!(solution.replay_confirmed, outcome == RefinementOutcome::WithinTolerance);
    }
}

#[test]
fn a_replay_misses_fixed_wheel_angles_by_the_rim() {
    let mut parameters = SolveParameters::default();
    // The start, at rest with all angles 0, meets the goal by this alone.
    parameters.settings.goal_tolerance = 0.1;
    parameters.maneuver.goal = Goal::at_rest(0.0, 0.0, 0.0);
    parameters.maneuver.goal.set(StateComponent::WheelAngleRight, Some(0.1));
    let solution = certified_standstill(&SolveInput::new(parameters).unwrap());
    // 0.1 rad of a wheel of 60 mm, with a tolerance of 1 mm.
    assert_eq!((solution.report.replay.unwrap().miss_position, solution.replay_confirmed), (0.06 * 0.1, false));
}

#[test]
fn a_plan_gains_no_more_than_its_final_time() {
    for beyond in [7953.0, 1.8e145, f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
        assert_eq!(decrease_within(beyond, 24.0), 24.0);
    }
    assert_eq!([0.5, 0.0, -2e-14].map(|predicted| decrease_within(predicted, 24.0)), [0.5, 0.0, 2e-14]);
}

/// What is claimed of a plan of one step that meets its goal and all limits, after it was spoiled.
fn claims(spoil: impl Fn(&mut SolveInput, &mut Motion, &mut Optimality, &mut Replayed)) -> (Status, bool) {
    use crate::contact::ContactMode;
    use crate::simulation::ContactSample;

    let mut input = SolveInput::forward_drive();
    let at_rest = input.robot.normal_force_projection().static_force;
    let sample = |contact: usize| ContactSample {
        normal_force: at_rest[contact],
        lateral_force: 0.0,
        longitudinal_force: 0.0,
        lateral_slip: 0.0,
        longitudinal_slip: 0.0,
        mode: ContactMode::Stick,
    };
    let trajectory = Trajectory {
        time: vec![0.0, 1.0],
        state: vec![State::default(); 2],
        contact: vec![PerContact::from_array([0, 1, 2].map(sample))],
        degrees_of_freedom: vec![2],
        ..Trajectory::default()
    };
    let schedule = TorqueSchedule { final_time: 1.0, left: vec![0.0], right: vec![0.0] };
    let mut motion = Motion { schedule, trajectory, goal_error: SVector::zeros(), limits: Vec::new() };
    let mut optimality = Optimality { measure: 0.0, is_stationary: true, sign_violations: 0 };
    let replay = replay_of_miss(&input, &SVector::zeros(), (16, 0, 0.0));
    let mut replayed = Replayed { replay, limits: Vec::new() };
    spoil(&mut input, &mut motion, &mut optimality, &mut replayed);
    let bound = largest_lower_bound(&input, Grid::Steps(1));
    let shown = Certificate { bound, replayed, sensitivity: Vec::new(), indeterminate_steps: 0 };
    let solution = motion.solution(&input, SearchResult::default(), (optimality, Some(shown)));
    (solution.status, solution.replay_confirmed)
}

fn used(excess: f64) -> LimitUse {
    LimitUse { limit: "maneuver.limits.speed_m_s", value: 1.0, largest: 1.0, time: 0.5, excess, replay_excess: None }
}

#[test]
fn each_requirement_by_itself_takes_a_claim_away() {
    use crate::contact::ContactMode::Slip;
    use crate::shooting::SlipPolicy::Forbidden;

    assert_eq!(claims(|_, _, _, _| {}), (Status::Converged, true));
    assert_eq!(claims(|_, _, optimality, _| optimality.is_stationary = false), (Status::Feasible, true));
    let residual = |value: f64| claims(move |_, motion, _, _| motion.trajectory.worst_contact_residual = value);
    assert_eq!(
        [0.9, 1.1, f64::NAN].map(|of| residual(of * LAW_ERROR).0),
        [Status::Converged, Status::Feasible, Status::Feasible]
    );
    // Less than each contact has to carry, but no pull.
    for contact in 0..3 {
        let share = |share: f64| {
            claims(move |input, motion, _, _| {
                input.maneuver.limits.normal_load_share = 0.02;
                let weight = motion.trajectory.contact[0].sum(|sample| sample.normal_force);
                let PerContact { left, right, front } = &mut motion.trajectory.contact[0];
                [left, right, front][contact].normal_force = share * weight;
            })
        };
        assert_eq!([0.001, 0.2].map(share), [(Status::Feasible, true), (Status::Converged, true)], "{contact}");
    }
    for wheel in [0, 1] {
        let slips = |is_forbidden: bool| {
            claims(move |input, motion, _, _| {
                if is_forbidden {
                    input.maneuver.slip = Forbidden;
                }
                let step = &mut motion.trajectory.contact[0];
                [&mut step.left, &mut step.right][wheel].mode = Slip;
            })
        };
        assert_eq!([true, false].map(slips), [(Status::Feasible, true), (Status::Converged, true)], "{wheel}");
    }
    let pulls = claims(|_, motion, _, _| motion.trajectory.contact[0].front.normal_force = -0.1);
    assert_eq!(pulls, (Status::Feasible, false));
    assert_eq!(claims(|_, motion, _, _| motion.goal_error[1] = 1e-3), (Status::NotConverged, false));
    assert_eq!(claims(|_, motion, _, _| motion.limits = vec![used(1e-5)]), (Status::NotConverged, false));
    assert_eq!(claims(|_, motion, _, _| motion.limits = vec![used(1e-7)]), (Status::Converged, true));
    assert_eq!(claims(|_, _, _, replayed| replayed.replay.within_tolerance = false), (Status::Converged, false));
}

#[test]
fn each_miss_of_a_replay_is_judged_by_its_tolerance() {
    use StateComponent::{Heading, VelocityX, VelocityY, WheelAngleLeft, WheelAngleRight, WheelRateLeft};
    use StateComponent::{WheelRateRight, X, Y, YawRate};

    let mut input = SolveInput::forward_drive();
    input.settings.replay_tolerance_position = 1e-3;
    input.settings.replay_tolerance_heading = 2e-3;
    let radius = input.robot.parameters().wheel_radius;
    // Speeds are judged by where they lead in a second.
    for (component, largest) in [
        (X, 1e-3),
        (Y, 1e-3),
        (Heading, 2e-3),
        (WheelAngleLeft, 1e-3 / radius),
        (WheelAngleRight, 1e-3 / radius),
        (VelocityX, 1e-3),
        (VelocityY, 1e-3),
        (YawRate, 2e-3),
        (WheelRateLeft, 1e-3 / radius),
        (WheelRateRight, 1e-3 / radius),
    ] {
        let of = |share: f64| {
            let mut miss = SVector::zeros();
            miss[component.index()] = -share * largest;
            replay_of_miss(&input, &miss, (16, 0, 0.0)).within_tolerance
        };
        assert_eq!([0.99, 1.01].map(of), [true, false], "{component:?}");
    }
    let of =
        |separations, excess| replay_of_miss(&input, &SVector::zeros(), (16, separations, excess)).within_tolerance;
    assert_eq!([of(0, 0.99 * REPLAY_EXCESS), of(1, 0.0), of(0, 1.01 * REPLAY_EXCESS)], [true, false, false]);
}

#[test]
fn a_limit_is_told_with_its_excess_on_the_finer_grid() {
    let input = SolveInput::forward_drive();
    let replay = replay_of_miss(&input, &SVector::zeros(), (16, 0, 0.01));
    let trajectory = Trajectory { time: vec![0.0], state: vec![State::default()], ..Trajectory::default() };
    let limits = vec![used(-0.1), used(-0.2)];
    let motion = Motion { schedule: TorqueSchedule::empty(), trajectory, goal_error: SVector::zeros(), limits };
    let shown = Certificate {
        bound: largest_lower_bound(&input, Grid::Steps(1)),
        replayed: Replayed { replay, limits: vec![used(0.03), used(0.04)] },
        sensitivity: Vec::new(),
        indeterminate_steps: 0,
    };
    let optimality = Optimality { measure: 0.0, is_stationary: true, sign_violations: 0 };
    let solution = motion.solution(&input, SearchResult::default(), (optimality, Some(shown)));
    let told = solution.report.limits.iter().map(|used| (used.excess, used.replay_excess));
    assert_eq!(told.collect::<Vec<_>>(), [(-0.1, Some(0.03)), (-0.2, Some(0.04))]);
}
