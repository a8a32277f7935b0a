//! A set of rows, a bit each.

/// Some of the rows of a sweep.
#[derive(Debug, Clone)]
pub(in crate::sweep) struct RowSet {
    words: Vec<u64>,
    rows: u64,
}

impl RowSet {
    /// None of so many.
    pub(in crate::sweep) fn of(rows: u64) -> Self {
        Self { words: vec![0; usize::try_from(rows.div_ceil(64)).unwrap_or_default()], rows }
    }

    /// Adds a row; whether it was not there before.
    pub(in crate::sweep) fn insert(&mut self, row: u64) -> bool {
        let (word, bit) = place(row);
        match self.words.get_mut(word) {
            Some(word) if *word & bit == 0 => {
                *word |= bit;
                true
            }
            Some(_) | None => false,
        }
    }

    /// Whether a row is there.
    pub(in crate::sweep) fn contains(&self, row: u64) -> bool {
        let (word, bit) = place(row);
        row < self.rows && self.words.get(word).is_some_and(|word| word & bit != 0)
    }
}

fn place(row: u64) -> (usize, u64) {
    (usize::try_from(row / 64).unwrap_or(usize::MAX), 1 << (row % 64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_there_once() {
        let mut set = RowSet::of(65);
        assert!(set.insert(0) && set.insert(64) && !set.insert(64));
        assert!(set.contains(0) && set.contains(64) && !set.contains(1) && !set.contains(1 << 40));
    }
}
