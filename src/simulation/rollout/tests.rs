//! How often rollouts ask whether they are stopped, with robots whose friction is hard to resolve.

use super::*;
use crate::robot::unlucky::short_track;
use crate::robot::{Configuration, PerWheel, RobotParameters};
use crate::simulation::{EndSensitivity, FrictionLaw};
use crate::stop::probe;

const STEPS: usize = 30;

fn schedule() -> TorqueSchedule {
    let repeated = |torques: [f64; 4]| torques.into_iter().cycle().take(STEPS).collect();
    let (left, right) = (repeated([-0.252, 0.169, 0.551, 0.803]), repeated([1.893, 1.769, -1.166, -1.366]));
    TorqueSchedule { final_time: 8.71 * STEPS as f64, left, right }
}

/// A rollout of a robot with its simulator.
fn with_rollout<T>(robot: RobotParameters, run: impl FnOnce(&Simulator, &Rollout) -> T) -> T {
    let simulator = Simulator::new(&Robot::new(robot).unwrap());
    let (start, schedule) = (State::default(), schedule());
    run(&simulator, &Rollout { start: &start, schedule: &schedule, step_count: STEPS })
}

fn model(simulator: &Simulator) -> &StepModel<5> {
    let Model::WheelsAndFront(model) = &simulator.model else { panic!("the front support has friction") };
    model
}

#[test]
fn rollout_asks_at_each_step() {
    with_rollout(short_track(), |simulator, rollout| {
        let steps_until = |last: u64| {
            let mut steps = 0_usize;
            let run = |stop: Stop| integrate(model(simulator), rollout, exactly, stop, |_, _| steps += 1);
            let (end, asked) = probe::stopped_at(last, run);
            (end, asked, steps)
        };
        let (end, asked, steps) = steps_until(0);
        assert!(end.is_ok() && steps == STEPS && asked >= STEPS as u64, "{asked}");
        let mut before = 0;
        for last in 1..=asked {
            let (end, _, steps) = steps_until(last);
            assert_eq!(end, Err(Stopped), "question {last}");
            assert!(steps <= before + 1, "{} steps between two questions", steps - before);
            before = steps;
        }
        assert_eq!(before, STEPS - 1, "a rollout stopped at its last step is none either");
    });
}

#[test]
fn fixed_point_asks_every_64_sweeps() {
    with_rollout(short_track(), |simulator, rollout| {
        let sweeps_until = |last: u64| {
            let mut solver = FixedPointSolver::new(2000);
            let run =
                |stop: Stop| integrate(model(simulator), rollout, by_fixed_point(&mut solver, stop), stop, |_, _| {});
            let (end, asked) = probe::stopped_at(last, run);
            (end, asked, solver.sweeps())
        };
        let (end, asked, sweeps) = sweeps_until(0);
        assert!(end.is_ok() && sweeps > 100 * STEPS as u64, "{sweeps} sweeps are not hard");
        let mut before = 0;
        for last in 1..=asked {
            let (end, _, sweeps) = sweeps_until(last);
            assert_eq!(end, Err(Stopped), "question {last}");
            assert!(sweeps <= before + Stop::PERIOD as u64, "{} sweeps between two questions", sweeps - before);
            before = sweeps;
        }
    });
}

#[test]
fn backward_sweeps_ask_at_each_step() {
    with_rollout(short_track(), |simulator, rollout| {
        let mut sensitivity = EndSensitivity::default();
        simulator.record(rollout, FrictionLaw::Exact, &mut sensitivity, Stop::never()).unwrap();
        let (end, asked) =
            probe::unstopped(|stop| simulator.differentiate(rollout, FrictionLaw::Exact, &mut sensitivity, stop));
        assert_eq!((end, asked), (Ok(()), STEPS as u64));
        let chosen = [0, 1, 2, 3 * STEPS - 1];
        let forces = |stop: Stop| simulator.path_sensitivity(rollout, FrictionLaw::Exact, &sensitivity, &chosen, stop);
        let (derivatives, asked) = probe::unstopped(forces);
        let last_step = chosen.map(|index| sensitivity.path.step(index)).into_iter().max().unwrap();
        assert!(derivatives.is_ok() && asked == last_step as u64 + 1, "{asked}");
        for last in 1..=STEPS as u64 {
            assert!(last > asked || probe::stopped_at(last, forces) == (Err(Stopped), last));
            let again = probe::stopped_at(last, |stop| {
                let mut sensitivity = sensitivity.clone();
                simulator.differentiate(rollout, FrictionLaw::Exact, &mut sensitivity, stop)
            });
            assert_eq!(again, (Err(Stopped), last));
        }
    });
}

#[test]
fn motion_that_diverges_has_no_residual() {
    with_rollout(RobotParameters::default(), |simulator, rollout| {
        let schedule = TorqueSchedule { final_time: 1.0, left: vec![1e200], right: vec![-1e200] };
        let rollout = Rollout { schedule: &schedule, step_count: 10, ..*rollout };
        let trajectory = simulator.trajectory(&rollout, ContactMethod::Exact, Stop::never()).unwrap();
        assert!(trajectory.worst_contact_residual.is_nan(), "{}", trajectory.worst_contact_residual);
    });
}

/// Wheels that grip nothing on a front support that does.
fn without_grip(front_friction_coefficient: f64, tangential_restitution: f64) -> RobotParameters {
    let wheel_friction_coefficient = 0.0;
    let reference = RobotParameters::default();
    RobotParameters { wheel_friction_coefficient, front_friction_coefficient, tangential_restitution, ..reference }
}

#[test]
fn wheels_without_friction_spin_and_leave_the_robot_at_rest() {
    for (front, restitution) in [(1e-3, 0.0), (0.3, 0.0), (0.3, 0.4), (1.0, 0.4), (1.0, 1.0)] {
        for torque in [0.0, 0.5] {
            let robot = without_grip(front, restitution);
            with_rollout(robot, |simulator, rollout| {
                let schedule = TorqueSchedule { final_time: 1.0, left: vec![torque], right: vec![torque] };
                let rollout = Rollout { schedule: &schedule, step_count: 200, ..*rollout };
                let trajectory = simulator.trajectory(&rollout, ContactMethod::Exact, Stop::never()).unwrap();
                assert_eq!(trajectory.worst_contact_residual, 0.0);
                let (end, rate) = (trajectory.end_state, torque / robot.wheel_spin_inertia);
                let Configuration { x, y, heading, .. } = end.configuration;
                assert_eq!([x, y, heading], [0.0; 3]);
                for wheel_rate in [end.velocity.wheel_rate.left, end.velocity.wheel_rate.right] {
                    // 200 sums round.
                    assert!((wheel_rate - rate).abs() <= 1e-12 * rate, "{wheel_rate}, not {rate}");
                }
            });
        }
    }
}

#[test]
fn front_support_alone_brakes_as_the_fixed_point_says() {
    let mut start = State::default();
    (start.velocity.x, start.velocity.y, start.velocity.yaw_rate) = (0.2, 0.5, -1.0);
    for (front, restitution) in [(1e-3, 0.0), (0.3, 0.0), (0.3, 0.4), (1.0, 0.4), (1.0, 1.0)] {
        with_rollout(without_grip(front, restitution), |simulator, _| {
            let schedule = TorqueSchedule { final_time: 1.0, left: vec![0.3], right: vec![-0.1] };
            let rollout = Rollout { start: &start, schedule: &schedule, step_count: 200 };
            let [exact, reference] = [ContactMethod::Exact, ContactMethod::FixedPoint]
                .map(|method| simulator.trajectory(&rollout, method, Stop::never()).unwrap());
            assert!(exact.worst_contact_residual <= 1e-10, "{}", exact.worst_contact_residual);
            // Of the wheel rates, 100 rad/s, both methods leave rounding.
            let difference = (exact.end_state.to_vector() - reference.end_state.to_vector()).amax();
            assert!(difference <= 1e-9, "{front}, {restitution}: {difference}");
        });
    }
}

#[test]
fn only_unproved_uniqueness_is_looked_for_step_by_step() {
    let (_, asked) = with_rollout(RobotParameters::default(), |simulator, rollout| {
        probe::stopped_at(0, |stop| simulator.indeterminate_steps(rollout, stop))
    });
    assert_eq!(asked, 0, "the reference robot's is proved");
    let (end, asked) = with_rollout(short_track(), |simulator, rollout| {
        probe::stopped_at(0, |stop| simulator.indeterminate_steps(rollout, stop))
    });
    assert_eq!((end.is_ok(), asked), (true, STEPS as u64));
}

#[test]
fn fixed_point_reports_forces_within_friction_and_the_modes_of_the_exact_solver() {
    for turn in 0..20 {
        // Rolling on a curve: the sweeps leave the lateral force where they please, and a wheel on the rim of its disc.
        let mut start = State::default();
        let velocity = &mut start.velocity;
        (velocity.x, velocity.y, velocity.yaw_rate) = (-0.14, 1.5 + 0.02 * f64::from(turn), 2.0);
        velocity.wheel_rate = PerWheel::new(25.0, 35.0);
        with_rollout(RobotParameters::default(), |simulator, _| {
            let schedule = TorqueSchedule { final_time: 0.5, left: vec![0.0], right: vec![0.0] };
            let rollout = Rollout { start: &start, schedule: &schedule, step_count: 50 };
            let [exact, reference] = [ContactMethod::Exact, ContactMethod::FixedPoint]
                .map(|method| simulator.trajectory(&rollout, method, Stop::never()).unwrap());
            assert!(reference.worst_contact_residual <= 1e-12, "{}", reference.worst_contact_residual);
            assert_eq!(exact.degrees_of_freedom, reference.degrees_of_freedom, "{turn}");
            for contact in reference.contact.iter().flat_map(|contact| [contact.left, contact.right]) {
                let friction = contact.longitudinal_force.hypot(contact.lateral_force);
                let most = RobotParameters::default().wheel_friction_coefficient * contact.normal_force;
                assert!(friction <= most * (1.0 + 1e-9), "{turn}: {friction} of {most} N");
            }
        });
    }
}
