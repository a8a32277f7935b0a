//! The largest accelerations that friction and torque can cause.
//!
//! Velocities are those of the whole robot's centre of mass G, in which translation, yaw and wheels have a diagonal mass
//! matrix. The derivations are in `docs/bounds.md`.

use std::f64::consts::PI;

use nalgebra::Vector2;

use super::ceiling::{KEPT, kept};
use super::curve::Level;
use super::drive_norm::{Bodies, DriveNorm};
use super::drive_rate::{LEVELS, drive_rates};
use super::grid_error::Grid;
use super::loads::{Loads, moments};
use super::rolling::{Rolling, SpeedLimit};
use crate::contact::PROMISED_RESIDUAL;
use crate::robot::{PerWheel, Robot};
use crate::solver::settings::SolveInput;

/// Largest accepted residual of the contact law, relative to m g dt: a plan's friction forces may be as far from the friction law.
pub(in crate::solver) const LAW_ERROR: f64 = PROMISED_RESIDUAL;
/// Steps of half a turn in which the friction along a direction of the floor is bounded: twice as many gain 0.03 % of a
/// bound in the median over the suite.
const TURNS: u32 = 16;

/// The largest accelerations, and the growth of the drive norm.
#[derive(Debug, Clone)]
pub(super) struct Capacity {
    /// kg
    pub(super) mass: f64,
    /// Yaw inertia about G, kg m2.
    pub(super) yaw_inertia: f64,
    /// G relative to the chassis centre of mass, m.
    pub(super) center: Vector2<f64>,
    /// Largest acceleration of G, m/s2.
    pub(super) acceleration: f64,
    /// Largest yaw acceleration, rad/s2.
    pub(super) yaw_acceleration: f64,
    /// Largest wheel acceleration, rad/s2.
    pub(super) wheel_acceleration: PerWheel<f64>,
    pub(super) norm: DriveNorm,
    /// Largest growth of the drive norm per second; none with restitution, under which friction may raise it.
    pub(super) drive_rates: Option<Vec<Level>>,
    /// Growth of the drive norm that errors in the direction of friction cause, per square root of step length times
    /// duration, 1/s.
    pub(super) direction_error: f64,
    /// Where no wheel may slip.
    pub(super) rolling: Option<Rolling>,
    /// Limits with what they may be exceeded by; infinite without.
    pub(super) limits: RateLimits,
    loads: Loads,
}

/// Limits of rates, rad/s, rad/s2.
#[derive(Debug, Clone, Copy)]
pub(super) struct RateLimits {
    pub(super) wheel: f64,
    pub(super) yaw: f64,
    pub(super) yaw_acceleration: f64,
}

impl Capacity {
    pub(super) fn new(input: &SolveInput, grid: Grid) -> Self {
        let (robot, maneuver) = (&input.robot, &input.maneuver);
        let (torque_limit, asked) = (maneuver.torque_limit, maneuver.limits);
        let parameters = robot.parameters();
        let bodies = bodies(robot);
        let Bodies { mass, yaw_inertia, spin_inertia, wheel_radius, .. } = bodies;
        let (law_error, drive_levels) = match grid {
            Grid::Steps(_) => (LAW_ERROR, LEVELS),
            // Whether it takes hours does not depend on the first seconds.
            Grid::Continuous => (0.0, 0),
        };
        let loads = Loads::new(robot, torque_limit, asked, law_error);
        let norm = DriveNorm::new(bodies);
        let wheel_acceleration = |torque: f64, wheel: usize| {
            let mut lengthwise = [Vector2::zeros(); 3];
            lengthwise[wheel].x = wheel_radius;
            (torque + loads.largest_magnitude(&lengthwise)) / spin_inertia
        };
        let has_restitution = parameters.tangential_restitution > 0.0;
        let limits = RateLimits {
            wheel: kept(asked.wheel_rate),
            yaw: kept(asked.yaw_rate),
            yaw_acceleration: kept(asked.yaw_acceleration),
        };
        let holds = maneuver.forbids_slip() && !has_restitution && bodies.has_grip;
        let rolling = holds.then(|| Rolling::new(robot, torque_limit, &bodies, speed_limits(input), loads.law_error));
        let by_friction = loads.largest_magnitude(&moments(&levers(robot))) / yaw_inertia;
        Self {
            mass,
            yaw_inertia,
            center: parameters.whole_center_of_mass(),
            acceleration: loads.largest_sum() / mass,
            yaw_acceleration: by_friction.min(limits.yaw_acceleration),
            wheel_acceleration: PerWheel::new(
                wheel_acceleration(torque_limit.left, 0),
                wheel_acceleration(torque_limit.right, 1),
            ),
            norm,
            drive_rates: (!has_restitution).then(|| drive_rates(&norm, &loads, drive_levels)),
            direction_error: direction_error(robot, &loads, rolling.as_ref()),
            rolling,
            limits,
            loads,
        }
    }

    /// Whether a limit bounds the yaw acceleration, rather than friction.
    pub(super) fn is_yaw_limited(&self) -> bool {
        self.yaw_acceleration == self.limits.yaw_acceleration
    }

    /// Largest yaw rate at the end of each step, rad/s; infinite without a limit.
    pub(super) fn largest_yaw_rate(&self, dt: f64) -> f64 {
        let of_rolling = |rolling: &Rolling| rolling.largest_yaw_rate(dt);
        self.limits.yaw.min(self.rolling.as_ref().map_or(f64::INFINITY, of_rolling))
    }

    /// Speed of G per unit of the drive norm, at most.
    pub(super) fn translation_scale(&self) -> f64 {
        self.rolling.as_ref().map_or_else(|| self.norm.translation_scale(), Rolling::translation_scale)
    }

    /// Yaw rate per unit of the drive norm, at most.
    pub(super) fn yaw_scale(&self) -> f64 {
        self.rolling.as_ref().map_or_else(|| self.norm.yaw_scale(), Rolling::yaw_scale)
    }

    /// Largest acceleration of G along a direction of the body (longitudinal, lateral), by the time after or before which
    /// the robot has it: yaw may have turned it by then.
    ///
    /// `slack` is how far the direction is known, rad; `yaw_rate` the largest rate at that time, rad/s.
    pub(super) fn accelerations_along(&self, direction: Vector2<f64>, slack: f64, yaw_rate: f64) -> Vec<Level> {
        let turn = |index: u32| PI * f64::from(index) / f64::from(TURNS);
        let enclosing = self.loads.enclosing_turn(direction);
        let last = (1..TURNS).find(|index| turn(*index) >= enclosing).unwrap_or(TURNS);
        let level = |index: u32| {
            let until = if index == last { f64::INFINITY } else { self.time_of_turn(turn(index) - slack, yaw_rate) };
            Level { until, rate: self.loads.largest_sum_along(direction, turn(index)) / self.mass }
        };
        (1..=last).map(level).collect()
    }

    /// A time before which yaw cannot turn by more than an angle, s.
    fn time_of_turn(&self, turn: f64, yaw_rate: f64) -> f64 {
        let root = (yaw_rate * yaw_rate + 2.0 * self.yaw_acceleration * turn.max(0.0)).sqrt();
        2.0 * turn.max(0.0) / (yaw_rate + root)
    }
}

/// The contact points relative to G, m.
fn levers(robot: &Robot) -> [Vector2<f64>; 3] {
    let parameters = robot.parameters();
    parameters.contact_points().map(|point| point - parameters.whole_center_of_mass())
}

/// The bodies of a robot about G.
pub(super) fn bodies(robot: &Robot) -> Bodies {
    let parameters = robot.parameters();
    let mass = parameters.total_mass();
    Bodies {
        mass,
        yaw_inertia: robot.mass_matrix()[(2, 2)] - mass * parameters.whole_center_of_mass().norm_squared(),
        spin_inertia: parameters.wheel_spin_inertia,
        wheel_radius: parameters.wheel_radius,
        levers: levers(robot),
        has_grip: parameters.wheel_friction_coefficient > 0.0,
    }
}

/// Limits of the forward speed where the wheels hold.
fn speed_limits(input: &SolveInput) -> Vec<SpeedLimit> {
    let limits = &input.maneuver.limits;
    let from_axle = input.limited_point() - input.robot.parameters().axle_midpoint();
    let of_wheels = limits.wheel_rate.map(|rate| SpeedLimit::Wheels(KEPT * rate));
    let of_point = limits.speed.map(|speed| SpeedLimit::Point(from_axle, KEPT * speed));
    of_wheels.into_iter().chain(of_point).collect()
}

/// Twice the root of twice the errors of the slips' directions times the friction that they misdirect.
fn direction_error(robot: &Robot, loads: &Loads, rolling: Option<&Rolling>) -> f64 {
    let delassus = robot.delassus();
    // The largest eigenvalue of each contact's block is below its trace.
    let traces = [[0, 2], [1, 2], [3, 4]].map(|[a, b]| delassus[(a, a)] + delassus[(b, b)]);
    let mut sum = 0.0;
    for (contact, trace) in traces.into_iter().enumerate() {
        sum += loads.law_error * trace * loads.friction[contact] * loads.weight;
    }
    if let Some(rolling) = rolling {
        sum += rolling.front_slip(levers(robot)[2]) * loads.friction[2] * loads.weight;
    }
    2.0 * (2.0 * sum).sqrt()
}
