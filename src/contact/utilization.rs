//! How much of their grip two sticking wheels use.
//!
//! While both wheels stick only the sum Y of their lateral forces is known. Their utilisation is the least rho for which some
//! split of Y keeps both within that share of their friction:
//!
//! ```text
//! |F_i| <= rho mu N_i,    |Y| <= sqrt((rho mu N_L)^2 - F_L^2) + sqrt((rho mu N_R)^2 - F_R^2)
//! ```
//!
//! The capacity on the right grows with rho without bound, so there is exactly one; its derivatives follow from the equation
//! that binds (envelope theorem).

/// Friction of two sticking wheels in one step: impulses, or forces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelFriction {
    /// Longitudinal, of the left and the right wheel.
    pub longitudinal: [f64; 2],
    /// Lateral, of both together.
    pub lateral: f64,
    /// Friction radii: friction coefficient times normal, > 0.
    pub radius: [f64; 2],
}

/// Derivatives of the utilisation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UtilizationGradient {
    /// By the longitudinal friction of each wheel.
    pub by_longitudinal: [f64; 2],
    /// By the lateral friction.
    pub by_lateral: f64,
    /// By the radius of each wheel.
    pub by_radius: [f64; 2],
}

impl WheelFriction {
    /// The least share of the friction that holds both wheels; NaN if any friction is.
    #[inline]
    pub fn utilization(&self) -> f64 {
        let [left, right] = self.lengthwise_shares();
        let (least, lateral) = (left.max(right), self.lateral.abs());
        if (left + right + lateral).is_nan() {
            return f64::NAN;
        }
        if self.capacity(least) >= lateral {
            return least;
        }
        // At d above the least share each root is at least d r_i. Of equal wheels the quadratic may leave rounding alone, even 0 / 0.
        let most = least + lateral / (self.radius[0] + self.radius[1]);
        self.binding_share().min(most).max(least)
    }

    /// Derivatives of [`Self::utilization`]; at rest they are zero.
    pub fn gradient(&self) -> UtilizationGradient {
        let share = self.utilization();
        let mut gradient = UtilizationGradient::default();
        let lengthwise = self.lengthwise_shares();
        // Of sum_i sqrt((rho r_i)^2 - F_i^2) = |Y|, times both roots.
        let root = self.roots(share);
        let [left, right] = self.radius;
        let by_share = share * (left * left * root[1] + right * right * root[0]);
        if share <= lengthwise[0].max(lengthwise[1]) || by_share == 0.0 {
            let wheel = usize::from(lengthwise[1] > lengthwise[0]);
            gradient.by_longitudinal[wheel] = self.longitudinal[wheel].signum() / self.radius[wheel];
            gradient.by_radius[wheel] = -share / self.radius[wheel];
            return gradient;
        }
        for wheel in 0..2 {
            let other = root[1 - wheel] / by_share;
            gradient.by_longitudinal[wheel] = self.longitudinal[wheel] * other;
            gradient.by_radius[wheel] = -share * share * self.radius[wheel] * other;
        }
        gradient.by_lateral = self.lateral.signum() * root[0] * root[1] / by_share;
        gradient
    }

    /// The lateral friction of each wheel, split so that both keep within the utilisation.
    pub fn lateral_split(&self) -> [f64; 2] {
        let share = self.utilization();
        // A wheel without normal force has none to use; the other one takes what full friction leaves.
        let of_left = share_of_left(self.lateral, self.roots(if share.is_finite() { share } else { 1.0 }));
        [of_left, self.lateral - of_left]
    }

    fn lengthwise_shares(&self) -> [f64; 2] {
        [0, 1].map(|wheel| self.longitudinal[wheel].abs() / self.radius[wheel])
    }

    /// What each wheel can take sideways at a share of its friction.
    fn roots(&self, share: f64) -> [f64; 2] {
        [0, 1].map(|wheel| {
            let (radius, force) = (share * self.radius[wheel], self.longitudinal[wheel].abs());
            ((radius - force).max(0.0) * (radius + force)).sqrt()
        })
    }

    fn capacity(&self, share: f64) -> f64 {
        let [left, right] = self.roots(share);
        left + right
    }

    /// The share at which both wheels together just take the lateral friction, but for rounding.
    ///
    /// With s = rho^2, p = `r_L^2 - r_R^2`, q = `F_L^2 - F_R^2` and S, T the sums of the squares, squaring twice gives
    /// `p^2 s^2 - 2 (p q + Y^2 S) s + q^2 + 2 Y^2 T + Y^4 = 0`. Its smaller root belongs to the sum of the roots, the larger
    /// one to their difference.
    fn binding_share(&self) -> f64 {
        let squares = |values: [f64; 2]| [values[0] * values[0], values[1] * values[1]];
        let ([left, right], [force_left, force_right]) = (squares(self.radius), squares(self.longitudinal));
        let lateral = self.lateral * self.lateral;
        let (p, q) = (left - right, force_left - force_right);
        let half = p * q + lateral * (left + right);
        let constant = q * q + 2.0 * lateral * (force_left + force_right) + lateral * lateral;
        let discriminant = (half * half - p * p * constant).max(0.0);
        (constant / (half + discriminant.sqrt())).sqrt()
    }
}

/// What the left wheel has of a value that both share in proportion to these, >= 0; a half where both are 0.
#[inline]
pub(super) fn share_of_left(value: f64, [left, right]: [f64; 2]) -> f64 {
    if left + right > 0.0 { value * left / (left + right) } else { 0.5 * value }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    type Move = fn(&mut WheelFriction, f64);

    fn random(rng: &mut Xoshiro256PlusPlus) -> WheelFriction {
        WheelFriction {
            longitudinal: [0; 2].map(|_| rng.random_range(-1.0..1.0)),
            lateral: rng.random_range(-2.0..2.0),
            radius: [0; 2].map(|_| rng.random_range(0.1..3.0)),
        }
    }

    #[test]
    fn the_capacity_at_the_utilization_is_what_is_needed() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        for _ in 0..10_000 {
            let friction = random(&mut rng);
            let share = friction.utilization();
            // The square root of the quadratic loses half of the digits where its roots meet.
            assert!(friction.capacity(share * (1.0 + 1e-7)) >= friction.lateral.abs(), "{friction:?}");
            let less = share * (1.0 - 1e-7);
            let holds = [0, 1].iter().all(|&wheel| friction.longitudinal[wheel].abs() <= less * friction.radius[wheel]);
            assert!(!holds || friction.capacity(less) < friction.lateral.abs(), "{friction:?}");
        }
    }

    #[test]
    fn no_wheel_uses_more_than_the_utilization_in_the_split() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(4);
        for _ in 0..10_000 {
            let friction = random(&mut rng);
            let split = friction.lateral_split();
            assert!((split[0] + split[1] - friction.lateral).abs() <= 1e-15, "{friction:?}: {split:?}");
            for (wheel, lateral) in split.into_iter().enumerate() {
                let used = friction.longitudinal[wheel].hypot(lateral) / friction.radius[wheel];
                // Half of the digits where the quadratic's roots meet, as above.
                assert!(used <= friction.utilization() * (1.0 + 1e-7), "{friction:?}: {used}");
            }
        }
    }

    #[test]
    fn a_wheel_without_normal_force_takes_nothing_sideways() {
        for longitudinal in [[3.0, 0.0], [0.0, 0.0]] {
            let friction = WheelFriction { longitudinal, lateral: 8.0, radius: [10.0, 0.0] };
            assert_eq!(friction.lateral_split(), [8.0, 0.0]);
        }
    }

    /// By halving.
    fn utilization_by_bisection(friction: &WheelFriction) -> f64 {
        let [left, right] = friction.lengthwise_shares();
        let least = left.max(right);
        let (mut low, mut high) = (0.0, friction.lateral.abs() / (friction.radius[0] + friction.radius[1]));
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            let is_enough = friction.capacity(least + middle) >= friction.lateral.abs();
            (low, high) = if is_enough { (low, middle) } else { (middle, high) };
        }
        least + high
    }

    #[test]
    fn nearly_equal_wheels_use_what_bisection_finds() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        for _ in 0..100_000 {
            let mut nearly = |value: f64| value * (1.0 + f64::EPSILON * f64::from(rng.random_range(-3..=3)));
            let (longitudinal, radius) = ([nearly(0.8), nearly(0.8)], [nearly(1.1), nearly(1.1)]);
            let size = 10.0_f64.powf(rng.random_range(-320.0..0.0)) * f64::from(rng.random_range(0..=1));
            let scale = 10.0_f64.powf(rng.random_range(-30.0..10.0));
            let friction = WheelFriction {
                longitudinal: longitudinal.map(|force| scale * force),
                lateral: scale * size,
                radius: radius.map(|radius| scale * radius),
            };
            let (share, expected) = (friction.utilization(), utilization_by_bisection(&friction));
            assert!((share - expected).abs() <= 1e-10, "{friction:?}: {share} {expected}");
            let UtilizationGradient { by_longitudinal, by_lateral, by_radius } = friction.gradient();
            let all = [by_longitudinal[0], by_longitudinal[1], by_lateral, by_radius[0], by_radius[1]];
            assert!(all.iter().all(|slope| (scale * slope).abs() <= 2.0), "{friction:?}: {all:?}");
        }
    }

    #[test]
    fn what_is_not_a_number_uses_no_number() {
        let good = WheelFriction { longitudinal: [3.0, 3.0], lateral: 8.0, radius: [10.0, 10.0] };
        let bad = [
            WheelFriction { longitudinal: [f64::NAN, 3.0], ..good },
            WheelFriction { longitudinal: [3.0, f64::NAN], ..good },
            WheelFriction { lateral: f64::NAN, ..good },
            WheelFriction { radius: [10.0, f64::NAN], ..good },
        ];
        assert!(bad.iter().all(|friction| friction.utilization().is_nan()));
    }

    #[test]
    fn one_wheel_of_equal_ones_takes_half() {
        let friction = WheelFriction { longitudinal: [3.0, 3.0], lateral: 8.0, radius: [10.0, 10.0] };
        // Each takes (3, 4). The quadratic is linear here, and rounds to a few ulps.
        assert!((friction.utilization() - 0.5).abs() < 1e-15);
    }

    #[test]
    fn gradient_agrees_with_differences() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
        for _ in 0..1000 {
            let friction = random(&mut rng);
            let gradient = friction.gradient();
            let moves: [(f64, Move); 5] = [
                (gradient.by_longitudinal[0], |friction, step| friction.longitudinal[0] += step),
                (gradient.by_longitudinal[1], |friction, step| friction.longitudinal[1] += step),
                (gradient.by_lateral, |friction, step| friction.lateral += step),
                (gradient.by_radius[0], |friction, step| friction.radius[0] += step),
                (gradient.by_radius[1], |friction, step| friction.radius[1] += step),
            ];
            for (derivative, change) in moves {
                let step = 1e-6;
                let [above, below] = [step, -step].map(|step| {
                    let mut moved = friction;
                    change(&mut moved, step);
                    moved.utilization()
                });
                // Second derivatives are large where a wheel has next to nothing left sideways.
                let gap = ((above - below) / (2.0 * step) - derivative).abs();
                assert!(gap < 1e-3 * derivative.abs().max(1.0), "{friction:?}: {gap}");
            }
        }
    }
}
