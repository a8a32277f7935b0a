//! Warm re-solves: a known plan, a robot that differs by 5 %, and what it costs to adapt the plan to it.
//!
//! Per case: the single start from nothing on the original robot (the cost that warm ones are compared with), the default
//! search there (the known plan), the changed robot from that plan, and the default search on the changed robot (what the
//! warm answer is compared with). CPU times of one thread, the shortest of several runs.

use anyhow::Result;
use serde_json::json;
use slipdrive::simulation::TorqueSchedule;
use slipdrive::solver::{RunControl, solve};
use slipdrive::solver::{Solution, SolveInput, Status};

use crate::arguments::WarmArguments;
use crate::suite::Case;
use crate::timing::shortest_ms;

/// The case that is always in the sample.
const FORWARD_DRIVE: &str = "reference/forward-5m";
/// What a robot's parameter is multiplied by.
const CHANGE: f64 = 1.05;
/// Warm final times within this share of the cold search's agree.
const AGREEMENT: f64 = 0.005;
/// Largest accepted ratio of warm to cold cost.
const COST_RATIO: f64 = 0.2;

/// What is changed.
#[derive(Debug, Clone, Copy)]
enum Change {
    Friction,
    Mass,
}

/// One case, solved cold and warm.
struct Comparison {
    cold_ms: f64,
    warm_ms: f64,
    warm: Solution,
    cold_search: Solution,
}

/// Measures a sample of the cases, spread evenly, and prints a table.
///
/// # Errors
/// A changed robot that the service would refuse.
pub(crate) fn measure(cases: &[Case], arguments: &WarmArguments) -> Result<()> {
    println!(
        "{:<38} {:<8} {:>9} {:>9} {:>7} {:>10} {:>10} {:>8}  warm status",
        "case", "changed", "cold ms", "warm ms", "ratio", "warm s", "cold s", "diff %"
    );
    let mut ratios = Vec::new();
    let mut agreeing = 0;
    for (index, case) in sample(cases, arguments.sample).into_iter().enumerate() {
        let change = if index % 2 == 0 { Change::Friction } else { Change::Mass };
        let comparison = Comparison::of(case, change, arguments.repetitions.get())?;
        comparison.print(&case.name, change);
        ratios.push(comparison.ratio());
        agreeing += usize::from(comparison.agrees());
    }
    ratios.sort_by(f64::total_cmp);
    let cheap = ratios.iter().filter(|ratio| **ratio <= COST_RATIO).count();
    let median = ratios.get(ratios.len() / 2).copied().unwrap_or(f64::NAN);
    println!(
        "\n{} cases: median ratio {median:.3}, largest {:.3}; at most {COST_RATIO} on {cheap}; final times agree on {agreeing}",
        ratios.len(),
        ratios.last().copied().unwrap_or(f64::NAN),
    );
    Ok(())
}

/// The forward drive, and so many of the others, spread evenly.
fn sample(cases: &[Case], count: usize) -> Vec<&Case> {
    let (first, others): (Vec<&Case>, Vec<&Case>) = cases.iter().partition(|case| case.name == FORWARD_DRIVE);
    let count = count.min(others.len());
    first.into_iter().chain((0..count).map(|index| others[index * others.len() / count])).collect()
}

impl Comparison {
    fn of(case: &Case, change: Change, repetitions: usize) -> Result<Self> {
        let original = &case.accepted.input;
        let (_, cold_ms) = shortest_ms(repetitions, || solved(&from_one_start(original, None)));
        let known = solved(original);
        let changed = changed(case, change)?.accepted.input;
        let warm_input = from_one_start(&changed, Some(known.schedule));
        let (warm, warm_ms) = shortest_ms(repetitions, || solved(&warm_input));
        let cold_search = solved(&changed);
        Ok(Self { cold_ms, warm_ms, warm, cold_search })
    }

    fn ratio(&self) -> f64 {
        self.warm_ms / self.cold_ms
    }

    /// How much slower the warm plan is, as a share.
    fn difference(&self) -> f64 {
        self.warm.schedule.final_time / self.cold_search.schedule.final_time - 1.0
    }

    /// A warm plan that is faster than the search agrees as well.
    fn agrees(&self) -> bool {
        self.warm.status == Status::Converged && self.difference() <= AGREEMENT
    }

    fn print(&self, name: &str, change: Change) {
        println!(
            "{name:<38} {:<8} {:>9.2} {:>9.2} {:>7.3} {:>10.4} {:>10.4} {:>+8.2}  {}",
            change.name(),
            self.cold_ms,
            self.warm_ms,
            self.ratio(),
            self.warm.schedule.final_time,
            self.cold_search.schedule.final_time,
            1e2 * self.difference(),
            self.warm.status.as_str(),
        );
    }
}

impl Change {
    fn name(self) -> &'static str {
        match self {
            Self::Friction => "friction",
            Self::Mass => "mass",
        }
    }
}

fn changed(case: &Case, change: Change) -> Result<Case> {
    let robot = case.accepted.input.robot.parameters();
    let (field, value) = match change {
        Change::Friction => ("wheel_friction_coefficient", robot.wheel_friction_coefficient),
        Change::Mass => ("chassis_mass_kg", robot.chassis_mass),
    };
    let mut body = case.body.clone();
    body["robot"][field] = json!(CHANGE * value);
    Case::new(case.name.clone(), body)
}

fn from_one_start(input: &SolveInput, initial_guess: Option<TorqueSchedule>) -> SolveInput {
    let mut input = SolveInput { initial_guess, ..input.clone() };
    input.settings.start_count = 1;
    input
}

fn solved(input: &SolveInput) -> Solution {
    solve(input, &RunControl::unattended()).expect("nothing stops it")
}
