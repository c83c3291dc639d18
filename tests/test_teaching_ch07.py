"""Chapter 07: the arithmetic of chance against cases known by hand, and the pictures of the stored tables."""

import itertools

import numpy as np
import pytest

from pfslam.teaching.ch07 import changes as ch07_changes
from pfslam.teaching.ch07 import explorers as ch07_explorers
from pfslam.teaching.ch07 import sweeps as ch07
from pfslam.teaching.ch07.statistics import (
    best_of,
    bootstrap_interval,
    difference_interval,
    resampled,
    verdict,
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


def test_difference_is_after_minus_before_seed_by_seed():
    before = np.array([3.0, 1.0, 2.0])
    assert difference_interval(before, before - 0.5, RNG(0)) == (-0.5, -0.5, -0.5)


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ((0.0, 0.0), "no change"),
        ((-2, -1), "helps"),
        ((1, 2), "hurts"),
        ((-1, 2), "undecided"),
        ((-1, 0), "undecided"),
    ],
)
def test_verdicts(ends, words):
    assert verdict(*ends) == words


def test_wrong_winner_of_equals_is_a_coin_and_of_strangers_never():
    runs = np.arange(20.0)
    assert wrong_winner(runs, runs, 5, RNG(0)) == pytest.approx(0.5, abs=0.04)
    assert wrong_winner(runs, runs + 100.0, 1, RNG(0)) == 0.0
    # One run each: the share of all pairs in which the worse one looks better.
    worse = runs + 3.0
    pairs = np.mean(worse[:, None] < runs) + 0.5 * np.mean(worse[:, None] == runs)
    assert wrong_winner(runs, worse, 1, RNG(0)) == pytest.approx(pairs, abs=0.04)


def test_best_of_many_equal_settings_looks_better_than_it_is():
    same = {k: np.array([1.0, 2.0, 3.0]) for k in range(7)}
    reported, real = best_of(same, RNG(0))
    assert (reported, real) == (1.0, 2.0)


@pytest.mark.parametrize("name", ch07.SWEEPS)
def test_every_sweep_has_runs_for_every_metric(name):
    for metric in ch07.METRICS.values():
        series = ch07.sweep_series(ch07.SWEEPS[name], metric.column)
        assert len(series["hall"]) >= 3
        assert all(
            len(runs) >= 4 and np.isfinite(runs).all() for some in series.values() for runs in some.values()
        )


def test_sweep_explorer_says_the_medians_that_it_draws():
    explorer = ch07_explorers.sweep_explorer()
    for state in explorer.states():
        values = explorer.values(state)
        sweep, what = ch07.SWEEPS[values["parameter"]], ch07.METRICS[values["metric"]]
        for some in ch07.sweep_series(sweep, what.column).values():
            for runs in some.values():
                assert f"{np.median(runs):{what.form}} {what.unit}".strip() in explorer.alt(**values)
    assert explorer.frame(**explorer.values(explorer.start)).shape[2] == 3


def test_seeds_explorer_draws_every_pair():
    pairs = {
        "filters": ch07_changes.filter_pair(),
        "threshold": ch07_changes.threshold_pair("count, 0.5 rad/s", 0.1, 0.9),
    }
    explorer = ch07_explorers.seeds_explorer(pairs)
    for state in explorer.states():
        assert "crown the wrong one in" in explorer.alt(**explorer.values(state))
    assert explorer.frame(**explorer.values(explorer.start)).shape[2] == 3
    assert ch07_explorers.how_often_wrong(pairs["filters"], 3) == 0.0  # in whichever order


def test_a_threshold_that_is_not_reached_changes_nothing():
    change = ch07_changes.threshold_change("count, 0.14 rad/s", 0.1, 0.9)
    reached = ch07.groups("ch07_threshold", "count, 0.14 rad/s", "resample_below", "resamplings")[0.9] > 0
    assert reached.sum() <= 2
    np.testing.assert_array_equal(change.by_seed[~reached], 0.0)  # to the last bit
