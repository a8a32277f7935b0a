//! The result of a contact solver for one step, and values per contact.

use nalgebra::{SVector, Vector3};

use super::pattern::ContactPattern;

/// Friction impulse of one contact: (longitudinal, lateral), N s.
pub type ContactImpulse = [f64; 2];

/// The friction impulses of one step and what follows from them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactSolution<const N: usize> {
    /// Friction impulse per direction, N s; the axle's lateral impulse is the sum of both wheels'.
    pub impulse: SVector<f64, N>,
    /// Impact slip xi per direction, m/s.
    pub impact_slip: SVector<f64, N>,
    /// Raw normal impulses of left wheel, right wheel and front support, N s.
    pub normal_impulse: Vector3<f64>,
    /// Modes of the contacts.
    pub pattern: ContactPattern,
    /// Residual of the natural map, or an upper bound of it, relative to the weight's impulse m g dt.
    pub residual: f64,
}

impl<const N: usize> Default for ContactSolution<N> {
    /// No friction, and so the guess before a first step.
    fn default() -> Self {
        Self {
            impulse: SVector::zeros(),
            impact_slip: SVector::zeros(),
            normal_impulse: Vector3::zeros(),
            pattern: ContactPattern::default(),
            residual: 0.0,
        }
    }
}

/// The three contacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContactName {
    /// The left wheel.
    Left,
    /// The right wheel.
    Right,
    /// The front support.
    Front,
}

impl ContactName {
    /// Left, right, front.
    pub const ALL: [Self; 3] = [Self::Left, Self::Right, Self::Front];

    /// `left`, `right` or `front`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Front => "front",
        }
    }
}

/// One value per contact.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PerContact<T> {
    /// The left wheel's value.
    pub left: T,
    /// The right wheel's value.
    pub right: T,
    /// The front support's value.
    pub front: T,
}

impl<T> PerContact<T> {
    /// From left, right, front.
    pub fn from_array([left, right, front]: [T; 3]) -> Self {
        Self { left, right, front }
    }

    /// The value of one contact.
    pub fn get(&self, contact: ContactName) -> &T {
        match contact {
            ContactName::Left => &self.left,
            ContactName::Right => &self.right,
            ContactName::Front => &self.front,
        }
    }

    /// Contacts with their values, in the order left, right, front.
    pub fn iter(&self) -> impl Iterator<Item = (ContactName, &T)> {
        ContactName::ALL.into_iter().map(|contact| (contact, self.get(contact)))
    }

    /// Applies `map` to each value.
    pub fn map<U>(&self, map: impl Fn(&T) -> U) -> PerContact<U> {
        PerContact { left: map(&self.left), right: map(&self.right), front: map(&self.front) }
    }

    /// Sums `value` over the contacts.
    pub fn sum(&self, value: impl Fn(&T) -> f64) -> f64 {
        value(&self.left) + value(&self.right) + value(&self.front)
    }
}
