"""What one step of a filter is given: a scan, and the motion that led to it.

``Drive`` makes the events of a whole recording; ``Odometer`` makes them one at a time, as a robot delivers its samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from pfslam.errors import DataError
from pfslam.motion import Controls, controls, dead_reckoning, motion_model
from pfslam.poses import Trajectory, between, rotation_matrix
from pfslam.recording import Recording
from pfslam.refined.jumps import FASTEST, jumped, left_out, rejoined
from pfslam.refined.sweep import deskewed, motion_during
from pfslam.refined.tilt import FLOOR_CLEARANCE, estimate_tilt
from pfslam.sensors import LidarModel, RobotModel, scan_points, scan_points_3d

LEVEL = (0.0, 0.0)
"""Pitch and roll (rad) of a body that does not lean."""


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

    @classmethod
    def of(
        cls,
        t: float,
        ranges: np.ndarray,
        lidar: LidarModel,
        motion: np.ndarray,
        inputs: tuple[np.ndarray, np.ndarray, np.ndarray],
        odometry: Trajectory,
        tilt: np.ndarray | tuple[float, float] = LEVEL,
    ) -> ScanEvent:
        """Make the event of a scan with ``ranges (B,)`` (m), stamped ``t`` (s).

        ``motion`` and the controls ``inputs`` are seen from above, ``tilt`` is (pitch, roll) in rad; ``odometry`` tells
        how the robot moved while the beams of a scan were measured one after the other.
        """
        points, beams, sensor, struck = level_scan(ranges, lidar, tilt, FLOOR_CLEARANCE)
        if lidar.sweep:
            points = deskewed(points, beams, lidar, motion_during(odometry, t, lidar.sweep))
        return cls(t, points, beams, sensor, struck, motion, inputs)


@dataclass(frozen=True, eq=False)
class Drive:
    """What a run takes from a recording, computed once: odometry, controls, tilt, and which scans are used.

    ``scans (K,)`` are the indices of the used scans and ``t (K,)`` their stamps (s); ``tilt (K, 2)`` is pitch and roll
    there (rad), zero where the floor is taken for flat; ``motion (K, 3)`` the motion since the scan before, that of the
    first since ``begin``. ``dropped`` says how many scans were left out, by reason.
    """

    recording: Recording
    odometry: Trajectory
    controls: Controls
    scans: np.ndarray
    t: np.ndarray
    begin: float
    tilt: np.ndarray
    motion: np.ndarray
    dropped: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(
        cls, recording: Recording, every: int | None = None, tilt: bool = True, from_odometry: bool = False
    ) -> Drive:
        """Take from a recording what a run uses; ``DataError`` if no scan is covered by the odometry.

        Every ``every``-th scan is used, None for the recording's own default. ``tilt`` says whether the body's lean is
        estimated. A run begins at its first scan, or ``from_odometry``'s first stamp.
        """
        inputs = controls(recording)
        odometry = dead_reckoning(recording, inputs)
        scans, dropped = _used_scans(recording, every or recording.default_every, odometry)
        dropped |= left_out(recording.odometry)
        t = recording.scans().t[scans]
        begin = odometry.t[0] if from_odometry else t[0]
        poses = odometry.at(np.append(begin, t))
        motion, lean = between(poses[:-1], poses[1:]), np.zeros((len(t), 2))
        if tilt and (found := estimate_tilt(recording, inputs)) is not None:
            lean = found.at(t)
        motion[:, :2] *= np.cos(lean[:, :1])  # wheels measure along the slope, the map is seen from above
        return cls(recording, odometry, inputs, scans, t, begin, lean, motion, dropped)

    def __len__(self) -> int:
        return len(self.scans)

    def events(self) -> Iterator[ScanEvent]:
        """Yield the used scans in order, each with the motion since the one before."""
        scans, lidar, previous = self.recording.scans(), self.recording.robot.lidar, self.begin
        for i, t, tilt, motion in zip(self.scans, self.t, self.tilt, self.motion, strict=True):
            v, omega, dt = self.controls.during(previous, t)
            inputs = np.cos(tilt[0]) * v, omega, dt
            yield ScanEvent.of(t, scans.ranges[i], lidar, motion, inputs, self.odometry, tilt)
            previous = t


class Odometer:
    """Dead reckoning for a robot's own node: samples go in as they come, the event of a scan comes out.

    Either wheel counts and yaw rates, or the poses of an odometry, each in the order of its stamps (s). The events are
    those of a ``Drive`` over the whole recording, to the last bit, but for the lean of the body, which the node may
    know and hands over. The first begins at its own scan, or at the first sample with ``from_odometry``.

    >>> odometer = Odometer(RobotModel())
    >>> odometer.add_pose(10.0, [0.0, 0.0, 0.0])
    >>> odometer.add_pose(10.2, [0.1, 0.0, 0.0])
    >>> event = odometer.event(10.1, np.full(1081, 2.0))
    >>> len(event.points_b), odometer.event(10.2, np.full(1081, 2.0)).motion.round(2).tolist()
    (1081, [0.05, 0.0, 0.0])
    """

    def __init__(self, robot: RobotModel, from_odometry: bool = False):
        self.robot, self.from_odometry = robot, from_odometry
        self.previous: float | None = None
        """Stamp of the last event."""
        self.jumps = 0
        """How many steps of the odometry were left out as jumps (see ``pfslam.refined.jumps``)."""
        self._first: np.ndarray | None = None
        self._last: np.ndarray | None = None
        self._speed = FASTEST
        self._wheels: list[tuple[float, float]] = []  # stamp, distance since the first reading
        self._waiting: list[tuple[float, float]] = []  # yaw rates whose stamps the wheels have not passed yet
        self._travelled = self._start = self._distance = 0.0
        self._t: list[float] = []
        self._poses: list[np.ndarray] = []
        self._inputs: list[tuple[float, float]] = []  # speed and yaw rate up to each stamp but the first

    def copy(self) -> Odometer:
        """Return an odometer that has taken the same samples and goes on by itself."""
        other = Odometer(self.robot)
        kept = {
            name: value.copy() if isinstance(value, list) else value for name, value in vars(self).items()
        }
        vars(other).update(kept)
        return other

    def add_pose(self, t: float, pose) -> None:
        """Add a pose ``(3,)`` (m, m, rad) of the robot's own odometry, in whatever frame that has."""
        pose = np.asarray(pose, dtype=float)
        self._check(t, pose, (3,), self._t)
        if self._last is None or self._first is None:
            self._first = pose
        else:
            step, dt = between(self._last, pose), t - self._t[-1]
            jump, self._speed = jumped(float(np.hypot(step[0], step[1])), dt, self._speed)
            if jump:
                step, self._first = np.zeros(3), rejoined(pose, self._poses[-1])
                self.jumps += 1
            self._inputs.append((step[0] / dt, step[2] / dt))
        self._last = pose
        self._t.append(t)
        self._poses.append(between(self._first, pose))

    def add_counts(self, t: float, counts) -> None:
        """Add a reading ``(4,)`` of the encoders: the counts of each wheel since the reading before."""
        counts = np.asarray(counts, dtype=float)
        self._check(t, counts, (4,), [stamp for stamp, _ in self._wheels[-1:]])
        distance = counts.mean() * self.robot.encoders.metres_per_count
        self._start = self._start if self._wheels else distance
        self._travelled += distance
        self._wheels.append((t, self._travelled - self._start))
        while self._waiting and self._waiting[0][0] <= t:
            self._turn(*self._waiting.pop(0))

    def add_rate(self, t: float, yaw_rate: float) -> None:
        """Add a yaw rate (rad/s) of the gyro, positive to the left; it stands for the time that ends at its stamp."""
        self._check(t, np.asarray(yaw_rate), (), [stamp for stamp, _ in self._waiting[-1:]] or self._t)
        if self._wheels and t <= self._wheels[-1][0]:
            self._turn(t, yaw_rate)
        else:
            self._waiting.append((t, yaw_rate))

    def reaches(self, t: float) -> bool:
        """Whether samples go on to the last beam of a scan stamped ``t`` (s), so that its time has come."""
        return len(self._t) > 1 and t + 0.5 * abs(self.robot.lidar.sweep) <= self._t[-1]

    def covers(self, t: float) -> bool:
        """Whether there are samples on both sides of a scan stamped ``t`` (s)."""
        return self.reaches(t) and self._t[0] <= t

    def event(self, t: float, ranges, tilt: tuple[float, float] = LEVEL) -> ScanEvent:
        """Return the event of a scan with ``ranges (B,)`` (m); ``DataError`` while the odometry does not reach it.

        ``tilt`` is the (pitch, roll) of the body in rad. Where the last beams come after the last sample, the robot is
        taken to go on as it did up to there; who can wait asks ``reaches``. Scans come in the order of their stamps.
        """
        lidar = self.robot.lidar
        if not self._t or not self._t[0] <= t <= self._t[-1]:
            found = f"[{self._t[0]:.6f}, {self._t[-1]:.6f}] s" if self._t else "no sample"
            raise DataError("Odometer.event", "odometry", found, f"samples on both sides of {t:.6f} s")
        if self.previous is not None and t <= self.previous:
            raise DataError("Odometer.event", "stamp", f"{t!r} after {self.previous!r}", "increasing times")
        ahead, inputs = 0.5 * abs(lidar.sweep) or 1.0, np.array(self._inputs).reshape(-1, 2)
        v, omega = inputs[-1] if len(inputs) else (0.0, 0.0)
        beyond = motion_model(self._poses[-1], v, omega, ahead)
        knots = np.append(self._t, self._t[-1] + ahead)
        odometry = Trajectory(knots, np.array([*self._poses, beyond]))
        begin = (self._t[0] if self.from_odometry else t) if self.previous is None else self.previous
        motion = between(*odometry.at(np.array([begin, t])))
        motion[:2] *= np.cos(tilt[0])
        v, omega, dt = Controls(knots[:-1], *inputs.T).during(begin, t)
        made = ScanEvent.of(
            t, np.asarray(ranges), lidar, motion, (np.cos(tilt[0]) * v, omega, dt), odometry, tilt
        )
        self.previous = t
        self._forget(t - 0.5 * abs(lidar.sweep))
        return made

    def _turn(self, t: float, yaw_rate: float) -> None:
        """Move to the stamp of a yaw rate that the wheels have passed."""
        if t < self._wheels[0][0]:
            return  # the wheels were not heard of yet
        distance = float(np.interp(t, *np.array(self._wheels).T))
        if not self._t:
            self._poses.append(np.zeros(3))
        else:
            dt, before = t - self._t[-1], self._poses[-1]
            speed = (distance - self._distance) / dt
            step = motion_model(np.array([0.0, 0.0, before[2]]), speed, yaw_rate, dt)
            self._poses.append(before + [step[0], step[1], yaw_rate * dt])
            self._inputs.append((speed, yaw_rate))
        self._t.append(t)
        self._distance = distance

    def _check(self, t: float, value: np.ndarray, shape: tuple, before: list[float]) -> None:
        if value.shape != shape or not np.isfinite(value).all() or not np.isfinite(t):
            raise DataError("Odometer", "sample", f"{value} at {t} s", f"finite numbers of shape {shape}")
        if before and t <= before[-1]:
            raise DataError("Odometer", "stamp", f"{t!r} after {before[-1]!r}", "increasing times")

    def _forget(self, t: float) -> None:
        """Drop what no later scan can ask for: all but one sample before time ``t``."""
        old = max(int(np.searchsorted(self._t, t, side="right")) - 1, 0)
        del self._t[:old], self._poses[:old], self._inputs[:old]
        while len(self._wheels) > 2 and self._wheels[1][0] <= self._t[-1]:
            self._wheels.pop(0)


def _used_scans(recording: Recording, every: int, odometry: Trajectory) -> tuple[np.ndarray, dict[str, int]]:
    """Find the indices of the scans a run will use, and count those that the odometry does not cover."""
    stamps = recording.scans().t
    index = np.arange(0, len(stamps), every)
    covered = odometry.covers(stamps[index])
    if not covered.any():
        apart = max(stamps[0] - odometry.t[-1], odometry.t[0] - stamps[-1], 0.0)
        found = f"no scan within the odometry's time, {apart:.1f} s apart"
        raise DataError(recording.name, "lidar time_stamps", found, "streams that overlap, of one clock")
    outside = int(np.count_nonzero(~covered))
    return index[covered], {"scans outside the odometry's time": outside} if outside else {}


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
    points = scan_points_3d(ranges, lidar, *tilt)
    high = points[:, 2] >= floor
    sensor = rotation_matrix(roll=tilt[1], pitch=tilt[0]) @ lidar.position_b
    return points[:, :2].compress(high, axis=0), beams[high], sensor[:2], int(np.count_nonzero(~high))
