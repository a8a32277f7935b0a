//! The contact-mode timeline of a trajectory, its separations and its slip reversals.

use std::ops::Range;

use super::trajectory::{ContactSample, Trajectory};
use crate::contact::{ContactMode, ContactName, PerContact};

/// A time span in which no contact changes its mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactModeSpan {
    /// Start of the span, s.
    pub start: f64,
    /// End of the span, s.
    pub end: f64,
    /// Mode per contact.
    pub mode: PerContact<ContactMode>,
    /// Degrees of freedom in the span.
    pub degrees_of_freedom: u8,
}

/// A step in which the normal force of a contact would be negative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separation {
    /// Start of the step, s.
    pub time: f64,
    /// The contact.
    pub contact: ContactName,
    /// Its raw normal force, N, negative.
    pub normal_force: f64,
}

/// The normal force of a contact in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalLoad {
    /// The force as a share of the weight; negative where the contact separates.
    pub share: f64,
    /// The contact.
    pub contact: ContactName,
    /// Start of its step, s.
    pub time: f64,
}

/// Negative normal forces of at most this fraction of the weight are rounding, not separation.
const SEPARATION_TOLERANCE: f64 = 1e-12;

/// Whether a contact with this normal force, or impulse, would have to pull; the weight in the same unit.
pub(super) fn separates(normal: f64, weight: f64) -> bool {
    normal < -SEPARATION_TOLERANCE * weight
}

impl Trajectory {
    /// Merges equal modes of neighbouring steps.
    pub fn contact_modes(&self) -> Vec<ContactModeSpan> {
        let mut spans: Vec<ContactModeSpan> = Vec::new();
        for (step, contacts) in self.contact.iter().enumerate() {
            let mode = contacts.map(|sample| sample.mode);
            let (start, end) = (self.time[step], self.time[step + 1]);
            match spans.last_mut() {
                Some(span) if span.mode == mode => span.end = end,
                _ => {
                    let degrees_of_freedom = self.degrees_of_freedom[step];
                    spans.push(ContactModeSpan { start, end, mode, degrees_of_freedom });
                }
            }
        }
        spans
    }

    /// Every step and contact with a negative normal force.
    pub fn separations(&self) -> Vec<Separation> {
        let mut separations = Vec::new();
        for (step, contacts) in self.contact.iter().enumerate() {
            let weight = contacts.sum(|sample| sample.normal_force);
            for (contact, sample) in contacts.iter() {
                if separates(sample.normal_force, weight) {
                    separations.push(Separation { time: self.time[step], contact, normal_force: sample.normal_force });
                }
            }
        }
        separations
    }

    /// The load of each step and contact.
    pub fn normal_loads(&self) -> impl Iterator<Item = NormalLoad> {
        self.contact.iter().zip(&self.time).flat_map(|(contacts, &time)| {
            let weight = contacts.sum(|sample| sample.normal_force);
            let load = move |sample: &ContactSample| sample.normal_force / weight;
            ContactName::ALL.map(|contact| NormalLoad { share: load(contacts.get(contact)), contact, time })
        })
    }

    /// The smallest load; none without motion.
    pub fn least_normal_load(&self) -> Option<NormalLoad> {
        self.normal_loads().min_by(|a, b| a.share.total_cmp(&b.share))
    }

    /// Counts opposite slip of one contact before and after at most one sticking step.
    ///
    /// There the derivative of any fixed-step scheme is wrong (`docs/model.md`). Contacts without friction force do
    /// not count.
    pub fn slip_reversals(&self) -> usize {
        ContactName::ALL.into_iter().map(|contact| self.slip_reversals_of(contact)).sum()
    }

    fn slip_reversals_of(&self, contact: ContactName) -> usize {
        let sample = |step: usize| *self.contact[step].get(contact);
        let mut reversals = 0;
        for step in 1..self.contact.len() {
            if sample(step).mode == ContactMode::Stick || !has_friction(&sample(step)) {
                continue;
            }
            let skip = usize::from(sample(step - 1).mode == ContactMode::Stick);
            if step < 1 + skip {
                continue;
            }
            let before = sample(step - 1 - skip);
            let opposite = before.lateral_slip * sample(step).lateral_slip
                + before.longitudinal_slip * sample(step).longitudinal_slip
                < 0.0;
            reversals += usize::from(before.mode == ContactMode::Slip && opposite);
        }
        reversals
    }

    /// The steps in which a contact slips, by spans.
    pub fn slip_spans(&self, contact: ContactName) -> Vec<Range<usize>> {
        let modes: Vec<_> = self.contact.iter().map(|contacts| contacts.get(contact).mode).enumerate().collect();
        let slips = modes.chunk_by(|a, b| a.1 == b.1).filter(|span| span[0].1 == ContactMode::Slip);
        slips.map(|span| span[0].0..span[0].0 + span.len()).collect()
    }

    /// Time that a contact slips, s.
    pub fn slip_time(&self, contact: ContactName) -> f64 {
        let slips = |step: &usize| self.contact[*step].get(contact).mode == ContactMode::Slip;
        (0..self.step_count()).filter(slips).map(|step| self.time[step + 1] - self.time[step]).sum()
    }
}

fn has_friction(sample: &ContactSample) -> bool {
    sample.lateral_force != 0.0 || sample.longitudinal_force != 0.0
}
