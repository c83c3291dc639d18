"""Right answers to the exercises of chapter 00, in the ways that people write them: each must pass its check."""

import bisect
import cmath
import itertools
import math
from array import array
from collections import deque

import cv2
import numpy as np


def polar(r, angle):
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])


def good(r):
    return np.isfinite(r) & (r >= 0.1) & (r <= 30)


def rotation(theta):
    return np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])


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


STYLES = {
    "check_scan_points": [
        points_in_a_loop,
        points_complex,
        points_masked_at_the_end,
        points_of_opencv,
        lambda *a: np.round(points_complex(*a), 4),
    ],
    "check_nearest_within": [
        nearest_in_a_loop,
        nearest_by_search,
        nearest_by_midpoints,
        nearest_complex,
        nearest_by_bisection,
        nearest_in_float32,
        lambda *a: list(nearest_by_search(*a)),
    ],
    "check_to_world": [
        world_complex,
        world_in_a_loop,
        world_homogeneous,
        world_of_opencv,
        lambda pose, p: np.float32(world_complex(np.float32(pose), np.float32(p))),
    ],
    "check_distance_at": [
        distance_in_a_loop,
        distance_by_matrix,
        distance_from_a_first_zero,
        distance_by_own_interpolation,
        distance_complex,
    ],
}
