//! Medians and means of what was measured on maneuvers, and how far other maneuvers could have moved them.
//!
//! Solves of one maneuver with several seeds are alike, so that each maneuver counts once, with the mean over its seeds, and the
//! bootstrap draws whole maneuvers.

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;

/// Resamples: the ends of a 95 % interval then rest on 50 values each.
const RESAMPLES: usize = 2_000;
/// What lies in an interval.
const COVERAGE: f64 = 0.95;
/// The same figures give the same intervals.
const SEED: u64 = 0;

/// A figure with its interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Estimate {
    pub(crate) value: f64,
    /// Ends of the interval.
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// Median and mean of one value for each maneuver.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Summary {
    pub(crate) median: Estimate,
    pub(crate) mean: Estimate,
}

impl Summary {
    /// Of one value for each maneuver; none of no maneuvers.
    pub(crate) fn of(values: &[f64]) -> Option<Self> {
        (!values.is_empty()).then(|| Self { median: estimate(values, median), mean: estimate(values, mean) })
    }

    /// The same after a growing function of each figure, such as the exponential of logarithms.
    pub(crate) fn map(self, function: impl Fn(f64) -> f64) -> Self {
        let mapped = |Estimate { value, low, high }| Estimate {
            value: function(value),
            low: function(low),
            high: function(high),
        };
        Self { median: mapped(self.median), mean: mapped(self.mean) }
    }
}

fn estimate(values: &[f64], figure: impl Fn(&[f64]) -> f64) -> Estimate {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(SEED);
    let resampled = (0..RESAMPLES).map(|_| {
        let sample: Vec<f64> = values.iter().map(|_| values[rng.random_range(0..values.len())]).collect();
        figure(&sample)
    });
    let resampled = sorted(resampled);
    let outside = (1.0 - COVERAGE) / 2.0;
    Estimate { value: figure(values), low: quantile(&resampled, outside), high: quantile(&resampled, 1.0 - outside) }
}

/// The mean; NaN of none.
pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The median; NaN of none.
pub(crate) fn median(values: &[f64]) -> f64 {
    quantile(&sorted(values.iter().copied()), 0.5)
}

/// The values in growing order.
pub(crate) fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The value below which a share of the sorted values lies, on the line between its neighbours; NaN of none.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = share * last as f64;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and the last index")]
    let below = place.floor() as usize;
    let above = last.min(below + 1);
    sorted[below] + (place - below as f64) * (sorted[above] - sorted[below])
}
