//! A program under comparison: a built binary of any commit, and fields that all its requests get.
//!
//! Each solve is a process of its own on one thread, and its CPU time is that of the process without what every process takes
//! to start: the command line is the same in all commits, and nothing of one solve can make the next one faster.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::cpu::children_cpu_time;

/// Exit codes with an answer: what was asked for, and an answer that is not.
const ANSWERED: [i32; 2] = [0, 2];
/// Exit code without an answer, such as that of a solve that the time limit ended before its plan was known.
const FAILED: i32 = 1;
/// Exit code for input that the program refuses.
const REFUSED: i32 = 64;
/// The start of a process is measured this often, and the median counts.
const START_UPS: usize = 21;
/// Status of a plan that is what was asked for.
const CONVERGED: &str = "converged";
/// The longest time limit that a program takes, s: what a search finds should not depend on the machine.
const TIME_LIMIT_S: f64 = 60.0;
/// What stands for the words of an answer that is missing.
const NONE: &str = "none";
/// The resolution of the account: the logarithm of a CPU time is finite.
const LEAST_CPU_TIME: Duration = Duration::from_micros(1);

/// A program and how it is asked.
pub(crate) struct Program {
    path: PathBuf,
    /// The file's name.
    pub(crate) name: String,
    /// Fields that its requests get over those of the maneuver.
    fields: Value,
    /// CPU time of a process that does all but search.
    pub(crate) start_up: Duration,
    /// Whether it takes the least share of the normal force from the request.
    pub(crate) takes_load_share: bool,
}

/// The answer of `slipdrive solve`, as far as every commit writes it.
#[derive(Debug, Deserialize)]
pub(crate) struct Answer {
    status: String,
    stop_reason: String,
    pub(crate) final_time_s: f64,
    pub(crate) torque_schedule: TorqueSchedule,
}

/// The torques of an answer.
#[derive(Debug, Deserialize)]
pub(crate) struct TorqueSchedule {
    pub(crate) left_n_m: Vec<f64>,
    pub(crate) right_n_m: Vec<f64>,
}

/// One solve. An answer may be missing: the program had none, which it told.
pub(crate) struct Solved {
    pub(crate) answer: Option<Answer>,
    pub(crate) cpu_s: f64,
}

/// The figures of one solve.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Run {
    /// `none` without an answer.
    status: String,
    stop_reason: String,
    /// NaN without an answer.
    pub(crate) final_time_s: f64,
    pub(crate) cpu_s: f64,
}

/// What a process left behind.
struct Ended {
    code: Option<i32>,
    output: Vec<u8>,
    error: String,
    cpu_time: Duration,
}

impl Program {
    /// Makes the program's acquaintance: how long it takes to start, and whether it knows `maneuver.limits.normal_load_share`.
    ///
    /// # Errors
    /// A program that cannot be run, or does not answer the simplest requests.
    pub(crate) fn new(path: &Path, fields: Option<&Value>, load_share: Option<f64>) -> Result<Self> {
        let mut all_fields = json!({ "solver": { "time_limit_s": TIME_LIMIT_S } });
        if let Some(fields) = fields {
            merge(&mut all_fields, fields);
        }
        let mut program = Self {
            path: path.to_owned(),
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            fields: all_fields,
            start_up: Duration::ZERO,
            takes_load_share: false,
        };
        program.start_up = program.measured_start_up()?;
        if let Some(share) = load_share {
            program.takes_load_share = program.accepts(&simple_solve(&with_load_share(share)))?;
            if program.takes_load_share {
                merge(&mut program.fields, &with_load_share(share));
            }
        }
        if !program.accepts(&simple_solve(&program.fields))? {
            bail!("{} refuses the fields {}", program.name, program.fields);
        }
        Ok(program)
    }

    /// The figures of a solve with a seed.
    ///
    /// # Errors
    /// A program that breaks down, or refuses the request.
    pub(crate) fn run(&self, request: &Value, seed: u64) -> Result<Run> {
        let Solved { answer, cpu_s } = self.solve(request, seed)?;
        Ok(match answer {
            Some(Answer { status, stop_reason, final_time_s, .. }) => Run { status, stop_reason, final_time_s, cpu_s },
            None => Run { status: NONE.to_owned(), stop_reason: NONE.to_owned(), final_time_s: f64::NAN, cpu_s },
        })
    }

    /// Solves a request with a seed.
    ///
    /// # Errors
    /// A program that breaks down, or refuses the request.
    pub(crate) fn solve(&self, request: &Value, seed: u64) -> Result<Solved> {
        let mut request = request.clone();
        merge(&mut request, &self.fields);
        merge(&mut request, &json!({ "solver": { "seed": seed } }));
        let ended = self.ended(&request)?;
        let cpu_time = ended.cpu_time.saturating_sub(self.start_up).max(LEAST_CPU_TIME);
        let cpu_s = cpu_time.as_secs_f64();
        if ended.code == Some(FAILED) {
            return Ok(Solved { answer: None, cpu_s });
        }
        let output = self.output_of(ended)?;
        let answer = serde_json::from_slice(&output);
        let answer = answer.with_context(|| format!("the answer of {} cannot be read", self.name))?;
        Ok(Solved { answer: Some(answer), cpu_s })
    }

    fn accepts(&self, request: &Value) -> Result<bool> {
        Ok(self.ended(request)?.code != Some(REFUSED))
    }

    /// Without torque there is nothing to search: a solve does all the rest.
    fn measured_start_up(&self) -> Result<Duration> {
        let without_torque = json!({ "maneuver": { "torque_limit_left_n_m": 0.0, "torque_limit_right_n_m": 0.0 } });
        let request = simple_solve(&without_torque);
        let mut times = Vec::with_capacity(START_UPS);
        for _ in 0..START_UPS {
            let ended = self.ended(&request)?;
            times.push(ended.cpu_time);
            self.output_of(ended)?;
        }
        times.sort();
        Ok(times[START_UPS / 2])
    }

    /// What a process wrote that must have answered.
    fn output_of(&self, ended: Ended) -> Result<Vec<u8>> {
        if ended.code.is_some_and(|code| ANSWERED.contains(&code)) {
            return Ok(ended.output);
        }
        bail!("{} broke down or refused (exit code {:?}): {}", self.name, ended.code, ended.error)
    }

    fn ended(&self, request: &Value) -> Result<Ended> {
        let before = children_cpu_time();
        let mut command = Command::new(&self.path);
        command.args(["solve", "-", "--threads", "1", "--json", "-"]);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().with_context(|| format!("{} cannot be run", self.path.display()))?;
        let mut input = child.stdin.take().context("the input is a pipe")?;
        input.write_all(&serde_json::to_vec(request)?)?;
        drop(input);
        let ended = child.wait_with_output()?;
        let error = String::from_utf8_lossy(&ended.stderr).trim().to_owned();
        let cpu_time = children_cpu_time().saturating_sub(before);
        Ok(Ended { code: ended.status.code(), output: ended.stdout, error, cpu_time })
    }
}

impl Answer {
    /// Whether the program calls its plan converged.
    pub(crate) fn is_converged(&self) -> bool {
        self.status == CONVERGED
    }
}

impl Run {
    /// Whether the search was done.
    pub(crate) fn is_finished(&self) -> bool {
        self.stop_reason == "finished"
    }

    /// Whether the program calls its plan converged.
    pub(crate) fn is_converged(&self) -> bool {
        self.status == CONVERGED
    }
}

/// A short drive from one start, with some fields.
fn simple_solve(fields: &Value) -> Value {
    let mut body = json!({ "maneuver": { "goal": { "y_m": 1.0 } }, "grid": { "steps": 200 } });
    merge(&mut body, fields);
    merge(&mut body, &json!({ "solver": { "starts": 1 } }));
    body
}

fn with_load_share(share: f64) -> Value {
    json!({ "maneuver": { "limits": { "normal_load_share": share } } })
}

/// Puts the fields of `patch` over those of `target`, objects within objects.
pub(crate) fn merge(target: &mut Value, patch: &Value) {
    match (target, patch) {
        (Value::Object(target), Value::Object(patch)) => {
            for (field, value) in patch {
                merge(target.entry(field.clone()).or_insert(Value::Null), value);
            }
        }
        (target, patch) => *target = patch.clone(),
    }
}
