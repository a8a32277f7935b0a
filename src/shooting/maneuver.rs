//! What is asked: a start, a goal in some or all components, and the torque limits.

use nalgebra::{SVector, Vector2, Vector3};

use crate::robot::{PerWheel, Robot, RobotParameters, State};
use crate::rules::{BoundedField, Checks, Rule, RuleSet};

/// Largest accepted coordinate, m: beyond it a millimetre is near the rounding of the rollout.
const POSITION_LIMIT: f64 = 1e4;
/// Largest accepted angle, rad.
const ANGLE_LIMIT: f64 = 1e4;
/// Largest accepted speed, m/s.
const SPEED_LIMIT: f64 = 100.0;
/// Largest accepted yaw rate, rad/s.
const YAW_RATE_LIMIT: f64 = 1e3;
/// Largest accepted wheel rate, rad/s.
const WHEEL_RATE_LIMIT: f64 = 1e5;
/// Largest accepted torque limit, N m.
const TORQUE_LIMIT: f64 = 1e6;
/// A third is what each contact carries on average.
const LARGEST_NORMAL_LOAD_SHARE: f64 = 0.5;

/// The point of the chassis whose position and velocity the caller speaks of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ReferencePoint {
    /// Centre of mass of the chassis, as in the paper.
    #[default]
    ChassisCenterOfMass,
    /// Midpoint of the axle, what planners call `base_link`.
    AxleMidpoint,
}

impl ReferencePoint {
    /// The point relative to the chassis centre of mass, in the body frame (right, forward), m.
    pub fn offset(self, robot: &RobotParameters) -> Vector2<f64> {
        match self {
            Self::ChassisCenterOfMass => Vector2::zeros(),
            Self::AxleMidpoint => robot.axle_midpoint(),
        }
    }
}

/// A component of the state that a goal may fix; the order is that of [`State::to_vector`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StateComponent {
    /// World x, m.
    X,
    /// World y, m.
    Y,
    /// Heading, rad.
    Heading,
    /// Left wheel angle, rad.
    WheelAngleLeft,
    /// Right wheel angle, rad.
    WheelAngleRight,
    /// World x velocity, m/s.
    VelocityX,
    /// World y velocity, m/s.
    VelocityY,
    /// Yaw rate, rad/s.
    YawRate,
    /// Left wheel rate, rad/s.
    WheelRateLeft,
    /// Right wheel rate, rad/s.
    WheelRateRight,
}

impl StateComponent {
    /// All components in the order of [`State::to_vector`].
    pub const ALL: [Self; 10] = [
        Self::X,
        Self::Y,
        Self::Heading,
        Self::WheelAngleLeft,
        Self::WheelAngleRight,
        Self::VelocityX,
        Self::VelocityY,
        Self::YawRate,
        Self::WheelRateLeft,
        Self::WheelRateRight,
    ];

    /// Position of the component in [`State::to_vector`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The field of the public contract.
    pub const fn field(self) -> &'static str {
        match self {
            Self::X => "x_m",
            Self::Y => "y_m",
            Self::Heading => "heading_rad",
            Self::WheelAngleLeft => "wheel_angle_left_rad",
            Self::WheelAngleRight => "wheel_angle_right_rad",
            Self::VelocityX => "velocity_x_m_s",
            Self::VelocityY => "velocity_y_m_s",
            Self::YawRate => "yaw_rate_rad_s",
            Self::WheelRateLeft => "wheel_rate_left_rad_s",
            Self::WheelRateRight => "wheel_rate_right_rad_s",
        }
    }

    /// The bounds of its value.
    const fn rule(self) -> Rule {
        match self {
            Self::X | Self::Y => Rule::within_magnitude(POSITION_LIMIT, "m"),
            Self::Heading | Self::WheelAngleLeft | Self::WheelAngleRight => Rule::within_magnitude(ANGLE_LIMIT, "rad"),
            Self::VelocityX | Self::VelocityY => Rule::within_magnitude(SPEED_LIMIT, "m/s"),
            Self::YawRate => Rule::within_magnitude(YAW_RATE_LIMIT, "rad/s"),
            Self::WheelRateLeft | Self::WheelRateRight => Rule::within_magnitude(WHEEL_RATE_LIMIT, "rad/s"),
        }
    }
}

/// The goal: a value per constrained component of the state, `None` where it is free.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Goal([Option<f64>; State::LEN]);

impl Goal {
    /// At rest at a pose (m, m, rad), with free wheel angles.
    pub fn at_rest(x: f64, y: f64, heading: f64) -> Self {
        let zero = Some(0.0);
        Self([Some(x), Some(y), Some(heading), None, None, zero, zero, zero, zero, zero])
    }

    /// The value asked of a component, if any.
    pub fn value(&self, component: StateComponent) -> Option<f64> {
        self.0[component.index()]
    }

    /// Fixes or frees a component.
    pub fn set(&mut self, component: StateComponent, value: Option<f64>) {
        self.0[component.index()] = value;
    }

    /// The constrained components with their values.
    pub fn constrained(&self) -> impl Iterator<Item = (StateComponent, f64)> + '_ {
        StateComponent::ALL.into_iter().filter_map(|component| Some((component, self.value(component)?)))
    }
}

/// What a plan must keep at every step of its grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManeuverLimits {
    /// Least normal force of each contact as a share of the weight, at most half of the contact's share at rest.
    pub normal_load_share: f64,
}

impl Default for ManeuverLimits {
    /// A hundredth of the weight: plans that balance on a contact do not survive small errors of the model.
    fn default() -> Self {
        Self { normal_load_share: 0.01 }
    }
}

impl ManeuverLimits {
    /// Share of its static normal force that a contact must keep at most.
    const STATIC_SHARE: f64 = 0.5;
    const RULES: [BoundedField<Self>; 1] =
        [("normal_load_share", |limits| limits.normal_load_share, Rule::between(0.0, LARGEST_NORMAL_LOAD_SHARE, ""))];

    /// The least normal forces (left, right, front) as shares of the weight.
    pub fn least_normal_loads(&self, robot: &Robot) -> Vector3<f64> {
        let half = static_loads(robot) * Self::STATIC_SHARE;
        half.map(|half| half.clamp(0.0, self.normal_load_share))
    }
}

/// Normal forces at rest (left, right, front) as shares of the weight.
pub(crate) fn static_loads(robot: &Robot) -> Vector3<f64> {
    let weight = robot.parameters().total_mass() * robot.parameters().gravity;
    robot.normal_force_projection().static_force / weight
}

/// Start, goal and torque limits of one maneuver, all at the reference point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Maneuver {
    /// The point that start and goal speak of.
    pub reference_point: ReferencePoint,
    /// Start state at the reference point.
    pub start: State,
    /// Goal at the reference point.
    pub goal: Goal,
    /// Largest torque magnitude per wheel, N m; 0 for a wheel without drive.
    pub torque_limit: PerWheel<f64>,
    /// What the plan must keep on the way.
    pub limits: ManeuverLimits,
}

impl Maneuver {
    /// The bounds of the torque limit of a wheel.
    const TORQUE_RULE: Rule = Rule::between(0.0, TORQUE_LIMIT, "N m");

    /// The rules of all fields.
    pub fn rules() -> RuleSet {
        let torque_limits = ["torque_limit_left_n_m", "torque_limit_right_n_m"].map(|field| (field, Self::TORQUE_RULE));
        let goal = rules_of_state()
            .across(&["free"], "names fields of the goal, each once, and none that has a value")
            .across(&["free"], "leaves at least one field of the goal constrained");
        let limits = RuleSet::of(ManeuverLimits::RULES.map(|(field, _, rule)| (field, rule)));
        RuleSet::of(torque_limits).with("start", rules_of_state()).with("goal", goal).with("limits", limits)
    }

    /// The paper's case: 5 m forward from rest to rest with 1 N m per wheel.
    pub fn forward_drive() -> Self {
        Self {
            reference_point: ReferencePoint::ChassisCenterOfMass,
            start: State::default(),
            goal: Goal::at_rest(0.0, 5.0, 0.0),
            torque_limit: PerWheel::new(1.0, 1.0),
            limits: ManeuverLimits::default(),
        }
    }

    /// Adds the violated rules to `checks`, under field names relative to the maneuver.
    pub(crate) fn check(&self, checks: &mut Checks) {
        checks.within("start", |checks| check_state(&self.start, checks));
        checks.within("goal", |checks| {
            for (component, value) in self.goal.constrained() {
                checks.bounds(component.field(), value, &component.rule());
            }
            let constrained = self.goal.constrained().count();
            checks.require("free", "every field", constrained > 0, "such that at least one field is constrained", None);
        });
        for (field, limit) in
            [("torque_limit_left_n_m", self.torque_limit.left), ("torque_limit_right_n_m", self.torque_limit.right)]
        {
            checks.bounds(field, limit, &Self::TORQUE_RULE);
        }
        checks.within("limits", |checks| {
            for (field, value, rule) in ManeuverLimits::RULES {
                checks.bounds(field, value(&self.limits), &rule);
            }
        });
    }

    /// The goal heading in the winding nearest to the start's, rad; none where it is free.
    pub fn nearest_goal_heading(&self) -> Option<f64> {
        let start = self.start.configuration.heading;
        self.goal.value(StateComponent::Heading).map(|goal| start + wrapped_angle(goal - start))
    }

    /// The start state at the chassis centre of mass.
    pub fn start_at_center_of_mass(&self, robot: &RobotParameters) -> State {
        self.start.moved_by(-self.reference_point.offset(robot))
    }

    /// Constrained components of `end` (a state at the reference point, at the end of a rollout in the
    /// [frame of its end](crate::simulation::EndFrame)) minus goal; the heading modulo 2 pi, 0 where free.
    pub fn goal_error(&self, end: &State) -> SVector<f64, { State::LEN }> {
        let end = end.to_vector();
        let mut error = SVector::zeros();
        for (component, value) in self.goal.constrained() {
            let difference = end[component.index()] - value;
            error[component.index()] =
                if component == StateComponent::Heading { wrapped_angle(difference) } else { difference };
        }
        error
    }
}

/// The rules of the components of a state.
pub(crate) fn rules_of_state() -> RuleSet {
    RuleSet::of(StateComponent::ALL.map(|component| (component.field(), component.rule())))
}

/// Adds the violated rules of a start state to `checks`.
pub(crate) fn check_state(state: &State, checks: &mut Checks) {
    let values = state.to_vector();
    for component in StateComponent::ALL {
        checks.bounds(component.field(), values[component.index()], &component.rule());
    }
}

/// The angle in [-pi, pi] that differs from `angle` by whole turns.
pub fn wrapped_angle(angle: f64) -> f64 {
    angle - (angle / std::f64::consts::TAU).round() * std::f64::consts::TAU
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heading_error_is_modulo_whole_turns() {
        let mut end = State::default();
        end.configuration.y = 5.0;
        end.configuration.heading = std::f64::consts::TAU + 0.25;
        let error = Maneuver::forward_drive().goal_error(&end);
        // One subtraction of 2 pi rounds to a few 1e-16.
        assert!((error[StateComponent::Heading.index()] - 0.25).abs() < 1e-15);
        assert_eq!(error[StateComponent::Y.index()], 0.0);
    }

    #[test]
    fn axle_start_lies_behind_the_center_of_mass() {
        let robot = RobotParameters::default();
        let maneuver = Maneuver { reference_point: ReferencePoint::AxleMidpoint, ..Maneuver::forward_drive() };
        let start = maneuver.start_at_center_of_mass(&robot);
        assert_eq!((start.configuration.x, start.configuration.y), (-0.02, 0.07));
    }

    #[test]
    fn all_violations_are_reported_at_once() {
        let mut maneuver = Maneuver::forward_drive();
        maneuver.torque_limit = PerWheel::new(-1.0, f64::NAN);
        maneuver.start.velocity.x = f64::INFINITY;
        let mut checks = Checks::new();
        maneuver.check(&mut checks);
        assert_eq!(checks.count(), 3);
    }
}
