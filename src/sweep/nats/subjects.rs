//! Names of streams and subjects. Chunks, results and marks are those of this version: answers of two are never mixed.

use crate::sweep::SOLVER_VERSION;

/// Chunks that wait or run: a work queue.
pub(super) const CHUNKS: &str = "slipdrive-chunks";
/// One message per row.
pub(super) const RESULTS: &str = "slipdrive-results";
/// How often rows were begun that may have killed their workers.
pub(super) const MARKS: &str = "slipdrive-marks";
/// What cannot be run, with its input.
pub(super) const DEAD_LETTERS: &str = "slipdrive-dead-letters";
/// Whether sweeps are cancelled.
pub(super) const STATES: &str = "slipdrive-states";

/// All subjects of a stream.
pub(super) fn all_of(stream: &str) -> String {
    let kind = match stream {
        CHUNKS => "chunk",
        RESULTS => "result",
        MARKS => "mark",
        DEAD_LETTERS => "dead",
        _ => "state",
    };
    format!("slipdrive.{kind}.>")
}

/// The version as a part of a subject, where dots divide.
fn version() -> String {
    SOLVER_VERSION.replace('.', "_")
}

/// The durable consumer of all workers.
pub(super) fn consumer() -> String {
    format!("workers-{}", version())
}

/// Chunks of all sweeps.
pub(super) fn all_chunks() -> String {
    format!("slipdrive.chunk.{}.>", version())
}

/// Chunks of a sweep.
pub(super) fn chunks_of_sweep(sweep: &str) -> String {
    format!("slipdrive.chunk.{}.{sweep}.*", version())
}

/// Chunks of a sweep for any version.
pub(super) fn chunks_of_any_version(sweep: &str) -> String {
    format!("slipdrive.chunk.*.{sweep}.*")
}

pub(super) fn chunk(sweep: &str, chunk: u64) -> String {
    format!("slipdrive.chunk.{}.{sweep}.{chunk}", version())
}

/// Results of a sweep.
pub(super) fn results_of_sweep(sweep: &str) -> String {
    format!("slipdrive.result.{}.{sweep}.*", version())
}

pub(super) fn result(sweep: &str, row: u64) -> String {
    format!("slipdrive.result.{}.{sweep}.{row}", version())
}

/// The row that a subject of a result ends in.
pub(super) fn row_of(subject: &str) -> Option<u64> {
    subject.rsplit('.').next()?.parse().ok()
}

/// Marks of a sweep by any version.
pub(super) fn marks_of_any_version(sweep: &str) -> String {
    format!("slipdrive.mark.*.{sweep}.*")
}

pub(super) fn mark(sweep: &str, row: u64) -> String {
    format!("slipdrive.mark.{}.{sweep}.{row}", version())
}

/// Where a row goes that cannot be run.
pub(super) fn dead_row(sweep: &str, row: u64) -> String {
    format!("slipdrive.dead.row.{sweep}.{row}")
}

/// Where a message goes that is no chunk.
pub(super) fn dead_message(sequence: u64) -> String {
    format!("slipdrive.dead.message.{sequence}")
}

/// States of all sweeps.
pub(super) const ALL_STATES: &str = "slipdrive.state.*";

pub(super) fn state(sweep: &str) -> String {
    format!("slipdrive.state.{sweep}")
}
