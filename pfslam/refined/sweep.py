"""The sweep of a scanner: its beams are measured one after the other, while the robot drives on."""

from __future__ import annotations

import numpy as np

from pfslam.poses import Trajectory, between
from pfslam.sensors import LidarModel


def motion_during(odometry: Trajectory, t: float, sweep: float) -> np.ndarray:
    """Return the odometry's motion ``(3,)`` over the ``sweep`` (s) of a scan with its middle beam at ``t``.

    A negative sweep gives the motion from the later beam back to the earlier.
    """
    ends = np.clip([t - 0.5 * sweep, t + 0.5 * sweep], *odometry.t[[0, -1]])
    return between(*odometry.at(ends))


def deskewed(points_b: np.ndarray, beams: np.ndarray, lidar: LidarModel, motion: np.ndarray) -> np.ndarray:
    """Deskew a scan: return its end points ``(M, 2)`` as if all beams had been measured at the stamp.

    A scanner's mirror turns while the robot does: each beam is measured from a pose of its own, and a turning robot
    smears its walls. ``motion (3,)`` is the odometry's from first beam to last; each beam takes its share of it.
    """
    share = beams / max(lidar.beams - 1, 1) - 0.5
    x, y = points_b.T
    c, s = np.cos(share * motion[2]), np.sin(share * motion[2])
    return np.column_stack([share * motion[0] + c * x - s * y, share * motion[1] + s * x + c * y])
