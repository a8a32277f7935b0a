//! The search for best-known plans: far more starts than a service would spend, kept only where they find something better.
//!
//! Half of the starts are the solver's own search, of which the seed perturbs all but the first ten or so. The other half
//! leaves from the best plan itself, with torques perturbed over some stretch, and descends again. Where no plan without
//! separations is known, larger robots and weaker torques are tried for a first one: small maneuvers need a large penalty
//! parameter in their own scale, and a gentle enough maneuver causes no separation.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use anyhow::{Error, Result};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::robot::PerWheel;
use slipdrive::simulation::TorqueSchedule;
use slipdrive::solver::SolveInput;
use slipdrive::solver::{RunControl, solve};

use crate::arguments::{Effort, ImproveArguments};
use crate::scale::{Scale, enlarged, reduced};
use crate::suite::{Case, Witness};

/// Starts per case, if the command line names none.
const DEFAULT_STARTS: usize = 300;
/// Similar maneuvers that are tried for a first plan.
const LARGER: [Scale; 3] = [
    Scale { length: 10.0, gravity: 1.0 },
    Scale { length: 100.0, gravity: 1.0 },
    Scale { length: 100.0, gravity: 100.0 },
];
/// Shares of the torque limits that are tried for a first plan.
const GENTLE: [f64; 6] = [0.8, 0.6, 0.4, 0.25, 0.15, 0.08];
/// Starts of the solver's search in each such case.
const EASED_STARTS: usize = 16;
/// Sizes of the perturbations, as shares of the torque limit.
const HOPS: [f64; 4] = [0.05, 0.2, 0.5, 1.0];
/// Final times of perturbed plans, as shares of the best.
const STRETCHES: std::ops::Range<f64> = 0.95..1.08;
/// Gains below this share are rounding and not worth a change of the file.
const SMALLEST_GAIN: f64 = 1e-9;

/// Searches for better plans of all cases; each case is saved as soon as it is done.
///
/// # Errors
/// Files that cannot be read or written.
pub(crate) fn improve(cases: &[Case], arguments: &ImproveArguments, effort: &Effort) -> Result<()> {
    let starts = effort.starts.unwrap_or(DEFAULT_STARTS);
    let next = AtomicUsize::new(0);
    let work = || -> Result<()> {
        while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
            improve_case(case, starts, arguments)?;
        }
        Ok(())
    };
    thread::scope(|scope| {
        let threads: Vec<_> = (0..effort.threads.get()).map(|_| scope.spawn(work)).collect();
        let outcomes = threads.into_iter().map(|thread| thread.join().unwrap_or_else(|_| Err(Error::msg("a panic"))));
        outcomes.collect()
    })
}

fn improve_case(case: &Case, starts: usize, arguments: &ImproveArguments) -> Result<()> {
    let known = Witness::read(&case.name)?;
    let spent = known.as_ref().map_or(0, |witness| witness.starts);
    if arguments.up_to.is_some_and(|up_to| spent >= up_to) {
        return Ok(());
    }
    let fault = known.as_ref().and_then(|witness| witness.verify(case).err());
    let valid = known.filter(|_| fault.is_none());
    if let Some(fault) = fault {
        println!("{:<38} the plan on file is no witness: {fault}", case.name);
    }
    let mut search = Search { case, best: valid.as_ref().map(Witness::schedule), shortfall: None };
    search.search(starts / 2, arguments.seed);
    if search.best.is_none() {
        search.in_the_large(arguments.seed);
    }
    if search.best.is_none() {
        search.gently(arguments.seed);
    }
    search.hop(starts - starts / 2, arguments.seed);
    let Some(best) = search.best else {
        println!("{:<38} no plan: {}", case.name, search.shortfall.unwrap_or_default());
        return Ok(());
    };
    let spent = spent + starts as u64;
    println!("{:<38} {}  after {spent} starts", case.name, change(valid.as_ref(), best.final_time));
    Witness::new(&best, spent).write(&case.name)
}

fn change(before: Option<&Witness>, after: f64) -> String {
    match before.map(|witness| witness.final_time_s) {
        None => format!("{after:.6} s first"),
        Some(before) if after < before => {
            format!("{after:.6} s was {before:.6} s ({:+.3} %)", 1e2 * (after / before - 1.0))
        }
        Some(_) => format!("{after:.6} s as before"),
    }
}

/// The search on one case.
struct Search<'a> {
    case: &'a Case,
    best: Option<TorqueSchedule>,
    /// Why the last plan that would have been the best is none.
    shortfall: Option<String>,
}

impl Search<'_> {
    /// The solver's own starts.
    fn search(&mut self, starts: usize, seed: u64) {
        let mut input = self.input();
        input.settings.start_count = starts.max(1);
        input.settings.seed = seed;
        self.keep_better(&input);
    }

    /// On larger robots.
    fn in_the_large(&mut self, seed: u64) {
        let limit = self.case.accepted.input.maneuver.torque_limit;
        for scale in LARGER {
            let Some(mut input) = enlarged(&self.input(), scale) else { continue };
            input.settings.start_count = EASED_STARTS;
            input.settings.seed = seed;
            let found = solve(&input, &RunControl::unattended()).expect("nothing stops it").schedule;
            self.keep_if_better(reduced(&found, scale, limit));
        }
    }

    /// Under ever weaker torques, until a plan keeps all contacts.
    fn gently(&mut self, seed: u64) {
        let limit = self.case.accepted.input.maneuver.torque_limit;
        for share in GENTLE {
            let mut input = self.input();
            input.settings.start_count = EASED_STARTS;
            input.settings.seed = seed;
            input.maneuver.torque_limit = PerWheel::new(share * limit.left, share * limit.right);
            self.keep_better(&input);
            if self.best.is_some() {
                return;
            }
        }
    }

    /// From perturbed copies of the best plan.
    fn hop(&mut self, starts: usize, seed: u64) {
        let limit = self.case.accepted.input.maneuver.torque_limit;
        // Each case has a sequence of its own, whichever cases a run selects.
        let name = self.case.name.bytes().fold(seed, |sum, byte| sum.wrapping_mul(31).wrapping_add(u64::from(byte)));
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(name);
        for start in 0..starts {
            let Some(best) = &self.best else { return };
            let mut input = self.input();
            input.settings.start_count = 1;
            input.initial_guess = Some(perturbed(best, HOPS[start % HOPS.len()], limit, &mut rng));
            self.keep_better(&input);
        }
    }

    fn input(&self) -> SolveInput {
        let mut input = self.case.accepted.input.clone();
        input.settings.rollout_limit = u64::MAX;
        input
    }

    fn keep_better(&mut self, input: &SolveInput) {
        self.keep_if_better(solve(input, &RunControl::unattended()).expect("nothing stops it").schedule);
    }

    fn keep_if_better(&mut self, found: TorqueSchedule) {
        let is_better = |best: &TorqueSchedule| found.final_time < best.final_time * (1.0 - SMALLEST_GAIN);
        if !self.best.as_ref().is_none_or(is_better) {
            return;
        }
        match Witness::new(&found, 0).verify(self.case) {
            Ok(()) => self.best = Some(found),
            Err(fault) => self.shortfall = Some(fault.to_string()),
        }
    }
}

/// A plan with random torques added to one stretch of each wheel.
fn perturbed(plan: &TorqueSchedule, size: f64, limit: PerWheel<f64>, rng: &mut Xoshiro256PlusPlus) -> TorqueSchedule {
    let mut plan = plan.clone();
    let count = plan.control_count();
    for (torques, limit) in [(&mut plan.left, limit.left), (&mut plan.right, limit.right)] {
        let (one, other) = (rng.random_range(0..count), rng.random_range(0..count));
        for torque in &mut torques[one.min(other)..=one.max(other)] {
            *torque = (*torque + size * limit * rng.random_range(-1.0..1.0)).clamp(-limit, limit);
        }
    }
    plan.final_time *= rng.random_range(STRETCHES);
    plan
}
