//! The requirements of the bench, and whether they were met.

/// Whether all requirements were met so far.
#[derive(Debug, Default)]
pub struct Verdict {
    has_missed: bool,
}

impl Verdict {
    /// Prints one requirement with what was found.
    pub fn require(&mut self, requirement: &str, is_met: bool, found: &str) {
        println!("  {} {requirement}: {found}", if is_met { "met   " } else { "MISSED" });
        self.has_missed |= !is_met;
    }

    /// Adds the verdict of another run.
    pub fn join(&mut self, other: &Self) {
        self.has_missed |= other.has_missed;
    }

    pub fn is_met(&self) -> bool {
        !self.has_missed
    }
}
