"""Turns by odometry and by gyro, side by side, and headings from the gyro where the odometry turns poorly.

Wheels that skid sideways turn the robot less than they say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.poses import Trajectory, between, compose, wrap_angle
from pfslam.recording import Imu
from pfslam.sensors import ImuModel

LONGEST = 1e7
"""Seconds of a drive; stamps that span more are those of a clock that was set."""
STOOD = 0.005
"""Metres or radians by which a robot that stands may seem to move in a second."""
LEAST_SECONDS = 3
"""Seconds at rest, or of a drive, that say something."""
LEAST_TURN = 1.0
"""Turns (rad) of a whole drive, below which there is nothing to compare."""
POOR = 0.1
"""Share by which the odometry's turns over one second may differ from the gyro's, root mean square."""
LEAST_LIKENESS = 0.5
"""Correlation of the turns below which the gyro is not believed either: a flipped axis gives -1."""


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
        """Whether the drive turned enough for a comparison."""
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


def compare_turns(odometry: Trajectory, imu: Imu, model: ImuModel | None = None) -> Turns:
    """Compare the turns of an odometry with those of a gyro, whose columns are x, y, z without a model."""
    since, until = max(odometry.t[0], imu.t[0]), min(odometry.t[-1], imu.t[-1])
    edges = np.arange(since, until, 1.0) if LEAST_SECONDS - 1 < until - since < LONGEST else np.zeros(0)
    rates = (model or ImuModel()).in_body(imu.angular_velocity)[:, 2]
    integral = np.concatenate([[0.0], np.cumsum(rates[1:] * np.diff(imu.t))])
    by_odometry = np.diff(np.interp(edges, odometry.t, np.unwrap(odometry.poses[:, 2])))
    by_gyro = np.diff(np.interp(edges, imu.t, integral))
    moved = np.hypot(*np.diff(odometry.at(edges)[:, :2], axis=0).T)
    rest = (moved < STOOD) & (np.abs(by_odometry) < STOOD)
    bias = float(by_gyro[rest].mean()) if rest.sum() >= LEAST_SECONDS else 0.0
    heading = integral - bias * (imu.t - imu.t[0])
    return Turns(by_odometry, by_gyro - bias, heading, bias, int(rest.sum()))


def with_better_headings(odometry: Trajectory, imu: Imu | None) -> tuple[Trajectory, list[str]]:
    """Take the headings from the gyro, and the distances from the odometry, where the odometry turns poorly.

    Returns the odometry, and notes of what was found. Without an IMU, or with too little to tell, it is left alone.

    The rule: the turns of both over one second at a time are compared. The odometry is poor if they differ by more than
    a tenth of the gyro's, root mean square. The gyro is believed if both are alike at all: a correlation over one half.
    """
    if imu is None or not (turns := compare_turns(odometry, imu)).enough:
        return odometry, []
    by_wheels, by_gyro = turns.by_odometry, turns.by_gyro
    differ = float(np.sqrt(((by_wheels - by_gyro) ** 2).sum() / (by_gyro**2).sum()))
    if differ <= POOR:
        return odometry, []
    words = f"the turns of odometry and gyro differ by {100 * differ:.0f} %"
    if turns.likeness < LEAST_LIKENESS:
        unlike = f"{words} and are not alike (correlation {turns.likeness:+.2f}): the gyro is not used"
        return odometry, [unlike]
    steps = between(odometry.poses[:-1], odometry.poses[1:])
    inside = (odometry.t[:-1] >= imu.t[0]) & (odometry.t[1:] <= imu.t[-1])
    turned = np.diff(np.interp(odometry.t, imu.t, turns.heading))
    better = _chained(odometry, steps, np.where(inside, turned, steps[:, 2]))
    return better, [f"{words}: headings are taken from the gyro, distances from the odometry"]


def _chained(odometry: Trajectory, steps: np.ndarray, turns: np.ndarray) -> Trajectory:
    """Put the steps ``(K, 3)`` of an odometry together again, with other turns ``(K,)`` in rad."""
    # A step's chord points half a turn away from the heading at its start.
    half = np.column_stack([np.zeros((len(turns), 2)), 0.5 * wrap_angle(turns - steps[:, 2])])
    headings = odometry.poses[0, 2] + np.concatenate([[0.0], np.cumsum(turns)])
    start = np.column_stack([np.zeros((len(turns), 2)), headings[:-1]])
    ways = compose(compose(start, half), np.column_stack([steps[:, :2], turns]))[:, :2]
    xy = odometry.poses[0, :2] + np.concatenate([np.zeros((1, 2)), np.cumsum(ways, axis=0)])
    return Trajectory(odometry.t, np.column_stack([xy, headings]))
