//! The Jacobian of the shooting problem under smoothed friction, against differences of its values: all variables, the goal and
//! the least normal forces.

use nalgebra::DVector;
use slipdrive::optimizer::{Linearisation, Problem};
use slipdrive::robot::{PerWheel, Robot};
use slipdrive::shooting::{
    Goal, Maneuver, PathLimits, ReferencePoint, ShootingProblem, StateComponent, decision_from_schedule,
};
use slipdrive::simulation::Simulator;
use slipdrive::stop::Stop;

use crate::random::RandomCases;

/// Slip smoothings from far above those of a search to the smallest of them, m/s.
const SMOOTHINGS: [f64; 4] = [0.3, 0.1, 0.03, 0.01];
const STEP_COUNT: usize = 60;
const CONTROL_COUNT: usize = 4;
/// Near the optimum of truncation, which grows with the inverse square of the smoothing, and rounding.
const DIFFERENCE_STEP: f64 = 1e-6;
/// Newton's last update of at most 1e-9 leaves rounding of 1e-12 or so, which the difference divides by its step; relative to the
/// larger of 1 and the derivative.
const TOLERANCE: f64 = 1e-5;

/// A maneuver whose goal constrains every component.
fn maneuver(cases: &mut RandomCases, robot: &Robot, reference_point: ReferencePoint) -> Maneuver {
    let mut goal = Goal::at_rest(0.3, 0.8, 0.4);
    goal.set(StateComponent::WheelAngleLeft, Some(5.0));
    goal.set(StateComponent::WheelAngleRight, Some(6.0));
    let start = cases.state(robot, 1.0);
    Maneuver { reference_point, start, goal, torque_limit: PerWheel::new(3.0, 2.5), ..Maneuver::forward_drive() }
}

/// From a rollout that follows no other: what Newton leaves is then as smooth as the law.
fn rows_at(fresh: &ShootingProblem, model: &Linearisation, decision: &DVector<f64>) -> DVector<f64> {
    model.rows_of(&fresh.clone().evaluate(decision, Stop::never()).unwrap())
}

/// Compares every column with differences of a problem that has no rollout yet; returns how many normal forces have rows.
fn compare_columns(
    (problem, fresh): (&mut ShootingProblem, &ShootingProblem),
    decision: &DVector<f64>,
    label: &str,
) -> usize {
    let mut model = Linearisation::new(problem.constraints(), decision.len());
    problem.linearise((decision, 1.0), &mut model, Stop::never()).unwrap();
    let goal_rows = model.constraints.residual.len();
    let here = rows_at(fresh, &model, decision);
    // The last rollout was at the same decision under another smoothing, and must not pass for one under this.
    assert!((model.rows_of(&model.constraints) - &here).amax() <= TOLERANCE, "{label}");
    for variable in 0..decision.len() {
        let [ahead, behind] = [DIFFERENCE_STEP, -DIFFERENCE_STEP].map(|step| {
            let mut moved = decision.clone();
            moved[variable] += step;
            (rows_at(fresh, &model, &moved) - &here) / step
        });
        for row in 0..here.len() {
            let (derivative, sides) = (model.jacobian[(row, variable)], [ahead[row], behind[row]]);
            // Where the least force moves to another step, its derivative jumps: it is that of either side.
            let central = 0.5 * (sides[0] + sides[1]);
            let (low, high) =
                if row < goal_rows { (central, central) } else { (sides[0].min(sides[1]), sides[0].max(sides[1])) };
            let gap = (low - derivative).max(derivative - high);
            assert!(
                gap <= TOLERANCE * central.abs().max(1.0),
                "{label}, row {row} of {goal_rows} by variable {variable}: {derivative}, differences {sides:?}"
            );
        }
    }
    model.working_set.len()
}

#[test]
fn jacobian_agrees_with_differences_under_every_smoothing() {
    let mut normal_forces = 0;
    for seed in 0..20 {
        let mut cases = RandomCases::new(seed);
        let robot = cases.robot();
        let simulator = Simulator::new(&robot);
        for point in [ReferencePoint::ChassisCenterOfMass, ReferencePoint::AxleMidpoint] {
            let maneuver = maneuver(&mut cases, &robot, point);
            let decision = decision_from_schedule(&cases.schedule(CONTROL_COUNT, 1.2, 2.0));
            let new =
                ShootingProblem::new(&simulator, (&maneuver, &PathLimits::default()), (STEP_COUNT, CONTROL_COUNT), 1.0);
            let mut problem = new.clone();
            for smoothing in SMOOTHINGS {
                let mut fresh = new.clone();
                problem.set_slip_smoothing(smoothing);
                fresh.set_slip_smoothing(smoothing);
                let label = format!("seed {seed}, {point:?}, smoothing {smoothing}");
                normal_forces += compare_columns((&mut problem, &fresh), &decision, &label);
            }
        }
    }
    assert!(normal_forces > 100, "{normal_forces} rows of normal forces");
}
