//! Whether the answer of a plan belongs to its request: what the motion, rolled out again, says of it.

use super::{AcceptedPlan, Said};
use crate::contract::message::{EndState, Solution, Status};
use crate::jobs::present::short;
use crate::robot::State;
use crate::service::Stopped;
use crate::shooting::StateComponent;
use crate::simulation::Trajectory;
use crate::solver::SolveInput;

/// Largest difference of the end from what the answer says, in any component: rounding of an interval's length, no more.
const END_TOLERANCE: f64 = 1e-9;
/// The same of plans that are worked on: another processor, C library or version may round otherwise, and no controller keeps more.
const TOLERATED_DIFFERENCE: f64 = 1e-3;

impl AcceptedPlan {
    /// The largest difference of the motion's end from that of the answer, in any component, in their units; not a number
    /// where they cannot be compared.
    pub(in crate::jobs) fn end_difference(&self, motion: &Trajectory) -> f64 {
        self.said_end().map_or(f64::NAN, |end| difference(&motion.end_state, end))
    }

    /// What speaks against the answer, in whole sentences: where it claims the goal, that the motion misses it or takes another
    /// time, and an end that is not the one it states. One that states no end is not contradicted by that.
    pub(in crate::jobs) fn contradictions(&self, motion: &Trajectory) -> Vec<String> {
        self.contradictions_beyond(END_TOLERANCE, motion)
    }

    fn contradictions_beyond(&self, tolerance: f64, motion: &Trajectory) -> Vec<String> {
        let mut found = Vec::new();
        if let Said::Solve(asked, answer) = &self.said
            && claims_goal(answer)
        {
            let goal_tolerance = asked.settings.goal_tolerance + tolerance;
            found.extend(other_goal(largest_goal_error(asked, &motion.end_state), goal_tolerance));
            found.extend(other_time(answer, self.motion.schedule.final_time));
        }
        let end_difference = self.end_difference(motion);
        // What is no number is not near.
        let is_another = end_difference.is_nan() || end_difference > tolerance;
        found.extend((is_another && self.said_end().is_some()).then(|| other_end(end_difference)));
        found
    }

    /// Refuses an answer that does not belong to its request by more than rounding explains.
    pub(in crate::jobs) fn check_belongs(&self, motion: &Trajectory) -> Result<(), Stopped> {
        let found = self.contradictions_beyond(TOLERATED_DIFFERENCE, motion).into_iter().next();
        found.map_or(Ok(()), |found| Err(self.at_fault(&found)))
    }

    /// Refuses a motion that no controller could follow.
    pub(in crate::jobs) fn check_ends(&self, motion: &Trajectory) -> Result<(), Stopped> {
        if motion.diverges() { Err(self.at_fault("The motion diverges, must end.")) } else { Ok(()) }
    }

    fn at_fault(&self, fault: &str) -> Stopped {
        let field = match &self.said {
            Said::Solve(..) => "solve.answer",
            Said::Simulate(_) => "simulate.answer",
        };
        Stopped::Contradicted { field, fault: format!("`{field}`: {fault}") }
    }

    fn said_end(&self) -> Option<EndState> {
        match &self.said {
            Said::Solve(_, answer) => answer.end_state,
            Said::Simulate(answer) => answer.end_state,
        }
    }
}

/// Whether the answer says that the goal is met.
pub(in crate::jobs) fn claims_goal(answer: &Solution) -> bool {
    matches!(answer.status(), Status::Converged | Status::Feasible)
}

/// The field of the goal with the largest error at the end, and that error.
pub(in crate::jobs) fn largest_goal_error(asked: &SolveInput, end: &State) -> (&'static str, f64) {
    let errors = asked.maneuver.goal_error(end);
    let error = |(component, _): (StateComponent, f64)| (component.field(), errors[component.index()].abs());
    let largest = asked.maneuver.goal.constrained().map(error).max_by(|a, b| a.1.total_cmp(&b.1));
    largest.unwrap_or(("goal", 0.0))
}

/// What to say of a motion that misses the goal.
fn other_goal((field, error): (&str, f64), tolerance: f64) -> Option<String> {
    let text = format!(
        "The motion, rolled out again, ends {} away from the goal of the request in {field}: request and answer do not belong \
         together.",
        short(error)
    );
    (error > tolerance).then_some(text)
}

/// What to say of torques that last for another time.
fn other_time(answer: &Solution, time: f64) -> Option<String> {
    let said = answer.final_time_s;
    let text =
        format!("The torques of the answer last {time} s, its final_time_s is {said}: they do not belong together.");
    let agrees = (said - time).abs() <= END_TOLERANCE * time.max(1.0);
    (!agrees).then_some(text)
}

/// What to say of another end; of one that cannot be compared where the difference is no number.
pub(in crate::jobs) fn other_end(end_difference: f64) -> String {
    let found = if end_difference.is_finite() {
        format!("ends {} away from the end_state of the answer", short(end_difference))
    } else {
        "cannot be compared with the end_state of the answer".to_owned()
    };
    format!(
        "The motion, rolled out again from the request and its torques, {found}: request and answer do not belong \
         together, or another version made the answer."
    )
}

/// Largest difference in any component; two values that are no numbers are alike.
fn difference(end: &State, said: EndState) -> f64 {
    let (end, said) = (end.to_vector(), State::from(said).to_vector());
    let of = |end: f64, said: f64| if end.is_finite() || said.is_finite() { (end - said).abs() } else { 0.0 };
    // NaN, which `max` would drop, is the largest, and stays.
    end.zip_map(&said, of).iter().fold(0.0, |worst, &of| if of > worst || of.is_nan() { of } else { worst })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_component_without_a_number_cannot_be_compared() {
        let end = State::default();
        let said = EndState::from(&end);
        assert_eq!(difference(&end, EndState { yaw_rate_rad_s: -0.5, ..said }), 0.5);
        assert!(difference(&end, EndState { x_m: f64::NAN, ..said }).is_nan());
        assert!(difference(&end, EndState { wheel_rate_right_rad_s: f64::NAN, ..said }).is_nan());
    }

    #[test]
    fn two_ends_without_a_number_are_alike() {
        let mut end = State::default();
        end.configuration.x = f64::NAN;
        assert_eq!(difference(&end, EndState { x_m: f64::NAN, ..EndState::from(&State::default()) }), 0.0);
    }
}
