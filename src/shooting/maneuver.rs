//! What is asked: a start, a goal in some or all components, and the torque limits.

use nalgebra::{SVector, Vector2, Vector3};

use crate::robot::{Motor, PerWheel, Robot, RobotParameters, State};
use crate::rules::{Checks, OptionalField, Rule, RuleSet};

/// Largest accepted coordinate, m: beyond it a millimetre is near the rounding of the rollout.
pub(super) const POSITION_LIMIT: f64 = 1e4;
/// Largest accepted heading, rad: 10,000 steps from there round to less than 1e-8, and whole turns may be left out.
const HEADING_LIMIT: f64 = 1e4;
/// Largest accepted wheel angle, rad, as after 60 km on small wheels. The motion does not depend on it, and 10,000 steps from there
/// round to less than the default goal tolerance.
const WHEEL_ANGLE_LIMIT: f64 = 1e6;
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
    /// Centre of mass of the bare chassis, as in the paper; a payload does not move it.
    #[default]
    ChassisCenterOfMass,
    /// Midpoint of the axle, what planners call `base_link`.
    AxleMidpoint,
}

impl ReferencePoint {
    /// The point relative to the chassis centre of mass, in the body frame (right, forward), m.
    pub fn offset(self, robot: &RobotParameters) -> Vector2<f64> {
        match self {
            Self::ChassisCenterOfMass => robot.bare_center_of_mass,
            Self::AxleMidpoint => robot.axle_midpoint(),
        }
    }

    /// From the point to the axle midpoint, in the body frame, m.
    pub(crate) fn to_axle_midpoint(self, robot: &RobotParameters) -> Vector2<f64> {
        robot.axle_midpoint() - self.offset(robot)
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
            Self::Heading => Rule::within_magnitude(HEADING_LIMIT, "rad"),
            Self::WheelAngleLeft | Self::WheelAngleRight => Rule::within_magnitude(WHEEL_ANGLE_LIMIT, "rad"),
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

/// Whether the wheels may slip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SlipPolicy {
    /// Wherever it is faster.
    #[default]
    Allowed,
    /// Never: both wheels stick at every step.
    Forbidden,
}

/// What a plan must keep at every step of its grid; an absent limit bounds nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManeuverLimits {
    /// Least normal force of each contact as a share of the weight, at most half of the contact's share at rest.
    pub normal_load_share: f64,
    /// Largest share of the grip of each wheel that its friction force may use, below 1; implies that no wheel slips.
    pub grip_utilization: Option<f64>,
    /// Largest magnitude of the rate of each wheel, rad/s.
    pub wheel_rate: Option<f64>,
    /// Largest speed of the point that the limits speak of, m/s.
    pub speed: Option<f64>,
    /// Largest magnitude of the yaw rate, rad/s.
    pub yaw_rate: Option<f64>,
    /// Largest acceleration of that point while its speed grows, m/s2.
    pub acceleration: Option<f64>,
    /// Largest acceleration of that point while its speed falls, m/s2.
    pub deceleration: Option<f64>,
    /// Largest magnitude of the yaw acceleration, rad/s2.
    pub yaw_acceleration: Option<f64>,
    /// Largest magnitude of the change of the torque of each wheel per time, N m/s.
    pub torque_rate: Option<f64>,
}

impl Default for ManeuverLimits {
    /// A hundredth of the weight: plans that balance on a contact do not survive small errors of the model.
    fn default() -> Self {
        Self {
            normal_load_share: 0.01,
            grip_utilization: None,
            wheel_rate: None,
            speed: None,
            yaw_rate: None,
            acceleration: None,
            deceleration: None,
            yaw_acceleration: None,
            torque_rate: None,
        }
    }
}

impl ManeuverLimits {
    /// Share of its static normal force that a contact must keep at most.
    const STATIC_SHARE: f64 = 0.5;
    /// The rule of every limit, by its field in the contract.
    ///
    /// The bounds span from toys to trucks; those above are no smaller than what starts and goals may have.
    const RULES: [OptionalField<Self>; 9] = [
        (
            "normal_load_share",
            |limits| Some(limits.normal_load_share),
            Rule::between(0.0, LARGEST_NORMAL_LOAD_SHARE, ""),
        ),
        ("grip_utilization", |limits| limits.grip_utilization, Rule::from_to_below(1e-3, 1.0, "")),
        ("wheel_rate_rad_s", |limits| limits.wheel_rate, Rule::between(1e-3, WHEEL_RATE_LIMIT, "rad/s")),
        ("speed_m_s", |limits| limits.speed, Rule::between(1e-4, SPEED_LIMIT, "m/s")),
        ("yaw_rate_rad_s", |limits| limits.yaw_rate, Rule::between(1e-4, YAW_RATE_LIMIT, "rad/s")),
        ("acceleration_m_s2", |limits| limits.acceleration, Rule::between(1e-4, 1e4, "m/s2")),
        ("deceleration_m_s2", |limits| limits.deceleration, Rule::between(1e-4, 1e4, "m/s2")),
        ("yaw_acceleration_rad_s2", |limits| limits.yaw_acceleration, Rule::between(1e-4, 1e6, "rad/s2")),
        ("torque_rate_n_m_s", |limits| limits.torque_rate, Rule::between(1e-6, 1e9, "N m/s")),
    ];

    /// The rules of all limits.
    pub(crate) fn rules() -> RuleSet {
        RuleSet::of(Self::RULES.map(|(field, _, rule)| (field, rule)))
    }

    /// Adds the violated rules to `checks`, under field names relative to the limits.
    pub(crate) fn check(&self, checks: &mut Checks) {
        for (field, value, rule) in Self::RULES {
            if let Some(value) = value(self) {
                checks.bounds(field, value, &rule);
            }
        }
    }

    /// The least normal forces (left, right, front) as shares of the weight.
    pub fn least_normal_loads(&self, robot: &Robot) -> Vector3<f64> {
        let half = static_loads(robot) * Self::STATIC_SHARE;
        half.map(|half| half.clamp(0.0, self.normal_load_share))
    }
}

/// Normal forces at rest (left, right, front) as shares of the weight.
pub(crate) fn static_loads(robot: &Robot) -> Vector3<f64> {
    robot.normal_force_projection().static_force / robot.parameters().weight()
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
    /// Whether the wheels may slip; see [`Maneuver::forbids_slip`].
    pub slip: SlipPolicy,
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
        RuleSet::of(torque_limits)
            .with("start", rules_of_state())
            .with("goal", goal)
            .with("limits", ManeuverLimits::rules())
            .across(&["slip", "limits.grip_utilization"], "no slip is allowed beside a share of the grip")
    }

    /// Whether no wheel may slip: so it is asked, or a share of the grip is all that a wheel may use.
    pub fn forbids_slip(&self) -> bool {
        match self.slip {
            SlipPolicy::Allowed => self.limits.grip_utilization.is_some(),
            SlipPolicy::Forbidden => true,
        }
    }

    /// The torque limit where none is given, N m: what the motor has at standstill, that of the paper without one.
    pub fn default_torque_limit(robot: &RobotParameters) -> f64 {
        const OF_THE_PAPER: f64 = 1.0;
        let stall_torque = robot.motor.map(|motor| motor.stall_torque);
        // A refused motor is named once, by its own field.
        stall_torque.filter(|&torque| Motor::STALL_TORQUE_RULE.admits(torque)).unwrap_or(OF_THE_PAPER)
    }

    /// The paper's case: 5 m forward from rest to rest with 1 N m per wheel.
    pub fn forward_drive() -> Self {
        Self {
            reference_point: ReferencePoint::ChassisCenterOfMass,
            start: State::default(),
            goal: Goal::at_rest(0.0, 5.0, 0.0),
            torque_limit: PerWheel::new(1.0, 1.0),
            limits: ManeuverLimits::default(),
            slip: SlipPolicy::default(),
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
        checks.bounds("torque_limit_left_n_m", self.torque_limit.left, &Self::TORQUE_RULE);
        checks.bounds("torque_limit_right_n_m", self.torque_limit.right, &Self::TORQUE_RULE);
        checks.within("limits", |checks| self.limits.check(checks));
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
    use crate::robot::Payload;

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
    fn center_of_the_bare_chassis_stays_the_reference_with_a_payload() {
        let bare = RobotParameters::default();
        let payload = Payload { mass: 4.0, right: 0.05, forward: 0.12, height: 0.2, yaw_inertia: 0.0 };
        let joined = bare.with_payload(&payload);
        let apart = |robot| -ReferencePoint::ChassisCenterOfMass.to_axle_midpoint(robot);
        // A few roundings of numbers near 0.1.
        assert!((apart(&joined) - apart(&bare)).norm() < 1e-15);
        assert_eq!(apart(&bare), Vector2::new(bare.center_of_mass_right, bare.center_of_mass_forward));
    }

    #[test]
    fn share_of_the_grip_forbids_slip() {
        let mut maneuver = Maneuver::forward_drive();
        assert!(!maneuver.forbids_slip());
        maneuver.limits.grip_utilization = Some(0.9);
        assert!(maneuver.forbids_slip());
    }

    #[test]
    fn each_spoiled_limit_is_named_with_its_range() {
        type Set = fn(&mut ManeuverLimits, f64);
        let cases: [(Set, &str, f64); 8] = [
            (|limits, value| limits.grip_utilization = Some(value), "grip_utilization", 1.0),
            (|limits, value| limits.wheel_rate = Some(value), "wheel_rate_rad_s", 1e300),
            (|limits, value| limits.speed = Some(value), "speed_m_s", 1e300),
            (|limits, value| limits.yaw_rate = Some(value), "yaw_rate_rad_s", 1e300),
            (|limits, value| limits.acceleration = Some(value), "acceleration_m_s2", 1e300),
            (|limits, value| limits.deceleration = Some(value), "deceleration_m_s2", 1e300),
            (|limits, value| limits.yaw_acceleration = Some(value), "yaw_acceleration_rad_s2", 1e300),
            (|limits, value| limits.torque_rate = Some(value), "torque_rate_n_m_s", 1e300),
        ];
        for (set, field, large) in cases {
            for value in [-1.0, 0.0, f64::NAN, f64::INFINITY, large] {
                let mut maneuver = Maneuver::forward_drive();
                set(&mut maneuver.limits, value);
                let mut checks = Checks::new();
                maneuver.check(&mut checks);
                let violations = checks.finish().unwrap_err();
                assert_eq!(violations.list().len(), 1, "{violations}");
                assert_eq!(violations.list()[0].field, format!("limits.{field}"));
                assert!(violations.to_string().contains(" and "), "{violations}");
            }
        }
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
