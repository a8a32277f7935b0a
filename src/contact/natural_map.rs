//! The natural map of the friction law, (27): the residual of every contact solver.
//!
//! `Lambda_i = prox_C(Lambda_i - r_i xi_i)` holds for any r > 0 exactly at a solution: the natural map of the
//! quasi-variational inequality `-xi_i in N_C(Lambda_i)` (Facchinei & Pang 2003), and the tangential part of Alart &
//! Curnier's (1991) map. The normal impulses are affine in the friction, by projection, so there is no normal
//! complementarity and no De Saxce correction. The residual is the largest
//! `|Lambda_i - prox_C(Lambda_i - r_i xi_i)|` over the contacts with r of [`DelassusOperator::prox_step`], relative to the
//! weight's impulse m g dt.

use nalgebra::{SVector, Vector3};

use super::delassus::DelassusOperator;
use super::directions::{AXLE, ROWS, contact_count};
use super::one_step_problem::OneStepProblem;
use super::pattern::{ContactMode, ContactPattern, WheelPattern};
use super::prox::{project_onto_disc, project_onto_half_line};
use super::solution::{ContactImpulse, ContactSolution};
use super::utilization::{WheelFriction, share_of_left};

/// The direction of a slip is undetermined where it shifts the argument of the prox map by less than this share of the
/// friction radius: directions of larger slips are accurate to 2e-12, and for smaller ones the friction radii give the
/// lateral impulses as accurately.
const UNDETERMINED_DIRECTION: f64 = 1e-4;

/// Relative residual of the friction law at given impulses per contact; NaN if a value is NaN.
#[inline]
pub fn residual<const N: usize>(
    operator: &DelassusOperator<N>,
    problem: &OneStepProblem<N>,
    contact_impulse: &[ContactImpulse; 3],
    impact_slip: &SVector<f64, N>,
    normal_impulse: &Vector3<f64>,
) -> f64 {
    let (mut worst, mut sum) = (0.0_f64, 0.0_f64);
    for (contact, &impulse) in contact_impulse.iter().enumerate().take(contact_count::<N>()) {
        let point = prox_argument(operator, contact, impulse, impact_slip);
        let nearest = project_onto_disc(point, friction_radius(operator, contact, normal_impulse));
        let miss = [impulse[0] - nearest[0], impulse[1] - nearest[1]];
        let squared = miss[0] * miss[0] + miss[1] * miss[1];
        worst = if squared > worst { squared } else { worst };
        sum += squared;
    }
    // The sum keeps what is not a number, which the comparisons drop.
    let worst = if sum.is_nan() { sum } else { worst };
    worst.sqrt() / problem.weight_impulse()
}

/// Upper bound of what impulses miss the law by while the wheels' pattern is linear, summed over the contacts, N s; rounding where the pattern
/// is right. Without the roots and divisions of the wheels' prox maps, for which a step would wait. Infinite where a contact does not do
/// what the pattern says, or only just.
///
/// Prox maps do not stretch distances. So an impulse inside its disc, which is its own nearest point, misses by at most `r |xi|`. One
/// against its slip misses nothing on the rim, nor does a longer argument in that direction; off the rim both are as far from
/// those, and what of the slip is across adds r times itself.
#[expect(clippy::inline_always, reason = "a call would take the solution through memory")]
#[inline(always)]
pub(super) fn miss_bound<const N: usize>(
    operator: &DelassusOperator<N>,
    pattern: ContactPattern,
    impulse: &SVector<f64, N>,
    impact_slip: &SVector<f64, N>,
    normal_impulse: &Vector3<f64>,
) -> f64 {
    let radius = |contact: usize| friction_radius(operator, contact, normal_impulse);
    let shift = |contact: usize, row: usize| operator.prox_step()[contact] * impact_slip[row].abs();
    let stuck = |contact: usize| shift(contact, ROWS[contact][0]) + shift(contact, ROWS[contact][1]);
    let sliding = |wheel: usize| {
        let opposes = impulse[wheel] * impact_slip[wheel] <= 0.0;
        if opposes { 2.0 * (impulse[wheel].abs() - radius(wheel)).abs() + shift(wheel, AXLE) } else { f64::INFINITY }
    };
    // What a sticking wheel can still take sideways, squared.
    let spare = |wheel: usize| radius(wheel) * radius(wheel) - impulse[wheel] * impulse[wheel];
    let lateral = impulse[AXLE] * impulse[AXLE];
    let (is_inside, miss) = match pattern.wheels {
        WheelPattern::BothStick => {
            // The square of a sum of roots is at least this.
            let (left, right) = (spare(0), spare(1));
            let less = left.min(right);
            (less >= 0.0 && lateral <= left + right + 2.0 * less, stuck(0) + stuck(1))
        }
        WheelPattern::RightSlips(_) => (lateral <= spare(0), stuck(0) + sliding(1)),
        WheelPattern::LeftSlips(_) => (lateral <= spare(1), stuck(1) + sliding(0)),
        WheelPattern::BothSlip => (false, 0.0),
    };
    let front = if N == 5 { front_miss_bound(operator, pattern.front, impulse, impact_slip, radius(2)) } else { 0.0 };
    if is_inside { miss + front } else { f64::INFINITY }
}

/// The part of the front support.
#[expect(clippy::inline_always, reason = "a call would take vectors through memory")]
#[inline(always)]
fn front_miss_bound<const N: usize>(
    operator: &DelassusOperator<N>,
    mode: ContactMode,
    impulse: &SVector<f64, N>,
    impact_slip: &SVector<f64, N>,
    radius: f64,
) -> f64 {
    let [[x, y], [slip_x, slip_y]] = [impulse, impact_slip].map(|vector| ROWS[2].map(|row| vector[row]));
    let (squared, step) = (x * x + y * y, operator.prox_step()[2]);
    match mode {
        ContactMode::Stick if squared <= radius * radius => step * (slip_x.abs() + slip_y.abs()),
        ContactMode::Slip if x * slip_x + y * slip_y <= 0.0 => {
            let size = squared.sqrt();
            let across = if size > 0.0 { (x * slip_y - y * slip_x).abs() / size } else { 0.0 };
            2.0 * (size - radius).abs() + step * across
        }
        ContactMode::Stick | ContactMode::Slip => f64::INFINITY,
    }
}

/// `Lambda_i - r_i xi_i`.
#[inline]
pub(super) fn prox_argument<const N: usize>(
    operator: &DelassusOperator<N>,
    contact: usize,
    impulse: ContactImpulse,
    impact_slip: &SVector<f64, N>,
) -> [f64; 2] {
    let [longitudinal, lateral] = ROWS[contact];
    let step = operator.prox_step()[contact];
    [impulse[0] - step * impact_slip[longitudinal], impulse[1] - step * impact_slip[lateral]]
}

/// Radius of a contact's friction disc, N s.
#[inline]
pub(super) fn friction_radius<const N: usize>(
    operator: &DelassusOperator<N>,
    contact: usize,
    normal_impulse: &Vector3<f64>,
) -> f64 {
    operator.friction_coefficient()[contact] * project_onto_half_line(normal_impulse[contact])
}

/// Friction impulse per contact (left, right, front) of a solution.
///
/// While both wheels stick, only the sum of their lateral impulses is physical: it is split in proportion to the
/// remaining friction capacity, by convention. Two wheels with slips of undetermined direction share it in the same way:
/// rounding dominates these directions, and their effect is below the accuracy of the solution.
#[inline]
pub fn contact_impulses<const N: usize>(
    operator: &DelassusOperator<N>,
    solution: &ContactSolution<N>,
) -> [ContactImpulse; 3] {
    let ContactSolution { impulse, impact_slip, normal_impulse, .. } = solution;
    let mut pattern = solution.pattern;
    if pattern.wheels == WheelPattern::BothSlip
        && slip_directions_are_undetermined(operator, impact_slip, normal_impulse)
    {
        pattern.wheels = WheelPattern::BothStick;
    }
    split(operator, pattern, impulse, impact_slip, normal_impulse)
}

/// As [`contact_impulses`], but what two sticking wheels share is split so that both keep within their utilisation: what people are shown.
/// Near full friction that has half of the digits, too few to judge a solution by.
pub fn contact_impulses_by_utilization<const N: usize>(
    operator: &DelassusOperator<N>,
    solution: &ContactSolution<N>,
) -> [ContactImpulse; 3] {
    let mut parts = contact_impulses(operator, solution);
    if solution.pattern.wheels == WheelPattern::BothStick {
        let (longitudinal, lateral) = ([solution.impulse[0], solution.impulse[1]], solution.impulse[AXLE]);
        let radius = [0, 1].map(|wheel| friction_radius(operator, wheel, &solution.normal_impulse));
        [parts[0][1], parts[1][1]] = WheelFriction { longitudinal, lateral, radius }.lateral_split();
    }
    parts
}

/// Friction impulse per contact, with the directions of the slips as they are.
#[inline]
pub(super) fn split<const N: usize>(
    operator: &DelassusOperator<N>,
    pattern: ContactPattern,
    impulse: &SVector<f64, N>,
    impact_slip: &SVector<f64, N>,
    normal_impulse: &Vector3<f64>,
) -> [ContactImpulse; 3] {
    let lateral = impulse[AXLE];
    let capacity = |wheel: usize| lateral_capacity(operator, wheel, impulse, normal_impulse);
    let share = |wheel: usize| lateral_share(operator, wheel, impact_slip, normal_impulse);
    let left_lateral = match pattern.wheels {
        WheelPattern::RightSlips(_) => lateral,
        WheelPattern::LeftSlips(_) => 0.0,
        WheelPattern::BothStick => share_of_left(lateral, [capacity(0), capacity(1)]),
        WheelPattern::BothSlip => share_of_left(lateral, [share(0), share(1)]),
    };
    let front = if N == 5 { [impulse[ROWS[2][0]], impulse[ROWS[2][1]]] } else { [0.0, 0.0] };
    [[impulse[0], left_lateral], [impulse[1], lateral - left_lateral], front]
}

/// Whether both wheels slip so slowly that the friction radii determine their shares of the lateral impulse more accurately
/// than the slip directions do.
fn slip_directions_are_undetermined<const N: usize>(
    operator: &DelassusOperator<N>,
    impact_slip: &SVector<f64, N>,
    normal_impulse: &Vector3<f64>,
) -> bool {
    [0, 1].into_iter().all(|wheel| {
        let shift = operator.prox_step()[wheel] * wheel_slip_speed(wheel, impact_slip);
        shift < UNDETERMINED_DIRECTION * friction_radius(operator, wheel, normal_impulse)
    })
}

/// m/s.
#[inline]
fn wheel_slip_speed<const N: usize>(wheel: usize, impact_slip: &SVector<f64, N>) -> f64 {
    (impact_slip[wheel] * impact_slip[wheel] + impact_slip[AXLE] * impact_slip[AXLE]).sqrt()
}

/// What a sticking wheel can still take sideways, N s.
#[inline]
fn lateral_capacity<const N: usize>(
    operator: &DelassusOperator<N>,
    wheel: usize,
    impulse: &SVector<f64, N>,
    normal_impulse: &Vector3<f64>,
) -> f64 {
    let radius = friction_radius(operator, wheel, normal_impulse);
    project_onto_half_line(radius * radius - impulse[wheel] * impulse[wheel]).sqrt()
}

/// Friction radius over slip speed: both wheels share the lateral slip, so this is their share of the lateral impulse.
#[inline]
fn lateral_share<const N: usize>(
    operator: &DelassusOperator<N>,
    wheel: usize,
    impact_slip: &SVector<f64, N>,
    normal_impulse: &Vector3<f64>,
) -> f64 {
    let speed = wheel_slip_speed(wheel, impact_slip);
    if speed > 0.0 { friction_radius(operator, wheel, normal_impulse) / speed } else { 0.0 }
}
