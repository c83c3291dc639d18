"""Right answers in the ways that people write them: the book's own in other dress, and those that differ from it.

A solution in another style computes the same numbers and gives them back as lists, in float32, to four digits, ...
So `styles` dresses the ``right`` of each exercise. Written out are only the answers that no dress makes of it: other
random numbers, other samples, another way to look for a minimum.
"""

import math
import random
from collections import deque

import numpy as np
from pfslam_book.exercises.ch05 import summary

from pfslam.beyond.localization import kld_bound
from pfslam.correlation import map_correlation
from pfslam.grid import GridSpec, trace_rays
from pfslam.motion import motion_model, motion_model_arc
from pfslam.particles import RESAMPLERS, ControlNoise, Particles, predict


def as_list(answer):
    return np.atleast_1d(answer).tolist()


def as_tuples(answer):
    return tuple(tuple(row) if isinstance(row, list) else row for row in as_list(answer))


def rounded(answer):
    """Five digits, and two behind the point at least."""
    size = np.maximum(np.abs(answer), 1e-9)
    scale = 10.0 ** np.maximum(4 - np.floor(np.log10(size)), 2)
    return np.round(np.asarray(answer) * scale) / scale


def dresses(answer):
    """The ways to give such an answer back."""
    if isinstance(answer, str):
        return [np.str_]
    if isinstance(answer, bool):
        return [int, float, np.bool_, np.array]
    if isinstance(answer, list):  # of arrays, which are to stay the same
        return [tuple, deque]
    return [
        as_list,
        as_tuples,
        lambda numbers: iter(as_list(numbers)),
        lambda numbers: deque(as_list(numbers)),
        np.asarray,
        np.float32,
        rounded,
    ]


def in_float32(part):
    """An argument as somebody has it who computes with fewer digits."""
    is_float = isinstance(part, float) or (isinstance(part, np.ndarray) and part.dtype == float)
    return np.float32(part) if is_float else part


def styles(right, example):
    """A right function in other dress, each beside the example of an answer that it gives."""
    dressed = [lambda *case, dress=dress: dress(right(*case)) for dress in dresses(example)]
    return [*dressed, lambda *case: right(*map(in_float32, case))]


# ---- chapter 01: samples of other stretches at rest, arcs in the place of straight steps


def wheels_along_arcs(counts, metres, track):
    """Headings not brought back to the circle, as a list of poses."""
    poses = [np.array([0.0, 0.0, 2 * np.pi])]
    for FR, FL, RR, RL in counts * metres:
        poses.append(
            motion_model_arc(poses[-1], (FR + FL + RR + RL) / 4, (FR - FL + RR - RL) / 2 / track, 1.0)
        )
    return poses


def small_steps(pose, v, omega, dt):
    headings = pose[2] + omega * dt * np.arange(10_000) / 10_000
    x, y = v * dt * np.array([np.cos(headings), np.sin(headings)]).mean(axis=1)
    return pose + [x, y, omega * dt]


# ---- chapter 03: a cloud from other random numbers


def move_in_a_loop(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    moved = []
    for x, y, theta in poses.tolist():
        a, b = v + rng.normal(0, sigma_v), omega + rng.normal(0, sigma_omega)
        moved.append((x + dt * a * np.cos(theta), y + dt * a * np.sin(theta), theta + dt * b))
    return moved


def move_float32(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    noise = rng.standard_normal((len(poses), 2), dtype=np.float32) * np.float32([sigma_v, sigma_omega])
    return np.float32(motion_model(np.float32(poses), v + noise[:, 0], omega + noise[:, 1], dt))


def move_by_the_standard_library(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    own, moved = random.Random(int(rng.integers(2**31))), []
    for x, y, theta in poses.tolist():
        a, turn = own.gauss(v, sigma_v) * dt, own.gauss(omega, sigma_omega) * dt
        moved.append([x + a * math.cos(theta), y + a * math.sin(theta), (theta + turn) % (2 * math.pi)])
    return moved


def move_by_the_package(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    cloud = Particles(poses, np.zeros(len(poses)))
    return predict(cloud, v, omega, dt, ControlNoise(sigma_v, sigma_omega), rng).poses


MOVES = [move_in_a_loop, move_float32, move_by_the_standard_library, move_by_the_package]


def spread_by_simulation(sigma_omega, rate, seconds):
    drawn = np.random.default_rng(1).normal(0, sigma_omega / rate, (round(rate * seconds), 1000))
    return np.degrees(np.std(drawn.sum(axis=0)))


# ---- chapter 04: tests that use other poses and points


def works_by_complex_numbers(transform):
    pose, points = np.array([3.0, -1.0, 2.1]), np.random.default_rng(1).normal(size=(5, 2))
    moved = complex(*pose[:2]) + np.exp(1j * pose[2]) * (points @ [1, 1j])
    return np.allclose(np.asarray(transform(pose, points)) @ [1, 1j], moved)


def works_in_float32(transform):
    found = np.float32(transform(np.float32([3, 1, 0.7]), np.float32([[2, 1]]))).tolist()[0]
    return all(math.isclose(a, b, rel_tol=1e-4) for a, b in zip(found, [3.8855, 3.0533], strict=True))


# ---- chapter 05: other draws by weight, and headings that are not brought back to the circle


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


def by_the_standard_library(poses, weights, rng):
    own, n = random.Random(int(rng.integers(2**31))), len(weights)
    return own.choices(poses.tolist(), weights.tolist(), k=n), (1 / n,) * n


def by_scheme(scheme):
    return lambda poses, weights, rng: (poses[scheme(weights, rng)], np.full(len(poses), 1 / len(poses)))


RESAMPLED = [resampling_wheel, by_the_standard_library, *map(by_scheme, RESAMPLERS.values())]


def mean_in_a_loop(poses, weights):
    x = y = s = c = 0.0
    for (px, py, theta), w in zip(poses, weights, strict=True):
        x, y, s, c = x + w * px, y + w * py, s + w * np.sin(theta), c + w * np.cos(theta)
    return np.float32([x, y, np.arctan2(s, c) % (2 * np.pi)])


# ---- chapter 07: fewer resamples, drawn otherwise


def difference_in_a_loop(before, after, rng):
    apart = [
        np.median(rng.choice(after, len(after))) - np.median(rng.choice(before, len(before)))
        for _ in range(2000)
    ]
    return [np.median(after) - np.median(before), *np.percentile(apart, [2.5, 97.5])]


def by_building_in_a_loop(before, after, rng):
    change = [np.mean(a) - np.mean(b) for b, a in zip(before, after, strict=True)]
    medians = sorted(float(np.median(rng.choice(change, len(change)))) for _ in range(2000))
    return float(np.median(change)), medians[50], medians[1949]


# ---- chapter 08: another test of a resampler, other searches


def looks_broken(resample):
    poses = np.column_stack([np.arange(5.0), 10.0 + np.arange(5.0), 0.1 * np.arange(5.0)])
    weights, rng, counts = np.array([0.4, 0.3, 0.2, 0.1, 0.0]), np.random.default_rng(3), np.zeros(5)
    for _ in range(400):
        new, new_weights = resample(poses, weights, rng)
        same = (np.asarray(new)[:, None] == poses).all(axis=2)
        if not same.any(axis=1).all() or np.abs(np.asarray(new_weights) - 0.2).max() > 1e-9:
            return True
        counts += same.sum(axis=0)
    return bool((np.abs(counts / 400 - 5 * weights) > 0.2).any())


def in_two_passes(cells):
    best = 0.0
    for step in (0.05, 0.005):
        best = min((best + k * step for k in range(-7, 8)), key=cells)
    return best


# ---- chapters 09 to 13


def draw_lazily(maps, ancestors, hits):
    new = [maps[k] for k in ancestors]
    for k, h in enumerate(hits):
        if h is not None:
            new[k] = new[k].copy()
            new[k][h] += 1
    return new


def count_up(poses, e, z, least):
    n = least
    while n < len(poses):
        k = len({tuple(np.floor(p / [0.5, 0.5, np.deg2rad(10)])) for p in poses[:n]})
        if n >= kld_bound(k, e, 0.5 * math.erfc(z / 2**0.5)):
            break
        n += 1
    return float(min(n, len(poses)))


def jacobian_by_differences(pose, landmark):
    def seen(v):
        c, s = np.cos(v[2]), np.sin(v[2])
        return np.array([[c, s], [-s, c]]) @ (v[3:] - v[:2])

    v, steps = np.concatenate([pose, landmark]), 1e-5 * np.eye(5)
    return np.column_stack([(seen(v + d) - seen(v - d)) / 2e-5 for d in steps])


def unwrapped(readings):
    angle = np.unwrap(readings * (2 * np.pi / 256))
    return np.diff(angle, prepend=angle[0]) * 256 / (2 * np.pi)


OTHERS = {
    "01 check_gyro_bias": [
        lambda t, w, v: [w[len(v) - np.argmax(v[::-1] != 0) :].mean()],  # the last rest
        lambda t, w, v: np.median(w[(v == 0) & (t > t[0] + 4)]),
        lambda t, w, v: np.float32(w)[(np.abs(v) < 0.01) & (t > t[0] + 8)].mean(),
    ],
    "01 check_arc": [small_steps],
    "01 check_reckon_by_wheels": [wheels_along_arcs],
    "02 check_crossed_cells": [trace_rays],
    "03 check_heading_spread": [
        spread_by_simulation,
        lambda s, rate, t: np.array([57.3 * s * (t / rate) ** 0.5]),
    ],
    "04 check_count_on_walls": [lambda p, m, o, r: map_correlation(m, GridSpec(o, r, m.shape), p)],
    "04 check_transform_test": [works_by_complex_numbers, works_in_float32],
    "05 resampled": [
        lambda p, w, seed, style=style: summary(*style(p, w, np.random.default_rng(seed)))
        for style in RESAMPLED
    ],
    "05 check_mean_pose": [mean_in_a_loop],
    "06 check_seen_at": [  # with the numbers as the page prints them
        lambda X, Y, Z: (585.05 * X / Z + 315.84, 585.05 * Y / Z + 242.94, 1089 - 8 * 42.35 / Z)
    ],
    "06 check_blind_ring": [
        lambda h, a, p, r, c, f: round(a + h / math.tan(p + math.atan((r - 0.5 - c) / f)), 3)
    ],
    "07 check_difference": [difference_in_a_loop, lambda *case: (yield from difference_in_a_loop(*case))],
    "07 check_by_building": [by_building_in_a_loop],
    "08 check_looks_broken": [looks_broken],
    "08 check_find_shift": [
        in_two_passes,
        lambda cells: min((cells(s / 100), s / 100) for s in range(-30, 31))[1],
    ],
    "09 check_sub_cell": [lambda *values: np.roots(np.polyder(np.polyfit([-1, 0, 1], values, 2)))[0]],
    "09 check_draw_all": [draw_lazily],
    "10 check_particles_needed": [count_up],
    "12 check_landmark_jacobian": [jacobian_by_differences],
    "13 check_increments": [unwrapped],
}
"""By exercise, the right answers that are not the book's own in other dress."""
