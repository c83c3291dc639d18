"""Right answers to the exercises of chapter 03, in the ways that people write them: each must pass its check."""

import math
import random
from collections import deque
from fractions import Fraction

import numpy as np

from pfslam.motion import motion_model
from pfslam.particles import ControlNoise, Particles, predict


def spread_by_variances(sigma_omega, rate, seconds):
    variance = sum((sigma_omega / rate) ** 2 for _ in range(round(rate * seconds * 1000))) / 1000
    return [57.3 * variance**0.5]


def spread_by_simulation(sigma_omega, rate, seconds):
    rng = np.random.default_rng(1)
    headings = np.zeros(1000)
    for _ in range(round(rate * seconds)):
        headings += rng.normal(0, sigma_omega, 1000) / rate
    return np.degrees(np.std(headings))


def move_in_a_loop(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    moved = []
    for x, y, theta in poses.tolist():
        a, b = v + rng.normal(0, sigma_v), omega + rng.normal(0, sigma_omega)
        moved.append((x + dt * a * np.cos(theta), y + dt * a * np.sin(theta), theta + dt * b))
    return moved


def move_float32(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    noise = rng.standard_normal((len(poses), 2), dtype=np.float32) * np.float32([sigma_v, sigma_omega])
    poses = poses.astype(np.float32)
    return motion_model(poses, (v + noise[:, 0]), (omega + noise[:, 1]), dt).astype(np.float32)


def move_by_matrices(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    moved = deque()
    for x, y, theta in poses:
        a, b = v + sigma_v * rng.standard_normal(), omega + sigma_omega * rng.standard_normal()
        c, s = np.cos(theta), np.sin(theta)
        place = np.array([[c, -s, x], [s, c, y], [0, 0, 1]]) @ [a * dt, 0, 1]
        moved.append([*place[:2], theta + b * dt])
    return moved


def move_by_the_standard_library(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    own, moved = random.Random(int(rng.integers(2**31))), []
    for x, y, theta in poses.tolist():
        a, turn = own.gauss(v, sigma_v) * dt, own.gauss(omega, sigma_omega) * dt
        turned = (theta + turn) % (2 * math.pi)
        moved.append([x + a * math.cos(theta), y + a * math.sin(theta), turned])
    return moved


def move_with_a_covariance(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    u = rng.multivariate_normal([v, omega], np.diag([sigma_v**2, sigma_omega**2]), len(poses))
    return np.round(motion_model(poses, u[:, 0], u[:, 1], dt), 5)


def move_by_the_package(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    cloud = Particles(poses, np.zeros(len(poses)))
    return predict(cloud, v, omega, dt, ControlNoise(sigma_v, sigma_omega), rng).poses


def seeded(move):
    """As the data has it: a seed in the place of the generator."""
    return lambda *arguments: move(*arguments[:-1], np.random.default_rng(arguments[-1]))


def track_by_logarithms(belief, looks, step):
    logs = np.log(belief) + np.log(looks[0])
    for look in looks[1:]:
        moved = [math.log(p) + np.roll(logs, cells) for cells, p in step.items()]
        logs = np.logaddexp.reduce(moved) + np.log(look)
    return np.exp(logs - np.logaddexp.reduce(logs))


def track_in_fractions(belief, looks, step):
    belief, n = [Fraction(float(b)) for b in belief], len(belief)
    for k, look in enumerate(looks):
        if k:
            belief = [sum(Fraction(p) * belief[i - cells] for cells, p in step.items()) for i in range(n)]
        belief = [b * Fraction(float(seen)) for b, seen in zip(belief, look, strict=True)]
    return deque(float(b / sum(belief)) for b in belief)


def track_in_loops(belief, looks, step):
    belief = list(belief)
    for k, look in enumerate(looks):
        if k:
            moved = [0.0] * len(belief)
            for i, p in enumerate(belief):
                for cells, chance in step.items():
                    moved[(i + cells) % len(belief)] += p * chance
            belief = moved
        belief = [a * b for a, b in zip(belief, look, strict=True)]
        belief = [b / sum(belief) for b in belief]
    return tuple(belief)


def track_by_matrix(belief, looks, step):
    move = sum(p * np.roll(np.eye(len(belief)), cells, axis=0) for cells, p in step.items())
    for k, look in enumerate(looks):
        belief = np.float32(look * (move @ belief if k else belief))
    return belief / belief.sum()


MOVES = [
    move_in_a_loop,
    move_float32,
    move_by_matrices,
    move_by_the_standard_library,
    move_with_a_covariance,
    move_by_the_package,
]

STYLES = {
    "check_track": [
        track_by_logarithms,
        track_in_fractions,
        track_in_loops,
        track_by_matrix,
    ],
    "moved": [seeded(move) for move in MOVES],
    "check_heading_spread": [
        spread_by_variances,
        spread_by_simulation,
        lambda s, rate, t: round(float(np.rad2deg(s * (t / rate) ** 0.5)), 4),
        lambda s, rate, t: np.float32(s * 180 / np.pi) * np.sqrt(t / rate),
        lambda s, rate, t: np.array([57.3 * s * (t / rate) ** 0.5]),
        lambda s, rate, t: math.degrees(s * math.sqrt(t / rate)),
        lambda s, rate, t: deque([math.degrees(s) * math.hypot((t / rate) ** 0.5)]),
    ],
}
