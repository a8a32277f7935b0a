//! Motions as rows of numbers, for spreadsheets.

use std::fmt::Write as _;

use super::LABELS;
use crate::contact::ContactName;
use crate::jobs::ManeuverSolver;
use crate::jobs::plan::AcceptedPlan;
use crate::shooting::StateComponent;
use crate::simulation::{ContactSample, control_interval};
use crate::stop::{Stop, Stopped};

/// What a contact does in the step that begins at the row's time.
type OfContact = (&'static str, fn(&ContactSample) -> f64);
const OF_CONTACTS: [OfContact; 5] = [
    ("normal_force_n", |of| of.normal_force),
    ("longitudinal_force_n", |of| of.longitudinal_force),
    ("lateral_force_n", |of| of.lateral_force),
    ("longitudinal_slip_m_s", |of| of.longitudinal_slip),
    ("lateral_slip_m_s", |of| of.lateral_slip),
];

impl AcceptedPlan {
    /// The motions of plans, one row per node: the state there, and torques, forces and slips of the step that begins
    /// there, which the last row leaves empty.
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub fn csv(plans: &[Self], solver: &dyn ManeuverSolver, stop: Stop<'_>) -> Result<String, Stopped> {
        let mut text = "plan,time_s".to_owned();
        for component in StateComponent::ALL {
            let _ = write!(text, ",{}", component.field());
        }
        text.push_str(",torque_left_n_m,torque_right_n_m");
        for (contact, (name, _)) in ContactName::ALL.into_iter().flat_map(|contact| OF_CONTACTS.map(|of| (contact, of)))
        {
            let _ = write!(text, ",{}_{name}", contact.as_str());
        }
        text.push('\n');
        for (plan, label) in plans.iter().zip(LABELS) {
            plan.write_rows(label, solver, stop, &mut text)?;
        }
        Ok(text)
    }

    fn write_rows(
        &self,
        label: &str,
        solver: &dyn ManeuverSolver,
        stop: Stop<'_>,
        text: &mut String,
    ) -> Result<(), Stopped> {
        let trajectory = self.trajectory(solver, stop)?;
        let (steps, schedule) = (trajectory.step_count(), &self.motion.schedule);
        for (node, (time, state)) in trajectory.time.iter().zip(&trajectory.state).enumerate() {
            // Writing to a string cannot fail.
            let _ = write!(text, "{label},{time}");
            for value in &state.to_vector() {
                let _ = write!(text, ",{value}");
            }
            if let Some(contacts) = trajectory.contact.get(node) {
                let torque = schedule.torque(control_interval(node, steps, schedule.control_count()));
                let _ = write!(text, ",{},{}", torque.left, torque.right);
                for value in contacts.iter().flat_map(|(_, sample)| OF_CONTACTS.map(|(_, value)| value(sample))) {
                    let _ = write!(text, ",{value}");
                }
            } else {
                text.push_str(&",".repeat(2 + 3 * OF_CONTACTS.len()));
            }
            text.push('\n');
        }
        Ok(())
    }
}
