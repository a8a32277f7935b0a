//! Plans as figures, and figures as messages.

use super::words;
use crate::contract::message;
use crate::contract::message::PlanInWords;
use crate::jobs::plan::{AcceptedPlan, Said};
use crate::plot;
use crate::simulation::Trajectory;

/// The figures of plans with their motions.
pub(super) fn figures(plans: &[(&AcceptedPlan, &Trajectory)], words: &[PlanInWords]) -> Vec<plot::Figure> {
    let plans: Vec<_> = plans.iter().zip(words).map(|(plan, words)| shown(plan, &words.label)).collect();
    plot::figures(&plans)
}

fn shown<'a>((plan, trajectory): &(&'a AcceptedPlan, &'a Trajectory), name: &'a str) -> plot::Plan<'a> {
    let AcceptedPlan { said, motion, corners } = *plan;
    let (goal, torque_limit, limits) = match said {
        Said::Solve(asked, _) => {
            (Some(&asked.maneuver.goal), Some(asked.maneuver.torque_limit), &asked.maneuver.limits)
        }
        Said::Simulate(_) => (None, None, &motion.limits),
    };
    plot::Plan {
        name,
        outcome: words::outcome(plan),
        fault: words::fault(plan, trajectory),
        robot: &motion.robot,
        reference_point: motion.reference_point,
        start: motion.start,
        goal,
        torque_limit,
        limits,
        footprint: &corners.footprint,
        keep_in: &corners.keep_in,
        schedule: &motion.schedule,
        trajectory,
    }
}

impl From<&plot::Figure> for message::Figure {
    fn from(figure: &plot::Figure) -> Self {
        let plot::Figure { name, title, caption, size: [width_px, height_px], svg, maps } = figure;
        Self {
            name: (*name).to_owned(),
            title: (*title).to_owned(),
            caption: caption.clone(),
            width_px: *width_px,
            height_px: *height_px,
            svg: svg.clone(),
            maps: maps.iter().map(Into::into).collect(),
        }
    }
}

impl From<&plot::AxesMap> for message::AxesMap {
    fn from(map: &plot::AxesMap) -> Self {
        let plot::AxesMap { axes, x, y } = map;
        Self { axes: (*axes).to_owned(), x: Some(x.into()), y: Some(y.into()) }
    }
}

impl From<&plot::AxisMap> for message::AxisMap {
    fn from(map: &plot::AxisMap) -> Self {
        let plot::AxisMap { quantity, data, px } = map;
        Self { quantity: (*quantity).to_owned(), data: data.to_vec(), px: px.to_vec() }
    }
}
