//! Bounds on the errors of the time-stepping scheme in the laws that the lower bounds use.
//!
//! The scheme keeps the law of the yaw rate and of the wheel rates exactly. The momentum of the whole robot's centre of
//! mass G it keeps only to first order where G lies off the chassis centre of mass (by `lever`) and the robot yaws; the
//! errors are derived in `docs/bounds.md`. They grow with the yaw rate, which friction and torque bound over time.

use std::f64::consts::PI;

use super::capacity::Capacity;
use super::curve::{Curve, Level};
use super::envelope::Envelope;

/// The motions for which a bound holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::solver) enum Grid {
    /// Those of the time-stepping scheme on this many steps, or more.
    Steps(usize),
    /// Those of the equations of motion.
    Continuous,
}

/// Largest value of `sin^3 x cos x`: yaw that takes a share of the drive norm leaves the rest for translation.
const YAW_BESIDE_TRANSLATION: f64 = 0.324_76;

/// Known speeds of a motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct KnownRates {
    /// Largest magnitude of the yaw rate at the start, rad/s.
    pub(super) start_yaw: f64,
    /// Largest magnitude of the yaw rate at the goal; none where it is free.
    pub(super) end_yaw: Option<f64>,
    /// Drive norm at the start.
    pub(super) start_norm: f64,
    /// Largest forward speed of the axle at the goal, m/s; none where it is free.
    pub(super) end_forward: Option<f64>,
}

/// Errors of one motion of known duration, and the bounds on its speeds that hold with them.
#[derive(Debug, Clone)]
pub(super) struct GridError {
    lever: f64,
    /// Length of a step, s.
    pub(super) dt: f64,
    yaw_acceleration: f64,
    /// Largest yaw rate at nodes, rad/s.
    pub(super) peak_yaw_rate: f64,
    end_yaw: f64,
    mass: f64,
    /// s
    pub(super) duration: f64,
    /// Bound on the magnitude of the yaw rate over time.
    yaw_rate: Envelope,
    /// Its area, rad.
    largest_turn: f64,
    /// Acceleration error per lever and yaw rate, 1/s.
    per_yaw_rate: f64,
    /// Per lever: how far the velocity that the scheme keeps is from that of G at both ends, and what the largest yaw rate
    /// of a step may add to the integral at both of its ends, rad/s.
    at_nodes: f64,
    /// Bound on the drive norm over time, errors included.
    pub(super) drive: Option<Curve>,
    /// Bound on the norm over time that braking by torque alone leaves, where nothing else brakes.
    pub(super) brake: Option<Curve>,
    /// Largest yaw rate at the end of each step by the limits, rad/s; infinite without.
    pub(super) yaw_level: f64,
    /// Largest speed of G at nodes where the wheels hold, m/s; infinite without a limit.
    pub(super) center_level: f64,
}

impl GridError {
    pub(super) fn new(capacity: &Capacity, rates: &KnownRates, duration: f64, grid: Grid) -> Self {
        let (lever, dt) = match grid {
            Grid::Steps(count) => (capacity.center.norm(), duration / count as f64),
            Grid::Continuous => (0.0, 0.0),
        };
        let slope = capacity.yaw_acceleration;
        let nothing = Curve::above_all(duration);
        let forward = Curve::straight(rates.start_yaw, slope, duration);
        let backward = rates.end_yaw.map_or(nothing.clone(), |end| Curve::straight(end, slope, duration).reversed());
        // No limit judges the first node.
        let yaw_level = capacity.largest_yaw_rate(dt);
        let level = yaw_level.max(rates.start_yaw);
        let limit = if level.is_finite() { Curve::straight(level, 0.0, duration) } else { nothing };
        let by_friction = Envelope::new(&[&forward, &backward, &limit]);
        let turning = Turning { lever, dt, peak: by_friction.peak() };
        let drive = turning.drive_curve(capacity, rates, duration);
        let yaw_rate = match &drive {
            Some(drive) => Envelope::new(&[&forward, &backward, &drive.scaled(capacity.yaw_scale()), &limit]),
            None => by_friction,
        };
        let peak = yaw_rate.peak();
        let turning = Turning { peak, ..turning };
        let brake = drive.as_ref().and_then(|drive| turning.brake_curve(capacity, rates, (drive.end(), duration)));
        let half_turn = 0.5 * dt * peak;
        let per_yaw_rate = dt * slope * bend(half_turn);
        Self {
            lever,
            dt,
            yaw_acceleration: slope,
            peak_yaw_rate: peak,
            end_yaw: rates.end_yaw.map_or(peak, |end| end.min(peak)),
            mass: capacity.mass,
            duration,
            largest_turn: yaw_rate.area(duration),
            per_yaw_rate,
            at_nodes: 2.0 * peak * shift(half_turn) + 2.0 * dt * per_yaw_rate * peak,
            yaw_rate,
            drive,
            brake,
            yaw_level,
            center_level: capacity
                .rolling
                .as_ref()
                .map_or(f64::INFINITY, |rolling| rolling.speed_level((lever, dt), peak)),
        }
    }

    /// Error of G's velocity that builds up from the start until `time`, m/s.
    pub(super) fn since_start(&self, time: f64) -> f64 {
        if self.lever == 0.0 {
            return 0.0;
        }
        self.lever * (self.per_yaw_rate * self.yaw_rate.area(time) + self.at_nodes)
    }

    /// Error of G's velocity that builds up from `time` to the end, m/s.
    pub(super) fn until_end(&self, time: f64) -> f64 {
        if self.lever == 0.0 {
            return 0.0;
        }
        let integral = self.largest_turn - self.yaw_rate.area(time);
        self.lever * (self.per_yaw_rate * integral + self.at_nodes)
    }

    /// How much the drive norm at the end may exceed its bound, which holds within the steps.
    pub(super) fn of_end_norm(&self) -> f64 {
        0.5 * self.dt * self.mass.sqrt() * self.lever * self.end_yaw * self.end_yaw
    }

    /// Error of G's displacement against the sum of its velocities, m.
    pub(super) fn of_displacement(&self) -> f64 {
        if self.lever == 0.0 {
            return 0.0;
        }
        self.lever * self.of_quadrature() + self.dt * self.since_start(self.duration)
    }

    /// Error of a point's displacement against the sum of its velocities relative to another one, per distance.
    pub(super) fn of_quadrature(&self) -> f64 {
        let jerk = self.yaw_rate.cubic_area() + 3.0 * self.yaw_acceleration * self.largest_turn;
        let peak_jerk = self.peak_yaw_rate.powi(3) + 3.0 * self.yaw_acceleration * self.peak_yaw_rate;
        self.dt * self.dt / 12.0 * (jerk + 2.0 * self.dt * peak_jerk)
    }

    /// How far the way of a point may differ from the sum of its velocities in the frames of the steps, per distance from the
    /// chassis centre of mass: it goes along chords, its velocity along tangents.
    pub(super) fn of_chords(&self) -> f64 {
        let half_turn = 0.5 * self.dt * self.peak_yaw_rate;
        if half_turn == 0.0 {
            return 0.0;
        }
        let each = half_turn * self.peak_yaw_rate * self.duration;
        let by_parts = if half_turn < PI {
            let (sin, cos) = half_turn.sin_cos();
            let end = (1.0 - half_turn * cos / sin).hypot(half_turn);
            let slope = ((half_turn - sin * cos) / (sin * sin)).hypot(1.0);
            2.0 * end + half_turn * half_turn + 0.5 * self.dt * slope * self.yaw_acceleration * self.duration
        } else {
            f64::INFINITY
        };
        each.min(by_parts)
    }

    /// What the sum of node values may exceed the area under convex curves by.
    pub(super) fn of_convexity(&self, curves: &[&Curve]) -> f64 {
        self.dt * self.dt / 8.0 * curves.iter().map(|curve| curve.slope_rise()).sum::<f64>()
    }
}

/// `x / sin x - 1`, which grows with x; infinite from a half turn on.
fn shift(x: f64) -> f64 {
    if x == 0.0 {
        0.0
    } else if x < PI {
        x / x.sin() - 1.0
    } else {
        f64::INFINITY
    }
}

/// `|dzeta/domega| / (2 h omega)` at x = h omega, which grows with x (`docs/bounds.md`); infinite from a half turn on.
fn bend(x: f64) -> f64 {
    if x == 0.0 {
        return 1.0;
    }
    if x >= PI {
        return f64::INFINITY;
    }
    let imaginary = 1.0 - 2.0 * x / x.tan() + (x / x.sin()).powi(2);
    1.0_f64.hypot(imaginary / (2.0 * x))
}

/// The error that the turning frame causes in the drive norm.
#[derive(Debug, Clone, Copy)]
struct Turning {
    lever: f64,
    dt: f64,
    /// Largest yaw rate, rad/s.
    peak: f64,
}

impl Turning {
    fn drive_curve(&self, capacity: &Capacity, rates: &KnownRates, duration: f64) -> Option<Curve> {
        let levels = capacity.drive_rates.as_ref()?;
        let by_rolling = capacity.rolling.as_ref().map(|rolling| rolling.levels(rates.start_norm, (self.dt, duration)));
        let levels = by_rolling.as_ref().unwrap_or(levels);
        let with_error = |level: &Level| Level { rate: level.rate + self.rate(capacity, level.until), ..*level };
        let levels: Vec<Level> = levels.iter().map(with_error).collect();
        let curve_from = |start| Curve::by_value(&levels, start, duration);
        let half_step = 0.5 * self.dt * self.lever * capacity.mass.sqrt();
        let start = rates.start_norm
            + 3.0 * half_step * rates.start_yaw * rates.start_yaw
            + capacity.direction_error * (self.dt * duration).sqrt();
        let curve = curve_from(start);
        if let Some(rolling) = &capacity.rolling {
            return Some(curve_from(start + rolling.turn_of_node((self.lever, self.dt), curve.end(), self.peak)));
        }
        // The norm in the frame of a step bounds the speed at its ends too, as long as a half step's turn is small.
        let bend = 0.5 * self.dt * self.lever * curve.end() * capacity.mass.sqrt() / capacity.yaw_inertia;
        if bend <= 0.5 { Some(curve) } else { Some(curve_from(start + half_step * self.peak * self.peak)) }
    }

    /// The norm over time from the end on backwards, where the wheels hold; `largest` is the norm that torque can build up.
    fn brake_curve(&self, capacity: &Capacity, rates: &KnownRates, (largest, duration): (f64, f64)) -> Option<Curve> {
        let rolling = capacity.rolling.as_ref()?;
        let grid = (self.lever, self.dt);
        let end = rolling.norm((rates.end_forward?, rates.end_yaw?), self.dt);
        let end = end + rolling.turn_of_node(grid, largest, self.peak);
        rolling.brake_curve((end, largest), grid, self.peak, duration)
    }

    /// Growth of the drive norm per second at a norm.
    fn rate(&self, capacity: &Capacity, norm: f64) -> f64 {
        if self.lever == 0.0 {
            return 0.0;
        }
        let beside_translation = YAW_BESIDE_TRANSLATION * (norm * capacity.norm.yaw_scale()).powi(3);
        let turn = self.dt * self.peak;
        let cube = beside_translation.min(self.peak.powi(3));
        0.5 * self.dt * self.lever * capacity.mass.sqrt() * (1.0 + turn * turn / 9.0).sqrt() * cube
    }
}
