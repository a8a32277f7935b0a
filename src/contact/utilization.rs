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
    /// The least share of the friction that holds both wheels.
    #[inline]
    pub fn utilization(&self) -> f64 {
        let lengthwise = self.lengthwise_shares();
        let least = lengthwise[0].max(lengthwise[1]);
        if self.capacity(least) >= self.lateral.abs() { least } else { self.binding_share() }
    }

    /// Derivatives of [`Self::utilization`]; at rest they are zero.
    pub fn gradient(&self) -> UtilizationGradient {
        let share = self.utilization();
        let mut gradient = UtilizationGradient::default();
        let lengthwise = self.lengthwise_shares();
        if share <= lengthwise[0].max(lengthwise[1]) {
            let wheel = usize::from(lengthwise[1] > lengthwise[0]);
            gradient.by_longitudinal[wheel] = self.longitudinal[wheel].signum() / self.radius[wheel];
            gradient.by_radius[wheel] = -share / self.radius[wheel];
            return gradient;
        }
        // Of sum_i sqrt((rho r_i)^2 - F_i^2) = |Y|, times both roots.
        let root = self.roots(share);
        let [left, right] = self.radius;
        let by_share = share * (left * left * root[1] + right * right * root[0]);
        for wheel in 0..2 {
            let other = root[1 - wheel] / by_share;
            gradient.by_longitudinal[wheel] = self.longitudinal[wheel] * other;
            gradient.by_radius[wheel] = -share * share * self.radius[wheel] * other;
        }
        gradient.by_lateral = self.lateral.signum() * root[0] * root[1] / by_share;
        gradient
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

    /// The share at which both wheels together just take the lateral friction.
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
