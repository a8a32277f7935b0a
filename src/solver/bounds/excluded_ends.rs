//! Starts and goals that the limits of a maneuver or the loads of its contacts exclude, found without any rollout.

use std::f64::consts::SQRT_2;

use nalgebra::{Rotation2, Vector2};

use super::largest_normal_force::{Rates, largest_normal_forces};
use crate::contact::ContactName;
use crate::motion::ROUNDING;
use crate::robot::{BodyVector, PerWheel, State};
use crate::shooting::{LIMIT_TOLERANCE, StateComponent};
use crate::solver::settings::SolveInput;
use crate::solver::solution::Reason;

/// An end of the maneuver: its state at the reference point, as far as it is given.
pub(super) struct End {
    name: &'static str,
    state: State,
    is_given: [bool; State::LEN],
}

const POSE: [StateComponent; 3] = [StateComponent::X, StateComponent::Y, StateComponent::Heading];
const VELOCITY: [StateComponent; 3] = [StateComponent::VelocityX, StateComponent::VelocityY, StateComponent::YawRate];
/// A larger tolerance (m, rad, m/s, rad/s) is another goal.
const LARGEST_ADVISED_TOLERANCE: f64 = 1e-2;
const WHEEL_RATES: [StateComponent; 2] = [StateComponent::WheelRateLeft, StateComponent::WheelRateRight];

/// What a limit makes impossible at the start, or else at the goal.
pub(super) fn excluded_end(input: &SolveInput) -> Option<Reason> {
    [End::start(input), End::goal(input)]
        .iter()
        .find_map(|end| end.leaves_aisle(input).or_else(|| end.exceeds_rates(input)).or_else(|| end.slips(input)))
}

/// The slip speed of a wheel that other wheel rates at the goal would take away, m/s; none where no wheel slips there so. Above the tolerance
/// itself such a slip is a burden, even where the tolerances of all components together allow it.
pub(in crate::solver) fn slip_by_wheel_rates(input: &SolveInput) -> Option<f64> {
    let Slip { along, across, slack } = End::goal(input).slip(input)?;
    (across <= slack && along > input.settings.goal_tolerance).then_some(along)
}

/// Whether wheels roll at every end of a step. With restitution one that sticks may slip at both ends.
fn may_not_slip(input: &SolveInput) -> bool {
    input.maneuver.forbids_slip() && input.robot.parameters().tangential_restitution == 0.0
}

/// The slip that an end asks for, m/s.
struct Slip {
    /// The larger of both wheels; 0 where wheel rates are left open.
    along: f64,
    /// Of both wheels: no wheel rates mend that.
    across: f64,
    /// What tolerances may be of it.
    slack: f64,
}

impl End {
    pub(super) fn start(input: &SolveInput) -> Self {
        Self { name: "start", state: input.maneuver.start, is_given: [true; State::LEN] }
    }

    pub(super) fn goal(input: &SolveInput) -> Self {
        let (mut state, mut is_given) = (State::default().to_vector(), [false; State::LEN]);
        for (component, value) in input.maneuver.goal.constrained() {
            (state[component.index()], is_given[component.index()]) = (value, true);
        }
        Self { name: "goal", state: State::from_vector(&state), is_given }
    }

    fn is_start(&self) -> bool {
        self.name == "start"
    }

    fn has(&self, components: &[StateComponent]) -> bool {
        components.iter().all(|component| self.is_given[component.index()])
    }

    /// The corner that is furthest outside.
    fn leaves_aisle(&self, input: &SolveInput) -> Option<Reason> {
        let aisle = input.aisle.as_ref().filter(|_| self.has(&POSE))?;
        let from_reference = input.maneuver.reference_point.to_axle_midpoint(input.robot.parameters());
        let pose = &self.state.configuration;
        let turn = Rotation2::new(pose.heading);
        let outside = aisle.footprint.corners().iter().flat_map(|corner| {
            let place = Vector2::new(pose.x, pose.y) + turn * (from_reference + corner);
            aisle.keep_in.edges().map(move |edge| (*corner, edge.normal.dot(&place) - edge.offset))
        });
        let (corner, distance) = outside.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let slack = input.settings.goal_tolerance * (SQRT_2 + (from_reference + corner).norm());
        let [right, forward] = corner.into();
        (distance > slack).then(|| {
            let outside = Reason::told(distance, slack);
            let message = format!(
                "at the {} the corner of `robot.footprint` at ({right}, {forward}) m (right, forward) is {outside} m outside \
                 `maneuver.keep_in`, must be inside; a wider aisle or another pose helps",
                self.name
            );
            self.reason(["start_outside", "goal_outside"], ("maneuver.keep_in", message), (distance, 0.0))
        })
    }

    fn exceeds_rates(&self, input: &SolveInput) -> Option<Reason> {
        let (limits, velocity) = (&input.maneuver.limits, &self.state.velocity);
        let (speed, play) = self.speed_of_payload(input);
        let wheels = self.wheel_rate(input);
        let (wheel_rate, play_of_wheel) = wheels.unwrap_or_default();
        [
            ("wheel_rate_rad_s", wheel_rate, limits.wheel_rate, wheels.is_some(), play_of_wheel),
            ("yaw_rate_rad_s", velocity.yaw_rate.abs(), limits.yaw_rate, self.has(&VELOCITY[2..]), 1.0),
            ("speed_m_s", speed, limits.speed, self.has(&VELOCITY) && !self.is_turned(input), play),
        ]
        .into_iter()
        .find_map(|(field, value, limit, is_given, play)| {
            let limit = limit.filter(|_| is_given)?;
            let slack = LIMIT_TOLERANCE * limit + play * input.settings.goal_tolerance;
            (value > limit + slack).then(|| {
                let field = format!("maneuver.limits.{field}");
                let message = format!(
                    "`{field}` is {limit}, which the {} exceeds with {}; a larger limit or a slower {} helps",
                    self.name,
                    Reason::told(value, limit),
                    self.name
                );
                self.reason(["start_exceeds_limit", "goal_exceeds_limit"], (&field, message), (value, limit))
            })
        })
    }

    /// The larger of both wheel rates, rad/s, and how many tolerances it may be of it: those that are given, or else those of wheels that
    /// roll because they may not slip.
    fn wheel_rate(&self, input: &SolveInput) -> Option<(f64, f64)> {
        let larger = |[left, right]: [f64; 2]| left.abs().max(right.abs());
        if self.has(&WHEEL_RATES) {
            let PerWheel { left, right } = self.state.velocity.wheel_rate;
            return Some((larger([left, right]), 1.0));
        }
        let ([left, right, _], play) = self.wheel_slip(input).filter(|_| may_not_slip(input))?;
        let radius = input.robot.parameters().wheel_radius;
        // Without rates of their own the wheels slip by the way that they would roll. They may slip by as much as tolerances are of that.
        Some((larger([left, right]) / radius, 2.0 * play / radius))
    }

    /// Whether the velocity is another one than that of the last node, of which limits speak: that of a goal with restitution, unless
    /// the robot does not yaw.
    fn is_turned(&self, input: &SolveInput) -> bool {
        let has_restitution = input.robot.parameters().tangential_restitution > 0.0;
        !self.is_start() && has_restitution && self.state.velocity.yaw_rate != 0.0
    }

    /// A reason with the code of the start, at time 0, or with that of the goal, whose time nobody knows.
    fn reason(
        &self,
        [at_start, at_goal]: [&'static str; 2],
        (field, message): (&str, String),
        (value, limit): (f64, f64),
    ) -> Reason {
        let (code, time) = if self.is_start() { (at_start, Some(0.0)) } else { (at_goal, None) };
        Reason { code, field: field.to_owned(), message, time, value, limit }
    }

    /// The least speed of the point that the limits speak of, m/s, at any heading where that is open, and how many tolerances it may be
    /// of it. A payload's centre turns around the reference point.
    fn speed_of_payload(&self, input: &SolveInput) -> (f64, f64) {
        let arm = input.limited_point() - input.maneuver.reference_point.offset(input.robot.parameters());
        let body = self.body_velocity();
        let yaw_rate = body[2].abs();
        let speed = if self.has(&POSE[2..]) {
            (body[0] - arm.y * body[2]).hypot(body[1] + arm.x * body[2])
        } else {
            (body[0].hypot(body[1]) - arm.norm() * yaw_rate).abs()
        };
        (speed, SQRT_2 + arm.norm() * (1.0 + yaw_rate))
    }

    /// At the reference point, in the frame of the heading.
    fn body_velocity(&self) -> BodyVector {
        let (heading, velocity) = (self.state.configuration.heading, &self.state.velocity);
        let planar = Rotation2::new(-heading) * Vector2::new(velocity.x, velocity.y);
        let wheels = velocity.wheel_rate;
        BodyVector::from([planar.x, planar.y, velocity.yaw_rate, wheels.left, wheels.right])
    }

    /// A wheel that slips where none may.
    fn slips(&self, input: &SolveInput) -> Option<Reason> {
        let Slip { along, across, slack } = self.slip(input).filter(|_| may_not_slip(input))?;
        let speed = along.max(across);
        if speed <= slack {
            return None;
        }
        let (how, help) = if across > slack {
            ("the wheels slip sideways", "a heading along the velocity, or a free one at the goal")
        } else {
            ("a wheel slips", "wheel rates that fit the velocity, or free ones at the goal")
        };
        // What may slip is in proportion to the tolerance.
        let needed = input.settings.goal_tolerance * speed / slack;
        let or_tolerance = if needed <= LARGEST_ADVISED_TOLERANCE {
            format!(", or a `solver.goal_tolerance` above {needed:.1e}")
        } else {
            String::new()
        };
        let [told, most] = [Reason::told(speed, slack), Reason::told(slack, speed)];
        let message = format!(
            "`maneuver.slip` is forbidden, but at the {} {how} by {told} m/s, must be at most {most}; \
             {help}{or_tolerance} would help",
            self.name
        );
        Some(self.reason(["start_slips", "goal_slips"], ("maneuver.slip", message), (speed, slack)))
    }

    /// None where the velocity is left open.
    fn slip(&self, input: &SolveInput) -> Option<Slip> {
        let (slip, play) = self.wheel_slip(input)?;
        let [left, right, across] = slip.map(f64::abs);
        let along = if self.has(&WHEEL_RATES) { left.max(right) } else { 0.0 };
        Some(Slip { along, across, slack: input.settings.goal_tolerance * play })
    }

    /// The slip of the wheels (left and right along, both across), m/s, with rates of 0 where none are given, and how many tolerances may be
    /// of it; none where the velocity is left open.
    fn wheel_slip(&self, input: &SolveInput) -> Option<([f64; 3], f64)> {
        if !(self.has(&POSE[2..]) && self.has(&VELOCITY)) {
            return None;
        }
        let parameters = input.robot.parameters();
        let offset = input.maneuver.reference_point.offset(parameters);
        let mut velocity = self.body_velocity();
        // Each component of a state may be off by the tolerance: a heading turns the velocity, a yaw rate swings the wheels.
        let speed = velocity[0].hypot(velocity[1]);
        let [left_wheel, right_wheel, _] = parameters.contact_points().map(|contact| (contact - offset).norm());
        let play = SQRT_2 + speed + left_wheel.max(right_wheel) + parameters.wheel_radius;
        velocity[0] += offset.y * velocity[2];
        velocity[1] -= offset.x * velocity[2];
        Some((input.robot.tangent_jacobian().wheel_slip(&velocity), play))
    }

    /// The contact whose normal force stays furthest below what it must be, whatever the torques: it separates, or misses its least load.
    /// See [`largest_normal_forces`].
    pub(super) fn unloads(&self, input: &SolveInput) -> Option<Reason> {
        if !(self.has(&VELOCITY[2..]) && self.has(&WHEEL_RATES)) {
            return None;
        }
        let velocity = &self.state.velocity;
        let (yaw_rate, wheels) = (velocity.yaw_rate, velocity.wheel_rate.left + velocity.wheel_rate.right);
        let slack = if self.is_start() { 0.0 } else { input.settings.goal_tolerance };
        let around = |value: f64, slack: f64| (value - slack, value + slack);
        let rates = Rates { yaw: around(yaw_rate, slack), wheels: around(wheels, 2.0 * slack) };
        let parameters = input.robot.parameters();
        let torque_limit = input.maneuver.torque_limit;
        let forces = |viscous_friction| largest_normal_forces(&input.robot, (torque_limit, viscous_friction), &rates);
        let largest = forces(parameters.wheel_viscous_friction);
        let weight = parameters.weight();
        let least = input.maneuver.limits.least_normal_loads(&input.robot) * weight;
        let missing = |contact: &ContactName| least[*contact as usize] - largest[*contact as usize];
        let contact = ContactName::ALL.into_iter().max_by(|a, b| missing(a).total_cmp(&missing(b)))?;
        if missing(&contact) <= ROUNDING * weight {
            return None;
        }
        let force = largest[contact as usize];
        let (codes, limit, effect, help) = if force < -ROUNDING * weight {
            (["start_separates", "goal_separates"], 0.0, "lifts", "")
        } else {
            let help = "a smaller `maneuver.limits.normal_load_share`, ";
            (["start_below_load_share", "goal_below_load_share"], least[contact as usize], "unloads", help)
        };
        let is_by_spin = least[contact as usize] - forces(0.0)[contact as usize] > ROUNDING * weight;
        let (component, rate, slower) = if is_by_spin {
            (StateComponent::YawRate, yaw_rate, "a slower spin or a lower centre of mass helps")
        } else {
            let PerWheel { left, right } = velocity.wheel_rate;
            let is_right = right.abs() > left.abs();
            let (component, rate) =
                if is_right { (StateComponent::WheelRateRight, right) } else { (StateComponent::WheelRateLeft, left) };
            (component, rate, "slower wheels, less `robot.wheel_viscous_friction_n_m_s` or larger torque limits help")
        };
        let field = format!("maneuver.{}.{}", self.name, component.field());
        let name = match contact {
            ContactName::Front => "front support".to_owned(),
            ContactName::Left | ContactName::Right => format!("{} wheel", contact.as_str()),
        };
        let [most, least] = [Reason::told(force, limit), Reason::told(limit, force)];
        let message = format!(
            "`{field}` is {rate}, which {effect} the {name} whatever the torques: its normal force is at most {most} N, \
             must be >= {least} N; {help}{slower}"
        );
        Some(self.reason(codes, (&field, message), (force, limit)))
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::robot::{Configuration, Payload, Velocity};
    use crate::shooting::{AisleCorners, ReferencePoint, SlipPolicy};
    use crate::solver::settings::SolveParameters;

    /// A state at the axle midpoint that rolls, any way round.
    fn rolling(rng: &mut Xoshiro256PlusPlus, parameters: &SolveParameters) -> State {
        let robot = &parameters.robot;
        let [heading, speed, yaw_rate] = [3.0, 10.0, 5.0].map(|most| rng.random_range(-most..most));
        let across = 0.5 * robot.track_width * yaw_rate;
        let wheel_rate = [speed - across, speed + across].map(|speed| speed / robot.wheel_radius);
        let [x, y] = (Rotation2::new(heading) * Vector2::y() * speed).into();
        State {
            configuration: Configuration { heading, ..State::default().configuration },
            velocity: Velocity { x, y, yaw_rate, wheel_rate: PerWheel::new(wheel_rate[0], wheel_rate[1]) },
        }
    }

    /// Limits that a state just keeps, and an aisle that it touches along a slanted wall.
    fn limit_to(state: &State, parameters: &mut SolveParameters, rng: &mut Xoshiro256PlusPlus) {
        let [right, forward] = [0; 2].map(|_| rng.random_range(-1.0..1.0));
        // A mass that rounds away only says which point is limited.
        parameters.payload = Some(Payload { mass: f64::MIN_POSITIVE, right, forward, height: 0.1, yaw_inertia: 0.0 });
        let velocity = &state.velocity;
        let turn = Rotation2::new(state.configuration.heading);
        let arm = turn * Vector2::new(right, forward);
        let speed = (Vector2::new(velocity.x, velocity.y) + velocity.yaw_rate * Vector2::new(-arm.y, arm.x)).norm();
        let limits = &mut parameters.maneuver.limits;
        (limits.speed, limits.yaw_rate) = (Some(speed), Some(velocity.yaw_rate.abs()));
        limits.wheel_rate = Some(velocity.wheel_rate.left.abs().max(velocity.wheel_rate.right.abs()));
        let footprint = [[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]].map(Vector2::from).to_vec();
        let keep_in = footprint.iter().map(|corner| turn * corner).collect();
        parameters.aisle = AisleCorners { keep_in, footprint };
    }

    #[test]
    fn a_goal_on_a_curve_may_be_faster_than_its_last_node_with_restitution() {
        for (restitution, yaw_rate, is_excluded) in
            [(0.0, 0.5, true), (0.4, 0.0, true), (0.4, 0.5, false), (1.0, -0.5, false)]
        {
            let mut parameters = SolveParameters::forward_drive();
            parameters.robot.tangential_restitution = restitution;
            parameters.maneuver.limits.speed = Some(0.9);
            let goal = &mut parameters.maneuver.goal;
            goal.set(StateComponent::VelocityY, Some(1.0));
            goal.set(StateComponent::YawRate, Some(yaw_rate));
            let excluded = excluded_end(&SolveInput::new(parameters).unwrap());
            assert_eq!(excluded.is_some(), is_excluded, "{restitution}, {yaw_rate}: {excluded:?}");
        }
    }

    #[test]
    fn wheels_that_may_not_slip_turn_as_fast_as_the_goal_asks() {
        for (slip, least_rate, is_excluded) in [
            (SlipPolicy::Forbidden, 16.66, true),
            (SlipPolicy::Forbidden, 16.67, false),
            (SlipPolicy::Allowed, 10.0, false),
        ] {
            let mut parameters = SolveParameters::forward_drive();
            parameters.maneuver.slip = slip;
            parameters.maneuver.limits.wheel_rate = Some(least_rate);
            let goal = &mut parameters.maneuver.goal;
            goal.set(StateComponent::VelocityY, Some(1.0));
            for rate in WHEEL_RATES {
                goal.set(rate, None);
            }
            let excluded = excluded_end(&SolveInput::new(parameters).unwrap());
            assert_eq!(excluded.map(|reason| reason.code), is_excluded.then_some("goal_exceeds_limit"), "{least_rate}");
        }
    }

    #[test]
    fn an_end_that_some_state_within_the_tolerances_keeps_to_is_not_excluded() {
        for seed in 0..2000 {
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
            let mut parameters = SolveParameters::forward_drive();
            parameters.maneuver.slip = SlipPolicy::Forbidden;
            parameters.maneuver.reference_point = ReferencePoint::AxleMidpoint;
            let state = rolling(&mut rng, &parameters);
            limit_to(&state, &mut parameters, &mut rng);
            let tolerance = 10_f64.powf(rng.random_range(-6.0..-1.0));
            parameters.settings.goal_tolerance = tolerance;
            let goal = &mut parameters.maneuver.goal;
            for (component, value) in StateComponent::ALL.into_iter().zip(state.to_vector().iter()) {
                let is_wheel_rate = WHEEL_RATES.contains(&component);
                let is_free = component == StateComponent::Heading && seed.is_multiple_of(2)
                    || is_wheel_rate && seed.is_multiple_of(3);
                if goal.constrained().any(|(constrained, _)| constrained == component) {
                    goal.set(component, (!is_free).then(|| value + tolerance * [-1.0, 1.0][rng.random_range(0..2)]));
                }
            }
            parameters.maneuver.start = state;
            let excluded = excluded_end(&SolveInput::new(parameters).unwrap());
            assert!(excluded.is_none(), "{seed} at {tolerance}: {excluded:?}");
        }
    }
}
