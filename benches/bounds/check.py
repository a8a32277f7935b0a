#!/usr/bin/env python3
"""The lower bound of a straight drive from rest to rest, recomputed in interval arithmetic from docs/bounds.md.

Shows that no plan drives as far as asked in the time that an answer quotes as `lower_bound_s`, nor in less, since the distance
grows with the time. All quantities are intervals with outward rounding; floats appear only as choices (shares of balances,
multipliers, times of cuts) of which every one gives a valid bound. The robot needs a front support without friction and no tangential restitution.

    pip install -r benches/bounds/requirements.txt
    cargo run --release -- solve benches/bounds/forward_drive.json --json answer.json
    python3 benches/bounds/check.py benches/bounds/forward_drive.json answer.json
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from typing import Any, Callable

from mpmath import iv, mpf

iv.dps = 25
INFINITY = math.inf
LAW_ERROR = iv.mpf("1e-10")
WEIGHTS = ((1, 0), (4, 1), (2, 1), (1.5, 1), (1, 1), (1, 1.5), (1, 2), (1, 4), (0, 1))
BALANCES = TURNS = 16
LEVELS = 32
# Of the whole motion.
ERROR_SPANS = 64
# The largest value of sin^3 x cos x is sqrt(27) / 16.
YAW_BESIDE_TRANSLATION = iv.sqrt(27) / 16
Interval = Any
Side = tuple[tuple[float, float], list[Interval]]  # weights of the wheels, and what their sum is at least with each torque


def low(x: Interval) -> float:
    """A float at most x."""
    return math.nextafter(float(mpf(x.a)), -INFINITY)


def high(x: Interval) -> float:
    """A float at least x."""
    return math.nextafter(float(mpf(x.b)), INFINITY)


def middle(x: Interval) -> float:
    return float(mpf(x.mid))


def largest(*values: Interval) -> Interval:
    return iv.mpf([max(mpf(v.a) for v in values), max(mpf(v.b) for v in values)])


def least(*values: Interval) -> Interval:
    return iv.mpf([min(mpf(v.a) for v in values), min(mpf(v.b) for v in values)])


def dot(a: list[Interval], b: list[Interval]) -> Interval:
    return sum((x * y for x, y in zip(a, b)), iv.mpf(0))


def norm(a: list[Interval]) -> Interval:
    return iv.sqrt(dot(a, a))


def combine(*terms: tuple[Interval, list[Interval]]) -> list[Interval]:
    return [sum((scale * form[i] for scale, form in terms), iv.mpf(0)) for i in range(len(terms[0][1]))]


class Robot:
    """Masses, levers, and the normal forces as linear forms.

    A form lists the factors of 1, the forces f_L, y_L, f_R, y_R (longitudinal, lateral), the torques M_L, M_R, the squared
    yaw rate, and the yaw rate times the sum of the wheel rates.
    """

    def __init__(self, fields: dict[str, float], torque_limits: tuple[float, float]) -> None:
        def of(name: str) -> Interval:
            return iv.mpf(repr(fields[name]))

        assert fields["front_friction_coefficient"] == 0 and fields["tangential_restitution"] == 0
        chassis, wheel, gravity = of("chassis_mass_kg"), of("wheel_mass_kg"), of("gravity_m_s2")
        right, forward = of("center_of_mass_right_m"), of("center_of_mass_forward_m")
        half_track, length = of("track_width_m") / 2, of("axle_to_front_support_m")
        self.radius, self.spin = of("wheel_radius_m"), of("wheel_spin_inertia_kg_m2")
        self.friction = of("wheel_friction_coefficient")
        self.limits = [iv.mpf(repr(limit)) for limit in torque_limits]
        self.mass = chassis + 2 * wheel
        self.weight = self.mass * gravity
        self.law_error = LAW_ERROR * self.weight
        # Points relative to the chassis centre of mass, as (right, forward).
        points = [[-right - half_track, -forward], [-right + half_track, -forward],
                  [of("front_support_right_m") - right, length - forward]]
        center = [-2 * wheel * right / self.mass, -2 * wheel * forward / self.mass]
        self.lever = norm(center)
        inertia = of("chassis_yaw_inertia_kg_m2") + 2 * of("wheel_diametral_inertia_kg_m2")
        inertia += wheel * (dot(points[0], points[0]) + dot(points[1], points[1]))
        self.yaw_inertia = inertia - self.mass * dot(center, center)
        self.levers = [[p[0] - center[0], p[1] - center[1]] for p in points]
        self.moments = [[lever[0], -lever[1]] for lever in self.levers[:2]]

        unit = [[iv.mpf(int(i == j)) for i in range(9)] for j in range(9)]
        force_forward, force_right = combine((1, unit[1]), (1, unit[3])), combine((1, unit[2]), (1, unit[4]))
        yaw = combine(*((self.moments[i][j] / self.yaw_inertia, unit[1 + 2 * i + j]) for i in (0, 1) for j in (0, 1)))
        # The chassis moves with G, but for the turn about it.
        chassis_forward = combine((1 / self.mass, force_forward), (-center[0], yaw), (center[1], unit[7]))
        chassis_right = combine((1 / self.mass, force_right), (center[1], yaw), (center[0], unit[7]))
        spin_up = combine((1, unit[5]), (1, unit[6]), (-self.radius, force_forward))
        height_moment = chassis * of("center_of_mass_height_m") + 2 * wheel * self.radius
        wheel_moment, wheels_right = wheel * self.radius, points[0][0] + points[1][0]
        pitch = combine((-height_moment, chassis_forward), (-wheel_moment * wheels_right, yaw), (-1, spin_up),
                        (2 * wheel_moment * points[0][1], unit[7]))
        roll = combine((height_moment, chassis_right), (-2 * wheel_moment * points[0][1], yaw),
                       (-wheel_moment * wheels_right, unit[7]), (-self.spin, unit[8]))
        front = combine((chassis * gravity * forward / length, unit[0]), (1 / length, pitch))
        rear = combine((self.weight, unit[0]), (-1, front))
        # Moments of the normal forces about the axis through the chassis centre of mass.
        moment = combine((wheel * gravity * wheels_right, unit[0]), (-1, roll), (-points[2][0], front))
        to_right = combine((1 / (2 * half_track), moment), (-points[0][0] / (2 * half_track), rear))
        self.front, self.normal = front, [combine((1, rear), (-1, to_right)), to_right]
        assert low(front[7]) >= 0, "yaw must not relieve the front support"

    def bound(self, gain: Callable[[int, Interval, list[Interval]], Interval]) -> list[Interval]:
        """Largest weighted sum of the friction forces as (at rest, per left torque, per right torque)."""
        best, best_value = None, INFINITY
        for index in range(BALANCES + 1):
            share = iv.mpf(index) / BALANCES
            responses = [[share * self.front[1 + 2 * i], share * self.front[2 + 2 * i]] for i in (0, 1)]
            if any(high(norm(response)) >= low(1 / self.friction) for response in responses):
                continue
            top = largest(*(gain(i, 1 / self.friction, response) for i, response in enumerate(responses)))
            load = self.weight - share * self.front[0] + self.law_error * (1 + sum(map(norm, responses)))
            found = [top * load, -top * share * self.front[5], -top * share * self.front[6]]
            value = middle(self.over_torques(found))
            if value < best_value:
                best, best_value = found, value
        assert best is not None
        return best

    def over_torques(self, bound: list[Interval]) -> Interval:
        return bound[0] + abs(bound[1]) * self.limits[0] + abs(bound[2]) * self.limits[1]

    def weighted(self, weights: list[list[Interval]]) -> list[Interval]:
        bound = self.bound(lambda i, cost, response: gain_along(weights[i], cost, response))
        return [bound[0] + sum(map(norm, weights)) * self.law_error, *bound[1:]]

    def largest_along(self, heading_error: Interval, sign: int) -> Interval:
        """Largest friction along a direction that is ahead (1) or astern (-1), but for an angle, N."""

        def gain(_: int, cost: Interval, response: list[Interval]) -> Interval:
            size = norm(response)
            if low(size) <= 0:
                return 1 / cost
            # The angle between the direction and where the response relieves the most.
            apart = acos_low(-sign * response[0] / size) - heading_error
            apart = largest(apart, iv.mpf(0))
            return gain_along([iv.cos(apart), iv.sin(apart)], cost, [-size, iv.mpf(0)])

        return self.over_torques(self.bound(gain)) + 3 * self.law_error


def acos_low(cosine: Interval) -> Interval:
    """A number at most the angle."""
    angle = math.acos(max(-1.0, min(1.0, middle(cosine)))) - 1e-12
    assert angle < 0 or low(iv.cos(iv.mpf(angle)) - cosine) >= 0
    return iv.mpf(angle)


def gain_along(weight: list[Interval], cost: Interval, response: list[Interval]) -> Interval:
    along, margin = dot(weight, response), cost * cost - dot(response, response)
    return (iv.sqrt(along * along + margin * dot(weight, weight)) - along) / margin


class DriveNorm:
    """The drive norm, and how fast torque raises it."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.gains = []
        for lever in robot.levers[:2]:
            contact = 1 / robot.mass + lever[0] ** 2 / robot.yaw_inertia
            self.gains.append(iv.sqrt(contact / (robot.radius ** 2 + robot.spin * contact)))
        # Any rate within the gains.
        rate = iv.mpf(min(low(self.gains[0]), low(self.gains[1]), low(1 / (2 * iv.sqrt(robot.spin)))))
        yaw = iv.sqrt(1 - 2 * robot.spin * rate ** 2)
        self.yaw_times_wheels = 1 / (4 * yaw * rate * robot.spin * iv.sqrt(robot.yaw_inertia))
        slips = sum(iv.sqrt(1 / robot.mass + dot(lever, lever) / robot.yaw_inertia) for lever in robot.levers)
        self.margin = robot.law_error * (slips + robot.radius * sum(self.gains))
        self.bounds = [self.load_bound(weights) for weights in WEIGHTS]

    def at_most(self, forces: list[float], torques: list[Interval]) -> Interval:
        """At most the norm of what lengthwise forces and torques cause in a second."""
        robot, gains = self.robot, [middle(gain) for gain in self.gains]
        moment = dot([iv.mpf(f) for f in forces], [lever[0] for lever in robot.levers[:2]])
        body = iv.mpf(sum(map(iv.mpf, forces))) ** 2 / robot.mass + moment ** 2 / robot.yaw_inertia
        rates = [abs(torque - robot.radius * force) / robot.spin for torque, force in zip(torques, forces)]
        kept = [middle(rate) for rate in rates]
        for _ in range(60):
            scale = math.sqrt(middle(body) + middle(robot.spin) * (kept[0] ** 2 + kept[1] ** 2))
            kept = [min(rate, gain * scale) for rate, gain in zip(kept, gains)]
        excess = [abs(rate - k) * gain * robot.spin for rate, k, gain in zip(rates, kept, self.gains)]
        return iv.sqrt(body + robot.spin * (iv.mpf(kept[0]) ** 2 + iv.mpf(kept[1]) ** 2)) + sum(excess)

    def load_bound(self, weights: tuple[float, float]) -> tuple[list[Interval], Interval]:
        """Least weighted sum of the wheels' normal forces by torque, and what yaw takes off it per squared norm."""
        robot = self.robot
        form = combine((weights[0], robot.normal[0]), (weights[1], robot.normal[1]))
        relieved = robot.weighted([[-form[1], -form[2]], [-form[3], -form[4]]])
        at_rest = [form[0] - relieved[0], form[5] - relieved[1], form[6] - relieved[2]]
        relief = largest(-form[7], iv.mpf(0)) / robot.yaw_inertia + abs(form[8]) * self.yaw_times_wheels
        return at_rest, relief

    def corners(self) -> list[list[Interval]]:
        return [[a * self.robot.limits[0], b * self.robot.limits[1]] for a in (1, -1) for b in (1, -1)]

    def sides(self, norm_squared: Interval) -> list[Side]:
        """Bounds that neighbours cross where no wheel has less than nothing: any of them say enough."""
        sides = []
        for weights, (rest, relief) in zip(WEIGHTS, self.bounds):
            known = [rest[0] + rest[1] * left + rest[2] * right - relief * norm_squared for left, right in self.corners()]
            is_single = 0 in weights
            sides.append((weights, [iv.mpf(0)] * 4 if is_single and any(low(value) < 0 for value in known) else known))
        place = 0
        while place + 1 < len(sides):
            normals = crossings(*sides[place:place + 2])
            less = [any(low(normal[wheel]) < 0 for normal in normals) for wheel in (0, 1)]
            if place > 0 and less[0]:
                del sides[place]
                place -= 1
            elif place + 2 < len(sides) and less[1]:
                del sides[place + 1]
            else:
                place += 1
        return sides

    def rate(self, norm_squared: Interval) -> Interval:
        rates, sides = [], self.sides(norm_squared)
        for neighbours in zip(sides, sides[1:]):
            for torque, normal in zip(self.corners(), crossings(*neighbours)):
                limits = [max(low(self.robot.friction * n), 0.0) for n in normal]
                rates.append(self.at_most(self.rolling_forces(torque, limits), torque))
        return largest(*rates)

    def rolling_forces(self, torque: list[Interval], limits: list[float]) -> list[float]:
        robot, forces = self.robot, [0.0, 0.0]
        mass, inertia, spin, radius = map(middle, (robot.mass, robot.yaw_inertia, robot.spin, robot.radius))
        levers = [middle(lever[0]) for lever in robot.levers[:2]]
        for _ in range(30):
            for i, j in ((0, 1), (1, 0)):
                slip = (1 / mass + levers[0] * levers[1] / inertia) * forces[j] - radius * middle(torque[i]) / spin
                rolling = -slip / (1 / mass + levers[i] ** 2 / inertia + radius ** 2 / spin)
                forces[i] = max(-limits[i], min(limits[i], rolling))
        return forces

    def levels(self) -> list[tuple[float, Interval]]:
        """Rates of growth up to norms."""
        ends = []
        for rest, relief in (self.bounds[0], self.bounds[-1]):
            most = largest(iv.mpf(0), *(rest[0] + rest[1] * t[0] + rest[2] * t[1] for t in self.corners()))
            ends.append(middle(most / relief))
        squares = [max(ends) * index / LEVELS for index in range(1, LEVELS + 1)]
        levels = [(low(iv.sqrt(iv.mpf(s))), self.margin + self.rate(iv.mpf(s))) for s in squares]
        return [*levels, (INFINITY, self.margin + dot(self.gains, self.robot.limits))]


def crossings(one: Side, other: Side) -> list[list[Interval]]:
    """Normal forces at which two bounds hold with equality, for each corner of the torques."""
    (a, left), (b, right) = one, other
    determinant = a[0] * b[1] - a[1] * b[0]
    return [[(b[1] * x - a[1] * y) / determinant, (a[0] * y - b[0] * x) / determinant] for x, y in zip(left, right)]


@dataclass
class Segment:
    """value + slope * (time - start) from a start to an end."""

    start: float
    end: float
    value: Interval
    slope: Interval

    def at(self, time: float) -> Interval:
        return self.value + self.slope * (iv.mpf(time) - self.start)


def by_value(levels: list[tuple[float, Interval]], start: Interval, extra: Callable[[Interval], Interval],
             duration: float) -> list[Segment]:
    segments, time, value = [], 0.0, start
    for until, rate in levels:
        if until <= low(start):
            continue
        slope = rate + extra(iv.mpf(until))
        # An earlier time is safe, since rates rise.
        reached = INFINITY if until == INFINITY else time + low((iv.mpf(until) - value) / slope)
        segments.append(Segment(time, min(max(reached, time), duration), value, slope))
        if reached >= duration:
            break
        value, time = segments[-1].at(segments[-1].end), segments[-1].end
    return segments


def by_time(levels: list[tuple[float, Interval]], advance: float, duration: float) -> list[Segment]:
    segments, time, value = [], 0.0, iv.mpf(0)
    for until, rate in levels:
        if until <= advance:
            continue
        segments.append(Segment(time, min(until - advance, duration), value, rate))
        if segments[-1].end >= duration:
            break
        value, time = segments[-1].at(segments[-1].end), segments[-1].end
    return segments


def reversed_in_time(segments: list[Segment], duration: float) -> list[Segment]:
    def flipped(s: Segment) -> Segment:
        return Segment(duration - s.end, duration - s.start, s.at(s.end), -s.slope)

    # Times of the flipped cuts round; the values are those at the exact cuts, so each piece is widened to them.
    result = [flipped(s) for s in reversed(segments)]
    for piece, source in zip(result, reversed(segments)):
        exact = iv.mpf(duration) - source.end
        piece.value = source.at(source.end) - source.slope * (iv.mpf(piece.start) - exact)
    return result


@dataclass
class Piece:
    start: float
    end: float
    curve: int
    value: Interval
    end_value: Interval

    def power_area(self, power: int) -> Interval:
        total = sum((self.value ** j * self.end_value ** (power - j) for j in range(power + 1)), iv.mpf(0))
        return (iv.mpf(self.end) - self.start) * total / (power + 1)


def envelope(curves: list[list[Segment]]) -> list[Piece]:
    """Pieces of the curves that are about the lowest: any choice bounds the lowest from above."""
    cuts = sorted({cut for curve in curves for s in curve for cut in (s.start, s.end)})

    def segment(curve: list[Segment], time: float) -> Segment:
        return next(s for s in curve if s.start <= time <= s.end)

    pieces: list[Piece] = []
    for start, end in zip(cuts, cuts[1:]):
        center = 0.5 * (start + end)
        active = [segment(curve, center) for curve in curves]
        crossings = {start, end}
        for i, a in enumerate(active):
            for b in active[:i]:
                closing = middle(a.slope - b.slope)
                if closing != 0:
                    time = start + middle(b.at(start) - a.at(start)) / closing
                    if start < time < end:
                        crossings.add(time)
        times = sorted(crossings)
        for a, b in zip(times, times[1:]):
            curve = min(range(len(curves)), key=lambda i: middle(active[i].at(0.5 * (a + b))))
            pieces.append(Piece(a, b, curve, active[curve].at(a), active[curve].at(b)))
    return pieces


class Drive:
    """How far the robot gets in a time, at most."""

    def __init__(self, request: dict[str, Any]) -> None:
        maneuver = request["maneuver"]
        limits = (maneuver["torque_limit_left_n_m"], maneuver["torque_limit_right_n_m"])
        self.robot = robot = Robot(request["robot"], limits)
        self.steps, self.tolerance = request["grid"]["steps"], iv.mpf(repr(request["solver"]["goal_tolerance"]))
        self.distance = iv.mpf(repr(maneuver["goal"]["y_m"]))
        assert maneuver["goal"]["x_m"] == 0 and maneuver["goal"]["heading_rad"] == 0 and "start" not in maneuver
        norm_of_drive = DriveNorm(robot)
        self.levels = norm_of_drive.levels()
        moments = [robot.weighted([[s * a for a in moment] for moment in robot.moments]) for s in (1, -1)]
        self.yaw_acceleration = largest(*map(robot.over_torques, moments)) / robot.yaw_inertia
        # 2 (2 sum of errors)^(1/2): the trace of a contact's Delassus block bounds its largest eigenvalue.
        errors = iv.mpf(0)
        for lever in robot.levers[:2]:
            trace = 2 / robot.mass + dot(lever, lever) / robot.yaw_inertia + robot.radius ** 2 / robot.spin
            errors += robot.law_error * trace * robot.friction * robot.weight
        self.direction_error = 2 * iv.sqrt(2 * errors)
        # With a thousandth for the rounding of the rollout.
        slack = self.tolerance * iv.mpf("1.001")
        self.ahead = self.pushes(1, iv.mpf(0), iv.mpf(0))
        self.astern = self.pushes(-1, slack, slack)
        self.slack = slack

    def pushes(self, sign: int, slack: Interval, yaw_rate: Interval) -> list[tuple[float, Interval]]:
        """Accelerations by the time in which yaw cannot turn the robot further."""
        levels = []
        for index in range(1, TURNS + 1):
            turn = iv.pi * index / TURNS
            left = largest(turn - slack, iv.mpf(0))
            until = 2 * left / (yaw_rate + iv.sqrt(yaw_rate ** 2 + 2 * self.yaw_acceleration * left))
            rate = self.robot.largest_along(turn, sign) / self.robot.mass
            levels.append((INFINITY if index == TURNS else low(until), rate))
        return levels

    def required(self) -> Interval:
        """Distance of G: start and goal have the same heading, within the tolerance."""
        return self.distance - self.slack * (1 + self.robot.lever)

    def furthest(self, duration: float) -> Interval:
        robot, lever, alpha = self.robot, self.robot.lever, self.yaw_acceleration
        dt = iv.mpf(duration) / self.steps
        line = [Segment(0.0, duration, iv.mpf(0), alpha)]
        yaw_curves = [line, reversed_in_time([Segment(0.0, duration, self.slack, alpha)], duration)]
        peak = largest(*(v for p in envelope(yaw_curves) for v in (p.value, p.end_value)))
        drive = self.drive_curve(duration, dt, peak)
        inverse = 1 / iv.sqrt(robot.yaw_inertia)
        yaw = envelope([*yaw_curves, [Segment(s.start, s.end, inverse * s.value, inverse * s.slope) for s in drive]])
        peak = largest(*(v for p in yaw for v in (p.value, p.end_value)))
        x = dt * peak / 2
        assert high(x) < 1, "a step turns too far"
        imaginary = 1 - 2 * x * iv.cos(x) / iv.sin(x) + (x / iv.sin(x)) ** 2
        per_yaw = dt * alpha * iv.sqrt(1 + (imaginary / (2 * x)) ** 2)
        at_nodes = 2 * peak * (x / iv.sin(x) - 1) + 2 * dt * per_yaw * peak

        def yaw_integral(power: int, time: float = INFINITY) -> Interval:
            total = iv.mpf(0)
            for p in yaw:
                if p.end <= time:
                    total += p.power_area(power)
                elif p.start < time:
                    share = (iv.mpf(time) - p.start) / (iv.mpf(p.end) - p.start)
                    total += Piece(p.start, time, 0, p.value, p.value + share * (p.end_value - p.value)).power_area(power)
            return total

        def since_start(time: float) -> Interval:
            return lever * (per_yaw * yaw_integral(1, time) + at_nodes)

        def until_end(time: float) -> Interval:
            return lever * (per_yaw * (yaw_integral(1) - yaw_integral(1, time)) + at_nodes)

        inverse = 1 / iv.sqrt(robot.mass)
        forward = by_time(self.ahead, high(dt), duration)
        backward = by_time(self.astern, high(dt), duration)
        # Speed that the goal's tolerance leaves.
        end_speed = self.slack * (1 + lever * (1 + self.slack))
        backward = [Segment(s.start, s.end, s.value + end_speed, s.slope) for s in backward]
        curves = [forward, reversed_in_time(backward, duration),
                  [Segment(s.start, s.end, inverse * s.value, inverse * s.slope) for s in drive]]
        area = iv.mpf(0)
        for p in envelope(curves):
            area += p.power_area(1)
            count = max(1, math.ceil(ERROR_SPANS * (p.end - p.start) / duration))
            span = (p.end - p.start) / count
            for index in range(count):
                start = p.start + span * index
                end = p.end if index + 1 == count else p.start + span * (index + 1)
                if p.curve < 2:
                    error = since_start(end) if p.curve == 0 else until_end(start)
                    area += iv.mpf(span) * (1 + iv.mpf("1e-12")) * error
        rises = [forward[-1].slope - forward[0].slope, backward[-1].slope - backward[0].slope,
                 inverse * (drive[-1].slope - drive[0].slope)]
        convexity = dt ** 2 / 8 * sum(rises)
        jerk = yaw_integral(3) + 3 * alpha * yaw_integral(1) + 2 * dt * (peak ** 3 + 3 * alpha * peak)
        return area + convexity + lever * dt ** 2 / 12 * jerk + dt * since_start(duration)

    def drive_curve(self, duration: float, dt: Interval, peak: Interval) -> list[Segment]:
        robot = self.robot
        half_step = dt / 2 * robot.lever * iv.sqrt(robot.mass)
        bend = iv.sqrt(1 + (dt * peak) ** 2 / 9)

        def turning(value: Interval) -> Interval:
            cube = peak ** 3
            if mpf(value.b) != mpf("inf"):
                cube = least(cube, YAW_BESIDE_TRANSLATION * (value / iv.sqrt(robot.yaw_inertia)) ** 3)
            return half_step * bend * cube

        start = self.direction_error * iv.sqrt(dt * duration)
        curve = by_value(self.levels, start, turning, duration)
        end = curve[-1].at(duration)
        assert high(half_step * end / robot.yaw_inertia) <= 0.5, "a step turns too far"
        return curve


def main() -> int:
    request, answer = (json.load(open(path, encoding="utf-8")) for path in sys.argv[1:3])
    quoted = answer["report"]["lower_bound_s"]
    drive = Drive(request)
    reached, required = drive.furthest(quoted), drive.required()
    holds = high(reached) < low(required)
    print(f"lower_bound_s {quoted}: at most {high(reached):.9f} m of {low(required):.9f} m by then")
    lower, upper = 0.5 * quoted, 2.0 * quoted
    while upper - lower > 1e-5 * upper:
        center = 0.5 * (lower + upper)
        lower, upper = (center, upper) if high(drive.furthest(center)) < low(required) else (lower, center)
    print(f"recomputed {lower:.6f} s; the quoted bound is {'proved' if holds else 'NOT proved'}")
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
