"""Chapter 07, the arithmetic of chance: how sure a handful of runs can make us.

Every function takes the results of runs as plain arrays, one number per seed.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

DRAWS = 2000
LEVEL = 0.95


def resampled(values: np.ndarray, rng: np.random.Generator, statistic: Callable = np.median) -> np.ndarray:
    """The statistic of ``DRAWS`` bootstrap samples: as many values as there are, drawn with replacement."""
    values = np.asarray(values, dtype=float)
    draws = values[rng.integers(0, len(values), (DRAWS, len(values)))]
    return statistic(draws, axis=1)


def bootstrap_interval(
    values: np.ndarray, rng: np.random.Generator, statistic: Callable = np.median
) -> tuple[float, float]:
    """Where the statistic of ``values (n,)`` lies with 95 %: the middle part of its bootstrap distribution."""
    low, high = np.quantile(resampled(values, rng, statistic), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def difference_interval(
    before: np.ndarray, after: np.ndarray, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Median over seeds of ``after - before`` (both ``(n,)``, same seeds in the same order), and its interval."""
    change = np.asarray(after, dtype=float) - np.asarray(before, dtype=float)
    return float(np.median(change)), *bootstrap_interval(change, rng)


def verdict(low: float, high: float) -> str:
    """What an interval of a change in error allows to say."""
    if low == high == 0.0:
        return "no change"
    if high < 0.0:
        return "helps"
    return "hurts" if low > 0.0 else "undecided"


def wrong_winner(better: np.ndarray, worse: np.ndarray, seeds: int, rng: np.random.Generator) -> float:
    """How often the worse setting has the smaller median when each is run with so many seeds.

    Both arrays hold all the runs there are; an experiment draws ``seeds`` runs of each with replacement. A tie is
    half a mistake.
    """
    a, b = (_medians(values, seeds, rng) for values in (better, worse))
    return float(np.mean(b < a) + 0.5 * np.mean(b == a))


def _medians(values: np.ndarray, seeds: int, rng: np.random.Generator) -> np.ndarray:
    """Medians ``(DRAWS,)`` of so many runs each."""
    values = np.asarray(values, dtype=float)
    return np.median(values[rng.integers(0, len(values), (DRAWS, seeds))], axis=1)


def experiment(values: np.ndarray, seeds: int, rng: np.random.Generator) -> np.ndarray:
    """One experiment: ``seeds`` of the runs ``(seeds,)``, drawn with replacement."""
    values = np.asarray(values, dtype=float)
    return values[rng.integers(0, len(values), seeds)]


def best_of(some: dict[float, np.ndarray], rng: np.random.Generator) -> tuple[float, float]:
    """Try every value once and keep the best: the error then reported, and what that value really gives (medians).

    Both in metres, medians over ``DRAWS`` such searches.
    """
    runs = np.array([values[rng.integers(0, len(values), DRAWS)] for values in some.values()])
    winner = runs.argmin(axis=0)
    truth = np.array([np.median(values) for values in some.values()])
    return float(np.median(runs.min(axis=0))), float(np.median(truth[winner]))


def seconds_of(work: Callable[[], object]) -> float:
    """Processor time of one call (s), the least of three."""
    spent = []
    for _ in range(3):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return min(spent)
