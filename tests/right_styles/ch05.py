"""Right answers to the exercises of chapter 05, in the ways that people write them: each must pass its check."""

import random
from bisect import bisect
from collections import deque
from fractions import Fraction
from itertools import accumulate

import numpy as np
from pfslam_book.exercises.ch05 import summary

from pfslam.particles import RESAMPLERS
from pfslam.poses import average_pose, wrap_angle


def update_in_a_loop(weights, likelihood):
    products = [w * c for w, c in zip(weights.tolist(), likelihood.tolist(), strict=True)]
    return [p / sum(products) for p in products] if any(products) else weights.tolist()


def update_by_logarithms(weights, likelihood):
    if not (weights * likelihood).any():
        return weights
    logs = np.log(weights) + np.log(likelihood)
    return np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()


def update_in_fractions(weights, likelihood):
    products = [Fraction(float(w)) * Fraction(float(c)) for w, c in zip(weights, likelihood, strict=True)]
    return deque(float(p / sum(products)) for p in products) if any(products) else deque(weights.tolist())


def multinomial(poses, weights, rng):
    return poses[rng.choice(len(weights), len(weights), p=weights)], np.full(len(poses), 1 / len(poses))


def low_variance(poses, weights, rng):
    """The loop of the textbooks, with lists."""
    n, kept, i, total = len(weights), [], 0, weights[0]
    start = rng.random() / n
    for m in range(n):
        while start + m / n > total:
            i += 1
            total += weights[i]
        kept.append(tuple(poses[i]))
    return kept, (1 / n,) * n


def resampling_wheel(poses, weights, rng):
    n, beta, kept = len(weights), 0.0, []
    index = int(rng.random() * n)
    for _ in range(n):
        beta += rng.random() * 2 * weights.max()
        while beta > weights[index]:
            beta -= weights[index]
            index = (index + 1) % n
        kept.append(index)
    return [np.float32(poses[kept]), [1 / n] * n]


def by_multinomial(poses, weights, rng):
    n = len(weights)
    return np.repeat(poses, rng.multinomial(n, weights), axis=0), deque([1 / n] * n)


def by_the_standard_library(poses, weights, rng):
    own, n = random.Random(int(rng.integers(2**31))), len(weights)
    return own.choices(poses.tolist(), weights.tolist(), k=n), [1 / n] * n


def by_bisection(poses, weights, rng):
    ends, n = list(accumulate(weights.tolist())), len(weights)
    return tuple(tuple(poses[min(bisect(ends, rng.random()), n - 1)]) for _ in range(n)), (1 / n,) * n


def by_scheme(scheme):
    return lambda poses, weights, rng: (poses[scheme(weights, rng)], np.full(len(poses), 1 / len(poses)))


RESAMPLED = [
    multinomial,
    low_variance,
    resampling_wheel,
    by_multinomial,
    by_the_standard_library,
    by_bisection,
    *map(by_scheme, RESAMPLERS.values()),
]


def seen(style):
    return lambda poses, weights, seed: summary(*style(poses, weights, np.random.default_rng(seed)))


def mean_by_rotations(poses, weights):
    turns = [np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) for t in poses[:, 2]]
    mean = sum(w * turn for w, turn in zip(weights, turns, strict=True))
    return deque([*np.average(poses[:, :2], axis=0, weights=weights), np.arctan2(mean[1, 0], mean[0, 0])])


def mean_complex(poses, weights):
    z = weights @ (poses[:, 0] + 1j * poses[:, 1])
    return z.real, z.imag, np.angle(weights @ np.exp(1j * poses[:, 2]))


def mean_of_wrapped_differences(poses, weights):
    first = poses[0, 2]
    return [*(weights @ poses[:, :2]), first + weights @ wrap_angle(poses[:, 2] - first)]


def mean_in_a_loop(poses, weights):
    x = y = s = c = 0.0
    for (px, py, theta), w in zip(poses, weights, strict=True):
        x, y, s, c = x + w * px, y + w * py, s + w * np.sin(theta), c + w * np.cos(theta)
    return np.float32([x, y, np.arctan2(s, c) % (2 * np.pi)])


STYLES = {
    "check_update": [
        update_in_a_loop,
        update_by_logarithms,
        lambda w, c: tuple(np.round(update_by_logarithms(w, c), 5)),
        lambda w, c: np.float32(update_by_logarithms(w, c)),
        update_in_fractions,
    ],
    "resampled": [seen(style) for style in RESAMPLED],
    "check_mean_pose": [
        mean_complex,
        mean_by_rotations,
        mean_of_wrapped_differences,
        mean_in_a_loop,
        lambda poses, weights: np.round(average_pose(poses, weights), 4),
    ],
}
