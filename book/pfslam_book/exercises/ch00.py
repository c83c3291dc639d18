"""Checks of the exercises of chapter 00: each takes the reader's function and says in words what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from pfslam_book.show.checks import Check, attempt, compare, hint

# ---- exercise 1: a scan as points of the body frame

RANGE_MIN, RANGE_MAX = 0.1, 30.0
NOT_MEASURED = (np.inf, 0.0, 0.05, np.nan, 60.0, 30.6)


def _scan_case(seed: int) -> tuple:
    """Return ranges, bearings and a lever arm with both coordinates; six beams in the middle measured nothing."""
    rng = np.random.default_rng(seed)
    ranges, angles = rng.uniform(0.2, 9.0, 12), np.sort(rng.uniform(-2.3, 2.3, 12))
    ranges[:2], ranges[3:9] = (0.15, 29.5), rng.permutation(NOT_MEASURED)
    return ranges, angles, rng.uniform(0.05, 0.3, 2)


def measured(ranges: np.ndarray) -> np.ndarray:
    """Tell which ranges ``(M,)`` lie between the least and the greatest that can be measured."""
    return (ranges >= RANGE_MIN) & (ranges <= RANGE_MAX)


def polar(ranges: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return points ``(M, 2)`` at these ranges (m) and bearings (rad)."""
    return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])


def scan_points(ranges, angles, lidar_xy) -> np.ndarray:
    """Solve exercise 1."""
    good = measured(ranges)
    return polar(ranges[good], angles[good]) + lidar_xy


def _scan_mistake(change: Callable) -> Callable:
    """Return a wrong ``scan_points`` made of the valid ranges, their bearings and the lever arm."""
    return lambda r, a, arm: change(r[measured(r)], a[measured(r)], np.asarray(arm))


SCAN_MISTAKES = [
    (
        lambda r, a, arm: polar(r[measured(r)], a[: measured(r).sum()]) + arm,
        "The ranges are right and their bearings are not: you dropped beams and counted the rest afresh, so every "
        "point behind the gap is turned. Mask ranges and angles together.",
    ),
    (
        lambda r, a, arm: polar(r[measured(r)], np.linspace(a[0], a[-1], measured(r).sum())) + arm,
        "The ranges are right and their bearings are not: the beams that are left do not stand at equal angles. Mask "
        "ranges and angles together.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, a)),
        "The lever arm is missing: these points are in the LiDAR's frame, and the LiDAR does not sit at the robot's "
        "centre.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, a) - arm),
        "The lever arm has the wrong sign: the LiDAR sits at lidar_xy, so its points lie further by that much.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, a) + arm[::-1]),
        "The two coordinates of the lever arm have changed places.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, a) + [arm[0], 0.0]),
        "The lever arm has two coordinates; you use the first one only.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, a) + [0.0, arm[1]]),
        "The lever arm has two coordinates; you use the second one only.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, a) + 2.0 * arm),
        "You add the lever arm twice.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r + np.hypot(*arm), a)),
        "The lever arm is a position, not a length: it shifts all points alike and makes no beam longer.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r + arm[0], a)),
        "The lever arm is a position, not a length: it shifts all points alike and makes no beam longer.",
    ),
    (
        _scan_mistake(lambda r, a, arm: np.column_stack([r, a])),
        "Those are ranges and bearings still. A point has the coordinates r cos(angle) and r sin(angle).",
    ),
    (
        _scan_mistake(lambda r, a, arm: np.column_stack([r * np.cos(a), r * np.cos(a)]) + arm),
        "Both coordinates have the cosine: x is r cos(angle), y is r sin(angle).",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, a + np.pi / 2) + arm),
        "Your points are turned by 90 degrees: the angle 0 is ahead, along x.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, a)[:, ::-1] + arm),
        "x and y are swapped: x is ahead, r cos(angle), and y is to the left, r sin(angle).",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, -a) + arm),
        "Left and right are swapped: positive angles are to the left, where y is positive.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, np.deg2rad(a)) + arm),
        "The angles are in radians already; you converted them once more.",
    ),
    (
        _scan_mistake(lambda r, a, arm: polar(r, np.rad2deg(a)) + arm),
        "NumPy's cos and sin take radians, and the angles are in radians: there is nothing to convert.",
    ),
]


def _rows_hint(answer, ranges: np.ndarray) -> str:
    """Return what is wrong with the number of points, or nothing."""
    try:
        rows = len(answer)
    except TypeError:
        return ""
    if rows == len(ranges):
        return "All beams are still there. 60.0, 0.05, 0, NaN and infinity are codes for 'no return', not distances."
    if measured(ranges).sum() < rows < len(ranges):
        return (
            "Some beams that measured nothing are still there. A range counts if it is at least 0.1 m and at most "
            "30 m; for NaN neither is true."
        )
    if 2 != rows < measured(ranges).sum():
        return "Some beams that did measure something are missing: every range from 0.1 m to 30 m counts."
    return ""


def check_scan_points(theirs: Callable) -> Check:
    """Check whether ``scan_points(ranges, angles, lidar_xy)`` keeps each valid beam with its bearing, in frame b."""
    cases = [_scan_case(seed) for seed in range(4)]
    words = _rows_hint(attempt(theirs, *(part.copy() for part in cases[0])), cases[0][0])
    if words:
        return hint(words)
    praise = (
        "Six of twelve beams measured something, each at its own bearing, seen from the middle of the robot."
    )
    return compare(theirs, scan_points, cases, mistakes=SCAN_MISTAKES, praise=praise)


# ---- exercise 2: the nearest stamp that is near enough


def _stamp_case(seed: int) -> tuple:
    """Return stamps that jitter and pause, queries between them, in the pause, before and after all, and the gap."""
    rng = np.random.default_rng(seed)
    t = 10.0 + np.cumsum(rng.uniform(0.02, 0.05, 14)) + np.where(np.arange(14) > 6, 0.5, 0.0)
    between = t[[0, 2, 4, 8, 9]] + np.diff(t)[[0, 2, 4, 8, 9]] * np.array([0.3, 0.7, 0.4, 0.8, 0.2])
    gap = (0.1, 0.08, 0.12, 0.1)[seed]
    in_the_pause = [t[6] + 1.6 * gap, t[6] + 0.25, t[7] - 0.7 * gap]
    at_the_end = [t[-1] + 0.03, t[-1] + 1.15 * gap, t[-1] + 3.0]
    return t, np.array([9.0, t[0] - 0.04, *between, *in_the_pause, *at_the_end]), gap


def _apart(t, query) -> np.ndarray:
    return np.abs(np.asarray(t)[None, :] - np.asarray(query)[:, None])


def nearest_within(t, query, max_gap) -> np.ndarray:
    """Solve exercise 2."""
    return np.where(_apart(t, query).min(axis=1) <= max_gap, _apart(t, query).argmin(axis=1), -1)


def _neighbour(t, query, back: int) -> np.ndarray:
    """Return the next stamp, or the one before."""
    return np.clip(np.searchsorted(t, query) - back, 0, len(t) - 1)


def _if_near(index: np.ndarray, t, query, max_gap) -> np.ndarray:
    return np.where(np.abs(t[index] - query) <= max_gap, index, -1)


def _within(t, query, max_gap, near: Callable, none: int = -1) -> np.ndarray:
    """Return the nearest index where ``near(apart, max_gap)`` holds."""
    apart = _apart(t, query)
    return np.where(near(apart.min(axis=1), max_gap), apart.argmin(axis=1), none)


def _within_signed(t, query, max_gap, sign: int) -> np.ndarray:
    """Return the nearest index where the signed difference is below the gap."""
    nearest = _apart(t, query).argmin(axis=1)
    return np.where(sign * (t[nearest] - query) <= max_gap, nearest, -1)


STAMP_MISTAKES = [
    (
        IndexError,
        "Your function stops with an IndexError. A query may come after the last stamp, and there is no "
        "reading there: "
        "the camera goes on after everything else has ended.",
    ),
    (
        lambda t, q, gap: _apart(t, q).argmin(axis=1),
        "Nearest, but not near: the query at 9.0 s found a partner a whole second away. Outside max_gap the answer "
        "is -1.",
    ),
    (
        lambda t, q, gap: np.searchsorted(t, q),
        "That is the next stamp, not the nearest: searchsorted looks only forward. Compare it with the one before.",
    ),
    (
        lambda t, q, gap: _neighbour(t, q, 0),
        "That is the next stamp, not the nearest: searchsorted looks only forward. Compare it with the one before.",
    ),
    (
        lambda t, q, gap: _neighbour(t, q, 1),
        "That is the stamp before, not the nearest: compare it with the one after.",
    ),
    (
        lambda t, q, gap: _if_near(_neighbour(t, q, 0), t, q, gap),
        "You look only at the next stamp, and then test the gap. The nearest may be the one before.",
    ),
    (
        lambda t, q, gap: _if_near(_neighbour(t, q, 1), t, q, gap),
        "You look only at the stamp before, and then test the gap. The nearest may be the one after.",
    ),
    (
        lambda t, q, gap: np.arange(len(q)),
        "You paired by number: reading k with reading k. Their clocks are not the same.",
    ),
    (
        lambda t, q, gap: np.asarray(t)[_apart(t, q).argmin(axis=1)],
        "Those are times. The index of the reading is asked for.",
    ),
    (
        lambda t, q, gap: _apart(t, q).min(axis=1),
        "Those are the gaps. The index of the reading is asked for.",
    ),
    (
        lambda t, q, gap: np.where(nearest_within(t, q, gap) < 0, 0, nearest_within(t, q, gap)),
        "Where no stamp is near enough you answer 0, and 0 is the first reading. The answer there is -1.",
    ),
    (
        lambda t, q, gap: np.where(nearest_within(t, q, gap) < 0, np.nan, nearest_within(t, q, gap)),
        "Where no stamp is near enough the answer is -1, a whole number like the others.",
    ),
    (
        lambda t, q, gap: _if_near(_apart(t, q).argmin(axis=1), t, q, 1e-3 * gap),
        "max_gap is in seconds, as the stamps are: there is nothing to convert.",
    ),
    *(
        (
            partial(_within, near=near),
            "You find the nearest stamp and test it against another limit: compare |t - query| itself with max_gap.",
        )
        for near in (
            lambda apart, gap: apart <= 2.0 * gap,
            lambda apart, gap: apart <= 0.5 * gap,
            lambda apart, gap: apart**2 <= gap,
            lambda apart, gap: apart <= 0.1,
        )
    ),
    *(
        (
            partial(_within, near=lambda apart, gap: apart <= gap, none=none),
            "Where no stamp is near enough you answer another number than -1.",
        )
        for none in (-2, 14, 99, -99, 999, -999)
    ),
    (
        lambda t, q, gap: np.where(nearest_within(t, q, gap) < 0, -1, nearest_within(t, q, gap) + 1),
        "Your indices are too large by one: the first stamp has the index 0.",
    ),
    (
        lambda t, q, gap: np.subtract.outer(-q, -t).argmin(axis=1),
        "The least signed difference is not the nearest stamp: take absolute values first.",
    ),
    *(
        (
            partial(_within_signed, sign=sign),
            "You compare a signed difference with max_gap, so a stamp on the other side is never too far. Take its "
            "absolute value.",
        )
        for sign in (1, -1)
    ),
]


def check_nearest_within(theirs: Callable) -> Check:
    """Check whether ``nearest_within(t, query, max_gap)`` gives the nearest index, or -1 where none is near enough."""
    cases = [_stamp_case(seed) for seed in range(4)]
    answer = attempt(theirs, cases[0][0].copy(), cases[0][1].copy(), 0.1)
    parts = answer.ravel() if isinstance(answer, np.ndarray) else answer
    if isinstance(parts, list | tuple | np.ndarray) and any(part is None for part in parts):
        return hint(
            "Where no stamp is near enough the answer is -1, a whole number like the others; yours is None."
        )
    praise = "Each query has its nearest stamp, from either side, or -1 where none lies within max_gap."
    return compare(theirs, nearest_within, cases, mistakes=STAMP_MISTAKES, praise=praise)


# ---- exercise 3: from the body to the world


def rotation(theta: float) -> np.ndarray:
    """Return the turn by ``theta`` (rad) as a matrix ``(2, 2)``."""
    return np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])


def to_world(pose_wb, points_b) -> np.ndarray:
    """Solve exercise 3."""
    return np.asarray(points_b) @ rotation(pose_wb[2]).T + pose_wb[:2]


def _world_case(seed: int) -> tuple:
    """Return a pose with nothing round about it, and five points."""
    rng = np.random.default_rng(seed)
    heading = (0.7, -2.4, 2.1, -0.6)[seed]
    return np.array([*rng.uniform(1.0, 4.0, 2), heading]), rng.uniform(-3.0, 3.0, (5, 2))


def _turned_by(matrix: Callable) -> Callable:
    return lambda pose, p: p @ np.asarray(matrix(np.cos(pose[2]), np.sin(pose[2]))).T + pose[:2]


def _shift_by(pose, points, part) -> np.ndarray:
    """Turn as is right, and shift by one coordinate of the position."""
    return points @ rotation(pose[2]).T + np.multiply(pose[:2], part)


def _x_overwritten(pose, points) -> np.ndarray:
    """Write the new x over the old one before y has been computed."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x = c * points[:, 0] - s * points[:, 1]
    return np.column_stack([x, s * x + c * points[:, 1]]) + pose[:2]


WORLD_MISTAKES = [
    (
        lambda pose, p: p + pose[:2],
        "You shift by the position only. A robot that looks elsewhere sees the same point in another place: turn "
        "first.",
    ),
    (
        lambda pose, p: p @ rotation(pose[2]).T,
        "You turn only. The robot does not stand at the origin: shift by its position after the turn.",
    ),
    (
        lambda pose, p: p @ rotation(pose[2]) + pose[:2],
        "Turned the wrong way. Points stand in rows, so R p for all of them is points @ R.T, not points @ R.",
    ),
    (
        lambda pose, p: (p - pose[:2]) @ rotation(pose[2]),
        "That is T_bw, the world seen from the robot. T_wb turns first and then shifts.",
    ),
    (
        lambda pose, p: (p + pose[:2]) @ rotation(pose[2]).T,
        "You shift by the pose and then turn: the position gets turned too.",
    ),
    (
        lambda pose, p: p @ rotation(pose[2]).T - pose[:2],
        "The turn is right, the shift has the wrong sign: add the position.",
    ),
    (
        lambda pose, p: p @ rotation(pose[2]).T + pose[1::-1],
        "The turn is right, but the position's x and y have changed places.",
    ),
    *(
        (
            partial(_shift_by, part=part),
            "The turn is right, but you shift along one axis only: the position has x and y.",
        )
        for part in ([1.0, 0.0], [0.0, 1.0])
    ),
    (
        _turned_by(lambda c, s: ((0.0, -1.0), (1.0, 0.0))),
        "You turn by 90 degrees whatever the heading is. The angle is the third number of the pose.",
    ),
    (
        _turned_by(lambda c, s: ((0.0, -s), (s, 0.0))),
        "The two cosines of the matrix are missing.",
    ),
    (
        _turned_by(lambda c, s: ((c, 0.0), (0.0, c))),
        "The two sines of the matrix are missing.",
    ),
    (
        _turned_by(lambda c, s: ((c, -s), (s, -c))),
        "One sign in the matrix is wrong: it mirrors the points instead of turning them. The second row is "
        "(sin, cos).",
    ),
    (
        _turned_by(lambda c, s: ((c, s), (s, c))),
        "One sign in the matrix is wrong: the first row is (cos, -sin).",
    ),
    (
        _turned_by(lambda c, s: ((s, -c), (c, s))),
        "Sine and cosine have changed places: at the heading 0 nothing is turned.",
    ),
    (
        _turned_by(lambda c, s: ((c, 0.0), (0.0, s))),
        "Each new coordinate needs both of the old ones: x' = x cos - y sin, y' = x sin + y cos.",
    ),
    (
        _x_overwritten,
        "Your new x goes into your new y. Compute both from the old point before you write either.",
    ),
    (
        lambda pose, p: p @ rotation(abs(pose[2])).T + pose[:2],
        "Left turns are right, right turns are not: the heading has a sign, and you dropped it.",
    ),
    (
        lambda pose, p: (p * [1.0, -1.0]) @ rotation(pose[2]).T + pose[:2],
        "Your points are mirrored: y is positive to the left.",
    ),
    (
        lambda pose, p: (p @ rotation(pose[2]).T + pose[:2])[:, ::-1],
        "x and y of your answer have changed places: the first column is x.",
    ),
    (
        lambda pose, p: p @ rotation(np.deg2rad(pose[2])).T + pose[:2],
        "The heading is in radians already; you converted it once more.",
    ),
    (
        lambda pose, p: p @ rotation(np.rad2deg(pose[2])).T + pose[:2],
        "NumPy's cos and sin take radians, and the heading is in radians: there is nothing to convert.",
    ),
    (
        lambda pose, p: p[:, ::-1] @ rotation(pose[2]).T + pose[:2],
        "The points' x and y are swapped: the first column is x.",
    ),
]


def check_to_world(theirs: Callable) -> Check:
    """Check whether ``to_world(pose_wb, points_b)`` turns by the heading and then shifts by the position."""
    cases = [_world_case(seed) for seed in range(4)]
    praise = "First the turn, then the shift: that is T_wb."
    return compare(theirs, to_world, cases, mistakes=WORLD_MISTAKES, praise=praise)


# ---- exercise 4: increments at the times of another clock


def _count_case(seed: int) -> tuple:
    """Return scan times, stamps that jitter, counts of four wheels that differ, and the metres per count."""
    rng = np.random.default_rng(seed)
    t = 3.0 + np.cumsum(rng.uniform(0.05, 0.12, 14))
    counts = rng.integers(4, 30, 14)[:, None] + rng.integers(0, 9, (14, 4))
    scans = np.sort([t[0] + 0.6 * (t[1] - t[0]), *rng.uniform(t[1], t[-2], 4)])
    return scans, t, counts, (0.01, 0.0022, 0.003, 0.0022)[seed]


def _sums(wheels: Callable, counts, metres: float) -> np.ndarray:
    """Return the running sum (m) from 0 at the first stamp, each reading made one number by ``wheels``."""
    per_reading = wheels(np.asarray(counts)) * metres
    return np.cumsum(per_reading) - per_reading[0]


def mean_of_wheels(counts: np.ndarray) -> np.ndarray:
    """Return the mean count of the four wheels, one for each reading."""
    return np.mean(counts, axis=1)


def distance_at(t_scan, t, counts, metres_per_count) -> np.ndarray:
    """Solve exercise 4."""
    return np.interp(t_scan, t, _sums(mean_of_wheels, counts, metres_per_count))


def _with_wheels(wheels: Callable) -> Callable:
    return lambda s, t, c, m: np.interp(s, t, _sums(wheels, c, m))


def _near(s, t) -> np.ndarray:
    return _apart(t, s).argmin(axis=1)


DISTANCE_MISTAKES = [
    (
        lambda s, t, c, m: np.interp(s, t, np.cumsum(mean_of_wheels(c) * m)),
        "The first reading tells about the time before the first stamp, so the distance is 0 there. Subtract it.",
    ),
    (
        lambda s, t, c, m: (mean_of_wheels(c) * m)[_near(s, t)],
        "Those are single readings, each the distance since the one before. You need their running sum.",
    ),
    (
        lambda s, t, c, m: np.cumsum((mean_of_wheels(c) * m)[_near(s, t)]),
        "You add up the readings nearest to the scans. All readings between two scans are lost.",
    ),
    (
        lambda s, t, c, m: _sums(mean_of_wheels, c, m)[_near(s, t)],
        "The sums are right, but they are read off at the nearest reading. Between two readings the robot moves on: "
        "interpolate.",
    ),
    (
        lambda s, t, c, m: _sums(mean_of_wheels, c, m)[np.searchsorted(t, s) - 1],
        "The sums are right, but they are read off at the reading before each scan: interpolate.",
    ),
    (
        lambda s, t, c, m: _sums(mean_of_wheels, c, m)[np.searchsorted(t, s)],
        "The sums are right, but they are read off at the reading after each scan: interpolate.",
    ),
    (
        lambda s, t, c, m: np.interp(s, t[1:], np.cumsum(mean_of_wheels(c)[1:] * m)),
        "A scan between the first two readings gets a wrong distance: the sum begins with 0 at the first stamp.",
    ),
    (
        lambda s, t, c, m: (
            np.interp(s, t, _sums(mean_of_wheels, c, m)) - np.interp(s[0], t, _sums(mean_of_wheels, c, m))
        ),
        "You count from the first scan. The distance is 0 at the first stamp of the encoders.",
    ),
    (
        lambda s, t, c, m: np.cumsum(np.interp(s, t, mean_of_wheels(c) * m)),
        "You interpolate the increments and then add up. The other way round: add them up first.",
    ),
    (
        lambda s, t, c, m: np.interp(s, t, mean_of_wheels(c) * m),
        "You interpolate the increments. A share of an increment means nothing: add them up first.",
    ),
    (
        _with_wheels(lambda c: c.sum(axis=1)),
        "Four times too long: the chassis travels the mean of its wheels, not their sum.",
    ),
    (
        _with_wheels(lambda c: c[:, :2].mean(axis=1)),
        "You use the front wheels only; in a bend or on a bump the four differ. Take the mean of all four.",
    ),
    *(
        (
            _with_wheels(lambda c, pair=pair: c[:, pair].mean(axis=1)),
            "You use two of the wheels only; in a bend or on a bump the four differ. Take the mean of all four.",
        )
        for pair in ([2, 3], [0, 2], [1, 3], [0, 3], [1, 2])
    ),
    *(
        (
            _with_wheels(lambda c, wheel=wheel: c[:, wheel]),
            "You use one wheel only. Take the mean of all four.",
        )
        for wheel in range(4)
    ),
    (
        _with_wheels(lambda c: np.median(c, axis=1)),
        "That is the median of the wheels. The chassis centre travels their mean.",
    ),
    (
        _with_wheels(lambda c: 0.5 * (c.min(axis=1) + c.max(axis=1))),
        "That is the middle between the slowest and the fastest wheel. Take the mean of all four.",
    ),
    (
        _with_wheels(lambda c: c.sum(axis=1) // 4),
        "// drops the rest of a division, up to three quarters of a count in each reading. Divide with /.",
    ),
    (
        lambda s, t, c, m: np.diff(distance_at(s, t, c, m), prepend=0.0),
        "Those are the distances from one scan to the next. The distance since the first stamp is asked for.",
    ),
    (
        lambda s, t, c, m: distance_at(s, t, c, 1.0),
        "Those are counts. Each count is worth metres_per_count metres.",
    ),
]


def check_distance_at(theirs: Callable) -> Check:
    """Check whether ``distance_at(t_scan, t, counts, metres_per_count)`` adds up first and interpolates then."""
    cases = [_count_case(seed) for seed in range(4)]
    praise = "Added up first, then interpolated: no count is lost, whichever scans you choose."
    return compare(theirs, distance_at, cases, mistakes=DISTANCE_MISTAKES, praise=praise)
