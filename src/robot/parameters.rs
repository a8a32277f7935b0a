//! The numbers that describe one robot, with their accepted ranges.

use nalgebra::Vector2;

use crate::rules::{BoundedField, Checks, Number, Rule, RuleSet, Violations};

/// Largest accepted product of friction coefficient and relative height of the centre of mass.
///
/// Near 1 sliding friction can lift its own contact (Painleve's paradox) and the one-step problem may lose uniqueness.
const PARADOX_LIMIT: f64 = 0.9;
const PARADOX_RULE: &str = "friction coefficient times height is at most 0.9 of half the track width and 0.9 of the \
                            distance from axle to front support: beyond, the motion may not be unique";

/// A drive motor as a wheel sees it, gears included: its torque falls linearly with the speed.
///
/// `M <= max(0, stall_torque (1 - omega / free_speed))`, and the same the other way round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    /// Torque at standstill, N m at the wheel.
    pub stall_torque: f64,
    /// Speed without load, rad/s at the wheel; positive.
    pub free_speed: f64,
}

impl Motor {
    /// The bounds of the stall torque, which is the torque limit of those who give none.
    pub(crate) const STALL_TORQUE_RULE: Rule = Rule::between(1e-6, 1e6, "N m");
    pub(crate) const RULES: [BoundedField<Self>; 2] = [
        ("motor_stall_torque_n_m", |motor| motor.stall_torque, Self::STALL_TORQUE_RULE),
        ("motor_free_speed_rad_s", |motor| motor.free_speed, Rule::between(1e-3, 1e5, "rad/s")),
    ];
}

/// Parameters of the robot; [`Default`] is the reference robot of `docs/model.md`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobotParameters {
    /// Chassis mass without the wheels, kg.
    pub chassis_mass: f64,
    /// Mass of each wheel, kg.
    pub wheel_mass: f64,
    /// Yaw inertia of the chassis about its centre of mass, kg m2.
    pub chassis_yaw_inertia: f64,
    /// Inertia of each wheel about its diameter, kg m2.
    pub wheel_diametral_inertia: f64,
    /// Spin inertia of each wheel, rotor and gear included, kg m2.
    pub wheel_spin_inertia: f64,
    /// Wheel radius, m.
    pub wheel_radius: f64,
    /// Distance of the wheel contacts, m.
    pub track_width: f64,
    /// Distance from the axle to the front support, m.
    pub axle_to_front_support: f64,
    /// Front support right of the centreline, m.
    pub front_support_right: f64,
    /// Centre of mass of the chassis right of the centreline, m.
    pub center_of_mass_right: f64,
    /// Centre of mass of the chassis ahead of the axle, m.
    pub center_of_mass_forward: f64,
    /// Height of the chassis centre of mass over the floor, m.
    pub center_of_mass_height: f64,
    /// Coulomb friction coefficient of the wheels.
    pub wheel_friction_coefficient: f64,
    /// Coulomb friction coefficient of the front support; 0 is frictionless.
    pub front_friction_coefficient: f64,
    /// Tangential restitution (Newton's law) of all contacts, 0 to 1.
    pub tangential_restitution: f64,
    /// Gravity, m/s2.
    pub gravity: f64,
    /// The motor of each wheel; none: any torque within the limits at any speed.
    pub motor: Option<Motor>,
    /// Viscous friction between chassis and each wheel, N m s/rad.
    pub wheel_viscous_friction: f64,
    /// Centre of mass of the bare chassis relative to that of the chassis, in the body frame (right, forward), m: zero
    /// unless a [payload](super::Payload) has been joined.
    pub bare_center_of_mass: Vector2<f64>,
    /// Sum of mass times height times place over bare chassis and payload, about the centre of mass of both, in the body frame
    /// (right, forward), kg m2: zero unless a payload has been joined.
    pub product_of_inertia: Vector2<f64>,
}

impl Default for RobotParameters {
    fn default() -> Self {
        Self {
            chassis_mass: 10.33,
            wheel_mass: 0.6,
            chassis_yaw_inertia: 0.20,
            wheel_diametral_inertia: 5.5e-4,
            wheel_spin_inertia: 3.0e-3,
            wheel_radius: 0.06,
            track_width: 0.30,
            axle_to_front_support: 0.28,
            front_support_right: 0.0,
            center_of_mass_right: -0.02,
            center_of_mass_forward: 0.07,
            center_of_mass_height: 0.10,
            wheel_friction_coefficient: 0.45,
            front_friction_coefficient: 0.0,
            tangential_restitution: 0.0,
            gravity: 9.81,
            motor: None,
            wheel_viscous_friction: 0.0,
            bare_center_of_mass: Vector2::zeros(),
            product_of_inertia: Vector2::zeros(),
        }
    }
}

impl RobotParameters {
    /// Checks signs, ranges, the statics of the three contacts and the guard against paradoxes.
    ///
    /// # Errors
    /// All violated rules, with field names of the public contract.
    pub fn validate(&self) -> Result<(), Violations> {
        let mut checks = Checks::new();
        checks.within("robot", |checks| self.check(checks));
        checks.finish()
    }

    /// Adds the violated rules to `checks`, under field names relative to the robot.
    pub(crate) fn check(&self, checks: &mut Checks) {
        let before = checks.count();
        for (field, value, rule) in Self::RULES {
            checks.bounds(field, value(self), &rule);
        }
        if let Some(motor) = &self.motor {
            for (field, value, rule) in Motor::RULES {
                checks.bounds(field, value(motor), &rule);
            }
        }
        // Statics and the paradox guard divide by lengths: judge them only when the lengths are valid.
        if checks.count() == before {
            let position = (self.center_of_mass_right, self.center_of_mass_forward);
            self.check_loads(("center_of_mass_right_m", "center_of_mass_forward_m"), position, checks);
            self.check_paradox_guard(checks);
        }
    }

    /// The rule of every parameter, by its field in the contract.
    ///
    /// The bounds span from toys to trucks; they keep every product of the model far from overflow and underflow.
    const RULES: [BoundedField<Self>; 17] = [
        ("chassis_mass_kg", |robot| robot.chassis_mass, Self::CHASSIS_MASS_RULE),
        ("wheel_mass_kg", |robot| robot.wheel_mass, Rule::between(1e-4, 1e4, "kg")),
        ("chassis_yaw_inertia_kg_m2", |robot| robot.chassis_yaw_inertia, Self::YAW_INERTIA_RULE),
        ("wheel_diametral_inertia_kg_m2", |robot| robot.wheel_diametral_inertia, Rule::between(1e-9, 1e4, "kg m2")),
        ("wheel_spin_inertia_kg_m2", |robot| robot.wheel_spin_inertia, Rule::between(1e-9, 1e4, "kg m2")),
        ("wheel_radius_m", |robot| robot.wheel_radius, Rule::between(1e-3, 10.0, "m")),
        ("track_width_m", |robot| robot.track_width, Rule::between(1e-2, 100.0, "m")),
        ("axle_to_front_support_m", |robot| robot.axle_to_front_support, Rule::between(1e-2, 100.0, "m")),
        ("front_support_right_m", |robot| robot.front_support_right, Rule::between(-100.0, 100.0, "m")),
        ("center_of_mass_right_m", |robot| robot.center_of_mass_right, Rule::between(-100.0, 100.0, "m")),
        ("center_of_mass_forward_m", |robot| robot.center_of_mass_forward, Rule::between(-100.0, 100.0, "m")),
        ("center_of_mass_height_m", |robot| robot.center_of_mass_height, Rule::between(0.0, 100.0, "m")),
        ("wheel_friction_coefficient", |robot| robot.wheel_friction_coefficient, Rule::between(0.0, 10.0, "")),
        ("front_friction_coefficient", |robot| robot.front_friction_coefficient, Rule::between(0.0, 10.0, "")),
        ("tangential_restitution", |robot| robot.tangential_restitution, Rule::between(0.0, 1.0, "")),
        ("gravity_m_s2", |robot| robot.gravity, Rule::between(1e-2, 1e3, "m/s2")),
        ("wheel_viscous_friction_n_m_s", |robot| robot.wheel_viscous_friction, Rule::between(0.0, 1e4, "N m s/rad")),
    ];
    /// Of the chassis, a payload included.
    pub(super) const CHASSIS_MASS_RULE: Rule = Rule::between(1e-3, 1e5, "kg");
    /// Of the chassis, a payload included.
    pub(super) const YAW_INERTIA_RULE: Rule = Rule::between(1e-7, 1e6, "kg m2");

    /// The rules of all parameters.
    pub fn rules() -> RuleSet {
        let lengths = ["center_of_mass_height_m", "track_width_m", "axle_to_front_support_m"];
        let with_lengths = |field| [&[field][..], &lengths].concat();
        let own = Self::RULES.map(|(field, _, rule)| (field, rule));
        let motor = Motor::RULES.map(|(field, _, rule)| (field, rule));
        RuleSet::of(own.into_iter().chain(motor))
            .across(&motor.map(|(field, _)| field), "given together")
            .across(
                &["center_of_mass_right_m", "center_of_mass_forward_m"],
                "no contact has a negative normal force at rest",
            )
            .across(&with_lengths("wheel_friction_coefficient"), PARADOX_RULE)
            .across(&with_lengths("front_friction_coefficient"), PARADOX_RULE)
    }

    /// Requires that every contact carries load at rest; the fields (right, forward) of what is at `position` are to blame.
    pub(super) fn check_loads(&self, (right, forward): (&str, &str), position: (f64, f64), checks: &mut Checks) {
        let loads = self.static_loads();
        // What lifts both wheels is too far forward.
        let of_wheel = if loads[0] < 0.0 && loads[1] < 0.0 { forward } else { right };
        let contacts = [("left wheel", of_wheel), ("right wheel", of_wheel), ("front support", forward)];
        for ((name, field), load) in contacts.into_iter().zip(loads) {
            let rule = format_args!(
                "such that the {name} carries load at rest (its normal force would be {} N)",
                Number(load)
            );
            let position = format_args!("({}, {}) (right, forward)", Number(position.0), Number(position.1));
            checks.require(field, position, load >= 0.0, rule, Some(0.0));
        }
    }

    fn check_paradox_guard(&self, checks: &mut Checks) {
        for guard in self.paradox_guards() {
            let ParadoxGuard { field, friction, length_name, length } = guard;
            let largest = PARADOX_LIMIT * length / self.center_of_mass_height;
            let height = self.center_of_mass_height;
            let rule = format_args!(
                "such that the motion is unique: times center_of_mass_height_m ({}) at most {PARADOX_LIMIT} of \
                 {length_name} ({})",
                Number(height),
                Number(length)
            );
            checks.require(field, Number(friction), guard.admits(height), rule, Some(largest));
        }
    }

    /// Each friction coefficient with each length that it is judged by.
    pub(super) fn paradox_guards(&self) -> [ParadoxGuard; 4] {
        let wheel = ("wheel_friction_coefficient", self.wheel_friction_coefficient);
        let front = ("front_friction_coefficient", self.front_friction_coefficient);
        let track = ("track_width_m / 2", self.track_width / 2.0);
        let base = ("axle_to_front_support_m", self.axle_to_front_support);
        [(wheel, track), (wheel, base), (front, track), (front, base)]
            .map(|((field, friction), (length_name, length))| ParadoxGuard { field, friction, length_name, length })
    }

    /// Normal forces at rest, N: left, right, front.
    fn static_loads(&self) -> [f64; 3] {
        // Moments about the axle and about the centreline, in the frame of the axle midpoint.
        let chassis_weight = self.chassis_mass * self.gravity;
        let total_weight = chassis_weight + 2.0 * self.wheel_mass * self.gravity;
        let front = chassis_weight * self.center_of_mass_forward / self.axle_to_front_support;
        let axle = total_weight - front;
        let rolling_moment = chassis_weight * self.center_of_mass_right - front * self.front_support_right;
        let difference = rolling_moment / (self.track_width / 2.0);
        [0.5 * (axle - difference), 0.5 * (axle + difference), front]
    }

    /// The time in which gravity moves something by half of the track width, from rest: what is short and long for the robot, s.
    pub fn natural_time(&self) -> f64 {
        (self.track_width / self.gravity).sqrt()
    }

    /// Mass of the whole robot, kg.
    pub fn total_mass(&self) -> f64 {
        self.chassis_mass + 2.0 * self.wheel_mass
    }

    /// Weight of the whole robot, N.
    pub fn weight(&self) -> f64 {
        self.total_mass() * self.gravity
    }

    /// What turns a robot whose wheels hold, about the axle midpoint, kg m2: the wheels and what they turn by rolling included.
    pub fn rolling_yaw_inertia(&self) -> f64 {
        let rolling_mass = self.wheel_mass + self.wheel_spin_inertia / self.wheel_radius.powi(2);
        self.chassis_yaw_inertia
            + self.chassis_mass * self.axle_midpoint().norm_squared()
            + 2.0 * (self.wheel_diametral_inertia + rolling_mass * (self.track_width / 2.0).powi(2))
    }

    /// Friction coefficients of left wheel, right wheel and front support.
    pub fn friction_coefficients(&self) -> [f64; 3] {
        [self.wheel_friction_coefficient, self.wheel_friction_coefficient, self.front_friction_coefficient]
    }

    /// Contact points of left wheel, right wheel and front support relative to the chassis centre of mass, in the
    /// body frame (right, forward), m.
    pub fn contact_points(&self) -> [Vector2<f64>; 3] {
        let half_track = self.track_width / 2.0;
        let axle = self.axle_midpoint();
        [
            axle + Vector2::new(-half_track, 0.0),
            axle + Vector2::new(half_track, 0.0),
            axle + Vector2::new(self.front_support_right, self.axle_to_front_support),
        ]
    }

    /// The axle midpoint relative to the chassis centre of mass, in the body frame (right, forward), m.
    pub fn axle_midpoint(&self) -> Vector2<f64> {
        Vector2::new(-self.center_of_mass_right, -self.center_of_mass_forward)
    }

    /// Centre of mass of the whole robot relative to the chassis centre of mass, in the body frame, m.
    pub fn whole_center_of_mass(&self) -> Vector2<f64> {
        self.axle_midpoint() * (2.0 * self.wheel_mass / self.total_mass())
    }
}

/// A friction coefficient and a length that bound the height of the centre of mass.
pub(super) struct ParadoxGuard {
    /// The field of the coefficient.
    pub(super) field: &'static str,
    friction: f64,
    /// The length in words of the contract.
    pub(super) length_name: &'static str,
    length: f64,
}

impl ParadoxGuard {
    pub(super) fn admits(&self, height: f64) -> bool {
        self.friction * height <= PARADOX_LIMIT * self.length
    }

    /// The largest height, m.
    pub(super) fn largest_height(&self) -> f64 {
        PARADOX_LIMIT * self.length / self.friction
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reference_robot_is_valid() {
        assert_eq!(RobotParameters::default().validate(), Ok(()));
    }

    #[test]
    fn static_loads_carry_the_weight() {
        let robot = RobotParameters::default();
        let total: f64 = robot.static_loads().iter().sum();
        // Three sums of numbers near 100: rounding stays below 1e-12.
        assert!((total - robot.weight()).abs() < 1e-12);
    }

    #[test]
    fn each_spoiled_field_is_named() {
        type Spoil = fn(&mut RobotParameters);
        let motor = |stall_torque, free_speed| Some(Motor { stall_torque, free_speed });
        assert_eq!(RobotParameters { motor: motor(8.0, 15.0), ..RobotParameters::default() }.validate(), Ok(()));
        let cases: [(Spoil, &str); 12] = [
            (|robot| robot.chassis_mass = -1.0, "robot.chassis_mass_kg"),
            (|robot| robot.wheel_radius = 0.0, "robot.wheel_radius_m"),
            (|robot| robot.gravity = f64::NAN, "robot.gravity_m_s2"),
            (|robot| robot.tangential_restitution = 1.5, "robot.tangential_restitution"),
            (|robot| robot.wheel_friction_coefficient = -0.1, "robot.wheel_friction_coefficient"),
            (|robot| robot.center_of_mass_height = 2.0, "robot.wheel_friction_coefficient"),
            (|robot| robot.center_of_mass_forward = -0.05, "robot.center_of_mass_forward_m"),
            (|robot| robot.center_of_mass_right = 0.4, "robot.center_of_mass_right_m"),
            (|robot| robot.wheel_viscous_friction = -1.0, "robot.wheel_viscous_friction_n_m_s"),
            (|robot| robot.wheel_viscous_friction = f64::NAN, "robot.wheel_viscous_friction_n_m_s"),
            (|robot| robot.motor = Some(Motor { stall_torque: 0.0, free_speed: 15.0 }), "robot.motor_stall_torque_n_m"),
            (
                |robot| robot.motor = Some(Motor { stall_torque: 8.0, free_speed: 1e300 }),
                "robot.motor_free_speed_rad_s",
            ),
        ];
        for (spoil, field) in cases {
            let mut robot = RobotParameters::default();
            spoil(&mut robot);
            let violations = robot.validate().unwrap_err();
            assert_eq!(violations.list()[0].field, field, "{violations}");
        }
    }
}
