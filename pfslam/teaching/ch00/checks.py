"""Checks of the exercises of chapter 00. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pfslam.teaching.show.checks import Check, attempt, hint, is_unanswered, passed, unanswered


def _array(answer, shape: tuple[int, ...]) -> np.ndarray | Check:
    """The answer as an array of numbers of that shape, or the verdict on what it is instead."""
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    try:
        values = np.asarray(answer)
    except ValueError:
        return hint("Your rows have different lengths; one plain array is asked for.")
    if values.dtype.kind not in "fiub":
        return hint(f"Numbers are asked for; your function returns {answer!r}.")
    if values.shape != shape:
        return hint(f"An array of shape {shape} is asked for; yours has the shape {values.shape}.")
    return values


def _verdict(values: np.ndarray, right: np.ndarray, wrong: list, ok: str, otherwise: str) -> Check:
    """Passed if equal to ``right``; else the first hint of ``wrong`` (values, words) that fits; else the last one."""
    if np.allclose(values, right, atol=1e-6):
        return passed(ok)
    for value, words in wrong:
        if np.shape(value) == values.shape and np.allclose(values, value, atol=1e-6):
            return hint(words)
    return hint(otherwise)


# ---- exercise 1: ranges and their bearings

ANGLES = np.deg2rad([-90.0, -45.0, 0.0, 45.0, 90.0, 135.0])
RANGES = np.array([2.0, 60.0, 1.0, np.nan, 3.0, 0.001])
RANGE_MIN, RANGE_MAX = 0.1, 30.0


def _polar(r: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])


def check_end_points(end_points: Callable) -> Check:
    """Whether ``end_points(ranges, angles, range_min, range_max)`` keeps each valid range with its own bearing."""
    answer = attempt(end_points, RANGES.copy(), ANGLES.copy(), RANGE_MIN, RANGE_MAX)
    good = np.isfinite(RANGES) & (RANGES >= RANGE_MIN) & (RANGES <= RANGE_MAX)
    if isinstance(answer, np.ndarray) and answer.ndim == 2:
        if len(answer) == len(RANGES):
            return hint(
                "All six beams are still there. 60.0, 0.001 and NaN are codes for 'no return', not distances."
            )
        if len(answer) in (4, 5):
            return hint(
                "Some beams that measured nothing are still there. Test all three: finite, not below range_min, "
                "not above range_max."
            )
    values = _array(answer, (int(good.sum()), 2))
    if isinstance(values, Check):
        return values
    right = _polar(RANGES[good], ANGLES[good])
    wrong = [
        (
            _polar(RANGES[good], ANGLES[: good.sum()]),
            "The ranges are right and their bearings are not: you dropped beams and numbered the rest anew. Every "
            "point after a gap is turned. Mask ranges and angles together.",
        ),
        (right[:, ::-1], "x and y are swapped: x is ahead, r cos(angle); y is to the left, r sin(angle)."),
        (
            _polar(RANGES[good], np.deg2rad(ANGLES[good])),
            "The angles are in radians already; you converted them once more.",
        ),
        (
            right * [1, -1],
            "Left and right are swapped: positive angles are to the left, where y is positive.",
        ),
    ]
    return _verdict(
        values,
        right,
        wrong,
        "Three of six beams measured something, each at its own bearing.",
        f"The points should be {np.round(right, 2).tolist()}; yours are {np.round(values, 2).tolist()}.",
    )


# ---- exercise 2: the nearest stamp that is near enough

STAMPS = np.array([10.00, 10.03, 10.06, 10.50])
QUERIES = np.array([10.031, 10.044, 10.058, 10.25, 10.45, 9.0])
NEAREST = np.array([1, 1, 2, -1, 3, -1])
MAX_GAP = 0.1


def check_nearest_within(nearest_within: Callable) -> Check:
    """Whether ``nearest_within(t, query, max_gap)`` gives the nearest index, or -1 where none is near enough."""
    values = _array(attempt(nearest_within, STAMPS.copy(), QUERIES.copy(), MAX_GAP), QUERIES.shape)
    if isinstance(values, Check):
        return values
    near = np.abs(STAMPS[None] - QUERIES[:, None]).argmin(axis=1)
    after = np.searchsorted(STAMPS, QUERIES)
    wrong = [
        (
            near,
            "Nearest, but not near: the stamp at 9.0 s found a partner a whole second away. Outside max_gap the "
            "answer is -1.",
        ),
        (
            after,
            "That is the next stamp, not the nearest: searchsorted looks only forward. Compare it with the one before.",
        ),
        (
            np.maximum(after - 1, 0),
            "That is the stamp before, not the nearest: compare it with the one after.",
        ),
        (np.arange(6), "You paired by number: reading k with reading k. Their clocks are not the same."),
        (
            np.where(np.abs(STAMPS[np.minimum(after, 3)] - QUERIES) <= MAX_GAP, np.minimum(after, 3), -1),
            "You look only at the next stamp, and then test the gap. The nearest may be the one before.",
        ),
        (
            STAMPS[near],
            "Those are times. The index of the reading is asked for.",
        ),
    ]
    return _verdict(
        values,
        NEAREST,
        wrong,
        "Four queries have a partner within 0.1 s; two have none, and you say so.",
        f"Expected {NEAREST.tolist()} for the queries {QUERIES.tolist()}; yours are {values.tolist()}.",
    )


# ---- exercise 3: from the LiDAR to the world

POSE = np.array([1.0, 2.0, np.pi / 2])
ARM = np.array([0.1, 0.0])
POINTS_L = np.array([[2.0, 0.0], [0.0, 1.0]])


def check_to_world(to_world: Callable) -> Check:
    """Whether ``to_world(pose_wb, points_l, lidar_b)`` shifts by the lever arm, then turns, then shifts by the pose."""
    values = _array(attempt(to_world, POSE.copy(), POINTS_L.copy(), ARM.copy()), POINTS_L.shape)
    if isinstance(values, Check):
        return values
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])  # by +90 degrees
    points_b = POINTS_L + ARM
    right = points_b @ turn.T + POSE[:2]
    wrong = [
        (
            POINTS_L @ turn.T + POSE[:2],
            "The lever arm is missing: the LiDAR does not sit at the robot's centre.",
        ),
        (
            POINTS_L @ turn.T + POSE[:2] + ARM,
            "The lever arm was added in the world. It is fixed to the robot: add it first, then turn.",
        ),
        (
            (POINTS_L + ARM[::-1]) @ turn.T + POSE[:2],
            "The lever arm is on the wrong axis: x is ahead, y is left.",
        ),
        (
            (POINTS_L - ARM) @ turn.T + POSE[:2],
            "The sign of the lever arm: the LiDAR sits ahead of the centre.",
        ),
        (
            points_b @ turn + POSE[:2],
            "Turned the wrong way: points stand in rows, so R p for all of them is points @ R.T, not points @ R.",
        ),
        (
            (points_b - POSE[:2]) @ turn,
            "That is T_bw, the world seen from the robot. T_wb turns first and then shifts.",
        ),
        (
            (points_b + POSE[:2]) @ turn.T,
            "You shift by the pose and then turn: the position gets turned too.",
        ),
    ]
    return _verdict(
        values,
        right,
        wrong,
        "A point 2 m ahead of a LiDAR that looks north lies at (1.0, 4.1).",
        f"Expected {right.tolist()}, yours are {np.round(values, 2).tolist()}.",
    )


# ---- exercise 4: increments at the times of another clock

T_COUNTS = np.array([0.0, 0.1, 0.2, 0.3, 0.4])
COUNTS = np.array([[5, 5, 5, 5], [10, 12, 10, 12], [20, 18, 20, 18], [16, 14, 16, 14], [8, 8, 8, 8]])
T_SCANS = np.array([0.05, 0.24, 0.38])
METRES = 0.01


def check_distance_at(distance_at: Callable) -> Check:
    """Whether ``distance_at(t_scan, t, counts, metres_per_count)`` cumulates first and interpolates then."""
    answer = attempt(distance_at, T_SCANS.copy(), T_COUNTS.copy(), COUNTS.copy(), METRES)
    values = _array(answer, T_SCANS.shape)
    if isinstance(values, Check):
        return values
    mean = COUNTS.mean(axis=1) * METRES
    near = np.abs(T_COUNTS[None] - T_SCANS[:, None]).argmin(axis=1)
    right = np.interp(T_SCANS, T_COUNTS, np.cumsum(mean) - mean[0])
    wrong = [
        (
            np.interp(T_SCANS, T_COUNTS, np.cumsum(mean)),
            "The first reading speaks of the time before the first stamp: "
            "the distance starts at 0 there. Subtract it.",
        ),
        (
            mean[near],
            "Those are single readings, each the way since the one before. You need their running sum.",
        ),
        (
            np.cumsum(mean[near]),
            "You sum the readings nearest to the scans. All readings between two scans are lost.",
        ),
        (
            (np.cumsum(mean) - mean[0])[near],
            "Right sums, but read off at the nearest reading. Between two readings the "
            "robot moves on: interpolate.",
        ),
        (4 * right, "Four times too long: the chassis travels the mean of its wheels, not their sum."),
        (
            np.interp(T_SCANS, T_COUNTS, mean),
            "You interpolate the increments. A share of an increment means nothing: cumulate first.",
        ),
    ]
    return _verdict(
        values,
        right,
        wrong,
        f"{np.round(right, 3).tolist()} m: cumulated, then interpolated.",
        f"Expected {np.round(right, 3).tolist()} m at the scans; yours are {np.round(values, 3).tolist()}.",
    )
