"""A recording as a filter sees it: an ordered stream of used scans, each with the motion that led to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from pfslam.config import SlamConfig
from pfslam.errors import DataError
from pfslam.motion import Controls, controls, dead_reckoning
from pfslam.poses import Trajectory, between, rotation_matrix
from pfslam.recording import Recording
from pfslam.refined.tilt import estimate_tilt
from pfslam.sensors import LidarModel, scan_points_3d


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


@dataclass(frozen=True, eq=False)
class Drive:
    """What a run takes from a recording, computed once: odometry, controls, tilt, and which scans are used.

    ``scans (K,)`` are the indices of the used scans and ``t (K,)`` their stamps (s); ``tilt (K, 2)`` is pitch and roll
    there (rad), zero where the floor is taken for flat; ``motion (K, 3)`` the motion since the scan before, that of the
    first since ``begin``. ``floor`` is the height (m) below which the end of a beam is taken for the floor, ``dropped``
    how many scans were left out, by reason.
    """

    recording: Recording
    odometry: Trajectory
    controls: Controls
    scans: np.ndarray
    t: np.ndarray
    begin: float
    tilt: np.ndarray
    motion: np.ndarray
    floor: float
    dropped: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, recording: Recording, config: SlamConfig) -> Drive:
        """Take from a recording what a run with this configuration uses; ``DataError`` if no scan is covered.

        The run begins at its first scan, or at the odometry's first stamp if the filter predicts before that scan.
        """
        inputs = controls(recording)
        odometry = dead_reckoning(recording, inputs)
        scans, dropped = _used_scans(recording, config, odometry)
        t = recording.scans().t[scans]
        begin = odometry.t[0] if config.predict_before_first_scan else t[0]
        poses = odometry.at(np.append(begin, t))
        motion, tilt = between(poses[:-1], poses[1:]), np.zeros((len(t), 2))
        if config.tilt is not None and (found := estimate_tilt(recording, config.tilt, inputs)) is not None:
            tilt = found.at(t)
        motion[:, :2] *= np.cos(tilt[:, :1])  # wheels measure along the slope, the map is seen from above
        floor = config.tilt.floor_clearance if config.tilt is not None else -np.inf
        return cls(recording, odometry, inputs, scans, t, begin, tilt, motion, floor, dropped)

    def __len__(self) -> int:
        return len(self.scans)

    def events(self) -> Iterator[ScanEvent]:
        """Yield the used scans in order, each with the motion since the one before."""
        scans, lidar, previous = self.recording.scans(), self.recording.robot.lidar, self.begin
        for i, t, tilt, motion in zip(self.scans, self.t, self.tilt, self.motion, strict=True):
            floor = self.floor if tilt.any() else -np.inf
            points, beams, sensor, struck = level_scan(scans.ranges[i], lidar, tilt, floor)
            if lidar.sweep:
                points = deskewed(points, beams, lidar, self.motion_during(t, lidar.sweep))
            v, omega, dt = self.controls.during(previous, t)
            yield ScanEvent(t, points, beams, sensor, struck, motion, (np.cos(tilt[0]) * v, omega, dt))
            previous = t

    def motion_during(self, t: float, sweep: float) -> np.ndarray:
        """Return the odometry's motion ``(3,)`` over the ``sweep`` (s) of a scan with its middle beam at ``t``.

        A negative sweep gives the motion from the later beam back to the earlier.
        """
        ends = np.clip([t - 0.5 * sweep, t + 0.5 * sweep], *self.odometry.t[[0, -1]])
        return between(*self.odometry.at(ends))


def _used_scans(
    recording: Recording, config: SlamConfig, odometry: Trajectory
) -> tuple[np.ndarray, dict[str, int]]:
    """Find the indices of the scans a run will use, and count those that the odometry does not cover."""
    stamps = recording.scans().t
    every = config.every if config.every is not None else recording.default_every
    index = np.arange(0, len(stamps), every)
    covered = odometry.covers(stamps[index])
    if not covered.any():
        raise DataError(
            recording.name, "lidar time_stamps", "no scan within the odometry's time", "streams that overlap"
        )
    outside = int(np.count_nonzero(~covered))
    return index[covered], {"scans outside the odometry's time": outside} if outside else {}


def level_scan(
    ranges: np.ndarray, lidar: LidarModel, tilt: np.ndarray | tuple[float, float], floor: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Turn one scan into the level body frame: end points ``(M, 2)``, beams ``(M,)``, LiDAR ``(2,)``, number left out.

    ``tilt (2,)`` is (pitch, roll) in radians. Beams that end lower than ``floor`` (m above the ground under the robot)
    are left out: they struck the floor, which is no wall.
    """
    points = scan_points_3d(ranges, lidar, *tilt)
    high = points[:, 2] >= floor
    sensor = rotation_matrix(roll=tilt[1], pitch=tilt[0]) @ lidar.position_b
    return (
        points[:, :2].compress(high, axis=0),
        np.flatnonzero(lidar.valid(ranges))[high],
        sensor[:2],
        int(np.count_nonzero(~high)),
    )


def deskewed(points_b: np.ndarray, beams: np.ndarray, lidar: LidarModel, motion: np.ndarray) -> np.ndarray:
    """Deskew a scan: return its end points ``(M, 2)`` as if all beams had been measured at the stamp.

    A scanner's mirror turns while the robot does: each beam is measured from a pose of its own, and a turning robot
    smears its walls. ``motion (3,)`` is the odometry's from first beam to last; each beam takes its share of it.
    """
    share = beams / max(lidar.beams - 1, 1) - 0.5
    x, y = points_b.T
    c, s = np.cos(share * motion[2]), np.sin(share * motion[2])
    return np.column_stack([share * motion[0] + c * x - s * y, share * motion[1] + s * x + c * y])
