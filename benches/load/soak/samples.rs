//! What the server holds in quiet times.

use crate::process::{memory_bytes, open_files, threads};

/// What the process holds at one time.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    memory_bytes: u64,
    open_files: usize,
    threads: usize,
}

impl Sample {
    pub fn of(process: u32) -> Self {
        Self { memory_bytes: memory_bytes(process), open_files: open_files(process), threads: threads(process) }
    }
}

/// A quarter of all samples, in the order of time.
pub fn quarters(samples: &[Sample]) -> [&[Sample]; 4] {
    std::array::from_fn(|quarter| &samples[samples.len() * quarter / 4..samples.len() * (quarter + 1) / 4])
}

/// Zero when there are none.
pub fn median_memory_bytes(samples: &[Sample]) -> u64 {
    let mut memory: Vec<_> = samples.iter().map(|sample| sample.memory_bytes).collect();
    memory.sort_unstable();
    memory.get(memory.len() / 2).copied().unwrap_or_default()
}

pub fn most_open_files(samples: &[Sample]) -> usize {
    samples.iter().map(|sample| sample.open_files).max().unwrap_or_default()
}

pub fn most_threads(samples: &[Sample]) -> usize {
    samples.iter().map(|sample| sample.threads).max().unwrap_or_default()
}
