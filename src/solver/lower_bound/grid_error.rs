//! Bounds on the errors of the time-stepping scheme in the laws that the lower bounds use.
//!
//! The scheme keeps the law of the yaw rate and of the wheel rates exactly. The momentum of the whole robot's centre of
//! mass G it keeps only to first order where G lies off the chassis centre of mass (by `lever`) and the robot yaws; the
//! errors are derived in `docs/bounds.md`. They grow with the yaw rate, which friction and torque bound over time.

use super::capacity::Capacity;
use super::envelope::{Envelope, Line};

/// The motions for which a bound holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::solver) enum Grid {
    /// Those of the time-stepping scheme on this many steps, or more.
    Steps(usize),
    /// Those of the equations of motion.
    Continuous,
}

/// Each round of bounding the yaw rate tightens the error that the next one uses; later ones gain little.
const YAW_RATE_ROUNDS: usize = 4;

/// Known speeds of a motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct KnownRates {
    /// Largest magnitude of the yaw rate at the start, rad/s.
    pub(super) start_yaw: f64,
    /// Largest magnitude of the yaw rate at the goal; none where it is free.
    pub(super) end_yaw: Option<f64>,
    /// Drive norm at the start.
    pub(super) start_norm: f64,
}

/// Errors of one motion of known duration.
#[derive(Debug, Clone, Copy)]
pub(super) struct GridError {
    lever: f64,
    dt: f64,
    yaw_acceleration: f64,
    start_yaw: f64,
    peak: f64,
    duration: f64,
    /// Bound on the magnitude of the yaw rate over time.
    yaw_rate: Envelope,
}

impl GridError {
    pub(super) fn new(capacity: &Capacity, rates: &KnownRates, duration: f64, grid: Grid) -> Self {
        let (lever, dt) = match grid {
            Grid::Steps(count) => (capacity.center.norm(), duration / count as f64),
            Grid::Continuous => (0.0, 0.0),
        };
        let slope = capacity.yaw_acceleration;
        let backward = |end: f64| Line { start: end + slope * duration, slope: -slope };
        let mut lines =
            [Line { start: rates.start_yaw, slope }, rates.end_yaw.map_or(Line::ABOVE_ALL, backward), Line::ABOVE_ALL];
        let yaw_rate = Envelope::new(&lines, duration);
        let mut error = Self {
            lever,
            dt,
            yaw_acceleration: slope,
            start_yaw: rates.start_yaw,
            peak: yaw_rate.peak(),
            duration,
            yaw_rate,
        };
        if let Some(rate) = capacity.drive_rate {
            let mass = capacity.mass.sqrt();
            let scale = 1.0 / capacity.yaw_inertia.sqrt();
            // The drive norm bounds the yaw rate too, up to an error that the bound so far bounds.
            for _ in 0..YAW_RATE_ROUNDS {
                let start = scale * (rates.start_norm + mass * error.of_drive(duration));
                lines[2] = Line { start, slope: scale * rate };
                error.yaw_rate = Envelope::new(&lines, duration);
                error.peak = error.yaw_rate.peak();
            }
        }
        error
    }

    /// Error of G's velocity that builds up from the start until `time`, m/s.
    pub(super) fn since_start(&self, time: f64) -> f64 {
        if self.lever == 0.0 {
            return 0.0;
        }
        let (first, fourth) = self.weights();
        let integral = first * self.yaw_rate.power_integral(1, time) + fourth * self.yaw_rate.power_integral(4, time);
        self.lever * (integral + self.peak_steps())
    }

    /// Error of G's velocity that builds up from `time` to the end, m/s.
    pub(super) fn until_end(&self, time: f64) -> f64 {
        if self.lever == 0.0 {
            return 0.0;
        }
        self.since_start(self.duration) - self.since_start(time) + self.lever * self.peak_steps()
    }

    /// Error of the drive norm per square root of the mass, m/s.
    pub(super) fn of_drive(&self, time: f64) -> f64 {
        if self.lever == 0.0 {
            return 0.0;
        }
        let (half, turn) = (0.5 * self.dt, self.dt * self.peak);
        let steps = self.yaw_rate.power_integral(3, time) + self.dt * self.peak.powi(3);
        let ends = 3.0 * self.start_yaw * self.start_yaw + self.peak * self.peak;
        self.lever * half * (ends + (1.0 + turn * turn / 9.0).sqrt() * steps)
    }

    /// Error of G's displacement against the sum of its velocities, m.
    pub(super) fn of_displacement(&self) -> f64 {
        if self.lever == 0.0 {
            return 0.0;
        }
        let integral = |power| self.yaw_rate.power_integral(power, self.duration);
        let jerk = integral(3) + 3.0 * self.yaw_acceleration * integral(1);
        let peak_jerk = self.peak.powi(3) + 3.0 * self.yaw_acceleration * self.peak;
        let quadrature = self.dt * self.dt / 12.0 * (jerk + 2.0 * self.dt * peak_jerk);
        self.lever * quadrature + self.dt * (self.since_start(self.duration) + self.of_drive(self.duration))
    }

    /// Length of a step, s.
    pub(super) fn dt(&self) -> f64 {
        self.dt
    }

    /// Acceleration error per yaw rate and per its fourth power.
    fn weights(&self) -> (f64, f64) {
        let half = 0.5 * self.dt;
        let turn = half * self.peak;
        (2.0 * half * self.yaw_acceleration * (1.0 + 0.5625 * turn * turn).sqrt(), half * half / 6.0)
    }

    /// What the largest rate in each step may add to the integrals.
    fn peak_steps(&self) -> f64 {
        let (first, fourth) = self.weights();
        2.0 * self.dt * (first * self.peak + fourth * self.peak.powi(4))
    }
}
