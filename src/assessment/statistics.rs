//! What samples say: an interval of a rate, quantiles, and shares of variance.

/// The normal quantile of an interval of 95 %.
const QUANTILE_OF_95_PERCENT: f64 = 1.959_963_984_540_054;
/// Shares of variance from fewer samples that end are noise.
pub const FEWEST_FOR_SHARES: usize = 64;
/// More bins resolve no more of a smooth function, and each has fewer samples.
const MOST_BINS: usize = 64;

/// Wilson's interval of 95 % for a rate, (low, high).
pub(super) fn wilson(successes: usize, count: usize) -> (f64, f64) {
    let (count, z) = (count as f64, QUANTILE_OF_95_PERCENT);
    let rate = successes as f64 / count;
    let middle = rate + z * z / (2.0 * count);
    let half = z * (rate * (1.0 - rate) / count + z * z / (2.0 * count).powi(2)).sqrt();
    let scale = 1.0 + z * z / count;
    // Without rounding where the closed form ends at 0 or 1.
    let low = if successes == 0 { 0.0 } else { (middle - half) / scale };
    (low, if rate == 1.0 { 1.0 } else { (middle + half) / scale })
}

/// A quantile of ascending values, linear between them; NaN of none.
pub(super) fn quantile(ascending: &[f64], share: f64) -> f64 {
    let Some(last) = ascending.len().checked_sub(1) else { return f64::NAN };
    let place = share * last as f64;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index")]
    let below = place as usize;
    let (low, high) = (ascending[below], ascending[(below + 1).min(last)]);
    // Where both are infinite their difference is not a number.
    if place > below as f64 && low < high { low + (place - below as f64) * (high - low) } else { low }
}

/// The share of the variance of `values` that is due to `causes` alone, a first-order Sobol index, from the means of bins of about
/// as many samples each; NaN of too few samples or of values that do not vary.
///
/// Means of noise vary too: what the variance within the bins adds to that between them is subtracted.
pub(super) fn share_of_variance(causes: &[f64], values: &[f64]) -> f64 {
    let count = values.len();
    if count < FEWEST_FOR_SHARES {
        return f64::NAN;
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| causes[a].total_cmp(&causes[b]));
    let bin_count = count.isqrt().min(MOST_BINS);
    let mean = values.iter().sum::<f64>() / count as f64;
    let total: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    let between: f64 = (0..bin_count)
        .map(|bin| {
            let bin = &order[bin * count / bin_count..(bin + 1) * count / bin_count];
            let shift = bin.iter().map(|&index| values[index] - mean).sum::<f64>() / bin.len() as f64;
            bin.len() as f64 * shift * shift
        })
        .sum();
    let of_noise = (total - between) * (bin_count - 1) as f64 / (count - bin_count) as f64;
    // Values that differ in their last digits alone do not vary.
    let rounding = count as f64 * (1e-12 * mean).powi(2);
    if total > rounding { ((between - of_noise) / total).clamp(0.0, 1.0) } else { f64::NAN }
}

#[cfg(test)]
mod tests {
    use super::super::draw::share;
    use super::*;

    #[test]
    fn wilson_interval_is_that_of_the_closed_form() {
        // Both ends solve (rate - p)^2 = z^2 p (1 - p) / count.
        let (low, high) = wilson(37, 100);
        for end in [low, high] {
            let square = 1.96_f64.powi(2) * end * (1.0 - end) / 100.0;
            // 1.96 in place of the quantile.
            assert!(((0.37 - end).powi(2) - square).abs() < 1e-6, "{end}");
        }
        assert!((wilson(0, 50).0, wilson(50, 50).1) == (0.0, 1.0) && wilson(0, 50).1 < 0.08);
    }

    #[test]
    fn wilson_interval_covers_rates_in_95_percent() {
        // The coverage of a single rate jumps by counts between 93.7 and 96.1 %, so each repeat has a rate of its own.
        for seed in 0..5 {
            let covers = |repeat: u64| {
                let rate = 0.3 + 0.4 * share(seed, [repeat, 100]);
                let is_success = |sample: &u64| share(seed, [repeat, *sample]) < rate;
                let (low, high) = wilson((0..100).filter(is_success).count(), 100);
                (low..=high).contains(&rate)
            };
            let covered = (0..2_000).filter(|&repeat| covers(repeat)).count() as f64 / 2_000.0;
            assert!((0.94..=0.965).contains(&covered), "{covered}");
        }
    }

    #[test]
    fn quantiles_are_linear_between_values() {
        let values = [0.0, 1.0, 3.0, f64::INFINITY, f64::INFINITY];
        let of = |share| quantile(&values, share);
        assert_eq!([of(0.0), of(0.25), of(0.375), of(0.6), of(1.0)], [0.0, 1.0, 2.0, f64::INFINITY, f64::INFINITY]);
        assert!(quantile(&[], 0.5).is_nan());
    }

    /// Ishigami and Homma (1990), with a = 7 and b = 0.1.
    fn ishigami([first, second, third]: [f64; 3]) -> f64 {
        first.sin() + 7.0 * second.sin().powi(2) + 0.1 * third.powi(4) * first.sin()
    }

    #[test]
    fn shares_are_those_of_the_ishigami_function() {
        use std::f64::consts::{PI, TAU};
        let (a, b) = (7.0, 0.1);
        let variance = a * a / 8.0 + b * PI.powi(4) / 5.0 + b * b * PI.powi(8) / 18.0 + 0.5;
        let known = [0.5 * (1.0 + b * PI.powi(4) / 5.0).powi(2) / variance, a * a / 8.0 / variance, 0.0];
        for seed in 0..5 {
            let causes: [Vec<f64>; 3] = std::array::from_fn(|which| {
                (0..3_000).map(|sample| TAU * share(seed, [sample, which as u64]) - PI).collect()
            });
            let values: Vec<f64> =
                (0..3_000).map(|sample| ishigami([causes[0][sample], causes[1][sample], causes[2][sample]])).collect();
            let found = causes.each_ref().map(|causes| share_of_variance(causes, &values));
            for (found, known) in found.into_iter().zip(known) {
                assert!((found - known).abs() < 0.05, "{found}, must be {known}, seed {seed}");
            }
        }
    }

    #[test]
    fn shares_are_those_of_the_means_without_their_noise() {
        // 8 bins of 8 samples each: means 0 to 7, about which the values scatter by 3 either way.
        let causes: Vec<f64> = (0..64).map(f64::from).collect();
        let values: Vec<f64> =
            (0..64).map(|sample| f64::from(sample / 8) + if sample % 2 == 0 { 3.0 } else { -3.0 }).collect();
        // Of the means of 8 numbers that scatter so freely 7 parts of 56 would come by chance.
        let (between, within) = (64.0 * 5.25, 64.0 * 9.0);
        let share = (between - within * 7.0 / 56.0) / (between + within);
        assert!((share_of_variance(&causes, &values) - share).abs() < 1e-14);
    }

    #[test]
    fn there_are_no_shares_of_few_or_equal_values() {
        assert!(share_of_variance(&[0.0; 63], &[0.0; 63]).is_nan());
        assert!(share_of_variance(&[0.0; 100], &[0.1; 100]).is_nan());
    }
}
