//! Figures in the plane: the path from above, and the friction of each wheel within its circle.

use std::f64::consts::TAU;

use nalgebra::Vector2;

use super::panel::{Panel, Quantity, Range, Shape};
use super::sheet::{GOAL, Key, LIMIT, SLIP, Shared, Sheet, WIDTH, paint_of};
use super::svg::Paint;
use super::{Figure, Plan};
use crate::contact::{ContactMode, ContactName};
use crate::robot::State;
use crate::shooting::{ReferencePoint, StateComponent};

const TRACK: Paint = Paint::line("sd-track", "#9a9a9a", 1.1);
const BODY: Paint = Paint::line("sd-body", "#4d4d4d", 1.2);
const WHEEL: Paint = Paint::area("sd-wheel", "#4d4d4d", 1.0);
const START: Paint = BODY.filled("#56b4e9");
const KEEP_IN: Paint = Paint::line("sd-limit", "#4d4d4d", 1.4).dashed("10 3 2 3");
/// Robots and arrows on the way, at equal times.
const GHOSTS: usize = 10;
/// Lowest and highest picture of a path, px.
const HEIGHTS: (f64, f64) = (130.0, 430.0);
/// A path that is so much longer upwards than across lies on its side.
const TALL: f64 = 1.2;

/// A friction force that turns by so much of its limit in a step leaps: it was not in between.
const LEAP: f64 = 0.2;

/// From the world to the axes: as it is, or on its side.
#[derive(Clone, Copy)]
struct View {
    on_side: bool,
}

impl View {
    fn place(self, point: Vector2<f64>) -> [f64; 2] {
        if self.on_side { [point.y, point.x] } else { [point.x, point.y] }
    }

    /// The direction in which a heading faces, rad from across; on its side x points down.
    fn direction(self, heading: f64) -> f64 {
        if self.on_side { heading } else { heading + TAU / 4.0 }
    }
}

/// A pose as the place of the axle midpoint, and its axes to the right and forward.
fn from_axle(plan: &Plan, state: &State) -> impl Fn(Vector2<f64>) -> Vector2<f64> + use<> {
    let axle = state.moved_by(plan.reference_point.to_axle_midpoint(plan.robot.parameters()));
    let (sin, cos) = axle.configuration.heading.sin_cos();
    let at = Vector2::new(axle.configuration.x, axle.configuration.y);
    move |point| at + point.x * Vector2::new(cos, sin) + point.y * Vector2::new(-sin, cos)
}

/// The outline of the robot from the axle midpoint; without a footprint that of wheels and front support.
fn outline(plan: &Plan) -> Vec<Vector2<f64>> {
    if !plan.footprint.is_empty() {
        return plan.footprint.to_vec();
    }
    let of = plan.robot.parameters();
    let (half, radius, nose) = (0.5 * of.track_width, of.wheel_radius, 0.12 * of.track_width);
    let (front, right) = (of.axle_to_front_support, of.front_support_right);
    [
        (-half, -radius),
        (half, -radius),
        (half, 0.7 * radius),
        (right + nose, front),
        (right - nose, front),
        (-half, 0.7 * radius),
    ]
    .map(|(right, forward)| Vector2::new(right, forward))
    .to_vec()
}

/// The robot at a pose: its outline, and its wheels where they are asked for.
fn robot(plan: &Plan, state: &State, view: View, (body, wheels): (Paint, Option<Paint>)) -> Vec<Shape> {
    let place = from_axle(plan, state);
    let polygon = |corners: &[Vector2<f64>], paint| Shape::Outline {
        corners: corners.iter().map(|corner| view.place(place(*corner))).collect(),
        paint,
    };
    let of = plan.robot.parameters();
    let (half, radius, width) = (0.5 * of.track_width, of.wheel_radius, 0.05 * of.track_width);
    let wheel = |side: f64| {
        [(-width, -radius), (width, -radius), (width, radius), (-width, radius)]
            .map(|(right, forward)| Vector2::new(side * half + right, forward))
    };
    let wheels = wheels.into_iter().flat_map(|paint| [-1.0, 1.0].map(|side| polygon(&wheel(side), paint)));
    std::iter::once(polygon(&outline(plan), body)).chain(wheels).collect()
}

/// The pose that is asked for, where position and heading are.
fn goal_pose(plan: &Plan) -> Option<State> {
    let goal = plan.goal?;
    let mut state = State::default();
    state.configuration.x = goal.value(StateComponent::X)?;
    state.configuration.y = goal.value(StateComponent::Y)?;
    state.configuration.heading = goal.value(StateComponent::Heading)?;
    Some(state)
}

/// The tracks of both wheels: where they stick and where they slip.
fn tracks(plan: &Plan, view: View, (stick, slip): (Option<Paint>, Paint)) -> [Vec<Shape>; 2] {
    let half = 0.5 * plan.robot.parameters().track_width;
    let mut tracks = [Vec::new(), Vec::new()];
    for (wheel, side) in [(ContactName::Left, -half), (ContactName::Right, half)] {
        let at = |state: &State| view.place(from_axle(plan, state)(Vector2::new(side, 0.0)));
        let points: Vec<_> = plan.trajectory.state.iter().map(at).collect();
        let spans = plan.trajectory.slip_spans(wheel).into_iter();
        let slipping = spans.flat_map(|steps| points[steps.start..=steps.end].iter().chain([&[f64::NAN; 2]]).copied());
        tracks[0].push(Shape::Curve { points: slipping.collect(), paint: slip });
        tracks[1].extend(stick.map(|paint| Shape::Curve { points, paint }));
    }
    tracks
}

/// Start, aisle and goal: what is below the path, and what is above.
fn ends(plan: &Plan, view: View) -> [Vec<Shape>; 2] {
    let mut below = robot(plan, &plan.start, view, (START.faint(0.35), None));
    let corners: Vec<_> = plan.keep_in.iter().map(|corner| view.place(*corner)).collect();
    below.extend((!corners.is_empty()).then_some(Shape::Outline { corners, paint: KEEP_IN }));
    let mut above = robot(plan, &plan.start, view, (BODY, Some(WHEEL)));
    above.extend(goal(plan, view));
    [below, above]
}

/// Shapes of all plans, from the lowest to the topmost.
fn shapes(plans: &[Plan], view: View) -> Vec<Shape> {
    let (mut low, mut middle, mut top) = (Vec::new(), Vec::new(), Vec::new());
    let is_single = plans.len() == 1;
    let (stick, slip) = if is_single { (Some(TRACK), SLIP.faint(0.85)) } else { (None, SLIP.wide(2.4).faint(0.7)) };
    let mut drawn: Vec<[Vec<Shape>; 2]> = Vec::new();
    for ends in plans.iter().map(|plan| ends(plan, view)) {
        // What looks the same is drawn once.
        if !drawn.contains(&ends) {
            drawn.push(ends);
        }
    }
    for [below, above] in drawn {
        low.extend(below);
        top.extend(above);
    }
    for (index, plan) in plans.iter().enumerate().filter(|(_, plan)| plan.moves()) {
        let [slipping, sticking] = tracks(plan, view, (stick, slip));
        low.extend(slipping.into_iter().chain(sticking));
        let at = |state: &State| view.place(Vector2::new(state.configuration.x, state.configuration.y));
        let points = plan.trajectory.state.iter().map(at).collect();
        middle.push(Shape::Curve { points, paint: paint_of(index) });
        let steps = plan.trajectory.step_count();
        for state in (0..=GHOSTS).map(|ghost| &plan.trajectory.state[ghost * steps / GHOSTS]) {
            if is_single {
                low.extend(robot(plan, state, view, (BODY.wide(0.8).faint(0.35), None)));
            }
            let (direction, paint) =
                (view.direction(state.configuration.heading), paint_of(index).dashed("").wide(1.4));
            top.push(Shape::Arrow { at: at(state), direction, length: 16.0, paint });
        }
    }
    low.into_iter().chain(middle).chain(top).collect()
}

/// What is asked of the end: the robot in dashes, or a circle where the heading is free.
fn goal(plan: &Plan, view: View) -> Vec<Shape> {
    if let Some(pose) = goal_pose(plan) {
        return robot(plan, &pose, view, (GOAL.dashed("4 2.5"), None));
    }
    let place = plan.goal.and_then(|goal| Some((goal.value(StateComponent::X)?, goal.value(StateComponent::Y)?)));
    let circle = |(x, y)| Shape::Dot { at: view.place(Vector2::new(x, y)), radius: 6.0, paint: GOAL.dashed("3 2") };
    place.map(circle).into_iter().collect()
}

/// The path from above, in one scale.
pub(super) fn path(plans: &[Plan]) -> Figure {
    let of = |view: View| {
        let (x, y) = (Quantity { name: "x", unit: "m", field: "x_m" }, Quantity { name: "y", unit: "m", field: "y_m" });
        let (title, across, up) = if view.on_side { ("x (m), downwards", y, x) } else { ("y (m)", x, y) };
        let (title, shapes, shown) = (title.to_owned(), shapes(plans, view), [Vec::new(), Vec::new()]);
        Panel { axes: "path", title, across, up, shapes, shown, height: HEIGHTS.0, equal: true, up_falls: view.on_side }
    };
    let span = |range: Range| range.map_or(0.0, |[low, high]| high - low);
    let upright = of(View { on_side: false });
    let is_tall = span(upright.range(1)) > TALL * span(upright.range(0));
    let mut panel = if is_tall { of(View { on_side: true }) } else { upright };
    // As high as the width makes it, with free space around.
    let [across, up] = [0, 1].map(|axis| span(panel.range(axis)));
    panel.height = (0.9 * WIDTH * up / across.max(1e-9) + 40.0).clamp(HEIGHTS.0, HEIGHTS.1);
    let notes = plans.iter().filter_map(|plan| {
        let fault = plan.fault.as_ref()?;
        Some(if plans.len() == 1 { fault.clone() } else { format!("{}. {fault}", plan.name) })
    });
    let notes: Vec<_> = notes.collect();
    let points: Vec<_> = plans.iter().map(|plan| plan.reference_point).collect();
    let point = match points.first() {
        Some(first) if points.iter().any(|point| point != first) => "each plan's reference point",
        Some(ReferencePoint::AxleMidpoint) => "the axle midpoint",
        Some(ReferencePoint::ChassisCenterOfMass) | None => "the chassis centre of mass",
    };
    let caption = format!(
        "The path of {point} in true scale, with the heading at equal times and the tracks of the wheels where they slip."
    );
    Sheet {
        name: "path",
        title: "Path from above",
        caption,
        keys: keys_of_path(plans),
        notes,
        rows: vec![vec![panel]],
        shared: Shared::None,
        with_zero: false,
    }
    .figure()
}

fn keys_of_path(plans: &[Plan]) -> Vec<Key> {
    let mut keys = Key::of_plans(plans);
    if let [plan] = plans
        && plan.moves()
    {
        keys.push(Key::line(paint_of(0), &format!("{}, arrows: heading", plan.label())));
        keys.push(Key::line(TRACK, "track of a wheel"));
    }
    if plans.iter().any(Plan::slips) {
        keys.push(Key::line(SLIP, "wheel slips"));
    }
    keys.push(Key::area(START.faint(0.35), "start"));
    if plans.iter().any(|plan| !goal(plan, View { on_side: false }).is_empty()) {
        keys.push(Key::line(GOAL.dashed("4 2.5"), "goal"));
    }
    if plans.iter().any(|plan| !plan.keep_in.is_empty()) {
        keys.push(Key::line(KEEP_IN, "keep-in"));
    }
    keys
}

/// What each wheel uses of its friction; none without friction.
pub(super) fn friction(plans: &[Plan]) -> Option<Figure> {
    let moving = || plans.iter().enumerate().filter(|(_, plan)| plan.moves());
    let has_friction = moving().any(|(_, plan)| plan.robot.parameters().wheel_friction_coefficient > 0.0);
    if !has_friction {
        return None;
    }
    let circle = |radius: f64, paint| {
        let corner = |index: usize| TAU * index as f64 / 120.0;
        let corners = (0..120).map(|index| [radius * corner(index).cos(), radius * corner(index).sin()]).collect();
        Shape::Outline { corners, paint }
    };
    let panel = |(axes, title, wheel): (&'static str, &str, ContactName)| {
        let mut shapes = vec![circle(1.0, LIMIT)];
        shapes.extend(plans.iter().filter_map(|plan| plan.limits.grip_utilization).map(|share| circle(share, KEEP_IN)));
        let mut traces = Vec::new();
        for (index, plan) in moving() {
            let friction = plan.robot.parameters().wheel_friction_coefficient;
            let samples = || plan.trajectory.contact.iter().map(|contacts| contacts.get(wheel));
            let share = |force: f64, normal: f64| if normal > 0.0 { force / (friction * normal) } else { f64::NAN };
            let used = samples()
                .map(|of| [of.lateral_force, of.longitudinal_force].map(|force| share(force, of.normal_force)));
            let points: Vec<_> = used.collect();
            let mut slips: Vec<[f64; 2]> = Vec::new();
            for (of, point) in samples().zip(&points) {
                let is_jump = slips.last().is_some_and(|last| (last[0] - point[0]).hypot(last[1] - point[1]) > LEAP);
                if is_jump || of.mode == ContactMode::Stick {
                    slips.push([f64::NAN; 2]);
                }
                if of.mode == ContactMode::Slip {
                    slips.push(*point);
                }
            }
            shapes.push(Shape::Curve { points: slips, paint: SLIP.wide(5.0).faint(0.7) });
            traces.push(Shape::Curve { points, paint: paint_of(index).wide(1.4) });
        }
        shapes.extend(traces);
        let across = Quantity { name: "lateral force / \u{3bc}N, to the right", unit: "", field: "lateral_share" };
        let up = Quantity { name: "longitudinal force / \u{3bc}N", unit: "", field: "longitudinal_share" };
        let title = format!("{title}: longitudinal force / \u{3bc}N");
        let shown = [vec![-1.0, 1.0], vec![-1.0, 1.0]];
        Panel { axes, title, across, up, shapes, shown, height: 280.0, equal: true, up_falls: false }
    };
    let wheels =
        [("left_friction", "Left wheel", ContactName::Left), ("right_friction", "Right wheel", ContactName::Right)];
    let mut keys = Key::of_plans(plans);
    keys.push(Key::line(LIMIT, "friction limit"));
    if plans.iter().any(|plan| plan.limits.grip_utilization.is_some()) {
        keys.push(Key::line(KEEP_IN, "limit of grip"));
    }
    keys.extend(plans.iter().any(Plan::slips).then(|| Key::line(SLIP, "the wheel slips")));
    let sheet = Sheet {
        name: "friction",
        title: "Friction of each wheel within its limit",
        caption:
            "The friction force on each wheel as a share of what its load allows: inside the circle it sticks, on the \
                  circle it may slip. While both stick, only the sum of their forces across is known: it is shared so that the wheel \
                  that uses more of its grip uses least."
                .to_owned(),
        keys,
        notes: Vec::new(),
        rows: vec![wheels.into_iter().map(panel).collect()],
        shared: Shared::None,
        with_zero: false,
    };
    Some(sheet.figure())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrows_point_where_the_robot_drives() {
        for (on_side, heading) in [false, true].into_iter().flat_map(|on_side| [0.0, 0.7, -2.0].map(|of| (on_side, of)))
        {
            let view = View { on_side };
            let [across, along] = view.place(Vector2::new(-f64::sin(heading), f64::cos(heading)));
            let up = if on_side { -along } else { along };
            let (sin, cos) = view.direction(heading).sin_cos();
            assert!((sin - up).abs() + (cos - across).abs() < 1e-15, "{heading}, on its side: {on_side}");
        }
    }
}
