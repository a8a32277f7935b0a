//! The time of one contact step by the exact solver, over rollouts of drawn robots: median, 99.9 % and slowest, the paths on which
//! the steps are solved, and their residuals. `cargo bench --bench contact_steps -- [robots] [seed]`.

use std::hint::black_box;
use std::time::Instant;

#[path = "contact_steps/draw.rs"]
mod draw;
#[path = "contact_steps/robots.rs"]
mod robots;
#[path = "../src/robot/unlucky.rs"]
mod unlucky;

use draw::{Drawn, Motion};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::contact::{ContactSolution, ExactSolver, SolvePath};
use slipdrive::robot::{Robot, RobotParameters};

const STEPS: usize = 30;
/// The least of so many measurements counts: the others had company on their core.
const REPETITIONS: usize = 5;
/// Steps of one measurement of a quick step, which is shorter than a look at the clock.
const QUICK_STEPS: u32 = 8;
/// Motions with larger normal forces, relative to the weight, have blown up on a grid that is too coarse for them.
const BLOWN_UP: f64 = 1e3;

/// One measured step.
struct Row {
    time_ns: f64,
    path: &'static str,
    interior_steps: usize,
    residual: f64,
}

fn main() {
    let numbers: Vec<u64> = std::env::args().skip(1).filter_map(|argument| argument.parse().ok()).collect();
    let (count, seed) = (numbers.first().copied().unwrap_or(10_000), numbers.get(1).copied().unwrap_or(0));
    let mut rows = Vec::new();
    for number in 0..count {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed.wrapping_add(number));
        let robot = match number {
            0 => Robot::new(unlucky::heavy_wheels()).expect("an accepted robot"),
            1 => Robot::new(unlucky::short_track()).expect("an accepted robot"),
            _ => draw::robot(&mut random, number % 2 == 0),
        };
        if robot.parameters().front_friction_coefficient > 0.0 {
            measure::<5>(&robot, &mut random, &mut rows);
        } else {
            measure::<3>(&robot, &mut random, &mut rows);
        }
    }
    print(&mut rows, count);
}

fn measure<const N: usize>(robot: &Robot, random: &mut Xoshiro256PlusPlus, rows: &mut Vec<Row>) {
    let drawn = Drawn::<N>::new(robot);
    let mut motion = Motion::new(robot, random);
    let mut guess = ContactSolution::default();
    for step in 0..STEPS {
        let problem = motion.problem(&drawn, step, random);
        if problem.free_normal.amax() > BLOWN_UP * problem.weight_impulse() {
            break;
        }
        let mut solution = guess;
        let path = ExactSolver.solve(&drawn.operator, &problem, &mut solution);
        let (path, interior_steps) = match path {
            SolvePath::GuessedPattern => ("guessed pattern", 0),
            SolvePath::OtherPattern => ("other pattern", 0),
            SolvePath::InteriorPoint { steps } => ("interior point", steps),
        };
        let mut time_ns = f64::INFINITY;
        for _ in 0..REPETITIONS {
            let start = Instant::now();
            for _ in 0..QUICK_STEPS {
                let mut solution = black_box(guess);
                ExactSolver.solve(black_box(&drawn.operator), black_box(&problem), &mut solution);
                black_box(solution);
            }
            time_ns = time_ns.min(start.elapsed().as_secs_f64() * 1e9 / f64::from(QUICK_STEPS));
        }
        rows.push(Row { time_ns, path, interior_steps, residual: solution.residual });
        guess = solution;
        motion.advance(&drawn, &solution.impulse);
    }
}

fn print(rows: &mut [Row], robots: u64) {
    rows.sort_by(|a, b| a.time_ns.total_cmp(&b.time_ns));
    let all: Vec<&Row> = rows.iter().collect();
    println!("{} contact steps of {robots} robots", all.len());
    print_line("all", &all);
    for path in ["guessed pattern", "other pattern", "interior point"] {
        let of_path: Vec<&Row> = all.iter().copied().filter(|row| row.path == path).collect();
        print_line(path, &of_path);
    }
    if let (Some(median), Some(slowest)) = (all.get(all.len() / 2), all.last()) {
        println!("slowest over median: {:.0}", slowest.time_ns / median.time_ns);
    }
    let most = rows.iter().map(|row| row.interior_steps).max().unwrap_or(0);
    println!("most steps of the interior point: {most}");
}

/// Times and residuals of rows in the order of their times.
fn print_line(name: &str, rows: &[&Row]) {
    let Some(last) = rows.len().checked_sub(1) else { return };
    let at = |thousandth: usize| rows[last * thousandth / 1000].time_ns / 1e3;
    let above = |bound: f64| rows.iter().filter(|row| row.residual.is_nan() || row.residual > bound).count();
    let worst = rows.iter().map(|row| row.residual).fold(0.0, f64::max);
    println!(
        "{name:<16} {:>7} steps  median {:>7.3}  99 % {:>7.3}  99.9 % {:>7.3}  slowest {:>7.3} us  residual worst {worst:.1e}, above 1e-12: {}, 1e-10: {}",
        rows.len(),
        at(500),
        at(990),
        at(999),
        at(1000),
        above(1e-12),
        above(1e-10)
    );
}
