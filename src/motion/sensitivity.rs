//! How far a plan ends from its own end where robot, torques or start are a little different from what it was made for.
//!
//! Each change is one rollout of the same torques by Coulomb's law, whatever law the search held the wheels by. Starts and ends
//! are those of the axle midpoint, which stays in its place where the centre of mass does not.

use super::{ChangedParameter, Undisturbed};
use crate::robot::State;
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

/// All changes of a plan, smaller values first.
///
/// # Errors
/// When it was stopped before the end.
pub(crate) fn sensitivity(planned: &Undisturbed, stop: Stop) -> Result<Vec<Sensitivity>, Stopped> {
    let (end, _) = planned.unchanged().end(stop)?;
    let changes = CHANGES.into_iter().flat_map(|(parameter, size)| [(parameter, -size), (parameter, size)]);
    changes.map(|change| sensitivity_to((planned, &end), change, stop)).collect()
}

/// The shift of a plan's end under less friction, which no rule refuses.
///
/// # Errors
/// When it was stopped before the end.
pub(crate) fn friction_shift(planned: &Undisturbed, stop: Stop) -> Result<Option<EndShift>, Stopped> {
    let (end, _) = planned.unchanged().end(stop)?;
    Ok(sensitivity_to((planned, &end), LESS_FRICTION, stop)?.outcome.ok())
}

/// What a change does to a plan with this end, which is at the axle midpoint.
fn sensitivity_to(
    (planned, end): (&Undisturbed, &State),
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

/// What a motion that diverges makes of a distance becomes the largest number.
pub(crate) fn finite_or_largest(value: f64) -> f64 {
    if value.is_finite() { value } else { f64::MAX }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::RobotParameters;
    use crate::shooting::ReferencePoint;
    use crate::simulation::TorqueSchedule;

    #[test]
    fn plans_are_weighed_by_less_friction() {
        let schedule = TorqueSchedule { final_time: 1.0, left: vec![0.3], right: vec![-0.3] };
        let start = (ReferencePoint::default(), &State::default());
        let planned = Undisturbed::new((RobotParameters::default(), None), start, (&schedule, 50));
        let all = sensitivity(&planned, Stop::never()).unwrap();
        assert_eq!((all.len(), all[0].parameter, all[0].change), (14, ChangedParameter::Friction, -0.1));
        assert_eq!(friction_shift(&planned, Stop::never()).unwrap(), all[0].outcome.clone().ok());
    }
}
