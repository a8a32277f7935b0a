//! Sweeps: many jobs of one kind, described by a file, whose results outlast the process.
//!
//! - A [`Sweep`] is a file: a base request and axes, or lines that are merged over it. Its rows are numbered from 0 and
//!   made when they are needed ([`Sweep::row`]); rows that follow each other are a chunk. Its hash is that of all that
//!   decides the rows.
//! - No clock ends a job of a sweep, so a row's answer is a function of the file (and of the version of the solver).
//! - [`Results`] is a folder with one line per row that is done. It survives the process: what is written is never done
//!   again.
//! - [`run`] runs what is missing on the workers of a service.
//!
//! `nats`, with the feature of that name, takes the place of the last two: it brings chunks to the [`RowRunner`] of any
//! worker and keeps the lines that come.

mod axis;
mod check;
mod definition;
mod figure;
#[cfg(feature = "nats")]
pub mod nats;
mod outcome;
mod path;
mod results;
mod row_job;
mod rows;
mod runner;
mod shard;
mod table;
mod warm;
mod whole_file;

use std::io::{self, BufRead as _, BufReader, Read as _, SeekFrom};
use std::ops::Range;
use std::sync::Arc;

pub use check::{MOST_FAULTS, RowFaults};
use definition::{Definition, Followed};
pub use figure::{MapError, MapOf, map};
pub use results::{Header, Index, Progress, Results, ResultsError, Status, StoredRow, status};
use row_job::RowJob;
pub use rows::Row;
use rows::{Rows, Source};
pub use runner::{Ended, Finished, RowRunner, run, service_settings};
use sha2::{Digest, Sha256};
pub use shard::Shard;
pub use table::{EmptyColumn, TableError, write_csv};
pub use whole_file::write_whole;

use crate::contract::{BodyLimit, ErrorCode, Problem, hexadecimal};
use crate::jobs::Jobs;

/// Sweeps to begin with: names, and the files.
pub const EXAMPLES: &[(&str, &str)] = &[("final-time-map", include_str!("final_time_map.json"))];
/// Most rows of a sweep: what is kept of each in memory, a bit or a place, fits any machine.
pub const MOST_ROWS: u64 = 1_000_000_000;
/// Largest object of a file, bytes; lines that follow it are not held in memory.
const LARGEST_OBJECT: u64 = 64 << 20;
/// The version that all results of a sweep come from.
const SOLVER_VERSION: &str = env!("CARGO_PKG_VERSION");

/// Why there is no sweep in a file.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The file cannot be read.
    #[error(transparent)]
    Unreadable(#[from] io::Error),
    /// What it says breaks rules.
    #[error(transparent)]
    Refused(#[from] Problem),
}

/// A sweep that was read.
pub struct Sweep {
    definition: Definition,
    rows: Rows,
    job: Arc<dyn RowJob>,
    hash: String,
}

impl Sweep {
    /// Reads a file: one JSON object, or JSON Lines of which the first is this object.
    ///
    /// # Errors
    /// All violated rules of the object, or all lines that are no objects; a source that cannot be read. The requests are
    /// not looked at: that is [`Sweep::check`].
    pub fn read(source: impl io::Read + io::Seek + Send + 'static, jobs: &Jobs) -> Result<Self, SweepError> {
        let mut source: Box<dyn Source> = Box::new(source);
        let (object, lines_from) = first_object(&mut *source)?;
        if object.len() as u64 > LARGEST_OBJECT {
            let limit = BodyLimit::of(usize::try_from(LARGEST_OBJECT).unwrap_or(usize::MAX));
            return Err(Problem::body_too_large(limit).into());
        }
        let followed = if lines_from.is_some() { Followed::ByLines } else { Followed::ByNothing };
        let mut definition = Definition::read(&object, followed)?;
        let job = row_job::named(&definition.job, jobs).map_err(|names| {
            let text = format!("`job` is `{}`, must be one of {}", definition.job, names.join(", "));
            Problem::at_field(ErrorCode::InvalidValue, "#/job".to_owned(), text)
        })?;
        warm::check(&definition)?;
        let mut hash = Sha256::new();
        hash.update(crate::contract::json::write(&definition.canonical));
        let rows = match lines_from {
            Some(start) => Rows::Lines(rows::Lines::find(source, start, &definition, &mut hash)?),
            None => Rows::crossed(std::mem::take(&mut definition.axes))?,
        };
        Ok(Self { definition, rows, job, hash: hexadecimal(&hash.finalize()) })
    }

    /// The hash of all that decides the rows: SHA-256 in hexadecimal.
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// How many rows there are.
    pub fn row_count(&self) -> u64 {
        self.rows.count()
    }

    /// How many chunks there are; the last may have fewer rows.
    pub fn chunk_count(&self) -> u64 {
        self.row_count().div_ceil(self.definition.chunk_rows)
    }

    /// The rows of a chunk below the count.
    pub fn chunk(&self, number: u64) -> Range<u64> {
        let start = number * self.definition.chunk_rows;
        start..(start + self.definition.chunk_rows).min(self.row_count())
    }

    /// What names a row wherever its result goes.
    pub fn key(&self, row: u64) -> String {
        key(&self.hash, row)
    }

    /// How its rows run.
    pub fn runner(&self) -> RowRunner {
        RowRunner { job: Arc::clone(&self.job), sweep: self.hash.clone(), is_warm: self.is_warm() }
    }

    /// A row below the count.
    ///
    /// # Errors
    /// Where its line cannot be read any more.
    pub fn row(&self, number: u64) -> Result<Row, Problem> {
        self.rows.row(number, &self.definition.base)
    }

    /// What a folder with results says of this sweep.
    pub fn header(&self, shard: Shard) -> Header {
        let Definition { job, chunk_rows, columns, canonical, warm_start, .. } = &self.definition;
        Header {
            sweep: self.hash.clone(),
            solver_version: SOLVER_VERSION.to_owned(),
            job: job.clone(),
            rows: self.row_count(),
            chunk_rows: *chunk_rows,
            warm_start: *warm_start,
            shard,
            fields: self.rows.field_names(),
            columns: columns.clone(),
            definition: canonical.clone(),
        }
    }

    fn is_warm(&self) -> bool {
        self.definition.warm_start
    }

    fn job(&self) -> &dyn RowJob {
        &*self.job
    }
}

/// What names a row of a sweep.
fn key(sweep: &str, row: u64) -> String {
    format!("{sweep}-{row}")
}

/// The object that a file begins with, and where lines follow it, if any do.
fn first_object(source: &mut dyn Source) -> io::Result<(Vec<u8>, Option<u64>)> {
    let mut object = Vec::new();
    let length = {
        let mut reader = BufReader::new(&mut *source).take(LARGEST_OBJECT + 1);
        reader.read_until(b'\n', &mut object)? as u64
    };
    let is_whole = serde_json::from_slice::<serde::de::IgnoredAny>(&object).is_ok();
    source.seek(SeekFrom::Start(length))?;
    let mut rest = Vec::new();
    if is_whole && has_words(source)? {
        return Ok((object, Some(length)));
    }
    source.seek(SeekFrom::Start(length))?;
    source.take(LARGEST_OBJECT + 1).read_to_end(&mut rest)?;
    object.extend(rest);
    Ok((object, None))
}

/// Whether there is anything but white space ahead.
fn has_words(source: &mut dyn Source) -> io::Result<bool> {
    let mut reader = BufReader::new(source);
    loop {
        let bytes = reader.fill_buf()?;
        if bytes.is_empty() {
            return Ok(false);
        }
        if !bytes.trim_ascii().is_empty() {
            return Ok(true);
        }
        let length = bytes.len();
        reader.consume(length);
    }
}
