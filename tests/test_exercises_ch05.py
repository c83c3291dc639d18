"""Exercises of chapter 05: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
import pytest
from notebook_cells import defined

from pfslam.particles import effective_sample_size
from pfslam.teaching.ch05.checks import check_mean_pose, check_resample, check_update
from pfslam.teaching.ch05.weights import (
    SHARPNESS,
    copies_table,
    counts_of_a_scan,
    raw_count_weights,
    weights_from,
)
from pfslam.teaching.show.tables import errors_by_label, read_table


def from_notebook(tag, name):
    return defined("05", tag)[name]


def test_update_stub_and_solution():
    assert check_update(from_notebook("exercise-1", "update")).verdict == "unanswered"
    assert check_update(from_notebook("solution-1", "update_solution"))


def test_update_hints():
    def softmax(weights, counts):
        return np.exp(counts) / np.exp(counts).sum()

    def uniform_if_empty(weights, counts):
        joint = weights * counts
        return joint / joint.sum() if joint.any() else np.full(len(weights), 1 / len(weights))

    assert "forgotten" in check_update(lambda weights, counts: counts / counts.sum()).message
    assert "sum to 19" in check_update(lambda weights, counts: weights * counts).message
    assert "exp of the count" in check_update(softmax).message
    assert "0 by 0" in check_update(lambda w, c: w * c / (w * c).sum()).message
    assert "wiped out" in check_update(uniform_if_empty).message
    assert "shape" in check_update(lambda weights, counts: 1.0).message
    assert "NameError" in check_update(lambda weights, counts: nothing).message  # noqa: F821


def test_resample_stub_and_solution():
    assert check_resample(from_notebook("exercise-2", "resample")).verdict == "unanswered"
    assert check_resample(from_notebook("solution-2", "resample_solution"))


def resampler(pick, keep_weights=False):
    """A resampler with its own way to pick ancestors."""

    def resample(poses, weights, rng):
        ancestors = pick(poses, weights, rng)
        return poses[ancestors], weights[ancestors] if keep_weights else np.full(len(poses), 1 / len(poses))

    return resample


def by_weight(poses, weights, rng):
    return rng.choice(len(poses), len(poses), p=weights)


def test_resample_hints():
    def torn(poses, weights, rng):
        first, second = by_weight(poses, weights, rng), by_weight(poses, weights, rng)
        return np.column_stack([poses[first, :2], poses[second, 2]]), np.full(len(poses), 1 / len(poses))

    def jittered(poses, weights, rng):
        poses = poses[by_weight(poses, weights, rng)]
        return poses + 0.01 * rng.standard_normal(poses.shape), np.full(len(poses), 1 / len(poses))

    def best(poses, weights, rng):
        return np.full(len(poses), np.argmax(weights))

    assert check_resample(resampler(by_weight))
    assert "counted twice" in check_resample(resampler(by_weight, keep_weights=True)).message
    assert "one index array" in check_resample(torn).message
    assert "next prediction" in check_resample(jittered).message
    assert "play no part" in check_resample(resampler(lambda p, w, rng: rng.integers(0, 5, 5))).message
    assert "Only the heaviest" in check_resample(resampler(best)).message
    assert "two arrays" in check_resample(lambda poses, weights, rng: poses).message


def test_mean_pose_stub_and_solution():
    assert check_mean_pose(from_notebook("exercise-3", "mean_pose")).verdict == "unanswered"
    assert check_mean_pose(from_notebook("solution-3", "mean_pose_solution"))


def test_mean_pose_hints():
    def swapped(poses, weights):
        heading = np.arctan2(weights @ np.cos(poses[:, 2]), weights @ np.sin(poses[:, 2]))
        return np.array([*(weights @ poses[:, :2]), heading])

    assert "numbers on a line" in check_mean_pose(lambda poses, weights: weights @ poses).message
    assert "weights play no part" in check_mean_pose(lambda poses, weights: poses.mean(axis=0)).message
    assert "heaviest" in check_mean_pose(lambda poses, weights: poses[np.argmax(weights)]).message
    assert "sine first" in check_mean_pose(swapped).message
    assert "One pose" in check_mean_pose(lambda poses, weights: weights @ poses[:, :2]).message


def test_sharper_likelihoods_leave_fewer_particles():
    """The values that one works out with NumPy alone, for counts of 500 give or take 15."""
    counts = counts_of_a_scan()
    alive = [effective_sample_size(weights_from(counts, b)) for b in SHARPNESS]
    assert alive == sorted(alive, reverse=True)
    assert alive[0] == pytest.approx(200)
    assert alive[-1] < 5
    assert effective_sample_size(raw_count_weights(counts)) > 199


def test_every_scheme_makes_n_w_copies_on_average():
    table = copies_table()
    assert all(mean == pytest.approx(3.0, abs=0.12) for mean, _ in table.values())
    assert table["systematic"][1] < 0.05 < table["multinomial"][1]


def test_stored_runs_say_what_the_chapter_says_of_them():
    errors = errors_by_label(read_table("ch05_cures"))
    typical = {name: np.median(values) for name, values in errors.items()}
    others = np.concatenate([errors["report"], errors["gentle clearing"]])
    assert typical["gentle clearing"] < typical["report"] < typical["dead reckoning"]
    assert errors["refined"].max() < min(0.02, others.min())
