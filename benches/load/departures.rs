//! Callers who leave long solves in four ways must free their workers, and each answer must reach its own caller.

use std::collections::BTreeMap;
use std::fs;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::Value;
use slipdrive::api::grpc::pb::{self, View};
use slipdrive::api::server::{Connections, ServerSettings};
use slipdrive::api::{ApiSettings, ApiState, grpc, rest};
use slipdrive::jobs::{InProcessSolver, Jobs, Limits, ManeuverSolver};
use slipdrive::motion::{SimulateInput, Simulation};
use slipdrive::service::{Service, ServiceSettings};
use slipdrive::solver::RunControl;
use slipdrive::solver::{Solution, SolveInput};
use slipdrive::stop::{Stop, Stopped};
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio::time::{sleep, sleep_until, timeout};
use tonic_types::StatusExt as _;

use crate::callers::{Addresses, Callers, Question};
use crate::server::listen;
use crate::tally::Latencies;
use crate::verdict::Verdict;

const SEED: u64 = 21;
const DEPARTURES: u32 = 200;
/// Interval between callers; each stays for at most three times as long.
const ARRIVAL_INTERVAL: Duration = Duration::from_millis(100);
const CALLERS: u32 = 64;
const SOLVES: u32 = 1000;
/// Steps of the long solves: long enough for a rollout to stand out from the noise of the clock.
const LONG_STEPS: u32 = 2000;

/// The solver of the crate, with a measurement of how long it runs on after its stop flag.
#[derive(Default)]
struct WatchedSolver {
    /// After a caller has left, and after a deadline, which asks for the best plan so far.
    after_departure: Mutex<Latencies>,
    after_deadline: Mutex<Latencies>,
    /// As the first, in processor time of the worker, which other load on the machine hardly changes. The system counts
    /// it no finer than its tick, some ms.
    processor_after_departure: Mutex<Latencies>,
    /// Processor time of the latest solve.
    processor: Mutex<Duration>,
}

/// Processor time of a thread of this process; zero where the system does not report it.
fn processor_time(thread: &str) -> Duration {
    let text = fs::read_to_string(format!("/proc/{thread}/schedstat")).unwrap_or_default();
    Duration::from_nanos(text.split(' ').next().and_then(|time| time.parse().ok()).unwrap_or_default())
}

impl ManeuverSolver for WatchedSolver {
    fn solve(&self, input: &SolveInput, control: &RunControl<'_>) -> Result<Solution, Stopped> {
        let (has_ended, stop, cut) = (AtomicBool::new(false), control.stop(), control.cut());
        // Such as `1234/task/1235`.
        let this_thread = fs::read_link("/proc/thread-self").unwrap_or_default().display().to_string();
        let begin = processor_time(&this_thread);
        thread::scope(|scope| {
            let watch = scope.spawn(|| {
                while !stop.is_set() && !has_ended.load(Ordering::Relaxed) {
                    thread::sleep(Duration::from_micros(50));
                }
                // A departure sets both flags, a deadline one after the other.
                (Instant::now(), processor_time(&this_thread), cut.is_set())
            });
            let solution = InProcessSolver.solve(input, control);
            has_ended.store(true, Ordering::Relaxed);
            let ended = Instant::now();
            // A yield makes the system update the processor time of this thread.
            thread::yield_now();
            let processor = processor_time(&this_thread);
            *self.processor.lock().unwrap() = processor.saturating_sub(begin);
            let (stopped, processor_when_stopped, has_left) = watch.join().unwrap();
            if stop.is_set() && has_left {
                self.after_departure.lock().unwrap().record(ended.saturating_duration_since(stopped));
                let since = processor.saturating_sub(processor_when_stopped);
                self.processor_after_departure.lock().unwrap().record(since);
            } else if stop.is_set() {
                self.after_deadline.lock().unwrap().record(ended.saturating_duration_since(stopped));
            }
            solution
        })
    }

    fn simulate(&self, input: &SimulateInput, stop: Stop<'_>) -> Result<Simulation, Stopped> {
        InProcessSolver.simulate(input, stop)
    }
}

pub async fn run() -> Verdict {
    let solver = Arc::new(WatchedSolver::default());
    let watched: Arc<dyn ManeuverSolver> = Arc::<WatchedSolver>::clone(&solver);
    // No bound on expected work, so that no caller is refused for the length of the solves before.
    let settings = ServiceSettings { queue_work: Duration::MAX, ..ServiceSettings::default() };
    let service = Arc::new(Service::start(settings).unwrap());
    let jobs = Jobs::new(Limits::default(), watched, service.metrics());
    let state = ApiState::new(Arc::clone(&service), jobs, ApiSettings::default());
    let connections = Connections::of(&state, ServerSettings::default());
    let rest = listen(&connections, rest::router(&state)).await;
    let (grpc_router, _health) = grpc::router(&state).await;
    let callers = Callers::connect(&Addresses { rest, grpc: listen(&connections, grpc_router).await }).await;
    let mut verdict = Verdict::default();
    leave(&callers, &service, &solver, &mut verdict).await;
    ask_all_at_once(&callers, &service, &mut verdict).await;
    verdict
}

/// A solve that goes on until it is stopped.
fn long_solve() -> (String, pb::SolveRequest) {
    let json = serde_json::json!({
        "maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": LONG_STEPS},
        "solver": {"starts": 64, "time_limit_s": 60},
    });
    let goal = pb::Goal { y_m: Some(5.0), ..pb::Goal::default() };
    let message = pb::SolveRequest {
        maneuver: Some(pb::Maneuver { goal: Some(goal), ..pb::Maneuver::default() }),
        grid: Some(pb::SolveGrid { steps: Some(LONG_STEPS), ..pb::SolveGrid::default() }),
        solver: Some(pb::Solver { starts: Some(64), time_limit_s: Some(60.0), ..pb::Solver::default() }),
        ..pb::SolveRequest::default()
    };
    (json.to_string(), message)
}

async fn leave(callers: &Callers, service: &Service, solver: &WatchedSolver, verdict: &mut Verdict) {
    println!("departures: {DEPARTURES} callers leave by close, reset, dropped stream and deadline");
    let alone = Instant::now();
    let solution = callers.grpc(0).solve(long_solve().1).await.unwrap().into_inner().solution.unwrap();
    let alone = alone.elapsed();
    verdict.require("a solve alone takes over 2 s", alone.as_secs_f64() > 2.0, &format!("{alone:.1?}"));
    // The average includes the derivatives and linear programs between the rollouts.
    let rollouts: u32 = solution.report.unwrap().rollouts.try_into().unwrap();
    let (rollout, processor) = (alone / rollouts, *solver.processor.lock().unwrap() / rollouts);
    println!("  one of its rollouts takes {rollout:.2?} on average, {processor:.2?} of processor time");

    let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED);
    let (begin, mut gone) = (Instant::now(), JoinSet::new());
    for number in 0..DEPARTURES {
        sleep_until((begin + number * ARRIVAL_INTERVAL).into()).await;
        let stay = random.random_range(Duration::ZERO..3 * ARRIVAL_INTERVAL);
        gone.spawn(depart(callers.clone(), number, stay));
    }
    let mut ends = BTreeMap::<String, u32>::new();
    while let Some(end) = gone.join_next().await {
        *ends.entry(end.unwrap()).or_default() += 1;
    }
    let last = Instant::now();
    let is_empty = async {
        while service.jobs_in_flight() > 0 {
            sleep(Duration::from_micros(100)).await;
        }
    };
    let is_empty = timeout(Duration::from_secs(5), is_empty).await.is_ok();
    verdict.require("all places are given back", is_empty, &format!("{:.1?} after the last departure", last.elapsed()));
    let is_expected = |end: &String| EXPECTED_ENDS.contains(&end.as_str());
    verdict.require(
        "answers are what a deadline or a full queue gives",
        ends.keys().all(is_expected),
        &format!("{ends:?}"),
    );
    let (departure, deadline) = (solver.after_departure.lock().unwrap(), solver.after_deadline.lock().unwrap());
    let processor = solver.processor_after_departure.lock().unwrap();
    let found = format!("{departure} of {} stopped solves", departure.count());
    let bound = rollout.as_secs_f64() * 1e3;
    verdict.require(
        "a worker is free one rollout after its stop flag (p50)",
        departure.quantile_ms(0.5) <= bound,
        &found,
    );
    println!("    in processor time of the worker, no finer than a tick of the system: {processor}");
    println!("    with the best plan at a deadline, its certificate included: {deadline} of {}", deadline.count());
}

/// How a caller may end: gone without an answer, with the best plan at its deadline, or refused with one of these codes.
const EXPECTED_ENDS: [&str; 5] = [GONE, "deadline", "deadline_exceeded", "deadline_unreachable", "queue_full"];
const GONE: &str = "gone";

/// Sends a long solve and leaves after `stay` in one of four ways; says how it ended.
async fn depart(callers: Callers, number: u32, stay: Duration) -> String {
    let (json, message) = long_solve();
    let mut client = callers.grpc(number.into());
    match number % 4 {
        0 => {
            let address = callers.addresses().rest.trim_start_matches("http://").to_owned();
            let mut stream = TcpStream::connect(address).await.unwrap();
            let head = format!(
                "POST /solve HTTP/1.1\r\nhost: h\r\ncontent-type: application/json\r\ncontent-length: {}\r\n\r\n",
                json.len()
            );
            stream.write_all(format!("{head}{json}").as_bytes()).await.unwrap();
            sleep(stay).await;
            GONE.to_owned()
        }
        1 => timeout(stay, client.solve(message)).await.map_or_else(|_| GONE.to_owned(), end_of),
        2 => {
            let pb::SolveRequest { robot, payload, maneuver, grid, solver, initial_guess, view } = message;
            let request = pb::SolveStreamRequest { robot, payload, maneuver, grid, solver, initial_guess, view };
            match client.solve_stream(request).await {
                Ok(events) => {
                    sleep(stay).await;
                    drop(events);
                    GONE.to_owned()
                }
                Err(status) => code_of(&status),
            }
        }
        _ => {
            // Over REST: clients of gRPC give up by themselves at this time.
            let (deadline, question) = (stay.as_millis() + 1, callers.post(json));
            let answer = question.header("request-timeout-ms", deadline.to_string()).send();
            let answer = timeout(Duration::from_secs(10), answer).await.expect("the deadline is kept").unwrap();
            let body: Value = serde_json::from_slice(&answer.bytes().await.unwrap()).unwrap();
            let told = body["code"].as_str().or(body["stop_reason"].as_str()).unwrap_or("nothing");
            told.to_owned()
        }
    }
}

/// The stop reason of a plan, or the code of a refusal.
fn end_of(answer: Result<tonic::Response<pb::SolveResponse>, tonic::Status>) -> String {
    match answer.map(|response| response.into_inner().solution.unwrap().stop_reason()) {
        Ok(reason) => reason.as_str_name().trim_start_matches("STOP_REASON_").to_lowercase(),
        Err(status) => code_of(&status),
    }
}

fn code_of(status: &tonic::Status) -> String {
    let reason = status.get_details_error_info().map(|info| info.reason.to_lowercase());
    reason.unwrap_or_else(|| format!("{status:?}"))
}

async fn ask_all_at_once(callers: &Callers, service: &Service, verdict: &mut Verdict) {
    println!("answers: {CALLERS} callers with goals of their own, {SOLVES} solves");
    let mut asked = JoinSet::new();
    for caller in 0..CALLERS {
        let callers = callers.clone();
        asked.spawn(async move {
            let goal = 1.0 + 0.05 * f64::from(caller);
            let question = Question::new(goal, View::Plan);
            // The reference: the same solve without load.
            let mut input = SolveInput::forward_drive();
            input.maneuver.goal.set(slipdrive::shooting::StateComponent::Y, Some(goal));
            let expected = slipdrive::solver::solve(&input, &RunControl::unattended()).unwrap().schedule.final_time;
            let (mut own, mut others) = (0, 0);
            for round in (caller..SOLVES).step_by(CALLERS as usize) {
                let final_time = if round % 2 == 0 {
                    let answer = callers.answer_of_rest(&question).await;
                    serde_json::from_slice::<serde_json::Value>(&answer).unwrap()["final_time_s"].as_f64().unwrap()
                } else {
                    let answer = callers.grpc(round.into()).solve(question.message.clone()).await.unwrap();
                    answer.into_inner().solution.unwrap().final_time_s
                };
                if final_time == expected { own += 1 } else { others += 1 }
            }
            (own, others)
        });
    }
    let (mut own, mut others) = (0, 0);
    while let Some(answers) = asked.join_next().await {
        let (to_own, to_others) = answers.unwrap();
        (own, others) = (own + to_own, others + to_others);
    }
    verdict.require("every answer reaches its own caller", own == SOLVES && others == 0, &format!("{own} of {SOLVES}"));
    let in_flight = service.jobs_in_flight();
    verdict.require("nothing is left in flight", in_flight == 0, &format!("{in_flight}"));
}
