//! Robots whose wheels hold: all that moves follows from the forward speed of the axle and the yaw rate, and energy from the
//! torques alone (`docs/bounds.md`).

use nalgebra::{Matrix2, Vector2};

use super::curve::{Curve, Level};
use super::drive_norm::Bodies;
use crate::robot::{PerWheel, Robot};

/// Spans of the yaw rate on which speeds are bounded by their largest value: twice as many gain 0.01 % of a bound with a limit of
/// the wheel rates.
const SPANS: u32 = 16;
/// Share of the largest value by which the two squared speeds per norm must differ to be told apart in spite of rounding.
const DISTINCT: f64 = 1e-3;
/// Levels of the norm with a rate of their own.
const LEVELS: u32 = 8;

/// What limits the forward speed at a yaw rate.
#[derive(Debug, Clone, Copy)]
pub(super) enum SpeedLimit {
    /// Of both wheels, rad/s.
    Wheels(f64),
    /// Of a point of the chassis relative to the axle midpoint (right, forward), m, m/s.
    Point(Vector2<f64>, f64),
}

/// The motion of one robot whose wheels hold, with its limits.
#[derive(Debug, Clone)]
pub(super) struct Rolling {
    mass: f64,
    /// About G, kg m2.
    yaw_inertia: f64,
    spin_inertia: f64,
    wheel_radius: f64,
    half_track: f64,
    /// G relative to the axle midpoint (right, forward), m.
    center: Vector2<f64>,
    /// Of forward speed and yaw rate.
    inertia: Matrix2<f64>,
    inverse: Matrix2<f64>,
    limits: Vec<SpeedLimit>,
    /// Largest growth of the norm by the torques per second.
    pub(super) rate: f64,
    /// Growth of the norm by what wheels that hold may slip within the errors of the contact solver, per second.
    hold_error: f64,
    /// Slip of a wheel that holds per length of its step, m/s2.
    slip_error: f64,
    viscous_friction: f64,
    /// Whether torque alone brakes.
    is_conservative: bool,
}

impl Rolling {
    pub(super) fn new(
        robot: &Robot,
        torque: PerWheel<f64>,
        bodies: &Bodies,
        limits: Vec<SpeedLimit>,
        law_error: f64,
    ) -> Self {
        let parameters = robot.parameters();
        let Bodies { mass, yaw_inertia, spin_inertia, wheel_radius, .. } = *bodies;
        let center = parameters.whole_center_of_mass() - parameters.axle_midpoint();
        let half_track = 0.5 * parameters.track_width;
        let rim = 2.0 * spin_inertia / (wheel_radius * wheel_radius);
        let inertia = Matrix2::new(
            mass + rim,
            mass * center.x,
            mass * center.x,
            mass * center.norm_squared() + yaw_inertia + rim * half_track * half_track,
        );
        let inverse = Matrix2::new(inertia.m22, -inertia.m12, -inertia.m21, inertia.m11) / inertia.determinant();
        let norm = |force: Vector2<f64>| force.dot(&(inverse * force)).sqrt();
        let by_torques =
            |left: f64, right: f64| norm(Vector2::new(right + left, half_track * (right - left)) / wheel_radius);
        let slips = slip_errors(robot, law_error);
        Self {
            mass,
            yaw_inertia,
            spin_inertia,
            wheel_radius,
            half_track,
            center,
            inertia,
            inverse,
            limits,
            rate: by_torques(torque.left, torque.right).max(by_torques(torque.left, -torque.right)),
            hold_error: norm_of_slips(robot, slips),
            slip_error: slips.into_iter().fold(0.0, f64::max),
            viscous_friction: parameters.wheel_viscous_friction,
            is_conservative: parameters.wheel_viscous_friction == 0.0 && parameters.front_friction_coefficient == 0.0,
        }
    }

    /// Speed of G per unit of the norm, at most.
    pub(super) fn translation_scale(&self) -> f64 {
        self.translation_scales().0.sqrt()
    }

    /// Yaw rate per unit of the norm, at most.
    pub(super) fn yaw_scale(&self) -> f64 {
        self.inverse.m22.sqrt()
    }

    /// Squared speeds of G per squared norm: the largest and the least.
    fn translation_scales(&self) -> (f64, f64) {
        let map = self.speed_map();
        let middle = 0.5 * map.trace();
        let spread = (middle * middle - map.determinant()).max(0.0).sqrt();
        (middle + spread, (middle - spread).max(0.0))
    }

    /// Slip of a held wheel within the errors of the contact solver, m/s.
    pub(super) fn slip(&self, dt: f64) -> f64 {
        self.slip_error * dt
    }

    /// Largest yaw rate within the limits of wheels and speed, rad/s.
    pub(super) fn largest_yaw_rate(&self, dt: f64) -> f64 {
        let of = |limit: &SpeedLimit| match *limit {
            SpeedLimit::Wheels(rate) => (self.wheel_radius * rate + self.slip(dt)) / self.half_track,
            SpeedLimit::Point(point, speed) => (speed + self.slip(dt)) / point.y.abs(),
        };
        self.limits.iter().map(of).fold(f64::INFINITY, f64::min)
    }

    /// Largest speed of G within the limits at yaw rates of these magnitudes, m/s.
    fn largest_speed(&self, (slow, fast): (f64, f64), dt: f64) -> f64 {
        let slip = self.slip(dt);
        let forward = |limit: &SpeedLimit| match *limit {
            SpeedLimit::Wheels(rate) => {
                let axle = self.wheel_radius * rate + slip - self.half_track * slow;
                axle.max(0.0) + self.center.x.abs() * fast
            }
            SpeedLimit::Point(point, speed) => {
                let lateral = (point.y.abs() * slow - slip).max(0.0);
                (speed * speed - lateral * lateral).max(0.0).sqrt() + (self.center.x - point.x).abs() * fast
            }
        };
        let forward = self.limits.iter().map(forward).fold(f64::INFINITY, f64::min);
        forward.hypot(self.center.y.abs() * fast + slip)
    }

    /// Largest speed of G at nodes within the limits, at yaw rates up to one, m/s; infinite without limits.
    ///
    /// The limits hold in the frame of the step's midpoint: at a node `lever` turns on by half a step.
    pub(super) fn speed_level(&self, (lever, dt): (f64, f64), yaw_rate: f64) -> f64 {
        if self.limits.is_empty() {
            return f64::INFINITY;
        }
        let of_span = |span: (f64, f64)| self.largest_speed(span, dt) + 0.5 * dt * lever * span.1 * span.1;
        spans(yaw_rate.min(self.largest_yaw_rate(dt))).map(of_span).fold(0.0, f64::max)
    }

    /// What the turn of a half step may add to the norm at a node, beyond what speeds below it allow for.
    ///
    /// Along the directions of the largest and the least speed per norm, with shares cos and sin, the speed of G per norm is at most
    /// `a - (a^2 - b^2) sin^2 / (2 a)`, and the squared yaw rate `2 (r^2 cos^2 + q^2 sin^2)`.
    pub(super) fn turn_of_node(&self, (lever, dt): (f64, f64), norm: f64, yaw_rate: f64) -> f64 {
        if lever == 0.0 {
            return 0.0;
        }
        let (largest, least) = self.translation_scales();
        let scale = largest.sqrt();
        let bend = 0.5 * dt * lever;
        let by_peak = bend * yaw_rate * yaw_rate / scale;
        let is_distinct = largest - least > DISTINCT * largest;
        if is_distinct && 2.0 * bend * norm * self.inverse.m22 <= 0.5 * (largest - least) / scale {
            by_peak.min(2.0 * bend * norm * norm * self.squared_yaw_of_fastest(least) / scale)
        } else {
            by_peak
        }
    }

    /// Squared yaw rate per squared norm in the direction of the largest speed per norm, `least` being the other squared one.
    fn squared_yaw_of_fastest(&self, least: f64) -> f64 {
        // All that is left without the other direction points there.
        let rest = self.speed_map() - least * Matrix2::identity();
        let of = |direction: Vector2<f64>| (direction.dot(&(self.inertia * direction)), direction.y * direction.y);
        let [one, other] = [rest.column(0).into_owned(), rest.column(1).into_owned()].map(of);
        let (squared_norm, squared_yaw) = if one.0 > other.0 { one } else { other };
        squared_yaw / squared_norm
    }

    /// Squared speed of G against squared norm.
    fn speed_map(&self) -> Matrix2<f64> {
        self.inverse * Matrix2::new(1.0, self.center.x, self.center.x, self.center.norm_squared())
    }

    /// At most the norm of a motion that holds within the errors of the contact solver, by the forward speed of the axle and the
    /// yaw rate.
    pub(super) fn norm(&self, (forward, yaw_rate): (f64, f64), dt: f64) -> f64 {
        let squared = self.inertia.m11 * forward * forward
            + 2.0 * self.inertia.m12.abs() * forward * yaw_rate
            + self.inertia.m22 * yaw_rate * yaw_rate;
        let by_slip = self.mass.sqrt() + (2.0 * self.spin_inertia).sqrt() / self.wheel_radius;
        squared.sqrt() + by_slip * self.slip(dt) + self.hold_error * dt
    }

    /// The growth of the norm by torques in levels up to what they build up in a time.
    pub(super) fn levels(&self, start: f64, (dt, duration): (f64, f64)) -> Vec<Level> {
        let viscous = self.viscous_friction * self.hold_error * dt / self.spin_inertia.sqrt();
        let by_wheels =
            (self.inverse.m11 + self.half_track * self.half_track * self.inverse.m22).sqrt() / self.wheel_radius;
        let rate = self.rate + self.hold_error + 4.0 * viscous * by_wheels;
        levels(start + rate * duration, rate, |_| 0.0)
    }

    /// Bound on the norm over the time that is left, where torque alone brakes: backwards it grows like forwards, but for what turning
    /// frames take.
    pub(super) fn brake_curve(
        &self,
        (end, largest): (f64, f64),
        (lever, dt): (f64, f64),
        yaw_rate: f64,
        duration: f64,
    ) -> Option<Curve> {
        let rate = self.rate + 2.0 * self.hold_error;
        let loss = |norm: f64| self.loss(norm, (lever, dt), yaw_rate);
        // What a step loses goes by the norm before it, which is by so much larger at most than that after it.
        let step = dt * (rate + loss(largest));
        let loss_before = |norm: f64| loss((norm + step).min(largest));
        self.is_conservative.then(|| Curve::by_value(&levels(largest, rate, loss_before), end, duration))
    }

    /// What the turning frame takes from a norm per second, at most.
    ///
    /// A held robot keeps its rates from step to step and is pushed aside as its frame turns.
    fn loss(&self, norm: f64, (lever, dt): (f64, f64), yaw_rate: f64) -> f64 {
        if dt == 0.0 {
            return 0.0;
        }
        let margin = self.hold_error * dt / self.yaw_inertia.sqrt();
        let of_span = |(slow, fast): (f64, f64)| {
            let rest = (norm * norm - self.yaw_inertia * slow * slow).max(0.0);
            let momentum = (rest / self.mass).sqrt().min(self.largest_speed((slow, fast), dt)) * self.mass;
            let fast = fast + margin;
            let norm = (momentum * momentum / self.mass + self.yaw_inertia * fast * fast).sqrt();
            let turn = fast * dt;
            let across = momentum * momentum / self.mass * turn * turn / 2.0;
            let centrifugal = momentum * lever * fast * turn * turn / 2.0 * (1.0 + turn * turn / 9.0).sqrt();
            if norm > 0.0 { (across + centrifugal) / (norm * dt) } else { 0.0 }
        };
        let largest = yaw_rate.min(self.largest_yaw_rate(dt)).min(norm * self.yaw_scale());
        spans(largest).map(of_span).fold(0.0, f64::max)
    }

    /// Friction impulse over mass that the slip of held wheels misdirects at a front support with friction: per length of the step,
    /// m/s2.
    pub(super) fn front_slip(&self, lever: Vector2<f64>) -> f64 {
        (1.0 / self.mass + lever.norm_squared() / self.yaw_inertia).sqrt() * self.hold_error
    }
}

/// Equal spans from zero to a value.
fn spans(largest: f64) -> impl Iterator<Item = (f64, f64)> {
    let edge = move |index: u32| largest * f64::from(index) / f64::from(SPANS);
    (0..SPANS).map(move |index| (edge(index), edge(index + 1)))
}

/// Levels up to a norm, with `extra` of the upper end of each; beyond it that of this norm.
fn levels(largest: f64, rate: f64, extra: impl Fn(f64) -> f64) -> Vec<Level> {
    let level = |index: u32| {
        let until = largest * f64::from(index) / f64::from(LEVELS);
        Level { until: if index == LEVELS { f64::INFINITY } else { until }, rate: rate + extra(until) }
    };
    (1..=LEVELS).map(level).collect()
}

/// Slip that the errors of the contact solver leave: left and right lengthwise, lateral, per length of the step, m/s2.
fn slip_errors(robot: &Robot, law_error: f64) -> [f64; 3] {
    let delassus = robot.delassus();
    let [left, right] = [0, 1].map(|wheel| law_error * (delassus[(wheel, wheel)] + delassus[(2, 2)]));
    [left, right, left.max(right)]
}

/// At most the norm of the motion that has these slips and the least norm.
fn norm_of_slips(robot: &Robot, slips: [f64; 3]) -> f64 {
    let block = robot.delassus().fixed_view::<3, 3>(0, 0).into_owned();
    let Some(inverse) = block.try_inverse() else { return f64::INFINITY };
    let mut squared = 0.0;
    for (row, a) in slips.into_iter().enumerate() {
        for (column, b) in slips.into_iter().enumerate() {
            squared += inverse[(row, column)].abs() * a * b;
        }
    }
    squared.sqrt()
}
