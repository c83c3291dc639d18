"""Exercises of chapter 01: right answers in many styles, and wrong ones with the words for each."""

import cmath
import functools
import itertools
import math
import statistics
from array import array
from collections import deque

import numpy as np
import pytest
from notebook_cells import check_nonsense_is_named
from pfslam_book.ch01 import check_arc, check_dead_reckon, check_gyro_bias, check_path_length

from pfslam.motion import motion_model, motion_model_arc

EXERCISES = [
    (check_path_length, "path_length"),
    (check_gyro_bias, "gyro_bias"),
    (check_arc, "arc_step"),
    (check_dead_reckon, "dead_reckon"),
]


@pytest.mark.parametrize(("check", "name"), EXERCISES)
def test_nonsense_is_named_and_never_raises(check, name):
    check_nonsense_is_named(check, -7.0, 3)


# ---- right answers: loops, lists, tuples, float32, four digits, complex numbers, other ways to compute


def length_in_a_loop(counts, metres_per_count):
    total = 0
    for row in counts.tolist():
        for count in row:
            total += count
    return total / 4 * metres_per_count


def length_complex(counts, metres_per_count):
    sides = counts[:, 1::2].sum() + 1j * counts[:, ::2].sum()
    return (sides.real + sides.imag) / 4 * metres_per_count


def bias_in_a_loop(t, yaw_rate, speed):
    kept = [w for s, w, v in zip(t, yaw_rate, speed, strict=True) if v < 0.01 and s - t[0] > 2.5]
    return sum(kept) / len(kept)


def bias_of_the_last_rest(t, yaw_rate, speed):
    first = len(speed) - np.argmax(speed[::-1] > 0)
    return [yaw_rate[first:].mean()]


def bias_with_statistics(t, yaw_rate, speed):
    return statistics.fmean(w for s, w, v in zip(t, yaw_rate, speed, strict=True) if v == 0 and s > t[0] + 3)


def bias_complex(t, yaw_rate, speed):
    z = (yaw_rate * 1j)[(speed < 1e-3) & (t >= t[0] + 3)]
    return z.mean().imag


def bias_of_a_masked_array(t, yaw_rate, speed):
    return np.ma.masked_where((speed > 0) | (t < t[0] + 2.5), yaw_rate).mean()


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


def steps_of(t_enc, counts, t_gyro, metres):
    return np.diff(np.interp(t_gyro, t_enc, np.cumsum(counts.mean(axis=1)) * metres))


def reckon_vectorised(t_enc, counts, t_gyro, yaw_rate, metres):
    step, turn = steps_of(t_enc, counts, t_gyro, metres), yaw_rate[1:] * np.diff(t_gyro)
    theta = np.concatenate([[0], np.cumsum(turn)])
    xy = np.cumsum(step * np.exp(1j * theta[:-1]))
    return np.column_stack([np.append(0, xy.real), np.append(0, xy.imag), theta])


def reckon_along_arcs(t_enc, counts, t_gyro, yaw_rate, metres):
    poses, dt = [np.zeros(3)], np.diff(t_gyro)
    for s, w, tau in zip(steps_of(t_enc, counts, t_gyro, metres), yaw_rate[1:], dt, strict=True):
        poses.append(motion_model_arc(poses[-1], s / tau, w, tau))
    return poses


def reckon_with_reduce(t_enc, counts, t_gyro, yaw_rate, metres):
    def step(path, move):
        x, y, theta = path[-1]
        s, turn = move
        return [*path, array("d", [x + s * math.cos(theta), y + s * math.sin(theta), theta + turn])]

    moves = zip(steps_of(t_enc, counts, t_gyro, metres), yaw_rate[1:] * np.diff(t_gyro), strict=True)
    return functools.reduce(step, moves, [array("d", [0, 0, 0])])


def reckon_half_way(t_enc, counts, t_gyro, yaw_rate, metres):
    x = y = theta = 0.0
    path = [(x, y, theta)]
    for s, turn in zip(steps_of(t_enc, counts, t_gyro, metres), yaw_rate[1:] * np.diff(t_gyro), strict=True):
        x, y = x + s * math.cos(theta + turn / 2), y + s * math.sin(theta + turn / 2)
        theta += turn
        path.append((x, y, theta))
    return path


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (check_path_length, length_in_a_loop),
        (check_path_length, lambda c, m: np.float32(np.float32(c).mean() * len(c) * np.float32(m))),
        (check_path_length, lambda c, m: [round(float(c.sum() / 4 * m), 5)]),
        (check_path_length, lambda c, m: np.cumsum(c.mean(axis=1) * m)[-1]),
        (check_path_length, length_complex),
        (check_path_length, lambda c, m: np.full((1, len(c)), m) @ c @ np.full((4, 1), 0.25)),
        (check_gyro_bias, bias_in_a_loop),
        (check_gyro_bias, bias_of_the_last_rest),
        (check_gyro_bias, bias_with_statistics),
        (check_gyro_bias, bias_complex),
        (check_gyro_bias, bias_of_a_masked_array),
        (check_gyro_bias, lambda t, w, v: np.median(w[(v == 0) & (t > t[0] + 4)])),
        (check_gyro_bias, lambda t, w, v: np.float32(w)[(v == 0) & (t > t[0] + 8)].mean()),
        (check_arc, motion_model_arc),
        (check_arc, arc_complex),
        (check_arc, arc_by_radius),
        (check_arc, arc_by_series),
        (check_arc, lambda *a: np.round(motion_model_arc(*a), 4)),
        (check_arc, lambda *a: motion_model_arc(*a).astype(np.float32)),
        (check_dead_reckon, reckon_vectorised),
        (check_dead_reckon, reckon_along_arcs),
        (check_dead_reckon, reckon_half_way),
        (check_dead_reckon, reckon_with_reduce),
        (check_dead_reckon, lambda *a: np.float32(reckon_vectorised(*a))),
        (check_dead_reckon, lambda *a: np.round(reckon_vectorised(*a), 4).tolist()),
    ],
)
def test_the_same_in_another_style_is_right_too(check, answer):
    assert check(answer), check(answer)


# ---- wrong answers


def chord(length, part):
    """A step by ``length(half) v dt``, in the old heading plus ``part`` of the turn."""

    def step(pose, v, omega, dt):
        half = 0.5 * omega * dt
        way, angle = v * dt * length(half), pose[2] + 2 * part * half
        return np.array([pose[0] + way * np.cos(angle), pose[1] + way * np.sin(angle), pose[2] + 2 * half])

    return step


def by_radius(pose, v, omega, dt, radius=lambda v, omega: v / omega):
    r, end = radius(v, omega), pose[2] + omega * dt
    return pose + [r * (np.sin(end) - np.sin(pose[2])), r * (np.cos(pose[2]) - np.cos(end)), omega * dt]


def without_sign(pose, v, omega, dt):
    if omega == 0:
        return motion_model(pose, v, omega, dt)
    return by_radius(pose, v, omega, dt, lambda v, omega: v / abs(omega))


def straight_in_gentle_bends(pose, v, omega, dt):
    return (motion_model if abs(omega) < 0.1 else by_radius)(pose, v, omega, dt)


def many_steps(pose, v, omega, dt, n=500):
    for _ in range(n):
        pose = motion_model(pose, v, omega, dt / n)
    return pose


def simpson(pose, v, omega, dt):
    angles = pose[2] + omega * dt * np.array([0, 0.5, 1])
    weights = v * dt / 6 * np.array([1, 4, 1])
    return np.array([pose[0] + weights @ np.cos(angles), pose[1] + weights @ np.sin(angles), angles[2]])


def into_the_pose(pose, v, omega, dt):
    pose += [v * dt * np.cos(pose[2]), v * dt * np.sin(pose[2]), omega * dt]
    return pose


def only_in_bends(straight):
    """The exact step in bends, and another one straight on."""
    return lambda p, v, w, dt: motion_model_arc(p, v, w, dt) if w else p + v * dt * np.array(straight)


def warm(t, v):
    return (v == 0) & (t > t[0] + 3)


def reckon(step=None, turn=None, by=None):
    """A path with other steps (m), turns (rad) or arguments."""

    def dead_reckon(t_enc, counts, t_gyro, yaw_rate, metres):
        if by:
            t_enc, counts, t_gyro, yaw_rate, metres = by(t_enc, counts, t_gyro, yaw_rate, metres)
        steps = steps_of(t_enc, counts, t_gyro, metres)
        turns = yaw_rate[1:] * np.diff(t_gyro)
        if step:
            steps = step(t_enc, counts, t_gyro, metres)
        if turn:
            turns = turn(yaw_rate, np.diff(t_gyro))
        theta = np.concatenate([[0], np.cumsum(turns)])
        xy = np.cumsum(steps * np.exp(1j * theta[:-1]))
        return np.column_stack([np.append(0, xy.real), np.append(0, xy.imag), theta])

    return dead_reckon


def read_off(which):
    """Steps from the sum, read off at one of the readings."""

    def steps(t_enc, counts, t_gyro, metres):
        return np.diff((np.cumsum(counts.mean(axis=1)) * metres)[which(t_enc, t_gyro)])

    return steps


def some_wheels(wheels):
    return reckon(by=lambda te, c, tg, w, m: (te, c[:, wheels], tg, w, m))


def turn_first(*case):
    ahead = reckon()(*case)
    step = steps_of(*case[:3], case[4]) * np.exp(1j * ahead[1:, 2])
    ahead[1:, 0], ahead[1:, 1] = np.cumsum(step).real, np.cumsum(step).imag
    return ahead


def from_zero(t_enc, counts, t_gyro, yaw_rate, metres):
    t_gyro -= t_enc[0]
    return reckon()(t_enc - t_enc[0], counts, t_gyro, yaw_rate, metres)


def own_interval(t_enc, counts, t_gyro, metres):
    speed = counts.mean(axis=1)[1:] * metres / np.diff(t_enc)
    near = np.abs(t_gyro[1:, None] - t_enc[None, 1:]).argmin(axis=1)
    return speed[near] * np.diff(t_gyro)


def as_printed(t_enc, counts, t_gyro, metres):
    near = np.abs(t_gyro[1:, None] - t_enc[None]).argmin(axis=1)
    return (counts.mean(axis=1) * metres)[near] * np.diff(t_gyro)


@pytest.mark.parametrize(
    ("check", "wrong", "words"),
    [
        (check_path_length, lambda c, m: c.sum() * m, "added the wheels"),
        (check_path_length, lambda c, m: np.diff(c, axis=0).mean(axis=1).sum() * m, "increment since"),
        (check_path_length, lambda c, m: c[-1].mean() * m, "running total"),
        (check_path_length, lambda c, m: c.mean(axis=1).sum(), "in counts"),
        (check_path_length, lambda c, m: c.mean() * m, "mean over the readings"),
        (check_path_length, lambda c, m: c[1:].mean(axis=1).sum() * m, "first reading"),
        (check_path_length, lambda c, m: c[:, :2].mean(axis=1).sum() * m, "front wheels only"),
        (check_path_length, lambda c, m: c[:, [0, 3]].mean(axis=1).sum() * m, "two wheels only"),
        (check_path_length, lambda c, m: np.median(c, axis=1).sum() * m, "median"),
        (check_path_length, lambda c, m: ((c.max(axis=1) + c.min(axis=1)) / 2).sum() * m, "slowest"),
        (check_path_length, lambda c, m: (c.sum(axis=1) // 4).sum() * m, "drops the rest"),
        (check_path_length, lambda c, m: 1 / 0, "ZeroDivisionError"),
        (check_path_length, lambda c, m: c[:, 1::2].mean(axis=1).sum() * m, "two wheels only"),
        (check_path_length, lambda c, m: c[:, 3].sum() * m, "one wheel only"),
        (check_path_length, lambda c, m: c[:-1].mean(axis=1).sum() * m, "last reading"),
        (check_path_length, lambda c, m: c.sum() / 4 * 0.0022, "whatever you are given"),
        (check_path_length, lambda c, m: c.sum() / 4 / m, "divide by metres_per_count"),
        (check_path_length, lambda c, m: np.rint(c.mean(axis=1)).sum() * m, "round"),
        (check_path_length, lambda c, m: c.sum() / 4 * m * 1000, "a thousand times too large"),
        (check_path_length, lambda c, m: c.mean(axis=1) * m, "One number"),
        (check_gyro_bias, lambda t, w, v: w.mean(), "whole drive"),
        (check_gyro_bias, lambda t, w, v: w[t < t[0] + 1].mean(), "first second"),
        (check_gyro_bias, lambda t, w, v: w[v == 0].mean(), "Leave them out"),
        (check_gyro_bias, lambda t, w, v: -w[warm(t, v)].mean(), "sign"),
        (check_gyro_bias, lambda t, w, v: w.min(), "least single reading"),
        (check_gyro_bias, lambda t, w, v: w[-1], "last single reading"),
        (check_gyro_bias, lambda t, w, v: w[v > 0].mean(), "while the robot drives"),
        (check_gyro_bias, lambda t, w, v: np.abs(w[warm(t, v)]).mean(), "absolute values"),
        (check_gyro_bias, lambda t, w, v: np.rad2deg(w[warm(t, v)].mean()), "in degrees"),
        (check_gyro_bias, lambda t, w, v: 0.0, "returns 0"),
        (check_gyro_bias, lambda t, w, v: w[(v == 0) & (t > t[0] + 1)].mean(), "two or three"),
        (check_gyro_bias, lambda t, w, v: w[(v == 0) & (t > 3)].mean(), "Leave them out"),
        (check_gyro_bias, lambda t, w, v: np.median(w[v == 0]), "in your median"),
        (check_gyro_bias, lambda t, w, v: w[t < t[0] + 15].mean(), "first rest"),
        (check_gyro_bias, lambda t, w, v: np.deg2rad(w[warm(t, v)].mean()), "nothing to convert"),
        (check_gyro_bias, lambda t, w, v: np.sqrt(np.mean(w[warm(t, v)] ** 2)), "root of the mean square"),
        (check_gyro_bias, lambda t, w, v: w.max(), "greatest single reading"),
        (check_gyro_bias, lambda t, w, v: w[warm(t, v)].sum(), "is the sum"),
        (check_gyro_bias, lambda t, w, v: w - w[warm(t, v)].mean(), "One number"),
        (check_arc, motion_model, "straight step"),
        (check_arc, chord(np.sinc, 0.5), "by pi"),
        (check_arc, chord(lambda half: 1.0, 0.5), "chord is shorter"),
        (check_arc, chord(lambda half: np.sinc(half / np.pi), 0.0), "half way"),
        (check_arc, chord(lambda half: np.sinc(half / np.pi), 1.0), "half way"),
        (check_arc, chord(lambda half: np.sin(half) / half, 0.5), "divide by zero"),
        (check_arc, by_radius, "divide by zero"),
        (check_arc, without_sign, "right bends are not"),
        (check_arc, straight_in_gentle_bends, "gentle one"),
        (check_arc, many_steps, "formula that needs"),
        (check_arc, simpson, "returns"),
        (check_arc, only_in_bends([1, 0, 0]), "drives along x"),
        (check_arc, only_in_bends([0, 0, 0]), "stays where it is"),
        (check_arc, lambda *a: np.nan_to_num(by_radius(a[0], np.float64(a[1]), *a[2:])), "divide by zero"),
        (check_arc, chord(lambda half: np.sinc(2 * half / np.pi), 0.5), "half the turn"),
        (check_arc, chord(lambda half: np.tan(half) / half if half else 1, 0.5), "tangent"),
        (check_arc, lambda p, v, w, dt: motion_model_arc(p, v, -w, dt), "wrong way"),
        (check_arc, lambda p, v, w, dt: motion_model_arc(p, abs(v), w, dt), "backwards"),
        (check_arc, lambda *a: motion_model_arc(*a) - a[0], "the change of the pose"),
        (check_arc, lambda p, v, w, dt: motion_model_arc(p, v, w, 1), "one second"),
        (check_arc, lambda *a: a[0] + (motion_model_arc(*a) - a[0])[[1, 0, 2]], "Sine and cosine"),
        (check_arc, lambda *a: motion_model_arc(*a) * [1, 1, 57.29578], "in degrees"),
        (check_arc, lambda p, v, w, dt: motion_model_arc(p, v, w / 57.3, dt), "nothing to convert"),
        (check_arc, into_the_pose, "changes what it is given"),
        (check_arc, lambda pose, v, omega, dt: pose[:2], "shape (2,)"),
        (check_arc, lambda p, v, w, dt: np.append(motion_model_arc(p, v, w, dt)[:2], p[2]), "did not change"),
        (check_dead_reckon, reckon(step=own_interval), "own interval"),
        (check_dead_reckon, reckon(step=as_printed), "Eq. 19 as a speed"),
        (check_dead_reckon, reckon(turn=lambda w, dt: w[:-1] * dt), "one interval too late"),
        (check_dead_reckon, reckon(turn=lambda w, dt: w[1:] * 0.01), "10 ms"),
        (check_dead_reckon, reckon(turn=lambda w, dt: -w[1:] * dt), "wrong way"),
        (check_dead_reckon, reckon(turn=lambda w, dt: 0 * dt), "never turns"),
        (check_dead_reckon, reckon(by=lambda te, c, tg, w, m: (te, 4 * c, tg, w, m)), "Four times"),
        (check_dead_reckon, reckon(by=lambda te, c, tg, w, m: (te, c, tg, w, 1.0)), "in counts"),
        (check_dead_reckon, reckon(by=lambda te, c, tg, w, m: (te, c, tg, np.rad2deg(w), m)), "nothing to convert"),
        (check_dead_reckon, lambda *a: reckon()(*a)[1:], "shape"),
        (check_dead_reckon, some_wheels([0, 1]), "some of the wheels"),
        (check_dead_reckon, some_wheels([3]), "some of the wheels"),
        (check_dead_reckon, reckon(step=read_off(lambda te, tg: abs(te - tg[:, None]).argmin(axis=1))), "interpolate"),
        (check_dead_reckon, reckon(step=read_off(lambda te, tg: np.searchsorted(te, tg) - 1)), "interpolate"),
        (check_dead_reckon, reckon(step=lambda *a: steps_of(*a) / np.diff(a[2])), "a distance must not"),
        (check_dead_reckon, reckon(turn=lambda w, dt: w[1:]), "as if they were angles"),
        (check_dead_reckon, reckon(turn=lambda w, dt: (w[1:] + w[:-1]) / 2 * dt), "mean of two rates"),
        (check_dead_reckon, turn_first, "turn before you drive"),
        (check_dead_reckon, lambda *a: reckon()(*a) * [1, -1, 1], "y has the wrong sign"),
        (check_dead_reckon, lambda *a: reckon()(*a)[:, [1, 0, 2]], "changed places"),
        (check_dead_reckon, lambda *a: reckon()(*a)[:, [2, 0, 1]], "in this order"),
        (check_dead_reckon, from_zero, "changes what it is given"),
        (check_dead_reckon, lambda *a: reckon()(*a) * [1, 1, 57.29578], "degrees"),
    ],
)  # fmt: skip
def test_a_wrong_answer_is_named(check, wrong, words):
    verdict = check(wrong)
    assert not verdict
    assert words in verdict.message
