//! The two messages of ROS 2: `nav_msgs/msg/Trajectory` and `trajectory_msgs/msg/JointTrajectory`.

use std::fmt::Write as _;

use super::motion::Point;
use super::sink::Sink;

const NS_PER_S: u64 = 1_000_000_000;

/// What both messages say beside the points.
#[derive(Debug)]
pub(super) struct Labels {
    /// When the plan begins, ns since the epoch of the clock.
    pub(super) start_ns: u64,
    /// The frame of the poses.
    pub(super) frame_id: String,
    /// The joints of the left and of the right wheel.
    pub(super) joint_names: [String; 2],
}

/// The name of a message, and its fields.
type Definition = (&'static str, &'static [&'static str]);

/// All messages that are used.
const DEFINITIONS: [Definition; 14] = [
    ("nav_msgs/Trajectory", &["std_msgs/Header header", "nav_msgs/TrajectoryPoint[] points"]),
    (
        "nav_msgs/TrajectoryPoint",
        &[
            "std_msgs/Header header",
            "geometry_msgs/Pose pose",
            "geometry_msgs/Twist velocity",
            "geometry_msgs/Accel acceleration",
            "geometry_msgs/Wrench effort",
        ],
    ),
    (
        "trajectory_msgs/JointTrajectory",
        &["std_msgs/Header header", "string[] joint_names", "trajectory_msgs/JointTrajectoryPoint[] points"],
    ),
    (
        "trajectory_msgs/JointTrajectoryPoint",
        &[
            "float64[] positions",
            "float64[] velocities",
            "float64[] accelerations",
            "float64[] effort",
            "builtin_interfaces/Duration time_from_start",
        ],
    ),
    ("std_msgs/Header", &["builtin_interfaces/Time stamp", "string frame_id"]),
    ("builtin_interfaces/Time", &["int32 sec", "uint32 nanosec"]),
    ("builtin_interfaces/Duration", &["int32 sec", "uint32 nanosec"]),
    ("geometry_msgs/Pose", &["geometry_msgs/Point position", "geometry_msgs/Quaternion orientation"]),
    ("geometry_msgs/Point", &["float64 x", "float64 y", "float64 z"]),
    ("geometry_msgs/Quaternion", &["float64 x", "float64 y", "float64 z", "float64 w"]),
    ("geometry_msgs/Twist", &["geometry_msgs/Vector3 linear", "geometry_msgs/Vector3 angular"]),
    ("geometry_msgs/Accel", &["geometry_msgs/Vector3 linear", "geometry_msgs/Vector3 angular"]),
    ("geometry_msgs/Wrench", &["geometry_msgs/Vector3 force", "geometry_msgs/Vector3 torque"]),
    ("geometry_msgs/Vector3", &["float64 x", "float64 y", "float64 z"]),
];

/// The definition of a message with those of all messages in it, as `ros2msg` of MCAP: `nav_msgs/Trajectory`.
pub(super) fn schema(root: &'static str) -> String {
    let mut names = vec![root];
    let mut text = String::new();
    let mut next = 0;
    while let Some(name) = names.get(next).copied() {
        if next > 0 {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{}\nMSG: {name}", "=".repeat(80));
        }
        next += 1;
        let fields = DEFINITIONS.iter().find(|(of, _)| *of == name).map_or(&[][..], |(_, fields)| fields);
        for field in fields {
            let _ = writeln!(text, "{field}");
            let kind = field.split(['[', ' ']).next().unwrap_or_default();
            if kind.contains('/') && !names.contains(&kind) {
                names.push(kind);
            }
        }
    }
    text
}

/// `nav_msgs/msg/Trajectory`: absolute times; acceleration and effort, which are for other robots, are absent.
pub(super) fn trajectory(sink: &mut impl Sink, labels: &Labels, points: &[Point]) {
    sink.message("", |sink| {
        header(sink, labels, 0);
        sink.array("points", points.iter(), |sink, point| {
            sink.message("", |sink| {
                header(sink, labels, point.nanoseconds);
                sink.message("pose", |sink| {
                    let (sin, cos) = (0.5 * point.yaw).sin_cos();
                    vector(sink, "position", [("x", point.x), ("y", point.y), ("z", 0.0)]);
                    vector(sink, "orientation", [("x", 0.0), ("y", 0.0), ("z", sin), ("w", cos)]);
                });
                let twist = &point.twist;
                pair(
                    sink,
                    "velocity",
                    ("linear", [twist.forward, twist.left, 0.0]),
                    ("angular", [0.0, 0.0, twist.yaw_rate]),
                );
                pair(sink, "acceleration", ("linear", [f64::NAN; 3]), ("angular", [f64::NAN; 3]));
                pair(sink, "effort", ("force", [f64::NAN; 3]), ("torque", [f64::NAN; 3]));
            });
        });
    });
}

/// `trajectory_msgs/msg/JointTrajectory`: times from the start.
pub(super) fn joint_trajectory(sink: &mut impl Sink, labels: &Labels, points: &[Point]) {
    sink.message("", |sink| {
        header(sink, labels, 0);
        sink.array("joint_names", labels.joint_names.iter(), |sink, name| sink.text("", name));
        sink.array("points", points.iter(), |sink, point| {
            sink.message("", |sink| {
                sink.float64s("positions", &[point.wheel_angle.left, point.wheel_angle.right]);
                sink.float64s("velocities", &[point.wheel_rate.left, point.wheel_rate.right]);
                sink.float64s("accelerations", &[]);
                sink.float64s("effort", &[point.torque.left, point.torque.right]);
                time(sink, "time_from_start", point.nanoseconds);
            });
        });
    });
}

/// `std_msgs/msg/Header` of a time after the start, ns.
fn header(sink: &mut impl Sink, labels: &Labels, after_start: u64) {
    sink.message("header", |sink| {
        time(sink, "stamp", labels.start_ns + after_start);
        sink.text("frame_id", &labels.frame_id);
    });
}

fn time(sink: &mut impl Sink, name: &str, nanoseconds: u64) {
    sink.message(name, |sink| {
        // The rules keep instants within the type.
        sink.int32("sec", i32::try_from(nanoseconds / NS_PER_S).unwrap_or(i32::MAX));
        sink.uint32("nanosec", u32::try_from(nanoseconds % NS_PER_S).unwrap_or_default());
    });
}

/// Two vectors, such as a twist.
fn pair(sink: &mut impl Sink, name: &str, first: (&str, [f64; 3]), second: (&str, [f64; 3])) {
    sink.message(name, |sink| {
        for (name, [x, y, z]) in [first, second] {
            vector(sink, name, [("x", x), ("y", y), ("z", z)]);
        }
    });
}

fn vector<const N: usize>(sink: &mut impl Sink, name: &str, components: [(&str, f64); N]) {
    sink.message(name, |sink| components.into_iter().for_each(|(name, value)| sink.float64(name, value)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schema_has_each_message_once_and_nothing_but_fields() {
        let text = schema("trajectory_msgs/JointTrajectory");
        let expected = [
            "std_msgs/Header header",
            "string[] joint_names",
            "trajectory_msgs/JointTrajectoryPoint[] points",
            "=",
            "MSG: std_msgs/Header",
            "builtin_interfaces/Time stamp",
            "string frame_id",
            "=",
            "MSG: trajectory_msgs/JointTrajectoryPoint",
            "float64[] positions",
            "float64[] velocities",
            "float64[] accelerations",
            "float64[] effort",
            "builtin_interfaces/Duration time_from_start",
            "=",
            "MSG: builtin_interfaces/Time",
            "int32 sec",
            "uint32 nanosec",
            "=",
            "MSG: builtin_interfaces/Duration",
            "int32 sec",
            "uint32 nanosec",
        ];
        let separator = "=".repeat(80);
        assert_eq!(text.lines().map(|line| if line == separator { "=" } else { line }).collect::<Vec<_>>(), expected);
        assert_eq!(schema("nav_msgs/Trajectory").matches("MSG: geometry_msgs/Vector3").count(), 1);
    }
}
