//! Plans in words: what was found, and why to trust it.

use super::replay_words::replay;
use crate::contact::{ContactName, PROMISED_RESIDUAL};
use crate::contract::message::{
    ChangedParameter, ContactName as NamedContact, LimitUse, LowerBoundAssumption, PlanInWords, Refinement, Report,
    Sensitivity, Separation, SimulateResponse, Solution, Status, StopReason,
};
use crate::jobs::plan::{AcceptedPlan, Said, claims_goal, largest_goal_error, other_end};
use crate::shooting::LIMIT_TOLERANCE;
use crate::simulation::Trajectory;
use crate::solver::{Reason, Refinement as Grid, SolveInput, SolverSettings};

/// The headline where request and answer contradict each other.
const OF_NO_PLAN: &str = "The answer does not belong to its request.";
/// What is said of a motion without an end.
const DIVERGES: &str = "The motion diverges.";
/// How many other optima are named.
const NAMED_OPTIMA: usize = 5;

/// What is said of a plan with this motion.
pub(super) fn of_plan(label: &str, plan: &AcceptedPlan, motion: &Trajectory) -> PlanInWords {
    let mut contradictions = plan.contradictions(motion);
    let (headline, mut details, mut certificate) = match &plan.said {
        Said::Solve(asked, answer) => {
            let error = largest_goal_error(asked, &motion.end_state);
            let headline = if contradictions.is_empty() { headline(answer) } else { OF_NO_PLAN.to_owned() };
            (headline, details(asked, answer, motion), certificate(asked, answer, error))
        }
        Said::Simulate(answer) => (duration(motion), motion_in_words(motion), certificate_of_motion(answer, motion)),
    };
    let end_difference = plan.end_difference(motion);
    // An answer that states no end contradicts nothing, and nothing speaks for it.
    if end_difference.is_nan() && contradictions.is_empty() {
        contradictions.push(other_end(end_difference));
    }
    if !contradictions.is_empty() {
        certificate.clear();
    }
    details.extend(contradictions.iter().map(|contradiction| format!("{contradiction} Nothing is claimed for it.")));
    PlanInWords { label: label.to_owned(), headline, details, certificate, end_difference }
}

/// The outcome, for legends too: the final time, or what is missing.
pub(super) fn outcome(plan: &AcceptedPlan) -> String {
    let time = seconds(plan.motion.schedule.final_time);
    match &plan.said {
        Said::Simulate(_) => format!("{time}, simulated"),
        Said::Solve(_, answer) => match answer.status() {
            Status::Converged if plan.step_count() == 0 => "start is goal".to_owned(),
            Status::Converged => time,
            Status::Feasible => format!("{time}, feasible"),
            Status::NotConverged if exceeds_limit(answer) => "limit exceeded".to_owned(),
            Status::NotConverged => "goal missed".to_owned(),
            Status::Infeasible => "infeasible".to_owned(),
            Status::Unspecified => "without a status".to_owned(),
        },
    }
}

/// Why the goal is missed or a limit exceeded, and that the motion diverges, where that is so.
pub(super) fn fault(plan: &AcceptedPlan, motion: &Trajectory) -> Option<String> {
    let missed = match &plan.said {
        Said::Solve(_, answer) => reason(answer).map(|reason| format!("{} {reason}", headline(answer))),
        Said::Simulate(_) => None,
    };
    let diverges = motion.diverges().then(|| DIVERGES.to_owned());
    let faults: Vec<_> = missed.into_iter().chain(diverges).collect();
    (!faults.is_empty()).then(|| faults.join(" "))
}

fn headline(answer: &Solution) -> String {
    let time = seconds(answer.final_time_s);
    match answer.status() {
        Status::Converged if answer.final_time_s == 0.0 => "The start is the goal: there is nothing to do.".to_owned(),
        Status::Converged if answer.replay_confirmed => format!("The robot reaches its goal in {time}."),
        Status::Converged => format!("The robot reaches its goal in {time}, which no replay in finer steps confirms."),
        Status::Feasible => format!("The robot reaches its goal in {time}, but that is not shown to be optimal."),
        Status::NotConverged if exceeds_limit(answer) => "The goal is met, but a limit is exceeded.".to_owned(),
        Status::NotConverged => "The goal is missed.".to_owned(),
        Status::Infeasible => "The goal is impossible.".to_owned(),
        Status::Unspecified => "The answer has no status.".to_owned(),
    }
}

/// Whether the requirement that is not met is a limit on the way.
fn exceeds_limit(answer: &Solution) -> bool {
    answer.reason.as_ref().is_some_and(|reason| reason.code == Reason::LIMIT_EXCEEDED)
}

/// The requirement that is not met.
fn reason(answer: &Solution) -> Option<String> {
    answer.reason.as_ref().map(|reason| sentence(&reason.message))
}

/// With a full stop, and without the quotes of code.
fn sentence(words: &str) -> String {
    let words = words.trim_end_matches('.');
    format!("{}.", words.replace('`', ""))
}

fn duration(motion: &Trajectory) -> String {
    let time = seconds(motion.time.last().copied().unwrap_or_default());
    format!("Given torques for {time}, integrated in {} steps.", motion.step_count())
}

fn details(asked: &SolveInput, answer: &Solution, motion: &Trajectory) -> Vec<String> {
    let mut details: Vec<_> = reason(answer).into_iter().collect();
    details.extend(motion_in_words(motion));
    let Some(report) = &answer.report else { return details };
    if report.starts_tried > 0 {
        let starts = if report.starts_tried == 1 { "start" } else { "starts" };
        let effort = format!("{} {starts} and {} rollouts", report.starts_tried, report.rollouts);
        let time = short(report.solve_time_s);
        details.push(match answer.stop_reason() {
            StopReason::TimeLimit => format!("The time limit ended the search after {effort}, {time} s."),
            StopReason::Deadline => format!("The deadline of the call ended the search after {effort}, {time} s."),
            StopReason::RolloutLimit => format!("The rollout limit ended the search after {effort}, {time} s."),
            StopReason::Finished | StopReason::Unspecified => {
                format!("The whole search asked for was done: {effort} in {time} s.")
            }
        });
    }
    details.extend(grid(asked, report));
    details
}

/// Where the motion ends, and when the wheels slip.
fn motion_in_words(motion: &Trajectory) -> Vec<String> {
    if motion.step_count() == 0 {
        return Vec::new();
    }
    if motion.diverges() {
        return vec![DIVERGES.to_owned()];
    }
    let end = &motion.end_state.configuration;
    let (x, y, heading) = (rounded(end.x), rounded(end.y), rounded(end.heading));
    vec![format!("It ends at x = {x} m, y = {y} m, heading {heading} rad."), slip(motion)]
}

/// Without a sign where it is zero to the digits shown.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3 + 0.0
}

fn slip(motion: &Trajectory) -> String {
    let wheels = [ContactName::Left, ContactName::Right].map(|wheel| {
        let (spans, time) = (motion.slip_spans(wheel).len(), seconds(motion.slip_time(wheel)));
        let wheel = wheel.as_str();
        match spans {
            0 => format!("the {wheel} wheel never slips"),
            1 => format!("the {wheel} wheel slips once, for {time}"),
            _ => format!("the {wheel} wheel slips {spans} times, for {time}"),
        }
    });
    let [left, right] = wheels;
    format!("T{}; {right}.", &left[1..])
}

fn grid(asked: &SolveInput, report: &Report) -> Option<String> {
    let steps = Some(report.steps).filter(|steps| *steps > 0)?;
    let why = match report.refinement() {
        Refinement::Fixed if matches!(asked.settings.refinement, Grid::Fixed) => "as asked",
        Refinement::WithinTolerance => "chosen so that the replay is within tolerance",
        Refinement::StepLimit => "the finest allowed, on which the replay is still above tolerance",
        Refinement::GoalLost => "since the goal was lost on finer ones",
        Refinement::Interrupted => "since a limit ended the refinement",
        Refinement::NoPlan | Refinement::Unspecified | Refinement::Fixed => return None,
    };
    Some(format!("The grid has {steps} steps, {why}."))
}

fn certificate(asked: &SolveInput, answer: &Solution, error: (&str, f64)) -> Vec<String> {
    let Some(report) = answer.report.as_ref().filter(|_| claims_goal(answer) && answer.final_time_s > 0.0) else {
        return Vec::new();
    };
    let settings = &asked.settings;
    let mut said = vec![goal_met(error, settings)];
    said.push(contact_law(report.worst_contact_residual, report.replay.as_ref().map(|_| report.indeterminate_steps)));
    said.push(loads(report));
    said.push(replay(report, asked));
    said.extend(lower_bound(answer.final_time_s, report));
    said.extend(criticality(report));
    said.extend(report.limits.iter().map(limit_used));
    said.extend(sensitivity(report));
    said.extend(other_optima(answer.final_time_s, report));
    said
}

fn certificate_of_motion(answer: &SimulateResponse, motion: &Trajectory) -> Vec<String> {
    // Steps without numbers keep no law and break none.
    if motion.diverges() {
        return separations(&answer.separations).into_iter().collect();
    }
    let mut said = vec![contact_law(answer.worst_contact_residual, Some(answer.indeterminate_steps))];
    said.push(separations(&answer.separations).unwrap_or_else(|| "Loads: no contact ever has to pull.".to_owned()));
    said.extend(answer.limits.iter().map(limit_used));
    said
}

fn goal_met((field, error): (&str, f64), settings: &SolverSettings) -> String {
    let tolerance = short(settings.goal_tolerance);
    format!("Goal: met in every component within {tolerance}; the largest error is {} ({field}).", short(error))
}

/// Whether the law is kept, and has one solution, where that is known.
fn contact_law(residual: f64, indeterminate_steps: Option<u32>) -> String {
    let verdict = if residual <= PROMISED_RESIDUAL { "kept to rounding" } else { "not kept to rounding" };
    let unique = match indeterminate_steps {
        None => String::new(),
        Some(0) => "; no step was found to have a second solution".to_owned(),
        Some(steps) => format!("; {steps} steps have several solutions"),
    };
    format!(
        "Contact law: Coulomb's law with stick and slip is {verdict}, to {} of the weight{unique}.",
        short(residual)
    )
}

fn loads(report: &Report) -> String {
    if let Some(separations) = separations(&report.separations) {
        return separations;
    }
    let least = report.least_normal_load.as_ref().map(|load| {
        let share = short(100.0 * load.share);
        format!("; the {} carries least, {share} % of the weight at {}", named(load.contact()), seconds(load.time_s))
    });
    format!("Loads: no contact ever has to pull{}.", least.unwrap_or_default())
}

fn separations(separations: &[Separation]) -> Option<String> {
    let first = separations.first()?;
    // One for each contact, in the order of the steps.
    let count = separations.chunk_by(|one, other| one.time_s == other.time_s).count();
    let contact = named(first.contact());
    Some(format!(
        "Loads: in {count} steps a contact would have to pull, first the {contact} at {}: the motion is outside the model.",
        seconds(first.time_s)
    ))
}

fn named(contact: NamedContact) -> &'static str {
    match contact {
        NamedContact::Left => "left wheel",
        NamedContact::Right => "right wheel",
        NamedContact::Front | NamedContact::Unspecified => "front support",
    }
}

fn lower_bound(final_time: f64, report: &Report) -> Option<String> {
    let bound = report.lower_bound_s;
    let why = match report.lower_bound_assumption() {
        LowerBoundAssumption::Unspecified => return None,
        LowerBoundAssumption::Friction => "since friction bounds the acceleration of the centre of mass",
        LowerBoundAssumption::YawFriction => "since friction bounds the yaw acceleration",
        LowerBoundAssumption::DriveTorque => "since torque builds the motion up and friction brakes it",
        LowerBoundAssumption::WheelDrive => "since torque and friction bound the acceleration of each wheel",
        LowerBoundAssumption::Limits => "since limits of the maneuver bound speeds, accelerations or slip",
    };
    let slower = short(100.0 * (final_time / bound - 1.0));
    let gap = if bound > 0.0 { format!("; this plan takes {slower} % longer") } else { String::new() };
    Some(format!("Lower bound: no plan on this grid is faster than {}, {why}{gap}.", seconds(bound)))
}

fn criticality(report: &Report) -> Option<String> {
    // Without a replay the certificate was cut off, and the decrease says nothing.
    report.replay.as_ref()?;
    let signs = match report.switching_sign_violations {
        0 => String::new(),
        1 => "; 1 torque is off the limit at which it would gain".to_owned(),
        count => format!("; {count} torques are off the limit at which they would gain"),
    };
    // Before, a linear program could end a rounding error below zero, and answers are kept in files.
    let decrease = short(report.predicted_decrease_s.max(0.0));
    Some(format!("Criticality: to first order, changed torques gain no more than {decrease} s{signs}."))
}

fn limit_used(used: &LimitUse) -> String {
    let LimitUse { limit, value, largest, time_s, excess, replay_excess } = used;
    let time = seconds(*time_s);
    let verdict = if *excess <= LIMIT_TOLERANCE { "kept" } else { "exceeded" };
    // Of an aisle the report has how far a corner is outside; negative inside. Its excesses are shares of the robot's size.
    if limit.ends_with("keep_in") {
        let place = |outside: f64| {
            let side = if outside > 0.0 { "outside" } else { "inside" };
            format!("{} mm {side}", short(1e3 * outside.abs()))
        };
        let replayed = match replay_excess {
            None => String::new(),
            Some(finer) if *excess != 0.0 => format!(", on the finer grid to {}", place(largest * finer / excess)),
            Some(finer) => format!("; on the finer grid it is {}", if *finer <= 0.0 { "kept too" } else { "exceeded" }),
        };
        return format!("Limit {limit}: {verdict}; at {time} a corner comes to {}{replayed}.", place(*largest));
    }
    let replayed = match replay_excess {
        None => String::new(),
        Some(excess) if *excess <= 0.0 => ", on the finer grid too".to_owned(),
        Some(excess) => format!(" on its own grid, exceeded by {} % on the finer one", short(100.0 * excess)),
    };
    format!("Limit {limit} = {}: {verdict}{replayed}; the largest use is {} at {time}.", short(*value), short(*largest))
}

/// What less friction does to the end; nothing where the answer does not say.
fn sensitivity(report: &Report) -> Option<String> {
    let is_less_friction = |one: &&Sensitivity| one.parameter() == ChangedParameter::Friction && one.change < 0.0;
    let shift = report.sensitivity.iter().find(is_less_friction)?;
    let lifts = if shift.separates { "; on the way a contact lifts, which leaves the model" } else { "" };
    Some(format!(
        "Sensitivity: with {} % less friction the same torques end {} m and {} rad away{lifts}.",
        short(-100.0 * shift.change),
        short(shift.end_shift_m?),
        short(shift.end_shift_rad?),
    ))
}

fn other_optima(final_time: f64, report: &Report) -> Option<String> {
    let optima = &report.distinct_optima;
    let list: Vec<_> =
        optima.iter().take(NAMED_OPTIMA).map(|of| format!("{} ({})", seconds(of.final_time_s), of.count)).collect();
    let more = optima.len().saturating_sub(NAMED_OPTIMA);
    let more = if more > 0 { format!(" and {more} slower ones") } else { String::new() };
    match optima.len() {
        0 => None,
        1 if report.starts_tried == 1 => Some("Other optima: only one start was tried.".to_owned()),
        1 => Some(format!(
            "Other optima: none; {} starts were tried, and {} of them or of their spins led, on the first grid, to this plan.",
            report.starts_tried, optima[0].count
        )),
        count => Some(format!(
            "Other optima: the starts and their spins led, on the first grid, to {count} local optima, by final time and how often \
             found: {}{more}; this plan takes {}. A faster one may exist that no start led to.",
            list.join(", "),
            seconds(final_time)
        )),
    }
}

/// With its unit: to a millisecond, or what is less than ten of them to three digits.
fn seconds(time: f64) -> String {
    if time == 0.0 || time.abs() >= 0.01 { format!("{time:.3} s") } else { format!("{} s", short(time)) }
}

/// Three digits, as short as they can be read.
pub(in crate::jobs) fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 { "0".to_owned() } else { "an unknown number".to_owned() };
    }
    let magnitude = value.abs().log10().floor();
    if !(-4.0..6.0).contains(&magnitude) {
        return scientific(value);
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 6")]
    let decimals = (2.0 - magnitude).max(0.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Such as 1.2e-5: no zeros at the end.
fn scientific(value: f64) -> String {
    let text = format!("{value:.2e}");
    match text.split_once('e') {
        Some((digits, exponent)) => format!("{}e{exponent}", digits.trim_end_matches('0').trim_end_matches('.')),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::message::{DistinctOptimum, Replay};

    #[test]
    fn short_times_keep_their_digits() {
        let times = [0.0, 0.000_132_4, 0.009, 0.01, 2.930_04, 1e-9];
        assert_eq!(times.map(seconds), ["0.000 s", "0.000132 s", "0.009 s", "0.010 s", "2.930 s", "1e-9 s"]);
        let answer = Solution { status: Status::Converged.into(), final_time_s: 0.000_132, ..Solution::default() };
        let said = "The robot reaches its goal in 0.000132 s";
        assert_eq!(headline(&answer), format!("{said}, which no replay in finer steps confirms."));
        assert_eq!(headline(&Solution { replay_confirmed: true, ..answer }), format!("{said}."));
    }

    #[test]
    fn corner_of_an_aisle_is_said_in_its_own_unit_on_both_grids() {
        let limit = "maneuver.keep_in".to_owned();
        let used = LimitUse { limit, largest: -1e-3, excess: -2.5e-3, time_s: 0.5, ..LimitUse::default() };
        let said = |used: &LimitUse| limit_used(used);
        assert_eq!(said(&used), "Limit maneuver.keep_in: kept; at 0.500 s a corner comes to 1 mm inside.");
        let finer = LimitUse { replay_excess: Some(0.43), ..used.clone() };
        let end = "a corner comes to 1 mm inside, on the finer grid to 172 mm outside.";
        assert!(said(&finer).ends_with(end), "{}", said(&finer));
        let on_edge = LimitUse { largest: 0.0, excess: 0.0, ..finer };
        assert!(said(&on_edge).ends_with("0 mm inside; on the finer grid it is exceeded."), "{}", said(&on_edge));
    }

    #[test]
    fn other_optima_are_counted_where_they_were_found() {
        let optimum = |final_time_s, count| DistinctOptimum { final_time_s, count, ..DistinctOptimum::default() };
        let distinct_optima = vec![optimum(2.0, 40), optimum(2.5, 3)];
        let report = Report { starts_tried: 36, distinct_optima, ..Report::default() };
        let said = other_optima(1.9, &report).unwrap();
        let begin = "Other optima: the starts and their spins led, on the first grid, to 2 local optima, by final time and how \
                     often found: 2.000 s (40), 2.500 s (3); this plan takes 1.900 s.";
        assert!(said.starts_with(begin), "{said}");
        let report = Report { switching_sign_violations: 1, replay: Some(Replay::default()), ..report };
        assert!(criticality(&report).unwrap().ends_with("; 1 torque is off the limit at which it would gain."));
    }

    #[test]
    fn numbers_have_three_digits() {
        let numbers = [0.0, 2.0, 0.123_456, 12_345.6, -0.000_5, 1.234e-9, f64::NAN];
        assert_eq!(numbers.map(short), ["0", "2", "0.123", "12346", "-0.0005", "1.23e-9", "an unknown number"]);
        assert_eq!(short(1e-6), "1e-6");
    }
}
