"""Right answers to the exercises of chapter 01, in the ways that people write them: each must pass its check."""

import cmath
import functools
import itertools
import math
import statistics
from array import array
from collections import deque

import numpy as np

from pfslam.motion import motion_model, motion_model_arc


def length_in_a_loop(counts, metres_per_count):
    total = 0
    for row in counts.tolist():
        for count in row:
            total += count
    return total / 4 * metres_per_count


def bias_in_a_loop(t, yaw_rate, speed):
    kept = [w for s, w, v in zip(t, yaw_rate, speed, strict=True) if v < 0.01 and s - t[0] > 2.5]
    return sum(kept) / len(kept)


def bias_of_the_last_rest(t, yaw_rate, speed):
    first = len(speed) - np.argmax(speed[::-1] > 0)
    return [yaw_rate[first:].mean()]


def bias_with_statistics(t, yaw_rate, speed):
    return statistics.fmean(w for s, w, v in zip(t, yaw_rate, speed, strict=True) if v == 0 and s > t[0] + 3)


def arc_complex(pose, v, omega, dt):
    step = v * dt if omega == 0 else v * (cmath.exp(1j * omega * dt) - 1) / (1j * omega)
    z = complex(pose[0], pose[1]) + cmath.exp(1j * pose[2]) * step
    return z.real, z.imag, pose[2] + omega * dt


def arc_by_radius(pose, v, omega, dt):
    x, y, theta = pose.tolist()
    if abs(omega) < 1e-9:
        return [x + v * dt * math.cos(theta), y + v * dt * math.sin(theta), theta]
    new = theta + omega * dt
    x, y = (
        x + v / omega * (math.sin(new) - math.sin(theta)),
        y - v / omega * (math.cos(new) - math.cos(theta)),
    )
    return [x, y, math.atan2(math.sin(new), math.cos(new))]


def arc_by_series(pose, v, omega, dt):
    h = omega * dt / 2
    terms = (lambda k, x: -x * h * h / ((2 * k) * (2 * k + 1)), range(1, 12))
    chord = v * dt * math.fsum(itertools.accumulate(terms[1], lambda x, k: terms[0](k, x), initial=1.0))
    x, y, theta = pose
    return deque([x + chord * math.cos(theta + h), y + chord * math.sin(theta + h), theta + 2 * h])


def sides(counts, metres_per_count):
    """What the left and the right wheels ran (m) in each reading."""
    return (0.5 * metres_per_count * (counts[:, k] + counts[:, k + 2]) for k in (1, 0))


def wheels_in_a_loop(counts, metres_per_count, track):
    x = y = theta = 0.0
    path = [(x, y, theta)]
    for FR, FL, RR, RL in counts.tolist():
        left, right = (FL + RL) / 2 * metres_per_count, (FR + RR) / 2 * metres_per_count
        x += (left + right) / 2 * math.cos(theta)
        y += (left + right) / 2 * math.sin(theta)
        theta += (right - left) / track
        path.append((x, y, theta))
    return path


def wheels_complex(counts, metres_per_count, track):
    left, right = sides(counts, metres_per_count)
    theta = np.append(0, np.cumsum((right - left) / track))
    z = np.append(0, np.cumsum((left + right) / 2 * np.exp(1j * theta[:-1])))
    return np.column_stack([z.real, z.imag, np.angle(np.exp(1j * theta))])


def wheels_by_the_model(counts, metres_per_count, track, model=motion_model):
    poses = [np.zeros(3)]
    for left, right in zip(*sides(counts, metres_per_count), strict=True):
        poses.append(model(poses[-1], (left + right) / 2, (right - left) / track, 1.0))
    return poses


def wheels_with_reduce(counts, metres_per_count, track):
    def step(path, way):
        (x, y, theta), (left, right) = path[-1], way
        s, phi = (left + right) / 2, (right - left) / track
        half = theta + phi / 2
        return [*path, array("d", [x + s * math.cos(half), y + s * math.sin(half), theta + phi])]

    return functools.reduce(step, zip(*sides(counts, metres_per_count), strict=True), [array("d", [0, 0, 0])])


STYLES = {
    "check_distance_ahead": [
        length_in_a_loop,
        lambda c, m: np.float32(np.float32(c).mean() * len(c) * np.float32(m)),
        lambda c, m: [round(float(c.sum() / 4 * m), 5)],
        lambda c, m: np.cumsum(c.mean(axis=1) * m)[-1],
        lambda c, m: np.full((1, len(c)), m) @ c @ np.full((4, 1), 0.25),
    ],
    "check_gyro_bias": [
        bias_in_a_loop,
        bias_of_the_last_rest,
        bias_with_statistics,
        lambda t, w, v: np.median(w[(v == 0) & (t > t[0] + 4)]),
        lambda t, w, v: np.float32(w)[(v == 0) & (t > t[0] + 8)].mean(),
    ],
    "check_arc": [
        motion_model_arc,
        arc_complex,
        arc_by_radius,
        arc_by_series,
        lambda *a: np.round(motion_model_arc(*a), 4),
        lambda *a: motion_model_arc(*a).astype(np.float32),
    ],
    "check_reckon_by_wheels": [
        wheels_in_a_loop,
        wheels_complex,
        wheels_by_the_model,
        lambda *a: wheels_by_the_model(*a, model=motion_model_arc),
        wheels_with_reduce,
        lambda *a: np.float32(wheels_complex(*a)),
        lambda *a: np.round(wheels_complex(*a), 4).tolist(),
    ],
}
