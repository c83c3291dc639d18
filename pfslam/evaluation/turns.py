"""Turns by odometry and by gyro, side by side: were they on the same drive?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.poses import Trajectory
from pfslam.recording import Imu

LONGEST = 1e7
"""Seconds of a drive; stamps that span more are those of a clock that was set."""
STOOD = 0.005
"""Metres or radians by which a robot that stands may seem to move in a second."""
LEAST_SECONDS = 3
"""So many seconds at rest, or of a drive, say something."""
LEAST_TURN = 1.0
"""A drive must turn by so much (rad) in all."""


@dataclass(frozen=True, eq=False)
class Turns:
    """Turns (rad) in each second of a drive, ``by_odometry (S,)`` and ``by_gyro (S,)``, whose bias is taken off.

    ``heading (K,)`` (rad) is the gyro's, at its own stamps; ``bias`` (rad/s) is what it showed in ``still`` seconds.
    """

    by_odometry: np.ndarray
    by_gyro: np.ndarray
    heading: np.ndarray
    bias: float
    still: int

    @property
    def enough(self) -> bool:
        """Tell whether the drive turned enough for a comparison."""
        return bool(np.abs(self.by_gyro).sum() >= LEAST_TURN)

    @property
    def factor(self) -> float:
        """The odometry's turns over the gyro's, by least squares."""
        return float(self.by_odometry @ self.by_gyro / max(self.by_gyro @ self.by_gyro, 1e-12))

    @property
    def likeness(self) -> float:
        """Correlation of the turns, from -1 to 1."""
        power = (self.by_odometry @ self.by_odometry) * (self.by_gyro @ self.by_gyro)
        return float(self.by_odometry @ self.by_gyro / max(np.sqrt(power), 1e-12))


def compare_turns(odometry: Trajectory, imu: Imu, yaw_axis: int = 2) -> Turns:
    """Compare the turns of an odometry with those of a gyro, about its ``yaw_axis``, while both last."""
    since, until = max(odometry.t[0], imu.t[0]), min(odometry.t[-1], imu.t[-1])
    edges = np.arange(since, until, 1.0) if LEAST_SECONDS - 1 < until - since < LONGEST else np.zeros(0)
    integral = np.concatenate([[0.0], np.cumsum(imu.angular_velocity[1:, yaw_axis] * np.diff(imu.t))])
    by_odometry = np.diff(np.interp(edges, odometry.t, np.unwrap(odometry.poses[:, 2])))
    by_gyro = np.diff(np.interp(edges, imu.t, integral))
    moved = np.hypot(*np.diff(odometry.at(edges)[:, :2], axis=0).T)
    rest = (moved < STOOD) & (np.abs(by_odometry) < STOOD)
    bias = float(by_gyro[rest].mean()) if rest.sum() >= LEAST_SECONDS else 0.0
    heading = integral - bias * (imu.t - imu.t[0])
    return Turns(by_odometry, by_gyro - bias, heading, bias, int(rest.sum()))
