"""Right answers to the exercises of chapter 09, in the ways that people write them: each must pass its check."""

import math
from collections import deque

import numpy as np


def top_of_polyfit(left, middle, right):
    a, b, _ = np.polyfit([-1, 0, 1], [left, middle, right], 2)
    return -b / (2 * a)


SUB_CELL = [
    top_of_polyfit,
    lambda a, b, c: np.float32((a - c) / (a - 2 * b + c) / 2),
    lambda a, b, c: round((a - c) / (2 * (a - 2 * b + c)), 4),
    lambda a, b, c: np.array([(a - c) / (2 * (a - 2 * b + c))]),
    lambda a, b, c: -((c - a) / 2) / ((c - b) - (b - a)),
]


def by_lstsq(arms, position, centres, normals):
    residual = np.einsum("ij,ij->i", normals, arms + position - centres)
    turning = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
    return np.linalg.lstsq(np.column_stack([normals, turning]), -residual, rcond=None)[0]


def by_sums(arms, position, centres, normals):
    H, g = np.zeros((3, 3)), np.zeros(3)
    for a, c, n in zip(arms, centres, normals, strict=True):
        J = np.array([n[0], n[1], n[1] * a[0] - n[0] * a[1]])
        H += np.outer(J, J)
        g += J * (n @ (position + a - c))
    return np.linalg.solve(H, -g)


LINE_STEP = [
    by_lstsq,
    by_sums,
    lambda *case: by_sums(*case).tolist(),
    lambda *case: tuple(by_lstsq(*case)),
    lambda *case: by_lstsq(*case).astype(np.float32),
    lambda *case: np.round(by_lstsq(*case), 6),
]


def summed(log_li, log_p):
    return np.logaddexp.reduce(log_li + log_p)


def one_by_one(log_li, log_p):
    total = -math.inf
    for a, b in zip(log_li, log_p, strict=True):
        high, low = max(total, a + b), min(total, a + b)
        total = high + math.log1p(math.exp(low - high))
    return total


def draw(maps, ancestors, hits):
    new = []
    for a, h in zip(ancestors, hits, strict=True):
        if h is None:
            new.append(maps[a])
        else:
            new.append(maps[a] + np.eye(len(maps[a]))[h])
    return new


def draw_lazily(maps, ancestors, hits):
    new = [maps[k] for k in ancestors]
    for k, h in enumerate(hits):
        if h is not None:
            new[k] = new[k].copy()
            new[k][h] += 1
    return new


STYLES = {
    "check_sub_cell": SUB_CELL,
    "check_line_step": LINE_STEP,
    "check_log_weight": [
        summed,
        one_by_one,
        lambda a, b: np.float32(summed(a, b)),
        lambda a, b: [summed(a, b)],
    ],
    "check_draw_all": [
        draw,
        draw_lazily,
        lambda m, a, h: tuple(draw(m, a, h)),
        lambda m, a, h: deque(draw(m, a, h)),
    ],
}
