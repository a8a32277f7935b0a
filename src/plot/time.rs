//! Figures over time, phase diagrams and torque over speed: the paper's figures 3 to 5 and what they leave out.

use super::panel::{Panel, Quantity, Shape};
use super::sheet::{GOAL, Key, LIMIT, Shared, Sheet, band_of, paint_of};
use super::svg::Paint;
use super::{Figure, Plan};
use crate::contact::ContactName;
use crate::robot::{PerWheel, State};
use crate::shooting::{StateComponent, wrapped_angle};
use crate::simulation::ContactSample;

const TIME: Quantity = Quantity { name: "time", unit: "s", field: "time_s" };
const WHEELS: [ContactName; 2] = [ContactName::Left, ContactName::Right];
/// Of a panel over time, px, and of one quantity over another.
const HEIGHT: f64 = 108.0;
const TALL_HEIGHT: f64 = 140.0;
/// The friction limit beside a plan's curve.
const FRICTION_DASH: &str = "1.5 2.5";

/// The plans that move, with their place in the legend.
fn moving<'a, 'p>(plans: &'a [Plan<'p>]) -> impl Iterator<Item = (usize, &'a Plan<'p>)> {
    plans.iter().enumerate().filter(|(_, plan)| plan.moves())
}

fn per_wheel<T: Copy>(of: PerWheel<T>, wheel: ContactName) -> T {
    match wheel {
        ContactName::Left => of.left,
        ContactName::Right | ContactName::Front => of.right,
    }
}

fn name_of(contact: ContactName) -> &'static str {
    match contact {
        ContactName::Left => "Left wheel",
        ContactName::Right => "Right wheel",
        ContactName::Front => "Front support",
    }
}

/// A panel of one quantity over another.
fn over_quantity(axes: &'static str, title: String, [across, up]: [Quantity; 2], shapes: Vec<Shape>) -> Panel {
    let shown = [Vec::new(), Vec::new()];
    Panel { axes, title, across, up, shapes, shown, height: TALL_HEIGHT, equal: false, up_falls: false }
}

/// A panel from the start to the end of the longest plan.
fn over_time(plans: &[Plan], axes: &'static str, title: String, up: Quantity, shapes: Vec<Shape>) -> Panel {
    let ends = moving(plans).map(|(_, plan)| plan.schedule.final_time);
    let shown = [std::iter::once(0.0).chain(ends).collect(), Vec::new()];
    Panel { shown, height: HEIGHT, ..over_quantity(axes, title, [TIME, up], shapes) }
}

/// A value of each step, in its middle: forces are means.
fn forces(plan: &Plan, contact: ContactName, value: impl Fn(&ContactSample) -> f64) -> Vec<[f64; 2]> {
    let middles = plan.trajectory.time.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]));
    middles.zip(&plan.trajectory.contact).map(|(time, contacts)| [time, value(contacts.get(contact))]).collect()
}

/// A value of each step, at its end: slips are.
fn slips(plan: &Plan, contact: ContactName, value: fn(&ContactSample) -> f64) -> Vec<[f64; 2]> {
    let ends = plan.trajectory.time.iter().skip(1);
    ends.zip(&plan.trajectory.contact).map(|(time, contacts)| [*time, value(contacts.get(contact))]).collect()
}

/// A value of each node.
fn states(plan: &Plan, value: impl Fn(&State) -> [f64; 2]) -> Vec<[f64; 2]> {
    plan.trajectory.state.iter().map(value).collect()
}

fn component(plan: &Plan, of: StateComponent) -> Vec<[f64; 2]> {
    let values = plan.trajectory.state.iter().map(|state| state.to_vector()[of.index()]);
    plan.trajectory.time.iter().copied().zip(values).map(|(time, value)| [time, value]).collect()
}

/// The spans in which a contact slips, by plan.
fn bands(plans: &[Plan], contact: ContactName) -> Vec<Shape> {
    let of_plan = |(index, plan): (usize, &Plan)| {
        let (row, paint) = band_of(index, plans.len());
        let time = &plan.trajectory.time;
        let spans = plan.trajectory.slip_spans(contact).into_iter();
        let spans = spans.map(|steps| [time[steps.start], time[steps.end]]).collect();
        Shape::Bands { spans, row, paint }
    };
    moving(plans).map(of_plan).collect()
}

/// Lines at a magnitude and its opposite, over the longest plan.
fn limit_lines(plans: &[Plan], value: impl Fn(&Plan) -> Option<f64>) -> Vec<Shape> {
    let mut drawn: Vec<f64> = Vec::new();
    let end = moving(plans).map(|(_, plan)| plan.schedule.final_time).fold(0.0, f64::max);
    for limit in moving(plans).filter_map(|(_, plan)| value(plan)) {
        if !drawn.contains(&limit) {
            drawn.push(limit);
        }
    }
    let line = |limit: f64| Shape::Curve { points: vec![[0.0, limit], [end, limit]], paint: LIMIT };
    drawn.into_iter().flat_map(|limit| [line(limit), line(-limit)]).collect()
}

/// What shows slip, where there is any.
fn slip_key(plans: &[Plan]) -> Option<Key> {
    let words = if plans.len() == 1 { "the wheel slips" } else { "bars at the foot: the wheel slips" };
    plans.iter().any(Plan::slips).then(|| Key::area(band_of(0, plans.len()).1, words))
}

/// The paper's figure 3.
pub(super) fn contact(plans: &[Plan]) -> Figure {
    let friction = |paint: Paint| paint.wide(1.1).dashed(FRICTION_DASH);
    let force = |axes, wheel: ContactName, what: &str, value: fn(&ContactSample) -> f64| {
        let mut shapes = bands(plans, wheel);
        for (index, plan) in moving(plans) {
            let limit = plan.robot.parameters().wheel_friction_coefficient;
            for side in [1.0, -1.0] {
                let points = forces(plan, wheel, |sample| side * limit * sample.normal_force.max(0.0));
                shapes.push(Shape::Curve { points, paint: friction(paint_of(index)) });
            }
            shapes.push(Shape::Curve { points: forces(plan, wheel, value), paint: paint_of(index) });
        }
        let up = Quantity { name: "force", unit: "N", field: "force_n" };
        over_time(plans, axes, format!("{}: {what} force (N)", name_of(wheel)), up, shapes)
    };
    let slip = |axes, wheel: ContactName, what: &str, value: fn(&ContactSample) -> f64| {
        let mut shapes = bands(plans, wheel);
        let curve = |(index, plan)| Shape::Curve { points: slips(plan, wheel, value), paint: paint_of(index) };
        shapes.extend(moving(plans).map(curve));
        let up = Quantity { name: "slip", unit: "m/s", field: "slip_m_s" };
        over_time(plans, axes, format!("{}: {what} slip (m/s)", name_of(wheel)), up, shapes)
    };
    let [left, right] = WHEELS;
    let rows = vec![
        vec![
            force("left_longitudinal_force", left, "longitudinal", |of| of.longitudinal_force),
            force("right_longitudinal_force", right, "longitudinal", |of| of.longitudinal_force),
        ],
        vec![
            force("left_lateral_force", left, "lateral", |of| of.lateral_force),
            force("right_lateral_force", right, "lateral", |of| of.lateral_force),
        ],
        vec![
            slip("left_longitudinal_slip", left, "longitudinal", |of| of.longitudinal_slip),
            slip("right_longitudinal_slip", right, "longitudinal", |of| of.longitudinal_slip),
        ],
        vec![
            slip("left_lateral_slip", left, "lateral", |of| of.lateral_slip),
            slip("right_lateral_slip", right, "lateral", |of| of.lateral_slip),
        ],
    ];
    let mut keys = Key::of_plans(plans);
    keys.push(Key::line(friction(if plans.len() == 1 { paint_of(0) } else { LIMIT }), "friction limit \u{b1}\u{3bc}N"));
    keys.extend(slip_key(plans));
    Sheet {
        name: "contact",
        title: "Contact forces and relative velocities of the wheels",
        caption: "Friction forces on the robot and slip of each wheel, forward and to the right, with the friction limit of \
                  the load and the spans in which the wheel slips. While both wheels stick, only the sum of their lateral \
                  forces is physical."
            .to_owned(),
        keys,
        notes: Vec::new(),
        rows,
        shared: Shared::Rows,
        with_zero: true,
    }
    .figure()
}

/// The paper's figure 4.
pub(super) fn motion(plans: &[Plan]) -> Figure {
    use StateComponent::{Heading, VelocityX, VelocityY, X, Y, YawRate};
    let panel = |axes, of: StateComponent, name: &'static str, unit: &'static str| {
        let mut shapes = limit_lines(plans, |plan| plan.limits.yaw_rate.filter(|_| of == YawRate));
        for (index, plan) in moving(plans) {
            let points = component(plan, of);
            let end = points.last().copied().unwrap_or_default();
            shapes.push(Shape::Curve { points, paint: paint_of(index) });
            if let Some(goal) = plan.goal.and_then(|goal| goal.value(of)) {
                // The winding that the plan comes nearest to.
                let goal = if of == Heading { end[1] + wrapped_angle(goal - end[1]) } else { goal };
                shapes.push(Shape::Dot { at: [end[0], goal], radius: 4.0, paint: GOAL });
            }
        }
        over_time(plans, axes, format!("{name} ({unit})"), Quantity { name, unit, field: of.field() }, shapes)
    };
    let rows = vec![
        vec![panel("x", X, "Position x", "m"), panel("velocity_x", VelocityX, "Velocity in x", "m/s")],
        vec![panel("y", Y, "Position y", "m"), panel("velocity_y", VelocityY, "Velocity in y", "m/s")],
        vec![panel("heading", Heading, "Heading", "rad"), panel("yaw_rate", YawRate, "Yaw rate", "rad/s")],
    ];
    let mut keys = Key::of_plans(plans);
    if plans.iter().any(|plan| plan.goal.is_some()) {
        keys.push(Key::circle(GOAL, "goal"));
    }
    if plans.iter().any(|plan| plan.limits.yaw_rate.is_some()) {
        keys.push(Key::line(LIMIT, "limit"));
    }
    Sheet {
        name: "motion",
        title: "Position, heading and velocities",
        caption: "The motion of the reference point in the world; heading 0 faces y, positive turns left.".to_owned(),
        keys,
        notes: Vec::new(),
        rows,
        shared: Shared::None,
        with_zero: false,
    }
    .figure()
}

/// The paper's figure 5.
pub(super) fn torques(plans: &[Plan]) -> Figure {
    let torque = |axes, wheel: ContactName| {
        let mut shapes = limit_lines(plans, |plan| plan.torque_limit.map(|limit| per_wheel(limit, wheel)));
        for (index, plan) in moving(plans) {
            let torques = if wheel == ContactName::Left { &plan.schedule.left } else { &plan.schedule.right };
            let edge = |interval: usize| interval as f64 * plan.schedule.interval();
            let steps = torques.iter().enumerate();
            let points = steps.flat_map(|(at, &torque)| [[edge(at), torque], [edge(at + 1), torque]]).collect();
            shapes.push(Shape::Curve { points, paint: paint_of(index) });
        }
        let up = Quantity { name: "torque", unit: "N m", field: "torque_n_m" };
        over_time(plans, axes, format!("{}: torque (N m)", name_of(wheel)), up, shapes)
    };
    let phase = |axes, [across, up]: [Quantity; 2], value: fn(&State) -> [f64; 2]| {
        let mut shapes = Vec::new();
        for (index, plan) in moving(plans) {
            let points = states(plan, value);
            let (start, end) = (points[0], points[points.len() - 1]);
            shapes.push(Shape::Curve { points, paint: paint_of(index) });
            shapes.push(Shape::Dot { at: start, radius: 3.0, paint: Paint::area("sd-ink", "#1a1a1a", 1.0) });
            shapes.push(Shape::Dot { at: end, radius: 4.0, paint: GOAL });
        }
        over_quantity(axes, format!("{} ({})", up.name, up.unit), [across, up], shapes)
    };
    let quantity = |name, unit, field| Quantity { name, unit, field };
    let rows = vec![
        vec![torque("left_torque", ContactName::Left), torque("right_torque", ContactName::Right)],
        vec![
            phase(
                "phase_x",
                [quantity("x", "m", "x_m"), quantity("Velocity in x", "m/s", "velocity_x_m_s")],
                |state| [state.configuration.x, state.velocity.x],
            ),
            phase(
                "phase_y",
                [quantity("y", "m", "y_m"), quantity("Velocity in y", "m/s", "velocity_y_m_s")],
                |state| [state.configuration.y, state.velocity.y],
            ),
            phase(
                "phase_heading",
                [quantity("heading", "rad", "heading_rad"), quantity("Yaw rate", "rad/s", "yaw_rate_rad_s")],
                |state| [state.configuration.heading, state.velocity.yaw_rate],
            ),
        ],
    ];
    let mut keys = Key::of_plans(plans);
    if plans.iter().any(|plan| plan.torque_limit.is_some()) {
        keys.push(Key::line(LIMIT, "torque limit"));
    }
    keys.push(Key::circle(GOAL, "end of a phase curve, from its dot"));
    Sheet {
        name: "torques",
        title: "Control torques and phase diagrams",
        caption: "The torques of both wheels within their limits, and each velocity over its position.".to_owned(),
        keys,
        notes: Vec::new(),
        rows,
        shared: Shared::First,
        with_zero: false,
    }
    .figure()
}

/// What each contact carries.
pub(super) fn normal_forces(plans: &[Plan]) -> Figure {
    let panel = |(axes, contact): (&'static str, ContactName)| {
        let mut shapes = if contact == ContactName::Front { Vec::new() } else { bands(plans, contact) };
        let curve = |(index, plan)| Shape::Curve {
            points: forces(plan, contact, |sample| sample.normal_force),
            paint: paint_of(index),
        };
        shapes.extend(moving(plans).map(curve));
        let up = Quantity { name: "normal force", unit: "N", field: "normal_force_n" };
        vec![over_time(plans, axes, format!("{}: normal force (N)", name_of(contact)), up, shapes)]
    };
    let contacts = [
        ("left_normal_force", ContactName::Left),
        ("right_normal_force", ContactName::Right),
        ("front_normal_force", ContactName::Front),
    ];
    let mut keys = Key::of_plans(plans);
    keys.extend(slip_key(plans));
    Sheet {
        name: "normal_forces",
        title: "Normal forces",
        caption: "What each contact carries; a contact that would have to pull is outside the model.".to_owned(),
        keys,
        notes: Vec::new(),
        rows: contacts.into_iter().map(panel).collect(),
        shared: Shared::All,
        with_zero: true,
    }
    .figure()
}

/// Wheel rates with their limit, and torque over rate with the motor's curve.
pub(super) fn wheel_rates(plans: &[Plan]) -> Figure {
    let limit = |plan: &Plan| {
        let free_speed = plan.robot.parameters().motor.map(|motor| motor.free_speed);
        plan.limits.wheel_rate.into_iter().chain(free_speed).reduce(f64::min)
    };
    let rate = |state: &State, wheel| per_wheel(state.velocity.wheel_rate, wheel);
    let up = Quantity { name: "rate", unit: "rad/s", field: "wheel_rate_rad_s" };
    let over = |axes, wheel: ContactName, of| {
        let mut shapes = bands(plans, wheel);
        shapes.extend(limit_lines(plans, limit));
        let curve = |(index, plan)| Shape::Curve { points: component(plan, of), paint: paint_of(index) };
        shapes.extend(moving(plans).map(curve));
        over_time(plans, axes, format!("{}: rate (rad/s)", name_of(wheel)), up, shapes)
    };
    let motor = |axes, wheel: ContactName| {
        let mut shapes = Vec::new();
        for (index, plan) in moving(plans) {
            let largest = plan.torque_limit.map_or(f64::INFINITY, |limit| per_wheel(limit, wheel));
            if let Some(motor) = plan.robot.parameters().motor {
                let torque = |rate: f64| (motor.stall_torque * (1.0 - rate / motor.free_speed)).clamp(0.0, largest);
                // The corner at the torque limit, where it is lower than the stall torque.
                let corner = motor.free_speed * (1.0 - (largest / motor.stall_torque).min(1.0));
                let rates = [-motor.free_speed, corner.max(-motor.free_speed), motor.free_speed];
                for side in [1.0, -1.0] {
                    let points = rates.map(|rate| [side * rate, side * torque(rate)]).to_vec();
                    shapes.push(Shape::Curve { points, paint: LIMIT });
                }
            }
            let torques = if wheel == ContactName::Left { &plan.schedule.left } else { &plan.schedule.right };
            let (steps, count) = (plan.trajectory.step_count(), torques.len());
            let at = |step: usize| torques[crate::simulation::control_interval(step, steps, count)];
            let nodes = |step: usize| [0, 1].map(|end| [rate(&plan.trajectory.state[step + end], wheel), at(step)]);
            shapes.push(Shape::Curve { points: (0..steps).flat_map(nodes).collect(), paint: paint_of(index) });
        }
        let up = Quantity { name: "torque", unit: "N m", field: "torque_n_m" };
        let across = Quantity { name: "rate", unit: "rad/s", field: "wheel_rate_rad_s" };
        over_quantity(axes, format!("{}: torque (N m)", name_of(wheel)), [across, up], shapes)
    };
    let mut rows = vec![vec![
        over("left_rate", ContactName::Left, StateComponent::WheelRateLeft),
        over("right_rate", ContactName::Right, StateComponent::WheelRateRight),
    ]];
    let has_motor = moving(plans).any(|(_, plan)| plan.robot.parameters().motor.is_some());
    if has_motor {
        rows.push(vec![motor("left_motor", ContactName::Left), motor("right_motor", ContactName::Right)]);
    }
    let mut keys = Key::of_plans(plans);
    match (has_motor, moving(plans).any(|(_, plan)| limit(plan).is_some())) {
        (true, _) => keys.push(Key::line(LIMIT, "largest rate, and curve of the motor")),
        (false, true) => keys.push(Key::line(LIMIT, "largest rate")),
        (false, false) => {}
    }
    keys.extend(slip_key(plans));
    Sheet {
        name: "wheel_rates",
        title: "Wheel rates",
        caption: if has_motor {
            "The rates of both wheels, and the torque at each rate within what the motor gives there.".to_owned()
        } else {
            "The rates of both wheels; torques are within their limits at any rate, since no motor is given.".to_owned()
        },
        keys,
        notes: Vec::new(),
        rows,
        shared: Shared::Rows,
        with_zero: true,
    }
    .figure()
}
