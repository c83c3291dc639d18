"""Exercises of chapter 07: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
from notebook_cells import defined

from pfslam.particles import effective_sample_size
from pfslam.teaching.ch07 import checks as checks_ch07
from pfslam.teaching.ch07.checks import (
    check_median_interval,
    check_sharpness,
    check_sigma_from_sheet,
    check_wrong_pairs,
)

CHECKS = {name: getattr(checks_ch07, name) for name in dir(checks_ch07) if name.startswith("check_")}


def from_notebook(tag, name):
    return defined("07", tag, effective_sample_size=effective_sample_size, **CHECKS)[name]


def test_wrong_pairs_stub_and_solution():
    assert check_wrong_pairs(from_notebook("exercise-1", "wrong_pairs")).verdict == "unanswered"
    assert check_wrong_pairs(from_notebook("solution-1", "wrong_pairs_solution"))


def test_wrong_pairs_hints():
    def pairs(better, worse):
        return np.less.outer(worse, better)

    assert check_wrong_pairs(lambda b, w: pairs(b, w).mean())
    assert "run i only" in check_wrong_pairs(lambda b, w: np.mean(w < b)).message
    assert "rightly" in check_wrong_pairs(lambda b, w: 1 - pairs(b, w).mean()).message
    assert "per cent" in check_wrong_pairs(lambda b, w: 100 * pairs(b, w).mean()).message
    assert "not their share" in check_wrong_pairs(lambda b, w: pairs(b, w).sum()).message
    assert "medians" in check_wrong_pairs(lambda b, w: float(np.median(w) < np.median(b))).message
    assert "One number" in check_wrong_pairs(lambda b, w: pairs(b, w)).message
    assert "counting the pairs" in check_wrong_pairs(lambda b, w: 0.77).message


def test_median_interval_stub_and_solution():
    assert check_median_interval(from_notebook("exercise-2", "median_interval")).verdict == "unanswered"
    assert check_median_interval(from_notebook("solution-2", "median_interval_solution"))


def bootstrap(statistic=np.median, replace=True, own=False):
    """A bootstrap interval with one thing wrong."""

    def interval(values, rng):
        rng = np.random.default_rng() if own else rng
        draws = [statistic(rng.choice(values, len(values), replace=replace)) for _ in range(2000)]
        return np.quantile(draws, [0.025, 0.975])

    return interval


def test_median_interval_hints():
    def bell(values, rng):
        reach = 1.96 * values.std(ddof=1) / np.sqrt(len(values))
        return np.median(values) - reach, np.median(values) + reach

    assert check_median_interval(bootstrap())
    assert "*with* replacement" in check_median_interval(bootstrap(replace=False)).message
    assert "interval of the mean" in check_median_interval(bootstrap(np.mean)).message
    assert "single runs" in check_median_interval(lambda v, rng: np.quantile(v, [0.025, 0.975])).message
    assert "long tail" in check_median_interval(bell).message
    assert "Low comes first" in check_median_interval(lambda v, rng: bootstrap()(v, rng)[::-1]).message
    assert "two numbers" in check_median_interval(lambda v, rng: np.median(v)).message
    drifting = iter(range(10))
    assert "np.random" in check_median_interval(lambda v, rng: (0.1, 0.2 + 0.1 * next(drifting))).message


def test_sigma_stub_and_solution():
    assert check_sigma_from_sheet(from_notebook("exercise-3", "sigma_from_sheet")).verdict == "unanswered"
    assert check_sigma_from_sheet(from_notebook("solution-3", "sigma_from_sheet_solution"))


def test_sigma_hints():
    def hints(function):
        return check_sigma_from_sheet(function).message

    density = np.deg2rad(1.0) / 60.0
    assert "Right" in hints(lambda walk, rate: walk * density * rate**0.5)
    assert "radians" in hints(lambda walk, rate: walk / 60.0 * rate**0.5)
    assert "root* hour" in hints(lambda walk, rate: walk * density / 60.0 * rate**0.5)
    assert "still per root hour" in hints(lambda walk, rate: np.deg2rad(walk) * rate**0.5)
    assert "wrong way round" in hints(lambda walk, rate: walk * density / rate**0.5)
    assert "one sample" in hints(lambda walk, rate: walk * density)
    assert "Variances scale" in hints(lambda walk, rate: walk * density * rate)
    assert "variance" in hints(lambda walk, rate: (walk * density) ** 2 * rate)
    assert "built in" in hints(lambda walk, rate: walk * density * 10.0)


def test_sharpness_stub_and_solution():
    assert check_sharpness(from_notebook("exercise-4", "sharpness")).verdict == "unanswered"
    assert check_sharpness(from_notebook("solution-4", "sharpness_solution"))


def test_sharpness_hints():
    right = from_notebook("solution-4", "sharpness_solution")
    assert "flat, like raw counts" in check_sharpness(lambda scores, share: 1.0).message
    assert "one particle" in check_sharpness(lambda scores, share: 590.0).message
    assert "earns nothing" in check_sharpness(lambda scores, share: -54.0).message
    assert (
        "does *not* count" in check_sharpness(lambda s, share: right(s, 0.5 if share == 0.5 else 0.8)).message
    )
    assert "falls as beta grows" in check_sharpness(lambda scores, share: 30.0).message
    assert "One number" in check_sharpness(lambda scores, share: scores).message
