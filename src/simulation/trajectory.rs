//! The samples of one rollout.

use nalgebra::Vector2;

use crate::contact::{ContactMode, PerContact};
use crate::robot::State;

/// States at the nodes and contacts of the steps of one rollout.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectory {
    /// Node times, s; one more than there are steps.
    pub time: Vec<f64>,
    /// States at the nodes, at the chassis centre of mass.
    pub state: Vec<State>,
    /// The end state as goals are judged ([`EndFrame`](super::EndFrame)), at the same point.
    pub end_state: State,
    /// Contacts per step.
    pub contact: Vec<PerContact<ContactSample>>,
    /// Degrees of freedom per step: 5 - rank of the sticking directions.
    pub degrees_of_freedom: Vec<u8>,
    /// Largest residual of the contact law over all steps, relative to m g dt.
    pub worst_contact_residual: f64,
}

impl Trajectory {
    /// Number of steps.
    pub fn step_count(&self) -> usize {
        self.contact.len()
    }

    /// Whether it leaves all bounds, or ends in no numbers.
    pub fn diverges(&self) -> bool {
        let is_finite = |state: &State| state.to_vector().iter().all(|value| value.abs() < 1e9);
        !self.state.iter().all(is_finite)
    }

    /// Describes the states at another point of the chassis, `offset` away in the body frame (right, forward), m.
    pub fn move_states_by(&mut self, offset: Vector2<f64>) {
        if offset != Vector2::zeros() {
            for state in &mut self.state {
                *state = state.moved_by(offset);
            }
            self.end_state = self.end_state.moved_by(offset);
        }
    }
}

/// One contact during one step: forces are the step's means, slips are `gamma_E` with W at `q_M`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactSample {
    /// Normal force, N; negative means that the contact separates.
    pub normal_force: f64,
    /// Friction force on the robot to the right, N. While both wheels stick only the wheels' sum is physical; the
    /// split is the one in which the wheel that uses more of its grip uses as little as possible, by convention.
    pub lateral_force: f64,
    /// Friction force on the robot to the front, N.
    pub longitudinal_force: f64,
    /// Slip to the right, m/s.
    pub lateral_slip: f64,
    /// Slip to the front, m/s.
    pub longitudinal_slip: f64,
    /// Whether the contact sticks or slips.
    pub mode: ContactMode,
}
