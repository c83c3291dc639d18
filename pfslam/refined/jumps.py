"""Jumps of an odometry: its node started again, or it had stood still and then caught up.

No robot moved as they say, so they are left out, and the odometry goes on from where it was. What way it had lost
before, scans may find.
"""

from __future__ import annotations

import numpy as np

from pfslam.poses import Trajectory, between, compose

JUMP_METRES, JUMP_SPEED = 0.3, 10.0
"""A step that is longer (m) and faster (m/s) than this is no motion of a robot indoors."""


def jumped(step: np.ndarray, dt) -> np.ndarray:
    """Which steps ``(..., 3)`` of an odometry, each over ``dt`` s, are jumps ``(...)``.

    Turns tell nothing: in logs whose stamps are not exact, robots turn by 30 degrees within a few milliseconds.
    """
    metres = np.hypot(step[..., 0], step[..., 1])
    return (metres > JUMP_METRES) & (metres > JUMP_SPEED * dt)


def jumps(odometry: Trajectory) -> np.ndarray:
    """Which steps ``(K - 1,)`` of an odometry are jumps."""
    return jumped(between(odometry.poses[:-1], odometry.poses[1:]), np.diff(odometry.t))


def left_out(odometry: Trajectory | None) -> dict[str, int]:
    """Count the jumps of an odometry, if there are any, as what a run has dropped."""
    count = 0 if odometry is None else int(jumps(odometry).sum())
    return {"jumps of the odometry": count} if count else {}


def steps(odometry: Trajectory) -> np.ndarray:
    """Return the motion ``(K - 1, 3)`` of an odometry from each of its poses to the next, none where it jumps."""
    return np.where(jumps(odometry)[:, None], 0.0, between(odometry.poses[:-1], odometry.poses[1:]))


def joined(odometry: Trajectory) -> Trajectory:
    """Return an odometry from the origin on that goes on from where it was after each jump."""
    poses = between(odometry.poses[0], odometry.poses)
    if jumps(odometry).any():
        step, poses = steps(odometry), np.zeros_like(poses)
        poses[1:, 2] = np.cumsum(step[:, 2])
        poses[1:, :2] = np.cumsum(compose(poses[:-1], step)[:, :2], axis=0)
    return Trajectory(odometry.t, poses)
