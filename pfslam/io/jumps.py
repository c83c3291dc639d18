"""Jumps of an odometry: its node started again, or it had stood still and then caught up.

No robot moved as they say, so they are left out, and the odometry goes on from where it was. What way it had lost
before, scans may find.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from pfslam.poses import Trajectory, between, compose, invert
from pfslam.recording import Recording
from pfslam.sensors import STANDARD_GRAVITY

JUMP_METRES = 0.3
"""A step may be so much longer (m) than the robot can have come: stamps come late, and scans take back as much."""
JUMPS = "jumps of the odometry"
"""What they are called among that which was left out."""
FASTEST = 10.0
"""No robot indoors is faster (m/s). Nothing else is known of it at the first step."""


def jumped(metres: float, dt: float, speed: float) -> tuple[bool, float]:
    """Tell whether a step of an odometry over ``dt`` s is a jump, and how fast (m/s) the robot may be after it.

    ``speed`` is what the step before gave, ``FASTEST`` at the first. A robot comes as far as this speed and an
    acceleration of 1 g allow, because wheels hold by friction; so the rate of the samples does not matter. Turns tell
    nothing: in logs whose stamps are not exact, robots turn by 30 degrees within a few milliseconds.
    """
    farthest = JUMP_METRES + speed * dt + 0.5 * STANDARD_GRAVITY * dt * dt
    return metres > farthest, min(metres / dt, speed + STANDARD_GRAVITY * dt, FASTEST)


def jumps(odometry: Trajectory) -> np.ndarray:
    """Which steps ``(K - 1,)`` of an odometry are jumps."""
    step, speed = between(odometry.poses[:-1], odometry.poses[1:]), FASTEST
    found = np.zeros(len(step), dtype=bool)
    for k, way in enumerate(
        zip(np.hypot(*step[:, :2].T).tolist(), np.diff(odometry.t).tolist(), strict=True)
    ):
        found[k], speed = jumped(*way, speed)
    return found


def left_out(recording: Recording) -> dict[str, int]:
    """Count the jumps of a recording's odometry, if there are any, as what is dropped.

    None where they have been left out already: the step that was left out is zero, and a robot that is fast again at
    the next would seem to jump.
    """
    if recording.odometry is None or JUMPS in recording.dropped:
        return {}
    count = int(jumps(recording.odometry).sum())
    return {JUMPS: count} if count else {}


def without_jumps(recording: Recording) -> Recording:
    """Return a recording whose odometry goes on from where it was after each jump; they are counted in ``dropped``.

    A recording without any, or without poses of an odometry, comes back as it is.
    """
    found = left_out(recording)
    if not found or recording.odometry is None:
        return recording
    return replace(recording, odometry=joined(recording.odometry), dropped=recording.dropped | found)


def steps(odometry: Trajectory) -> np.ndarray:
    """Return the motion ``(K - 1, 3)`` of an odometry from each of its poses to the next, none where it jumps."""
    return np.where(jumps(odometry)[:, None], 0.0, between(odometry.poses[:-1], odometry.poses[1:]))


def joined(odometry: Trajectory) -> Trajectory:
    """Return an odometry from the origin on that goes on from where it was after each jump."""
    poses = between(odometry.poses[0], odometry.poses)
    after = [*np.flatnonzero(jumps(odometry)) + 1, len(poses)]
    for begin, end in pairwise(after):
        frame = rejoined(odometry.poses[begin], poses[begin - 1])
        poses[begin:end] = between(frame, odometry.poses[begin:end])
    return Trajectory(odometry.t, poses)


def rejoined(pose: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return the frame ``(3,)`` in which the ``pose (3,)`` after a jump is where the robot was ``before (3,)`` it."""
    return compose(pose, invert(before))
