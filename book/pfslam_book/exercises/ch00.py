"""Exercises of chapter 00."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

rngs = [np.random.default_rng(seed) for seed in range(4)]

# ---- 1: a scan as points of the body frame


def scan_case(rng) -> tuple:
    """Ranges, both limits among them, bearings and a lever arm (x, y); six beams in the middle measured nothing."""
    ranges, angles = rng.uniform(0.2, 9.0, 12), np.sort(rng.uniform(-2.3, 2.3, 12))
    ranges[:2], ranges[3:9] = (0.1, 29.5), rng.permutation([np.inf, 0.0, 0.05, np.nan, 60.0, 30.0])
    return ranges, angles, rng.uniform(0.05, 0.3, 2)


def polar(r, angle):
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])


def good(r):
    return (r >= 0.1) & (r < 30.0)


def keeping(mask):
    """Points of the beams that some rule keeps."""
    return lambda r, a, arm: polar(r[mask(r)], a[mask(r)]) + arm


check_scan_points = Exercise(
    right=keeping(good),
    cases=[scan_case(rng) for rng in rngs],
    mistakes={
        "All beams are still there. 60.0, 0.05, 0, NaN and infinity are codes for 'no return', not distances.": (
            lambda r, a, arm: polar(r, a) + arm
        ),
        "The ranges are right and their bearings are not: you dropped beams and counted the rest afresh, so "
        "every point behind the gap is turned. Mask ranges and angles together.": (
            lambda r, a, arm: polar(r[good(r)], a[: good(r).sum()]) + arm
        ),
        "The lever arm is missing: these points are in the LiDAR's frame, and the LiDAR does not sit at the "
        "robot's centre.": lambda r, a, arm: polar(r[good(r)], a[good(r)]),
        "The lever arm is a position, not a length: it shifts all points alike and makes no beam longer.": (
            lambda r, a, arm: polar(r[good(r)] + arm[0], a[good(r)])
        ),
        "The angles are in radians already, and so NumPy's cos and sin want them: there is nothing to convert.": (
            lambda r, a, arm: polar(r[good(r)], np.deg2rad(a[good(r)])) + arm
        ),
        "You subtract the lever arm. From the robot's centre it is first the way to the LiDAR and then the way to "
        "the point, so the two add up.": lambda r, a, arm: polar(r[good(r)], a[good(r)]) - arm,
        "A beam whose range is NaN became a point. Every comparison with NaN is False: do not ask which ranges are "
        "bad and keep the rest, but ask which are good.": keeping(lambda r: ~((r < 0.1) | (r >= 30.0))),
        "Your limits are wrong at their edges. A range of exactly 0.1 m is a measurement; exactly 30 m is already a "
        "code for 'no return'.": (
            keeping(lambda r: (r >= 0.1) & (r <= 30.0)),
            keeping(lambda r: (r > 0.1) & (r < 30.0)),
            keeping(lambda r: (r > 0.1) & (r <= 30.0)),
        ),
    },
    praise="Six of twelve beams measured something, each at its own bearing, seen from the middle of the robot.",
)

# ---- 2: the nearest stamp that is near enough


def stamp_case(rng, gap) -> tuple:
    """Stamps that jitter and pause, queries between them, in the pause, before and after all, and the gap."""
    t = 10.0 + np.cumsum(rng.uniform(0.02, 0.05, 14)) + np.where(np.arange(14) > 6, 0.5, 0.0)
    between = t[[0, 2, 4, 8, 9]] + np.diff(t)[[0, 2, 4, 8, 9]] * [0.3, 0.7, 0.4, 0.8, 0.2]
    in_the_pause = [t[6] + 1.6 * gap, t[6] + 0.25, t[7] - 0.7 * gap]
    at_the_end = [t[-1] + 0.03, t[-1] + 1.15 * gap, t[-1] + 3.0]
    return t, np.array([9.0, t[0] - 0.04, *between, *in_the_pause, *at_the_end]), gap


def apart(t, query):
    return np.abs(t[None, :] - query[:, None])


def nearest_within(t, query, max_gap, none: float = -1):
    return np.where(apart(t, query).min(axis=1) <= max_gap, apart(t, query).argmin(axis=1), none)


def next_within(t, query, max_gap):
    after = np.minimum(np.searchsorted(t, query), len(t) - 1)
    return np.where(np.abs(t[after] - query) <= max_gap, after, -1)


check_nearest_within = Exercise(
    right=nearest_within,
    cases=[stamp_case(rng, gap) for rng, gap in zip(rngs, (0.1, 0.08, 0.12, 0.1), strict=True)],
    mistakes={
        "Nearest, but not near: the query at 9.0 s found a partner a whole second away. Outside max_gap the "
        "answer is -1.": lambda t, q, gap: apart(t, q).argmin(axis=1),
        "You look only at the next stamp. The nearest may be the one before.": next_within,
        "Your function stops with an IndexError. A query may come after the last stamp: the camera goes on "
        "when everything else has ended.": IndexError,
        "Where no stamp is near enough the answer is -1, a whole number like the others.": (
            lambda t, q, gap: nearest_within(t, q, gap, none=np.nan)
        ),
        "You paired by number, reading k with reading k. Their clocks are not the same.": (
            lambda t, q, gap: np.arange(len(q))
        ),
    },
    praise="Each query has its nearest stamp, from either side, or -1 where none lies within max_gap.",
)

# ---- 3: from the body to the world


def turn(theta):
    return np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])


check_to_world = Exercise(
    right=lambda pose, p: p @ turn(pose[2]).T + pose[:2],
    cases=[
        (np.array([*rng.uniform(1.0, 4.0, 2), heading]), rng.uniform(-3.0, 3.0, (5, 2)))
        for rng, heading in zip(rngs, (0.7, -2.4, 2.1, -0.6), strict=True)
    ],
    mistakes={
        "You shift by the position only. A robot that looks elsewhere sees the same point in another place: "
        "turn first.": lambda pose, p: p + pose[:2],
        "Turned the wrong way. Points stand in rows, so R p for all of them is points @ R.T, not points @ R.": (
            lambda pose, p: p @ turn(pose[2]) + pose[:2]
        ),
        "That is T_bw, the world seen from the robot. T_wb turns first and then shifts.": (
            lambda pose, p: (p - pose[:2]) @ turn(pose[2])
        ),
        "You shift by the pose and then turn: the position gets turned too.": (
            lambda pose, p: (p + pose[:2]) @ turn(pose[2]).T
        ),
        "NumPy's cos and sin take radians, and the heading is in radians: there is nothing to convert.": (
            lambda pose, p: p @ turn(np.deg2rad(pose[2])).T + pose[:2]
        ),
    },
    praise="First the turn, then the shift: that is T_wb.",
)

# ---- 4: increments at the times of another clock


def count_case(rng, metres, reverses) -> tuple:
    """Scan times, stamps that jitter, counts of four wheels that differ, and the metres per count."""
    t = 3.0 + np.cumsum(rng.uniform(0.05, 0.12, 14))
    counts = rng.integers(4, 30, 14)[:, None] + rng.integers(0, 9, (14, 4))
    counts[6:9] *= -1 if reverses else 1
    scans = np.sort([t[0] + 0.6 * (t[1] - t[0]), *rng.uniform(t[1], t[-2], 4)])
    return scans, t, counts, metres


def sums(counts, metres, wheels=np.mean):
    """The running sum (m) from 0 at the first stamp, each reading made one number by ``wheels``."""
    per_reading = wheels(counts, axis=1) * metres
    return np.cumsum(per_reading) - per_reading[0]


check_distance_at = Exercise(
    right=lambda s, t, c, m: np.interp(s, t, sums(c, m)),
    cases=[
        count_case(rng, metres, reverses)
        for rng, metres, reverses in zip(rngs, (0.01, 0.0022, 0.003, 0.0022), (0, 0, 1, 1), strict=True)
    ],
    mistakes={
        "The first reading tells about the time before the first stamp, so the distance is 0 there. Subtract it.": (
            lambda s, t, c, m: np.interp(s, t, np.cumsum(c.mean(axis=1) * m))
        ),
        "Those are single readings, each the distance since the one before. You need their running sum.": (
            lambda s, t, c, m: (c.mean(axis=1) * m)[apart(t, s).argmin(axis=1)]
        ),
        "The sums are right, but you read them off at the nearest reading. Between two readings the robot moves "
        "on: interpolate.": lambda s, t, c, m: sums(c, m)[apart(t, s).argmin(axis=1)],
        "Four times too long: the chassis travels the mean of its wheels, not their sum.": (
            lambda s, t, c, m: np.interp(s, t, sums(c, m, np.sum))
        ),
        "Right ahead, wrong backwards: a wheel that runs backwards counts down, and you dropped the sign.": (
            lambda s, t, c, m: np.interp(s, t, sums(np.abs(c), m))
        ),
    },
    praise="Added up first, then interpolated: no count is lost, whichever scans you choose.",
)
