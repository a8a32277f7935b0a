//! The paper's figures 3 to 5 from a solution, as one self-contained HTML page.
//!
//! Slip and loads of the contacts, torques, motion and phase diagram over time. The script that draws them is part of
//! the page: nothing is fetched.

use plotly::common::{DashType, Line, LineShape, Mode};
use plotly::layout::{Axis, GridPattern, LayoutGrid};
use plotly::{Layout, Plot, Scatter, Trace};

use crate::contact::ContactName;
use crate::simulation::{ContactSample, Trajectory};
use crate::solver::Solution;

const BLUE: &str = "#1f77b4";
const RED: &str = "#d62728";
const GREY: &str = "#7f7f7f";
const WIDTH: usize = 1100;
const HEIGHT: usize = 900;

/// One curve: name, color, abscissa, ordinate.
struct Curve {
    name: &'static str,
    color: &'static str,
    x: Vec<f64>,
    y: Vec<f64>,
}

/// A page with six diagrams of a solution.
pub fn html(solution: &Solution) -> String {
    let mut plot = Plot::new();
    for (panel, curves) in panels(solution).into_iter().enumerate() {
        for curve in curves {
            plot.add_trace(trace(curve, panel));
        }
    }
    plot.set_layout(layout(solution));
    plot.to_html()
}

fn panels(solution: &Solution) -> [Vec<Curve>; 6] {
    let trajectory = &solution.trajectory;
    let state = |value: fn(&crate::robot::State) -> f64| trajectory.state.iter().map(value).collect::<Vec<f64>>();
    let time = || trajectory.time.clone();
    let over_time = |name, color, y: Vec<f64>| Curve { name, color, x: time(), y };
    let contact = |name, color, which, value| per_step(trajectory, name, color, which, value);
    let (position, speed) = (state(|s| s.configuration.y), state(|s| s.velocity.y));
    [
        torques(solution),
        vec![
            contact("left slip", BLUE, ContactName::Left, |sample| sample.longitudinal_slip),
            contact("right slip", RED, ContactName::Right, |sample| sample.longitudinal_slip),
        ],
        vec![
            contact("left load", BLUE, ContactName::Left, |sample| sample.normal_force),
            contact("right load", RED, ContactName::Right, |sample| sample.normal_force),
            contact("front load", GREY, ContactName::Front, |sample| sample.normal_force),
        ],
        vec![
            contact("left friction", BLUE, ContactName::Left, |sample| sample.longitudinal_force),
            contact("right friction", RED, ContactName::Right, |sample| sample.longitudinal_force),
        ],
        vec![
            over_time("x", BLUE, state(|s| s.configuration.x)),
            over_time("heading", RED, state(|s| s.configuration.heading)),
        ],
        vec![Curve { name: "phase of y", color: BLUE, x: position, y: speed }],
    ]
}

fn torques(solution: &Solution) -> Vec<Curve> {
    let schedule = &solution.schedule;
    let nodes = 0..=schedule.control_count();
    let time: Vec<f64> = nodes.map(|node| node as f64 * schedule.interval()).collect();
    // The last torque again at the end, so that its step is drawn.
    let steps = |torques: &[f64]| torques.iter().chain(torques.last()).copied().collect();
    vec![
        Curve { name: "left torque", color: BLUE, x: time.clone(), y: steps(&schedule.left) },
        Curve { name: "right torque", color: RED, x: time, y: steps(&schedule.right) },
    ]
}

fn per_step(
    trajectory: &Trajectory,
    name: &'static str,
    color: &'static str,
    contact: ContactName,
    value: fn(&ContactSample) -> f64,
) -> Curve {
    let samples = trajectory.contact.iter().map(|contacts| value(contacts.get(contact)));
    let (x, y) = trajectory.time.iter().skip(1).copied().zip(samples).unzip();
    Curve { name, color, x, y }
}

fn trace(curve: Curve, panel: usize) -> Box<dyn Trace> {
    let is_torque = panel == 0;
    let dash = if curve.color == RED && is_torque { DashType::Dot } else { DashType::Solid };
    let shape = if is_torque { LineShape::Hv } else { LineShape::Linear };
    let number = if panel == 0 { String::new() } else { (panel + 1).to_string() };
    Scatter::new(curve.x, curve.y)
        .name(curve.name)
        .mode(Mode::Lines)
        .line(Line::new().color(curve.color).dash(dash).shape(shape).width(2.0))
        .x_axis(format!("x{number}"))
        .y_axis(format!("y{number}"))
        .show_legend(false)
}

fn layout(solution: &Solution) -> Layout {
    let title = format!(
        "{} in {:.4} s; left wheel blue, right wheel red, front support grey",
        solution.status.as_str(),
        solution.schedule.final_time
    );
    let axis = |label: &str| Axis::new().title(label);
    Layout::new()
        .title(title)
        .width(WIDTH)
        .height(HEIGHT)
        .grid(LayoutGrid::new().rows(3).columns(2).pattern(GridPattern::Independent).x_gap(0.15).y_gap(0.25))
        .x_axis(axis("time [s]"))
        .y_axis(axis("torque [N m]"))
        .x_axis2(axis("time [s]"))
        .y_axis2(axis("longitudinal slip [m/s]"))
        .x_axis3(axis("time [s]"))
        .y_axis3(axis("normal force [N]"))
        .x_axis4(axis("time [s]"))
        .y_axis4(axis("longitudinal force [N]"))
        .x_axis5(axis("time [s]"))
        .y_axis5(axis("x [m] (blue), heading [rad] (red)"))
        .x_axis6(axis("y [m]"))
        .y_axis6(axis("velocity in y [m/s]"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::{RunControl, SolveInput, solve};

    #[test]
    fn page_holds_its_curves_and_its_script() {
        let page = html(&solve(&SolveInput::forward_drive(), &RunControl::unattended()).unwrap());
        for text in ["right slip", "torque [N m]", "phase of y"] {
            assert!(page.contains(text), "{text}");
        }
        assert!(!page.contains("<script src=\"http"), "nothing is fetched");
    }
}
