//! The friction laws of rollouts.

/// The friction law of a rollout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrictionLaw {
    /// Coulomb's.
    Exact,
    /// Coulomb's with its corners rounded by a slip smoothing, m/s, > 0.
    Smoothed(f64),
    /// Both wheels stick whatever it takes; a front support with friction keeps Coulomb's law, with its corners rounded by a slip
    /// smoothing, m/s, or 0.
    Held(f64),
}

impl FrictionLaw {
    /// The slip smoothing, m/s; 0 without.
    pub(super) fn slip_smoothing(self) -> f64 {
        match self {
            Self::Smoothed(slip_smoothing) | Self::Held(slip_smoothing) => slip_smoothing,
            Self::Exact => 0.0,
        }
    }
}
