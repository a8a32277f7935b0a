//! The largest value of each path quantity in each stretch of a rollout.
//!
//! By stretches, because a constraint that is active over a whole phase of a plan is many constraints. Normal forces, which every
//! plan must keep, are noted in few stretches and by a loop of their own. Other quantities have up to three values per control
//! interval: in its last step, in its first one if they jump with the torques, and the largest one in between where that exceeds
//! both. The largest of all would be one value, but a corner wherever it moves to another step, and a plan that follows a limit
//! would lie on such corners throughout.

use super::moreau_step::Step;
use super::path_quantity::{PathQuantity, PathSample};
use super::rollout::Rollout;
use super::tape::TapeEntry;
use super::torque_schedule::control_interval;

/// Most stretches of normal forces; with fewer control intervals than this, one per interval.
const STRETCH_LIMIT: usize = 40;
/// Left, right and front.
pub const CONTACT_COUNT: usize = 3;

/// The largest values of path quantities in one rollout: first those of the normal forces, by stretch and contact, then those of the
/// other quantities, by control interval, quantity and place in the interval.
#[derive(Debug, Clone, Default)]
pub struct PathExtremes {
    others: Vec<PathQuantity>,
    step_count: usize,
    step_length: f64,
    unloading: Vec<Extreme>,
    largest: Vec<[Extreme; PLACES]>,
    /// One per step, where there are other quantities.
    samples: Vec<PathSample>,
}

/// The largest value of one quantity in one stretch.
#[derive(Debug, Clone, Copy)]
struct Extreme {
    /// As [`PathQuantity::of_step`] gives it.
    value: f64,
    step: usize,
}

/// Values of a quantity in an interval: in the first step, in between, in the last step.
const PLACES: usize = 3;
const FIRST: usize = 0;
const BETWEEN: usize = 1;
const LAST: usize = 2;
const NONE: Extreme = Extreme { value: f64::NEG_INFINITY, step: 0 };

impl PathExtremes {
    /// Of the normal forces and of other quantities, before any rollout of a schedule of so many control intervals.
    pub(super) fn new(others: Vec<PathQuantity>, control_count: usize) -> Self {
        let mut extremes = Self { others, ..Self::default() };
        extremes.forget_values(control_count);
        extremes
    }

    /// Has other ones in place of the other quantities, for schedules of so many control intervals, from the next rollout on.
    pub(crate) fn watch(&mut self, others: Vec<PathQuantity>, control_count: usize) {
        self.others = others;
        self.forget_values(control_count);
    }

    /// The quantities other than normal forces.
    pub(crate) fn others(&self) -> &[PathQuantity] {
        &self.others
    }

    /// Whether there are quantities other than normal forces.
    pub(super) fn has_others(&self) -> bool {
        !self.others.is_empty()
    }

    /// Number of values.
    pub fn count(&self) -> usize {
        self.unloading.len() + PLACES * self.largest.len()
    }

    /// The place of a value's quantity: the contact of a normal force, else 3 more than its place among the other quantities.
    pub fn place(&self, index: usize) -> usize {
        match index.checked_sub(self.unloading.len()) {
            None => index % CONTACT_COUNT,
            Some(index) => CONTACT_COUNT + index / PLACES % self.others.len(),
        }
    }

    /// The quantity of a value.
    pub fn quantity(&self, index: usize) -> PathQuantity {
        match self.place(index).checked_sub(CONTACT_COUNT) {
            None => PathQuantity::Unloading { contact: self.place(index) },
            Some(other) => self.others[other],
        }
    }

    /// The values of the other quantities: the place of each among these, and its index.
    pub fn of_others(&self) -> impl Iterator<Item = (usize, usize)> {
        (self.unloading.len()..self.count()).map(|index| (self.place(index) - CONTACT_COUNT, index))
    }

    /// A value, in the unit of its quantity.
    pub fn value(&self, index: usize) -> f64 {
        let value = self.extreme(index).value;
        if self.quantity(index).is_per_step_length() { value / self.step_length } else { value }
    }

    /// The step of a value.
    pub fn step(&self, index: usize) -> usize {
        self.extreme(index).step
    }

    /// What the quantities of a step depend on beside its tape entry; normal forces depend on nothing else.
    pub(super) fn sample(&self, step: usize) -> PathSample {
        self.samples.get(step).copied().unwrap_or_default()
    }

    fn extreme(&self, index: usize) -> &Extreme {
        match index.checked_sub(self.unloading.len()) {
            None => &self.unloading[index],
            Some(index) => &self.largest[index / PLACES][index % PLACES],
        }
    }

    pub(super) fn clear(&mut self, rollout: &Rollout) {
        self.step_count = rollout.step_count;
        self.step_length = rollout.step_length();
        self.forget_values(rollout.schedule.control_count());
        self.samples.clear();
    }

    /// As before any rollout of a schedule of so many control intervals.
    pub fn forget_values(&mut self, control_count: usize) {
        self.unloading.clear();
        self.unloading.resize(CONTACT_COUNT * control_count.min(STRETCH_LIMIT), NONE);
        self.largest.clear();
        self.largest.resize(self.others.len() * control_count, [NONE; PLACES]);
    }

    /// Notes a step with its torques.
    #[inline]
    pub(super) fn note<const N: usize>(&mut self, index: usize, step: &Step<N>, rollout: &Rollout) {
        let stretch = control_interval(index, self.step_count, self.unloading.len() / CONTACT_COUNT);
        let unloading = &mut self.unloading[CONTACT_COUNT * stretch..][..CONTACT_COUNT];
        for (extreme, normal_impulse) in unloading.iter_mut().zip(step.contact.normal_impulse.as_slice()) {
            let value = -normal_impulse;
            if value > extreme.value {
                *extreme = Extreme { value, step: index };
            }
        }
        if !self.others.is_empty() {
            self.note_others(index, step, rollout);
        }
    }

    fn note_others<const N: usize>(&mut self, index: usize, step: &Step<N>, rollout: &Rollout) {
        let control_count = rollout.schedule.control_count();
        let interval_of = |step| control_interval(step, self.step_count, control_count);
        let interval = interval_of(index);
        let is_first = index == 0 || interval_of(index - 1) != interval;
        let is_last = index + 1 == self.step_count || interval_of(index + 1) != interval;
        let sample = PathSample::new(step, rollout.schedule.torque(interval), self.step_length);
        let first = self.others.len() * interval;
        PathQuantity::each_of_step(&self.others, &TapeEntry::new(step), &sample, |place, value| {
            let (extremes, quantity) = (&mut self.largest[first + place], self.others[place]);
            let extreme = Extreme { value, step: index };
            if is_last {
                note_last(extremes, extreme, quantity);
            } else if is_first && quantity.jumps_with_torque() {
                extremes[FIRST] = extreme;
            } else if extreme.value > extremes[BETWEEN].value {
                extremes[BETWEEN] = extreme;
            }
        });
        self.samples.push(sample);
    }
}

/// Notes the last step of an interval, after which what lies in between counts only if it is larger.
fn note_last(extremes: &mut [Extreme; PLACES], last: Extreme, quantity: PathQuantity) {
    extremes[LAST] = last;
    let ends = extremes[FIRST].value.max(last.value);
    if extremes[BETWEEN].value <= ends + quantity.negligible(ends) {
        extremes[BETWEEN] = NONE;
    }
}
