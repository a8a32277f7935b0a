//! A maneuver as a direct single-shooting problem: from a decision vector to scaled goal errors, to path constraints, and
//! to their Jacobian.
//!
//! Cost and constraint values are dimensionless: the cost is the final time over a unit of time, the residuals are goal
//! errors over what the start misses, normal forces are shares of the weight. So all tolerances of the search are shares.
//! Headings become lengths by the track width w, speeds by the time sqrt(w / g).

mod held_wheels;

use nalgebra::{DVector, Vector2};

use super::decision::{decision_len, schedule_from_decision, write_schedule};
use super::goal_rows::{GoalRow, GoalScales, goal_rows};
use super::maneuver::{Maneuver, StateComponent};
use super::path_constraints::PathConstraints;
use super::path_limits::PathLimits;
use crate::optimizer::{Constraints, Linearisation, Problem};
use crate::robot::{PerWheel, State};
use crate::simulation::{
    EndDerivative, EndFrame, EndSensitivity, FrictionLaw, PathQuantity, Rollout, Simulator, TorqueSchedule,
};
use crate::stop::{Stop, Stopped};

/// The variable scale of a torque is its limit near the grip, that of the final time this fraction of itself.
const FINAL_TIME_SCALE: f64 = 0.5;
/// Shortest final time that is searched, s: the fastest nudge by the tightest tolerance takes longer. Without a floor the
/// linear model could make the final time zero or negative.
pub const SHORTEST_FINAL_TIME: f64 = 1e-7;
/// Longest final time that is searched, s.
pub const LONGEST_FINAL_TIME: f64 = 1e4;

/// Goal errors and path constraints of one maneuver as a function of torques and final time.
#[derive(Debug, Clone)]
pub struct ShootingProblem<'a> {
    simulator: &'a Simulator,
    start: State,
    reference_offset: Vector2<f64>,
    rows: Vec<GoalRow>,
    path_constraints: PathConstraints,
    step_count: usize,
    /// What the cost counts as 1, s.
    time_unit: f64,
    /// What residuals count as 1, m.
    length_unit: f64,
    cost: DVector<f64>,
    /// The variable scale of the torques: their limits near the grip.
    torque_scale: PerWheel<f64>,
    torque_limit: PerWheel<f64>,
    /// The limited quantities with motors at all nodes, where those that are watched have motors beyond the grip at the ends of steps.
    beyond_grip: Option<Vec<PathQuantity>>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    schedule: TorqueSchedule,
    sensitivity: EndSensitivity,
    /// The decision and the friction law of the rollout in `sensitivity`.
    recorded: Option<(DVector<f64>, FrictionLaw)>,
    law: FrictionLaw,
}

impl<'a> ShootingProblem<'a> {
    /// Formulates a maneuver with its limits on a grid of `step_count` steps and `control_count` torques per wheel, with the
    /// final time of a first guess, s, as the unit of time.
    ///
    /// The target heading is the one nearest to the start's heading, modulo whole turns.
    pub fn new(
        simulator: &'a Simulator,
        (maneuver, limits): (&Maneuver, &PathLimits),
        (step_count, control_count): (usize, usize),
        time_unit: f64,
    ) -> Self {
        let parameters = simulator.robot().parameters();
        let free = PerWheel { left: 0.0, right: 0.0 };
        let torque_scale = simulator.robot().torques_near_grip(maneuver.torque_limit);
        let (mut quantities, mut beyond_grip) = (limits.quantities(), None);
        if simulator.robot().has_motors_beyond_grip() {
            let near_grip = quantities.iter().map(|quantity| quantity.judged_at_ends()).collect();
            beyond_grip = Some(std::mem::replace(&mut quantities, near_grip));
        }
        let (rows, length_unit) = goal_rows(maneuver, parameters);
        let path_constraints = PathConstraints::new(simulator.robot(), maneuver.limits, limits);
        let mut sensitivity = EndSensitivity::watching(quantities, control_count);
        let wheel_angles = [StateComponent::WheelAngleLeft, StateComponent::WheelAngleRight];
        sensitivity.omits_wheel_angles = wheel_angles.iter().all(|&angle| maneuver.goal.value(angle).is_none());
        Self {
            simulator,
            start: maneuver.start_at_center_of_mass(parameters),
            reference_offset: maneuver.reference_point.offset(parameters),
            rows,
            path_constraints,
            step_count,
            time_unit,
            length_unit,
            cost: each_torque(free, control_count).push(1.0 / time_unit),
            torque_scale,
            torque_limit: maneuver.torque_limit,
            beyond_grip,
            lower: (-each_torque(torque_scale, control_count)).push(SHORTEST_FINAL_TIME),
            upper: each_torque(torque_scale, control_count).push(LONGEST_FINAL_TIME),
            schedule: schedule_from_decision(&DVector::zeros(decision_len(control_count))),
            sensitivity,
            recorded: None,
            law: if limits.forbids_slip { FrictionLaw::Held(0.0) } else { FrictionLaw::Exact },
        }
    }

    /// Allows all torques within their limits; before, they stay near the grip. Beyond it more torque gains little, and the search should
    /// not depend on it. Motors beyond the grip are judged at all nodes from now on; before, at the ends of steps.
    pub fn release_torques(&mut self) {
        if let Some(quantities) = self.beyond_grip.take() {
            self.sensitivity.path.watch(quantities, self.control_count());
            self.recorded = None;
        }
        let last = self.cost.len() - 1;
        let limit = each_torque(self.torque_limit, last / 2);
        self.lower.rows_mut(0, last).copy_from(&-&limit);
        self.upper.rows_mut(0, last).copy_from(&limit);
    }

    /// Whether plans that keep its limits may break those of the maneuver, since motors beyond the grip are judged at the ends of steps.
    pub fn is_stand_in(&self) -> bool {
        self.beyond_grip.is_some()
    }

    /// Whether torques may exceed those near the grip.
    pub fn has_torque_beyond_grip(&self) -> bool {
        let PerWheel { left, right } = self.torque_limit;
        self.beyond_grip.is_some() || self.torque_scale.left < left || self.torque_scale.right < right
    }

    /// Whether a plan may need more than the torques near the grip, or what motors beyond it leave.
    pub fn exceeds_grip(&self, decision: &DVector<f64>) -> bool {
        let bounds = self.lower.iter().zip(&self.upper);
        let mut torques = decision.iter().zip(bounds).take(decision.len() - 1);
        self.beyond_grip.is_some() || torques.any(|(torque, (lower, upper))| torque < lower || torque > upper)
    }

    /// Keeps limits with a share of each to spare: their fields, such as `maneuver.limits.speed_m_s`, and these shares.
    pub fn tighten(&mut self, margins: &[(&str, f64)]) {
        for (field, share) in margins {
            self.path_constraints.tighten(field, *share);
        }
    }

    /// Excludes final times below `time`, s.
    pub fn rule_out_before(&mut self, time: f64) {
        let shortest = &mut self.lower[self.cost.len() - 1];
        *shortest = shortest.max(time.min(LONGEST_FINAL_TIME));
    }

    /// Counts this time, s, as 1 from now on.
    pub fn set_time_unit(&mut self, time_unit: f64) {
        self.time_unit = time_unit;
        let final_time_index = self.cost.len() - 1;
        self.cost[final_time_index] = 1.0 / time_unit;
    }

    /// Rolls out on a grid of so many steps from now on.
    pub fn set_step_count(&mut self, step_count: usize) {
        self.step_count = step_count;
        self.recorded = None;
    }

    /// Has so many torques per wheel from now on.
    pub fn set_control_count(&mut self, control_count: usize) {
        for of_variable in [&mut self.cost, &mut self.lower, &mut self.upper] {
            let last = of_variable.len() - 1;
            let of_wheel = PerWheel { left: of_variable[0], right: of_variable[last - 1] };
            *of_variable = each_torque(of_wheel, control_count).push(of_variable[last]);
        }
        self.schedule.left.resize(control_count, 0.0);
        self.schedule.right.resize(control_count, 0.0);
        self.sensitivity.path.forget_values(control_count);
        self.recorded = None;
    }

    /// Torques per wheel.
    pub fn control_count(&self) -> usize {
        self.schedule.control_count()
    }

    /// Steps of the grid.
    pub fn step_count(&self) -> usize {
        self.step_count
    }

    /// The goal heading in the winding that it aims at, rad; none where the heading is free.
    pub fn goal_heading(&self) -> Option<f64> {
        self.rows.iter().find(|row| row.is_heading()).map(|row| row.target)
    }

    /// Aims at the goal heading in this winding, rad, if there is one; nothing where the heading is free.
    pub fn aim(&mut self, goal_heading: Option<f64>) {
        for (row, heading) in self.rows.iter_mut().filter(|row| row.is_heading()).zip(goal_heading) {
            row.target = heading;
        }
    }

    /// The heading at the end of a decision's motion, rad, which takes a rollout; not finite where the motion diverges.
    ///
    /// # Errors
    /// When it was stopped.
    pub fn end_heading(&mut self, decision: &DVector<f64>, stop: Stop) -> Result<f64, Stopped> {
        self.record(decision, stop)?;
        Ok(self.sensitivity.end.configuration.heading)
    }

    /// Whether the motion is smooth in everything, and smoothing changes nothing: rollouts hold the wheels, and nothing else rubs.
    pub fn is_smooth(&self) -> bool {
        matches!(self.law, FrictionLaw::Held(_))
            && self.simulator.robot().parameters().front_friction_coefficient == 0.0
    }

    /// Sets the slip smoothing of the friction law as a share of the maneuver's speed, unit of length over unit of time; 0 is the
    /// exact law. Held wheels stay held.
    pub fn set_slip_smoothing(&mut self, share: f64) {
        if self.is_smooth() {
            return;
        }
        let slip_smoothing = share * self.length_unit / self.time_unit;
        self.law = match self.law {
            FrictionLaw::Held(_) => FrictionLaw::Held(slip_smoothing),
            FrictionLaw::Exact | FrictionLaw::Smoothed(_) if slip_smoothing > 0.0 => {
                FrictionLaw::Smoothed(slip_smoothing)
            }
            FrictionLaw::Exact | FrictionLaw::Smoothed(_) => FrictionLaw::Exact,
        };
    }

    /// What the cost counts as 1, s.
    pub fn time_unit(&self) -> f64 {
        self.time_unit
    }

    /// What residuals count as 1, m.
    pub fn length_unit(&self) -> f64 {
        self.length_unit
    }

    /// The scales between residuals and goal errors.
    pub fn goal_scales(&self) -> GoalScales {
        GoalScales(self.rows.iter().map(|row| row.scale).collect())
    }

    /// Inequalities violated by at most this much are met.
    pub fn inequality_tolerance(&self) -> f64 {
        self.path_constraints.tolerance()
    }

    /// Sum of the squared violations of a point with these constraint values on its way, as shares of the weight and of what limits allow.
    pub fn squared_path_violation(&self, constraints: &Constraints) -> f64 {
        self.path_constraints.squared_violation(&self.sensitivity.path, &constraints.inequality)
    }

    /// Whether a point with these constraint values breaks the limits of the maneuver, beyond their tolerance.
    pub fn breaks_limits(&self, constraints: &Constraints) -> bool {
        self.path_constraints.are_broken(&self.sensitivity.path, &constraints.inequality)
    }

    /// Rolls out, unless the last rollout was the same: a search linearises at points that it has just evaluated. Of one that comes back
    /// to a point later the values may differ by what [`Simulator::record`] leaves.
    fn record(&mut self, decision: &DVector<f64>, stop: Stop) -> Result<(), Stopped> {
        let is_recorded = |(recorded, law): &(DVector<f64>, FrictionLaw)| recorded == decision && *law == self.law;
        if self.recorded.as_ref().is_some_and(is_recorded) {
            return Ok(());
        }
        // A part of a rollout must not pass for the last one.
        self.recorded = None;
        write_schedule(decision, &mut self.schedule);
        let rollout = Rollout { start: &self.start, schedule: &self.schedule, step_count: self.step_count };
        self.simulator.record(&rollout, self.law, &mut self.sensitivity, stop)?;
        self.recorded = Some((decision.clone(), self.law));
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
        for (value, row) in column.as_mut_slice().iter_mut().zip(&self.rows) {
            *value = row.scale * derivative[row.component];
        }
    }

    fn write_goal_rows(&self, linearisation: &mut Linearisation) {
        let sensitivity = &self.sensitivity;
        let frame = self.end_frame();
        self.write_residual(&frame.state(&sensitivity.end), &mut linearisation.constraints.residual);
        let frame = frame.at(&sensitivity.end);
        let torques = sensitivity.by_left_torque.iter().chain(&sensitivity.by_right_torque);
        let jacobian = &mut linearisation.jacobian;
        for (index, derivative) in torques.enumerate() {
            self.write_column(&frame.derivative(derivative), jacobian.column_mut(index));
        }
        let by_final_time = frame.derivative_by_final_time(&sensitivity.by_final_time);
        self.write_column(&by_final_time, jacobian.column_mut(self.cost.len() - 1));
    }

    /// The rows of the working set, of which the first `near_path_count` are of the path.
    fn write_path_rows(
        &self,
        rollout: &Rollout,
        linearisation: &mut Linearisation,
        near_path_count: usize,
        stop: Stop,
    ) -> Result<(), Stopped> {
        let Linearisation { working_set, jacobian, .. } = linearisation;
        let path = &self.sensitivity.path;
        let (of_path, of_torques) = working_set.split_at(near_path_count);
        let first = self.rows.len();
        if !of_path.is_empty() {
            let derivatives = self.simulator.path_sensitivity(rollout, self.law, &self.sensitivity, of_path, stop)?;
            for (row, (&index, derivative)) in of_path.iter().zip(&derivatives).enumerate() {
                self.path_constraints.write_path_row(path.place(index), derivative, jacobian.row_mut(first + row));
            }
        }
        for (row, &index) in of_torques.iter().enumerate() {
            let row = jacobian.row_mut(first + near_path_count + row);
            self.path_constraints.write_torque_rate_row((index, path), rollout.schedule, row);
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
        let last = decision.len() - 1;
        each_torque(self.torque_scale, last / 2).push(FINAL_TIME_SCALE * decision[last])
    }

    fn constraints(&self) -> Constraints {
        let inequality_count = self.path_constraints.count(&self.sensitivity.path, self.schedule.control_count());
        Constraints { residual: DVector::zeros(self.rows.len()), inequality: DVector::zeros(inequality_count) }
    }

    fn evaluate(&mut self, decision: &DVector<f64>, stop: Stop) -> Result<Constraints, Stopped> {
        self.record(decision, stop)?;
        let mut constraints = self.constraints();
        self.write_residual(&self.end_frame().state(&self.sensitivity.end), &mut constraints.residual);
        self.path_constraints.write_values(&self.sensitivity.path, &self.schedule, &mut constraints.inequality);
        Ok(constraints)
    }

    fn linearise(
        &mut self,
        (decision, radius): (&DVector<f64>, f64),
        linearisation: &mut Linearisation,
        stop: Stop,
    ) -> Result<(), Stopped> {
        self.record(decision, stop)?;
        let rollout = Rollout { start: &self.start, schedule: &self.schedule, step_count: self.step_count };
        self.simulator.differentiate(&rollout, self.law, &mut self.sensitivity, stop)?;
        let Linearisation { constraints, working_set, jacobian } = linearisation;
        let path = &self.sensitivity.path;
        self.path_constraints.write_values(path, &self.schedule, &mut constraints.inequality);
        let values = &constraints.inequality;
        let near_path_count = self.path_constraints.select_working_set(path, (values, radius), working_set);
        jacobian.resize_vertically_mut(self.rows.len() + working_set.len(), 0.0);
        self.write_goal_rows(linearisation);
        self.write_path_rows(&rollout, linearisation, near_path_count, stop)
    }
}

/// The same value for all torques of a wheel.
fn each_torque(of_wheel: PerWheel<f64>, control_count: usize) -> DVector<f64> {
    let of = |index: usize| if index < control_count { of_wheel.left } else { of_wheel.right };
    DVector::from_fn(decision_len(control_count) - 1, |index, _| of(index))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Robot, RobotParameters};
    use crate::shooting::ReferencePoint;

    #[test]
    fn constraints_are_laid_out_before_any_rollout() {
        let simulator = Simulator::new(&Robot::new(RobotParameters::default()).unwrap());
        let problem =
            ShootingProblem::new(&simulator, (&Maneuver::forward_drive(), &PathLimits::default()), (50, 5), 1.0);
        // A search that is stopped before its first rollout asks for both.
        let mut constraints = problem.constraints();
        assert_eq!(constraints.inequality.len(), 3 * 5);
        assert!(!problem.breaks_limits(&constraints));
        // What is not a number keeps no limit.
        constraints.inequality[4] = f64::NAN;
        assert!(problem.breaks_limits(&constraints) && problem.squared_path_violation(&constraints).is_nan());
    }

    #[test]
    fn jacobian_agrees_with_differences_at_the_axle_midpoint() {
        let simulator = Simulator::new(&Robot::new(RobotParameters::default()).unwrap());
        let maneuver = Maneuver { reference_point: ReferencePoint::AxleMidpoint, ..Maneuver::forward_drive() };
        let mut problem = ShootingProblem::new(&simulator, (&maneuver, &PathLimits::default()), (50, 5), 1.0);
        let decision = DVector::from_vec(vec![0.9, 0.3, -0.2, 0.7, -0.6, 0.5, 0.8, 0.1, -0.4, 0.2, 1.7]);
        let mut model = Linearisation::new(problem.constraints(), decision.len());
        problem.linearise((&decision, 1.0), &mut model, Stop::never()).unwrap();
        let step = 1e-6;
        for index in 0..decision.len() {
            let [above, below] = [step, -step].map(|step| {
                let mut moved = decision.clone();
                moved[index] += step;
                model.rows_of(&problem.evaluate(&moved, Stop::never()).unwrap())
            });
            let difference = (above - below) / (2.0 * step);
            // Truncation and rounding of the central difference meet near 1e-9 of derivatives near 1.
            assert!((model.jacobian.column(index) - difference).amax() < 1e-7);
        }
    }
}
