//! How fast torque raises the drive norm, by what the wheels' loads let friction dissipate (`docs/bounds.md`).
//!
//! A wheel that turns faster than it rolls stores drive for a better moment, at the price of friction. The loads, and with
//! them the price, are known while the drive norm is small; a large one may hide yaw that lifts a wheel off its load.

use nalgebra::Vector2;

use super::curve::Level;
use super::drive_norm::{DriveNorm, Speeds};
use super::loads::{ByTorque, Loads};
use crate::robot::PerWheel;

/// Levels of the drive norm with a rate of their own: twice as many gain 0.02 % of a bound in the median over the suite.
pub(super) const LEVELS: u32 = 32;
/// Weighted sums of the wheels' normal forces (left, right) that are bounded from below: twice as many gain nothing on the
/// suite.
const WEIGHTS: [[f64; 2]; 9] =
    [[1.0, 0.0], [4.0, 1.0], [2.0, 1.0], [1.5, 1.0], [1.0, 1.0], [1.0, 1.5], [1.0, 2.0], [1.0, 4.0], [0.0, 1.0]];
/// Most sweeps over the two wheels' friction forces, which converge geometrically and are safe after any number.
const FRICTION_SWEEPS: usize = 30;

/// Rates of growth by level, with rising norms; the last level has no end. With no levels it is the only one.
pub(super) fn drive_rates(norm: &DriveNorm, loads: &Loads, level_count: u32) -> Vec<Level> {
    let margin = loads.law_error * norm.largest_slips();
    let unloaded = norm.gain.left * loads.torque_limit.x + norm.gain.right * loads.torque_limit.y;
    let without_end = |rate: f64| Level { until: f64::INFINITY, rate: margin + rate };
    if unloaded == 0.0 || level_count == 0 || !loads.bounds_wheel_loads() {
        return vec![without_end(unloaded)];
    }
    let bounds = WEIGHTS.map(|weights| Bound::new(norm, loads, weights));
    let level = |norm_squared: f64| {
        let pairs = vertices(&bounds, norm_squared, loads);
        Level { until: norm_squared.sqrt(), rate: margin + rate(norm, loads, &pairs) }
    };
    let last = (bounds[0].end(loads)).max(bounds[WEIGHTS.len() - 1].end(loads));
    let bounded = (1..=level_count).map(|index| level(last * f64::from(index) / f64::from(level_count)));
    let mut levels: Vec<Level> = bounded.chain([without_end(unloaded)]).collect();
    // What bounds the rate at a larger norm bounds it at smaller ones.
    for index in (1..levels.len()).rev() {
        levels[index - 1].rate = levels[index - 1].rate.min(levels[index].rate);
    }
    levels
}

/// A lower bound on a weighted sum of the wheels' normal forces at a drive norm.
struct Bound {
    weights: Vector2<f64>,
    at_rest: ByTorque,
    /// What yaw may take off per squared norm.
    relief: f64,
}

impl Bound {
    fn new(norm: &DriveNorm, loads: &Loads, weights: [f64; 2]) -> Self {
        let (per_yaw_squared, per_yaw_and_wheels) = loads.relief_by_yaw(weights);
        let relief =
            per_yaw_squared * norm.largest_yaw_squared() + per_yaw_and_wheels * norm.largest_yaw_times_wheels();
        Self { weights: weights.into(), at_rest: loads.least_on_wheels(weights), relief }
    }

    fn at(&self, torque: Vector2<f64>, norm_squared: f64) -> f64 {
        self.at_rest.at(torque) - self.relief * norm_squared
    }

    /// Squared norm at which no torque keeps the sum above zero. Of a wheel's load the gyroscopic moment always takes some.
    fn end(&self, loads: &Loads) -> f64 {
        torques(loads).map(|torque| self.at_rest.at(torque)).into_iter().fold(0.0, f64::max) / self.relief
    }
}

/// Torques at the corners of their limits.
fn torques(loads: &Loads) -> [Vector2<f64>; 4] {
    let limit = loads.torque_limit;
    [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]
        .map(|[left, right]| Vector2::new(left * limit.x, right * limit.y))
}

/// Torques with least normal forces (left, right) that go with them.
type Pair = (Vector2<f64>, Vector2<f64>);

/// The corners of what is known of torques and normal forces.
fn vertices(bounds: &[Bound], norm_squared: f64, loads: &Loads) -> Vec<Pair> {
    let torques = torques(loads);
    let crossings = |sides: &[Side]| torques.iter().copied().zip(crossing(&sides[0], &sides[1])).collect::<Vec<_>>();
    sides(bounds, (&torques, norm_squared), loads).windows(2).flat_map(crossings).collect()
}

/// A lower bound on a weighted sum of the normal forces at one norm, for torques at each corner of their limits.
struct Side {
    weights: Vector2<f64>,
    least: [f64; 4],
}

/// Bounds that neighbours by weights cross where no wheel has less than it keeps. Any of them say enough, if the outermost are those of
/// single wheels.
fn sides(bounds: &[Bound], (torques, norm_squared): (&[Vector2<f64>; 4], f64), loads: &Loads) -> Vec<Side> {
    let side =
        |bound: &Bound| Side { weights: bound.weights, least: torques.map(|torque| bound.at(torque, norm_squared)) };
    let mut sides: Vec<Side> = bounds.iter().map(side).collect();
    let kept = [0, 1].map(|wheel| loads.least_of_wheel(wheel));
    for (place, kept) in [(0, kept[0]), (sides.len() - 1, kept[1])] {
        // Affine in the torques, or constant: otherwise the corners of the torques would not decide.
        if sides[place].least.iter().any(|least| *least < kept) {
            sides[place].least = [kept; 4];
        }
    }
    let mut place = 0;
    while place + 1 < sides.len() {
        let corners = crossing(&sides[place], &sides[place + 1]);
        let has_less = |wheel: usize| corners.iter().any(|corner| corner[wheel] < kept[wheel]);
        if place > 0 && has_less(0) {
            sides.remove(place);
            place -= 1;
        } else if place + 2 < sides.len() && has_less(1) {
            sides.remove(place + 1);
        } else {
            place += 1;
        }
    }
    sides
}

/// The normal forces at which two bounds hold with equality, for each corner of the torques.
fn crossing(one: &Side, other: &Side) -> [Vector2<f64>; 4] {
    let (a, b) = (one.weights, other.weights);
    let determinant = a.x * b.y - a.y * b.x;
    std::array::from_fn(|corner| {
        let (x, y) = (one.least[corner], other.least[corner]);
        Vector2::new(b.y * x - a.y * y, a.x * y - b.x * x) / determinant
    })
}

fn rate(norm: &DriveNorm, loads: &Loads, pairs: &[Pair]) -> f64 {
    let of_pair = |(torque, normal): &Pair| {
        let largest = Vector2::new(loads.friction[0] * normal.x, loads.friction[1] * normal.y);
        norm.at_most(&accelerations(norm, *torque, largest))
    };
    pairs.iter().map(of_pair).fold(0.0, f64::max)
}

/// Accelerations by torques and those lengthwise friction forces within limits that make the wheels roll best.
fn accelerations(norm: &DriveNorm, torque: Vector2<f64>, largest: Vector2<f64>) -> Speeds {
    let (own, coupling) = norm.contact_response();
    let (radius, spin) = (norm.wheel_radius, norm.spin_inertia);
    let mut force = Vector2::<f64>::zeros();
    for _ in 0..FRICTION_SWEEPS {
        let before = force;
        for (wheel, other) in [(0, 1), (1, 0)] {
            let slip = coupling * force[other] - radius * torque[wheel] / spin;
            let rolling = -slip / (own[wheel] + radius * radius / spin);
            force[wheel] = rolling.clamp(-largest[wheel], largest[wheel]);
        }
        if force == before {
            break;
        }
    }
    let spun = (torque - radius * force) / spin;
    norm.speeds_by(force, PerWheel::new(spun.x.abs(), spun.y.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Robot, RobotParameters};
    use crate::shooting::ManeuverLimits;
    use crate::solver::bounds::capacity::bodies;

    #[test]
    fn viscous_friction_may_take_all_load_off_the_wheels() {
        let damped = RobotParameters { wheel_viscous_friction: 1e-3, ..RobotParameters::default() };
        let levels = rates(RobotParameters::default(), 1.0);
        assert_eq!(rates(damped, 1.0), levels[levels.len() - 1..]);
    }

    fn rates(parameters: RobotParameters, torque: f64) -> Vec<Level> {
        rates_under(parameters, torque, 0.0)
    }

    fn rates_under(parameters: RobotParameters, torque: f64, normal_load_share: f64) -> Vec<Level> {
        let robot = Robot::new(parameters).unwrap();
        let limits = ManeuverLimits { normal_load_share, ..ManeuverLimits::default() };
        let loads = Loads::new(&robot, PerWheel::new(torque, torque), limits, 0.0);
        drive_rates(&DriveNorm::new(bodies(&robot)), &loads, LEVELS)
    }

    #[test]
    fn loaded_wheels_gain_what_they_gain_rolling() {
        // Symmetric, low, and too weak to slip.
        let parameters = RobotParameters {
            center_of_mass_right: 0.0,
            center_of_mass_height: 0.03,
            wheel_friction_coefficient: 0.9,
            ..RobotParameters::default()
        };
        let torque = 0.2;
        let robot = Robot::new(parameters).unwrap();
        let (radius, half_track) = (parameters.wheel_radius, 0.5 * parameters.track_width);
        let rim = parameters.wheel_spin_inertia / (radius * radius);
        let lengthwise = 2.0 * torque / radius / (parameters.total_mass() + 2.0 * rim).sqrt();
        let yaw_inertia =
            robot.mass_matrix()[(2, 2)] - parameters.total_mass() * parameters.whole_center_of_mass().norm_squared();
        let turning = 2.0 * torque / radius * half_track / (yaw_inertia + 2.0 * rim * half_track * half_track).sqrt();
        let rate = rates(parameters, torque)[0].rate;
        // Sweeps converge to rounding.
        assert!((rate - lengthwise.max(turning)).abs() < 1e-9 * rate, "{rate} {lengthwise} {turning}");
    }

    #[test]
    fn rates_do_not_fall_where_least_loads_matter() {
        let levels = rates_under(RobotParameters::default(), 4.5, 0.231);
        assert!(levels.windows(2).all(|pair| pair[0].rate <= pair[1].rate), "{levels:?}");
    }

    #[test]
    fn rates_rise_to_that_of_wheels_without_load() {
        let levels = rates(RobotParameters::default(), 1.0);
        assert!(levels.windows(2).all(|pair| pair[0].until < pair[1].until && pair[0].rate <= pair[1].rate));
        assert!(levels[0].rate < 0.8 * levels[levels.len() - 1].rate);
        assert_eq!(rates(RobotParameters::default(), 0.0), [Level { until: f64::INFINITY, rate: 0.0 }]);
    }
}
