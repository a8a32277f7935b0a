//! How far a running job is, on a terminal.

use std::io::{self, IsTerminal as _};
use std::pin::pin;
use std::time::Duration;

use futures_util::StreamExt as _;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use slipdrive::jobs::{Kind, ProgressLine};
use slipdrive::service::{Event, Running};

/// Waits for the end of a job; on a terminal a line shows how far it is.
///
/// # Errors
/// When the job has no answer.
pub(super) fn watched<K: Kind, T: Send + 'static>(running: Running<T, K::Progress>) -> anyhow::Result<T> {
    if !K::REPORTS_PROGRESS || !io::stderr().is_terminal() {
        return Ok(running.blocking_outcome()?);
    }
    let line = ProgressBar::with_draw_target(Some(1), ProgressDrawTarget::stderr());
    // What is said must fit beside it on 80 columns: a number that is cut off is another one.
    line.set_style(ProgressStyle::with_template("{spinner} {elapsed:>4} [{bar:12}] {wide_msg}")?.progress_chars("=> "));
    line.enable_steady_tick(Duration::from_millis(120));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build()?;
    let outcome = runtime.block_on(async {
        let mut events = pin!(running.events());
        while let Some(event) = events.next().await {
            match event {
                Event::Queued(_) => {}
                Event::Progress(progress) => show(&line, K::progress_line(&progress)),
                Event::Ended(outcome) => return Some(outcome),
            }
        }
        None
    });
    line.finish_and_clear();
    Ok(outcome.ok_or_else(|| anyhow::anyhow!("the job ended without an answer"))??)
}

fn show(line: &ProgressBar, progress: Option<ProgressLine>) {
    if let Some(ProgressLine { begun, of, words }) = progress {
        line.set_length(of as u64);
        line.set_position(begun as u64);
        line.set_message(words);
    }
}
