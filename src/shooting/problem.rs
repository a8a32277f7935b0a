//! A maneuver as a direct single-shooting problem: from a decision vector to scaled goal errors, to the distance of the
//! contacts from separation, and to their Jacobian.

use nalgebra::{DVector, Vector2};

use super::decision::{decision_len, write_schedule};
use super::maneuver::{Maneuver, StateComponent};
use super::normal_force_constraints::NormalForceConstraints;
use crate::optimizer::{Constraints, Linearisation, Problem};
use crate::robot::State;
use crate::simulation::{
    EndDerivative, EndFrame, EndSensitivity, LeastNormalForces, Rollout, Simulator, TorqueSchedule,
};
use crate::stop::{Stop, Stopped};

/// A speed error of 1 m/s (rad/s) counts as much as 0.3 m (rad): a time constant of 0.3 s.
const SPEED_SCALE: f64 = 0.3;
/// Wheel rates count this many times as much as the speeds of their rims: their errors are judged in rad/s, which are smaller,
/// so what cannot be met (rates of a goal that are rounded) goes into the velocity.
const WHEEL_SHARE: f64 = 4.0;
/// The variable scale of a torque is its limit, that of the final time this fraction of itself.
const FINAL_TIME_SCALE: f64 = 0.5;
/// Shortest final time that is searched, s: the fastest nudge by the tightest tolerance takes longer. Without a floor the
/// linear model could make the final time zero or negative.
pub const SHORTEST_FINAL_TIME: f64 = 1e-7;
/// Longest final time that is searched, s.
pub const LONGEST_FINAL_TIME: f64 = 1e4;

/// Goal errors and normal forces of one maneuver as a function of torques and final time.
#[derive(Debug, Clone)]
pub struct ShootingProblem<'a> {
    simulator: &'a Simulator,
    start: State,
    reference_offset: Vector2<f64>,
    rows: Vec<GoalRow>,
    normal_force_constraints: NormalForceConstraints,
    step_count: usize,
    cost: DVector<f64>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    schedule: TorqueSchedule,
    sensitivity: EndSensitivity,
    /// The decision and the smoothing of the rollout in `sensitivity`.
    recorded: Option<(DVector<f64>, f64)>,
    slip_smoothing: f64,
}

/// One constrained component of the end state.
#[derive(Debug, Clone, Copy)]
struct GoalRow {
    component: usize,
    target: f64,
    scale: f64,
}

/// Scale of each row: residual = scale * goal error.
#[derive(Debug, Clone, PartialEq)]
pub struct GoalScales(Vec<f64>);

impl GoalScales {
    /// Largest magnitude of the goal errors (m, rad, m/s, rad/s) behind scaled residuals; NaN if any is NaN.
    pub fn largest_goal_error(&self, residual: &DVector<f64>) -> f64 {
        let errors = residual.iter().zip(&self.0).map(|(value, scale)| (value / scale).abs());
        errors.fold(0.0, |worst, error| if error > worst || error.is_nan() { error } else { worst })
    }

    /// The largest scale: if every goal error is within `goal_tolerance`, every residual is within
    /// `goal_tolerance * largest`.
    pub fn largest(&self) -> f64 {
        self.0.iter().copied().fold(0.0, f64::max)
    }

    /// The smallest scale: if every residual is within `goal_tolerance * smallest`, every goal error is within
    /// `goal_tolerance`.
    pub fn smallest(&self) -> f64 {
        self.0.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

impl<'a> ShootingProblem<'a> {
    /// Formulates a maneuver on a grid of `step_count` steps and `control_count` torques per wheel.
    ///
    /// The target heading is the one nearest to the start's heading, modulo whole turns.
    pub fn new(simulator: &'a Simulator, maneuver: &Maneuver, step_count: usize, control_count: usize) -> Self {
        let parameters = simulator.robot().parameters();
        let final_time_index = decision_len(control_count) - 1;
        let mut cost = DVector::zeros(decision_len(control_count));
        cost[final_time_index] = 1.0;
        let limit = maneuver.torque_limit;
        let mut upper =
            DVector::from_fn(
                decision_len(control_count),
                |index, _| {
                    if index < control_count { limit.left } else { limit.right }
                },
            );
        let mut lower = -&upper;
        lower[final_time_index] = SHORTEST_FINAL_TIME;
        upper[final_time_index] = LONGEST_FINAL_TIME;
        Self {
            simulator,
            start: maneuver.start_at_center_of_mass(parameters),
            reference_offset: maneuver.reference_point.offset(parameters),
            rows: goal_rows(maneuver, parameters.wheel_radius),
            normal_force_constraints: NormalForceConstraints::new(simulator.robot(), maneuver.limits),
            step_count,
            cost,
            lower,
            upper,
            schedule: TorqueSchedule {
                final_time: 0.0,
                left: vec![0.0; control_count],
                right: vec![0.0; control_count],
            },
            sensitivity: EndSensitivity::default(),
            recorded: None,
            slip_smoothing: 0.0,
        }
    }

    /// Excludes final times below `time`, s.
    pub fn rule_out_before(&mut self, time: f64) {
        let shortest = &mut self.lower[self.cost.len() - 1];
        *shortest = shortest.max(time.min(LONGEST_FINAL_TIME));
    }

    /// Aims at the goal heading in the winding of `heading`, rad; nothing where the heading is free.
    pub fn aim_at_heading(&mut self, heading: f64) {
        for row in self.rows.iter_mut().filter(|row| row.component == StateComponent::Heading.index()) {
            row.target = heading;
        }
    }

    /// Sets the slip smoothing of the friction law, m/s; 0 is the exact law.
    pub fn set_slip_smoothing(&mut self, slip_smoothing: f64) {
        self.slip_smoothing = slip_smoothing;
    }

    /// The scales between residuals and goal errors.
    pub fn goal_scales(&self) -> GoalScales {
        GoalScales(self.rows.iter().map(|row| row.scale).collect())
    }

    /// Sum of the scaled goal errors of the start.
    pub fn violation_at_start(&self) -> f64 {
        let mut residual = DVector::zeros(self.rows.len());
        self.write_residual(&self.start.moved_by(self.reference_offset), &mut residual);
        residual.lp_norm(1)
    }

    /// Whether a point with these constraint values breaks the limits of the maneuver, beyond their tolerance.
    pub fn breaks_limits(&self, constraints: &Constraints) -> bool {
        self.normal_force_constraints.are_broken(&constraints.inequality)
    }

    /// Rolls out, unless the last rollout was the same: a search linearises at points that it has just evaluated.
    fn record(&mut self, decision: &DVector<f64>, stop: Stop) -> Result<(), Stopped> {
        let is_recorded =
            |(recorded, smoothing): &(DVector<f64>, f64)| recorded == decision && *smoothing == self.slip_smoothing;
        if self.recorded.as_ref().is_some_and(is_recorded) {
            return Ok(());
        }
        write_schedule(decision, &mut self.schedule);
        let rollout = Rollout { start: &self.start, schedule: &self.schedule, step_count: self.step_count };
        let recorded = self.simulator.record(&rollout, self.slip_smoothing, &mut self.sensitivity, stop);
        if let Err(stopped) = recorded {
            // A part of a rollout must not pass for the last one.
            self.recorded = None;
            return Err(stopped);
        }
        match &mut self.recorded {
            Some((recorded, smoothing)) => {
                recorded.copy_from(decision);
                *smoothing = self.slip_smoothing;
            }
            None => self.recorded = Some((decision.clone(), self.slip_smoothing)),
        }
        Ok(())
    }

    /// From the end state as goals are judged.
    fn write_residual(&self, end: &State, residual: &mut DVector<f64>) {
        let end = end.to_vector();
        for (value, row) in residual.iter_mut().zip(&self.rows) {
            *value = row.scale * (end[row.component] - row.target);
        }
    }

    fn end_frame(&self) -> EndFrame {
        let rollout = Rollout { start: &self.start, schedule: &self.schedule, step_count: self.step_count };
        self.simulator.end_frame(&rollout, self.reference_offset)
    }

    /// The goal rows of a column of the Jacobian.
    fn write_column(&self, derivative: &EndDerivative, mut column: nalgebra::DVectorViewMut<f64>) {
        for (value, row) in column.iter_mut().zip(&self.rows) {
            *value = row.scale * derivative[row.component];
        }
    }

    fn write_goal_rows(&self, linearisation: &mut Linearisation) {
        let (sensitivity, frame) = (&self.sensitivity, self.end_frame());
        let end = &sensitivity.end;
        self.write_residual(&frame.state(end), &mut linearisation.constraints.residual);
        let torques = sensitivity.by_left_torque.iter().chain(&sensitivity.by_right_torque);
        let jacobian = &mut linearisation.jacobian;
        for (index, derivative) in torques.enumerate() {
            self.write_column(&frame.derivative(derivative, end), jacobian.column_mut(index));
        }
        let by_final_time = frame.derivative_by_final_time(&sensitivity.by_final_time, end);
        self.write_column(&by_final_time, jacobian.column_mut(self.cost.len() - 1));
    }

    fn write_normal_force_rows(
        &self,
        rollout: &Rollout,
        linearisation: &mut Linearisation,
        stop: Stop,
    ) -> Result<(), Stopped> {
        let working_set = &linearisation.working_set;
        if working_set.is_empty() {
            return Ok(());
        }
        let (simulator, smoothing) = (self.simulator, self.slip_smoothing);
        let derivatives =
            simulator.normal_force_sensitivity(rollout, smoothing, &self.sensitivity, working_set, stop)?;
        for (index, derivative) in derivatives.iter().enumerate() {
            let row = linearisation.jacobian.row_mut(self.rows.len() + index);
            self.normal_force_constraints.write_row(derivative, row);
        }
        Ok(())
    }
}

impl Problem for ShootingProblem<'_> {
    fn cost(&self) -> &DVector<f64> {
        &self.cost
    }

    fn lower(&self) -> &DVector<f64> {
        &self.lower
    }

    fn upper(&self) -> &DVector<f64> {
        &self.upper
    }

    fn variable_scale(&self, decision: &DVector<f64>) -> DVector<f64> {
        let mut scale = self.upper.clone();
        let last = scale.len() - 1;
        scale[last] = FINAL_TIME_SCALE * decision[last];
        scale
    }

    fn constraints(&self) -> Constraints {
        let inequality_count = LeastNormalForces::count(self.schedule.control_count());
        Constraints { residual: DVector::zeros(self.rows.len()), inequality: DVector::zeros(inequality_count) }
    }

    fn evaluate(&mut self, decision: &DVector<f64>, constraints: &mut Constraints, stop: Stop) -> Result<(), Stopped> {
        self.record(decision, stop)?;
        self.write_residual(&self.end_frame().state(&self.sensitivity.end), &mut constraints.residual);
        self.normal_force_constraints
            .write_inequality_values(&self.sensitivity.least_normal_forces, &mut constraints.inequality);
        Ok(())
    }

    fn linearise(
        &mut self,
        decision: &DVector<f64>,
        linearisation: &mut Linearisation,
        stop: Stop,
    ) -> Result<(), Stopped> {
        self.record(decision, stop)?;
        let rollout = Rollout { start: &self.start, schedule: &self.schedule, step_count: self.step_count };
        self.simulator.differentiate(&rollout, self.slip_smoothing, &mut self.sensitivity, stop)?;
        let Linearisation { constraints, working_set, jacobian } = linearisation;
        self.normal_force_constraints
            .write_inequality_values(&self.sensitivity.least_normal_forces, &mut constraints.inequality);
        NormalForceConstraints::select_working_set(&constraints.inequality, working_set);
        jacobian.resize_vertically_mut(self.rows.len() + working_set.len(), 0.0);
        self.write_goal_rows(linearisation);
        self.write_normal_force_rows(&rollout, linearisation, stop)
    }
}

fn goal_rows(maneuver: &Maneuver, wheel_radius: f64) -> Vec<GoalRow> {
    let nearest_heading = maneuver.nearest_goal_heading();
    let row = |(component, value): (StateComponent, f64)| GoalRow {
        component: component.index(),
        target: nearest_heading.filter(|_| component == StateComponent::Heading).unwrap_or(value),
        scale: residual_scale(component, wheel_radius),
    };
    maneuver.goal.constrained().map(row).collect()
}

/// Scales turn every residual into metres or radians.
fn residual_scale(component: StateComponent, wheel_radius: f64) -> f64 {
    match component {
        StateComponent::X | StateComponent::Y | StateComponent::Heading => 1.0,
        StateComponent::WheelAngleLeft | StateComponent::WheelAngleRight => wheel_radius,
        StateComponent::VelocityX | StateComponent::VelocityY | StateComponent::YawRate => SPEED_SCALE,
        StateComponent::WheelRateLeft | StateComponent::WheelRateRight => WHEEL_SHARE * SPEED_SCALE * wheel_radius,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Robot, RobotParameters};
    use crate::shooting::ReferencePoint;

    #[test]
    fn jacobian_agrees_with_differences_at_the_axle_midpoint() {
        let simulator = Simulator::new(&Robot::new(RobotParameters::default()).unwrap());
        let maneuver = Maneuver { reference_point: ReferencePoint::AxleMidpoint, ..Maneuver::forward_drive() };
        let mut problem = ShootingProblem::new(&simulator, &maneuver, 50, 5);
        let decision = DVector::from_vec(vec![0.9, 0.3, -0.2, 0.7, -0.6, 0.5, 0.8, 0.1, -0.4, 0.2, 1.7]);
        let mut model = Linearisation::new(problem.constraints(), decision.len());
        problem.linearise(&decision, &mut model, Stop::never()).unwrap();
        let step = 1e-6;
        for index in 0..decision.len() {
            let [above, below] = [step, -step].map(|step| {
                let mut moved = decision.clone();
                moved[index] += step;
                let mut constraints = problem.constraints();
                problem.evaluate(&moved, &mut constraints, Stop::never()).unwrap();
                model.rows_of(&constraints)
            });
            let difference = (above - below) / (2.0 * step);
            // Truncation and rounding of the central difference meet near 1e-9 of derivatives near 1.
            assert!((model.jacobian.column(index) - difference).amax() < 1e-7);
        }
    }
}
