"""Exercises of chapter 01: right answers in many styles, and wrong ones with the words for each."""

import cmath
import math

import numpy as np
import pytest
from notebook_cells import check_nonsense_is_named

from pfslam.motion import motion_model, motion_model_arc
from pfslam.teaching.ch01 import check_arc, check_dead_reckon, check_gyro_bias, check_path_length

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


def bias_in_a_loop(t, yaw_rate, speed):
    kept = [w for s, w, v in zip(t, yaw_rate, speed, strict=True) if v < 0.01 and s - t[0] > 2.5]
    return sum(kept) / len(kept)


def bias_of_the_last_rest(t, yaw_rate, speed):
    first = len(speed) - np.argmax(speed[::-1] > 0)
    return [yaw_rate[first:].mean()]


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
        (check_gyro_bias, bias_in_a_loop),
        (check_gyro_bias, bias_of_the_last_rest),
        (check_gyro_bias, lambda t, w, v: np.median(w[(v == 0) & (t > t[0] + 4)])),
        (check_gyro_bias, lambda t, w, v: np.float32(w)[(v == 0) & (t > t[0] + 8)].mean()),
        (check_arc, motion_model_arc),
        (check_arc, arc_complex),
        (check_arc, arc_by_radius),
        (check_arc, lambda *a: np.round(motion_model_arc(*a), 4)),
        (check_arc, lambda *a: motion_model_arc(*a).astype(np.float32)),
        (check_dead_reckon, reckon_vectorised),
        (check_dead_reckon, reckon_along_arcs),
        (check_dead_reckon, reckon_half_way),
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
        (check_arc, motion_model, "straight step"),
        (check_arc, chord(np.sinc, 0.5), "by pi"),
        (check_arc, chord(lambda half: 1.0, 0.5), "chord is shorter"),
        (check_arc, chord(lambda half: np.sinc(half / np.pi), 0.0), "half way"),
        (check_arc, chord(lambda half: np.sinc(half / np.pi), 1.0), "half way"),
        (check_arc, chord(lambda half: np.sin(half) / half, 0.5), "divide by zero"),
        (check_arc, by_radius, "divide by zero"),
        (check_arc, without_sign, "right bends are not"),
        (check_arc, many_steps, "formula that needs"),
        (check_arc, simpson, "returns"),
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
        (check_dead_reckon, lambda *a: reckon()(*a) * [1, 1, 57.29578], "degrees"),
    ],
)  # fmt: skip
def test_a_wrong_answer_is_named(check, wrong, words):
    verdict = check(wrong)
    assert not verdict
    assert words in verdict.message
