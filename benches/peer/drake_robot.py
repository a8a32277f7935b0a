"""Slipdrive's robot in Drake, a judge that shares nothing with slipdrive: rigid bodies in space, compliant contacts,
its own friction solver.

The robot is a free chassis with two hinged wheels, which touch the floor as spheres, and a frictionless ball in front.
Needs `pip install drake==1.51.1` beside `requirements.txt`.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import AddContactMaterial, HalfSpace, ProximityProperties, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, RigidBody, RotationalInertia, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from mechanics import Robot

# How deep a contact sinks in that carries the whole weight, m, and what dampens that, s/m: what is left of a wheel's
# radius decides how far it rolls.
PENETRATION = 1e-6
DISSIPATION = 50.0
# Radius of the front ball over the wheel radius.
FRONT_RADIUS_SHARE = 0.5
# Pitch and roll inertia of the chassis over its yaw inertia; the planar model has none.
TILT_INERTIA_SHARE = 0.7

# No rigid body spins with more than twice its diametral inertia, but a wheel with rotor and gear does: what its
# diametral inertia gets more here, the chassis gets less, and the robot as a whole turns as before.
LEAST_DIAMETRAL_SHARE = 0.51


@dataclass(frozen=True)
class Discretisation:
    """How Drake integrates: in steps of `time_step` (s), with a friction that reaches its full force at a slip of about
    `stiction_tolerance` (m/s), by one of Drake's contact approximations.
    """

    time_step: float
    stiction_tolerance: float = 1e-4
    approximation: str = "lagged"


class DrakeRobot:
    """One robot on Drake's floor. Body frame: x right, y forward, z up, origin on the floor under the axle midpoint."""

    def __init__(self, robot: Robot, discretisation: Discretisation) -> None:
        # Drake warns that half spaces do not touch soft bodies.
        logging.getLogger("drake").setLevel(logging.ERROR)
        self._robot = robot
        config = MultibodyPlantConfig(
            time_step=discretisation.time_step,
            contact_model="point",
            discrete_contact_approximation=discretisation.approximation,
            stiction_tolerance=discretisation.stiction_tolerance,
        )
        builder = DiagramBuilder()
        self.plant, _ = AddMultibodyPlant(config, builder)
        self.plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -robot.gravity_m_s2])
        self.chassis, self.wheels = self._add_bodies()
        self.plant.Finalize()
        self.simulator = Simulator(builder.Build())
        self.context = self.plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self.apply(0.0, 0.0)

    def _add_bodies(self) -> tuple[RigidBody, list[RigidBody]]:
        """Floor, chassis, wheels and their drives."""
        robot, plant = self._robot, self.plant
        # Drake combines the coefficients of a pair to 2 a b / (a + b): equal ones stay, and one of zero gives zero.
        rough, smooth = self._surface(robot.wheel_friction_coefficient), self._surface(0.0)
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

    def apply(self, left: float, right: float) -> None:
        """Sets the torques, N m."""
        self.plant.get_actuation_input_port().FixValue(self.context, [left, right])

    def place(self, heading: float) -> None:
        """Puts it on the floor over the origin, turned to `heading` (rad); before the simulator runs."""
        pose = RigidTransform(RollPitchYaw(0.0, 0.0, heading), np.zeros(3))
        self.plant.SetFreeBodyPose(self.context, self.chassis, pose)

    def hold(self) -> None:
        """Takes all speed away."""
        self.plant.SetVelocities(self.context, np.zeros(self.plant.num_velocities()))

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
        return self._pose_of([self._robot.center_of_mass_right_m, self._robot.center_of_mass_forward_m, 0.0])

    def axle_pose(self) -> tuple[np.ndarray, float]:
        """Axle midpoint in the plane (m) and heading (rad)."""
        return self._pose_of([0.0, 0.0, 0.0])

    def _pose_of(self, point: list[float]) -> tuple[np.ndarray, float]:
        """A point of the chassis in the plane (m) and the heading (rad)."""
        transform = self.plant.EvalBodyPoseInWorld(self.context, self.chassis)
        right = transform.rotation().matrix()[:, 0]
        return np.asarray(transform.multiply(point))[:2], math.atan2(right[1], right[0])


def spatial_inertia(mass: float, center: list[float], principal: list[float]) -> SpatialInertia:
    """Inertia of a body from its mass (kg), centre of mass (m) and principal inertias about that (kg m2)."""
    return SpatialInertia.MakeFromCentralInertia(mass, center, RotationalInertia(*principal))
