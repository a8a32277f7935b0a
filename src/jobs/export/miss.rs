//! Where the twist of a plan leads a controller that follows it between the points.

use super::motion::Point;

/// Nodes and weights of Gauss and Legendre with three points, on [0, 1].
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 4.0 / 9.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];
/// The rule is exact to 1e-11 of the way over a turn of this, rad.
const TURN_PER_PANEL: f64 = 0.25;
/// More turns than these panels cover between two points are noise.
const MAX_PANELS: f64 = 200.0;

/// How far the integral of the twist ends from the last pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Miss {
    /// m.
    pub(super) distance: f64,
    /// rad, not negative.
    pub(super) yaw: f64,
}

impl Miss {
    /// The miss of the twist, linear between the points, integrated from the first pose to the last:
    /// `x' = cos(yaw) forward - sin(yaw) left`, `y' = sin(yaw) forward + cos(yaw) left`, `yaw' = yaw rate`.
    pub(super) fn of(points: &[Point]) -> Self {
        let [first, .., last] = points else { return Self { distance: 0.0, yaw: 0.0 } };
        let (mut x, mut y, mut yaw) = (first.x, first.y, first.yaw);
        for pair in points.windows(2) {
            let (begin, end) = (&pair[0].twist, &pair[1].twist);
            let duration = pair[1].time - pair[0].time;
            let turn = duration * begin.yaw_rate.abs().max(end.yaw_rate.abs());
            let panels = (turn / TURN_PER_PANEL).ceil().clamp(1.0, MAX_PANELS);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 200")]
            let count = panels as u32;
            for (panel, (node, weight)) in (0..count).flat_map(|panel| GAUSS.map(|of| (f64::from(panel), of))) {
                let share = (panel + node) / panels;
                let at = |begin: f64, end: f64| begin + share * (end - begin);
                let (forward, left) = (at(begin.forward, end.forward), at(begin.left, end.left));
                // The integral of the linear yaw rate.
                let turned = share * duration * at(begin.yaw_rate, 0.5 * (begin.yaw_rate + end.yaw_rate));
                let (sin, cos) = (yaw + turned).sin_cos();
                let time = weight * duration / panels;
                x += time * (cos * forward - sin * left);
                y += time * (sin * forward + cos * left);
            }
            yaw += 0.5 * duration * (begin.yaw_rate + end.yaw_rate);
        }
        Self { distance: (x - last.x).hypot(y - last.y), yaw: (yaw - last.yaw).abs() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::motion::Twist;
    use super::*;
    use crate::robot::PerWheel;

    fn point(time: f64, (x, y, yaw): (f64, f64, f64), twist: Twist) -> Point {
        let none = PerWheel::default();
        Point { time, nanoseconds: 0, x, y, yaw, twist, wheel_angle: none, wheel_rate: none, torque: none }
    }

    #[test]
    fn constant_twist_leads_along_an_arc() {
        // The integral of (1, -0.5) m/s that turns with 2 rad/s, over seven rad.
        let twist = Twist { forward: 1.0, left: -0.5, yaw_rate: 2.0 };
        let (turn, arrived) = (7.0_f64, |turn: f64| {
            let (sin, cos) = turn.sin_cos();
            (0.5 * (sin - 0.5 * (cos - 1.0)), 0.5 * ((1.0 - cos) - 0.5 * sin), turn)
        });
        let points = [point(0.0, (0.0, 0.0, 0.0), twist), point(0.5 * turn, arrived(turn), twist)];
        let Miss { distance, yaw } = Miss::of(&points);
        assert!(distance < 1e-10 && yaw == 0.0, "{distance} m, {yaw} rad");
    }
}
