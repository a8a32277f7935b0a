//! The same maneuver of a larger robot under stronger gravity: mechanics with Coulomb friction looks alike in all sizes.
//!
//! With lengths times s, gravity times k, inertias times s^2 and torques times s k, every motion is repeated with lengths
//! times s and times times sqrt(s / k); masses and friction stay. What a metre of goal is worth in seconds thus falls by
//! sqrt(s k): a penalty parameter that is too small for a small maneuver is large enough for a large one.

use slipdrive::robot::{PerWheel, Robot, RobotParameters, State};
use slipdrive::shooting::StateComponent;
use slipdrive::simulation::TorqueSchedule;
use slipdrive::solver::SolveInput;

/// Factors between similar maneuvers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale {
    /// Of lengths (s).
    pub(crate) length: f64,
    /// Of gravity and all accelerations (k).
    pub(crate) gravity: f64,
}

/// The similar maneuver; none where no such robot is accepted.
pub(crate) fn enlarged(input: &SolveInput, scale: Scale) -> Option<SolveInput> {
    let mut large = input.clone();
    large.robot = Robot::new(enlarged_robot(input.robot.parameters(), scale)).ok()?;
    large.bare_robot = enlarged_robot(&input.bare_robot, scale);
    let mut start = large.maneuver.start.to_vector();
    for component in StateComponent::ALL {
        let factor = factor_of(component, scale);
        start[component.index()] *= factor;
        let goal = large.maneuver.goal.value(component).map(|value| factor * value);
        large.maneuver.goal.set(component, goal);
    }
    large.maneuver.start = State::from_vector(&start);
    let limit = large.maneuver.torque_limit;
    large.maneuver.torque_limit = PerWheel::new(scale.torque() * limit.left, scale.torque() * limit.right);
    // Rates grow on the way back.
    large.settings.goal_tolerance /= 10.0 * scale.time().max(1.0);
    large.initial_guess = None;
    Some(large)
}

/// The plan of the original robot that does what a plan of the enlarged one does, within the original torque limits.
pub(crate) fn reduced(plan: &TorqueSchedule, scale: Scale, limit: PerWheel<f64>) -> TorqueSchedule {
    let within =
        |torques: &[f64], limit: f64| torques.iter().map(|t| (t / scale.torque()).clamp(-limit, limit)).collect();
    TorqueSchedule {
        final_time: plan.final_time / scale.time(),
        left: within(&plan.left, limit.left),
        right: within(&plan.right, limit.right),
    }
}

impl Scale {
    fn time(self) -> f64 {
        (self.length / self.gravity).sqrt()
    }

    fn torque(self) -> f64 {
        self.length * self.gravity
    }
}

fn enlarged_robot(robot: &RobotParameters, Scale { length, gravity }: Scale) -> RobotParameters {
    let inertia = length * length;
    RobotParameters {
        chassis_yaw_inertia: inertia * robot.chassis_yaw_inertia,
        wheel_diametral_inertia: inertia * robot.wheel_diametral_inertia,
        wheel_spin_inertia: inertia * robot.wheel_spin_inertia,
        wheel_radius: length * robot.wheel_radius,
        track_width: length * robot.track_width,
        axle_to_front_support: length * robot.axle_to_front_support,
        front_support_right: length * robot.front_support_right,
        center_of_mass_right: length * robot.center_of_mass_right,
        center_of_mass_forward: length * robot.center_of_mass_forward,
        center_of_mass_height: length * robot.center_of_mass_height,
        gravity: gravity * robot.gravity,
        ..*robot
    }
}

fn factor_of(component: StateComponent, scale: Scale) -> f64 {
    match component {
        StateComponent::X | StateComponent::Y => scale.length,
        StateComponent::Heading | StateComponent::WheelAngleLeft | StateComponent::WheelAngleRight => 1.0,
        StateComponent::VelocityX | StateComponent::VelocityY => scale.length / scale.time(),
        StateComponent::YawRate | StateComponent::WheelRateLeft | StateComponent::WheelRateRight => 1.0 / scale.time(),
    }
}
