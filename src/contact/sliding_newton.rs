//! Newton in impulses and sliding multipliers, for contacts that slip very slowly.
//!
//! As the slip goes to zero its direction can turn arbitrarily fast, and equations in that direction are useless. Maximum
//! dissipation in the friction disc has the Karush-Kuhn-Tucker conditions below, with one sliding multiplier
//! `sigma_i >= 0` per slipping contact: no slip direction appears, and the equations are smooth also at rest. Stewart &
//! Trinkle (1996) and Anitescu & Potra (1997) use the multiplier of this condition for polyhedral friction cones; there it
//! is the slip speed, here, for the squared radius of the disc, the slip speed over the radius.
//!
//! ```text
//! sticking direction:     xi = 0
//! lengthwise slip:        Lambda_i + sign mu_i Lambda_N,i = 0
//! slipping contact:       xi_i + sigma_i Lambda_i = 0,   |Lambda_i|^2 = (mu_i Lambda_N,i)^2
//! ```
//!
//! A step costs more than with the equations of [`super::mode_equations`], which are used wherever the slip is large
//! enough.

use nalgebra::{SMatrix, SVector, Vector3};

use super::delassus::DelassusOperator;
use super::directions::{AXLE, LEFT, RIGHT, ROWS, contact_count, sticking};
use super::natural_map::friction_radius;
use super::one_step_problem::OneStepProblem;
use super::pattern::{ContactMode, ContactPattern, WheelPattern};
use super::solution::ContactImpulse;

/// Impulses by direction (at most 5), lateral impulse of the left wheel, sliding multiplier of each contact. Unknowns that
/// a pattern does not use stay 0.
const SIZE: usize = 9;
const LEFT_LATERAL: usize = 5;
const MULTIPLIER: [usize; 3] = [6, 7, 8];
/// The starts are close to the solution: more iterations mean that the pattern is wrong.
const NEWTON_LIMIT: usize = 30;
const SMALLEST_SHARE: f64 = 0.05;

type Unknowns = SVector<f64, SIZE>;
/// An impulse as a sum of unknowns with signs.
type ImpulseSum<'a> = &'a [(usize, f64)];

/// The equations of one pattern in one friction problem.
pub(super) struct SlidingNewton<'a, const N: usize> {
    pub(super) operator: &'a DelassusOperator<N>,
    pub(super) problem: &'a OneStepProblem<N>,
    pub(super) pattern: ContactPattern,
}

/// Values of the equations, N s, and their derivatives.
struct Equations {
    value: Unknowns,
    jacobian: SMatrix<f64, SIZE, SIZE>,
}

impl<const N: usize> SlidingNewton<'_, N> {
    /// Iterates from impulses per contact; each impulse whose update was at most `small_update` (N s) is passed to
    /// `accept`, which ends the iteration with `Some`. None when no impulse was accepted or the equations became singular.
    pub(super) fn solve<T>(
        &self,
        start: &[ContactImpulse; 3],
        small_update: f64,
        accept: impl Fn(SVector<f64, N>) -> Option<T>,
    ) -> Option<T> {
        let mut unknowns = self.unknowns(start);
        let mut equations = self.equations(&unknowns);
        for _ in 0..NEWTON_LIMIT {
            let update = equations.jacobian.lu().solve(&equations.value)?;
            let is_small = update.fixed_rows::<N>(0).amax() <= small_update;
            let mut share = 1.0;
            loop {
                let trial = unknowns - update * share;
                let trial_equations = self.equations(&trial);
                let is_better = trial_equations.value.amax() < equations.value.amax();
                if is_small || is_better || share < SMALLEST_SHARE {
                    (unknowns, equations) = (trial, trial_equations);
                    break;
                }
                share *= 0.5;
            }
            if is_small && let Some(accepted) = accept(unknowns.fixed_rows::<N>(0).into_owned()) {
                return Some(accepted);
            }
        }
        None
    }

    fn slips(&self, contact: usize) -> bool {
        match contact {
            0 | 1 => self.pattern.wheels == WheelPattern::BothSlip,
            _ => contact_count::<N>() == 3 && self.pattern.front == ContactMode::Slip,
        }
    }

    /// The sliding multiplier of each contact is the least-squares fit to the start.
    fn unknowns(&self, start: &[ContactImpulse; 3]) -> Unknowns {
        let [left, right, front] = start;
        let mut unknowns = Unknowns::zeros();
        unknowns[LEFT] = left[0];
        unknowns[RIGHT] = right[0];
        unknowns[AXLE] = left[1] + right[1];
        if contact_count::<N>() == 3 {
            (unknowns[ROWS[2][0]], unknowns[ROWS[2][1]]) = (front[0], front[1]);
        }
        let slip = self.operator.impact_slip(self.problem, &unknowns.fixed_rows::<N>(0).into_owned());
        if self.pattern.wheels == WheelPattern::BothSlip {
            unknowns[LEFT_LATERAL] = left[1];
        }
        for (contact, impulse) in start.iter().enumerate().filter(|(contact, _)| self.slips(*contact)) {
            let along = slip[ROWS[contact][0]] * impulse[0] + slip[ROWS[contact][1]] * impulse[1];
            let squared = impulse[0] * impulse[0] + impulse[1] * impulse[1];
            unknowns[MULTIPLIER[contact]] = if squared > 0.0 { (-along / squared).max(0.0) } else { 0.0 };
        }
        unknowns
    }

    fn equations(&self, unknowns: &Unknowns) -> Equations {
        let impulse = unknowns.fixed_rows::<N>(0).into_owned();
        let slip = self.operator.impact_slip(self.problem, &impulse);
        let normal = self.operator.normal_impulse(self.problem, &impulse);
        // An unknown without an equation stays where it is.
        let mut equations = Equations { value: Unknowns::zeros(), jacobian: SMatrix::identity() };
        for (row, sticks) in sticking::<N>(self.pattern).into_iter().enumerate() {
            if sticks {
                self.set_slip(&mut equations, row, row, &slip);
            }
        }
        match self.pattern.wheels {
            WheelPattern::BothStick => {}
            WheelPattern::RightSlips(sign) => {
                self.set_lengthwise(&mut equations, RIGHT, sign.value(), unknowns, &normal);
            }
            WheelPattern::LeftSlips(sign) => {
                self.set_lengthwise(&mut equations, LEFT, sign.value(), unknowns, &normal);
            }
            WheelPattern::BothSlip => self.set_wheels(&mut equations, unknowns, &slip, &normal),
        }
        if self.slips(2) {
            let [longitudinal, lateral] = ROWS[2];
            for row in [longitudinal, lateral] {
                self.set_slip(&mut equations, row, row, &slip);
                Self::add_friction(&mut equations, row, (MULTIPLIER[2], self.step(2)), unknowns, &[(row, 1.0)]);
            }
            self.set_cone(&mut equations, 2, unknowns, &normal, (&[(longitudinal, 1.0)], &[(lateral, 1.0)]));
        }
        equations
    }

    fn set_wheels(
        &self,
        equations: &mut Equations,
        unknowns: &Unknowns,
        slip: &SVector<f64, N>,
        normal: &Vector3<f64>,
    ) {
        // The lateral impulse of the right wheel is what the left one leaves.
        let lateral: [ImpulseSum; 2] = [&[(LEFT_LATERAL, 1.0)], &[(AXLE, 1.0), (LEFT_LATERAL, -1.0)]];
        for (wheel, lateral_row) in [(LEFT, AXLE), (RIGHT, LEFT_LATERAL)] {
            let multiplier = (MULTIPLIER[wheel], self.step(wheel));
            self.set_slip(equations, wheel, wheel, slip);
            Self::add_friction(equations, wheel, multiplier, unknowns, &[(wheel, 1.0)]);
            self.set_slip(equations, lateral_row, AXLE, slip);
            Self::add_friction(equations, lateral_row, multiplier, unknowns, lateral[wheel]);
            self.set_cone(equations, wheel, unknowns, normal, (&[(wheel, 1.0)], lateral[wheel]));
        }
    }

    /// kg, so that slips count like impulses.
    fn step(&self, contact: usize) -> f64 {
        self.operator.prox_step()[contact]
    }

    /// `equation = step xi`.
    fn set_slip(&self, equations: &mut Equations, equation: usize, direction: usize, slip: &SVector<f64, N>) {
        let step = self.step(if direction < AXLE { direction } else { usize::from(direction > AXLE) * 2 });
        equations.value[equation] = step * slip[direction];
        equations.jacobian.row_mut(equation).fill(0.0);
        for column in 0..N {
            equations.jacobian[(equation, column)] = step * self.operator.delassus()[(direction, column)];
        }
    }

    /// Adds `step sigma Lambda` with Lambda a sum of unknowns.
    fn add_friction(
        equations: &mut Equations,
        equation: usize,
        (multiplier, step): (usize, f64),
        unknowns: &Unknowns,
        impulse: ImpulseSum,
    ) {
        let total: f64 = impulse.iter().map(|(index, sign)| sign * unknowns[*index]).sum();
        equations.value[equation] += step * unknowns[multiplier] * total;
        equations.jacobian[(equation, multiplier)] += step * total;
        for (index, sign) in impulse {
            equations.jacobian[(equation, *index)] += step * unknowns[multiplier] * sign;
        }
    }

    /// `Lambda_i + sign mu_i Lambda_N,i`.
    fn set_lengthwise(
        &self,
        equations: &mut Equations,
        wheel: usize,
        sign: f64,
        unknowns: &Unknowns,
        normal: &Vector3<f64>,
    ) {
        let coefficient = sign * self.operator.friction_coefficient()[wheel];
        equations.value[wheel] = unknowns[wheel] + coefficient * normal[wheel];
        for column in 0..N {
            equations.jacobian[(wheel, column)] = coefficient * self.operator.normal_response()[(wheel, column)];
        }
        equations.jacobian[(wheel, wheel)] += 1.0;
    }

    /// `(|Lambda_i|^2 - (mu_i Lambda_N,i)^2) / (2 m g dt)`.
    fn set_cone(
        &self,
        equations: &mut Equations,
        contact: usize,
        unknowns: &Unknowns,
        normal: &Vector3<f64>,
        (longitudinal, lateral): (ImpulseSum, ImpulseSum),
    ) {
        let weight = self.problem.weight_impulse();
        let radius = friction_radius(self.operator, contact, normal);
        let row = MULTIPLIER[contact];
        equations.jacobian.row_mut(row).fill(0.0);
        let mut squared = 0.0;
        for part in [longitudinal, lateral] {
            let total: f64 = part.iter().map(|(index, sign)| sign * unknowns[*index]).sum();
            squared += total * total;
            for (index, sign) in part {
                equations.jacobian[(row, *index)] += sign * total / weight;
            }
        }
        equations.value[row] = (squared - radius * radius) / (2.0 * weight);
        let by_normal = radius * self.operator.friction_coefficient()[contact] / weight;
        for column in 0..N {
            equations.jacobian[(row, column)] -= by_normal * self.operator.normal_response()[(contact, column)];
        }
    }
}
