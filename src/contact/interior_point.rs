//! An interior-point method on the friction law, for steps whose pattern is hard to find: sticking, slipping and lifting contacts
//! together, in a bounded number of small linear solves.
//!
//! Maximum dissipation in the friction disc has the Karush-Kuhn-Tucker conditions
//!
//! ```text
//! xi_i + sigma_i Lambda_i = 0,    sigma_i >= 0,    room_i = (rho_i^2 - |Lambda_i|^2) / 2 >= 0,    sigma_i room_i = 0
//! ```
//!
//! with one sliding multiplier `sigma_i` (1/kg) per contact: no slip direction appears, which may turn arbitrarily fast where
//! slips vanish. Stewart & Trinkle (1996) and Anitescu & Potra (1997) use this multiplier for polyhedral cones. Both products
//! are kept equal to a common target that falls to zero, and Newton's step is cut where it would leave the interior (primal-dual
//! interior points, Wright 1997). The radius `rho_i = mu_i (Lambda_N,i + sqrt(Lambda_N,i^2 + 4 kappa)) / 2` is smooth where a
//! contact lifts off; kappa falls with the target.
//!
//! The multipliers and the split of the wheels' lateral impulse are eliminated by hand: each step solves one system in the `N`
//! directions, which stays well conditioned where both wheels stick and their split is not determined.

use nalgebra::{SVector, Vector3};

use super::delassus::DelassusOperator;
use super::directions::{AXLE, ROWS, contact_count};
use super::one_step_problem::OneStepProblem;
use super::pattern::{ContactMode, ContactPattern, SlipSign, WheelPattern};
use super::small_systems::solved;

/// kappa relative to the square of m g dt, per target: larger values blur which contacts lift, smaller ones make kinks of them.
const LIFT_SMOOTHING: f64 = 0.09;
/// Least factor from one target to the next.
const LEAST_FACTOR: f64 = 0.1;
/// Last target: impulses are then accurate to its square root, also where a contact neither sticks nor slips clearly.
const LAST_TARGET: f64 = 1e-26;
/// Share of the way to the boundary of the interior that a step may go.
const SHARE_TO_BOUNDARY: f64 = 0.99;
/// A step may multiply the mean product by this much: more means that the linearisation does not hold so far.
const LARGEST_RISE: f64 = 10.0;
/// Halvings of a step before the path counts as lost.
const HALVING_LIMIT: usize = 20;
/// Shrinking of the first impulses by 0.7 until they are well inside of their discs, which shrink with them.
const START_LIMIT: usize = 30;

/// One contact on the path.
#[derive(Debug, Clone, Copy, Default)]
struct Contact {
    /// Lambda, N s.
    impulse: [f64; 2],
    /// sigma, 1/kg.
    multiplier: f64,
}

/// The friction disc of a contact.
#[derive(Debug, Clone, Copy, Default)]
struct Disc {
    /// rho, N s.
    radius: f64,
    by_normal: f64,
    by_lift_smoothing: f64,
    /// What the impulse leaves of the disc, (N s)^2.
    room: f64,
    /// sigma times room that the step aims at.
    product: f64,
}

/// Slip, normal impulses and discs at one point.
#[derive(Debug, Clone, Copy)]
struct Evaluation<const N: usize> {
    slip: SVector<f64, N>,
    normal: Vector3<f64>,
    discs: [Disc; 3],
}

/// Newton's step of one contact.
#[derive(Debug, Clone, Copy, Default)]
struct Change {
    impulse: [f64; 2],
    multiplier: f64,
    room: f64,
}

/// A point near the central path, with its target.
pub(super) struct InteriorPoint<'a, const N: usize> {
    operator: &'a DelassusOperator<N>,
    problem: &'a OneStepProblem<N>,
    /// m g dt, N s.
    weight: f64,
    contacts: [Contact; 3],
    at: Evaluation<N>,
    /// kappa, (N s)^2, and what it falls to in the next step.
    lift_smoothing: [f64; 2],
    /// Of the products, relative to those of the weight's friction.
    target: f64,
}

impl<'a, const N: usize> InteriorPoint<'a, N> {
    /// Starts with at most half of full friction against the free slip.
    pub(super) fn new(operator: &'a DelassusOperator<N>, problem: &'a OneStepProblem<N>) -> Self {
        let weight = problem.weight_impulse();
        let lift_smoothing = [LIFT_SMOOTHING * weight * weight; 2];
        let at = evaluation(operator, problem, &[Contact::default(); 3], lift_smoothing[0]);
        let mut contacts = [Contact::default(); 3];
        for contact in rubbing(operator) {
            contacts[contact] = first_contact(operator, &at, contact);
        }
        let mut point = Self { operator, problem, weight, contacts, at, lift_smoothing, target: 1.0 };
        for _ in 0..START_LIMIT {
            point.at = evaluation(operator, problem, &point.contacts, lift_smoothing[0]);
            let is_inside = |contact: usize| {
                let Disc { radius, room, .. } = point.at.discs[contact];
                room > 0.1 * radius * radius
            };
            if rubbing(operator).all(is_inside) {
                break;
            }
            for contact in &mut point.contacts {
                contact.impulse = contact.impulse.map(|impulse| 0.7 * impulse);
            }
        }
        point.target = mean_product(&point.contacts, &point.at.discs, &point.scales());
        point
    }

    /// The friction impulse per direction, N s.
    pub(super) fn impulse(&self) -> SVector<f64, N> {
        total(&self.contacts)
    }

    /// A contact sticks where its multiplier is smaller than its room, both relative to their scales.
    pub(super) fn pattern(&self) -> ContactPattern {
        let at = &self.at;
        let sticks = |contact: usize| {
            let Disc { radius, room, .. } = at.discs[contact];
            let multiplier = self.contacts[contact].multiplier * self.operator.prox_step()[contact];
            at.normal[contact] > 0.0 && multiplier * radius * radius < 2.0 * room
        };
        let sign = |wheel: usize| SlipSign::of(-self.contacts[wheel].impulse[0], at.normal[wheel]);
        let front = if N == 5 && sticks(2) { ContactMode::Stick } else { ContactMode::Slip };
        ContactPattern { wheels: WheelPattern::of_sticking([sticks(0), sticks(1)], sign), front }
    }

    /// Goes one Newton step along the path, with one linear solve; none where the path is lost.
    pub(super) fn advance(&mut self) -> Option<()> {
        let scales = self.scales();
        for (disc, scale) in self.at.discs.iter_mut().zip(scales) {
            disc.product = self.target * scale;
        }
        let changes = self.changes()?;
        let (share, contacts, next) = self.step_inside(&changes, &scales)?;
        (self.contacts, self.at) = (contacts, next);
        self.lift_smoothing[0] += share * (self.lift_smoothing[1] - self.lift_smoothing[0]);
        let mean = mean_product(&self.contacts, &self.at.discs, &scales);
        self.target = (mean * (1.0 - share).max(LEAST_FACTOR)).max(LAST_TARGET);
        let lift_smoothing = LIFT_SMOOTHING * self.weight * self.weight * self.target;
        self.lift_smoothing[1] = lift_smoothing.min(self.lift_smoothing[0]);
        Some(())
    }

    /// Scales of the products. Contacts that lift keep larger ones: they are decided last.
    fn scales(&self) -> [f64; 3] {
        let mut scales = [1.0; 3];
        for contact in rubbing(self.operator) {
            let radius = self.operator.friction_coefficient()[contact] * self.weight;
            scales[contact] =
                radius * radius * (radius / self.at.discs[contact].radius).sqrt() / self.operator.prox_step()[contact];
        }
        scales
    }

    /// Newton's step.
    fn changes(&self) -> Option<[Change; 3]> {
        let total = self.total_change()?;
        let slip = self.at.slip + self.operator.delassus() * total;
        let normal_change = self.operator.normal_response() * total;
        let lift_change = self.lift_smoothing[1] - self.lift_smoothing[0];
        // Half the change of the squared radius.
        let growth = |contact: usize| {
            let disc = &self.at.discs[contact];
            disc.radius * (disc.by_normal * normal_change[contact] + disc.by_lift_smoothing * lift_change)
        };
        let mut changes = [Change::default(); 3];
        let lateral = self.lateral_split(&total, [growth(0), growth(1)]);
        for contact in rubbing(self.operator) {
            let [a, b] = ROWS[contact];
            let change = &mut changes[contact];
            change.impulse = [total[a], if b == AXLE { lateral[contact] } else { total[b] }];
            let Contact { impulse: [x, y], multiplier } = self.contacts[contact];
            let disc = &self.at.discs[contact];
            let (squared, along) = (x * x + y * y, x * change.impulse[0] + y * change.impulse[1]);
            change.room = growth(contact) - along;
            // Both equations give it: each is accurate where its divisor is large.
            change.multiplier = if disc.room > 0.5 * squared {
                (disc.product - multiplier * (disc.room + change.room)) / disc.room
            } else {
                -(x * slip[a] + y * slip[b] + multiplier * (squared + along)) / squared
            };
        }
        Some(changes)
    }

    /// Change of the impulse per direction: each contact's is an affine function of the slips and normal impulses.
    fn total_change(&self) -> Option<SVector<f64, N>> {
        let (delassus, normal_response) = (&self.operator.delassus().data.0, self.operator.normal_response());
        let lift_change = self.lift_smoothing[1] - self.lift_smoothing[0];
        let mut rows = [[0.0; N]; N];
        let mut value = SVector::<f64, N>::zeros();
        let mut stiffness = [0.0; N];
        for contact in rubbing(self.operator) {
            let Contact { impulse: [x, y], multiplier } = self.contacts[contact];
            let disc = &self.at.discs[contact];
            let inverse = 1.0 / (disc.room + x * x + y * y);
            let by_slip = inverse / multiplier;
            let mixed = -x * y * by_slip;
            let by_slip = [[(disc.room + y * y) * by_slip, mixed], [mixed, (disc.room + x * x) * by_slip]];
            let by_room = [x * inverse, y * inverse];
            let offset = disc.radius * disc.by_lift_smoothing * lift_change - disc.product / multiplier;
            let [a, b] = ROWS[contact];
            for (axis, row) in ROWS[contact].into_iter().enumerate() {
                let by_normal = by_room[axis] * disc.radius * disc.by_normal;
                for column in 0..N {
                    // The Delassus matrix is symmetric: its columns are its rows.
                    rows[row][column] += by_slip[axis][0] * delassus[a][column]
                        + by_slip[axis][1] * delassus[b][column]
                        - by_normal * normal_response[(contact, column)];
                }
                value[row] +=
                    by_room[axis] * offset - by_slip[axis][0] * self.at.slip[a] - by_slip[axis][1] * self.at.slip[b];
                stiffness[row] += 1.0 / multiplier;
            }
        }
        // Rows of sticking contacts are larger by orders of magnitude.
        for row in 0..N {
            rows[row][row] += 1.0;
            let scale = 1.0 / (1.0 + stiffness[row] * delassus[row][row]);
            rows[row] = rows[row].map(|entry| entry * scale);
            value[row] *= scale;
        }
        solved(&rows, &value)
    }

    /// Changes of the lateral impulses of wheels with friction. Their sum is known, and the lateral slip that they share follows from
    /// it: computed from the sum, since for sticking wheels rounding would dominate it.
    fn lateral_split(&self, total: &SVector<f64, N>, growth: [f64; 2]) -> [f64; 2] {
        let mut at_rest = [0.0; 2];
        let mut by_slip = [0.0; 2];
        for wheel in 0..2 {
            let Contact { impulse: [x, y], multiplier } = self.contacts[wheel];
            let disc = &self.at.discs[wheel];
            let inverse = 1.0 / (disc.room + y * y);
            at_rest[wheel] = y * (growth[wheel] - x * total[wheel] - disc.product / multiplier) * inverse;
            by_slip[wheel] = disc.room * inverse / multiplier;
        }
        let slip = (at_rest[0] + at_rest[1] - total[AXLE]) / (by_slip[0] + by_slip[1]);
        [at_rest[0] - by_slip[0] * slip, at_rest[1] - by_slip[1] * slip]
    }

    /// The largest tried share of the step that stays in the interior and does not raise the products too much.
    fn step_inside(&self, changes: &[Change; 3], scales: &[f64; 3]) -> Option<(f64, [Contact; 3], Evaluation<N>)> {
        let largest_mean = LARGEST_RISE * mean_product(&self.contacts, &self.at.discs, scales).max(self.target);
        let mut share = self.share_to_boundary(changes);
        for _ in 0..HALVING_LIMIT {
            let (contacts, next) = self.moved(changes, share);
            let stays = |contact: usize| next.discs[contact].room > 1e-3 * self.at.discs[contact].room;
            if rubbing(self.operator).all(stays) && mean_product(&contacts, &next.discs, scales) <= largest_mean {
                return Some((share, contacts, next));
            }
            share *= 0.5;
        }
        None
    }

    fn share_to_boundary(&self, changes: &[Change; 3]) -> f64 {
        let mut share = 1.0_f64;
        for (contact, change) in changes.iter().enumerate().take(contact_count::<N>()) {
            let room = self.at.discs[contact].room;
            let multiplier = self.contacts[contact].multiplier;
            for (value, change) in [(room, change.room), (multiplier, change.multiplier)] {
                if change < 0.0 {
                    share = share.min(-SHARE_TO_BOUNDARY * value / change);
                }
            }
        }
        share
    }

    /// A share of the step. A disc is round: an impulse that moves along its edge would leave it, and is drawn in again.
    fn moved(&self, changes: &[Change; 3], share: f64) -> ([Contact; 3], Evaluation<N>) {
        let mut contacts = self.contacts;
        for (contact, change) in contacts.iter_mut().zip(changes) {
            contact.impulse[0] += share * change.impulse[0];
            contact.impulse[1] += share * change.impulse[1];
            contact.multiplier += share * change.multiplier;
        }
        let [from, to] = self.lift_smoothing;
        let lift_smoothing = from + share * (to - from);
        let mut next = evaluation(self.operator, self.problem, &contacts, lift_smoothing);
        let mut is_outside = false;
        for contact in 0..contact_count::<N>() {
            let wanted = self.at.discs[contact].room + share * changes[contact].room;
            let Disc { radius, room, .. } = next.discs[contact];
            if room < 0.5 * wanted {
                let [x, y] = contacts[contact].impulse;
                let squared = radius * radius - 2.0 * wanted;
                let size = (x * x + y * y).sqrt();
                let nearest = if squared > 0.0 { squared.sqrt() } else { 0.5 * radius.min(size) };
                contacts[contact].impulse = [x * nearest / size, y * nearest / size];
                is_outside = true;
            }
        }
        if is_outside {
            next = evaluation(self.operator, self.problem, &contacts, lift_smoothing);
        }
        (contacts, next)
    }
}

/// The contacts with friction. The others have neither multiplier nor room.
fn rubbing<const N: usize>(operator: &DelassusOperator<N>) -> impl Iterator<Item = usize> {
    let friction = operator.friction_coefficient();
    (0..contact_count::<N>()).filter(move |contact| friction[*contact] > 0.0)
}

/// Mean of the products of multiplier and room, relative to their scales; contacts without friction count as zero.
fn mean_product(contacts: &[Contact; 3], discs: &[Disc; 3], scales: &[f64; 3]) -> f64 {
    let mut sum = 0.0;
    for ((contact, disc), scale) in contacts.iter().zip(discs).zip(scales) {
        sum += contact.multiplier * disc.room / scale;
    }
    sum / 3.0
}

fn total<const N: usize>(contacts: &[Contact; 3]) -> SVector<f64, N> {
    let mut total = SVector::zeros();
    for (contact, rows) in contacts.iter().zip(ROWS).take(contact_count::<N>()) {
        total[rows[0]] += contact.impulse[0];
        total[rows[1]] += contact.impulse[1];
    }
    total
}

/// Half of full friction against the slip.
fn first_contact<const N: usize>(operator: &DelassusOperator<N>, at: &Evaluation<N>, contact: usize) -> Contact {
    let slip = ROWS[contact].map(|row| at.slip[row]);
    let multiplier = slip[0].hypot(slip[1]) / at.discs[contact].radius + 1.0 / operator.prox_step()[contact];
    Contact { impulse: slip.map(|slip| -0.5 * slip / multiplier), multiplier }
}

fn evaluation<const N: usize>(
    operator: &DelassusOperator<N>,
    problem: &OneStepProblem<N>,
    contacts: &[Contact; 3],
    lift_smoothing: f64,
) -> Evaluation<N> {
    let impulse = total(contacts);
    let slip = operator.impact_slip(problem, &impulse);
    let normal = operator.normal_impulse(problem, &impulse);
    let mut discs = [Disc::default(); 3];
    for (contact, disc) in discs.iter_mut().enumerate().take(contact_count::<N>()) {
        let (friction, normal) = (operator.friction_coefficient()[contact], normal[contact]);
        let root = (normal * normal + 4.0 * lift_smoothing).sqrt();
        // The same in two ways, each without cancellation.
        let smoothed = if normal > 0.0 { 0.5 * (normal + root) } else { 2.0 * lift_smoothing / (root - normal) };
        let [x, y] = contacts[contact].impulse;
        let (radius, size) = (friction * smoothed, (x * x + y * y).sqrt());
        *disc = Disc {
            radius,
            by_normal: radius / root,
            by_lift_smoothing: friction / root,
            room: 0.5 * (radius - size) * (radius + size),
            product: 0.0,
        };
    }
    Evaluation { slip, normal, discs }
}
