//! How much of its limits a motion uses: measured on a rollout of its own, on any grid.

use super::solution::LimitUse;
use crate::shooting::PathLimits;
use crate::simulation::{EndSensitivity, FrictionLaw, Rollout, Simulator};
use crate::stop::{Stop, Stopped};

/// The largest use of each limited field by a rollout, in the order of the limits.
///
/// Where no wheel may slip the wheels are held: so their friction is known that would hold them.
///
/// # Errors
/// When it was stopped before the end.
pub(super) fn limit_uses(
    simulator: &Simulator,
    limits: &PathLimits,
    rollout: &Rollout,
    stop: Stop,
) -> Result<Vec<LimitUse>, Stopped> {
    let mut uses: Vec<LimitUse> = Vec::new();
    if limits.is_empty() || rollout.schedule.control_count() == 0 {
        return Ok(uses);
    }
    let law = if limits.forbids_slip { FrictionLaw::Held } else { FrictionLaw::Exact };
    let mut motion = EndSensitivity::watching(limits.quantities());
    simulator.record(rollout, law, &mut motion, stop)?;
    let step_length = rollout.schedule.final_time / rollout.step_count as f64;
    for (limit, index) in motion.path.of_others(rollout.schedule.control_count()) {
        let (limit, value) = (&limits.path[limit], motion.path.value(index));
        note(
            &mut uses,
            LimitUse {
                limit: limit.field,
                value: limit.allowed(),
                largest: limit.used(value),
                time: (motion.path.step(index) + 1) as f64 * step_length,
                excess: limit.excess(value),
                replay_excess: None,
            },
        );
    }
    if let Some(rate) = limits.torque_rate {
        note(&mut uses, torque_rate_use(rate, rollout));
    }
    Ok(uses)
}

/// Keeps the largest use of each field; one that is not a number is larger than all.
fn note(uses: &mut Vec<LimitUse>, next: LimitUse) {
    match uses.iter_mut().find(|known| known.limit == next.limit) {
        Some(known) if next.excess > known.excess || next.excess.is_nan() => *known = next,
        Some(_) => {}
        None => uses.push(next),
    }
}

fn torque_rate_use(rate: f64, rollout: &Rollout) -> LimitUse {
    let (schedule, interval) = (rollout.schedule, rollout.schedule.interval());
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

/// The largest excess; at most 0 where all limits are kept, NaN if any is.
pub(super) fn largest_excess(uses: &[LimitUse]) -> f64 {
    uses.iter()
        .map(|used| used.excess)
        .fold(0.0, |worst, next| if next > worst || next.is_nan() { next } else { worst })
}
