//! What the loads of the contacts allow friction to do, and what friction leaves of the loads (`docs/bounds.md`).
//!
//! Viscous friction takes from the torques of the wheels, at fast wheels as much as you like: with it only the balance of weight
//! bounds what friction can do, since torques do not enter that.
//!
//! Normal forces are affine in torques and friction forces. The front support's one follows from the balances of weight
//! and pitch alone, so it does not depend on wheel rates; with it the wheels' sum of normal forces is known too.

use nalgebra::Vector2;

use super::ceiling::KEPT;
use crate::contact::ContactName;
use crate::robot::{PerWheel, Robot};
use crate::shooting::{LEAST_LOAD_FOR_GRIP, LIMIT_TOLERANCE, ManeuverLimits};

/// Balances that are tried between weight alone and weight with pitch, each of which gives a bound: twice as many gain nothing
/// in the median over the suite.
const BALANCES: u32 = 16;

/// One two-dimensional weight or force (longitudinal, lateral) per contact: left, right, front.
pub(super) type PerContact = [Vector2<f64>; 3];

/// A value that is affine in the torques.
#[derive(Debug, Clone, Copy)]
pub(super) struct ByTorque {
    pub(super) at_rest: f64,
    pub(super) slope: Vector2<f64>,
}

impl ByTorque {
    pub(super) fn at(&self, torque: Vector2<f64>) -> f64 {
        self.at_rest + self.slope.dot(&torque)
    }

    fn largest(&self, limit: Vector2<f64>) -> f64 {
        self.at_rest + self.slope.abs().dot(&limit)
    }
}

/// Normal forces of a robot as functions of its motion, and the limits of its torques.
#[derive(Debug, Clone)]
pub(super) struct Loads {
    pub(super) friction: [f64; 3],
    /// m g, N.
    pub(super) weight: f64,
    static_force: [f64; 3],
    by_torque: [Vector2<f64>; 3],
    centrifugal: [f64; 3],
    gyroscopic: [f64; 3],
    /// Normal force per friction force, by the contact of the normal force.
    by_friction: [PerContact; 3],
    pub(super) torque_limit: Vector2<f64>,
    has_viscous_friction: bool,
    least: [f64; 3],
    /// Normal force that wheels may be judged by beyond what they carry, where only a share of their grip may be used, N.
    unloaded_grip: f64,
    /// How far a friction force may be from the friction law, N.
    pub(super) law_error: f64,
}

const FRONT: usize = ContactName::Front as usize;

impl Loads {
    pub(super) fn new(
        robot: &Robot,
        torque_limit: PerWheel<f64>,
        limits: ManeuverLimits,
        law_error_share: f64,
    ) -> Self {
        let parameters = robot.parameters();
        let projection = robot.normal_force_projection();
        let by_change = &projection.velocity_change_map;
        let unit_rate = robot.inverse_mass_matrix() * robot.smooth_force(1.0, [0.0, 0.0]);
        let centrifugal = projection.centrifugal + by_change * unit_rate;
        let response = robot.normal_response();
        let weight = parameters.weight();
        let of_contact = |contact: usize, [longitudinal, lateral]: [usize; 2]| {
            Vector2::new(response[(contact, longitudinal)], response[(contact, lateral)])
        };
        let by_torque = |contact: usize| {
            Vector2::new(by_change[(contact, 3)], by_change[(contact, 4)]) / parameters.wheel_spin_inertia
        };
        let contacts = ContactName::ALL.map(|contact| contact as usize);
        let static_force = projection.static_force.into();
        // Plans may miss their least loads by the search's tolerance.
        let least_loads = limits.least_normal_loads(robot);
        let least = contacts.map(|contact| (least_loads[contact] * weight - LIMIT_TOLERANCE * weight).max(0.0));
        let share = limits.grip_utilization.map_or(1.0, |share| (KEPT * share).min(1.0));
        let (wheel, front) = (share * parameters.wheel_friction_coefficient, parameters.front_friction_coefficient);
        let unloaded_grip = |wheel: usize| (LEAST_LOAD_FOR_GRIP * weight - least[wheel]).max(0.0);
        let unloaded_grip = limits.grip_utilization.map_or(0.0, |_| unloaded_grip(0) + unloaded_grip(1));
        Self {
            friction: [wheel, wheel, front],
            weight,
            static_force,
            by_torque: contacts.map(by_torque),
            centrifugal: centrifugal.into(),
            gyroscopic: projection.gyroscopic.into(),
            by_friction: contacts.map(|contact| [[0, 2], [1, 2], [3, 4]].map(|columns| of_contact(contact, columns))),
            torque_limit: Vector2::new(torque_limit.left, torque_limit.right),
            has_viscous_friction: parameters.wheel_viscous_friction > 0.0,
            least,
            unloaded_grip,
            law_error: law_error_share * weight,
        }
    }

    /// Whether the normal forces of the wheels, beside yaw, depend on nothing but torques and friction within their limits.
    pub(super) fn bounds_wheel_loads(&self) -> bool {
        !self.has_viscous_friction
    }

    /// Least normal force of a wheel, N.
    pub(super) fn least_of_wheel(&self, wheel: usize) -> f64 {
        self.least[wheel]
    }

    /// Largest magnitude of the sum of the friction forces, N.
    pub(super) fn largest_sum(&self) -> f64 {
        // In the direction that relieves the contact the most.
        let gain = |_: usize, cost: f64, response: Vector2<f64>| 1.0 / (cost - response.norm());
        self.bound(gain).largest(self.torque_limit) + 3.0 * self.law_error
    }

    /// Largest sum of the friction forces along a direction of the body (longitudinal, lateral) and all that enclose at
    /// most an angle with it, N.
    pub(super) fn largest_sum_along(&self, direction: Vector2<f64>, turn: f64) -> f64 {
        // The gain falls with the response along the direction.
        let weights = self.by_friction[FRONT].map(|response| {
            let (sin, cos) = (direction.angle(&-response) - turn).max(0.0).sin_cos();
            Vector2::new(cos, sin)
        });
        let gain = |contact: usize, cost: f64, response: Vector2<f64>| {
            gain(weights[contact], cost, Vector2::new(-response.norm(), 0.0))
        };
        self.bound(gain).largest(self.torque_limit) + 3.0 * self.law_error
    }

    /// The turn from a direction of the body that encloses those which relieve the contacts the most: larger ones allow no more.
    pub(super) fn enclosing_turn(&self, direction: Vector2<f64>) -> f64 {
        self.by_friction[FRONT].iter().map(|response| direction.angle(&-response)).fold(0.0, f64::max)
    }

    /// Largest weighted sum of the friction forces.
    pub(super) fn largest(&self, weights: &PerContact) -> ByTorque {
        let mut bound = self.bound(|contact, cost, response| gain(weights[contact], cost, response));
        bound.at_rest += weights.iter().map(Vector2::norm).sum::<f64>() * self.law_error;
        bound
    }

    /// Largest magnitude of a weighted sum of the friction forces, for all torques.
    pub(super) fn largest_magnitude(&self, weights: &PerContact) -> f64 {
        let of = |weights: &PerContact| self.largest(weights).largest(self.torque_limit);
        of(weights).max(of(&weights.map(|weight| -weight)))
    }

    /// Least weighted sum of the wheels' normal forces without centrifugal and gyroscopic parts, N.
    pub(super) fn least_on_wheels(&self, [left, right]: [f64; 2]) -> ByTorque {
        let mix = |values: [Vector2<f64>; 2]| left * values[0] + right * values[1];
        let relief = |contact: usize| -mix([self.by_friction[0][contact], self.by_friction[1][contact]]);
        let relieved = self.largest(&[relief(0), relief(1), relief(FRONT)]);
        ByTorque {
            at_rest: left * self.static_force[0] + right * self.static_force[1] - relieved.at_rest,
            slope: mix([self.by_torque[0], self.by_torque[1]]) - relieved.slope,
        }
    }

    /// What yaw may take off the weighted sum of the wheels' normal forces: per squared yaw rate, and per yaw rate times
    /// sum of wheel rates, N s2.
    pub(super) fn relief_by_yaw(&self, [left, right]: [f64; 2]) -> (f64, f64) {
        let mix = |values: [f64; 3]| left * values[0] + right * values[1];
        ((-mix(self.centrifugal)).max(0.0), mix(self.gyroscopic).abs())
    }

    /// A bound on `sum t_i . F_i`, where `gain(i, p, b)` is the largest `t_i . F` over all F with `p |F| + b . F <= 1`.
    ///
    /// Of all balances the one with the least bound.
    fn bound(&self, gain: impl Fn(usize, f64, Vector2<f64>) -> f64) -> ByTorque {
        // Yaw that relieves the front support would add to the wheels' loads without limit, and so would viscous friction.
        let balances = if self.centrifugal[FRONT] < 0.0 || self.has_viscous_friction { 0 } else { BALANCES };
        let shares = (0..=balances).map(|index| f64::from(index) / f64::from(BALANCES));
        let bounds = shares.filter_map(|share| self.bound_of_balance(share, &gain));
        let least = |a: ByTorque, b: ByTorque| {
            if b.largest(self.torque_limit) < a.largest(self.torque_limit) { b } else { a }
        };
        bounds.reduce(least).expect("the balance of weight alone always gives a bound")
    }

    /// The bound by `share` times the balance with pitch plus the rest of the balance of weight; none where friction
    /// could add to its own load without limit.
    fn bound_of_balance(&self, share: f64, gain: impl Fn(usize, f64, Vector2<f64>) -> f64) -> Option<ByTorque> {
        let response = self.by_friction[FRONT].map(|response| share * response);
        let rest = 1.0 - share;
        let mut largest_gain = 0.0_f64;
        for (contact, response) in response.iter().enumerate().filter(|(contact, _)| self.friction[*contact] > 0.0) {
            let cost = if contact == FRONT { rest } else { 1.0 } / self.friction[contact];
            if cost <= response.norm() {
                return None;
            }
            largest_gain = largest_gain.max(gain(contact, cost, *response));
        }
        // A front support with friction has its normal force counted by its friction.
        let front_least = if self.friction[FRONT] > 0.0 { 0.0 } else { self.least[FRONT] };
        // Normal forces of less than -1e-12 of the weight count as rounding: the errors of the law cover them.
        let law_error = self.law_error * (1.0 + response.iter().map(Vector2::norm).sum::<f64>());
        let load = self.weight - share * self.static_force[FRONT] - rest * front_least + law_error + self.unloaded_grip;
        Some(ByTorque { at_rest: largest_gain * load, slope: -largest_gain * share * self.by_torque[FRONT] })
    }
}

/// Largest `weight . F` over all F with `cost |F| + response . F <= 1`, where `cost > |response|`: the root of
/// `|weight - x response| = x cost`.
fn gain(weight: Vector2<f64>, cost: f64, response: Vector2<f64>) -> f64 {
    let along = weight.dot(&response);
    let margin = cost * cost - response.norm_squared();
    ((along * along + margin * weight.norm_squared()).sqrt() - along) / margin
}

/// Moments of unit friction forces about a point, by the contacts' levers (right, forward).
pub(super) fn moments(levers: &[Vector2<f64>; 3]) -> PerContact {
    levers.map(|lever| Vector2::new(lever.x, -lever.y))
}

#[cfg(test)]
mod tests {
    use rand::{Rng, RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::robot::{Payload, RobotParameters};

    fn loads(parameters: RobotParameters, torque: f64) -> Loads {
        let limits = ManeuverLimits { normal_load_share: 0.0, ..ManeuverLimits::default() };
        Loads::new(&Robot::new(parameters).unwrap(), PerWheel::new(torque, torque), limits, 0.0)
    }

    #[test]
    fn braking_takes_load_off_the_wheels() {
        let parameters = RobotParameters { wheel_mass: 1e-4, ..RobotParameters::default() };
        let (friction, length) = (parameters.wheel_friction_coefficient, parameters.axle_to_front_support);
        let on_wheels = parameters.chassis_mass
            * parameters.gravity
            * (1.0 - parameters.center_of_mass_forward / length)
            // Torque of both wheels, which reacts on the chassis.
            + 2.0 * 1.0 / length;
        let shift = friction * (parameters.center_of_mass_height - parameters.wheel_radius) / length;
        let loads = loads(parameters, 1.0);
        for (direction, expected) in [(1.0, 1.0 - shift), (-1.0, 1.0 + shift)] {
            let largest = loads.largest_sum_along(Vector2::new(direction, 0.0), 0.0);
            // The wheels still weigh 0.002 N.
            assert!((largest - friction * on_wheels / expected).abs() < 2e-3, "{direction} {largest}");
        }
        assert!((loads.largest_sum() - friction * on_wheels / (1.0 - shift)).abs() < 2e-3);
        let share = 0.01;
        let limits = ManeuverLimits { normal_load_share: share, ..ManeuverLimits::default() };
        let least = Loads::new(&Robot::new(parameters).unwrap(), PerWheel::new(1.0, 1.0), limits, 0.0);
        assert!((least.least_of_wheel(0) - (share - LIMIT_TOLERANCE) * least.weight).abs() < 1e-12);
    }

    /// Friction forces and torques with normal forces that keep all contacts closed; none where they do not.
    fn random_forces(rng: &mut impl Rng, loads: &Loads, yaw_rate: f64) -> Option<(PerContact, Vector2<f64>, [f64; 3])> {
        let mut torque = || loads.torque_limit.x * f64::from(rng.random_range(-1..=1));
        let torque = Vector2::new(torque(), torque());
        let mut forces = [Vector2::zeros(); 3];
        let scale = loads.weight * loads.friction.iter().fold(0.0, |largest: f64, &friction| friction.max(largest));
        for (force, friction) in forces.iter_mut().zip(loads.friction) {
            let angle = rng.random_range(0.0..std::f64::consts::TAU);
            let size = if friction > 0.0 { scale * rng.random_range(0.0..1.0) } else { 0.0 };
            *force = size * Vector2::new(angle.cos(), angle.sin());
        }
        let normal = [0, 1, 2].map(|contact| {
            let by_friction: f64 = forces.iter().zip(loads.by_friction[contact]).map(|(a, b)| a.dot(&b)).sum();
            let by_yaw = yaw_rate * yaw_rate * loads.centrifugal[contact];
            loads.static_force[contact] + loads.by_torque[contact].dot(&torque) + by_friction + by_yaw
        });
        let holds = |contact: usize| {
            normal[contact] >= 0.0 && forces[contact].norm() <= loads.friction[contact] * normal[contact]
        };
        (0..3).all(holds).then_some((forces, torque, normal))
    }

    #[test]
    fn no_forces_of_closed_contacts_exceed_the_bounds() {
        let reference = RobotParameters::default();
        let tall = RobotParameters { center_of_mass_height: 0.2, wheel_friction_coefficient: 0.6, ..reference };
        let rubbing = RobotParameters { front_friction_coefficient: 0.3, ..reference };
        let payload = Payload { mass: 4.0, right: 0.05, forward: 0.1, height: 0.2, yaw_inertia: 0.0 };
        let loaded = reference.with_payload(&payload);
        for (seed, parameters) in [reference, tall, rubbing, loaded].into_iter().enumerate() {
            let loads = loads(parameters, 3.0);
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed as u64);
            let (mut count, mut nearest) = (0, 0.0_f64);
            for _ in 0..100_000 {
                let yaw_rate = rng.random_range(0.0..3.0);
                let Some((forces, torque, normal)) = random_forces(&mut rng, &loads, yaw_rate) else { continue };
                count += 1;
                let sum: Vector2<f64> = forces.iter().sum();
                nearest = nearest.max(sum.norm() / loads.largest_sum());
                assert!(sum.norm() <= loads.largest_sum());
                let direction = sum.normalize();
                assert!(sum.norm() <= loads.largest_sum_along(direction, 0.0) * (1.0 + 1e-12));
                let moment: f64 =
                    forces.iter().zip(moments(&[Vector2::new(0.1, 0.2); 3])).map(|(a, b)| a.dot(&b)).sum();
                assert!(moment.abs() <= loads.largest_magnitude(&moments(&[Vector2::new(0.1, 0.2); 3])));
                for weights in [[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]] {
                    let relief = yaw_rate * yaw_rate * loads.relief_by_yaw(weights).0;
                    let least = loads.least_on_wheels(weights).at(torque) - relief;
                    assert!(weights[0] * normal[0] + weights[1] * normal[1] >= least - 1e-9 * loads.weight);
                }
            }
            // The test bites.
            assert!(count > 1_000 && nearest > 0.8, "{count} {nearest}");
        }
    }
}
