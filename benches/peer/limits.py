"""What a request limits on the way: as bounds of the unknowns and as rows of every step (`docs/limits.md`)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

# A contact must carry at most this share of what it carries at rest.
STATIC_SHARE = 0.5


@dataclass(frozen=True)
class Limits:
    """Limits of one maneuver by their names in the request, SI units; None is no limit.

    `grip_utilization` is 1 where only slip is forbidden. `point`: where speed and acceleration are judged, from the
    chassis centre of mass in the body frame (right, forward), m.
    """

    normal_load_share: float = 0.01
    grip_utilization: float | None = None
    wheel_rate_rad_s: float | None = None
    speed_m_s: float | None = None
    yaw_rate_rad_s: float | None = None
    acceleration_m_s2: float | None = None
    yaw_acceleration_rad_s2: float | None = None
    point: tuple[float, float] = (0.0, 0.0)

    def least_load(self, static_load: np.ndarray) -> np.ndarray:
        """Least normal forces (left, right, front) in the unit of those at rest, whose sum is the weight."""
        share = self.normal_load_share * float(np.sum(static_load))
        return np.clip(share, 0.0, STATIC_SHARE * static_load)

    def rows(self, before: ca.SX, end: ca.SX, dt: ca.SX) -> list[ca.SX]:
        """Rows of a step, each at most zero: body velocities (5) in the frame of the step at its begin and end."""
        change = end - before
        rows = []
        if self.speed_m_s is not None:
            rows.append(ca.sumsqr(self._at_point(end)) / self.speed_m_s**2 - 1.0)
        if self.acceleration_m_s2 is not None:
            rows.append(ca.sumsqr(self._at_point(change) / dt) / self.acceleration_m_s2**2 - 1.0)
        if self.yaw_acceleration_rad_s2 is not None:
            share = change[2] / dt / self.yaw_acceleration_rad_s2
            rows += [share - 1.0, -share - 1.0]
        return rows

    def _at_point(self, velocity: ca.SX) -> ca.SX:
        """Velocity of the point, 2, m/s."""
        right, forward = self.point
        return ca.vertcat(velocity[0] - forward * velocity[2], velocity[1] + right * velocity[2])


@dataclass(frozen=True)
class Motor:
    """The line from the stall torque at rest to the free speed, both at the wheel."""

    stall_torque: float
    free_speed: float

    def rows(self, torque: ca.SX, rates: list[ca.SX]) -> list[ca.SX]:
        """Rows of a step, each at most zero, for the torques (2, N m) and the wheel rates (2, rad/s) at its nodes.

        `M <= stall (1 - omega / free)` and the same backwards. Beyond the free speed slipdrive's limit is zero torque
        where these rows ask for braking, so they allow no more.
        """
        share = torque / self.stall_torque
        return [sign * (share + rate / self.free_speed) - 1.0 for rate in rates for sign in (1.0, -1.0)]
