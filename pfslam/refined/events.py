"""Scans made level: what the accurate filter is given where the body leans, beams sweep, and odometry jumps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from pfslam.events import ScanEvent, UsedScans, covered_scans
from pfslam.io.jumps import JUMPS, joined, left_out, steps
from pfslam.motion import Controls, controls, dead_reckoning, motion_model
from pfslam.poses import Trajectory, apply_transform, between, rotation_matrix, transform
from pfslam.recording import Recording
from pfslam.refined.tilt import estimate_tilt
from pfslam.sensors import FLOOR_CLEARANCE, LidarModel, beam_directions, scan_points

LEVEL = (0.0, 0.0)
"""Pitch and roll (rad) of a body that does not lean."""


@dataclass(frozen=True, eq=False)
class RefinedEvent(ScanEvent):
    """A scan in the level body frame; ``struck_floor`` beams were left out because they met the floor."""

    struck_floor: int = 0


@dataclass(frozen=True, eq=False)
class LevelledScans(UsedScans):
    """The scans of a recording that a run uses, made level.

    ``tilt (K, 2)`` is the pitch and roll at each scan (rad), zero where the floor is taken for flat.
    """

    tilt: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))

    @classmethod
    def of(
        cls, recording: Recording, every: int | None = None, tilt: bool = True, from_odometry: bool = False
    ) -> LevelledScans:
        """Choose every ``every``-th scan of a recording, or with None as many as the recording's own default.

        ``tilt`` says whether the body's lean is estimated. A run begins at its first scan, or ``from_odometry``'s first
        stamp. Jumps of the odometry are left out and counted. Raises ``DataError`` if no scan is covered by the
        odometry.
        """
        jumps = left_out(recording)
        odometry, inputs = odometry_and_controls(recording)
        scans, t, dropped = covered_scans(recording, every or recording.default_every, odometry)
        begin = float(odometry.t[0] if from_odometry else t[0])
        poses = odometry.at(np.append(begin, t))
        motion, lean = between(poses[:-1], poses[1:]), np.zeros((len(t), 2))
        if tilt and (found := estimate_tilt(recording, inputs)) is not None:
            lean = found.at(t)
        motion[:, :2] *= np.cos(lean[:, :1])  # wheels measure along the slope, the map is seen from above
        return cls(recording, odometry, inputs, scans, t, begin, motion, dropped | jumps, lean)

    def events(self) -> Iterator[RefinedEvent]:
        """Yield the used scans in order, each with the motion since the one before."""
        ranges, lidar, previous = self.recording.scans().ranges, self.recording.robot.lidar, self.begin
        odometry = gone_on(self.odometry, self.controls, 0.5 * abs(lidar.sweep))
        for i, t, tilt, motion in zip(self.scans, self.t, self.tilt, self.motion, strict=True):
            v, omega, dt = self.controls.during(previous, t)
            inputs = np.cos(tilt[0]) * v, omega, dt
            yield levelled_event(t, ranges[i], lidar, motion, inputs, odometry, tilt)
            previous = t


def odometry_and_controls(recording: Recording) -> tuple[Trajectory, Controls]:
    """Return the dead-reckoned path from (0, 0, 0) and the controls of a recording, jumps of its odometry left out."""
    logged = recording.odometry
    if logged is None or JUMPS in recording.dropped:  # they have been left out when it was loaded
        inputs = controls(recording)
        return dead_reckoning(recording, inputs), inputs
    step, dt = steps(logged), np.diff(logged.t)
    return joined(logged), Controls(logged.t, step[:, 0] / dt, step[:, 2] / dt)


def gone_on(odometry: Trajectory, inputs: Controls, seconds: float) -> Trajectory:
    """Return an odometry as if the robot went on for so many ``seconds`` as it did last, or stood if it never moved.

    The last beams of a scan with a sweep may come after the last sample.
    """
    if seconds == 0.0:
        return odometry
    v, omega = (inputs.v[-1], inputs.omega[-1]) if len(inputs.v) else (0.0, 0.0)
    last = motion_model(odometry.poses[-1], v, omega, seconds)
    return Trajectory(np.append(odometry.t, odometry.t[-1] + seconds), np.vstack([odometry.poses, last]))


def levelled_event(
    t: float,
    ranges: np.ndarray,
    lidar: LidarModel,
    motion: np.ndarray,
    inputs: tuple[np.ndarray, np.ndarray, np.ndarray],
    odometry: Trajectory,
    tilt: np.ndarray | tuple[float, float] = LEVEL,
) -> RefinedEvent:
    """Make the event of a scan with ``ranges (B,)`` (m), stamped ``t`` (s).

    ``motion`` and the controls ``inputs`` are seen from above, ``tilt`` is (pitch, roll) in rad; ``odometry`` tells how
    the robot moved while the beams of a scan were measured one after the other.
    """
    points, beams, sensor, struck = level_scan(ranges, lidar, tilt, FLOOR_CLEARANCE)
    if lidar.sweep:
        points = deskewed(points, beams, lidar, motion_during(odometry, t, lidar.sweep))
    return RefinedEvent(t, points, beams, sensor, motion, inputs, struck)


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


def level_scan(
    ranges: np.ndarray, lidar: LidarModel, tilt: np.ndarray | tuple[float, float], floor: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Turn one scan into the level body frame: end points ``(M, 2)``, beams ``(M,)``, LiDAR ``(2,)``, number left out.

    ``tilt (2,)`` is (pitch, roll) in radians. Beams that end lower than ``floor`` (m above the ground under the robot)
    are left out: they struck the floor, which is no wall. A body that does not lean sees no floor (Eq. 7).
    """
    ranges = np.asarray(ranges, dtype=float)  # a limit such as 5.6 m is another number in single precision
    beams = np.flatnonzero(lidar.valid(ranges))
    if not np.any(tilt):
        return scan_points(ranges, lidar), beams, np.array(lidar.position_b[:2]), 0
    points = tilted_points(ranges, lidar, *tilt)
    high = points[:, 2] >= floor
    sensor = rotation_matrix(roll=tilt[1], pitch=tilt[0]) @ lidar.position_b
    return points[:, :2].compress(high, axis=0), beams[high], sensor[:2], int(np.count_nonzero(~high))


def tilted_points(ranges: np.ndarray, lidar: LidarModel, pitch: float, roll: float) -> np.ndarray:
    """End points ``(M, 3)`` (m) of the valid beams of a leaning body, in its level frame; ``pitch``, ``roll`` in rad.

    The level frame has the body's heading and origin; z is the height above the ground under the wheels.
    """
    points_b = np.tile(lidar.position_b, (len(valid := np.flatnonzero(lidar.valid(ranges))), 1))
    points_b[:, :2] += ranges[valid][:, None] * beam_directions(lidar).take(valid, axis=0)
    return apply_transform(transform(rotation_matrix(roll, pitch)), points_b)
