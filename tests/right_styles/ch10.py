"""Right answers to the exercises of chapter 10, in the ways that people write them: each must pass its check."""

import math
from collections import deque

import numpy as np


def product(li, p):
    return li * p / (li * p).sum()


def by_logs(li, p):
    with np.errstate(divide="ignore"):
        logs = np.log(li) + np.log(p)
    return np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()


def summed(log_li, log_p):
    return np.logaddexp.reduce(log_li + log_p)


def one_by_one(log_li, log_p):
    total = -math.inf
    for a, b in zip(log_li, log_p, strict=True):
        high, low = max(total, a + b), min(total, a + b)
        total = high + math.log1p(math.exp(low - high))
    return total


def with_scipy(log_li, log_p):
    from scipy.special import logsumexp

    return logsumexp(log_li + log_p)


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
    "check_proposal": [
        by_logs,
        lambda li, p: [a * b / sum(li * p) for a, b in zip(li, p, strict=True)],
        lambda li, p: product(li, p).astype(np.float32),
        lambda li, p: tuple(product(li, p)),
        lambda li, p: np.round(product(li, p), 5),
        lambda li, p: np.multiply(li, p) / np.dot(li, p),
    ],
    "check_log_weight": [
        summed,
        one_by_one,
        with_scipy,
        lambda a, b: np.float32(summed(a, b)),
        lambda a, b: [summed(a, b)],
        lambda a, b: a.max() + np.log(np.exp(a - a.max()) @ np.exp(b)),
    ],
    "check_draw_all": [
        draw,
        draw_lazily,
        lambda m, a, h: tuple(draw(m, a, h)),
        lambda m, a, h: deque(draw(m, a, h)),
    ],
}
