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

/// All changes of a plan, smaller values first. What the search has found out about it is not rolled out again.
///
/// # Errors
/// When it was stopped before the end.
pub(super) fn sensitivity(
    input: &SolveInput,
    (schedule, step_count): (&TorqueSchedule, usize),
    weighed: Option<&Weighed>,
    stop: Stop,
) -> Result<Vec<Sensitivity>, Stopped> {
    let Weighed { planned, end, less_friction } = match weighed.filter(|weighed| weighed.is_of(schedule, step_count)) {
        Some(weighed) => weighed,
        None => &Weighed::new(input, (schedule, step_count), stop)?,
    };
    let changes = CHANGES.into_iter().flat_map(|(parameter, size)| [(parameter, -size), (parameter, size)]);
    let outcome_of = |change| {
        if change == LESS_FRICTION { Ok(less_friction.clone()) } else { sensitivity_to((planned, end), change, stop) }
    };
    changes.map(outcome_of).collect()
}

/// A plan with its own end, and with what less friction does to it.
#[derive(Debug)]
pub(super) struct Weighed {
    planned: Undisturbed,
    /// At the axle midpoint.
    end: State,
    less_friction: Sensitivity,
}

impl Weighed {
    /// # Errors
    /// When it was stopped before the end.
    pub(super) fn new(input: &SolveInput, plan: (&TorqueSchedule, usize), stop: Stop) -> Result<Self, Stopped> {
        let SolveInput { bare_robot, payload, maneuver, .. } = input;
        let start = (maneuver.reference_point, &maneuver.start);
        let planned = Undisturbed::new((*bare_robot, *payload), start, plan);
        let (end, _) = planned.unchanged().end(stop)?;
        let less_friction = sensitivity_to((&planned, &end), LESS_FRICTION, stop)?;
        Ok(Self { planned, end, less_friction })
    }

    /// The shift of the plan's end under less friction, which no rule refuses.
    pub(super) fn shift(&self) -> Option<EndShift> {
        self.less_friction.outcome.as_ref().ok().copied()
    }

    fn is_of(&self, schedule: &TorqueSchedule, step_count: usize) -> bool {
        self.planned.step_count == step_count && self.planned.schedule == *schedule
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_of_another_plan_does_not_count() {
        let (input, never) = (SolveInput::forward_drive(), Stop::never());
        let plan = |torque: f64| TorqueSchedule { final_time: 1.0, left: vec![torque], right: vec![-torque] };
        let of =
            |schedule, steps, known: Option<&Weighed>| sensitivity(&input, (schedule, steps), known, never).unwrap();
        let (schedule, other) = (plan(0.3), plan(0.6));
        let alone = of(&schedule, 50, None);
        assert_eq!((alone.len(), alone[0].parameter, alone[0].change), (14, ChangedParameter::Friction, -0.1));
        for (known, steps) in [(&schedule, 50), (&schedule, 60), (&other, 50)] {
            let weighed = Weighed::new(&input, (known, steps), never).unwrap();
            assert_eq!(of(&schedule, 50, Some(&weighed)), alone);
        }
    }
}
