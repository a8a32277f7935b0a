//! The files of an export. Their names depend on the format alone.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Cursor;

use mcap::WriteOptions;
use mcap::records::MessageHeader;

use super::motion::{Motion, Point};
use super::ros::{Labels, joint_trajectory, schema, trajectory};
use super::sink::{Cdr, Json};
use crate::contract::message::ExportFormat;
use crate::jobs::File;

/// Beside it lies its description.
const BAG: &str = "plan.mcap";
/// Topic and message, with and without `msg`.
const TOPICS: [(&str, &str, &str); 2] = [
    ("/plan/trajectory", "nav_msgs/msg/Trajectory", "nav_msgs/Trajectory"),
    ("/plan/joint_trajectory", "trajectory_msgs/msg/JointTrajectory", "trajectory_msgs/JointTrajectory"),
];
/// A column of a CSV file, and its values.
type Column = (&'static str, fn(&Point) -> f64);
const COLUMNS: [Column; 13] = [
    ("time_s", |of| of.time),
    ("x_m", |of| of.x),
    ("y_m", |of| of.y),
    ("yaw_rad", |of| of.yaw),
    ("velocity_forward_m_s", |of| of.twist.forward),
    ("velocity_left_m_s", |of| of.twist.left),
    ("yaw_rate_rad_s", |of| of.twist.yaw_rate),
    ("wheel_angle_left_rad", |of| of.wheel_angle.left),
    ("wheel_angle_right_rad", |of| of.wheel_angle.right),
    ("wheel_rate_left_rad_s", |of| of.wheel_rate.left),
    ("wheel_rate_right_rad_s", |of| of.wheel_rate.right),
    ("torque_left_n_m", |of| of.torque.left),
    ("torque_right_n_m", |of| of.torque.right),
];

/// The files of a motion with these points at the rate asked for.
pub(super) fn files(format: ExportFormat, labels: &Labels, motion: &Motion, points: &[Point]) -> Vec<File> {
    let with_steps = || motion.with_torque_steps(points);
    match format {
        ExportFormat::Unspecified => Vec::new(),
        ExportFormat::Csv => vec![File { name: "trajectory.csv", media_type: "text/csv", content: csv(points) }],
        ExportFormat::Ros2Json => {
            let json = |name, content| File { name, media_type: "application/json", content };
            vec![
                json("trajectory.json", Json::of(|sink| trajectory(sink, labels, points))),
                json("joint_trajectory.json", Json::of(|sink| joint_trajectory(sink, labels, &with_steps()))),
            ]
        }
        ExportFormat::Ros2Mcap => {
            let messages = [
                Cdr::of(|sink| trajectory(sink, labels, points)),
                Cdr::of(|sink| joint_trajectory(sink, labels, &with_steps())),
            ];
            let description = metadata(labels.start_ns).into_bytes();
            vec![
                File { name: BAG, media_type: "application/vnd.mcap", content: bag(labels.start_ns, &messages) },
                File { name: "metadata.yaml", media_type: "application/yaml", content: description },
            ]
        }
    }
}

fn csv(points: &[Point]) -> Vec<u8> {
    let mut text = COLUMNS.map(|(name, _)| name).join(",");
    text.push('\n');
    for point in points {
        for (index, (_, value)) in COLUMNS.iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            // Writing to a string cannot fail. Of large and small numbers this form is the short one.
            let _ = write!(text, "{comma}{:?}", value(point));
        }
        text.push('\n');
    }
    text.into_bytes()
}

/// One message of each topic.
fn bag(start_ns: u64, messages: &[Vec<u8>; 2]) -> Vec<u8> {
    let written = || {
        let options = WriteOptions::new().compression(None).profile("ros2");
        let options = options.library(concat!("slipdrive ", env!("CARGO_PKG_VERSION")));
        let mut writer = options.create(Cursor::new(Vec::new()))?;
        // Readers compare it with the metadata.
        let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
        for ((topic, name, definition), message) in TOPICS.into_iter().zip(messages) {
            let schema_id = writer.add_schema(name, "ros2msg", schema(definition).as_bytes())?;
            let channel_id = writer.add_channel(schema_id, topic, "cdr", &metadata)?;
            let header = MessageHeader { channel_id, sequence: 0, log_time: start_ns, publish_time: start_ns };
            writer.write_to_known_channel(&header, message)?;
        }
        writer.finish()?;
        mcap::McapResult::Ok(writer.into_inner().into_inner())
    };
    written().expect("two messages are written to memory")
}

/// What `rosbag2` says of a bag, in the version that has nothing which is not known here.
fn metadata(start_ns: u64) -> String {
    let mut topics = String::new();
    for (topic, name, _) in TOPICS {
        let _ = write!(
            topics,
            "    - topic_metadata:\n        name: {topic}\n        type: {name}\n        serialization_format: cdr\n        \
             offered_qos_profiles: \"\"\n      message_count: 1\n"
        );
    }
    let count = TOPICS.len();
    format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    nanoseconds: 0\n  \
         starting_time:\n    nanoseconds_since_epoch: {start_ns}\n  message_count: {count}\n  topics_with_message_count:\n{topics}  \
         compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {BAG}\n  files:\n    - path: {BAG}\n      \
         starting_time:\n        nanoseconds_since_epoch: {start_ns}\n      duration:\n        nanoseconds: 0\n      \
         message_count: {count}\n"
    )
}
