//! How far a point is from a local optimum: the decrease that its linear model promises and the merit confirms.

use nalgebra::DVector;

use super::{RADIUS_FACTOR, SHRINK_RATIO, SMALLEST_RADIUS, Search, SequentialLinearSettings};
use crate::optimizer::evaluation::{Budget, Constraints, Interruption, Linearisation, Problem};
use crate::optimizer::linear_program::ElasticSolver;

/// The result of [`criticality_measure`].
#[derive(Debug, Clone, PartialEq)]
pub struct CriticalityMeasure {
    /// The measure: the predicted decrease.
    pub prediction: f64,
    /// The better point that confirms it, if there is one; or why the measure is only a bound.
    pub better: Result<Option<DVector<f64>>, Interruption>,
    /// The decrease that the linear model promises in the whole first trust region, confirmed or not.
    pub promise: f64,
    /// Where it promises that.
    pub promised_point: DVector<f64>,
    /// The last radius of the trust region.
    pub radius: f64,
    /// The linear model at the point.
    pub model: Linearisation,
    /// Residuals that it counts as none.
    pub accepted: DVector<f64>,
}

/// Criticality measure of a point: the decrease that the linear model predicts within the largest trust region in which
/// the merit confirms a tenth of it. (The usual measure, as in Conn, Gould & Toint, "Trust-Region Methods", 2000, has a
/// fixed radius and no confirmation.)
///
/// Zero at a smooth stationary point. At a kink between contact modes the linear model describes one side only, and the
/// merit does not confirm its decrease; there the trust region, and with it the measure, shrinks to zero. Along a true
/// descent direction the region stays large, and the measure estimates the attainable decrease. Takes about ten rollouts;
/// with fewer the answer is an upper bound of the measure.
///
/// The measure is that of a descent with these settings: from its first radius on, until no more than its smallest prediction is
/// left. What it takes as met counts as met: removing violations that a search accepts is no decrease.
///
/// # Errors
/// When the budget ends before the first linear program is solved, or one is stopped.
pub fn criticality_measure(
    problem: &mut dyn Problem,
    (x, programs): (&DVector<f64>, &mut ElasticSolver),
    settings: &SequentialLinearSettings,
    budget: &mut Budget,
) -> Result<CriticalityMeasure, Interruption> {
    let mut search = Search::new(problem, (x, programs), settings);
    search.linearise(budget)?;
    let within = |value: f64, tolerance: f64| if value.abs() <= tolerance { value } else { 0.0 };
    let Constraints { residual, inequality } = &search.model.constraints;
    let residual = residual.map(|value| within(value, settings.feasibility_tolerance));
    let inequality = inequality.map(|value| within(value.max(0.0), settings.inequality_tolerance));
    search.offset = Constraints { residual, inequality };
    search.model.constraints.subtract(&search.offset);
    let merit = search.merit(&search.x, &search.model.constraints);
    let (mut step, mut prediction) = search.promised(merit, budget)?;
    let (promise, promised_point) = (prediction, &search.x + &step);
    let better = loop {
        if prediction <= settings.smallest_prediction || search.radius <= SMALLEST_RADIUS {
            break Ok(None);
        }
        // The prediction falls with the radius, so this one is an upper bound of the measure.
        match search.try_step(&step, merit - SHRINK_RATIO * prediction, budget) {
            Ok(trial) if merit - trial.merit >= SHRINK_RATIO * prediction => break Ok(Some(trial.x)),
            Ok(_) => search.radius /= RADIUS_FACTOR,
            Err(interruption) => break Err(interruption),
        }
        (step, prediction) = search.promised(merit, budget)?;
    };
    let Search { radius, model, offset, .. } = search;
    let accepted = offset.residual;
    Ok(CriticalityMeasure { prediction, better, promise, promised_point, radius, model, accepted })
}

impl Search<'_> {
    /// The step of the linear model, and by how much it promises to lower this merit at most.
    fn promised(&mut self, merit: f64, budget: &Budget) -> Result<(DVector<f64>, f64), Interruption> {
        let (step, gap) = self.linear_step(budget)?;
        let prediction = merit - self.modelled_merit(&step) + gap;
        Ok((step, prediction))
    }
}
