"""Exercises of chapter 10: stub, solution, right answers in many styles, and the words for each wrong one."""

import math
from collections import deque

import numpy as np
import pytest
from pfslam_book import ch10


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


def draw_copies(maps, ancestors, hits, add=lambda m, h: m.__setitem__(h, m[h] + 1), copy=np.copy):
    new = [copy(maps[a]) if h is not None else maps[a] for a, h in zip(ancestors, hits, strict=True)]
    for m, h in zip(new, hits, strict=True):
        if h is not None:
            add(m, h)
    return new


def draw_lazily(maps, ancestors, hits):
    new = [maps[k] for k in ancestors]
    for k, h in enumerate(hits):
        if h is not None:
            new[k] = new[k].copy()
            new[k][h] += 1
    return new


RIGHT = {
    "proposal": [
        by_logs,
        lambda li, p: [a * b / sum(li * p) for a, b in zip(li, p, strict=True)],
        lambda li, p: product(li, p).astype(np.float32),
        lambda li, p: tuple(product(li, p)),
        lambda li, p: np.round(product(li, p), 5),
        lambda li, p: np.multiply(li, p) / np.dot(li, p),
    ],
    "log_weight": [
        summed,
        one_by_one,
        with_scipy,
        lambda a, b: np.logaddexp.reduce((a + b).astype(np.longdouble)),
        lambda a, b: np.float32(summed(a, b)),
        lambda a, b: [summed(a, b)],
        lambda a, b: a.max() + np.log(np.exp(a - a.max()) @ np.exp(b)),
    ],
    "draw_all": [
        draw,
        draw_copies,
        draw_lazily,
        lambda m, a, h: tuple(draw(m, a, h)),
        lambda m, a, h: deque(draw(m, a, h)),
        lambda m, a, h: [draw(m, a[k : k + 1], h[k : k + 1])[0] for k in range(len(h))],
        lambda m, a, h: [
            g if x is None else g + (np.arange(5) == x)
            for g, x in zip(draw(m, a, [None] * 5), h, strict=True)
        ],
    ],
}


@pytest.mark.parametrize(
    ("name", "style"), [(n, k) for n, styles in RIGHT.items() for k in range(len(styles))]
)
def test_a_right_answer_passes_in_any_style(name, style):
    verdict = getattr(ch10, f"check_{name}")(RIGHT[name][style])
    assert verdict, verdict.message


def spoiling(maps, ancestors, hits):
    new = [m.copy() if h is not None else m for m, h in zip(draw(maps, ancestors, hits), hits, strict=True)]
    maps[4] += 1
    return new


WRONG = {
    "proposal": {
        "No exp": lambda li, p: np.exp(li * p) / np.exp(li * p).sum(),
        "turns the motion round": lambda li, p: (li / p) / (li / p).sum(),
        "number of poses": lambda li, p: li * p / len(li),
        "as a draw would": lambda li, p: np.cumsum(product(li, p)),
        "do not sum to 1": lambda li, p: li * p,
        "The scan alone": lambda li, p: li / li.sum(),
        "motion alone": lambda li, p: p,
        "not added": lambda li, p: (li + p) / (li + p).sum(),
        "greatest product": lambda li, p: li * p / (li * p).max(),
        "sum of the likelihoods": lambda li, p: li * p / li.sum(),
        "mode": lambda li, p: np.eye(len(li))[np.argmax(li * p)],
        "opposite order": lambda li, p: product(li, p)[::-1],
    },
    "log_weight": {
        "not the largest": lambda a, b: (a + b).min() + np.log(np.exp(a + b - (a + b).min()).sum()),
        "base 10": lambda a, b: summed(a, b) / np.log(10),
        "average logarithms": lambda a, b: np.exp(b) @ a,
        "Subtract the largest": lambda a, b: np.log(np.exp(a + b).sum()),
        "best pose alone": lambda a, b: (a + b).max(),
        "motion is missing": lambda a, b: np.logaddexp.reduce(a),
        "equally likely": lambda a, b: np.logaddexp.reduce(a) - np.log(len(a)),
        "mean over the poses": lambda a, b: summed(a, b) - np.log(len(a)),
        "weight itself": lambda a, b: np.exp(summed(a, b)),
        "add up": lambda a, b: (a + b).sum(),
        "mean of logarithms": lambda a, b: (a + b).mean(),
        "did not add it again": lambda a, b: summed(a, b) - (a + b).max(),
        "sign": lambda a, b: -summed(a, b),
    },
    "draw_all": {
        "hits of the ancestors": lambda m, a, h: draw(m, a, [h[k] for k in a]),
        "added 1 to cell 0": lambda m, a, h: draw(m, a, [x or 0 for x in h]),
        "subtract 1": lambda m, a, h: draw_copies(m, a, h, add=lambda g, x: g.__setitem__(x, g[x] - 1)),
        "one and the same array": lambda m, a, h: draw_copies(m, a, h, copy=lambda x: x),
        "more memory": lambda m, a, h: [x.copy() for x in draw(m, a, h)],
        "use its map": lambda m, a, h: draw(m, range(5), h),
        "is not None": lambda m, a, h: [
            m[k].copy() + (np.eye(5)[x] if x else 0) if x is not None else m[k]
            for k, x in zip(a, h, strict=True)
        ],
        "set the cell": lambda m, a, h: draw_copies(m, a, h, add=lambda g, x: g.__setitem__(x, 1.0)),
        "hits are missing": lambda m, a, h: draw(m, a, [None] * 5),
        "step before": spoiling,
        "list of maps": lambda m, a, h: m[0],
        "returns nothing": lambda m, a, h: None,
        "some map is not that": lambda m, a, h: [x + 1 for x in draw(m, a, h)],
    },
}


@pytest.mark.parametrize(("name", "words"), [(n, w) for n, cases in WRONG.items() for w in cases])
def test_a_wrong_answer_is_named(name, words):
    verdict = getattr(ch10, f"check_{name}")(WRONG[name][words])
    assert verdict.verdict == "wrong"
    assert words in verdict.message
