//! Move limits of the variables.

use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

use nalgebra::DVector;

/// What a variable's share of the trust region is multiplied by where it turned back, and where it went on, half as much as the region
/// itself shrinks and grows.
const TURNED_BACK: f64 = FRAC_1_SQRT_2;
const WENT_ON: f64 = SQRT_2;

/// The share of the trust region that each variable may go through.
///
/// The steps of a linear model end in corners of the region, so that a variable whose optimum lies between its bounds goes to and fro.
/// It gets less of the region, and the others keep theirs. Source: the rule by which the method of moving asymptotes
/// (Svanberg 1987, 2002) moves these; its factors are 0.7 and 1.2.
pub(super) struct MoveLimits {
    /// One for each variable, in (0, 1].
    pub(super) shares: DVector<f64>,
    last_step: DVector<f64>,
}

impl MoveLimits {
    /// All of the region for each of `count` variables.
    pub(super) fn new(count: usize) -> Self {
        Self { shares: DVector::from_element(count, 1.0), last_step: DVector::zeros(count) }
    }

    /// After the change of the variables by an accepted step: less for those that turned back, more for those that went on.
    pub(super) fn adapt(&mut self, step: DVector<f64>) {
        for (share, turn) in self.shares.iter_mut().zip(step.component_mul(&self.last_step).iter()) {
            if *turn < 0.0 {
                *share *= TURNED_BACK;
            } else if *turn > 0.0 {
                *share = (WENT_ON * *share).min(1.0);
            }
        }
        self.last_step = step;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dvector;

    #[test]
    fn a_variable_that_turns_back_gets_less_and_one_that_goes_on_gets_it_back() {
        let mut moves = MoveLimits::new(3);
        moves.adapt(dvector![1.0, 1.0, 0.0]);
        assert_eq!(moves.shares, dvector![1.0, 1.0, 1.0]);
        moves.adapt(dvector![-1.0, 2.0, 1.0]);
        assert_eq!(moves.shares, dvector![TURNED_BACK, 1.0, 1.0]);
        moves.adapt(dvector![-1.0, 0.0, 1.0]);
        assert_eq!(moves.shares, dvector![1.0, 1.0, 1.0]);
    }

    #[test]
    fn a_share_comes_back_to_all_of_the_region() {
        let mut moves = MoveLimits::new(1);
        for turn in 0..40 {
            moves.adapt(dvector![if turn % 2 == 0 { 1.0 } else { -1.0 }]);
        }
        assert!(moves.shares[0] > 0.0);
        for _ in 0..40 {
            moves.adapt(dvector![-1.0]);
        }
        assert_eq!(moves.shares[0], 1.0);
    }
}
