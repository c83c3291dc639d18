"""What one step of a filter is given: a scan, and the motion that led to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from pfslam.errors import DataError
from pfslam.motion import Controls, controls, dead_reckoning
from pfslam.poses import Trajectory, between
from pfslam.recording import Recording
from pfslam.sensors import LidarModel, scan_points


@dataclass(frozen=True, eq=False)
class ScanEvent:
    """One used scan and the motion that led to it.

    ``points_b (M, 2)`` are the end points in the body frame (m), ``beams (M,)`` their beam numbers, ``sensor_b (2,)``
    the place of the LiDAR; ``motion (3,)`` is the odometry's pose of the robot seen from its pose at the event before,
    and ``controls`` are the samples in between as ``(v, omega, dt)``, each ``(n,)``.
    """

    t: float
    points_b: np.ndarray
    beams: np.ndarray
    sensor_b: np.ndarray
    motion: np.ndarray
    controls: tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class UsedScans:
    """The scans of a recording that a run uses, with the odometry and the controls between them.

    ``scans (K,)`` are the indices of the used scans and ``t (K,)`` their stamps (s); ``motion (K, 3)`` is the motion
    since the scan before, that of the first since ``begin`` (s). ``dropped`` says how many scans were left out, by
    reason.
    """

    recording: Recording
    odometry: Trajectory
    controls: Controls
    scans: np.ndarray
    t: np.ndarray
    begin: float
    motion: np.ndarray
    dropped: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, recording: Recording, every: int | None = None) -> UsedScans:
        """Choose every ``every``-th scan of a recording, or with None as many as the recording's own default.

        The run begins at the odometry's first stamp. Raises ``DataError`` if no scan is covered by the odometry.
        """
        inputs = controls(recording)
        odometry = dead_reckoning(recording, inputs)
        scans, t, dropped = covered_scans(recording, every or recording.default_every, odometry)
        poses = odometry.at(np.append(odometry.t[0], t))
        motion = between(poses[:-1], poses[1:])
        return cls(recording, odometry, inputs, scans, t, float(odometry.t[0]), motion, dropped)

    def __len__(self) -> int:
        return len(self.scans)

    def events(self) -> Iterator[ScanEvent]:
        """Yield the used scans in order, each with the motion since the one before."""
        ranges, lidar, previous = self.recording.scans().ranges, self.recording.robot.lidar, self.begin
        for i, t, motion in zip(self.scans, self.t, self.motion, strict=True):
            yield scan_event(t, ranges[i], lidar, motion, self.controls.during(previous, t))
            previous = t


def scan_event(t: float, ranges: np.ndarray, lidar: LidarModel, motion: np.ndarray, inputs) -> ScanEvent:
    """Make the event of a scan with ``ranges (B,)`` (m), stamped ``t`` (s), from the motion and controls before it."""
    ranges = np.asarray(ranges, dtype=float)  # a limit such as 5.6 m is another number in single precision
    beams, sensor_b = np.flatnonzero(lidar.valid(ranges)), np.array(lidar.position_b[:2])
    return ScanEvent(t, scan_points(ranges, lidar), beams, sensor_b, motion, inputs)


def covered_scans(
    recording: Recording, every: int, odometry: Trajectory
) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    """Find the scans a run can use: their indices ``(K,)``, their stamps ``(K,)`` (s), and how many were left out.

    Left out are scans outside the odometry's time. Raises ``DataError`` if none is inside.
    """
    stamps = recording.scans().t
    index = np.arange(0, len(stamps), every)
    covered = odometry.covers(stamps[index])
    if not covered.any():
        apart = max(stamps[0] - odometry.t[-1], odometry.t[0] - stamps[-1], 0.0)
        found = f"no scan within the odometry's time, {apart:.1f} s apart"
        raise DataError(recording.name, "lidar time_stamps", found, "streams that overlap, of one clock")
    outside = int(np.count_nonzero(~covered))
    dropped = {"scans outside the odometry's time": outside} if outside else {}
    return index[covered], stamps[index[covered]], dropped
