"""The odometry of a robot's own node, which gets its samples one at a time."""

from __future__ import annotations

import numpy as np

from pfslam.errors import DataError
from pfslam.io.jumps import FASTEST, jumped, rejoined
from pfslam.motion import Controls
from pfslam.poses import Trajectory, between
from pfslam.refined.events import RefinedEvent, gone_on, levelled_event
from pfslam.sensors import RobotModel


class Odometer:
    """The odometry of a robot's own node: poses go in as they come, the event of a scan comes out.

    Poses come in the order of their stamps (s). The events are those of ``LevelledScans`` over the whole recording, to
    the last bit, where the floor is taken to be flat. The first begins at its own scan, or at the first sample with
    ``from_odometry``.

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
        """How many steps of the odometry were left out as jumps (see ``pfslam.io.jumps``)."""
        self._first: np.ndarray | None = None
        self._last: np.ndarray | None = None
        self._speed = FASTEST
        self._t: list[float] = []
        self._poses: list[np.ndarray] = []
        self._inputs: list[tuple[float, float]] = []  # speed and yaw rate up to each stamp but the first

    def add_pose(self, t: float, pose) -> None:
        """Add a pose ``(3,)`` (m, m, rad) of the robot's own odometry, in whatever frame that has."""
        pose = np.asarray(pose, dtype=float)
        if pose.shape != (3,) or not np.isfinite(pose).all() or not np.isfinite(t):
            raise DataError("Odometer", "sample", f"{pose} at {t} s", "finite numbers of shape (3,)")
        if self._t and t <= self._t[-1]:
            raise DataError("Odometer", "stamp", f"{t!r} after {self._t[-1]!r}", "increasing times")
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

    def reaches(self, t: float) -> bool:
        """Whether samples go on to the last beam of a scan stamped ``t`` (s), so that its time has come."""
        return len(self._t) > 1 and t + 0.5 * abs(self.robot.lidar.sweep) <= self._t[-1]

    def covers(self, t: float) -> bool:
        """Whether there are samples on both sides of a scan stamped ``t`` (s)."""
        return self.reaches(t) and self._t[0] <= t

    def event(self, t: float, ranges) -> RefinedEvent:
        """Return the event of a scan with ``ranges (B,)`` (m); ``DataError`` while the odometry does not reach it.

        Where the last beams come after the last sample, the robot is taken to go on as it did up to there; who can wait
        asks ``reaches``. Scans come in the order of their stamps.
        """
        lidar = self.robot.lidar
        if not self._t or not self._t[0] <= t <= self._t[-1]:
            found = f"[{self._t[0]:.6f}, {self._t[-1]:.6f}] s" if self._t else "no sample"
            raise DataError("Odometer.event", "odometry", found, f"samples on both sides of {t:.6f} s")
        if self.previous is not None and t <= self.previous:
            raise DataError("Odometer.event", "stamp", f"{t!r} after {self.previous!r}", "increasing times")
        inputs = Controls(np.array(self._t), *np.array(self._inputs).reshape(-1, 2).T)
        odometry = gone_on(Trajectory(inputs.t, np.array(self._poses)), inputs, 0.5 * abs(lidar.sweep))
        begin = (self._t[0] if self.from_odometry else t) if self.previous is None else self.previous
        motion = between(*odometry.at(np.array([begin, t])))
        made = levelled_event(t, ranges, lidar, motion, inputs.during(begin, t), odometry)
        self.previous = t
        self._forget(t - 0.5 * abs(lidar.sweep))
        return made

    def _forget(self, t: float) -> None:
        """Drop what no later scan can ask for: all but one sample before time ``t``."""
        old = max(int(np.searchsorted(self._t, t, side="right")) - 1, 0)
        del self._t[:old], self._poses[:old], self._inputs[:old]
