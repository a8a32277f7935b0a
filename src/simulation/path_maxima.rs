//! The end of a rollout with the largest value of each of some path quantities on the way, without what derivatives need.

use super::contact_timeline::separates;
use super::friction_law::FrictionLaw;
use super::moreau_step::{Step, StepModel};
use super::path_quantity::{PathQuantity, PathSample};
use super::rollout::{Model, Rollout, Simulator, integrate_under};
use super::tape::TapeEntry;
use super::torque_schedule::control_interval;
use crate::contact::WheelPattern;
use crate::robot::State;
use crate::stop::{Stop, Stopped};

/// What a rollout comes to.
#[derive(Debug, Clone, PartialEq)]
pub struct PathMaxima {
    /// The end state at the chassis centre of mass.
    pub end: State,
    /// How often a contact separates.
    pub separations: usize,
    /// Whether a wheel slips in any step.
    pub slips: bool,
    /// Of each quantity, in their order.
    pub maxima: Vec<PathMaximum>,
}

/// The largest value of a quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathMaximum {
    /// In the unit of its quantity; not a number if any value is none.
    pub value: f64,
    /// The first node that has it, from 0: of what a whole step has, the end of that.
    pub node: usize,
}

impl Simulator {
    /// Integrates a rollout and notes the largest value of each quantity. It allocates nothing in its steps.
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub fn path_maxima(
        &self,
        rollout: &Rollout,
        law: FrictionLaw,
        quantities: &[PathQuantity],
        stop: Stop,
    ) -> Result<PathMaxima, Stopped> {
        match &*self.model(rollout) {
            Model::Wheels(model) => watch(model, (rollout, law), quantities, stop),
            Model::WheelsAndFront(model) => watch(model, (rollout, law), quantities, stop),
        }
    }
}

fn watch<const N: usize>(
    model: &StepModel<N>,
    (rollout, law): (&Rollout, FrictionLaw),
    quantities: &[PathQuantity],
    stop: Stop,
) -> Result<PathMaxima, Stopped> {
    let mut maxima = vec![PathMaximum { value: f64::NEG_INFINITY, node: 0 }; quantities.len()];
    let (mut separations, mut slips) = (0, false);
    let (control_count, dt) = (rollout.schedule.control_count(), rollout.step_length());
    let note = |index: usize, step: &mut Step<N>| {
        let normal_impulse = &step.contact.normal_impulse;
        let weight = normal_impulse.sum();
        separations += normal_impulse.iter().filter(|impulse| separates(**impulse, weight)).count();
        slips |= step.contact.pattern.wheels != WheelPattern::BothStick;
        if quantities.is_empty() {
            return;
        }
        let torque = rollout.schedule.torque(control_interval(index, rollout.step_count, control_count));
        let (entry, sample) = (TapeEntry::new(step), PathSample::new(step, torque, dt));
        PathQuantity::each_of_step(quantities, &entry, &sample, |place, value| {
            let largest = &mut maxima[place];
            // What is not a number stays.
            if value > largest.value || value.is_nan() {
                *largest = PathMaximum { value, node: index + quantities[place].node(&entry, &sample) };
            }
        });
    };
    let end = integrate_under(law, model, rollout, stop, note)?;
    for (largest, quantity) in maxima.iter_mut().zip(quantities) {
        if quantity.is_per_step_length() {
            largest.value /= dt;
        }
    }
    Ok(PathMaxima { end, separations, slips, maxima })
}
