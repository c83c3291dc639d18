"""Exercises of chapter 00: right answers in many styles, and wrong ones with the words for each."""

import bisect
import cmath
import itertools
import math
from array import array
from collections import deque

import cv2
import numpy as np
import pytest
from notebook_cells import check_nonsense_is_named
from pfslam_book.ch00 import check_distance_at, check_nearest_within, check_scan_points, check_to_world

EXERCISES = [
    (check_scan_points, "scan_points"),
    (check_nearest_within, "nearest_within"),
    (check_to_world, "to_world"),
    (check_distance_at, "distance_at"),
]


@pytest.mark.parametrize(("check", "name"), EXERCISES)
def test_nonsense_is_named_and_never_raises(check, name):
    check_nonsense_is_named(check, 1.0, 3)


def polar(r, angle):
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])


def good(r):
    return np.isfinite(r) & (r >= 0.1) & (r <= 30)


def rotation(theta):
    return np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])


# ---- right answers: loops, lists, tuples, float32, four digits, complex numbers, other ways to compute


def points_in_a_loop(ranges, angles, lidar_xy):
    points = []
    for r, angle in zip(ranges, angles, strict=True):
        if 0.1 <= r <= 30:
            points.append((lidar_xy[0] + r * math.cos(angle), lidar_xy[1] + r * math.sin(angle)))
    return points


def points_complex(ranges, angles, lidar_xy):
    z = (ranges * np.exp(1j * angles))[good(ranges)] + complex(*lidar_xy)
    return np.stack([z.real, z.imag], axis=-1)


def points_masked_at_the_end(ranges, angles, lidar_xy):
    with np.errstate(invalid="ignore"):
        return (polar(np.float32(ranges), angles) + lidar_xy)[good(ranges)].astype(np.float32)


def points_of_opencv(ranges, angles, lidar_xy):
    kept = good(ranges)
    x, y = cv2.polarToCart(ranges[kept], angles[kept])
    return deque(zip(x.ravel() + lidar_xy[0], y.ravel() + lidar_xy[1], strict=True))


def nearest_in_a_loop(t, query, max_gap):
    found = []
    for q in query:
        i = min(range(len(t)), key=lambda k: abs(t[k] - q))
        found.append(i if abs(t[i] - q) <= max_gap else -1)
    return tuple(found)


def nearest_by_search(t, query, max_gap):
    right = np.clip(np.searchsorted(t, query), 1, len(t) - 1)
    index = right - (query - t[right - 1] < t[right] - query)
    return np.where(np.abs(t[index] - query) > max_gap, -1, index).astype(float)


def nearest_by_midpoints(t, query, max_gap):
    index = np.digitize(query, 0.5 * (t[1:] + t[:-1])).astype(np.int16)
    index[np.abs(t[index] - query) > max_gap] = -1
    return index.tolist()


def nearest_complex(t, query, max_gap):
    apart = np.abs((t[:, None] - query[None, :]) * 1j)
    return np.where(apart.min(axis=0) > max_gap, -1, apart.argmin(axis=0))


def nearest_by_bisection(t, query, max_gap):
    found = array("i")
    for q in query:
        k = bisect.bisect_left(t, q)
        near = min((i for i in (k - 1, k) if 0 <= i < len(t)), key=lambda i: abs(t[i] - q))
        found.append(near if abs(t[near] - q) <= max_gap else -1)
    return found


def nearest_in_float32(t, query, max_gap):
    t, query = np.float32(t - t[0]), np.float32(query - t[0])
    apart = abs(t - query.reshape(-1, 1))
    nearest = apart.argmin(1)
    nearest[apart.min(1) > max_gap] = -1
    return np.float32(nearest)


def world_complex(pose_wb, points_b):
    z = complex(*pose_wb[:2]) + cmath.exp(1j * pose_wb[2]) * (points_b[:, 0] + 1j * points_b[:, 1])
    return np.column_stack([z.real, z.imag])


def world_in_a_loop(pose_wb, points_b):
    x, y, theta = (float(v) for v in pose_wb)
    c, s = math.cos(theta), math.sin(theta)
    return [[x + c * px - s * py, y + s * px + c * py] for px, py in points_b]


def world_homogeneous(pose_wb, points_b):
    T = np.eye(3)
    T[:2, :2], T[:2, 2] = rotation(pose_wb[2]), pose_wb[:2]
    return (T @ np.column_stack([points_b, np.ones(len(points_b))]).T)[:2].T.round(4)


def world_of_opencv(pose_wb, points_b):
    T = np.column_stack([rotation(pose_wb[2]), pose_wb[:2]])
    return tuple(map(tuple, cv2.transform(points_b[None], T)[0]))


def distance_in_a_loop(t_scan, t, counts, metres_per_count):
    total, at = 0.0, [0.0]
    for row in counts[1:].tolist():
        total += sum(row) / 4 * metres_per_count
        at.append(total)
    return [float(np.interp(s, t, at)) for s in t_scan]


def distance_by_matrix(t_scan, t, counts, metres_per_count):
    travelled = np.tril(np.ones((len(t), len(t)))) @ (counts @ np.full(4, 0.25))
    return np.float32(np.interp(t_scan, t, travelled - travelled[0]) * metres_per_count)


def distance_from_a_first_zero(t_scan, t, counts, metres_per_count):
    counts = np.vstack([np.zeros((1, 4)), counts[1:]])
    return tuple(np.interp(t_scan, t, np.cumsum(np.average(counts, axis=1))) * metres_per_count)


def distance_by_own_interpolation(t_scan, t, counts, metres_per_count):
    at = list(itertools.accumulate((float(np.mean(row)) for row in counts[1:]), initial=0.0))
    answer = array("d")
    for s in t_scan:
        k = max(i for i in range(len(t)) if t[i] <= s)
        share = (s - t[k]) / (t[k + 1] - t[k])
        answer.append(((1 - share) * at[k] + share * at[k + 1]) * metres_per_count)
    return answer


def distance_complex(t_scan, t, counts, metres_per_count):
    sides = counts[:, 1::2].mean(axis=1) + 1j * counts[:, ::2].mean(axis=1)
    both = np.interp(t_scan, t, np.cumsum(sides) - sides[0])
    return 0.5 * (both.real + both.imag) * metres_per_count


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (check_scan_points, points_in_a_loop),
        (check_scan_points, points_complex),
        (check_scan_points, points_masked_at_the_end),
        (check_scan_points, points_of_opencv),
        (check_scan_points, lambda *a: np.round(points_complex(*a), 4)),
        (check_scan_points, lambda *a: list(map(tuple, points_complex(*a)))),
        (check_nearest_within, nearest_in_a_loop),
        (check_nearest_within, nearest_by_search),
        (check_nearest_within, nearest_by_midpoints),
        (check_nearest_within, nearest_complex),
        (check_nearest_within, nearest_by_bisection),
        (check_nearest_within, nearest_in_float32),
        (check_nearest_within, lambda *a: list(nearest_by_search(*a))),
        (check_to_world, world_complex),
        (check_to_world, world_in_a_loop),
        (check_to_world, world_homogeneous),
        (check_to_world, world_of_opencv),
        (check_to_world, lambda pose, p: np.float32(world_complex(np.float32(pose), np.float32(p)))),
        (check_to_world, lambda pose, p: np.einsum("ij,mj->mi", rotation(pose[2]), p) + pose[None, :2]),
        (check_distance_at, distance_in_a_loop),
        (check_distance_at, distance_by_matrix),
        (check_distance_at, distance_from_a_first_zero),
        (check_distance_at, distance_by_own_interpolation),
        (check_distance_at, distance_complex),
        (check_distance_at, lambda *a: np.round(distance_by_matrix(*a), 5)),
    ],
)
def test_the_same_in_another_style_is_right_too(check, answer):
    assert check(answer), check(answer)


# ---- wrong answers


def points(change):
    """A scan of the valid beams with something changed about them."""
    return lambda r, a, arm: change(r[good(r)], a[good(r)], np.asarray(arm))


def into_the_ranges(r, a, arm):
    r[~good(r)] = 0.0
    return polar(r, a)[r > 0] + arm


def next_if_near(t, q, gap):
    after = np.minimum(np.searchsorted(t, q), len(t) - 1)
    return np.where(np.abs(t[after] - q) <= gap, after, -1)


def without_clip(t, q, gap):
    after = np.searchsorted(t, q)
    index = np.where(np.abs(t[after] - q) < np.abs(t[after - 1] - q), after, after - 1)
    return np.where(np.abs(t[index] - q) <= gap, index, -1)


def nearest(t, q, gap):
    return np.abs(t[None] - q[:, None]).argmin(axis=1)


def within(near, none=-1):
    """The nearest index where ``near(apart, gap)`` holds."""

    def nearest_within(t, q, gap):
        apart = np.abs(t[None] - q[:, None])
        return np.where(near(apart.min(axis=1), gap), apart.argmin(axis=1), none)

    return nearest_within


def signed(t, q, gap):
    index = nearest(t, q, gap)
    return np.where(t[index] - q <= gap, index, -1)


def counted_from_one(t, q, gap):
    return [i + 1 if i >= 0 else i for i in nearest_in_a_loop(t, q, gap)]


def by_the_other_clock(t, q, gap):
    q -= t[0]
    return nearest(t - t[0], q, gap)


def new_x_in_y(pose, p):
    p, c, s = p.copy(), np.cos(pose[2]), np.sin(pose[2])
    p[:, 0] = c * p[:, 0] - s * p[:, 1]
    p[:, 1] = s * p[:, 0] + c * p[:, 1]
    return p + pose[:2]


def matrix(c_, s_):
    """A turn by a matrix with the rows ``c_`` and ``s_``, functions of cosine and sine."""

    def to_world(pose, p):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return p @ np.array([c_(c, s), s_(c, s)]).T + pose[:2]

    return to_world


def into_the_points(pose, p):
    p += 1.0
    return p


def sums(counts, metres):
    return np.cumsum(counts.mean(axis=1) * metres) - counts[0].mean() * metres


def wheels(one):
    """The distance with another way to make one number of four wheels."""

    def distance_at(s, t, counts, metres):
        each = one(counts) * metres
        return np.interp(s, t, np.cumsum(each) - each[0])

    return distance_at


def since_the_first_scan(s, t, counts, metres):
    at = np.interp(s, t, sums(counts, metres))
    return at - at[0]


def single(s, t, counts, metres):
    return (counts.mean(axis=1) * metres)[nearest(t, s, None)]


@pytest.mark.parametrize(
    ("check", "wrong", "words"),
    [
        (check_scan_points, lambda r, a, arm: polar(r[good(r)], a[: good(r).sum()]) + arm, "counted the rest afresh"),
        (check_scan_points, lambda r, a, arm: polar(r, a) + arm, "not distances"),
        (check_scan_points, lambda r, a, arm: (polar(r, a) + arm)[np.isfinite(r)], "at least 0.1 m"),
        (check_scan_points, lambda r, a, arm: (polar(r, a) + arm)[r <= 30], "at least 0.1 m"),
        (check_scan_points, lambda r, a, arm: (polar(r, a) + arm)[(r >= 0.1) & (r <= 4)], "did measure something"),
        (check_scan_points, points(lambda r, a, arm: polar(r, a)), "lever arm is missing"),
        (check_scan_points, points(lambda r, a, arm: polar(r, a) - arm), "wrong sign"),
        (check_scan_points, points(lambda r, a, arm: polar(r, a) + arm[::-1]), "changed places"),
        (check_scan_points, points(lambda r, a, arm: polar(r, a) + [arm[0], 0]), "first one only"),
        (check_scan_points, points(lambda r, a, arm: polar(r + np.hypot(*arm), a)), "no beam longer"),
        (check_scan_points, points(lambda r, a, arm: polar(r, a)[:, ::-1] + arm), "x and y are swapped"),
        (check_scan_points, points(lambda r, a, arm: polar(r, -a) + arm), "Left and right"),
        (check_scan_points, points(lambda r, a, arm: polar(r, np.deg2rad(a)) + arm), "in radians already"),
        (check_scan_points, points(lambda r, a, arm: polar(r, np.rad2deg(a)) + arm), "nothing to convert"),
        (check_scan_points, points(lambda r, a, arm: (polar(r, a) + arm).T), "shape (2, 6)"),
        (check_scan_points, points(lambda r, a, arm: polar(r, a) + [0, arm[1]]), "second one only"),
        (check_scan_points, points(lambda r, a, arm: polar(r, a) + arm + arm), "twice"),
        (check_scan_points, points(lambda r, a, arm: polar(r + arm[0], a)), "no beam longer"),
        (check_scan_points, points(lambda r, a, arm: np.column_stack([r, a])), "ranges and bearings still"),
        (check_scan_points, points(lambda r, a, arm: np.column_stack([r * np.cos(a)] * 2) + arm), "Both coordinates"),
        (check_scan_points, points(lambda r, a, arm: polar(r, a + np.pi / 2) + arm), "by 90 degrees"),
        (check_scan_points, points(lambda r, a, arm: 1000 * (polar(r, a) + arm)), "a thousand times too large"),
        (
            check_scan_points,
            lambda r, a, arm: polar(r[good(r)], np.linspace(a[0], a[-1], good(r).sum())) + arm,
            "at equal angles",
        ),
        (check_scan_points, into_the_ranges, "changes what it is given"),
        (check_nearest_within, nearest, "not near"),
        (check_nearest_within, without_clip, "after the last stamp"),
        (check_nearest_within, lambda t, q, gap: np.searchsorted(t, q), "only forward"),
        (check_nearest_within, next_if_near, "only at the next"),
        (check_nearest_within, lambda t, q, gap: np.searchsorted(t, q) - 1, "returns"),
        (check_nearest_within, lambda t, q, gap: np.arange(len(q)), "by number"),
        (check_nearest_within, lambda t, q, gap: t[nearest(t, q, gap)], "Those are times"),
        (check_nearest_within, lambda t, q, gap: np.abs(t[None] - q[:, None]).min(axis=1), "the gaps"),
        (check_nearest_within, lambda t, q, gap: np.maximum(nearest_by_search(t, q, gap), 0), "you answer 0"),
        (check_nearest_within, lambda t, q, gap: [None if i < 0 else i for i in nearest_in_a_loop(t, q, gap)], "None"),
        (check_nearest_within, lambda t, q, gap: nearest_by_search(t, q, gap / 1000), "in seconds"),
        (check_nearest_within, lambda t, q, gap: np.array(3), "shape"),
        (check_nearest_within, within(lambda apart, gap: apart <= 2 * gap), "another limit"),
        (check_nearest_within, within(lambda apart, gap: apart <= gap / 2), "another limit"),
        (check_nearest_within, within(lambda apart, gap: apart**2 <= gap), "another limit"),
        (check_nearest_within, within(lambda apart, gap: apart <= 0.1), "another limit"),
        (check_nearest_within, within(lambda apart, gap: apart <= gap, none=999), "another number than -1"),
        (check_nearest_within, counted_from_one, "too large by one"),
        (check_nearest_within, signed, "signed difference"),
        (check_nearest_within, by_the_other_clock, "changes what it is given"),
        (check_to_world, matrix(lambda c, s: (0, -1), lambda c, s: (1, 0)), "whatever the heading"),
        (check_to_world, matrix(lambda c, s: (0, -s), lambda c, s: (s, 0)), "cosines of the matrix are missing"),
        (check_to_world, matrix(lambda c, s: (c, -s), lambda c, s: (s, -c)), "mirrors"),
        (check_to_world, matrix(lambda c, s: (c, s), lambda c, s: (s, c)), "first row"),
        (check_to_world, lambda pose, p: p + pose[:2], "turn first"),
        (check_to_world, lambda pose, p: p @ rotation(pose[2]).T, "turn only"),
        (check_to_world, lambda pose, p: p @ rotation(pose[2]) + pose[:2], "wrong way"),
        (check_to_world, lambda pose, p: (p - pose[:2]) @ rotation(pose[2]), "T_bw"),
        (check_to_world, lambda pose, p: (p + pose[:2]) @ rotation(pose[2]).T, "position gets turned"),
        (check_to_world, lambda pose, p: p @ rotation(np.rad2deg(pose[2])).T + pose[:2], "nothing to convert"),
        (check_to_world, into_the_points, "changes what it is given"),
        (check_to_world, lambda pose, p: p @ rotation(pose[2]).T - pose[:2], "shift has the wrong sign"),
        (check_to_world, lambda pose, p: p @ rotation(pose[2]).T + [pose[1], pose[0]], "changed places"),
        (check_to_world, lambda pose, p: p @ rotation(pose[2]).T + [pose[0], 0], "one axis only"),
        (check_to_world, lambda pose, p: p @ rotation(abs(pose[2])).T + pose[:2], "has a sign"),
        (check_to_world, matrix(lambda c, s: (s, -c), lambda c, s: (c, s)), "Sine and cosine"),
        (check_to_world, matrix(lambda c, s: (c, 0), lambda c, s: (0, s)), "both of the old ones"),
        (check_to_world, new_x_in_y, "new x goes into"),
        (check_to_world, lambda pose, p: world_complex(pose, p * [1, -1]), "mirrored"),
        (check_to_world, lambda pose, p: world_complex(pose, p)[:, ::-1], "first column is x"),
        (check_distance_at, single, "running sum"),
        (check_distance_at, lambda *a: np.cumsum(single(*a)), "are lost"),
        (check_distance_at, lambda s, t, c, m: sums(c, m)[nearest(t, s, None)], "interpolate"),
        (check_distance_at, lambda s, t, c, m: np.interp(s, t, np.cumsum(c.mean(axis=1) * m)), "before the first"),
        (check_distance_at, lambda s, t, c, m: np.interp(s, t, c.mean(axis=1) * m), "interpolate the increments"),
        (check_distance_at, wheels(lambda c: c.sum(axis=1)), "Four times"),
        (check_distance_at, wheels(lambda c: c[:, :2].mean(axis=1)), "front wheels only"),
        (check_distance_at, wheels(lambda c: c[:, 2]), "one wheel only"),
        (check_distance_at, wheels(lambda c: c[:, [0, 3]].mean(axis=1)), "two of the wheels"),
        (check_distance_at, wheels(lambda c: c[:, 1::2].mean(axis=1)), "two of the wheels"),
        (check_distance_at, lambda s, t, c, m: sums(c, m)[np.searchsorted(t, s)], "after each scan"),
        (check_distance_at, lambda s, t, c, m: np.interp(s, t[1:], sums(c, m)[1:]), "first two readings"),
        (check_distance_at, since_the_first_scan, "first scan"),
        (check_distance_at, lambda s, t, c, m: np.cumsum(np.interp(s, t, c.mean(axis=1) * m)), "other way round"),
        (check_distance_at, wheels(lambda c: np.median(c, axis=1)), "median"),
        (check_distance_at, wheels(lambda c: 0.5 * (c.max(axis=1) + c.min(axis=1))), "slowest and the fastest"),
        (check_distance_at, wheels(lambda c: c.sum(axis=1) // 4), "drops the rest"),
        (check_distance_at, lambda s, t, c, m: np.interp(s, t, sums(c, 1.0)), "Those are counts"),
        (check_distance_at, lambda s, t, c, m: 1000 * np.interp(s, t, sums(c, m)), "a thousand times too large"),
    ],
)  # fmt: skip
def test_a_wrong_answer_is_named(check, wrong, words):
    verdict = check(wrong)
    assert not verdict
    assert words in verdict.message
