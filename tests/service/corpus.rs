//! The requests in `tests/data/corpus`, given to all readers: examples, values at their bounds, malformed ones, and what
//! the fuzz target has found. Those whose names begin with `accepted` are requests, the others are refused.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::jobs::{Jobs, Kind, Limits, Visitor};
use slipdrive::metrics::Metrics;

use crate::support::readers::{KINDS, is_accepted};
use crate::support::real_solver;

const SEED: u64 = 17;
/// Large enough for one file of each case, small enough to be read.
const MAX_FILES: usize = 110;
const MAX_BYTES: usize = 200_000;

fn corpus() -> Vec<(PathBuf, Vec<u8>)> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/corpus");
    let mut paths: Vec<_> = fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

#[test]
fn corpus_is_accepted_and_refused_as_its_names_say() {
    let corpus = corpus();
    let bytes: usize = corpus.iter().map(|(_, bytes)| bytes.len()).sum();
    assert!(corpus.len() <= MAX_FILES && bytes <= MAX_BYTES, "{} files, {bytes} bytes", corpus.len());
    for (path, bytes) in &corpus {
        let name = path.file_name().unwrap().to_string_lossy();
        assert_eq!(is_accepted(bytes), name.starts_with("accepted"), "{name}");
    }
    let is_named = |word: &str| corpus.iter().filter(|(path, _)| path.to_string_lossy().contains(word)).count();
    assert!(is_named("accepted-") > 10 && is_named("refused-") > 10, "both outcomes have their cases");
}

#[test]
fn mutations_of_the_corpus_panic_no_reader() {
    let corpus = corpus();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED);
    for round in 0..20_000 {
        let mut bytes = corpus[random.random_range(0..corpus.len())].1.clone();
        for _ in 0..random.random_range(1..4) {
            let position = random.random_range(0..=bytes.len());
            match random.random_range(0..4) {
                0 => bytes.insert(position, random.random()),
                1 => bytes.truncate(position),
                2 if position < bytes.len() => bytes[position] = random.random(),
                // A part of another.
                _ => {
                    let other = &corpus[random.random_range(0..corpus.len())].1;
                    let end = random.random_range(0..=other.len());
                    let begin = random.random_range(0..=end);
                    bytes.splice(position..position, other[begin..end].iter().copied());
                }
            }
        }
        let outcome = std::panic::catch_unwind(|| is_accepted(&bytes));
        assert!(outcome.is_ok(), "seed {SEED}, round {round}: {}", String::from_utf8_lossy(&bytes));
    }
}

#[test]
fn readers_of_all_kinds_are_tried() {
    struct Names(BTreeSet<&'static str>);
    impl Visitor for Names {
        fn visit<K: Kind>(&mut self, _: &std::sync::Arc<K>) {
            self.0.insert(K::NAME);
        }
    }
    let mut names = Names(BTreeSet::new());
    Jobs::new(Limits::default(), real_solver(), &Metrics::new()).each(&mut names);
    assert_eq!(names.0, BTreeSet::from(KINDS));
}
