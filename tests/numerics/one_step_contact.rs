//! One-step friction problems: the exact solver against the paper's fixed point on random states, robots and steps.

use nalgebra::{SMatrix, SVector};
use slipdrive::contact::{
    ContactMode, ContactPattern, ContactSolution, DelassusOperator, ExactSolver, FixedPointSolver, OneStepProblem,
    SlipSign, SolvePath, WheelPattern, natural_map,
};
use slipdrive::robot::{BodyVector, Robot, RobotParameters};
use slipdrive::stop::Stop;

use crate::random::RandomCases;

#[path = "../../src/robot/unlucky.rs"]
#[allow(dead_code, reason = "other tests and benches use the other robots")]
mod unlucky;

/// Acceptance of the contact law, relative to m g dt.
const RESIDUAL_TOLERANCE: f64 = 1e-10;
/// Acceptance of the motion: m/s (rad/s) relative to the larger of 1 and the value.
const MOTION_TOLERANCE: f64 = 1e-8;
/// What the fixed point is run to, relative to m g dt.
const CONVERGED: f64 = 1e-13;
const CASE_COUNT: u64 = 10_000;

/// A random step of a random robot, assembled from the robot's own matrices.
#[derive(Clone)]
struct RandomStep<const N: usize> {
    operator: DelassusOperator<N>,
    problem: OneStepProblem<N>,
    start_velocity: BodyVector,
    smooth_change: BodyVector,
    impulse_response: SMatrix<f64, 5, N>,
}

impl<const N: usize> RandomStep<N> {
    fn new(cases: &mut RandomCases, robot: &Robot) -> Self {
        let parameters = robot.parameters();
        let dt = 10.0_f64.powf(cases.between(-4.0, -1.5));
        let speed = if cases.chance(0.3) { 0.0 } else { 10.0_f64.powf(cases.between(-3.0, 0.5)) };
        let state = cases.state(robot, speed.max(1e-9));
        let (sin, cos) = state.configuration.heading.sin_cos();
        let u = state.velocity;
        let start_velocity = BodyVector::from([
            cos * u.x + sin * u.y,
            cos * u.y - sin * u.x,
            u.yaw_rate,
            u.wheel_rate.left,
            u.wheel_rate.right,
        ]);
        let grip = parameters.wheel_friction_coefficient * parameters.total_mass() * 9.81 * parameters.wheel_radius;
        let torque = [cases.between(-1.0, 1.0) * grip, cases.between(-1.0, 1.0) * grip];
        let smooth_change = robot.inverse_mass_matrix() * robot.smooth_force(u.yaw_rate, torque) * dt;
        let projection = robot.normal_force_projection();
        let rates = u.yaw_rate * u.yaw_rate * projection.centrifugal
            + u.yaw_rate * (u.wheel_rate.left + u.wheel_rate.right) * projection.gyroscopic;
        let free = start_velocity * (1.0 + parameters.tangential_restitution) + smooth_change;
        Self {
            operator: DelassusOperator::new(
                robot.delassus().fixed_view::<N, N>(0, 0).into_owned(),
                robot.normal_response().fixed_columns::<N>(0).into_owned(),
                parameters.friction_coefficients(),
            ),
            problem: OneStepProblem {
                free_slip: (robot.tangent_jacobian().matrix() * free).fixed_rows::<N>(0).into_owned(),
                free_normal: (projection.static_force + rates) * dt + projection.velocity_change_map * smooth_change,
            },
            start_velocity,
            smooth_change,
            impulse_response: robot.impulse_response().fixed_columns::<N>(0).into_owned(),
        }
    }

    /// Scales the motion until one sticking wheel's impulse reaches `1 + offset` times its friction radius.
    fn move_to_cone_edge(&mut self, solution: &ContactSolution<N>, offset: f64) {
        let parts = natural_map::contact_impulses(&self.operator, solution);
        let friction = self.operator.friction_coefficient();
        let share =
            |wheel: usize| parts[wheel][0].hypot(parts[wheel][1]) / (friction[wheel] * solution.normal_impulse[wheel]);
        let scale = (1.0 + offset) / share(0).max(share(1)).max(1e-3);
        // The normal impulses stay the same: the free ones make up for the change of the friction impulses.
        self.problem.free_normal += self.operator.normal_response() * solution.impulse * (1.0 - scale);
        self.problem.free_slip *= scale;
    }

    fn end_velocity(&self, impulse: &SVector<f64, N>) -> BodyVector {
        self.start_velocity + self.smooth_change + self.impulse_response * impulse
    }
}

#[derive(Default)]
struct Tally {
    both_stick: u64,
    one_slips: u64,
    both_slip: u64,
    by_interior_point: u64,
    near_cone_edge: u64,
    sweeps: u64,
}

impl Tally {
    fn count<const N: usize>(&mut self, solution: &ContactSolution<N>, path: SolvePath) {
        match solution.pattern.wheels {
            WheelPattern::BothStick => self.both_stick += 1,
            WheelPattern::RightSlips(_) | WheelPattern::LeftSlips(_) => self.one_slips += 1,
            WheelPattern::BothSlip => self.both_slip += 1,
        }
        self.by_interior_point += u64::from(matches!(path, SolvePath::InteriorPoint { .. }));
    }
}

/// Compares both solvers; from a solution that sticks also moves on to the edge of its friction discs.
fn compare<const N: usize>(seed: u64, cases: &mut RandomCases, robot: &Robot, tally: &mut Tally) {
    let mut step = RandomStep::<N>::new(cases, robot);
    let mut solution = ContactSolution::default();
    let path = ExactSolver.solve(&step.operator, &step.problem, &mut solution);
    tally.count(&solution, path);
    assert_same_motion(seed, &step, &solution, tally);
    if solution.pattern.wheels == WheelPattern::BothStick && cases.chance(0.5) {
        // Exactly at the edge the sweeps converge sublinearly and reach no useful answer: stay off by a small share.
        let offset = 10.0_f64.powf(cases.between(-5.0, -1.0)) * if cases.chance(0.5) { 1.0 } else { -1.0 };
        let mut near_edge = step.clone();
        near_edge.move_to_cone_edge(&solution, offset);
        let mut at_edge = solution;
        let path = ExactSolver.solve(&near_edge.operator, &near_edge.problem, &mut at_edge);
        tally.count(&at_edge, path);
        tally.near_cone_edge += 1;
        assert_same_motion(seed, &near_edge, &at_edge, tally);

        step.move_to_cone_edge(&solution, 0.0);
        let mut on_edge = solution;
        ExactSolver.solve(&step.operator, &step.problem, &mut on_edge);
        assert!(on_edge.residual <= RESIDUAL_TOLERANCE, "seed {seed}: residual {} on the edge", on_edge.residual);
    }
}

fn assert_same_motion<const N: usize>(seed: u64, step: &RandomStep<N>, exact: &ContactSolution<N>, tally: &mut Tally) {
    let mut fixed_point = FixedPointSolver::new(2_000_000);
    let slow = fixed_point.solve(&step.operator, &step.problem, &Stop::never());
    tally.sweeps += fixed_point.sweeps();
    assert!(exact.residual <= RESIDUAL_TOLERANCE, "seed {seed}: exact residual {}", exact.residual);
    // What a solver bounds by inequalities or by its equations, worked out.
    let parts = natural_map::contact_impulses(&step.operator, exact);
    let residual =
        natural_map::residual(&step.operator, &step.problem, &parts, &exact.impact_slip, &exact.normal_impulse);
    assert!(residual <= exact.residual.max(1e-12), "seed {seed}: {residual} above {}", exact.residual);
    assert!(slow.residual <= CONVERGED, "seed {seed}: fixed-point residual {}", slow.residual);
    let (a, b) = (step.end_velocity(&exact.impulse), step.end_velocity(&slow.impulse));
    for axis in 0..5 {
        let difference = (a[axis] - b[axis]).abs();
        assert!(
            difference <= MOTION_TOLERANCE * b[axis].abs().max(1.0),
            "seed {seed}, axis {axis}: exact {}, fixed point {} ({:?}, {:?})",
            a[axis],
            b[axis],
            exact.pattern,
            slow.pattern
        );
    }
}

#[test]
fn exact_and_fixed_point_agree_on_random_steps() {
    let mut tally = Tally::default();
    for seed in 0..CASE_COUNT {
        let mut cases = RandomCases::new(seed);
        let robot = cases.robot();
        if robot.parameters().front_friction_coefficient > 0.0 {
            compare::<5>(seed, &mut cases, &robot, &mut tally);
        } else {
            compare::<3>(seed, &mut cases, &robot, &mut tally);
        }
    }
    println!(
        "both stick {}, one slips {}, both slip {}, near the cone's edge {}, found by the interior point {}, mean sweeps {}",
        tally.both_stick,
        tally.one_slips,
        tally.both_slip,
        tally.near_cone_edge,
        tally.by_interior_point,
        tally.sweeps / CASE_COUNT
    );
    assert!(tally.both_stick > 500 && tally.one_slips > 500 && tally.both_slip > 500, "all modes occur");
}

#[test]
fn separated_wheel_carries_no_friction() {
    let mut cases = RandomCases::new(7);
    let robot = cases.robot();
    let mut step = RandomStep::<3>::new(&mut cases, &robot);
    step.problem.free_normal[1] = -10.0 * step.problem.free_normal[0].abs();
    step.problem.free_normal[0] *= 12.0;
    let mut solution = ContactSolution::default();
    ExactSolver.solve(&step.operator, &step.problem, &mut solution);
    assert!(solution.normal_impulse[1] < 0.0);
    assert_eq!(solution.impulse[1], 0.0);
    assert!(solution.residual <= RESIDUAL_TOLERANCE);
}

/// The right wheel's lengthwise friction lowers its own normal impulse by `share` of itself, and raises another contact's.
fn operator_with_own_response(share: f64, other: usize) -> DelassusOperator<3> {
    let mut normal_response = SMatrix::<f64, 3, 3>::zeros();
    normal_response[(1, 1)] = -share;
    normal_response[(other, 1)] = share;
    DelassusOperator::new(SMatrix::identity(), normal_response, [1.0, 1.0, 0.0])
}

#[test]
fn uniqueness_is_proved_up_to_the_edge() {
    // The right wheel's friction shifts its normal impulse to the front support, which has no friction: up to a share of 1,
    // where the normal impulse falls as fast as the friction grows, there is one solution.
    assert!(operator_with_own_response(0.95, 2).has_unique_solutions());
    assert!(!operator_with_own_response(1.0, 2).has_unique_solutions());
}

#[test]
fn where_uniqueness_is_proved_no_other_solution_is_found() {
    let (mut proved, mut open) = (0, 0);
    for seed in 0..CASE_COUNT {
        let mut cases = RandomCases::new(seed);
        let robot = cases.robot();
        let is_unique = if robot.parameters().front_friction_coefficient > 0.0 {
            assert_no_other_solution::<5>(seed, &mut cases, &robot)
        } else {
            assert_no_other_solution::<3>(seed, &mut cases, &robot)
        };
        *(if is_unique { &mut proved } else { &mut open }) += 1;
    }
    println!("proved for {proved} robots, open for {open}");
    assert!(proved > CASE_COUNT / 2, "the proof covers most robots: {proved}");
}

/// Whether it is proved that the robot's steps have one solution; then a random one is tried.
fn assert_no_other_solution<const N: usize>(seed: u64, cases: &mut RandomCases, robot: &Robot) -> bool {
    let RandomStep { operator, problem, .. } = RandomStep::<N>::new(cases, robot);
    let is_unique = operator.has_unique_solutions();
    if is_unique {
        let mut solution = ContactSolution::default();
        ExactSolver.solve(&operator, &problem, &mut solution);
        assert!(!ExactSolver.is_indeterminate(&operator, &problem, &solution), "seed {seed}");
    }
    is_unique
}

#[test]
fn indeterminate_problem_is_flagged() {
    // One wheel whose friction raises its own normal impulse (Painleve): sticking and sliding both solve the step.
    let operator = operator_with_own_response(1.5, 0);
    assert!(!operator.has_unique_solutions());
    let problem = OneStepProblem { free_slip: SVector::from([0.0, 0.2, 0.0]), free_normal: [1.0, -0.05, 0.0].into() };
    let stick = ContactPattern { wheels: WheelPattern::BothStick, ..ContactPattern::default() };
    let mut solution = ContactSolution { pattern: stick, ..ContactSolution::default() };
    ExactSolver.solve(&operator, &problem, &mut solution);
    assert!(ExactSolver.is_indeterminate(&operator, &problem, &solution));
}

/// Met with wheels of 14 kg on a chassis of 10 kg: one wheel slips, or both do, which takes Newton more than 8 steps to find.
#[test]
fn second_motion_that_is_hard_to_find_is_flagged() {
    #[rustfmt::skip]
    let delassus = SMatrix::<f64, 3, 3>::new(
        61.088_44, 0.012_516_13, -0.004_182_695,
        0.012_516_13, 61.0838, 0.003_565_749,
        -0.004_182_695, 0.003_565_749, 0.028_016_91,
    );
    #[rustfmt::skip]
    let response = SMatrix::<f64, 3, 3>::new(
        -0.181_495_4, 0.093_609_2, 1.301_179,
        0.065_052_58, -0.243_021_4, -1.305_565,
        0.116_442_8, 0.149_412_2, 0.004_385_636,
    );
    let operator = DelassusOperator::new(delassus, response, [0.704_589_1, 0.704_589_1, 0.0]);
    let problem = OneStepProblem {
        free_slip: SVector::from([65.089_95, -75.836_55, 0.006_175_145]),
        free_normal: SVector::from([1.542_387, 1.725_168, 0.012_147_71]),
    };
    let mut solution = ContactSolution::default();
    ExactSolver.solve(&operator, &problem, &mut solution);
    assert!(solution.residual <= RESIDUAL_TOLERANCE && solution.normal_impulse.min() > 0.0);
    assert!(ExactSolver.is_indeterminate(&operator, &problem, &solution));
}

/// Derivatives at a solution whose sticking contacts are said to slip, without any slip: against differences of solutions.
///
/// Gives how many wheels stick, or none where a difference meets another pattern.
fn compare_derivatives_without_slip<const N: usize>(
    seed: u64,
    cases: &mut RandomCases,
    robot: &Robot,
) -> Option<usize> {
    let RandomStep { operator, problem, .. } = RandomStep::<N>::new(cases, robot);
    let mut solution = ContactSolution::default();
    ExactSolver.solve(&operator, &problem, &mut solution);
    let sticks = solution.pattern.modes().map(|mode| mode == ContactMode::Stick);
    let rows = [[0, 2], [1, 2], [3, 4]];
    let mut slip = solution.impact_slip;
    for row in rows.iter().zip(sticks).filter(|(_, sticks)| *sticks).flat_map(|(rows, _)| rows) {
        slip[*row] = 0.0;
    }
    let derivative = operator.impulse_derivative(ContactPattern::ALL_SLIP, &slip, &solution.normal_impulse, 0.0);
    // Small enough to stay in the pattern mostly, large enough against rounding.
    let normal_step = 1e-6 * problem.weight_impulse();
    let solved = |change: &dyn Fn(&mut OneStepProblem<N>)| {
        let (mut changed, mut moved) = (problem, solution);
        change(&mut changed);
        ExactSolver.solve(&operator, &changed, &mut moved);
        (moved.pattern == solution.pattern).then_some(moved.impulse)
    };
    let agrees = |of: SVector<f64, N>, above: SVector<f64, N>, below: SVector<f64, N>, step: f64| {
        let difference = (above - below) / (2.0 * step);
        let gap = (of - difference).amax();
        // The differences are of the size of the impulses' rounding, 1e-16 of the weight's, over the step, and its square.
        assert!(gap <= 1e-5 * difference.amax().max(operator.prox_step()[0]), "seed {seed}: {of} {difference}");
    };
    for column in 0..N {
        let step = normal_step / operator.prox_step()[0];
        let [above, below] = [step, -step].map(|step| solved(&|problem| problem.free_slip[column] += step));
        agrees(derivative.by_free_slip.column(column).into_owned(), above?, below?, step);
    }
    for column in 0..3 {
        let [above, below] =
            [normal_step, -normal_step].map(|step| solved(&|problem| problem.free_normal[column] += step));
        agrees(derivative.by_free_normal.column(column).into_owned(), above?, below?, normal_step);
    }
    Some(usize::from(sticks[0]) + usize::from(sticks[1]))
}

#[test]
fn derivatives_without_slip_are_those_of_sticking() {
    let mut compared = [0; 3];
    for seed in 0..1000 {
        let mut cases = RandomCases::new(seed);
        let robot = cases.robot();
        let sticking = if robot.parameters().front_friction_coefficient > 0.0 {
            compare_derivatives_without_slip::<5>(seed, &mut cases, &robot)
        } else {
            compare_derivatives_without_slip::<3>(seed, &mut cases, &robot)
        };
        if let Some(sticking) = sticking {
            compared[sticking] += 1;
        }
    }
    println!("compared with no, one and two sticking wheels: {compared:?}");
    assert!(compared.iter().all(|count| *count > 50), "all modes occur: {compared:?}");
}

/// Met by the search, which likes the edge of the friction cones: the left wheel slips by 2 um/s, and its direction turns
/// too fast for equations in it, while fixed-point sweeps take millions.
#[test]
#[expect(clippy::unreadable_literal, reason = "figures as they were met")]
fn wheels_that_hardly_slip_are_solved() {
    let delassus = SMatrix::<f64, 3, 3>::from_row_slice(&[
        1.9489007724301846,
        -0.060011883541295344,
        -0.057040998217468816,
        -0.060011883541295344,
        1.9489007724301846,
        0.057040998217468816,
        -0.057040998217468816,
        0.057040998217468816,
        0.13012477718360071,
    ]);
    let normal_response = SMatrix::<f64, 3, 3>::from_column_slice(&[
        0.04060209942562887,
        0.03347197464844526,
        -0.07407407407407413,
        0.03347197464844526,
        0.04060209942562887,
        -0.07407407407407413,
        0.21061720142602502,
        -0.21061720142602502,
        0.0,
    ]);
    let operator = DelassusOperator::new(delassus, normal_response, [0.9, 0.9, 0.0]);
    let problem = OneStepProblem {
        free_slip: SVector::from([-0.07672467857963101, 0.07452807024728687, -5.0950331048765785e-6]),
        free_normal: SVector::from([0.049559034705347324, 0.04955871900566147, 0.02792738487371197]),
    };
    let mut solution = ContactSolution::default();
    ExactSolver.solve(&operator, &problem, &mut solution);
    assert!(solution.residual <= 1e-12, "residual {}", solution.residual);
    assert_eq!(solution.pattern.wheels, WheelPattern::BothSlip);
}

/// Met by the search on a slippery floor: both wheels are at the very edge of sticking, and all slips vanish.
#[test]
#[expect(clippy::unreadable_literal, reason = "figures as they were met")]
fn steps_at_the_very_edge_of_sticking_are_solved() {
    let slippery = RobotParameters { wheel_friction_coefficient: 0.15, ..RobotParameters::default() };
    let operator = wheels_operator(slippery);
    let met = [
        (
            [-0.00045835656075127965, 0.00020633212324637235, -2.1559730940638733e-9],
            [0.002196301638257598, 0.0016163307636829097, 0.0010424383310242],
        ),
        (
            [-0.025793805320437835, -0.004692566032197776, -0.0009160449875594224],
            [0.12321575018050276, 0.09054760799214018, 0.059710393997627724],
        ),
        (
            [-0.03150256043098665, 0.016415302103229064, -8.805129871735512e-7],
            [0.1516705969698519, 0.11156386834633922, 0.07250494764006218],
        ),
    ];
    for (free_slip, free_normal) in met {
        let problem = OneStepProblem { free_slip: SVector::from(free_slip), free_normal: free_normal.into() };
        let mut solution = ContactSolution::default();
        ExactSolver.solve(&operator, &problem, &mut solution);
        assert!(solution.residual <= RESIDUAL_TOLERANCE, "residual {}", solution.residual);
    }
}

/// Met by the search on a grippy floor: slips of 1e-10 m/s, of which rounding blurs the directions.
#[test]
#[expect(clippy::unreadable_literal, reason = "figures as they were met")]
fn hardly_any_slip_is_as_accurate_as_any_other() {
    let grippy = RobotParameters {
        chassis_mass: 8.0,
        wheel_mass: 0.5,
        chassis_yaw_inertia: 0.12,
        wheel_diametral_inertia: 0.0004,
        wheel_spin_inertia: 0.0015,
        wheel_radius: 0.05,
        track_width: 0.32,
        axle_to_front_support: 0.24,
        center_of_mass_right: 0.0,
        center_of_mass_forward: 0.06,
        center_of_mass_height: 0.07,
        wheel_friction_coefficient: 0.9,
        ..RobotParameters::default()
    };
    let operator = wheels_operator(grippy);
    let problem = OneStepProblem {
        free_slip: SVector::from([-0.02919800149170238, 0.02831499033589286, -5.13575060560531e-9]),
        free_normal: SVector::from([0.018852339879564868, 0.018852339592927328, 0.01063081329466258]),
    };
    let mut solution = ContactSolution::default();
    ExactSolver.solve(&operator, &problem, &mut solution);
    assert!(solution.impact_slip.amax() < 1e-7, "slip {}", solution.impact_slip);
    assert!(solution.residual <= 4e-12, "residual {}", solution.residual);
}

/// The Delassus operator of a robot whose front support has no friction.
fn wheels_operator(parameters: RobotParameters) -> DelassusOperator<3> {
    let friction = parameters.wheel_friction_coefficient;
    let robot = Robot::new(parameters).unwrap();
    DelassusOperator::new(
        robot.delassus().fixed_view::<3, 3>(0, 0).into_owned(),
        robot.normal_response().fixed_columns::<3>(0).into_owned(),
        [friction, friction, 0.0],
    )
}

/// A step in whose pattern Newton does not converge from afar, with that pattern.
struct HardStep {
    story: &'static str,
    wheels: WheelPattern,
    front: ContactMode,
    free_slip: [f64; 5],
    free_normal: [f64; 3],
}

/// Steps of a robot with heavy wheels.
#[expect(clippy::unreadable_literal, reason = "figures as they were drawn")]
const HARD_STEPS: [HardStep; 3] = [
    HardStep {
        story: "both wheels slip by 1e-18 m/s beside a sticking front support",
        wheels: WheelPattern::BothSlip,
        front: ContactMode::Stick,
        free_slip: [
            -16.41978116227041,
            -56.37492158173005,
            -0.0005176437028405801,
            -4.618254711786021e-7,
            -2.2116115110278056e-7,
        ],
        free_normal: [21.369721995578587, 21.216079769394373, -5.18142674617425],
    },
    HardStep {
        story: "the front support lifts off, and its friction with it",
        wheels: WheelPattern::BothSlip,
        front: ContactMode::Slip,
        free_slip: [
            -138.34826330167692,
            2929.2158964493315,
            -36.20398086040508,
            -92.16568669608374,
            -33.09013724581974,
        ],
        free_normal: [427.9222317489758, 518.4872941531642, -879.1149869422792],
    },
    HardStep {
        story: "the left wheel and the front support slip, the right wheel sticks",
        wheels: WheelPattern::LeftSlips(SlipSign::Forward),
        front: ContactMode::Slip,
        free_slip: [
            0.4355837466405942,
            -0.357739295059666,
            -2.2794445255405055e-6,
            -0.08532581418999133,
            -0.004584056915045092,
        ],
        free_normal: [0.0006585877510904056, 0.00046545491738445716, 0.04590116463565659],
    },
];

/// Steps of the interior point that a hard step may take: half of what it is given.
const INTERIOR_STEPS: usize = 30;

#[test]
fn hard_steps_are_solved_in_few_linear_solves() {
    let robot = Robot::new(unlucky::heavy_wheels()).unwrap();
    let friction = robot.parameters().friction_coefficients();
    let operator = DelassusOperator::<5>::new(*robot.delassus(), *robot.normal_response(), friction);
    for HardStep { story, wheels, front, free_slip, free_normal } in HARD_STEPS {
        let problem = OneStepProblem { free_slip: SVector::from(free_slip), free_normal: free_normal.into() };
        let mut solution = ContactSolution::default();
        let path = ExactSolver.solve(&operator, &problem, &mut solution);
        // A front support that slips beside a sticking wheel needs none.
        let is_short = match path {
            SolvePath::InteriorPoint { steps } => wheels == WheelPattern::BothSlip && steps <= INTERIOR_STEPS,
            SolvePath::OtherPattern => wheels != WheelPattern::BothSlip,
            SolvePath::GuessedPattern => false,
        };
        assert!(is_short, "{story}: {path:?}");
        assert_eq!(solution.pattern, ContactPattern { wheels, front }, "{story}");
        assert!(solution.residual <= RESIDUAL_TOLERANCE, "{story}: residual {}", solution.residual);
    }
}
