//! A chunk on a worker: its rows that have no results, and their way into the stream.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;

use futures_util::future::ready;
use futures_util::stream::{self, BoxStream, LocalBoxStream, StreamExt as _};
use tokio::sync::watch;
use tokio::time::{Instant, sleep, timeout};

use super::{LAST_RESULTS, LAST_WORD, Worker};
use crate::sweep::nats::RETRY_PAUSE;
use crate::sweep::nats::broker::NatsError;
use crate::sweep::nats::cancel;
use crate::sweep::nats::chunk::Chunk;
use crate::sweep::nats::marks::{self, FIRST_SUSPECT_DELIVERY, MOST_BEGINNINGS, Mark};
use crate::sweep::nats::result::{self, RowResult};
use crate::sweep::row_job;
use crate::sweep::runner::Guesses;
use crate::sweep::warm::Guess;
use crate::sweep::{Finished, Row, RowRunner};

/// Results on their way at once; beyond, rows wait, so that a full stream holds no more than this back.
const RESULTS_AHEAD: usize = 8;
/// Rows that are looked up at once.
const LOOKUPS_AHEAD: usize = 16;

/// How a chunk ended on a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// All its rows have results.
    Complete,
    /// Others are to run the rest of it.
    GivenBack,
    /// Nobody wants it any more.
    Cancelled,
}

/// What is left of a chunk.
struct Rest {
    rows: Vec<Row>,
    guesses: Guesses,
}

impl Worker {
    /// Runs what has no results, and publishes each row as it ends.
    pub(super) async fn run_chunk(&self, chunk: Chunk, delivery: i64, stopped: &watch::Receiver<bool>) -> Outcome {
        let (sweep, number) = (chunk.sweep.clone(), chunk.number);
        let Ok(job) = row_job::named(&chunk.job, &self.jobs) else {
            // The version is the same, so the kinds are: this is no chunk that was published by a sweep.
            tracing::error!(chunk.number = number, job = chunk.job, "there is no such kind of job");
            return Outcome::Cancelled;
        };
        let runner = RowRunner { job, sweep: sweep.clone(), is_warm: chunk.warm_start };
        let rest = match self.rest_of(chunk).await {
            Ok(Some(rest)) => rest,
            Ok(None) => return Outcome::Cancelled,
            Err(error) => {
                tracing::warn!(error = %error, chunk.number = number, "a chunk is given back");
                sleep(RETRY_PAUSE).await;
                return Outcome::GivenBack;
            }
        };
        let (missing, mark) = (Cell::new(rest.rows.len()), RefCell::new(None));
        let results = if delivery < FIRST_SUSPECT_DELIVERY {
            self.results(&runner, rest)
        } else {
            tracing::warn!(sweep.hash = sweep, chunk.number = number, chunk.delivery = delivery, "a chunk is suspect");
            self.results_of_suspects(&runner, rest, &mark)
        };
        let until = stop_of(stopped.clone());
        let publish = |result: RowResult| {
            let missing = &missing;
            let sweep = &sweep;
            async move {
                if self.publish(sweep, &result, stopped).await {
                    missing.set(missing.get() - 1);
                }
            }
        };
        results.take_until(until).for_each_concurrent(RESULTS_AHEAD, publish).await;
        if let Some(mark) = mark.take() {
            // A server that is away must not hold up the end.
            let _ = timeout(LAST_WORD, Mark::take_back(mark, &self.broker)).await;
        }
        if missing.get() == 0 { Outcome::Complete } else { Outcome::GivenBack }
    }

    /// The rows without results; none where the sweep is cancelled.
    async fn rest_of(&self, chunk: Chunk) -> Result<Option<Rest>, NatsError> {
        if cancel::is_cancelled(&chunk.sweep, &self.broker).await? {
            return Ok(None);
        }
        let (sweep, broker) = (&chunk.sweep.clone(), &self.broker);
        let looked_up = stream::iter(chunk.row_numbers().collect::<Vec<_>>())
            .map(|row| async move { result::stored(sweep, row, broker).await.map(|stored| (row, stored)) })
            .buffered(LOOKUPS_AHEAD);
        let (mut missing, mut guesses, mut before) = (BTreeMap::new(), Guesses::new(), None);
        let mut looked_up = std::pin::pin!(looked_up);
        while let Some(found) = looked_up.next().await {
            let (row, stored) = found?;
            missing.insert(row, stored.is_none());
            match stored {
                None => guesses.extend(before.take().map(|guess| (row, guess))),
                Some(stored) => {
                    self.metrics.row("skipped");
                    let stored = stored.filter(|_| chunk.warm_start);
                    before = stored.and_then(|stored| Guess::of_value(stored.key, &stored.answer?));
                }
            }
        }
        Ok(Some(Rest { rows: chunk.into_rows(&missing), guesses }))
    }

    fn results<'a>(&'a self, runner: &'a RowRunner, rest: Rest) -> LocalBoxStream<'a, RowResult> {
        let finished: BoxStream<'a, Finished> = runner.rows_with(rest.guesses, rest.rows, &self.service);
        finished.filter_map(move |finished| ready(self.result_of(runner, &finished))).boxed_local()
    }

    fn result_of(&self, runner: &RowRunner, finished: &Finished) -> Option<RowResult> {
        RowResult::of(&runner.sweep, finished, self.broker.most_bytes())
    }

    /// One row after the other, each marked before it runs.
    fn results_of_suspects<'a>(
        &'a self,
        runner: &'a RowRunner,
        rest: Rest,
        mark: &'a RefCell<Option<Mark>>,
    ) -> LocalBoxStream<'a, RowResult> {
        stream::unfold((rest.rows.into_iter(), rest.guesses), move |(mut rows, mut guesses)| async move {
            let row = rows.next()?;
            let _alone = self.suspect.lock().await;
            match self.marked(&runner.sweep, &row).await {
                Some(set) => {
                    mark.replace(Some(set));
                    let finished = runner.next(row, &mut guesses, &self.service).await;
                    let result = self.result_of(runner, &finished);
                    if result.is_some() {
                        mark.replace(None);
                    }
                    Some((result, (rows, guesses)))
                }
                None => Some((Some(self.lost(&runner.sweep, &row).await), (rows, guesses))),
            }
        })
        .filter_map(ready)
        .boxed_local()
    }

    /// Marks a row, however long that takes; none where it was begun too often.
    async fn marked(&self, sweep: &str, row: &Row) -> Option<Mark> {
        loop {
            match Mark::set(sweep, row.number, &self.broker).await {
                Ok(Some(mark)) => {
                    tracing::warn!(
                        sweep.hash = sweep,
                        row = row.number,
                        beginnings = mark.beginnings,
                        "a row is marked"
                    );
                    return Some(mark);
                }
                Ok(None) => return None,
                Err(error) => tracing::warn!(error = %error, "a row waits for its mark"),
            }
            sleep(RETRY_PAUSE).await;
        }
    }

    /// Gives a row up, and keeps its request.
    async fn lost(&self, sweep: &str, row: &Row) -> RowResult {
        tracing::error!(sweep.hash = sweep, row = row.number, "a row is given up: its workers did not survive it");
        if let Err(error) = marks::bury(sweep, row, &self.broker).await {
            tracing::error!(error = %error, row = row.number, "a row has no dead letter");
        }
        let detail = format!("its workers were lost {MOST_BEGINNINGS} times while they ran it");
        RowResult::lost(sweep, row, &detail)
    }

    /// Publishes a row, however long that takes, but for a worker that ends; whether it is there.
    async fn publish(&self, sweep: &str, result: &RowResult, stopped: &watch::Receiver<bool>) -> bool {
        let mut ends = None;
        loop {
            match result.publish(sweep, &self.broker).await {
                Ok(()) => {
                    self.metrics.row(result.outcome);
                    return true;
                }
                Err(fault) => tracing::warn!(error = fault, row = result.row, "a result waits to be published"),
            }
            self.metrics.publish_retries.inc();
            let now = Instant::now();
            if *stopped.borrow() && now >= *ends.get_or_insert(now + LAST_RESULTS) {
                return false;
            }
            sleep(RETRY_PAUSE).await;
        }
    }
}

async fn stop_of(mut stopped: watch::Receiver<bool>) {
    if stopped.wait_for(|stopped| *stopped).await.is_err() {
        std::future::pending::<()>().await;
    }
}
