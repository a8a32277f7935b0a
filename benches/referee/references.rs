//! References: the fastest plans that long searches of several kinds found for the tuning maneuvers.
//!
//! Each search is written down as soon as it is done, so that a run may be stopped at any time, and the next one goes on. A plan
//! counts after the same tests as the best-known plans of the suite.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use slipdrive::simulation::TorqueSchedule;

use crate::arguments::{ReferencesArguments, TUNING_SEED, selected};
use crate::maneuvers::{Drive, Maneuver, drawn_maneuvers};
use crate::peer;
use crate::program::{Answer, Program, merge};
use crate::suite::{Case, Witness};
use crate::values::digest;

/// Number of the tuning maneuvers.
const COUNT: usize = 100;
/// Most starts that a program takes in one request; longer searches are several requests with seeds of their own.
const MOST_STARTS: u64 = 64;
/// Most rollouts that a program takes.
const ROLLOUT_LIMIT: u64 = 100_000_000;

/// The file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct References {
    /// Seed of the maneuvers.
    seed: u64,
    /// What the searches were asked to leave of the normal force at rest, where they took it from the request.
    normal_load_share: Option<f64>,
    maneuvers: BTreeMap<String, Reference>,
}

/// What is known of one maneuver.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Reference {
    /// Digest of the request: a maneuver of this name that is drawn otherwise has no reference.
    request_digest: String,
    best: Option<Best>,
    /// The searches that were done.
    searches: Vec<String>,
}

/// The fastest plan.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Best {
    final_time_s: f64,
    /// The search that found it.
    found_by: String,
}

/// One search of one maneuver.
struct Search<'a> {
    name: String,
    searcher: Searcher<'a>,
}

enum Searcher<'a> {
    Program {
        program: &'a Program,
        starts: u64,
        seed: u64,
    },
    /// The peer's plan, which the program takes the last step to the goal.
    Peer {
        python: &'a Path,
        program: &'a Program,
    },
}

/// Searches long; every search is saved as soon as it is done.
///
/// # Errors
/// A program that gives no answer, and files.
pub(crate) fn run(arguments: &ReferencesArguments) -> Result<()> {
    let programs = arguments.opponents.programs()?;
    let share = arguments.opponents.load_share;
    let mut references = References::read_or_new(share)?;
    ensure!(references.normal_load_share == share, "the references keep a share of {:?}", references.normal_load_share);
    let searches = searches(arguments, &programs);
    for maneuver in selected(drawn_maneuvers(TUNING_SEED, COUNT, Drive::TorqueLimits), &arguments.filters) {
        let case = Case::new(maneuver.name.clone(), maneuver.request.clone())?;
        for search in &searches {
            if references.entry(&maneuver).searches.contains(&search.name) {
                continue;
            }
            let found = search.found(&maneuver).with_context(|| format!("{} by {}", maneuver.name, search.name))?;
            references.entry(&maneuver).note(&case, &search.name, found);
            references.write()?;
        }
        println!("{:<26} {}", maneuver.name, references.entry(&maneuver).line());
    }
    Ok(())
}

/// All searches that are asked for, the programs' first.
fn searches<'a>(arguments: &'a ReferencesArguments, programs: &'a [Program; 2]) -> Vec<Search<'a>> {
    let requests = arguments.starts.div_ceil(MOST_STARTS);
    let mut searches = Vec::new();
    for program in programs {
        for seed in 0..arguments.seeds * requests {
            let starts = arguments.starts.div_ceil(requests);
            let name = format!("{}, {starts} starts, seed {seed}", program.name);
            searches.push(Search { name, searcher: Searcher::Program { program, starts, seed } });
        }
    }
    if let Some(python) = &arguments.peer {
        let name = format!("CasADi and IPOPT, then {}", programs[0].name);
        searches.push(Search { name, searcher: Searcher::Peer { python, program: &programs[0] } });
    }
    searches
}

impl Search<'_> {
    /// The plan of this search, if the program calls it one.
    fn found(&self, maneuver: &Maneuver) -> Result<Option<TorqueSchedule>> {
        let mut request = maneuver.request.clone();
        let (program, seed) = match &self.searcher {
            Searcher::Program { program, starts, seed } => {
                merge(&mut request, &long_solver(*starts));
                (program, *seed)
            }
            Searcher::Peer { python, program } => {
                let Some(guess) = peer::plan(python, maneuver)? else { return Ok(None) };
                merge(&mut request, &long_solver(1));
                merge(&mut request, &json!({ "initial_guess": guess }));
                (program, 0)
            }
        };
        let answer = program.solve(&request, seed)?.answer.filter(Answer::is_converged);
        Ok(answer.map(|Answer { final_time_s, torque_schedule, .. }| TorqueSchedule {
            final_time: final_time_s,
            left: torque_schedule.left_n_m,
            right: torque_schedule.right_n_m,
        }))
    }
}

fn long_solver(starts: u64) -> Value {
    json!({ "solver": { "starts": starts, "rollout_limit": ROLLOUT_LIMIT } })
}

impl References {
    /// The file, or an empty one for plans that keep this share of the normal force.
    ///
    /// # Errors
    /// A file that cannot be read, or is of other maneuvers.
    fn read_or_new(normal_load_share: Option<f64>) -> Result<Self> {
        let path = path();
        if !path.exists() {
            return Ok(Self { seed: TUNING_SEED, normal_load_share, maneuvers: BTreeMap::new() });
        }
        let text = fs::read_to_string(&path).with_context(|| format!("{} cannot be read", path.display()))?;
        let references: Self =
            serde_json::from_str(&text).with_context(|| format!("{} is malformed", path.display()))?;
        ensure!(references.seed == TUNING_SEED, "{} is of seed {}", path.display(), references.seed);
        Ok(references)
    }

    /// The references for plans that keep this share of the normal force.
    ///
    /// # Errors
    /// A file that cannot be read, or is of other maneuvers.
    pub(crate) fn comparable(normal_load_share: Option<f64>) -> Result<Self> {
        let mut references = Self::read_or_new(normal_load_share)?;
        if references.normal_load_share != normal_load_share {
            references.maneuvers.clear();
        }
        Ok(references)
    }

    /// The best final time known of a maneuver, s.
    pub(crate) fn final_time_of(&self, maneuver: &Maneuver) -> Option<f64> {
        let reference = self.maneuvers.get(&maneuver.name)?;
        let is_of_this_draw = reference.request_digest == digest_of(maneuver);
        reference.best.as_ref().filter(|_| is_of_this_draw).map(|best| best.final_time_s)
    }

    /// What is known of a maneuver; nothing at first, nor of another draw.
    fn entry(&mut self, maneuver: &Maneuver) -> &mut Reference {
        let request_digest = digest_of(maneuver);
        let entry = self.maneuvers.entry(maneuver.name.clone()).or_default();
        if entry.request_digest != request_digest {
            *entry = Reference { request_digest, ..Reference::default() };
        }
        entry
    }

    fn write(&self) -> Result<()> {
        let path = path();
        let unfinished = path.with_extension("unfinished");
        fs::write(&unfinished, serde_json::to_string_pretty(self)? + "\n")?;
        fs::rename(&unfinished, &path).with_context(|| format!("{} cannot be written", path.display()))
    }
}

impl Reference {
    /// Notes that a search is done, and its plan where that is the fastest and stands the tests.
    fn note(&mut self, case: &Case, search: &str, plan: Option<TorqueSchedule>) {
        self.searches.push(search.to_owned());
        let is_faster =
            |plan: &TorqueSchedule| self.best.as_ref().is_none_or(|best| plan.final_time < best.final_time_s);
        let Some(plan) = plan.filter(is_faster) else { return };
        match Witness::new(&plan, 0).verify(case) {
            Ok(()) => self.best = Some(Best { final_time_s: plan.final_time, found_by: search.to_owned() }),
            Err(fault) => println!("{}: the plan of {search} does not count: {fault}", case.name),
        }
    }

    fn line(&self) -> String {
        let searches = self.searches.len();
        match &self.best {
            Some(Best { final_time_s, found_by }) => {
                format!("{final_time_s:.6} s after {searches} searches, by {found_by}")
            }
            None => format!("no plan after {searches} searches"),
        }
    }
}

fn digest_of(maneuver: &Maneuver) -> String {
    digest(maneuver.request.to_string())
}

fn path() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "benches", "referee", "references.json"].iter().collect()
}
