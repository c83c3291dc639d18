"""Right answers to the exercises of chapter 07, in the ways that people write them: each must pass its check."""

import numpy as np


def difference_in_a_loop(before, after, rng):
    apart = [
        np.median(rng.choice(after, len(after))) - np.median(rng.choice(before, len(before)))
        for _ in range(2000)
    ]
    return [np.median(after) - np.median(before), *np.percentile(apart, [2.5, 97.5])]


def difference_by_rows(before, after, rng):
    draws = [e[rng.integers(0, len(e), (2000, len(e)))] for e in (after, before)]
    apart = np.subtract(*(np.median(d, axis=1) for d in draws))
    return np.median(after) - np.median(before), *np.quantile(apart, [0.025, 0.975])


def by_building_in_a_loop(before, after, rng):
    change = [np.mean(a) - np.mean(b) for b, a in zip(before, after, strict=True)]
    medians = sorted(float(np.median(rng.choice(change, len(change)))) for _ in range(2000))
    return float(np.median(change)), medians[50], medians[1949]


def by_building_by_rows(before, after, rng):
    change = (after - before).mean(axis=1)
    picked = rng.integers(0, len(change), (4000, len(change)))
    return [np.median(change), *np.percentile(np.median(change[picked], axis=1), [2.5, 97.5])]


def choose_in_a_loop(runs, n):
    middles = [sorted(run[:n]) for run in runs.tolist()]
    middle = [(run[(n - 1) // 2] + run[n // 2]) / 2 for run in middles]
    best = middle.index(min(middle))
    return best, float(np.median(runs[best][n:]))


STYLES = {
    "check_difference": [
        difference_in_a_loop,
        difference_by_rows,
        lambda b, a, rng: np.float32(difference_by_rows(b, a, rng)),
        lambda b, a, rng: tuple(np.round(difference_by_rows(b, a, rng), 4)),
    ],
    "check_by_building": [
        by_building_in_a_loop,
        by_building_by_rows,
        lambda b, a, rng: np.float32(by_building_by_rows(b, a, rng)),
        lambda b, a, rng: np.round(by_building_by_rows(b, a, rng), 4),
    ],
    "check_choose_and_report": [
        choose_in_a_loop,
        lambda runs, n: list(choose_in_a_loop(runs, n)),
        lambda runs, n: np.array(choose_in_a_loop(runs, n)),
        lambda runs, n: (np.int64(choose_in_a_loop(runs, n)[0]), np.float32(choose_in_a_loop(runs, n)[1])),
    ],
}
