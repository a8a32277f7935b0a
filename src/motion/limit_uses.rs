//! How much of its limits a motion uses: measured on a rollout of its own, on any grid.

use crate::optimizer::larger;
use crate::shooting::{PathLimit, PathLimits};
use crate::simulation::{FrictionLaw, PathMaxima, PathMaximum, PathQuantity, Rollout, Simulator, TorqueSchedule};
use crate::stop::{Stop, Stopped};

/// How far a motion uses one of the limits that were given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitUse {
    /// The field of a solve that has the limit, such as `maneuver.limits.speed_m_s`.
    pub limit: &'static str,
    /// What is allowed, in the unit of the field.
    pub value: f64,
    /// The largest use, in the unit of the field.
    pub largest: f64,
    /// When, s.
    pub time: f64,
    /// Largest use above the limit as a share of the limit, on the grid of the motion; at most 0 where it is kept.
    pub excess: f64,
    /// The same on the finer grid of the replay; none where nothing was replayed.
    pub replay_excess: Option<f64>,
}

/// The largest use of each limited field by a rollout, in the order of the limits; see [`motion_with_limits`].
///
/// # Errors
/// When it was stopped before the end.
pub(crate) fn limit_uses(
    simulator: &Simulator,
    limits: &PathLimits,
    rollout: &Rollout,
    stop: Stop,
) -> Result<Vec<LimitUse>, Stopped> {
    if limits.is_empty() {
        return Ok(Vec::new());
    }
    Ok(motion_with_limits(simulator, limits, (rollout, rollout.schedule), stop)?.1)
}

/// Integrates a motion: what it comes to, and the largest use of each limited field.
///
/// Where no wheel may slip but one does, its grip is judged by another rollout whose wheels are held: so the friction is known that
/// would hold them. Else wheels that slide use all of their friction, also where there is none. All else is that of the motion as it
/// is, but for the rate of its torques, which is that of the commanded ones.
///
/// # Errors
/// When it was stopped before the end.
pub(crate) fn motion_with_limits(
    simulator: &Simulator,
    limits: &PathLimits,
    (rollout, commanded): (&Rollout, &TorqueSchedule),
    stop: Stop,
) -> Result<(PathMaxima, Vec<LimitUse>), Stopped> {
    let judged: Vec<&PathLimit> = limits.path.iter().filter(|limit| !limit.is_face()).collect();
    let quantities: Vec<PathQuantity> = judged.iter().map(|limit| limit.quantity).collect();
    let maxima = |law, quantities: &[PathQuantity]| simulator.path_maxima(rollout, law, quantities, stop);
    let mut motion = maxima(FrictionLaw::Exact, &quantities)?;
    let is_grip = |quantity: &PathQuantity| matches!(quantity, PathQuantity::GripUtilization { .. });
    if let Some(grip) = quantities.iter().position(is_grip) {
        let maximum = &mut motion.maxima[grip];
        if limits.forbids_slip && motion.slips {
            *maximum = maxima(FrictionLaw::Held(0.0), &quantities[grip..=grip])?.maxima[0];
        } else if simulator.robot().parameters().wheel_friction_coefficient == 0.0 {
            maximum.value = larger(1.0, maximum.value);
        }
    }
    let step_length = rollout.step_length();
    let use_of = |(limit, &PathMaximum { value: reached, node }): (&PathLimit, &PathMaximum)| {
        let counted = limit.counted(reached);
        LimitUse {
            limit: limit.field,
            value: limit.allowed(),
            largest: limit.used(counted),
            time: node as f64 * step_length,
            excess: limit.excess(counted),
            replay_excess: None,
        }
    };
    let all: Vec<LimitUse> = judged.into_iter().zip(&motion.maxima).map(use_of).collect();
    // Limits of one field stand together.
    let mut uses: Vec<_> = all.chunk_by(|a, b| a.limit == b.limit).filter_map(most_exceeded).copied().collect();
    uses.extend(limits.torque_rate.map(|rate| torque_rate_use(rate, commanded)));
    Ok((motion, uses))
}

/// The use that exceeds its limit most, as a share of it.
pub(crate) fn most_exceeded(uses: &[LimitUse]) -> Option<&LimitUse> {
    uses.iter().reduce(|most, next| if exceeds_more(next, most) { next } else { most })
}

/// An excess that is not a number is larger than all.
fn exceeds_more(next: &LimitUse, known: &LimitUse) -> bool {
    next.excess > known.excess || next.excess.is_nan()
}

fn torque_rate_use(rate: f64, schedule: &TorqueSchedule) -> LimitUse {
    let interval = schedule.interval();
    let changes = [&schedule.left, &schedule.right].into_iter().flat_map(|torques| {
        torques.windows(2).enumerate().map(|(boundary, pair)| (boundary, (pair[1] - pair[0]).abs() / interval))
    });
    let (boundary, largest) = changes.fold((0, 0.0), |worst, next| if next.1 > worst.1 { next } else { worst });
    LimitUse {
        limit: "maneuver.limits.torque_rate_n_m_s",
        value: rate,
        largest,
        time: (boundary + 1) as f64 * interval,
        excess: largest / rate - 1.0,
        replay_excess: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{SimulateInput, SimulateParameters, simulate};
    use crate::robot::{Motor, PerWheel, RobotParameters, State};
    use crate::shooting::ManeuverLimits;

    fn uses(robot: RobotParameters, start: State, limits: ManeuverLimits) -> Vec<LimitUse> {
        let schedule = TorqueSchedule { final_time: 0.3, left: vec![1.0], right: vec![1.0] };
        let parameters = SimulateParameters { robot, start, limits, schedule, step_count: 3, ..Default::default() };
        simulate(&SimulateInput::new(parameters).unwrap(), Stop::never()).unwrap().limits
    }

    #[test]
    fn motor_that_slows_is_worst_at_the_start() {
        let motor = Motor { stall_torque: 2.0, free_speed: 15.0 };
        let robot = RobotParameters { motor: Some(motor), wheel_viscous_friction: 0.5, ..RobotParameters::default() };
        let mut start = State::default();
        start.velocity.y = 15.0 * robot.wheel_radius;
        start.velocity.wheel_rate = PerWheel::new(15.0, 15.0);
        let uses = uses(robot, start, ManeuverLimits::default());
        // At the free speed nothing is left of it.
        assert!(uses[0].time == 0.0 && (uses[0].largest - 3.0).abs() < 1e-12, "{uses:?}");
    }

    #[test]
    fn wheels_that_slide_without_friction_use_all_of_it() {
        let robot = RobotParameters { wheel_friction_coefficient: 0.0, ..RobotParameters::default() };
        let limits = ManeuverLimits { grip_utilization: Some(0.8), ..ManeuverLimits::default() };
        let uses = uses(robot, State::default(), limits);
        assert!(uses[0].largest == 1.0 && (uses[0].excess - 0.25).abs() < 1e-12, "{uses:?}");
    }
}
