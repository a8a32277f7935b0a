//! The replay of a plan in words.

use super::words::short;
use crate::contract::message::{Replay, Report};
use crate::shooting::StateComponent;
use crate::solver::{REPLAY_EXCESS, SolveInput};

/// Where the replay ends, and what keeps it from being within its tolerances.
pub(super) fn replay(report: &Report, asked: &SolveInput) -> String {
    let Some(replay) = &report.replay else {
        return "Replay: not computed in time, so the plan is not confirmed on a finer grid.".to_owned();
    };
    let beyond = beyond_tolerance(report, replay, asked);
    let verdict = if beyond.is_empty() { String::new() } else { format!(" Above tolerance: {}.", beyond.join(", ")) };
    format!(
        "Replay: the same torques on a finer grid of {} steps end {} mm and {} rad from the goal; tolerated are {} mm and {} rad, and \
         of speeds what moves the robot as far in a second.{verdict}",
        replay.steps,
        short(1e3 * replay.miss_m),
        short(replay.miss_heading_rad),
        short(1e3 * asked.settings.replay_tolerance_position),
        short(asked.settings.replay_tolerance_heading),
    )
}

fn beyond_tolerance(report: &Report, replay: &Replay, asked: &SolveInput) -> Vec<String> {
    let (position, heading) = (asked.settings.replay_tolerance_position, asked.settings.replay_tolerance_heading);
    let wheel_angles = [StateComponent::WheelAngleLeft, StateComponent::WheelAngleRight];
    let fixes_angle = wheel_angles.into_iter().any(|angle| asked.maneuver.goal.value(angle).is_some());
    let misses = [
        (if fixes_angle { "the place or a wheel's rim" } else { "the place" }, replay.miss_m, position, 1e3, "mm"),
        ("the heading", replay.miss_heading_rad, heading, 1.0, "rad"),
        ("the speed", replay.miss_speed_m_s, position, 1e3, "mm/s"),
        ("the yaw rate", replay.miss_yaw_rate_rad_s, heading, 1.0, "rad/s"),
        ("the speed of a wheel", replay.miss_wheel_speed_m_s, position, 1e3, "mm/s"),
    ];
    let missed = misses.into_iter().filter(|(_, miss, tolerance, ..)| miss > tolerance);
    let missed = missed.map(|(what, miss, _, scale, unit)| format!("{what} misses by {} {unit}", short(scale * miss)));
    let limits = report.limits.iter().filter(|used| used.replay_excess.is_some_and(|excess| excess > REPLAY_EXCESS));
    let exceeded = limits.map(|used| format!("{} exceeded", used.limit));
    let separates = (replay.separations > 0).then(|| "a contact separates".to_owned());
    missed.chain(exceeded).chain(separates).collect()
}
