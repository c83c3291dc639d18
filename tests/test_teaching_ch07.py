"""Chapter 07: the arithmetic of chance against cases known by hand, and the pictures of the stored tables."""

import itertools

import numpy as np
import pytest
from pfslam_book.ch07.statistics import (
    FEWEST,
    best_of,
    bootstrap_interval,
    difference_interval,
    paired_interval,
    re_paired,
    resampled,
    wrong_winner,
)

RNG = np.random.default_rng


def test_bootstrap_medians_of_three_values_come_as_often_as_counted():
    values = (1.0, 2.0, 9.0)
    ways = [np.median(draw) for draw in itertools.product(values, repeat=3)]
    found = resampled(np.array(values), RNG(0))
    for value in values:
        assert np.mean(found == value) == pytest.approx(ways.count(value) / 27, abs=0.04)


def test_interval_covers_the_true_median_about_as_often_as_it_says():
    rng = RNG(1)
    inside = 0
    for _ in range(200):
        low, high = bootstrap_interval(rng.exponential(size=20), rng)
        inside += low <= np.log(2.0) <= high
    assert 0.88 <= inside / 200 <= 1.0  # 95 % asked; 200 trials are good to 3 %


def test_a_difference_of_independent_runs_is_covered_and_does_not_depend_on_their_order():
    rng, inside = RNG(3), 0
    for _ in range(200):
        before, after = rng.exponential(size=20), 0.5 + rng.exponential(size=25)
        found = difference_interval(before, after, rng)
        inside += found.low <= 0.5 <= found.high
    assert 0.9 <= inside / 200 <= 1.0
    shuffled = difference_interval(rng.permutation(before), after, RNG(4))
    same = difference_interval(before, after, RNG(4))
    assert shuffled.value == same.value
    assert shuffled[1:] == pytest.approx(same[1:], abs=0.12)


def test_pairs_are_taken_one_by_one():
    before = np.array([3.0, 1.0, 2.0, 5.0, 9.0, 4.0])
    assert paired_interval(before, before - 0.5, RNG(0)) == (-0.5, -0.5, -0.5)
    assert re_paired(before, before - 0.5, RNG(0), times=20) < 1.0  # other pairs, other answers


def test_too_few_runs_get_no_interval():
    few, enough = np.arange(FEWEST - 1.0), np.arange(float(FEWEST))
    assert difference_interval(few, enough, RNG(0)).verdict == "too few runs"
    assert paired_interval(few, few, RNG(0)).verdict == "too few runs"
    assert difference_interval(enough, enough, RNG(0)).verdict == "undecided"
    assert paired_interval(enough, enough, RNG(0)).verdict == "no change"
    assert 2.0 ** (1 - FEWEST) < 0.05 < 2.0 ** (2 - FEWEST)


def test_wrong_winner_of_equals_is_a_coin_and_of_strangers_never():
    some = np.arange(20.0)
    assert wrong_winner(some, some, 5, RNG(0)) == pytest.approx(0.5, abs=0.02)
    assert wrong_winner(some, some + 100.0, 1, RNG(0)) == 0.0
    # One run each: the share of all pairs in which the worse one looks better.
    worse = some + 3.0
    pairs = np.mean(worse[:, None] < some) + 0.5 * np.mean(worse[:, None] == some)
    assert wrong_winner(some, worse, 1, RNG(0)) == pytest.approx(pairs, abs=0.02)


def test_best_of_many_equal_settings_looks_better_than_it_is():
    same = {k: np.array([1.0, 2.0, 3.0]) for k in range(7)}
    reported, real = best_of(same, RNG(0))
    assert (reported, real) == (1.0, 2.0)
