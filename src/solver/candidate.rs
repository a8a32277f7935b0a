//! Decisions and their ranking.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::DVector;

use crate::optimizer::CriticalityMeasure;

/// Largest accepted criticality measure, as a share of the final time.
pub(super) const CRITICALITY_TOLERANCE: f64 = 1e-4;
/// Local optima whose final times differ by less than this share count as one.
const DISTINCT_FINAL_TIME: f64 = 1e-3;
/// A plan slower by more than this share is of another kind: an optimum so far behind the best one seldom becomes the best, and a plan of
/// a similar robot or of another grid that loses so much has left its local optimum.
pub(super) const LARGEST_LAG: f64 = 0.05;

/// Plans whose linear model promises less than this share of the final time, twice what `converged` allows, are not polished: hops gain a
/// fifth as much from these.
pub(super) const LEAST_PROMISE: f64 = 2.0 * CRITICALITY_TOLERANCE;

/// A decision with what the search needs to rank it.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub(super) decision: DVector<f64>,
    /// Largest magnitude of its goal errors.
    pub(super) goal_error: f64,
    /// The largest one with which it meets the goal; the same for all candidates of a solve that were judged.
    pub(super) goal_tolerance: f64,
    /// Whether it breaks the limits of the maneuver.
    pub(super) breaks_limits: bool,
    /// The winding of the goal heading that it meets.
    pub(super) goal_heading: Option<f64>,
    /// The fields of limits that it keeps with a share of each to spare, and these shares.
    pub(super) margins: Vec<(&'static str, f64)>,
    /// Its final time and what its violations cost under the law of its last descent, s.
    pub(super) merit: f64,
    /// Its criticality measure, where the search has computed it.
    pub(super) stationarity: Option<Arc<Stationarity>>,
    /// How many starts, and spins of the best plan, led to it.
    pub(super) times_found: usize,
}

/// The criticality measure of a decision.
#[derive(Debug)]
pub(super) struct Stationarity {
    /// Penalty parameter of the goal errors in the merit.
    pub(super) penalty_parameter: f64,
    /// What the merit counts as 1, s.
    pub(super) time_unit: f64,
    pub(super) measure: CriticalityMeasure,
}

impl Candidate {
    /// Not judged yet: it meets no goal and keeps no limits.
    pub(super) fn new(decision: DVector<f64>, goal_heading: Option<f64>) -> Self {
        Self {
            decision,
            goal_error: f64::INFINITY,
            goal_tolerance: 0.0,
            breaks_limits: true,
            goal_heading,
            margins: Vec::new(),
            merit: f64::INFINITY,
            stationarity: None,
            times_found: 1,
        }
    }

    /// As its rollout shows it.
    pub(super) fn judged(self, (goal_error, goal_tolerance): (f64, f64), breaks_limits: bool) -> Self {
        Self { goal_error, goal_tolerance, breaks_limits, ..self }
    }

    /// As found under another problem than the maneuver's own: it may break limits.
    pub(super) fn not_judged(self) -> Self {
        Self { breaks_limits: true, stationarity: None, ..self }
    }

    pub(super) fn final_time(&self) -> f64 {
        self.decision[self.decision.len() - 1]
    }

    pub(super) fn meets_goal(&self) -> bool {
        self.goal_error <= self.goal_tolerance
    }

    /// Whether it meets the goal within the limits.
    pub(super) fn is_feasible(&self) -> bool {
        self.meets_goal() && !self.breaks_limits
    }

    /// Its final time, s, where it is feasible; any plan beats one that is not.
    pub(super) fn time_to_beat(&self) -> f64 {
        if self.is_feasible() { self.final_time() } else { f64::INFINITY }
    }

    /// Whether it is feasible, and so little is promised, by its linear model in the whole first trust region, that it is left as it is: at
    /// a smooth optimum nothing is promised, on a kink what lies behind it.
    pub(super) fn has_no_promise(&self) -> bool {
        self.is_feasible() && self.promised_decrease().is_some_and(|share| share < LEAST_PROMISE)
    }

    /// What its linear model promises, as a share of the final time, where it was measured.
    pub(super) fn promised_decrease(&self) -> Option<f64> {
        let known = self.stationarity.as_ref()?;
        Some(known.time_unit * known.measure.promise / self.final_time())
    }

    /// Whether it is feasible, and faster than another feasible one by more than a share.
    pub(super) fn gains_on(&self, other: &Self, share: f64) -> bool {
        let is_faster = self.final_time() < (1.0 - share) * other.final_time();
        self.is_feasible() && (is_faster || !other.is_feasible())
    }

    /// A feasible one before any other; of two that are, or two that are not, the one that [`is_better`].
    pub(super) fn is_better_than(&self, other: &Self) -> bool {
        let [this, that] = [self, other].map(Self::is_feasible);
        let of = |candidate: &Self| (candidate.final_time(), candidate.goal_error);
        if this == that { is_better(of(self), of(other), self.goal_tolerance) } else { this }
    }
}

/// Whether the first of two points, each with its final time and goal error, is better: the faster one of those that meet the goal, else
/// the one nearer to the goal. A NaN is the worst error.
pub(super) fn is_better((time, error): (f64, f64), (other_time, other_error): (f64, f64), tolerance: f64) -> bool {
    if error <= tolerance && other_error <= tolerance {
        time < other_time
    } else {
        // What meets the goal is nearer to it than what does not.
        error < other_error || (other_error.is_nan() && !error.is_nan())
    }
}

/// Whether a candidate is better than the best one known, if there is one.
pub(super) fn improves(known: Option<&Candidate>, next: &Candidate) -> bool {
    known.is_none_or(|known| next.is_better_than(known))
}

/// Keeps the better of the best one known and another; of equals the earlier one, with the criticality measure of either.
pub(super) fn keep_best(known: &mut Option<Candidate>, next: Option<Candidate>) {
    let Some(next) = next else { return };
    if improves(known.as_ref(), &next) {
        *known = Some(next);
    } else if let Some(known) = known.as_mut().filter(|known| known.decision == next.decision) {
        known.stationarity = next.stationarity.or(known.stationarity.take());
    }
}

pub(super) fn keep_better(best: &mut Candidate, next: Candidate) {
    if next.is_better_than(best) {
        *best = next;
    }
}

/// The groups of sorted optima whose times are nearly equal.
pub(super) fn distinct<T>(optima: &[T], time: impl Fn(&T) -> f64) -> Vec<Range<usize>> {
    let mut groups: Vec<Range<usize>> = Vec::new();
    for (index, optimum) in optima.iter().enumerate() {
        match groups.last_mut() {
            Some(group) if !is_distinct(time(&optima[group.start]), time(optimum)) => group.end += 1,
            Some(_) | None => groups.push(index..index + 1),
        }
    }
    groups
}

/// Whether two final times belong to different optima.
pub(super) fn is_distinct(faster: f64, slower: f64) -> bool {
    slower - faster > DISTINCT_FINAL_TIME * faster
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimizer::{Constraints, Linearisation};

    fn measured(plan: Candidate, decrease: f64) -> Candidate {
        let none = DVector::zeros(0);
        let (accepted, inequality) = (none.clone(), none.clone());
        let (promise, promised_point) = (decrease, none.clone());
        let model = Linearisation::new(Constraints { residual: none, inequality }, 1);
        let (prediction, better, radius) = (0.0, Ok(None), 0.1);
        let measure = CriticalityMeasure { prediction, better, promise, promised_point, radius, model, accepted };
        let stationarity = Some(Arc::new(Stationarity { penalty_parameter: 300.0, time_unit: 1.0, measure }));
        Candidate { stationarity, ..plan }
    }

    #[test]
    fn a_plan_without_promise_is_feasible_and_measured() {
        let plan =
            |goal_error: f64| Candidate::new(DVector::from_element(1, 2.0), None).judged((goal_error, 1e-6), false);
        assert!(measured(plan(0.0), 0.0).has_no_promise());
        assert!(!measured(plan(0.0), 2.0 * LEAST_PROMISE).has_no_promise());
        assert!(!measured(plan(1.0), 0.0).has_no_promise());
        assert!(!plan(0.0).has_no_promise());
    }

    #[test]
    fn a_plan_that_was_noted_before_it_was_measured_is_measured() {
        let plan =
            |final_time: f64| Candidate::new(DVector::from_element(1, final_time), None).judged((0.0, 1e-6), false);
        let measured = |final_time: f64| measured(plan(final_time), 0.0);
        let noted = |plans: &[Candidate]| {
            let mut known = None;
            for plan in plans {
                keep_best(&mut known, Some(plan.clone()));
            }
            known.map(|known| (known.final_time(), known.stationarity.is_some()))
        };
        assert_eq!(noted(&[plan(2.0), measured(2.0)]), Some((2.0, true)));
        assert_eq!(noted(&[measured(2.0), plan(2.0)]), Some((2.0, true)));
        assert_eq!(noted(&[plan(2.0), measured(2.5)]), Some((2.0, false)));
        assert_eq!(noted(&[measured(2.0), plan(1.5)]), Some((1.5, false)));
    }
}
