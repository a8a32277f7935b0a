//! The least normal force of each contact in each stretch of a rollout.
//!
//! A contact whose normal force would be negative separates, which the model does not describe. The least forces measure
//! the distance of a plan from separation; by stretches, because a constraint that is active over a whole phase of a plan
//! is many constraints.

use nalgebra::Vector3;

use super::rollout::Rollout;
use super::torque_schedule::control_interval;

/// Most stretches; with fewer control intervals than this, one per interval.
const STRETCH_LIMIT: usize = 40;
const CONTACT_COUNT: usize = 3;

/// The least normal forces of one rollout.
#[derive(Debug, Clone, Default)]
pub struct LeastNormalForces {
    step_count: usize,
    step_length: f64,
    /// By stretch, then by contact (left, right, front).
    least: Vec<LeastNormalForce>,
}

/// The least normal impulse of one contact in one stretch.
#[derive(Debug, Clone, Copy)]
pub(super) struct LeastNormalForce {
    impulse: f64,
    pub(super) step: usize,
}

impl LeastNormalForces {
    /// Number of values for a schedule: contacts times stretches.
    pub fn count(control_count: usize) -> usize {
        CONTACT_COUNT * control_count.min(STRETCH_LIMIT)
    }

    /// The contact (0 left, 1 right, 2 front) of a value.
    pub const fn contact(index: usize) -> usize {
        index % CONTACT_COUNT
    }

    /// A value, N; negative where the contact separates.
    pub fn force(&self, index: usize) -> f64 {
        self.least[index].impulse / self.step_length
    }

    /// The step of a value.
    pub fn step(&self, index: usize) -> usize {
        self.least[index].step
    }

    pub(super) fn clear(&mut self, rollout: &Rollout) {
        self.step_count = rollout.step_count;
        self.step_length = rollout.schedule.final_time / rollout.step_count as f64;
        self.least.clear();
        let none = LeastNormalForce { impulse: f64::INFINITY, step: 0 };
        self.least.resize(Self::count(rollout.schedule.control_count()), none);
    }

    #[inline]
    pub(super) fn note(&mut self, step: usize, normal_impulse: &Vector3<f64>) {
        let stretch = control_interval(step, self.step_count, self.least.len() / CONTACT_COUNT);
        for contact in 0..CONTACT_COUNT {
            let least = &mut self.least[CONTACT_COUNT * stretch + contact];
            if normal_impulse[contact] < least.impulse {
                *least = LeastNormalForce { impulse: normal_impulse[contact], step };
            }
        }
    }
}
