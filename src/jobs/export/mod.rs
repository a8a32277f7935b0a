//! The hand-over of a plan to a controller: the motion of `base_link`, wheel rates and torques at a constant rate, as files.
//!
//! The plan is rolled out again on its own grid. Frames, columns and the miss: `docs/hand_over.md`.

mod accept;
mod files;
mod miss;
mod motion;
mod ros;
mod sink;

use std::sync::Arc;
use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

pub use accept::AcceptedExport;

use self::miss::Miss;
use self::motion::Motion;
use super::limits::BODY_WITH_ANSWERS;
use super::plan::without_motion;
use super::table::{line, row};
use super::{File, Flag, Kind, Limits, ManeuverSolver, STEP_S};
use crate::contract::message::{ExportFormat, ExportRequest, ExportResponse, ExportedFile};
use crate::contract::{BodyLimit, Problem, json};
use crate::metrics::Metrics;
use crate::rules::RuleSet;
use crate::service::{Class, Cost, Done, Job, JobControl, Stopped};
use crate::stop::Stop;

/// What a point takes a small cloud machine to be written, s.
const POINT_S: f64 = 10e-6;

/// What files hold beside their points, bytes in base64: names of columns, and definitions of messages.
const FURTHER_BYTES: f64 = 10e3;

/// Exports plans.
pub struct Export(Arc<dyn ManeuverSolver>);

impl Export {
    /// Rolls motions out with this solver.
    pub fn new(solver: Arc<dyn ManeuverSolver>, _metrics: &Metrics) -> Self {
        Self(solver)
    }
}

/// A plan as files.
#[derive(Debug)]
pub struct Exported {
    files: Vec<File>,
    miss: Miss,
    point_count: usize,
}

impl Job for Export {
    const NAME: &'static str = "export";
    const CLASS: Class = Class::Light;
    type Input = AcceptedExport;
    type Output = Exported;
    type Progress = ();

    fn cost(&self, export: &AcceptedExport) -> Cost {
        Cost::seconds(export.plan.step_count() as f64 * STEP_S + export.point_count() * POINT_S)
    }

    fn time_limit(&self, export: &AcceptedExport) -> Option<Duration> {
        export.time_limit
    }

    fn run(&self, export: &AcceptedExport, control: &JobControl<'_, ()>) -> Result<Exported, Stopped> {
        let AcceptedExport { plan, format, rate, labels, time_limit: _ } = export;
        let stop = Stop::from(control.stop().cut_flag());
        let trajectory = plan.trajectory(&*self.0, stop).map_err(|_| control.cut_off())?;
        plan.check_belongs(&trajectory)?;
        plan.check_ends(&trajectory)?;
        let motion = Motion::new(plan, &trajectory);
        let points = motion.points(*rate);
        let files = files::files(*format, labels, &motion, &points);
        let miss = Miss::of(&points);
        // What is late has no answer, however far it came.
        stop.check().map_err(|_| control.cut_off())?;
        Ok(Exported { files, miss, point_count: points.len() })
    }
}

impl Kind for Export {
    const SUMMARY: &'static str = "writes a plan as files for controllers";
    const METHODS: &'static [&'static str] = &["Export"];
    const SAVED_FILES: usize = 1;
    const TEXT_FLAGS: &'static [Flag] = &[
        Flag { field: "format", help: "Which files: csv, ros2_json or ros2_mcap" },
        Flag { field: "frame_id", help: "The frame of the poses [default: odom]" },
    ];
    const FLAGS: &'static [Flag] = &[
        Flag { field: "rate_hz", help: "Points per second" },
        Flag { field: "start_time", help: "When the plan begins, such as {\"sec\": 5} [default: 0]" },
        Flag {
            field: "joint_names",
            help: "Joints, such as [\"left\", \"right\"] [default: left_wheel_joint, right_wheel_joint]",
        },
    ];
    const HAS_FILES: bool = true;
    type Request = ExportRequest;
    type Answer = ExportResponse;
    type Report = ();

    fn rules(_limits: &Limits) -> RuleSet {
        accept::rules()
    }

    fn validate(request: ExportRequest, limits: &Limits) -> Result<AcceptedExport, Problem> {
        accept::accept(request, limits)
    }

    fn body_limit(_limits: &Limits) -> BodyLimit {
        BODY_WITH_ANSWERS
    }

    fn answer_bytes(export: &AcceptedExport, _number_bytes: usize) -> usize {
        // In base64: points with their frame, and those of the joints, two more for each interval. 10,000 points of 1,000 intervals
        // fit into the share of a connection.
        let frame = &export.labels.frame_id;
        let base64 = |length: usize| 4.0 / 3.0 * length as f64;
        let (by_point, by_joint_point) = match export.format {
            ExportFormat::Csv | ExportFormat::Unspecified => (400.0, 0.0),
            ExportFormat::Ros2Mcap => (300.0 + base64(frame.len()), 120.0),
            ExportFormat::Ros2Json => (750.0 + base64(json::write(frame).len()), 340.0),
        };
        let joint_point_count = export.point_count() + 2.0 * export.plan.motion.schedule.control_count() as f64;
        let bytes = FURTHER_BYTES + export.point_count() * by_point + joint_point_count * by_joint_point;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 12,000 points")]
        let bytes = bytes as usize;
        bytes
    }

    fn answer(_export: &AcceptedExport, done: &Done<Exported>) -> ExportResponse {
        let Exported { files, miss, point_count: _ } = &done.output;
        let file = |File { name, media_type, content }: &File| ExportedFile {
            name: (*name).to_owned(),
            media_type: (*media_type).to_owned(),
            base64: STANDARD.encode(content),
        };
        ExportResponse { files: files.iter().map(file).collect(), miss_m: miss.distance, miss_rad: miss.yaw }
    }

    fn files(output: &Exported) -> &[File] {
        &output.files
    }

    /// The file has a plan, or a whole request.
    fn joined(files: Vec<Vec<u8>>) -> Result<Vec<u8>, Problem> {
        without_motion(&files.concat())
    }

    /// What the plan is worth, files and their sizes, and the miss.
    fn table(export: &AcceptedExport, done: &Done<Exported>) -> String {
        let Exported { files, miss, point_count } = &done.output;
        let mut table = String::new();
        row(&mut table, "plan", &export.plan.standing());
        row(&mut table, "points", &point_count.to_string());
        row(
            &mut table,
            "twist alone",
            &format!("misses the last pose by {:.2e} m, {:.2e} rad", miss.distance, miss.yaw),
        );
        table.push_str("\nfiles\n");
        for File { name, content, .. } in files {
            line(&mut table, &format!("  {name:<22} {:>9} bytes", content.len()));
        }
        table
    }
}
