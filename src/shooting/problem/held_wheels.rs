//! The same maneuver for rollouts that hold the wheels.

use super::ShootingProblem;
use crate::shooting::path_limits::holding_limits;
use crate::simulation::FrictionLaw;

impl ShootingProblem<'_> {
    /// Whether a wheel that begins to slip soon breaks a limit: spun up, it has no torque left on its motor's curve. So kinks are steep where
    /// wheels begin to slip, and a linear model, which knows the sticking side, does not see them.
    pub fn is_steep_where_wheels_slip(&self) -> bool {
        let holds_wheels = matches!(self.law, FrictionLaw::Held(_));
        !holds_wheels && self.simulator.robot().parameters().motor.is_some()
    }

    /// The same problem for rollouts that hold the wheels, with their grip as one more limit. Where that is kept its motions are those of
    /// the exact law.
    #[must_use]
    pub fn holding_wheels(&self) -> Self {
        let limits = holding_limits(self.simulator.robot());
        let grip = limits.map(|limit| limit.quantity);
        let mut held = self.clone();
        held.law = FrictionLaw::Held(0.0);
        held.path_constraints.extend(&limits);
        held.sensitivity.path.watch([self.sensitivity.path.others(), &grip].concat(), self.control_count());
        held.beyond_grip.iter_mut().for_each(|quantities| quantities.extend(grip));
        held.recorded = None;
        held
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::optimizer::Problem;
    use crate::robot::{Robot, RobotParameters};
    use crate::shooting::{Maneuver, PathLimits};
    use crate::simulation::Simulator;
    use crate::stop::Stop;

    #[test]
    fn held_wheels_move_as_those_that_do_not_slip_and_break_a_limit_where_these_would() {
        let simulator = Simulator::new(&Robot::new(RobotParameters::default()).unwrap());
        let limits = PathLimits::default();
        let mut exact = ShootingProblem::new(&simulator, (&Maneuver::forward_drive(), &limits), (50, 5), 1.0);
        let mut held = exact.holding_wheels();
        for (share, slips) in [(0.2, false), (4.0, true)] {
            let decision =
                DVector::from_vec(vec![0.9, 0.3, -0.2, 0.7, -0.6, 0.5, 0.8, 0.1, -0.4, 0.2, 1.7 / share]) * share;
            let [exact, constraints] =
                [&mut exact, &mut held].map(|problem| problem.evaluate(&decision, Stop::never()).unwrap());
            assert_eq!(held.breaks_limits(&constraints), slips, "{share}");
            // Sticking wheels and held ones solve the same three equations, differently.
            let difference = (exact.residual - constraints.residual).amax();
            assert_eq!(difference > 1e-12, slips, "{share}: {difference:e}");
        }
    }
}
