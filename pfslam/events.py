"""The ordered stream of what happened: one event per used scan, with the motion that led to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pfslam.config import SlamConfig
from pfslam.errors import DataError
from pfslam.motion import controls, dead_reckoning
from pfslam.poses import between, rotation_matrix
from pfslam.recording import Recording
from pfslam.sensors import LidarModel, scan_points_3d
from pfslam.tilt import Tilt, estimate_tilt


@dataclass(frozen=True, eq=False)
class ScanEvent:
    """One used scan and the motion that led to it.

    ``points_b (M, 2)`` end points in the level body frame (m), ``beams (M,)`` their beam numbers,
    ``sensor_b (2,)`` the LiDAR, ``struck_floor`` how many beams were left out because they met the floor;
    ``motion (3,)`` the odometry's pose of the robot seen from its pose at the event before; ``controls`` the
    samples in between as ``(v, omega, dt)``, each ``(n,)``.
    """

    t: float
    points_b: np.ndarray
    beams: np.ndarray
    sensor_b: np.ndarray
    struck_floor: int
    motion: np.ndarray
    controls: tuple[np.ndarray, np.ndarray, np.ndarray]


def used_scans(recording: Recording, config: SlamConfig) -> tuple[np.ndarray, dict[str, int]]:
    """Indices of the scans a run will use, and how many were left out because odometry does not cover them."""
    scans, odometry = recording.scans(), dead_reckoning(recording)
    every = config.every if config.every is not None else recording.default_every
    index = np.arange(0, len(scans.t), every)
    covered = odometry.covers(scans.t[index])
    if not covered.any():
        raise DataError(
            recording.name, "lidar time_stamps", "no scan within the odometry's time", "streams that overlap"
        )
    outside = int(np.count_nonzero(~covered))
    return index[covered], {"scans outside the odometry's time": outside} if outside else {}


def scan_events(recording: Recording, config: SlamConfig) -> tuple[Iterator[ScanEvent], dict[str, int]]:
    """The used scans in order, each with the motion since the one before, and what was dropped."""
    index, dropped = used_scans(recording, config)
    tilt = estimate_tilt(recording, config.tilt) if config.tilt is not None else None
    clearance = config.tilt.floor_clearance if config.tilt is not None else -np.inf
    return _events(recording, index, tilt, clearance), dropped


def scan_motions(recording: Recording, config: SlamConfig) -> np.ndarray:
    """The ``motion (K, 3)`` of every event of a run, all at once and without looking at the scans."""
    odometry, t = dead_reckoning(recording), recording.scans().t[used_scans(recording, config)[0]]
    poses = np.vstack([odometry.poses[:1], odometry.at(t)])
    motion = between(poses[:-1], poses[1:])
    tilt = estimate_tilt(recording, config.tilt) if config.tilt is not None else None
    if tilt is not None:
        motion[:, :2] *= np.cos(np.interp(t, tilt.t, tilt.pitch))[:, None]
    return motion


def _events(
    recording: Recording, index: np.ndarray, tilt: Tilt | None, clearance: float
) -> Iterator[ScanEvent]:
    odometry, inputs, scans = dead_reckoning(recording), controls(recording), recording.scans()
    previous_t, previous, lidar = odometry.t[0], odometry.poses[0], recording.robot.lidar
    for i in index:
        t, pose = scans.t[i], odometry.at(scans.t[i])
        motion = between(previous, pose)
        lean = tilt.at(t) if tilt is not None else (0.0, 0.0)
        level = np.cos(lean[0])  # wheels measure along the slope, the map is seen from above
        floor = clearance if any(lean) else -np.inf
        v, omega, dt = inputs.during(previous_t, t)
        points, beams, sensor, struck = level_scan(scans.ranges[i], lidar, lean, floor)
        if lidar.sweep > 0.0:
            ends = np.clip([t - 0.5 * lidar.sweep, t + 0.5 * lidar.sweep], *odometry.t[[0, -1]])
            points = unswept(points, beams, lidar, between(*odometry.at(ends)))
        yield ScanEvent(
            t, points, beams, sensor, struck, motion * [level, level, 1.0], (level * v, omega, dt)
        )
        previous_t, previous = t, pose


def level_scan(
    ranges: np.ndarray, lidar: LidarModel, lean: tuple[float, float], floor: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """One scan in the level body frame: end points ``(M, 2)``, beams ``(M,)``, LiDAR ``(2,)``, number left out.

    ``lean`` is (pitch, roll) in radians. Beams that end lower than ``floor`` (m above the ground under the robot) are
    left out: they struck the floor, which is no wall.
    """
    points = scan_points_3d(ranges, lidar, *lean)
    high = points[:, 2] >= floor
    sensor = rotation_matrix(roll=lean[1], pitch=lean[0]) @ lidar.position_b
    return (
        points[high, :2],
        np.flatnonzero(lidar.valid(ranges))[high],
        sensor[:2],
        int(np.count_nonzero(~high)),
    )


def unswept(points_b: np.ndarray, beams: np.ndarray, lidar: LidarModel, motion: np.ndarray) -> np.ndarray:
    """End points ``(M, 2)`` as if all beams had been measured at the stamp.

    A scanner's mirror turns while the robot does: each beam is measured from a pose of its own, and a turning robot
    smears its walls. ``motion (3,)`` is the odometry's from first beam to last; each beam takes its share of it.
    """
    share = beams / max(lidar.beams - 1, 1) - 0.5
    x, y = points_b.T
    c, s = np.cos(share * motion[2]), np.sin(share * motion[2])
    return np.column_stack([share * motion[0] + c * x - s * y, share * motion[1] + s * x + c * y])
