//! A share of the chunks of a sweep.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// The chunks whose number leaves `index` when it is divided by `of`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    /// Which share, from 0.
    pub index: u64,
    /// How many shares there are.
    pub of: u64,
}

impl Shard {
    /// All chunks.
    pub const WHOLE: Self = Self { index: 0, of: 1 };

    /// Its chunks of so many.
    pub fn chunks(self, count: u64) -> impl Iterator<Item = u64> {
        let step = usize::try_from(self.of).unwrap_or(usize::MAX);
        (self.index..count).step_by(step)
    }

    /// Whether a chunk belongs to it.
    pub(super) fn has(self, chunk: u64) -> bool {
        chunk % self.of == self.index
    }

    /// Whether another one has chunks of this one, of so many.
    pub(super) fn overlaps(self, other: Self, count: u64) -> bool {
        // After as many steps as the other has shares, remainders repeat.
        let differing = usize::try_from(other.of).unwrap_or(usize::MAX);
        self.chunks(count).take(differing).any(|chunk| other.has(chunk))
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}/{}", self.index, self.of)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
        match numbers {
            Some((index, of)) if index < of => Ok(Self { index, of }),
            _ => Err(format!("`{text}` must be two numbers as in 0/4, the first below the second")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_share_all_chunks() {
        let mut chunks: Vec<_> = (0..3).flat_map(|index| Shard { index, of: 3 }.chunks(8)).collect();
        assert_eq!(Shard { index: 2, of: 3 }.chunks(8).collect::<Vec<_>>(), [2, 5]);
        chunks.sort_unstable();
        assert_eq!(chunks, (0..8).collect::<Vec<_>>());
        assert_eq!(Shard::WHOLE.chunks(2).collect::<Vec<_>>(), [0, 1]);
    }

    #[test]
    fn shards_overlap_where_they_have_a_chunk_together() {
        let overlap = |one: (u64, u64), other: (u64, u64), count| {
            let [one, other] = [one, other].map(|(index, of)| Shard { index, of });
            one.overlaps(other, count)
        };
        assert!(overlap((0, 1), (0, 1), 1) && overlap((0, 2), (2, 4), 3) && overlap((1, 2), (0, 3), 4));
        assert!(!overlap((0, 2), (1, 2), 9) && !overlap((0, 2), (1, 4), 9) && !overlap((1, 2), (0, 3), 3));
    }

    #[test]
    fn shards_are_read_as_they_are_written() {
        assert_eq!("1/4".parse(), Ok(Shard { index: 1, of: 4 }));
        assert_eq!(Shard { index: 1, of: 4 }.to_string(), "1/4");
        for text in ["", "1", "4/4", "0/0", "-1/4", "a/b"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
