"""Exercises of chapter 09: stub, solution, right answers in many styles, and the words for each wrong one."""

import math

import numpy as np
import pytest
from pfslam_book import ch09
from pfslam_book.ch09.judging import best_fit_rmse

from pfslam.poses import Trajectory

# ---- right answers


def top_of_polyfit(left, middle, right):
    a, b, _ = np.polyfit([-1, 0, 1], [left, middle, right], 2)
    return -b / (2 * a)


SUB_CELL = [
    top_of_polyfit,
    lambda a, b, c: np.float32((a - c) / (a - 2 * b + c) / 2),
    lambda a, b, c: round((a - c) / (2 * (a - 2 * b + c)), 4),
    lambda a, b, c: np.array([(a - c) / (2 * (a - 2 * b + c))]),
    lambda a, b, c: -((c - a) / 2) / ((c - b) - (b - a)),
    lambda a, b, c: np.roots(np.polyder(np.polyfit([-1, 0, 1], [a, b, c], 2)))[0],
]


def by_complex_numbers(poses, true_poses):
    z, w = poses[:, 0] + 1j * poses[:, 1], true_poses[:, 0] + 1j * true_poses[:, 1]
    away = (z - z[0]) * np.exp(1j * (true_poses[0, 2] - poses[0, 2])) - (w - w[0])
    return np.sqrt(np.mean(np.abs(away) ** 2))


def by_a_loop(poses, true_poses):
    turn, total = true_poses[0][2] - poses[0][2], 0.0
    for p, q in zip(poses, true_poses, strict=True):
        dx, dy = p[0] - poses[0][0], p[1] - poses[0][1]
        x = true_poses[0][0] + math.cos(turn) * dx - math.sin(turn) * dy
        y = true_poses[0][1] + math.sin(turn) * dx + math.cos(turn) * dy
        total += (x - q[0]) ** 2 + (y - q[1]) ** 2
    return math.sqrt(total / len(poses))


def by_matrices(poses, true_poses):
    def matrix(pose):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])

    moved = matrix(true_poses[0]) @ np.linalg.inv(matrix(poses[0]))
    points = np.column_stack([poses[:, :2], np.ones(len(poses))]) @ moved.T
    return np.linalg.norm(points[:, :2] - true_poses[:, :2]) / np.sqrt(len(poses))


FIRST_POSE = [
    by_complex_numbers,
    by_a_loop,
    by_matrices,
    lambda p, q: np.float32(by_complex_numbers(p, q)),
    lambda p, q: [by_complex_numbers(p, q)],
    lambda p, q: float(f"{by_complex_numbers(p, q):.4g}"),
]


def by_lstsq(arms, position, centres, normals):
    residual = np.einsum("ij,ij->i", normals, arms + position - centres)
    turning = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
    return np.linalg.lstsq(np.column_stack([normals, turning]), -residual, rcond=None)[0]


def by_complex_lines(arms, position, centres, normals):
    a, d, n = (v @ [1, 1j] for v in (arms, arms + position - centres, normals))
    columns = np.column_stack([n.real, n.imag, (n.conj() * 1j * a).real])
    return np.linalg.lstsq(columns, -(n.conj() * d).real, rcond=None)[0]


def by_sums(arms, position, centres, normals):
    H, g = np.zeros((3, 3)), np.zeros(3)
    for a, c, n in zip(arms, centres, normals, strict=True):
        J = np.array([n[0], n[1], n[1] * a[0] - n[0] * a[1]])
        H += np.outer(J, J)
        g += J * (n @ (position + a - c))
    return np.linalg.solve(H, -g)


LINE_STEP = [
    by_lstsq,
    by_complex_lines,
    by_sums,
    lambda *case: by_sums(*case).tolist(),
    lambda *case: tuple(by_lstsq(*case)),
    lambda *case: by_lstsq(*case).astype(np.float32),
    lambda *case: np.round(by_lstsq(*case), 6),
    lambda a, p, c, n: (
        -np.linalg.pinv(np.column_stack([n, n[:, 1] * a[:, 0] - n[:, 0] * a[:, 1]]))
        @ ((a + p - c) * n).sum(axis=1)
    ),
]


def by_steps(occupied, cells):
    found = False
    for ix, iy in cells.tolist()[:-3]:
        found |= bool(occupied[iy][ix])
    return found


BLOCKED = [
    by_steps,
    lambda o, c: any(o[iy, ix] for ix, iy in c[: len(c) - 3]),
    lambda o, c: o[tuple(c[:-3].T[::-1])].any(),
    lambda o, c: int(o[c[:-3, 1], c[:-3, 0]].sum() > 0),
    lambda o, c: np.array(o.T[c[:-3, 0], c[:-3, 1]].max()),
    lambda o, c: bool(np.count_nonzero([o[iy, ix] for ix, iy in c[:-3]])),
]
RIGHT = {"sub_cell": SUB_CELL, "first_pose_error": FIRST_POSE, "line_step": LINE_STEP, "blocked": BLOCKED}


@pytest.mark.parametrize(
    ("name", "style"), [(n, k) for n, styles in RIGHT.items() for k in range(len(styles))]
)
def test_a_right_answer_passes_in_any_style(name, style):
    verdict = getattr(ch09, f"check_{name}")(RIGHT[name][style])
    assert verdict, verdict.message


# ---- wrong answers, and a part of the words that name each


def away(poses, true_poses, sign=1.0):
    turn = sign * (true_poses[0, 2] - poses[0, 2])
    c, s = np.cos(turn), np.sin(turn)
    return (poses[:, :2] - poses[0, :2]) @ np.array([[c, s], [-s, c]]) + true_poses[0, :2] - true_poses[:, :2]


def rms(errors):
    return np.sqrt((errors**2).sum(axis=1).mean())


def trajectories(poses, true_poses):
    t = np.arange(len(poses), dtype=float)
    return Trajectory(t, poses), Trajectory(t, true_poses)


def wrong_line_step(turning=None, residual=None, keep=3):
    def step(arms, position, centres, normals):
        r = (
            (normals * (arms + position - centres)).sum(axis=1)
            if residual is None
            else residual(arms, position, centres, normals)
        )
        own = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
        third = own if turning is None else turning(arms, position, normals)
        found = -np.linalg.lstsq(np.column_stack([normals, third])[:, :keep], r, rcond=None)[0]
        return np.append(found, np.zeros(3 - keep))

    return step


def gradient(arms, position, centres, normals):
    turning = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
    return -np.column_stack([normals, turning]).T @ (normals * (arms + position - centres)).sum(axis=1)


def any_of(first, last):
    return lambda o, c: bool(o[c[first:last, 1], c[first:last, 0]].any())


WRONG = {
    "sub_cell": {
        "lost the sign": lambda a, b, c: abs(top_of_polyfit(a, b, c)),
        "Upside down": lambda a, b, c: 1 / top_of_polyfit(a, b, c),
        "at a quarter": lambda a, b, c: np.clip(top_of_polyfit(a, b, c), -0.25, 0.25),
        "Twice": lambda a, b, c: (a - c) / (a - 2 * b + c),
        "sign": lambda a, b, c: (c - a) / (a - 2 * b + c) / 2,
        "between": lambda a, b, c: np.argmax([a, b, c]) - 1,
        "centre of mass": lambda a, b, c: (c - a) / (a + b + c),
        "height": lambda a, b, c: np.polyval(np.polyfit([-1, 0, 1], [a, b, c], 2), top_of_polyfit(a, b, c)),
        "slope": lambda a, b, c: (c - a) / 2,
        "left value": lambda a, b, c: 1 + top_of_polyfit(a, b, c),
        "returns nothing": lambda a, b, c: None,
    },
    "first_pose_error": {
        "last pose": lambda p, q: rms(away(p[::-1], q[::-1])),
        "error at the end": lambda p, q: np.hypot(*away(p, q)[-1]),
        "first pose out": lambda p, q: rms(away(p, q)[1:]),
        "x alone": lambda p, q: np.sqrt((away(p, q)[:, 0] ** 2).mean()),
        "standard deviation": lambda p, q: np.sqrt(away(p, q).var(axis=0).sum()),
        "into degrees": lambda p, q: rms(away(p, q, 180 / np.pi)),
        "absorbs the heading": lambda p, q: best_fit_rmse(*trajectories(p, q)),
        "must be turned": lambda p, q: rms(away(p, q, 0.0)),
        "wrong way": lambda p, q: rms(away(p, q, -1.0)),
        "half of a best fit": lambda p, q: rms(away(p, q, 0.0) - away(p, q, 0.0).mean(axis=0)),
        "frame of its own": lambda p, q: rms((p - q)[:, :2]),
        "mean distance": lambda p, q: np.hypot(*away(p, q).T).mean(),
        "Take the root": lambda p, q: (away(p, q) ** 2).sum(axis=1).mean(),
        "over coordinates": lambda p, q: np.sqrt((away(p, q) ** 2).mean()),
        "largest": lambda p, q: np.hypot(*away(p, q).T).max(),
        "millimetres": lambda p, q: 1000 * rms(away(p, q)),
        "One number": lambda p, q: p,
    },
    "line_step": {
        "along the walls": lambda a, p, c, n: by_lstsq(a, p, c, np.column_stack([n[:, 1], -n[:, 0]])),
        "lost the signs": wrong_line_step(residual=lambda a, p, c, n: abs((n * (a + p - c)).sum(axis=1))),
        "gradient": gradient,
        "in degrees": lambda *case: by_lstsq(*case) * (1, 1, 180 / np.pi),
        "comes last": lambda *case: by_lstsq(*case)[[2, 0, 1]],
        "lacks the arms": wrong_line_step(lambda a, p, n: n[:, 1] - n[:, 0]),
        "sign of the last": wrong_line_step(lambda a, p, n: n[:, 0] * a[:, 1] - n[:, 1] * a[:, 0]),
        "right angle": wrong_line_step(lambda a, p, n: (n * a).sum(axis=1)),
        "origin of the world": wrong_line_step(
            lambda a, p, n: n[:, 1] * (a + p)[:, 0] - n[:, 0] * (a + p)[:, 1]
        ),
        "contains the position": wrong_line_step(residual=lambda a, p, c, n: (n * (a - c)).sum(axis=1)),
        "never changes": wrong_line_step(keep=2),
        "but for their sign": lambda *case: -by_lstsq(*case),
        "step alone": lambda a, p, c, n: np.append(p, 0) + by_lstsq(a, p, c, n),
        "shape": lambda *case: by_lstsq(*case)[:2],
        "changes what it is given": lambda a, p, c, n: [a.sort(axis=0), by_lstsq(a, p, c, n)][1],
    },
    "blocked": {
        "too many cells": any_of(None, -5),
        "first cells": any_of(3, -3),
        "every second": lambda o, c: bool(o[c[:-3:2, 1], c[:-3:2, 0]].any()),
        "two cells": lambda o, c: o[c[:-3, 1], c[:-3, 0]].sum() > 1,
        "count the cells": lambda o, c: o[c[:-3, 1], c[:-3, 0]].sum(),
        "one truth value": lambda o, c: o[c[:-3, 1], c[:-3, 0]],
        "every beam is blocked": lambda o, c: True,
        "whether any cell on the way is free": lambda o, c: not o[c[:-3, 1], c[:-3, 0]].all(),
        "Leave the end": any_of(None, None),
        "two* cells": any_of(None, -1),
        "one cell before": any_of(None, -2),
        "too many": any_of(None, -4),
        "first cell": any_of(1, -3),
        "only near the end": any_of(-6, -3),
        "changed places": lambda o, c: bool(o[c[:-3, 0], c[:-3, 1]].any()),
        "*all*": lambda o, c: bool(o[c[:-3, 1], c[:-3, 0]].all()),
        "other way round": lambda o, c: not by_steps(o, c),
        "No beam": lambda o, c: False,
    },
}


@pytest.mark.parametrize(("name", "words"), [(n, w) for n, cases in WRONG.items() for w in cases])
def test_a_wrong_answer_is_named(name, words):
    verdict = getattr(ch09, f"check_{name}")(WRONG[name][words])
    assert verdict.verdict == "wrong"
    assert words in verdict.message
