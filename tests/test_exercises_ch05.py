"""Exercises of chapter 05: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
from notebook_cells import defined

from pfslam.teaching.checks_ch05 import check_resample, check_update


def from_notebook(tag, name):
    return defined("05", tag, check_update=check_update, check_resample=check_resample)[name]


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
