//! The faults of a configuration, collected so that all of them are reported at once.

use std::fmt;

/// All faults of a configuration.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Faults(pub(super) Vec<String>);

impl Faults {
    pub(crate) fn add(&mut self, fault: String) {
        self.0.push(fault);
    }

    /// The value, where nothing is wrong.
    ///
    /// # Errors
    /// All faults.
    pub(super) fn into_result<T>(self, value: Option<T>) -> Result<T, Self> {
        match value {
            Some(value) if self.0.is_empty() => Ok(value),
            _ => Err(self),
        }
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(faults) = self;
        write!(formatter, "the configuration cannot be used")?;
        faults.iter().try_for_each(|fault| write!(formatter, "\n  {fault}"))
    }
}
