//! What an attack found out.

use std::time::Duration;

use super::attacker::Life;

/// What an attack says about itself.
#[derive(Debug, Default)]
pub struct Found {
    /// Its figures in words.
    text: String,
    /// Which of its own requirements were missed.
    pub faults: Vec<String>,
    lives: Vec<Duration>,
    open_at_the_end: usize,
}

impl Found {
    pub fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), ..Self::default() }
    }

    /// With its figures.
    pub fn with_text(self, text: String) -> Self {
        Self { text, ..self }
    }

    /// Adds the life of a connection.
    pub fn add(&mut self, life: Life) {
        self.lives.push(life.lasted);
        self.open_at_the_end += usize::from(life.is_open);
    }

    /// Adds a requirement of the attack's own.
    pub fn require(&mut self, is_met: bool, fault: impl Into<String>) {
        if !is_met {
            self.faults.push(fault.into());
        }
    }
}

impl std::fmt::Display for Found {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.text)?;
        let mut lives: Vec<_> = self.lives.iter().map(Duration::as_secs_f64).collect();
        lives.sort_by(f64::total_cmp);
        if let (Some(shortest), Some(longest)) = (lives.first(), lives.last()) {
            let (median, count, open) = (lives[lives.len() / 2], lives.len(), self.open_at_the_end);
            let separator = if self.text.is_empty() { "" } else { ", " };
            write!(
                formatter,
                "{separator}{count} connections lived {shortest:.1} / {median:.1} / {longest:.1} s (shortest, median, \
                 longest), {open} still open"
            )?;
        }
        Ok(())
    }
}
