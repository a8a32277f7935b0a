//! A load on the chassis, joined to it by the parallel-axis theorem.
//!
//! ```text
//! m  = m_c + m_p
//! c' = c + m_p / m (p - c)
//! I' = I_c + I_p + m_c m_p / m |p - c|^2
//! P  = m_c m_p / m (h_p - h_c) (p - c)
//! ```
//!
//! `c`, `p`: centres of mass of bare chassis and payload; the heights `h_c`, `h_p` are weighted in the same way as `c`.

use nalgebra::Vector2;

use super::parameters::RobotParameters;
use crate::rules::{BoundedField, Checks, Number, Rule, RuleSet};

/// A load that is fixed to the chassis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Payload {
    /// Mass, kg; 0 is no load.
    pub mass: f64,
    /// Its centre of mass to the right of the axle midpoint, m.
    pub right: f64,
    /// Its centre of mass ahead of the axle, m.
    pub forward: f64,
    /// Height of its centre of mass over the floor, m.
    pub height: f64,
    /// Yaw inertia about its own centre of mass, kg m2; 0 for a point.
    pub yaw_inertia: f64,
}

impl Payload {
    /// The rule of every field, by its name in the contract: half of what chassis and payload may have together, and positions
    /// as those of the chassis.
    const RULES: [BoundedField<Self>; 5] = [
        ("mass_kg", |payload| payload.mass, Rule::between(0.0, 5e4, "kg")),
        ("right_m", |payload| payload.right, Rule::within_magnitude(100.0, "m")),
        ("forward_m", |payload| payload.forward, Rule::within_magnitude(100.0, "m")),
        ("height_m", |payload| payload.height, Rule::between(0.0, 100.0, "m")),
        ("yaw_inertia_kg_m2", |payload| payload.yaw_inertia, Rule::between(0.0, 5e5, "kg m2")),
    ];

    /// The rules of all fields.
    pub fn rules() -> RuleSet {
        RuleSet::of(Self::RULES.map(|(field, _, rule)| (field, rule))).across(
            &["mass_kg", "right_m", "forward_m", "height_m", "yaw_inertia_kg_m2"],
            "chassis and payload together keep the rules of the robot: mass, yaw inertia, load of each contact at rest, \
             friction coefficient times height",
        )
    }

    /// Whether it is there: without mass it is not, whatever its place and its yaw inertia.
    pub(crate) fn is_load(&self) -> bool {
        self.mass > 0.0
    }

    /// Its centre of mass relative to the axle midpoint, in the body frame (right, forward), m.
    pub fn position(&self) -> Vector2<f64> {
        Vector2::new(self.right, self.forward)
    }

    /// Adds the violated rules to `checks`, under field names relative to the payload.
    pub(crate) fn check(&self, checks: &mut Checks) {
        for (field, value, rule) in Self::RULES {
            checks.bounds(field, value(self), &rule);
        }
    }

    /// Adds to `checks` what a valid payload breaks of the rules of a valid `bare` robot.
    pub(crate) fn check_joined(&self, bare: &RobotParameters, checks: &mut Checks) {
        let joined = bare.with_payload(self);
        let sums = [
            ("mass_kg", self.mass, joined.chassis_mass, RobotParameters::CHASSIS_MASS_RULE),
            ("yaw_inertia_kg_m2", self.yaw_inertia, joined.chassis_yaw_inertia, RobotParameters::YAW_INERTIA_RULE),
        ];
        for (field, value, sum, rule) in sums {
            let words = format!("such that chassis and payload together have {rule} (they would have {})", Number(sum));
            checks.require(field, Number(value), rule.admits(sum), &words, Some(rule.maximum));
        }
        joined.check_loads(("right_m", "forward_m"), (self.right, self.forward), checks);
        for guard in joined.paradox_guards() {
            // Of the joined centre of mass, solved for the height of the payload.
            let share = self.mass / joined.chassis_mass;
            let largest = bare.center_of_mass_height + (guard.largest_height() - bare.center_of_mass_height) / share;
            let words = format!(
                "at most {} m: {} * height of the centre of mass of chassis and payload / ({}) above 0.9 may lose \
                 uniqueness",
                Number(largest),
                guard.field,
                guard.length_name
            );
            checks.require(
                "height_m",
                Number(self.height),
                guard.admits(joined.center_of_mass_height),
                &words,
                Some(largest),
            );
        }
    }
}

impl RobotParameters {
    /// The robot with a load fixed to its chassis; the reference point of the chassis stays where it is.
    #[must_use]
    pub fn with_payload(&self, payload: &Payload) -> Self {
        if !payload.is_load() {
            return *self;
        }
        let chassis_mass = self.chassis_mass + payload.mass;
        let share = payload.mass / chassis_mass;
        let lever = payload.position() + self.axle_midpoint();
        let shift = share * lever;
        let rise = payload.height - self.center_of_mass_height;
        Self {
            chassis_mass,
            chassis_yaw_inertia: self.chassis_yaw_inertia
                + payload.yaw_inertia
                + self.chassis_mass * share * lever.norm_squared(),
            center_of_mass_right: self.center_of_mass_right + shift.x,
            center_of_mass_forward: self.center_of_mass_forward + shift.y,
            center_of_mass_height: self.center_of_mass_height + share * rise,
            bare_center_of_mass: self.bare_center_of_mass - shift,
            product_of_inertia: self.product_of_inertia + self.chassis_mass * rise * shift,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::Violations;

    fn box_on_the_deck() -> Payload {
        Payload { mass: 5.0, right: 0.03, forward: 0.1, height: 0.2, yaw_inertia: 0.05 }
    }

    fn violated(robot: &RobotParameters, payload: &Payload) -> Vec<String> {
        let mut checks = Checks::new();
        payload.check(&mut checks);
        if checks.count() == 0 {
            payload.check_joined(robot, &mut checks);
        }
        let violations = checks.finish().err();
        violations.iter().flat_map(Violations::list).map(|violation| violation.field.clone()).collect()
    }

    #[test]
    fn payload_at_the_center_of_the_chassis_is_a_heavier_chassis() {
        let bare = RobotParameters::default();
        let (right, forward) = (bare.center_of_mass_right, bare.center_of_mass_forward);
        let payload = Payload { mass: 3.0, right, forward, height: bare.center_of_mass_height, yaw_inertia: 0.07 };
        let heavier = RobotParameters {
            chassis_mass: bare.chassis_mass + 3.0,
            chassis_yaw_inertia: bare.chassis_yaw_inertia + 0.07,
            ..bare
        };
        let joined = bare.with_payload(&payload);
        let numbers = |robot: &RobotParameters| {
            let RobotParameters { chassis_mass, chassis_yaw_inertia, bare_center_of_mass, .. } = *robot;
            let center = [robot.center_of_mass_right, robot.center_of_mass_forward, robot.center_of_mass_height];
            [chassis_mass, chassis_yaw_inertia, bare_center_of_mass.x, bare_center_of_mass.y].into_iter().chain(center)
        };
        // Sums and products of numbers up to 14.
        assert!(numbers(&joined).zip(numbers(&heavier)).all(|(joined, heavier)| (joined - heavier).abs() < 1e-12));
    }

    #[test]
    fn joined_robot_keeps_the_moments_of_its_parts() {
        let (bare, payload) = (RobotParameters::default(), box_on_the_deck());
        let joined = bare.with_payload(&payload);
        let at = |robot: &RobotParameters| Vector2::new(robot.center_of_mass_right, robot.center_of_mass_forward);
        let first = bare.chassis_mass * at(&bare) + payload.mass * payload.position();
        // About the axle midpoint; a few roundings of numbers near 1.
        assert!((joined.chassis_mass * at(&joined) - first).norm() < 1e-14);
        let second = |inertia: f64, mass: f64, at: Vector2<f64>| inertia + mass * at.norm_squared();
        let of_parts = second(bare.chassis_yaw_inertia, bare.chassis_mass, at(&bare))
            + second(payload.yaw_inertia, payload.mass, payload.position());
        assert!((second(joined.chassis_yaw_inertia, joined.chassis_mass, at(&joined)) - of_parts).abs() < 1e-14);
        assert!((at(&joined) + joined.bare_center_of_mass - at(&bare)).norm() < 1e-15);
    }

    #[test]
    fn loads_balance_the_moments_of_chassis_payloads_and_wheels() {
        let bare = RobotParameters::default();
        let loads = [
            Payload { mass: 4.0, right: 0.05, forward: 0.02, height: 0.15, yaw_inertia: 0.0 },
            Payload { mass: 2.0, right: -0.06, forward: 0.12, height: 0.02, yaw_inertia: 0.03 },
        ];
        let joined = loads.iter().fold(bare, |robot, load| robot.with_payload(load));
        let robot = crate::robot::Robot::new(joined).unwrap();
        let projection = robot.normal_force_projection();
        let (acceleration, yaw_acceleration, yaw_rate) = (Vector2::new(0.7, -0.4), 2.5, 1.3);
        let change = [acceleration.x, acceleration.y, yaw_acceleration, 0.0, 0.0];
        let forces = projection.static_force
            + projection.centrifugal * yaw_rate * yaw_rate
            + projection.velocity_change_map * nalgebra::Vector5::from(change);

        // Mass, place from the joined centre of mass, height.
        let points = joined.contact_points();
        let chassis = Vector2::new(bare.center_of_mass_right, bare.center_of_mass_forward) + joined.axle_midpoint();
        let wheels = [0, 1].map(|wheel| (bare.wheel_mass, points[wheel], bare.wheel_radius));
        let others = loads.map(|load| (load.mass, load.position() + joined.axle_midpoint(), load.height));
        let bodies = wheels.into_iter().chain(others).chain([(bare.chassis_mass, chassis, bare.center_of_mass_height)]);
        let moment = bodies.fold(Vector2::zeros(), |sum, (mass, place, height)| {
            let turning = yaw_acceleration * Vector2::new(-place.y, place.x) - yaw_rate * yaw_rate * place;
            sum + mass * (bare.gravity * place - height * (acceleration + turning))
        });
        let of_forces: Vector2<f64> = points.iter().zip(&forces).map(|(point, force)| *point * *force).sum();
        // Rounding of a dozen products near 10.
        assert!((of_forces - moment).norm() < 1e-13, "{of_forces} {moment}");
    }

    #[test]
    fn no_mass_is_the_bare_robot() {
        let payload = Payload { mass: 0.0, ..box_on_the_deck() };
        assert_eq!(RobotParameters::default().with_payload(&payload), RobotParameters::default());
    }

    #[test]
    fn each_spoiled_field_is_named() {
        let robot = RobotParameters::default();
        assert_eq!(violated(&robot, &box_on_the_deck()), Vec::<String>::new());
        let spoiled = |spoil: fn(&mut Payload)| {
            let mut payload = box_on_the_deck();
            spoil(&mut payload);
            violated(&robot, &payload)
        };
        assert_eq!(spoiled(|payload| payload.mass = -1.0), ["mass_kg"]);
        assert_eq!(spoiled(|payload| payload.right = f64::NAN), ["right_m"]);
        assert_eq!(spoiled(|payload| payload.yaw_inertia = 1e300), ["yaw_inertia_kg_m2"]);
        // Together with the chassis.
        let heavy = RobotParameters { chassis_mass: 9e4, chassis_yaw_inertia: 9e5, ..robot };
        assert_eq!(violated(&heavy, &Payload { mass: 2e4, ..box_on_the_deck() }), ["mass_kg"]);
        assert_eq!(violated(&heavy, &Payload { yaw_inertia: 2e5, ..box_on_the_deck() }), ["yaw_inertia_kg_m2"]);
        assert_eq!(spoiled(|payload| payload.right = 1.0), ["right_m"]);
        assert_eq!(spoiled(|payload| payload.forward = -1.0), ["forward_m"]);
        assert_eq!(spoiled(|payload| payload.height = 1.0), ["height_m"]);
    }

    #[test]
    fn largest_height_of_a_payload_is_accepted() {
        let (robot, payload) = (RobotParameters::default(), box_on_the_deck());
        let mut checks = Checks::new();
        Payload { height: 1.0, ..payload }.check_joined(&robot, &mut checks);
        let largest = checks.finish().unwrap_err().list()[0].limit.unwrap();
        // The bound is exact up to rounding.
        assert_eq!(violated(&robot, &Payload { height: largest * (1.0 - 1e-12), ..payload }), Vec::<String>::new());
        assert_eq!(violated(&robot, &Payload { height: largest * (1.0 + 1e-12), ..payload }), ["height_m"]);
    }
}
