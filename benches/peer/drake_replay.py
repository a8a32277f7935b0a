#!/usr/bin/env python3
"""Replays plans that keep off their grip in Drake, on a floor with a little less friction: the wheels should not slip.

Drake is a judge that shares nothing with slipdrive: rigid bodies in space, compliant contacts, its own friction solver.
The robot is a free chassis with two hinged wheels, which touch the floor as spheres, and a frictionless ball in front;
the torques of a plan are applied open loop. By hand only: `pip install drake==1.51.1`.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import AddContactMaterial, HalfSpace, ProximityProperties, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, RigidBody, RotationalInertia, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from maneuver import robot_from_wire
from mechanics import Robot
from suite import read_suite

# Grip that the plans may use, and the share of the friction coefficient that Drake's floor has.
GRIP_UTILIZATION = 0.9
FRICTION_SHARE = 0.95
# Largest slip of a wheel that passes, m/s.
SLIP_TOLERANCE = 1e-3
TIME_STEP = 1e-4
# Drake's friction reaches its full force at about this slip, m/s.
STICTION_TOLERANCE = 1e-4
# How deep a contact sinks in that carries the whole weight, m, and what dampens that, s/m: what is left of a wheel's
# radius decides how far it rolls.
PENETRATION = 1e-6
DISSIPATION = 50.0
# The robot comes to rest on its contacts before the torques begin, s.
SETTLING_TIME = 0.3
# Radius of the front ball over the wheel radius.
FRONT_RADIUS_SHARE = 0.5
# Pitch and roll inertia of the chassis over its yaw inertia; the planar model has none.
TILT_INERTIA_SHARE = 0.7

# No rigid body spins with more than twice its diametral inertia, but a wheel with rotor and gear does: what its
# diametral inertia gets more here, the chassis gets less, and the robot as a whole turns as before.
LEAST_DIAMETRAL_SHARE = 0.51

# Robot of the suite, goal, and limits beside the grip.
PLANS: tuple[tuple[str, dict[str, Any], dict[str, float]], ...] = (
    ("reference", {"x_m": 0.0, "y_m": 5.0}, {}),
    ("reference", {"x_m": 1.0, "y_m": 2.0}, {}),
    ("reference", {"heading_rad": math.pi / 2.0}, {}),
    ("reference", {"x_m": 0.0, "y_m": -2.0}, {}),
    ("warehouse", {"x_m": 0.0, "y_m": 5.0}, {"speed_m_s": 1.5}),
    ("warehouse", {"x_m": -1.0, "y_m": 2.0}, {}),
    ("slippery", {"x_m": 0.0, "y_m": 3.0}, {}),
    ("grippy", {"x_m": 1.0, "y_m": 1.0, "heading_rad": -math.pi / 2.0}, {}),
    ("offset", {"x_m": 0.0, "y_m": 3.0}, {}),
    ("tall", {"x_m": 0.0, "y_m": 3.0}, {"speed_m_s": 1.5}),
)


@dataclass(frozen=True)
class Replay:
    """What Drake says of a plan.

    `slip_m_s`: largest speed of a wheel's contact point, left and right, and `slip_time_s` when. `miss_m`, `miss_rad`:
    where the replay ends against the goal, open loop on a floor that is not the plan's.
    """

    slip_m_s: float
    slip_time_s: float
    miss_m: float
    miss_rad: float


class DrakeRobot:
    """One robot on Drake's floor. Body frame: x right, y forward, z up, origin on the floor under the axle midpoint."""

    def __init__(self, robot: Robot, approximation: str) -> None:
        self._robot = robot
        config = MultibodyPlantConfig(
            time_step=TIME_STEP,
            contact_model="point",
            discrete_contact_approximation=approximation,
            stiction_tolerance=STICTION_TOLERANCE,
        )
        builder = DiagramBuilder()
        self.plant, _ = AddMultibodyPlant(config, builder)
        self.plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -robot.gravity_m_s2])
        self.chassis, self.wheels = self._add_bodies()
        self.plant.Finalize()
        self.simulator = Simulator(builder.Build())
        self.context = self.plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self._apply(0.0, 0.0)

    def _add_bodies(self) -> tuple[RigidBody, list[RigidBody]]:
        """Floor, chassis, wheels and their drives."""
        robot, plant = self._robot, self.plant
        friction = FRICTION_SHARE * robot.wheel_friction_coefficient
        # Drake combines the coefficients of a pair to 2 a b / (a + b): equal ones stay, and one of zero gives zero.
        rough, smooth = self._surface(friction), self._surface(0.0)
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "floor", rough)
        center = [robot.center_of_mass_right_m, robot.center_of_mass_forward_m, robot.center_of_mass_height_m]
        diametral = max(robot.wheel_diametral_inertia_kg_m2, LEAST_DIAMETRAL_SHARE * robot.wheel_spin_inertia_kg_m2)
        yaw = robot.chassis_yaw_inertia_kg_m2 - 2.0 * (diametral - robot.wheel_diametral_inertia_kg_m2)
        tilt = TILT_INERTIA_SHARE * yaw
        chassis = plant.AddRigidBody("chassis", spatial_inertia(robot.chassis_mass_kg, center, [tilt, tilt, yaw]))
        front_radius = FRONT_RADIUS_SHARE * robot.wheel_radius_m
        front = RigidTransform([robot.front_support_right_m, robot.axle_to_front_support_m, front_radius])
        plant.RegisterCollisionGeometry(chassis, front, Sphere(front_radius), "front", smooth)
        wheels = []
        inertia = spatial_inertia(
            robot.wheel_mass_kg, [0.0, 0.0, 0.0], [robot.wheel_spin_inertia_kg_m2, diametral, diametral]
        )
        for name, side in (("left", -1.0), ("right", 1.0)):
            wheel = plant.AddRigidBody(name, inertia)
            sphere = Sphere(robot.wheel_radius_m)
            plant.RegisterCollisionGeometry(wheel, RigidTransform(), sphere, f"{name} rim", rough)
            axle = RigidTransform([side * robot.track_width_m / 2.0, 0.0, robot.wheel_radius_m])
            # Rolling forward turns a wheel about the axis to the left.
            mount = plant.AddFrame(FixedOffsetFrame(f"{name} mount", chassis.body_frame(), axle))
            hinge = plant.AddJoint(RevoluteJoint(f"{name} hinge", mount, wheel.body_frame(), [-1.0, 0.0, 0.0]))
            plant.AddJointActuator(f"{name} drive", hinge)
            wheels.append(wheel)
        return chassis, wheels

    def _surface(self, friction: float) -> ProximityProperties:
        """A surface into which the robot sinks by `PENETRATION` where a contact carries its weight."""
        properties = ProximityProperties()
        # Two surfaces in series are half as stiff.
        stiffness = 2.0 * self._robot.weight / PENETRATION
        AddContactMaterial(
            dissipation=DISSIPATION,
            point_stiffness=stiffness,
            friction=CoulombFriction(friction, friction),
            properties=properties,
        )
        return properties

    def _apply(self, left: float, right: float) -> None:
        """Sets the torques, N m."""
        self.plant.get_actuation_input_port().FixValue(self.context, [left, right])

    def slip(self) -> float:
        """Largest speed of the wheels' contact points over the floor, m/s."""
        return max(self._contact_speed(wheel) for wheel in self.wheels)

    def _contact_speed(self, wheel: RigidBody) -> float:
        """Speed in the plane of the point of a wheel that is at the floor, m/s."""
        velocity = self.plant.EvalBodySpatialVelocityInWorld(self.context, wheel)
        height = self.plant.EvalBodyPoseInWorld(self.context, wheel).translation()[2]
        moved = velocity.translational() + np.cross(velocity.rotational(), [0.0, 0.0, -height])
        return math.hypot(moved[0], moved[1])

    def pose(self) -> tuple[np.ndarray, float]:
        """Chassis centre of mass in the plane (m) and heading (rad)."""
        transform = self.plant.EvalBodyPoseInWorld(self.context, self.chassis)
        center = transform.multiply([self._robot.center_of_mass_right_m, self._robot.center_of_mass_forward_m, 0.0])
        right = transform.rotation().matrix()[:, 0]
        return np.asarray(center)[:2], math.atan2(right[1], right[0])

    def run(self, schedule: dict[str, Any]) -> tuple[float, float]:
        """Settles and drives; the largest slip and when."""
        self.simulator.Initialize()
        self.simulator.AdvanceTo(SETTLING_TIME)
        interval, left, right = schedule["interval_s"], schedule["left_n_m"], schedule["right_n_m"]
        largest, when, applied = 0.0, 0.0, -1
        for step in range(round(interval * len(left) / TIME_STEP)):
            current = min(int((step + 0.5) * TIME_STEP / interval), len(left) - 1)
            if current != applied:
                self._apply(left[current], right[current])
                applied = current
            time = (step + 1) * TIME_STEP
            self.simulator.AdvanceTo(SETTLING_TIME + time)
            slip = self.slip()
            if slip > largest:
                largest, when = slip, time
        return largest, when


def spatial_inertia(mass: float, center: list[float], principal: list[float]) -> SpatialInertia:
    """Inertia of a body from its mass (kg), centre of mass (m) and principal inertias about that (kg m2)."""
    return SpatialInertia.MakeFromCentralInertia(mass, center, RotationalInertia(*principal))


COLUMNS = (
    f"{'robot':10} {'goal':40}{'t_f s':>8}{'status':>11}{'steps':>7}{'grip':>8}"
    f"{'slip m/s':>10}{'at s':>7}{'miss m':>9}{'miss rad':>10}"
)
LEGEND = (
    "grip: largest share that the plan uses on its replay, which is finer.\n"
    f"slip: largest of a wheel's contact point in Drake, passes up to {SLIP_TOLERANCE:g} m/s.\n"
    "miss: end of Drake's motion against the plan's, open loop."
)


def request_of_plan(name: str, goal: dict[str, Any], limits: dict[str, float]) -> dict[str, Any]:
    """The body of a solve request: slipdrive chooses the grid."""
    of_robot = read_suite("robots.json")[name]
    limits = limits | {"grip_utilization": GRIP_UTILIZATION}
    maneuver = of_robot.get("maneuver", {}) | {"goal": goal, "limits": limits}
    return {"robot": of_robot["robot"], "maneuver": maneuver, "solver": {"starts": 1, "time_limit_s": 60.0}}


def plan(slipdrive: Path, request: dict[str, Any]) -> dict[str, Any]:
    """The answer of slipdrive."""
    with tempfile.TemporaryDirectory() as directory:
        asked, answer = Path(directory) / "request.json", Path(directory) / "answer.json"
        asked.write_text(json.dumps(request))
        command = [str(slipdrive), "solve", str(asked), "--json", str(answer)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"slipdrive ended with {done.returncode}: {done.stderr.strip()}")
        return json.loads(answer.read_text())


def replay(request: dict[str, Any], answer: dict[str, Any], approximation: str) -> Replay:
    """Drives a plan in Drake."""
    robot = robot_from_wire(request["robot"])
    drake = DrakeRobot(robot, approximation)
    begin, begin_heading = drake.pose()
    slip, when = drake.run(answer["torque_schedule"])
    end, end_heading = drake.pose()
    moved, planned = end - begin, answer["end_state"]
    return Replay(
        slip,
        when,
        math.hypot(moved[0] - planned["x_m"], moved[1] - planned["y_m"]),
        abs(math.remainder(end_heading - begin_heading - planned["heading_rad"], math.tau)),
    )


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slipdrive", type=Path, required=True, help="the binary")
    parser.add_argument("plans", nargs="*", type=int, help="which of the plans, from 0; default: all")
    parser.add_argument("--approximation", choices=("lagged", "tamsi"), default="lagged", help="of Drake's contacts")
    return parser.parse_args()


def main() -> int:
    """Exit code 0, or 1 if some plan slips."""
    asked = arguments()
    # Drake warns that half spaces do not touch soft bodies.
    logging.getLogger("drake").setLevel(logging.ERROR)
    print(COLUMNS, flush=True)
    passed = True
    for name, goal, limits in [PLANS[index] for index in asked.plans] or PLANS:
        request = request_of_plan(name, goal, limits)
        answer = plan(asked.slipdrive, request)
        driven = replay(request, answer, asked.approximation)
        passed = passed and driven.slip_m_s <= SLIP_TOLERANCE
        used = {limit["limit"]: limit for limit in answer["report"]["limits"]}["maneuver.limits.grip_utilization"]
        replayed = used["value"] * (1.0 + used["replay_excess"]) if used["replay_excess"] is not None else math.nan
        where = ", ".join(f"{field} {value:.3g}" for field, value in goal.items())
        print(
            f"{name:10} {where:40}{answer['final_time_s']:8.4f}{answer['status']:>11}{answer['report']['steps']:7}"
            f"{replayed:8.4f}{driven.slip_m_s:10.1e}{driven.slip_time_s:7.3f}{driven.miss_m:9.1e}{driven.miss_rad:10.1e}",
            flush=True,
        )
    print(LEGEND)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
