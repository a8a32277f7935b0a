//! Random numbers by counting: each number follows from the seed, the sample and the parameter alone, so that neither the order of
//! the samples nor the other parameters matter.

use rand::{Rng as _, SeedableRng as _};
use rand_xoshiro::SplitMix64;

use crate::motion::ChangedParameter;

/// What is known of an uncertain parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distribution {
    /// Any value between these as likely as any other.
    Uniform {
        /// The smallest.
        low: f64,
        /// The largest.
        high: f64,
    },
    /// Normal.
    Normal {
        /// Its mean.
        mean: f64,
        /// Its standard deviation.
        standard_deviation: f64,
    },
}

impl Distribution {
    /// The value in this sample.
    pub fn draw(self, seed: u64, sample: usize, parameter: ChangedParameter) -> f64 {
        let uniform = |which| share(seed, [sample as u64, 2 * parameter as u64 + which]);
        match self {
            Self::Uniform { low, high } => low + uniform(0) * (high - low),
            Self::Normal { mean, standard_deviation } => {
                // Box and Muller.
                let radius = (-2.0 * uniform(0).ln()).sqrt();
                mean + standard_deviation * radius * (std::f64::consts::TAU * uniform(1)).cos()
            }
        }
    }

    /// The largest value that is to be expected: beyond it are 3 of 100,000.
    pub fn largest(self) -> f64 {
        match self {
            Self::Uniform { high, .. } => high,
            Self::Normal { mean, standard_deviation } => mean + 4.0 * standard_deviation,
        }
    }
}

/// Uniform in (0, 1), of as many bits as a number has.
pub(super) fn share(seed: u64, counters: [u64; 2]) -> f64 {
    let bits = counters.into_iter().fold(mixed(seed), |state, counter| mixed(state ^ mixed(counter)));
    ((bits >> (u64::BITS - f64::MANTISSA_DIGITS)) as f64 + 0.5) * (1.0 / (1_u64 << f64::MANTISSA_DIGITS) as f64)
}

/// A bijection that spreads each bit over all others.
fn mixed(state: u64) -> u64 {
    SplitMix64::seed_from_u64(state).next_u64()
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: usize = 20_000;

    #[test]
    fn numbers_stay_from_version_to_version() {
        // The first output of SplitMix64 from 0 (Vigna's reference program) is the mix of 0.
        assert_eq!(mixed(0), 0xe220_a839_7b1d_cdaf);
        assert_eq!(share(7, [3, 5]), 0.469_807_875_987_715_84);
    }

    /// Mean and variance of the draws.
    fn moments(distribution: Distribution) -> (f64, f64) {
        let draws: Vec<f64> = (0..COUNT).map(|index| distribution.draw(7, index, ChangedParameter::Mass)).collect();
        let mean = draws.iter().sum::<f64>() / COUNT as f64;
        (mean, draws.iter().map(|draw| (draw - mean).powi(2)).sum::<f64>() / COUNT as f64)
    }

    #[test]
    fn draws_have_the_moments_of_their_distribution() {
        let (mean, variance) = moments(Distribution::Uniform { low: -1.0, high: 3.0 });
        // Four standard errors: of the mean sqrt(4 / 3 / count), of the variance below 1.5 / sqrt(count) of its size.
        assert!((mean - 1.0).abs() < 0.033 && (variance - 4.0 / 3.0).abs() < 0.05, "{mean} {variance}");
        let (mean, variance) = moments(Distribution::Normal { mean: -1.0, standard_deviation: 2.0 });
        assert!((mean + 1.0).abs() < 0.057 && (variance - 4.0).abs() < 0.17, "{mean} {variance}");
    }

    #[test]
    fn samples_and_parameters_are_uncorrelated() {
        let of = |index: usize, parameter: ChangedParameter| share(3, [index as u64, 2 * parameter as u64]) - 0.5;
        let product = |other: &dyn Fn(usize) -> f64| {
            let sum: f64 = (0..COUNT).map(|index| of(index, ChangedParameter::Friction) * other(index)).sum();
            12.0 * sum / COUNT as f64
        };
        let correlations = [
            product(&|index| of(index, ChangedParameter::Mass)),
            product(&|index| of(index + 1, ChangedParameter::Friction)),
        ];
        // Four standard errors, 1 / sqrt(count) each.
        assert!(correlations.iter().all(|correlation| correlation.abs() < 0.029), "{correlations:?}");
    }
}
