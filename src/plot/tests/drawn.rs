//! What figures draw, and where.

use super::super::{AxesMap, AxisMap, Plan, figures};
use super::{data, figure, paths};
use crate::contact::{ContactMode, PerContact};
use crate::robot::{Motor, PerWheel, Robot, RobotParameters, State};
use crate::shooting::{Goal, ManeuverLimits, ReferencePoint};
use crate::simulation::{ContactSample, TorqueSchedule, Trajectory};

/// Within the rounding of a picture.
fn is_near(found: f64, expected: f64, axis: &AxisMap) -> bool {
    (found - expected).abs() < 0.3 * ((axis.data[1] - axis.data[0]) / (axis.px[1] - axis.px[0])).abs()
}

/// Of one second to the right along x in 40 steps; the left wheel slips in the last quarter.
fn shown<T>(see: impl FnOnce(&Plan) -> T) -> T {
    let count = 40;
    let motor = Some(Motor { stall_torque: 2.0, free_speed: 90.0 });
    let robot = Robot::new(RobotParameters { motor, center_of_mass_right: 0.0, ..RobotParameters::default() }).unwrap();
    let state = |node: usize| {
        let share = node as f64 / count as f64;
        let mut state = State::default();
        // Heading -pi/2 faces +x.
        state.configuration.heading = -std::f64::consts::FRAC_PI_2;
        state.configuration.x = share * 2.0;
        state.velocity.x = 2.0;
        state.velocity.wheel_rate = PerWheel::new(40.0 * share, 20.0 * share);
        state
    };
    let sample = |step: usize, slips: bool| {
        let share = (step + 1) as f64 / count as f64;
        ContactSample {
            normal_force: 40.0,
            lateral_force: 0.25 * 0.45 * 40.0,
            longitudinal_force: -0.5 * 0.45 * 40.0,
            lateral_slip: 0.0,
            longitudinal_slip: share,
            mode: if slips { ContactMode::Slip } else { ContactMode::Stick },
        }
    };
    let trajectory = Trajectory {
        time: (0..=count).map(|node| node as f64 / count as f64).collect(),
        state: (0..=count).map(state).collect(),
        end_state: state(count),
        contact: (0..count)
            .map(|step| PerContact {
                left: sample(step, step >= 30),
                right: sample(step, false),
                front: sample(step, false),
            })
            .collect(),
        ..Trajectory::default()
    };
    let schedule = TorqueSchedule { final_time: 1.0, left: vec![1.0, -0.5], right: vec![0.5, 0.25] };
    let limits = ManeuverLimits { wheel_rate: Some(60.0), ..ManeuverLimits::default() };
    let goal = Goal::at_rest(2.0, 0.0, -std::f64::consts::FRAC_PI_2 + 2.0 * std::f64::consts::TAU);
    see(&Plan {
        name: "A",
        outcome: "1 s".to_owned(),
        fault: None,
        robot: &robot,
        reference_point: ReferencePoint::ChassisCenterOfMass,
        start: state(0),
        goal: Some(&goal),
        torque_limit: Some(PerWheel::new(0.5, 1.5)),
        limits: &limits,
        footprint: &[],
        keep_in: &[],
        schedule: &schedule,
        trajectory: &trajectory,
    })
}

#[test]
fn forces_are_drawn_in_the_middle_of_their_steps_and_slips_at_the_end() {
    shown(|plan| {
        let all = figures(std::slice::from_ref(plan));
        let contact = figure(&all, "contact");
        // Per panel a legend may come first: curves are long.
        let of = |axes: &str| {
            let at = contact.maps.iter().position(|map| map.axes == axes).unwrap();
            let map: &AxesMap = &contact.maps[at];
            (map.x.clone(), map.y.clone())
        };
        let curves: Vec<_> = paths(contact, "sd-plan-a");
        let (x, y) = of("left_longitudinal_slip");
        let inside = |point: &[f64; 2]| {
            let within = |of: f64, px: [f64; 2]| of >= px[0].min(px[1]) - 0.2 && of <= px[0].max(px[1]) + 0.2;
            within(point[0], x.px) && within(point[1], y.px)
        };
        let slip: Vec<_> = curves.iter().filter(|curve| curve.iter().all(inside)).collect();
        assert_eq!(slip.len(), 1, "{slip:?}");
        let (first, last) = (slip[0][0], slip[0][slip[0].len() - 1]);
        for (point, expected) in [(first, 1.0 / 40.0), (last, 1.0)] {
            assert!(
                is_near(data(&x, point[0]), expected, &x) && is_near(data(&y, point[1]), expected, &y),
                "{point:?}"
            );
        }
        let (x, y) = of("left_lateral_force");
        let inside = |point: &[f64; 2]| {
            let within = |of: f64, px: [f64; 2]| of >= px[0].min(px[1]) - 0.2 && of <= px[0].max(px[1]) + 0.2;
            within(point[0], x.px) && within(point[1], y.px)
        };
        let forces: Vec<_> = curves.iter().filter(|curve| curve.iter().all(inside)).collect();
        let first: Vec<_> = forces.iter().map(|curve| [data(&x, curve[0][0]), data(&y, curve[0][1])]).collect();
        // Friction limits on both sides, and the force.
        assert_eq!(first.len(), 3, "{first:?}");
        for (first, force) in first.iter().zip([18.0, -18.0, 4.5]) {
            assert!(is_near(first[0], 0.5 / 40.0, &x) && is_near(first[1], force, &y), "{first:?}");
        }
    });
}

#[test]
fn a_wheel_that_slips_leaves_its_track_on_its_own_side() {
    shown(|plan| {
        let all = figures(std::slice::from_ref(plan));
        let path = figure(&all, "path");
        let map = &path.maps[0];
        assert_eq!((map.x.quantity, map.y.quantity), ("x_m", "y_m"));
        let slips = paths(path, "sd-slip");
        // Beside what shows the key before it.
        let on_map =
            |curve: &&Vec<[f64; 2]>| curve.iter().all(|point| point[1] >= map.y.px[1] && point[1] <= map.y.px[0]);
        let slip: Vec<_> = slips.iter().filter(on_map).filter(|curve| curve.len() > 1).collect();
        assert_eq!(slip.len(), 1, "{slips:?}");
        let (first, last) = (slip[0][0], slip[0][slip[0].len() - 1]);
        // The axle is 7 cm behind; the left wheel is at +y of a robot that faces +x.
        for (point, x) in [(first, 1.5 - 0.07), (last, 2.0 - 0.07)] {
            let (found_x, found_y) = (data(&map.x, point[0]), data(&map.y, point[1]));
            assert!(is_near(found_x, x, &map.x) && is_near(found_y, 0.15, &map.y), "{found_x} {found_y}");
        }
    });
}

#[test]
fn friction_of_a_wheel_is_drawn_across_and_along() {
    shown(|plan| {
        let all = figures(std::slice::from_ref(plan));
        let friction = figure(&all, "friction");
        let map = &friction.maps[0];
        assert_eq!((map.x.quantity, map.y.quantity), ("lateral_share", "longitudinal_share"));
        let inside = |point: [f64; 2]| {
            let within = |of: f64, px: [f64; 2]| of >= px[0].min(px[1]) && of <= px[0].max(px[1]);
            within(point[0], map.x.px) && within(point[1], map.y.px)
        };
        let curves = paths(friction, "sd-plan-a");
        let point = curves.iter().map(|curve| curve[0]).find(|point| inside(*point)).unwrap();
        let (across, along) = (data(&map.x, point[0]), data(&map.y, point[1]));
        assert!(is_near(across, 0.25, &map.x) && is_near(along, -0.5, &map.y), "{across} {along}");
    });
}

#[test]
fn the_lower_limit_of_the_wheel_rates_is_drawn_and_the_motor_at_the_rate_of_each_node() {
    shown(|plan| {
        let all = figures(std::slice::from_ref(plan));
        let rates = figure(&all, "wheel_rates");
        let (limit, motor) = (&rates.maps[0], rates.maps.iter().find(|map| map.axes == "left_motor").unwrap());
        let of = |map: &AxesMap, class: &str| -> Vec<Vec<[f64; 2]>> {
            let within = |of: f64, px: [f64; 2]| of >= px[0].min(px[1]) - 0.2 && of <= px[0].max(px[1]) + 0.2;
            let inside = |point: &[f64; 2]| within(point[0], map.x.px) && within(point[1], map.y.px);
            let here = paths(rates, class).into_iter().filter(|curve| curve.len() > 1 && curve.iter().all(inside));
            here.map(|curve| curve.iter().map(|at| [data(&map.x, at[0]), data(&map.y, at[1])]).collect()).collect()
        };
        let lines: Vec<f64> = of(limit, "sd-limit").iter().map(|line| line[0][1]).collect();
        assert_eq!(lines.len(), 2, "{lines:?}");
        assert!(is_near(lines[0], 60.0, &limit.y) && is_near(lines[1], -60.0, &limit.y), "{lines:?}");
        // To 90 rad/s with nothing left; a quarter of the stall torque, which is the limit, up to 67.5 rad/s.
        let curve = of(motor, "sd-limit");
        assert_eq!(curve.len(), 2, "{curve:?}");
        for (point, expected) in curve[0].iter().zip([[-90.0, 0.5], [67.5, 0.5], [90.0, 0.0]]) {
            assert!(is_near(point[0], expected[0], &motor.x) && is_near(point[1], expected[1], &motor.y), "{curve:?}");
        }
        let driven = of(motor, "sd-plan-a");
        let last = driven[0][driven[0].len() - 1];
        assert!(is_near(last[0], 40.0, &motor.x) && is_near(last[1], -0.5, &motor.y), "{last:?}");
    });
}

#[test]
fn the_goal_of_a_heading_is_the_winding_next_to_the_end() {
    shown(|plan| {
        let all = figures(std::slice::from_ref(plan));
        let motion = figure(&all, "motion");
        let heading = motion.maps.iter().find(|map| map.axes == "heading").unwrap();
        let [low, high] = heading.y.data;
        assert!(low > -4.0 && high < 1.0, "{low} {high}");
    });
}
