//! How far a plan ends from its own end where robot, torques or start are a little different from what it was made for.
//!
//! Each change is one rollout of the same torques by Coulomb's law, whatever law the search held the wheels by. Starts and ends
//! are those of the axle midpoint, which stays in its place where the centre of mass does not.

use super::certificate::finite_or_largest;
use super::settings::{SolveInput, SolverSettings};
use crate::motion::{ChangedParameter, Undisturbed};
use crate::robot::State;
use crate::simulation::TorqueSchedule;
use crate::stop::{Stop, Stopped};

/// Each parameter with the size of its changes, in its unit.
const CHANGES: [(ChangedParameter, f64); 7] = [
    (ChangedParameter::Friction, FRICTION_CHANGE),
    (ChangedParameter::Mass, 0.05),
    (ChangedParameter::CenterOfMassRight, PLACE_CHANGE),
    (ChangedParameter::CenterOfMassForward, PLACE_CHANGE),
    (ChangedParameter::Torque, TORQUE_CHANGE),
    (ChangedParameter::TorqueLeft, TORQUE_CHANGE),
    (ChangedParameter::StartHeading, 0.5_f64.to_radians()),
];
/// As a share.
const FRICTION_CHANGE: f64 = 0.1;
/// The change that plans are weighed by.
const LESS_FRICTION: (ChangedParameter, f64) = (ChangedParameter::Friction, -FRICTION_CHANGE);
/// m.
const PLACE_CHANGE: f64 = 0.01;
/// As a share.
const TORQUE_CHANGE: f64 = 0.02;

/// What a change does to the end of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivity {
    /// What is changed.
    pub parameter: ChangedParameter,
    /// By how much, in the unit of the parameter.
    pub change: f64,
    /// The shift of the end, or the field whose rule refuses the change.
    pub outcome: Result<EndShift, String>,
}

/// From the end of a plan to the end of the changed motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndShift {
    /// Distance of the axle midpoints, m; the largest number where the motion diverges.
    pub distance: f64,
    /// Magnitude of the difference of the headings, not wrapped, rad; the largest number where the motion diverges.
    pub angle: f64,
    /// Whether a contact lifts on the way.
    pub separates: bool,
}

impl EndShift {
    /// In units of the replay's tolerances; none is larger than that of a motion that leaves the model.
    pub(super) fn relative(&self, settings: &SolverSettings) -> f64 {
        if self.separates {
            return f64::INFINITY;
        }
        (self.distance / settings.replay_tolerance_position).max(self.angle / settings.replay_tolerance_heading)
    }
}

/// All changes of a plan, smaller values first.
///
/// # Errors
/// When it was stopped before the end.
pub(super) fn sensitivity(
    input: &SolveInput,
    plan: (&TorqueSchedule, usize),
    stop: Stop,
) -> Result<Vec<Sensitivity>, Stopped> {
    let planned = planned(input, plan, stop)?;
    let changes = CHANGES.into_iter().flat_map(|(parameter, size)| [(parameter, -size), (parameter, size)]);
    changes.map(|change| sensitivity_to(&planned, change, stop)).collect()
}

/// The shift of a plan's end under less friction, which no rule refuses.
///
/// # Errors
/// When it was stopped before the end.
pub(super) fn friction_shift(
    input: &SolveInput,
    plan: (&TorqueSchedule, usize),
    stop: Stop,
) -> Result<Option<EndShift>, Stopped> {
    Ok(sensitivity_to(&planned(input, plan, stop)?, LESS_FRICTION, stop)?.outcome.ok())
}

/// A plan, of so many steps, with its own end, which is at the axle midpoint.
fn planned(
    SolveInput { bare_robot, payload, maneuver, .. }: &SolveInput,
    plan: (&TorqueSchedule, usize),
    stop: Stop,
) -> Result<(Undisturbed, State), Stopped> {
    let start = (maneuver.reference_point, &maneuver.start);
    let planned = Undisturbed::new((*bare_robot, *payload), start, plan);
    let (end, _) = planned.unchanged().end(stop)?;
    Ok((planned, end))
}

/// What a change does to a plan with this end.
fn sensitivity_to(
    (planned, end): &(Undisturbed, State),
    (parameter, change): (ChangedParameter, f64),
    stop: Stop,
) -> Result<Sensitivity, Stopped> {
    let outcome = match planned.under(&[(parameter, change)]) {
        Ok(disturbed) => {
            let (reached, separations) = disturbed.end(stop)?;
            let (reached, end) = (reached.configuration, end.configuration);
            Ok(EndShift {
                distance: finite_or_largest((reached.x - end.x).hypot(reached.y - end.y)),
                angle: finite_or_largest((reached.heading - end.heading).abs()),
                separates: separations > 0,
            })
        }
        Err(violations) => Err(violations.list()[0].field.clone()),
    };
    Ok(Sensitivity { parameter, change, outcome })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plans_are_weighed_by_less_friction() {
        let (input, never) = (SolveInput::forward_drive(), Stop::never());
        let schedule = TorqueSchedule { final_time: 1.0, left: vec![0.3], right: vec![-0.3] };
        let all = sensitivity(&input, (&schedule, 50), never).unwrap();
        assert_eq!((all.len(), all[0].parameter, all[0].change), (14, ChangedParameter::Friction, -0.1));
        assert_eq!(friction_shift(&input, (&schedule, 50), never).unwrap(), all[0].outcome.clone().ok());
    }
}
