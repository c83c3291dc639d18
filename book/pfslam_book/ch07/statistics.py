"""Chapter 07, the arithmetic of chance: how sure a handful of runs can make us.

Every function takes the results of runs as plain arrays, one number per run.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

DRAWS = 2000
LEVEL = 0.95
FEWEST = 6
"""Runs from which on an interval is given. From the least to the greatest of n runs is an interval for the median that
is right with 1 - 2^(1 - n) at best: 94 % for five, 97 % for six."""


def resampled(values: np.ndarray, rng: np.random.Generator, statistic: Callable = np.median) -> np.ndarray:
    """Give the statistic of ``DRAWS`` bootstrap samples: as many values as there are, drawn with replacement."""
    values = np.asarray(values, dtype=float)
    draws = values[rng.integers(0, len(values), (DRAWS, len(values)))]
    return statistic(draws, axis=1)


def bootstrap_interval(
    values: np.ndarray, rng: np.random.Generator, statistic: Callable = np.median
) -> tuple[float, float]:
    """Give the middle 95 % of the bootstrap distribution of a statistic of ``values (n,)``."""
    return middle_part(resampled(values, rng, statistic))


def middle_part(draws: np.ndarray) -> tuple[float, float]:
    """Give the ends between which the middle 95 % of some draws lie."""
    low, high = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


class Difference(NamedTuple):
    """A difference of two settings and its interval; the ends are NaN where the runs are too few for one."""

    value: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """Say what the interval of a change in error allows to say."""
        if np.isnan(self.low):
            return "too few runs"
        if self.low == self.high == 0.0:
            return "no change"
        if self.high < 0.0:
            return "helps"
        return "hurts" if self.low > 0.0 else "undecided"


def difference_interval(
    before: np.ndarray, after: np.ndarray, rng: np.random.Generator, statistic: Callable = np.median
) -> Difference:
    """Give the difference of the medians of ``before (m,)`` and ``after (n,)`` with its interval.

    The runs of the two settings are independent, so each is resampled by itself.
    """
    value = float(statistic(after) - statistic(before))
    if min(len(before), len(after)) < FEWEST:
        return Difference(value, np.nan, np.nan)
    return Difference(
        value, *middle_part(resampled(after, rng, statistic) - resampled(before, rng, statistic))
    )


def paired_interval(before: np.ndarray, after: np.ndarray, rng: np.random.Generator) -> Difference:
    """Give the median of the differences ``after - before`` (both ``(n,)``, pair by pair) with its interval.

    This is right only where run i of the one has more to do with run i of the other than with the rest.
    """
    change = np.asarray(after, dtype=float) - np.asarray(before, dtype=float)
    if len(change) < FEWEST:
        return Difference(float(np.median(change)), np.nan, np.nan)
    return Difference(float(np.median(change)), *bootstrap_interval(change, rng))


def re_paired(before: np.ndarray, after: np.ndarray, rng: np.random.Generator, times: int = 300) -> float:
    """Pair independent runs at random, many times; give how often the paired interval says "helps"."""
    said = [paired_interval(before, rng.permutation(after), rng).verdict for _ in range(times)]
    return said.count("helps") / times


def wrong_winner(
    better: np.ndarray,
    worse: np.ndarray,
    seeds: int,
    rng: np.random.Generator,
    statistic: Callable = np.median,
) -> float:
    """Give how often the worse setting has the smaller statistic when each is run with so many seeds.

    Both arrays hold all the runs there are; an experiment draws ``seeds`` runs of each with replacement. A tie is
    half a mistake.
    """
    a, b = (
        statistic(np.asarray(v, dtype=float)[rng.integers(0, len(v), (10 * DRAWS, seeds))], axis=1)
        for v in (better, worse)
    )
    return float(np.mean(b < a) + 0.5 * np.mean(b == a))


def experiment(values: np.ndarray, seeds: int, rng: np.random.Generator) -> np.ndarray:
    """Draw one experiment: ``seeds`` of the runs ``(seeds,)``, with replacement."""
    values = np.asarray(values, dtype=float)
    return values[rng.integers(0, len(values), seeds)]


def best_of(some: dict[float, np.ndarray], rng: np.random.Generator) -> tuple[float, float]:
    """Try every value once and keep the best: give the error then reported, and what that value really gives.

    Both in metres, medians over ``DRAWS`` such searches.
    """
    runs = np.array([values[rng.integers(0, len(values), DRAWS)] for values in some.values()])
    winner = runs.argmin(axis=0)
    truth = np.array([np.median(values) for values in some.values()])
    return float(np.median(runs.min(axis=0))), float(np.median(truth[winner]))


def seconds_of(work: Callable[[], object]) -> float:
    """Measure the processor time of one call (s), the least of three."""
    spent = []
    for _ in range(3):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return min(spent)
