//! Draws of maneuvers for one robot, of the same kinds as the suite's.
//!
//! Kinds take turns. Lengths are log-uniform (nudges and long drives count alike), angles and speeds uniform:
//!
//! | kind | start | goal |
//! |---|---|---|
//! | nudge | rest | 2 to 20 cm any way, same heading |
//! | straight | rest | 0.2 to 20 m ahead or behind |
//! | turn | rest | 1 deg to 180 deg in place, either way |
//! | pose | rest | 0.3 to 5 m any way, any heading |
//! | rolling | up to 1.5 m/s and 2 rad/s, rolling | pose |
//! | slipping | up to 0.8 m/s each way, 2 rad/s, wheels up to 15 rad/s | pose |
//! | passing | rest | pose, wheels and yaw of rolling at up to 1 m/s and 1 rad/s |
//! | free | rest | pose with one freed group of components |
//! | unequal | rest | pose, each torque limit 0.4 to 1 of the robot's |
//! | axle | rest | pose of the axle midpoint |
//!
//! Passing goals leave the velocity to the wheels. A time step keeps the wheels from sliding sideways at its middle, so a
//! plan that rolls through a turn ends with a velocity that lags its heading by half a step: asking for the velocity of
//! exact rolling as well would ask for a slip of that size.

use std::f64::consts::PI;
use std::ops::Range;

use rand::RngExt as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::{Map, Value, json};
use slipdrive::robot::{PerWheel, RobotParameters};

/// Names of the kinds, in the order in which they take turns.
pub(crate) const KINDS: [&str; 10] =
    ["nudge", "straight", "turn", "pose", "rolling", "slipping", "passing", "free", "unequal", "axle"];
/// Groups of goal components that are freed together.
const FREED: [&[&str]; 6] = [
    &["heading_rad"],
    &["x_m"],
    &["y_m"],
    &["wheel_rate_left_rad_s", "wheel_rate_right_rad_s"],
    &["velocity_x_m_s", "velocity_y_m_s"],
    &["velocity_x_m_s", "velocity_y_m_s", "yaw_rate_rad_s", "wheel_rate_left_rad_s", "wheel_rate_right_rad_s"],
];

/// Draws maneuvers of one robot.
pub(crate) struct Draw<'a> {
    pub(crate) rng: &'a mut Xoshiro256PlusPlus,
    pub(crate) parameters: &'a RobotParameters,
    /// Torque limits of the robot, N m.
    pub(crate) torque_limit: PerWheel<f64>,
}

impl Draw<'_> {
    /// A maneuver of a kind: the fields of the request's `maneuver` that differ from the robot's own.
    pub(crate) fn maneuver(&mut self, kind: &str) -> Map<String, Value> {
        let mut maneuver = Map::new();
        let goal = match kind {
            "nudge" => self.position(0.02..0.2),
            "straight" => object(&[("y_m", sign(self.rng) * log_uniform(self.rng, 0.2..20.0))]),
            "turn" => object(&[("heading_rad", sign(self.rng) * log_uniform(self.rng, PI / 180.0..PI))]),
            "passing" => {
                let mut goal = self.pose();
                let (speed, yaw_rate) = (within(self.rng, 1.0), within(self.rng, 1.0));
                goal.extend(self.rolling(speed, yaw_rate));
                goal.remove("velocity_y_m_s");
                goal.insert("free".to_owned(), json!(["velocity_x_m_s", "velocity_y_m_s"]));
                goal
            }
            "free" => {
                let mut goal = self.pose();
                let freed = FREED[self.rng.random_range(0..FREED.len())];
                goal.retain(|field, _| !freed.contains(&field.as_str()));
                goal.insert("free".to_owned(), json!(freed));
                goal
            }
            _ => self.pose(),
        };
        maneuver.insert("goal".to_owned(), Value::Object(goal));
        match kind {
            "rolling" => {
                let (speed, yaw_rate) = (within(self.rng, 1.5), within(self.rng, 2.0));
                maneuver.insert("start".to_owned(), Value::Object(self.rolling(speed, yaw_rate)));
            }
            "slipping" => {
                maneuver.insert("start".to_owned(), Value::Object(self.slipping()));
            }
            "unequal" => {
                let PerWheel { left, right } = self.torque_limit;
                for (field, limit) in [("torque_limit_left_n_m", left), ("torque_limit_right_n_m", right)] {
                    maneuver.insert(field.to_owned(), json!(self.rng.random_range(0.4..1.0) * limit));
                }
            }
            _ => {}
        }
        // Rolling is said of the axle midpoint, which has no lateral velocity then.
        if ["rolling", "axle"].contains(&kind) {
            maneuver.insert("reference_point".to_owned(), json!("axle_midpoint"));
        }
        maneuver
    }

    /// A place at some distance and any heading.
    pub(crate) fn pose(&mut self) -> Map<String, Value> {
        let mut pose = self.position(0.3..5.0);
        pose.insert("heading_rad".to_owned(), json!(within(self.rng, PI)));
        pose
    }

    /// A place at this distance (m), any way.
    pub(crate) fn position(&mut self, distance: Range<f64>) -> Map<String, Value> {
        let (distance, bearing) = (log_uniform(self.rng, distance), within(self.rng, PI));
        object(&[("x_m", distance * bearing.sin()), ("y_m", distance * bearing.cos())])
    }

    /// Velocities of the axle midpoint at heading 0, and of the wheels that roll along.
    pub(crate) fn rolling(&self, speed: f64, yaw_rate: f64) -> Map<String, Value> {
        let RobotParameters { wheel_radius, track_width, .. } = *self.parameters;
        let swing = yaw_rate * track_width / 2.0;
        object(&[
            ("velocity_y_m_s", speed),
            ("yaw_rate_rad_s", yaw_rate),
            ("wheel_rate_left_rad_s", (speed - swing) / wheel_radius),
            ("wheel_rate_right_rad_s", (speed + swing) / wheel_radius),
        ])
    }

    fn slipping(&mut self) -> Map<String, Value> {
        object(&[
            ("velocity_x_m_s", within(self.rng, 0.8)),
            ("velocity_y_m_s", within(self.rng, 0.8)),
            ("yaw_rate_rad_s", within(self.rng, 2.0)),
            ("wheel_rate_left_rad_s", within(self.rng, 15.0)),
            ("wheel_rate_right_rad_s", within(self.rng, 15.0)),
        ])
    }
}

/// A number between plus and minus a magnitude.
pub(crate) fn within(rng: &mut Xoshiro256PlusPlus, magnitude: f64) -> f64 {
    rng.random_range(-magnitude..magnitude)
}

/// Plus or minus one.
pub(crate) fn sign(rng: &mut Xoshiro256PlusPlus) -> f64 {
    within(rng, 1.0).signum()
}

/// A positive number whose logarithm is uniform.
pub(crate) fn log_uniform(rng: &mut Xoshiro256PlusPlus, range: Range<f64>) -> f64 {
    rng.random_range(range.start.ln()..range.end.ln()).exp()
}

/// A JSON object of numbers.
pub(crate) fn object(fields: &[(&str, f64)]) -> Map<String, Value> {
    fields.iter().map(|(field, value)| ((*field).to_owned(), json!(value))).collect()
}
