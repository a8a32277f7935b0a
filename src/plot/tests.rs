//! Figures of real motions.

mod drawn;

use std::sync::atomic::AtomicBool;

use super::*;
use crate::motion::{SimulateInput, SimulateParameters, simulate};
use crate::shooting::StateComponent;
use crate::solver::{RunControl, SolveInput, SolveParameters, SolverSettings, solve};

/// The forward drive, its torques on as many steps.
struct Drive {
    input: SolveInput,
    motion: SimulateInput,
    trajectory: Trajectory,
}

fn drive(step_count: usize) -> Drive {
    let input = SolveInput::forward_drive();
    let schedule = solve(&input, &RunControl::unattended()).unwrap().schedule;
    motion_of(input, SimulateParameters { schedule, step_count, ..SimulateParameters::default() })
}

fn motion_of(input: SolveInput, parameters: SimulateParameters) -> Drive {
    let motion = SimulateInput::new(parameters).unwrap();
    let trajectory = simulate(&motion, (&AtomicBool::new(false)).into()).unwrap().trajectory;
    Drive { input, motion, trajectory }
}

fn plan(drive: &Drive) -> Plan<'_> {
    Plan {
        name: "A",
        outcome: "2.930 s".to_owned(),
        fault: None,
        robot: &drive.motion.robot,
        reference_point: drive.motion.reference_point,
        start: drive.motion.start,
        goal: Some(&drive.input.maneuver.goal),
        torque_limit: Some(drive.input.maneuver.torque_limit),
        limits: &drive.input.maneuver.limits,
        footprint: &[],
        keep_in: &[],
        schedule: &drive.motion.schedule,
        trajectory: &drive.trajectory,
    }
}

fn figure<'a>(figures: &'a [Figure], name: &str) -> &'a Figure {
    figures.iter().find(|figure| figure.name == name).unwrap()
}

/// The points of all paths of a class, px.
fn paths(figure: &Figure, class: &str) -> Vec<Vec<[f64; 2]>> {
    let elements = figure.svg.split("<path ").skip(1).filter(|element| element.contains(&format!("class=\"{class}\"")));
    elements.map(|element| points(element.split(" d=\"").nth(1).unwrap().split('"').next().unwrap())).collect()
}

fn points(path: &str) -> Vec<[f64; 2]> {
    let spaced = path.replace('-', " -").replace(['M', 'l', 'z'], " ");
    let numbers: Vec<f64> = spaced.split_whitespace().map(|number| number.parse().unwrap()).collect();
    let mut at = [0.0; 2];
    let differences = numbers.chunks_exact(2);
    differences
        .map(|difference| {
            at = [at[0] + difference[0], at[1] + difference[1]];
            at
        })
        .collect()
}

fn px(axis: &AxisMap, value: f64) -> f64 {
    axis.px[0] + (axis.px[1] - axis.px[0]) * (value - axis.data[0]) / (axis.data[1] - axis.data[0])
}

fn data(axis: &AxisMap, px: f64) -> f64 {
    axis.data[0] + (axis.data[1] - axis.data[0]) * (px - axis.px[0]) / (axis.px[1] - axis.px[0])
}

fn distance(point: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let (along, to) = (Vector2::new(b[0] - a[0], b[1] - a[1]), Vector2::new(point[0] - a[0], point[1] - a[1]));
    let share = if along.norm() == 0.0 { 0.0 } else { (along.dot(&to) / along.norm_squared()).clamp(0.0, 1.0) };
    (to - share * along).norm()
}

#[test]
fn curves_are_where_the_maps_say_within_a_quarter_of_a_pixel() {
    let drive = drive(10_000);
    let figures = figures(&[plan(&drive)]);
    let motion = figure(&figures, "motion");
    // One curve per panel.
    for (curve, map) in paths(motion, "sd-plan-a").iter().zip(&motion.maps) {
        let value = |state: &State| match map.y.quantity {
            "x_m" => state.configuration.x,
            "y_m" => state.configuration.y,
            "heading_rad" => state.configuration.heading,
            "velocity_x_m_s" => state.velocity.x,
            "velocity_y_m_s" => state.velocity.y,
            _ => state.velocity.yaw_rate,
        };
        for (time, state) in drive.trajectory.time.iter().zip(&drive.trajectory.state) {
            let point = [px(&map.x, *time), px(&map.y, value(state))];
            let near = curve.windows(2).map(|pair| distance(point, [pair[0], pair[1]])).fold(f64::INFINITY, f64::min);
            assert!(near <= TOLERANCE + 1e-6, "{}: {near} px at {time} s", map.axes);
        }
    }
    assert_eq!(paths(motion, "sd-plan-a").len(), motion.maps.len());
}

#[test]
fn torques_keep_their_jumps() {
    let drive = drive(200);
    let figures = figures(&[plan(&drive)]);
    let torques = figure(&figures, "torques");
    let (curve, map) = (&paths(torques, "sd-plan-a")[0], &torques.maps[0]);
    let jumps = |from: f64, to: f64| (from - to).abs() > 0.5;
    let drawn = curve.windows(2).filter(|pair| jumps(data(&map.y, pair[0][1]), data(&map.y, pair[1][1])));
    let drawn: Vec<_> = drawn.collect();
    let left = &drive.motion.schedule.left;
    assert_eq!(drawn.len(), left.windows(2).filter(|pair| jumps(pair[0], pair[1])).count());
    assert!(!drawn.is_empty() && drawn.iter().all(|pair| (pair[0][0] - pair[1][0]).abs() < 1e-9), "they are upright");
}

#[test]
fn figures_are_small_and_complete_by_themselves() {
    let drive = drive(10_000);
    for count in [1, 4] {
        let plans: Vec<_> = (0..count).map(|_| plan(&drive)).collect();
        let figures = figures(&plans);
        let names: Vec<_> = figures.iter().map(|figure| figure.name).collect();
        let expected = ["path", "contact", "motion", "torques", "normal_forces", "wheel_rates", "friction"];
        assert_eq!(names, expected);
        for Figure { name, svg, maps, .. } in &figures {
            assert!(svg.len() <= LARGEST_FIGURE, "{name} of {count} plans has {} bytes", svg.len());
            for word in ["style", "<script", "href", "NaN", "inf", " id="] {
                assert!(!svg.contains(word), "{name} has {word}");
            }
            let mut axes: Vec<_> = maps.iter().map(|map| map.axes).collect();
            axes.dedup();
            assert_eq!(axes.len(), maps.len(), "{name}");
        }
    }
}

#[test]
fn noise_makes_coarser_curves_in_place_of_larger_figures() {
    let mut drive = drive(10_000);
    for (index, step) in drive.trajectory.contact.iter_mut().enumerate() {
        step.left.longitudinal_force += if index % 2 == 0 { 20.0 } else { -20.0 };
        step.right.longitudinal_slip += if index % 3 == 0 { 1.0 } else { -1.0 };
    }
    let plans: Vec<_> = (0..4).map(|_| plan(&drive)).collect();
    assert!(figure(&figures(&plans), "contact").svg.len() <= LARGEST_FIGURE);
}

#[test]
fn maps_lead_from_data_to_pixels_and_back() {
    let drive = drive(200);
    for figure in figures(&[plan(&drive)]) {
        for AxesMap { axes, x, y } in figure.maps {
            for axis in [x, y] {
                assert!(axis.data[0] != axis.data[1] && axis.px[0] != axis.px[1], "{axes}");
                let middle = f64::midpoint(axis.data[0], axis.data[1]);
                assert!((data(&axis, px(&axis, middle)) - middle).abs() < 1e-9, "{axes}");
                assert!(axis.px.iter().all(|px| (0.0..=figure.size[0].max(figure.size[1])).contains(px)), "{axes}");
            }
        }
    }
}

#[test]
fn path_has_one_scale() {
    let drive = drive(200);
    let figures = figures(&[plan(&drive)]);
    let AxesMap { x, y, .. } = &figure(&figures, "path").maps[0];
    let scale = |axis: &AxisMap| ((axis.px[1] - axis.px[0]) / (axis.data[1] - axis.data[0])).abs();
    assert!((scale(x) / scale(y) - 1.0).abs() < 1e-9);
    assert_eq!((x.quantity, y.quantity), ("y_m", "x_m"), "five metres forward lie on their side");
}

#[test]
fn slips_of_any_number_stay_within_the_largest_figure() {
    let mut drive = drive(10_000);
    // Every other step slips, on a path that winds.
    for (index, step) in drive.trajectory.contact.iter_mut().enumerate() {
        for wheel in [&mut step.left, &mut step.right] {
            wheel.mode = if index % 2 == 0 { ContactMode::Slip } else { ContactMode::Stick };
            wheel.lateral_force = wheel.normal_force * (index * 7919 % 101) as f64 / 101.0;
        }
    }
    for (index, state) in drive.trajectory.state.iter_mut().enumerate() {
        state.configuration.x = (0.7 * index as f64).sin();
    }
    for count in [1, 4] {
        let figures = figures(&(0..count).map(|_| plan(&drive)).collect::<Vec<_>>());
        for Figure { name, svg, .. } in &figures {
            assert!(svg.len() <= LARGEST_FIGURE, "{name} of {count} plans has {} bytes", svg.len());
        }
        assert!(figures.len() <= MOST_FIGURES);
    }
}

#[test]
fn spans_of_a_panel_are_one_path_without_gaps_that_nobody_sees() {
    let mut drive = drive(200);
    for (index, step) in drive.trajectory.contact.iter_mut().enumerate() {
        let slips = index < 30 && index != 19 || index >= 180;
        step.left.mode = if slips { ContactMode::Slip } else { ContactMode::Stick };
    }
    // A tenth of a pixel between the first two spans.
    drive.trajectory.time[20] = drive.trajectory.time[19] + 0.001;
    let figures = figures(&[plan(&drive)]);
    let contact = figure(&figures, "contact");
    let (bands, map) = (paths(contact, "sd-slip-area"), &contact.maps[0].x);
    // Beside what shows the key before it.
    let band = bands.iter().find(|points| points.len() > 2).unwrap();
    assert_eq!(band.len(), 2 * 4, "two outlines: {band:?}");
    let [from, to] = [band[0][0], band[1][0]].map(|x| data(map, x));
    assert!(from.abs() < 1e-3 && (to - drive.trajectory.time[30]).abs() < 1e-3, "{from} {to}");
}

#[test]
fn every_robot_is_drawn_at_its_start() {
    let drive = drive(200);
    let corners = [[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]].map(Vector2::from);
    let bodies = |plans: &[Plan]| {
        let figure = path::path(plans);
        (paths(&figure, "sd-body").len(), figure.caption)
    };
    let one = plan(&drive);
    let wide = Plan { footprint: &corners, ..one.clone() };
    let axle = Plan { reference_point: ReferencePoint::AxleMidpoint, ..one.clone() };
    let (same, caption) = bodies(&[one.clone(), one.clone()]);
    assert!(caption.starts_with("The path of the chassis centre of mass in"), "{caption}");
    // The start and its outline.
    assert_eq!(bodies(&[one.clone(), wide]).0, same + 2);
    let (moved, caption) = bodies(&[one, axle]);
    assert_eq!(moved, same + 2);
    assert!(caption.starts_with("The path of each plan's reference point in"), "{caption}");
}

#[test]
fn impossible_plan_says_so_over_start_and_goal() {
    let input = SolveInput::new(SolveParameters::default()).unwrap();
    let motion = input.motion_of(TorqueSchedule::empty(), 1);
    let trajectory = Trajectory { time: vec![0.0], state: vec![motion.start], ..Trajectory::default() };
    let drive = Drive { input, motion, trajectory };
    let fault = Some("The goal is impossible. <no torque> & \"more\".".to_owned());
    let figures = figures(&[Plan { fault, ..plan(&drive) }]);
    assert_eq!(figures.iter().map(|figure| figure.name).collect::<Vec<_>>(), ["path"]);
    assert!(figures[0].svg.contains("The goal is impossible. &lt;no torque&gt; &amp; &quot;more&quot;."));
}

#[test]
fn long_numbers_have_room_and_goals_without_a_place_have_no_key() {
    let mut drive = drive(200);
    for state in &mut drive.trajectory.state {
        state.configuration.x = 1e-6 * state.configuration.y - 5e-5;
    }
    let figures = figures(&[plan(&drive)]);
    let motion = figure(&figures, "motion");
    let left = |axes: &str| motion.maps.iter().find(|map| map.axes == axes).unwrap().x.px[0];
    assert!(motion.svg.contains(">\u{2212}0.00005<") && left("x") == 64.0 && left("y") == 54.0, "{}", motion.svg);
    assert!(figure(&figures, "path").svg.contains(">goal<"));

    for component in [StateComponent::X, StateComponent::Y] {
        drive.input.maneuver.goal.set(component, None);
    }
    assert!(!figure(&super::figures(&[plan(&drive)]), "path").svg.contains(">goal<"));
}

#[test]
fn numbers_at_the_right_edge_are_not_cut() {
    let mut drive = drive(200);
    for state in &mut drive.trajectory.state {
        state.configuration.x = 5000.0 + 0.32 * state.configuration.y;
        state.configuration.y = -7000.0;
    }
    drive.motion.start = drive.trajectory.state[0];
    let path = path::path(&[Plan { goal: None, ..plan(&drive) }]);
    let numbers =
        path.svg.split("<text ").filter(|text| text.contains("text-anchor=\"middle\"") && text.contains(">5"));
    let mut count = 0;
    for text in numbers {
        let attribute = |name: &str| text.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap();
        let number = text.split('>').nth(1).unwrap().split('<').next().unwrap();
        // Digits of the usual fonts are up to 0.64 as wide as high.
        let half = 0.5 * 0.64 * 11.0 * number.chars().count() as f64;
        assert!(attribute("x").parse::<f64>().unwrap() + half <= 680.0, "{number} in {}", path.svg);
        count += 1;
    }
    assert!(count > 3, "{}", path.svg);
}

#[test]
fn diverging_motion_is_no_picture() {
    let mut drive = drive(200);
    drive.trajectory.state[150].velocity.x = f64::NAN;
    let figures = figures(&[plan(&drive)]);
    assert_eq!(figures.len(), 1);
    assert!(!figures[0].svg.contains("NaN"));
    assert!(drive.trajectory.diverges());
}

#[test]
fn motor_has_its_curve_and_slip_its_spans() {
    let motor = Some(crate::robot::Motor { stall_torque: 2.0, free_speed: 90.0 });
    let robot = crate::robot::RobotParameters { motor, ..Default::default() };
    let settings = SolverSettings { start_count: 1, ..SolverSettings::default() };
    let input = SolveInput::new(SolveParameters { robot, settings, ..SolveParameters::forward_drive() }).unwrap();
    let schedule = TorqueSchedule { final_time: 1.0, left: vec![1.0, -1.0], right: vec![1.0, -1.0] };
    let drive = motion_of(input, SimulateParameters { robot, schedule, ..SimulateParameters::default() });
    let figures = figures(&[plan(&drive)]);
    let rates = figure(&figures, "wheel_rates");
    assert_eq!(rates.maps.len(), 4, "{:?}", rates.maps);
    assert!(figure(&figures, "contact").svg.contains("sd-slip-area"));
}
