//! The tape of a rollout: what the backward sweeps need of each step.

use nalgebra::{SVector, Vector3};

use super::moreau_step::Step;
use crate::contact::ContactPattern;
use crate::robot::BodyVector;

/// The data of one step that its derivatives need.
#[derive(Debug, Clone, Copy)]
pub(super) struct TapeEntry {
    /// Sine and cosine of the midpoint's heading.
    pub(super) rotation: (f64, f64),
    pub(super) start_velocity: BodyVector,
    pub(super) end_velocity: BodyVector,
    /// Impact slip by direction; those of a frictionless front support stay zero.
    pub(super) impact_slip: SVector<f64, 5>,
    pub(super) normal_impulse: Vector3<f64>,
    /// Friction impulse by direction, likewise.
    pub(super) impulse: SVector<f64, 5>,
    pub(super) pattern: ContactPattern,
}

impl TapeEntry {
    #[inline]
    pub(super) fn new<const N: usize>(step: &Step<N>) -> Self {
        let with_front = |by_direction: &SVector<f64, N>| {
            let mut all = SVector::<f64, 5>::zeros();
            all.fixed_rows_mut::<N>(0).copy_from(by_direction);
            all
        };
        Self {
            rotation: step.rotation,
            start_velocity: step.start_velocity,
            end_velocity: step.end_velocity,
            impact_slip: with_front(&step.contact.impact_slip),
            normal_impulse: step.contact.normal_impulse,
            impulse: with_front(&step.contact.impulse),
            pattern: step.contact.pattern,
        }
    }
}
