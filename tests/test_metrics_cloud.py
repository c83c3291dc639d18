"""Calibration of the cloud: closed forms against SciPy, and clouds whose honesty is known because it was made."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from pfslam.errors import DataError
from pfslam.evaluation.cloud import (
    CLAIMS,
    cloud_consistency,
    cloud_moments,
    covariance_consistency,
    squared_mahalanobis,
)
from pfslam.particles import Particles
from pfslam.poses import Trajectory, compose, wrap_angle
from pfslam.refined.record import RefinedStep

SPREAD = np.array([[0.04, 0.01, 0.002], [0.01, 0.02, 0.001], [0.002, 0.001, 0.0025]])
ROOT = np.linalg.cholesky(SPREAD)
CLOUDS = 600


def test_moments_of_a_weighted_cloud_across_the_cut_at_pi():
    """Two particles by hand: weights 1/4 and 3/4, headings either side of pi, 0.2 rad apart."""
    particles = Particles(np.array([[0.0, 0, np.pi - 0.15], [4.0, 2, -np.pi + 0.05]]), np.log([1.0, 3.0]))
    mean, P = cloud_moments(particles)
    np.testing.assert_allclose(mean[:2], [3.0, 1.5])
    assert wrap_angle(mean[2] - np.pi) == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(np.diag(P)[:2], [3.0, 0.75])
    np.testing.assert_allclose(P[0, 1], 1.5)
    assert P[2, 2] == pytest.approx(0.0075, rel=0.01)  # 1/4 of 0.15^2 and 3/4 of 0.05^2


def made_run(claimed, seed=0, particles=2000, weighted=False):
    """Clouds of spread ``claimed`` times the true one around estimates whose error is SPREAD; truth all over."""
    rng = np.random.default_rng(seed)
    t = np.arange(CLOUDS + 1.0)
    true_poses = np.column_stack([np.cos(t), 0.1 * t, wrap_angle(0.7 * t)])
    start = Particles.at(true_poses[0], 3)
    infos = [RefinedStep(0.0, true_poses[0], start, 3.0, 0, covariance=np.zeros((3, 3)))]
    for k in range(1, CLOUDS + 1):
        mean = true_poses[k] + ROOT @ rng.standard_normal(3)
        wide = 1.5 if weighted else 1.0
        z = wide * rng.standard_normal((particles, 3))
        # Drawn 1.5 times too wide, the weights p(z) / q(z) make up for it.
        log_weights = -0.5 * np.sum(z**2, axis=1) * (1.0 - 1.0 / wide**2)
        poses = mean + claimed * z @ ROOT.T
        cloud = Particles(poses, log_weights)
        covariance = claimed**2 * SPREAD
        infos.append(RefinedStep(t[k], mean, cloud, 1.0, 0, matched=True, covariance=covariance))
    return infos, Trajectory(t, true_poses)


def binomial(share):
    """Four standard errors of a share over the clouds of a run."""
    return 4 * np.sqrt(share * (1 - share) / CLOUDS)


@pytest.mark.parametrize("claimed", [1.0, 0.5])
@pytest.mark.parametrize(
    ("measure", "weighted"),
    [(cloud_consistency, False), (cloud_consistency, True), (covariance_consistency, False)],
)
def test_the_truth_lies_inside_as_often_as_is_claimed_and_too_little_spread_is_found_out(
    measure, weighted, claimed
):
    found = measure(*made_run(claimed, weighted=weighted))
    assert len(found.nees) == CLOUDS
    assert np.isfinite(found.nees).all()
    for share in CLAIMS:
        expected = stats.chi2.cdf(claimed**2 * stats.chi2.ppf(share, 3), 3)
        assert found.inside[share] == pytest.approx(expected, abs=binomial(expected))
    assert found.nees.mean() == pytest.approx(3 / claimed**2, abs=4 * np.sqrt(6 / CLOUDS) / claimed**2)
    assert found.claimed_m == pytest.approx(claimed * found.actual_m, rel=0.1)
    assert found.claimed_m == pytest.approx(claimed * np.sqrt(0.06), rel=0.02)


def test_the_ellipsoids_reach_as_far_as_chi_square_says():
    for share, reach in CLAIMS.items():
        np.testing.assert_allclose(reach, stats.chi2.ppf(share, 3), atol=1e-6)


def test_distances_are_those_of_each_covariance_alone_and_infinite_where_one_is_certain():
    errors, spreads = np.array([[0.2, 0.0, 0.0], [1.0, 2.0, 3.0], [0.0, 0.0, 0.1]]), np.stack([SPREAD] * 3)
    spreads[1, 2] = spreads[1, :, 2] = 0.0
    by_inverse = [e @ np.linalg.inv(SPREAD) @ e for e in errors]
    np.testing.assert_allclose(squared_mahalanobis(errors, spreads), [by_inverse[0], np.inf, by_inverse[2]])


def test_the_run_may_start_anywhere():
    infos, truth = made_run(1.0)
    moved = Trajectory(truth.t, compose([5.0, -3.0, 2.0], truth.poses))
    np.testing.assert_allclose(cloud_consistency(infos, moved).nees, cloud_consistency(infos, truth).nees)


def test_one_particle_claims_to_be_certain():
    infos, truth = made_run(1.0, particles=1)
    found = cloud_consistency(infos, truth)
    assert np.isinf(found.nees).sum() == CLOUDS
    assert found.inside == dict.fromkeys(CLAIMS, 0.0)
    assert found.claimed_m == 0.0


def test_without_clouds_covariances_or_truth_there_is_nothing_to_say():
    infos, truth = made_run(1.0, particles=1)
    with pytest.raises(DataError, match="particles"):
        cloud_consistency(infos, Trajectory(truth.t + 1e6, truth.poses))
    with pytest.raises(DataError, match="covariance"):
        covariance_consistency([replace(info, covariance=None) for info in infos], truth)
