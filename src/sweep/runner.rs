//! Runs the missing rows of a sweep on the workers of a service.

use std::collections::HashMap;
use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use futures_util::stream::{self, BoxStream, StreamExt as _};
use tokio::time::{MissedTickBehavior, interval};

use super::outcome::Outcome;
use super::results::{Progress, Results};
use super::row_job::RowJob;
use super::warm::Guess;
use super::{Row, Sweep};
use crate::contract::Problem;
use crate::service::{Service, ServiceSettings};

/// How often results are brought to the disk and progress is shown.
pub(super) const SYNC_INTERVAL: Duration = Duration::from_secs(1);

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// All rows have results.
    Complete,
    /// It was stopped; what is missing can be run later.
    Stopped,
}

/// A row with its result.
#[derive(Debug, Clone, PartialEq)]
pub struct Finished {
    /// The row.
    pub row: Row,
    /// The key of the row whose plan it began with, if it did.
    pub warm_start_from: Option<String>,
    /// The answer in JSON.
    pub answer: Result<Vec<u8>, Problem>,
}

/// Runs what is missing until all rows of the shard have results, or `stop` comes; what runs then is given up.
///
/// # Errors
/// When results cannot be written. Those that were written stay, and the run can be continued.
pub async fn run(
    sweep: &Sweep,
    results: &mut Results,
    service: &Service,
    mut show: impl FnMut(&Progress),
    stop: impl Future<Output = ()>,
) -> io::Result<Ended> {
    let (units, in_flight, runner) = (pending(sweep, results)?, in_flight(service), sweep.runner());
    let streams = stream::iter(units).map(|unit| unit.rows(sweep, &runner, service));
    let mut rows = std::pin::pin!(streams.flatten_unordered(in_flight));
    let mut stop = std::pin::pin!(stop);
    let mut ticks = interval(SYNC_INTERVAL);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let ended = loop {
        tokio::select! {
            biased;
            () = &mut stop => break Ended::Stopped,
            _ = ticks.tick() => {
                results.sync()?;
                show(results.progress());
            }
            row = rows.next() => match row {
                Some(finished) => results.append(sweep, &finished?)?,
                None => break Ended::Complete,
            }
        }
    };
    results.sync()?;
    show(results.progress());
    Ok(ended)
}

/// Rows that run in order, each after the other.
struct Unit {
    rows: Vec<u64>,
    guesses: Guesses,
}

/// What rows begin with, by the number of the row.
pub(super) type Guesses = HashMap<u64, Guess>;

/// A service whose workers do nothing but rows: what waits is bounded by [`run`] itself.
pub fn service_settings(workers: NonZeroUsize) -> ServiceSettings {
    let queue_length = 4 * workers.saturating_add(2).get();
    // For ever, as far as sums of it can be formed.
    let queue_work = Duration::from_secs(u32::MAX.into());
    ServiceSettings { workers, queue_length, queue_work, ..ServiceSettings::default() }
}

/// As many as wait while all workers are busy: a worker that ends finds the next row ready.
fn in_flight(service: &Service) -> usize {
    2 * service.settings().workers.get() + 2
}

/// What has no results: the rows of a warm chunk together, all others each by itself.
fn pending<'a>(sweep: &'a Sweep, results: &Results) -> io::Result<impl Iterator<Item = Unit> + use<'a>> {
    let (shard, done, mut guesses) = (results.shard(), results.done().clone(), results.guesses()?);
    let chunks = shard.chunks(sweep.chunk_count());
    Ok(chunks.flat_map(move |chunk| {
        let rows: Vec<_> = sweep.chunk(chunk).filter(|&row| !done.contains(row)).collect();
        let size = if sweep.is_warm() { rows.len().max(1) } else { 1 };
        let mut guessed = |rows: &[u64]| rows.iter().filter_map(|row| guesses.remove_entry(row)).collect();
        rows.chunks(size).map(|rows| Unit { rows: rows.to_vec(), guesses: guessed(rows) }).collect::<Vec<_>>()
    }))
}

impl Unit {
    fn rows<'a>(
        self,
        sweep: &'a Sweep,
        runner: &'a RowRunner,
        service: &'a Service,
    ) -> BoxStream<'a, io::Result<Finished>> {
        // Judged before anything ran: only the file itself can have changed or gone.
        let read = |number| sweep.row(number).map_err(|problem| io::Error::other(problem.to_string()));
        runner.in_order(self.rows.into_iter().map(read), self.guesses, service)
    }
}

/// How the rows of a sweep run, wherever they come from.
#[derive(Clone)]
pub struct RowRunner {
    pub(super) job: Arc<dyn RowJob>,
    /// The hash of the sweep.
    pub(super) sweep: String,
    /// Whether a row may begin with the plan of the one before.
    pub(super) is_warm: bool,
}

impl RowRunner {
    /// Runs rows of one chunk and gives them as they end: in order where they begin with each other's plans, else in any
    /// order.
    pub fn rows<'a>(&'a self, rows: Vec<Row>, service: &'a Service) -> BoxStream<'a, Finished> {
        self.rows_with(Guesses::new(), rows, service)
    }

    /// The same, where rows before some of them are done.
    pub(super) fn rows_with<'a>(
        &'a self,
        guesses: Guesses,
        rows: Vec<Row>,
        service: &'a Service,
    ) -> BoxStream<'a, Finished> {
        if self.is_warm {
            let rows = rows.into_iter().map(Ok);
            return self.in_order(rows, guesses, service).filter_map(|finished| async { finished.ok() }).boxed();
        }
        stream::iter(rows).map(|row| self.run(row, None, service)).buffer_unordered(in_flight(service)).boxed()
    }

    /// Rows that run each after the other.
    fn in_order<'a>(
        &'a self,
        rows: impl Iterator<Item = io::Result<Row>> + Send + 'a,
        guesses: Guesses,
        service: &'a Service,
    ) -> BoxStream<'a, io::Result<Finished>> {
        stream::unfold((rows, guesses), move |(mut rows, mut guesses)| async move {
            let finished = match rows.next()? {
                Ok(row) => Ok(self.next(row, &mut guesses, service).await),
                Err(error) => Err(error),
            };
            Some((finished, (rows, guesses)))
        })
        .boxed()
    }

    /// Runs a row with what it begins with, and adds what the next one does.
    pub(super) async fn next(&self, row: Row, guesses: &mut Guesses, service: &Service) -> Finished {
        let before = guesses.remove(&row.number);
        let finished = self.run(row, before, service).await;
        let plan = finished.answer.as_ref().ok().filter(|_| self.is_warm);
        let number = finished.row.number;
        let guess = plan.and_then(|answer| Guess::of(super::key(&self.sweep, number), answer));
        guesses.extend(guess.map(|guess| (number + 1, guess)));
        finished
    }

    /// Runs one row; from the plan of the row before, where that leads to an answer, else as it is.
    async fn run(&self, row: Row, before: Option<Guess>, service: &Service) -> Finished {
        if let Some(before) = before
            && let Some(descent) = before.descent(&row.request)
            && let Ok(answer) = self.job.run(&descent, service).await
            && Outcome::of(&answer).status() == Some("converged")
        {
            return Finished { row, warm_start_from: Some(before.key), answer: Ok(answer) };
        }
        let answer = self.job.run(&row.request, service).await;
        Finished { row, warm_start_from: None, answer }
    }
}
