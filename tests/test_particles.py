"""The cloud: Eq. 10 to 13, and resamplers whose mean offspring is N w whatever the weights."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfslam.errors import DataError
from pfslam.motion import motion_model
from pfslam.particles import (
    RESAMPLERS,
    ControlNoise,
    Particles,
    effective_sample_size,
    predict,
    resample,
    reweight,
)

schemes = pytest.mark.parametrize("scheme", RESAMPLERS)
SIGMAS = 5.0  # a fair test fails once in two million at five standard errors


class Fixed:
    """A random generator that always gives the same number."""

    def __init__(self, u):
        self.u = u

    def random(self, n=None):
        return self.u if n is None else np.full(n, self.u)


def weights_of(*w):
    return np.array(w, dtype=float) / np.sum(w)


def test_weights_sum_to_one_however_they_are_given():
    cloud = Particles(np.zeros((3, 3)), np.log([2.0, 6.0, 8.0]) + 1000.0)
    np.testing.assert_allclose(cloud.weights, [1 / 8, 3 / 8, 1 / 2])
    assert np.exp(cloud.log_weights).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("poses", "log_weights"),
    [
        (np.zeros((2, 3)), np.zeros(3)),
        (np.zeros((0, 3)), np.zeros(0)),
        (np.zeros((2, 2)), np.zeros(2)),
        (np.zeros((2, 3)), np.full(2, -np.inf)),
        (np.zeros((2, 3)), np.array([0.0, np.nan])),
        (np.full((2, 3), np.nan), np.zeros(2)),
    ],
)
def test_what_is_no_cloud_is_refused(poses, log_weights):
    with pytest.raises(DataError, match="Particles"):
        Particles(poses, log_weights)


def test_prediction_without_noise_is_the_motion_model_and_keeps_the_weights():
    cloud = Particles(np.random.default_rng(0).normal(size=(5, 3)), np.log([1, 2, 3, 4, 5]))
    moved = predict(cloud, 0.7, -0.3, 0.1, ControlNoise(0.0, 0.0), np.random.default_rng(1))
    np.testing.assert_array_equal(moved.poses, motion_model(cloud.poses, 0.7, -0.3, 0.1))
    np.testing.assert_allclose(moved.weights, cloud.weights)


@pytest.mark.parametrize(("per_root_second", "steps"), [(False, 1), (False, 16), (True, 4), (True, 16)])
def test_noise_per_sample_shrinks_with_the_rate_and_noise_per_root_second_does_not(per_root_second, steps):
    """Driving along x for 1 s: x = sum dt (v + e_v), theta = sum dt (omega + e_omega), drawn for each particle."""
    n, rng, noise = 20_000, np.random.default_rng(steps), ControlNoise(3e-4, 2e-4, per_root_second)
    cloud = Particles.at(np.zeros(3), n)
    for _ in range(steps):
        cloud = predict(cloud, 1.0, 0.0, 1.0 / steps, noise, rng)
    x, _, theta = cloud.poses.T
    shrunk = 1.0 if per_root_second else 1.0 / np.sqrt(steps)
    # The relative standard error of a deviation is 1 / sqrt(2 N); of the correlation of independent draws 1 / sqrt(N).
    assert x.std() == pytest.approx(3e-4 * shrunk, rel=SIGMAS / np.sqrt(2 * n))
    assert theta.std() == pytest.approx(2e-4 * shrunk, rel=SIGMAS / np.sqrt(2 * n))
    assert abs(np.corrcoef(x, theta)[0, 1]) < SIGMAS / np.sqrt(n)


def test_reweight_by_hand():
    # 1/2, 1/4, 1/4 times 2, 4, 0 is 1, 1, 0; the evidence is their sum. Eq. 12.
    cloud = Particles(np.zeros((3, 3)), np.log([2.0, 1.0, 1.0]))
    with np.errstate(divide="ignore"):
        after, evidence = reweight(cloud, np.log([2.0, 4.0, 0.0]))
    np.testing.assert_allclose(after.weights, [0.5, 0.5, 0.0])
    assert evidence == pytest.approx(np.log(2.0))


def test_scan_that_nobody_explains_leaves_the_weights_alone():
    cloud = Particles(np.zeros((3, 3)), np.log([2.0, 1.0, 1.0]))
    after, evidence = reweight(cloud, np.full(3, -np.inf))
    assert evidence == -np.inf
    np.testing.assert_array_equal(after.weights, cloud.weights)


def test_a_thousand_scans_do_not_underflow():
    cloud = Particles.at(np.zeros(3), 2)
    for _ in range(1000):
        cloud, _ = reweight(cloud, np.array([-50.0, -50.001]))
    assert cloud.weights[0] / cloud.weights[1] == pytest.approx(np.e)


def test_effective_sample_size_by_hand_and_at_its_ends():
    assert effective_sample_size(weights_of(1, 1, 1, 1)) == pytest.approx(4.0)
    assert effective_sample_size([0.0, 1.0, 0.0]) == 1.0
    assert effective_sample_size([0.5, 0.25, 0.25]) == pytest.approx(8 / 3)


@given(st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=30))
def test_effective_sample_size_lies_between_1_and_n(w):
    n_eff = effective_sample_size(weights_of(*w))
    assert 1.0 - 1e-9 <= n_eff <= len(w) + 1e-9


@pytest.mark.parametrize("weights", [[0.0, 0.0], [1.0, 1.0], [0.5, np.nan]])
def test_effective_sample_size_wants_normalised_weights(weights):
    with pytest.raises(DataError, match="effective_sample_size"):
        effective_sample_size(weights)


UNEVEN = [
    weights_of(0.6, 0.25, 0.15),
    weights_of(0.5, 0.5),
    weights_of(0.0, 0.3, 0.0, 0.7),
    weights_of(1, 1, 1, 1, 1),
    weights_of(0.97, 0.01, 0.01, 0.01),
    weights_of(*np.random.default_rng(0).exponential(size=20)),
]


@schemes
@pytest.mark.parametrize("weights", UNEVEN, ids=lambda w: f"{len(w)}-{w[0]:.2f}")
def test_mean_offspring_is_n_times_the_weight(scheme, weights):
    # No scheme varies more than N independent draws, whose offspring have variance N w (1 - w).
    repeats, n, rng = 4000, len(weights), np.random.default_rng(1)
    offspring = (
        sum(np.bincount(RESAMPLERS[scheme](weights, rng), minlength=n) for _ in range(repeats)) / repeats
    )
    standard_error = np.sqrt(n * weights * (1 - weights) / repeats)
    assert (np.abs(offspring - n * weights) <= SIGMAS * standard_error + 1e-12).all()


@given(
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12).filter(lambda w: sum(w) > 1e-3),
    st.integers(0, 2**32 - 1),
)
def test_offspring_stay_within_what_each_scheme_promises(w, seed):
    weights = weights_of(*w)
    expected, n = len(w) * weights, len(w)
    count = {
        s: np.bincount(f(weights, np.random.default_rng(seed)), minlength=n) for s, f in RESAMPLERS.items()
    }
    assert all(c.sum() == n and not c[weights == 0].any() for c in count.values())
    # Equal strides: whole part or one more. One draw a stratum: less than two away. Residual: at least the
    # whole part.
    assert (np.abs(count["systematic"] - expected) < 1 + 1e-9).all()
    assert (np.abs(count["stratified"] - expected) < 2 + 1e-9).all()
    assert (count["residual"] >= np.floor(expected - 1e-9)).all()


@pytest.mark.parametrize("scheme", ["systematic", "stratified", "residual"])
@pytest.mark.parametrize("n", [1, 3, 7, 20, 21, 200])
def test_equal_weights_keep_every_particle(scheme, n):
    # With 20 particles a weight over the sum of all, times 20, rounds to below 1: each still has exactly one child.
    np.testing.assert_array_equal(
        RESAMPLERS[scheme](np.full(n, 1.0 / n), np.random.default_rng(0)), np.arange(n)
    )


@schemes
@pytest.mark.parametrize("u", [0.0, np.nextafter(1.0, 0.0)])
@pytest.mark.parametrize("weights", [[*np.full(10, 0.1), 0.0], [0.0, 0.5, 0.0, 0.5, 0.0]])
def test_particles_of_weight_zero_have_no_children_at_either_end(scheme, u, weights):
    """Ten tenths add up to 1 - 2**-53: a position may lie beyond the last edge."""
    assert np.cumsum(np.full(10, 0.1))[-1] < 1.0
    ancestors = RESAMPLERS[scheme](np.array(weights), Fixed(u))
    assert len(ancestors) == len(weights)
    assert set(ancestors) <= set(np.flatnonzero(weights))


@schemes
@pytest.mark.parametrize("weights", [[0.0, 0.0, 0.0], [0.5, np.nan, 0.5], [-0.5, 1.0, 0.5], []])
def test_weights_that_are_none_are_refused(scheme, weights):
    with pytest.raises(DataError, match="weights"):
        RESAMPLERS[scheme](np.array(weights), np.random.default_rng(0))


@schemes
def test_resampled_cloud_has_copies_with_equal_weights_that_share_no_memory(scheme):
    cloud = Particles(np.arange(12.0).reshape(4, 3), np.log([0.7, 0.1, 0.1, 0.1]))
    after = resample(cloud, np.random.default_rng(0), scheme)
    np.testing.assert_allclose(after.weights, 0.25)
    assert {tuple(p) for p in after.poses} <= {tuple(p) for p in cloud.poses}
    assert not np.shares_memory(after.poses, cloud.poses)
