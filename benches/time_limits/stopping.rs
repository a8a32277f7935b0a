//! How long a worker runs on after it is stopped or cut off, in processor time: two robots whose friction is known to be
//! hard to resolve, and random ones, all on the largest grid.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

#[path = "../contact_steps/robots.rs"]
mod robots;
#[path = "../../src/robot/unlucky.rs"]
mod unlucky;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::motion::{SimulateInput, simulate};
use slipdrive::robot::{PerWheel, Robot, RobotParameters, State};
use slipdrive::shooting::{Goal, Maneuver, ManeuverLimits, ReferencePoint};
use slipdrive::simulation::{ContactMethod, TorqueSchedule};
use slipdrive::solver::{
    Phase, ProgressObserver, Refinement, RunControl, SolveInput, SolveParameters, SolveProgress, SolverSettings, solve,
};

const STEPS: usize = 10_000;
const INTERVALS: usize = 100;
/// What the search gets before it is stopped, and any work at most before it is cut off.
const PATIENCE: Duration = Duration::from_millis(200);

/// When a worker was told to end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Moment {
    Simulation,
    Search,
    Certificate,
}

/// Runs all and prints the worst.
pub(crate) fn run(count: u64, seed: u64) {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let known = [("heavy_wheels", unlucky::heavy_wheels()), ("short_track", unlucky::short_track())];
    let accepted = |parameters| Robot::new(parameters).expect("an accepted robot");
    let mut chosen = known.map(|(name, parameters)| (name.to_owned(), accepted(parameters))).to_vec();
    chosen.extend(
        (0..count)
            .map(|number| (format!("random {number}"), robots::accepted(|| robots::spread(&mut random, 1.0, 0.3)))),
    );
    let mut rows = Vec::new();
    for (name, robot) in &chosen {
        let seed = random.random();
        for moment in [Moment::Simulation, Moment::Search, Moment::Certificate] {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
            let after = match moment {
                Moment::Simulation => after_simulation(robot, &mut random),
                Moment::Search | Moment::Certificate => after_solve(robot, moment, &mut random),
            };
            rows.extend(after.map(|after| (moment, after, name.clone())));
        }
    }
    println!("processor time of a worker from its flag to its return, ms, {} robots, {STEPS} steps", chosen.len());
    for moment in [Moment::Simulation, Moment::Search, Moment::Certificate] {
        let mut of: Vec<_> = rows.iter().filter(|(at, ..)| *at == moment).collect();
        of.sort_by_key(|(_, after, _)| *after);
        let ms = |after: Duration| after.as_secs_f64() * 1e3;
        let (Some(median), Some(worst)) = (of.get(of.len() / 2), of.last()) else { continue };
        println!(
            "{moment:<12?} {:>4} stopped  median {:>7.2}  worst {:>7.2} ({})",
            of.len(),
            ms(median.1),
            ms(worst.1),
            worst.2
        );
        for (_, after, name) in of.iter().filter(|(.., name)| !name.starts_with("random")) {
            println!("{:<12} {name:<14} {:>7.2}", "", ms(*after));
        }
    }
}

/// Processor time of a thread of this process, such as `1234/task/1235`.
fn processor_time(thread: &str) -> Duration {
    let text = std::fs::read_to_string(format!("/proc/{thread}/schedstat")).unwrap_or_default();
    Duration::from_nanos(text.split(' ').next().and_then(|time| time.parse().ok()).unwrap_or_default())
}

/// Runs `work` on a thread of its own, then `end`, which ends it; gives the processor time in between, and none if the work
/// was over before.
fn after_flag(work: impl FnOnce() + Send, end: impl FnOnce()) -> Option<Duration> {
    let (sender, receiver) = channel();
    let has_ended = AtomicBool::new(false);
    thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let this = std::fs::read_link("/proc/thread-self").unwrap_or_default().display().to_string();
            sender.send(this.clone()).expect("the main thread listens");
            work();
            has_ended.store(true, Ordering::Release);
            // A yield makes the system update the processor time of this thread.
            thread::yield_now();
            processor_time(&this)
        });
        let thread = receiver.recv().expect("the worker says its name");
        end();
        let (was_over, at_flag) = (has_ended.load(Ordering::Acquire), processor_time(&thread));
        let at_end = worker.join().expect("no panic");
        (!was_over).then(|| at_end.saturating_sub(at_flag))
    })
}

fn after_simulation(robot: &Robot, random: &mut Xoshiro256PlusPlus) -> Option<Duration> {
    let input = SimulateInput {
        robot: robot.clone(),
        bare_robot: *robot.parameters(),
        payload: None,
        reference_point: ReferencePoint::default(),
        start: State::default(),
        limits: ManeuverLimits::default(),
        aisle: None,
        schedule: random_schedule(random),
        step_count: STEPS,
        contact_method: if random.random_bool(0.5) { ContactMethod::FixedPoint } else { ContactMethod::Exact },
    };
    let (flag, patience) = (AtomicBool::new(false), PATIENCE.mul_f64(random.random_range(0.0..1.0)));
    let end = || {
        thread::sleep(patience);
        flag.store(true, Ordering::Relaxed);
    };
    after_flag(|| drop(simulate(&input, (&flag).into())), end)
}

/// Tells when the certificate begins.
struct CertificateBegins(AtomicBool);

impl ProgressObserver for CertificateBegins {
    fn progress(&self, _progress: &SolveProgress) {}

    fn begins(&self, phase: Phase) {
        if phase == Phase::Certificate {
            self.0.store(true, Ordering::Release);
        }
    }
}

fn after_solve(robot: &Robot, moment: Moment, random: &mut Xoshiro256PlusPlus) -> Option<Duration> {
    let mut within = |reach: f64| random.random_range(-reach..reach);
    let goal = Goal::at_rest(within(3.0), within(3.0), within(3.0));
    let maneuver = Maneuver { goal, torque_limit: PerWheel::new(2.0, 2.0), ..Maneuver::forward_drive() };
    let settings = SolverSettings {
        step_count: STEPS,
        control_count: INTERVALS,
        refinement: Refinement::Fixed,
        ..SolverSettings::default()
    };
    let (robot, initial_guess) = (*robot.parameters(), Some(random_schedule(random)));
    let parameters = SolveParameters { robot, maneuver, settings, initial_guess, ..SolveParameters::default() };
    let input = SolveInput::new(parameters).ok()?;
    let [stop, cut] = [const { AtomicBool::new(false) }; 2];
    let observer = CertificateBegins(AtomicBool::new(false));
    let patience = PATIENCE.mul_f64(random.random_range(0.0..1.0));
    let end = || {
        thread::sleep(PATIENCE);
        stop.store(true, Ordering::Relaxed);
        if moment == Moment::Certificate {
            while !observer.0.load(Ordering::Acquire) {
                thread::yield_now();
            }
            thread::sleep(patience);
        }
        cut.store(true, Ordering::Relaxed);
    };
    after_flag(|| drop(solve(&input, &RunControl::new(&stop, &observer).cut_off_by(&cut))), end)
}

fn random_schedule(random: &mut Xoshiro256PlusPlus) -> TorqueSchedule {
    let mut torques = || (0..INTERVALS).map(|_| random.random_range(-2.0..2.0)).collect();
    TorqueSchedule { final_time: 9.1, left: torques(), right: torques() }
}
