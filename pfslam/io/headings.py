"""Headings from a gyro where the odometry turns poorly: wheels that skid sideways turn less than they say."""

from __future__ import annotations

import numpy as np

from pfslam.evaluation.turns import compare_turns
from pfslam.poses import Trajectory, between, compose, wrap_angle
from pfslam.recording import Imu

POOR = 0.1
"""Share by which the odometry's turns over one second may differ from the gyro's, root mean square."""
LEAST_LIKENESS = 0.5
"""Correlation of the turns below which the gyro is not believed either: a flipped axis gives -1."""


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
