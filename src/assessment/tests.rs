use super::*;
use crate::robot::RobotParameters;
use crate::shooting::{SlipPolicy, StateComponent};
use crate::simulation::TorqueSchedule;
use crate::solver::{Helpers, SharedWork};

/// A straight drive of the reference robot without an offset of its centre of mass, far below slip.
fn straight(uncertain: Vec<(ChangedParameter, Distribution)>, tolerances: [Option<f64>; 5]) -> AssessInput {
    let robot = RobotParameters { center_of_mass_right: 0.0, ..RobotParameters::default() };
    let torques = [0.3, -0.3].to_vec();
    let schedule = TorqueSchedule { final_time: 2.0, left: torques.clone(), right: torques };
    let start = (ReferencePoint::AxleMidpoint, &State::default());
    let planned = Undisturbed::new((robot, None), start, (&schedule, 40));
    AssessInput {
        driven: planned.clone(),
        planned,
        goal: None,
        limited: Limited::Motion(ReferencePoint::AxleMidpoint, ManeuverLimits::default()),
        aisle: None,
        uncertain,
        tolerances,
        sample_count: 1_000,
        seed: 3,
    }
}

fn heading(half: f64) -> Vec<(ChangedParameter, Distribution)> {
    vec![(ChangedParameter::StartHeading, Distribution::Uniform { low: -half, high: half })]
}

fn distance(input: &AssessInput) -> f64 {
    let (end, separations) = input.planned.unchanged().end(Stop::never()).unwrap();
    assert_eq!(separations, 0);
    end.configuration.y
}

#[test]
fn start_heading_of_a_straight_drive_shifts_its_end_across() {
    let input = straight(heading(0.0), [None, None, Some(1.0), None, None]);
    let target = input.target(Stop::never()).unwrap();
    let distance = distance(&input);
    assert!(distance > 0.5, "{distance}");
    for angle in [-0.2, 0.01, 0.1_f64] {
        let motion = input.driven.under(&[(ChangedParameter::StartHeading, angle)]).unwrap();
        let (end, _) = motion.end(Stop::never()).unwrap();
        let [along, across, away, turn, speed] = error(&target, &end);
        // Sums of some dozen numbers of the size of the distance.
        assert!((across - distance * angle.sin()).abs() < 1e-12, "{across}");
        assert!((along - distance * (angle.cos() - 1.0)).abs() < 1e-12, "{along}");
        assert!((away - 2.0 * distance * (0.5 * angle.abs()).sin()).abs() < 1e-12, "{away}");
        assert!((turn - angle).abs() < 1e-12 && speed < 1e-12);
    }
}

#[test]
fn success_rate_of_a_straight_drive_is_that_of_the_closed_form() {
    let (half, tolerance) = (0.1, 0.04);
    let input = straight(heading(half), [None, Some(tolerance), None, None, None]);
    let rate = (tolerance / distance(&input)).asin() / half;
    assert!((0.3..0.7).contains(&rate), "{rate}");
    // One in twenty intervals would not hold it.
    let holds = |seed: u64| {
        let (low, high) = assess(&AssessInput { seed, sample_count: 200, ..input.clone() }, &RunControl::unattended())
            .unwrap()
            .interval;
        (low..=high).contains(&rate)
    };
    let held = (0..40).filter(|&seed| holds(seed)).count();
    assert!(held >= 35, "{held} of 40");
}

#[test]
fn one_parameter_has_all_of_the_variance_and_the_largest_error_is_the_worst() {
    let mut uncertain = heading(0.1);
    uncertain.push((ChangedParameter::StartX, Distribution::Normal { mean: 0.0, standard_deviation: 1e-4 }));
    let input = straight(uncertain, [None, None, Some(0.06), None, None]);
    let found = assess(&input, &RunControl::unattended()).unwrap();
    let across: Vec<f64> = found.shares.iter().map(|of| of.shares[1]).collect();
    assert!(across[0] > 0.99 && across[1] < 0.05, "{across:?}");
    let worst = found.worst.unwrap();
    assert_eq!(found.quantiles[QUANTILES.len() - 1][2], worst.error[2]);
    assert_eq!(worst.relative_error, worst.error[2] / 0.06);
    assert_eq!((found.grid, found.nominal.is_success), (AssessedGrid { step_count: 40, factor: 1 }, true));
    let (end, _) = worst.motion.end(Stop::never()).unwrap();
    assert_eq!(error(&input.target(Stop::never()).unwrap(), &end), worst.error);
}

#[test]
fn impossible_samples_fail_and_are_counted() {
    // Half of the delays are negative.
    let delays = Distribution::Normal { mean: 0.0, standard_deviation: 1e-3 };
    let input = straight(vec![(ChangedParameter::DelayLeft, delays)], [None, None, Some(1.0), None, None]);
    let found = assess(&input, &RunControl::unattended()).unwrap();
    assert_eq!(found.success_count + found.refused_count, 1_000);
    // Five standard errors.
    assert!((420..580).contains(&found.refused_count), "{}", found.refused_count);
    let all = vec![(ChangedParameter::Mass, Distribution::Uniform { low: -2.0, high: -1.5 })];
    let found = assess(&AssessInput { uncertain: all, ..input }, &RunControl::unattended()).unwrap();
    assert_eq!((found.success_count, found.refused_count, found.interval.0), (0, 1_000, 0.0));
    assert!(found.worst.is_none() && found.quantiles[0][0].is_nan() && found.mean[0].is_nan());
}

#[test]
fn finest_grid_is_taken_where_none_is_good_enough() {
    let mut input = straight(heading(0.1), [None, None, None, None, Some(1e-9)]);
    let mut slow = Goal::default();
    slow.set(StateComponent::VelocityY, Some(1.0));
    input.goal = Some(slow);
    let found = assess(&AssessInput { sample_count: 20, ..input.clone() }, &RunControl::unattended()).unwrap();
    assert_eq!((found.grid, found.nominal.is_success), (AssessedGrid { step_count: 640, factor: 16 }, false));
    assert!((found.nominal.error[4] - 1.0).abs() < 1e-9);
    // As far as the steps of all samples go.
    input.sample_count = 10_000;
    input.driven.step_count = 200;
    assert_eq!(grid(&input, &input.target(Stop::never()).unwrap(), Stop::never()).unwrap().0.factor, 8);
}

/// Threads that take parts at once, and lose them now and then.
struct Unsteady(usize);

impl Helpers for Unsteady {
    fn share(&self, work: &dyn SharedWork) {
        let never = std::sync::atomic::AtomicBool::new(false);
        let recalled = std::sync::atomic::AtomicBool::new(true);
        std::thread::scope(|threads| {
            for _ in 0..self.0 {
                threads.spawn(|| while work.take_part(&never) {});
            }
            assert!(!work.take_part(&recalled));
        });
        while work.take_part(&never) {}
        assert_eq!(work.open_parts(), 0);
    }
}

#[test]
fn any_number_of_threads_finds_the_same() {
    let friction = Distribution::Normal { mean: 0.0, standard_deviation: 0.1 };
    let mut uncertain = heading(0.1);
    uncertain.push((ChangedParameter::Friction, friction));
    let input = AssessInput { sample_count: 333, ..straight(uncertain, [None, None, Some(0.06), None, None]) };
    let found = |threads: usize| {
        let helpers = Unsteady(threads);
        format!("{:?}", assess(&input, &RunControl::unattended().helped_by(&helpers)).unwrap())
    };
    let alone = format!("{:?}", assess(&input, &RunControl::unattended()).unwrap());
    assert!([1, 4].map(found).iter().all(|found| *found == alone));
}

#[test]
fn stopped_assessment_has_no_answer() {
    let input = straight(heading(0.1), [None, None, Some(0.06), None, None]);
    let run = |stop: Stop<'_>| assess(&input, &RunControl::new(stop, &crate::solver::NoProgress)).map(|_| ());
    for last in [1, 100, 10_000] {
        assert_eq!(crate::stop::probe::stopped_at(last, run).0, Err(Stopped));
    }
}

#[test]
fn excess_of_a_limit_is_counted() {
    let torque = Distribution::Uniform { low: -0.1, high: 0.1 };
    let mut input = straight(vec![(ChangedParameter::Torque, torque)], [None, None, Some(1.0), None, None]);
    let schedule = TorqueSchedule { final_time: 1.0, left: vec![0.3], right: vec![0.3] };
    let nominal = Undisturbed { schedule, step_count: 20, ..input.driven.clone() };
    let (end, _) = nominal.unchanged().end(Stop::never()).unwrap();
    let limits = ManeuverLimits { speed: Some(end.velocity.y), ..ManeuverLimits::default() };
    input.limited = Limited::Motion(ReferencePoint::AxleMidpoint, limits);
    let found = assess(&input, &RunControl::unattended()).unwrap();
    let [excess] = found.excesses.as_slice() else { panic!("{:?}", found.excesses) };
    assert_eq!(excess.limit, "maneuver.limits.speed_m_s");
    // 0.5 % of the speed is 0.5 % of the torque: 47.5 % of the samples, five standard errors.
    assert!((396..554).contains(&excess.sample_count), "{}", excess.sample_count);
}

#[test]
fn samples_that_slip_are_judged_by_the_friction_that_would_hold_them_and_by_the_speed_that_they_have() {
    // Less than half of the friction: the wheels slip.
    let slippery = vec![(ChangedParameter::Friction, Distribution::Uniform { low: -0.6, high: -0.6 })];
    let mut input = straight(slippery, [None, None, Some(10.0), None, None]);
    for torques in [&mut input.driven.schedule.left, &mut input.driven.schedule.right] {
        for torque in torques {
            *torque *= 3.0;
        }
    }
    input.sample_count = 1;
    let forbidden = Maneuver { slip: SlipPolicy::Forbidden, ..Maneuver::forward_drive() };
    input.limited = Limited::Maneuver(Box::new(forbidden));
    let motion = input.driven.under(&input.changes(0)).unwrap();
    let (end, _, uses) = motion.end_with_limits(&input.limits(&motion), Stop::never()).unwrap();
    assert_eq!(uses.len(), 1);
    assert!(uses[0].limit == "maneuver.slip" && uses[0].excess > 0.05, "{uses:?}");
    // Where nothing is said of slip, wheels that slide use all of their friction and no more.
    let limits = ManeuverLimits { grip_utilization: Some(1.0), ..ManeuverLimits::default() };
    input.limited = Limited::Motion(ReferencePoint::AxleMidpoint, limits);
    let (same, _, uses) = motion.end_with_limits(&input.limits(&motion), Stop::never()).unwrap();
    assert!(same == end && uses[0].excess.abs() < 1e-9, "{uses:?}");
    // The speed that is judged is that of the motion as it is, slower than on the floor that the plan was made for.
    let speed = |motion: &Disturbed| {
        let limits = ManeuverLimits { speed: Some(1.0), ..ManeuverLimits::default() };
        let maneuver = Maneuver { slip: SlipPolicy::Forbidden, limits, ..Maneuver::forward_drive() };
        let limits = PathLimits::of_maneuver(&motion.robot, &maneuver, None, None);
        let (_, _, uses) = motion.end_with_limits(&limits, Stop::never()).unwrap();
        uses.iter().find(|used| used.limit == "maneuver.limits.speed_m_s").unwrap().largest
    };
    assert!(speed(&motion) < 0.95 * speed(&input.driven.unchanged()), "{}", speed(&motion));
}
