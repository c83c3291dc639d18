"""Covariances: transport and measurement against Monte Carlo, and drives whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from rooms import LIDAR, drive

from pfslam.evaluation.cloud import covariance_consistency
from pfslam.grid import GridSpec
from pfslam.io.datasets import load
from pfslam.poses import between, compose
from pfslam.refined import covariance
from pfslam.refined.covariance import (
    line_information,
    predicted_covariance,
    transported,
    wall_covariance,
    with_silent_direction,
)
from pfslam.refined.lines import HitMoments, LineFit
from pfslam.refined.step import RefinedConfig
from pfslam.run import run_slam, slam_steps
from pfslam.slam import SlamConfig
from pfslam.study.disturbances import blind, first_seconds

ROOT = np.array([[0.02, 0.0, 0.0], [0.01, 0.03, 0.0], [0.004, -0.003, 0.008]])
SPREAD = ROOT @ ROOT.T


def test_an_error_of_a_scan_moves_what_is_fixed_to_it_as_drawn_at_random():
    """Poses drawn about one carry another along as a rigid body; the sample's covariance has a known accuracy."""
    rng = np.random.default_rng(0)
    reference, pose = np.array([1.0, 2.0, 0.7]), np.array([4.0, -3.0, -1.1])
    draws = 40_000
    wrong = reference + 0.2 * rng.standard_normal((draws, 3)) @ ROOT.T
    carried = compose(wrong, between(reference, pose)) - pose
    found = transported(0.04 * SPREAD, (pose - reference)[:2])
    deviation = np.sqrt(np.diag(found))
    tolerance = 5 * np.outer(deviation, deviation) * np.sqrt(2 / draws)
    assert (np.abs(np.cov(carried.T) - found) < tolerance).all()


def test_walls_carry_the_mean_error_of_the_scans_that_hit_them_first():
    """Two scans at different places drew the walls of a fit, one of them three quarters of it by weight."""
    spec, places = GridSpec((-5.0, -5.0), 0.05, (200, 200)), np.array([[1.0, -2.0, 0.3], [-3.0, 0.5, 2.0]])
    covariances = [SPREAD, np.diag([1e-4, 4e-4, 1e-6])]
    drawn, moments = [], HitMoments(spec)
    points = np.array([[0.02, 0.02], [1.02, 0.02], [4.02, 4.02]])  # nothing was drawn at the last
    for k in range(2):
        moments.add(points[[k]], k)
        drawn.append(transported(covariances[k], -places[k][:2]))
    fit = LineFit(np.zeros(3), np.zeros((3, 3)), np.array([3.0, 1.0, 9.0]), points)
    pose = np.array([2.0, 3.0, 1.0])
    moved = [transported(P, pose[:2] - place[:2]) for P, place in zip(covariances, places, strict=True)]
    found = wall_covariance(drawn, moments, pose, fit)
    np.testing.assert_allclose(found, 0.75 * moved[0] + 0.25 * moved[1], atol=1e-12)
    assert not wall_covariance(drawn, moments, pose, LineFit(*(part[2:] for part in fit))).any()


def room_fit(rng, noise, shared):
    """A room's four walls seen from its middle, and the residuals at the weighted least-squares pose with its error.

    ``shared`` is an error that ten beams side by side have in common.
    """
    angle = np.linspace(-np.pi, np.pi, 400, endpoint=False)
    side = np.floor((angle + np.pi / 4) / (np.pi / 2)) * np.pi / 2
    normal = np.column_stack([np.cos(side), np.sin(side)])
    points = np.column_stack([np.cos(angle), np.sin(angle)]) * (2.0 / np.cos(angle - side))[:, None]
    twist = normal[:, 1] * points[:, 0] - normal[:, 0] * points[:, 1]
    jacobian, weight = np.column_stack([normal, twist]), np.linspace(0.2, 1.0, 400)
    error = noise * rng.standard_normal(400) + np.repeat(shared * rng.standard_normal(40), 10)
    H = jacobian.T @ (weight[:, None] * jacobian)
    pose_error = -np.linalg.solve(H, jacobian.T @ (weight * error))
    return LineFit(error + jacobian @ pose_error, jacobian, weight, points), pose_error


@pytest.mark.parametrize(("noise", "shared"), [(0.01, 0.0), (0.006, 0.008)])
def test_the_residuals_tell_how_well_the_lines_fix_a_pose(monkeypatch, noise, shared):
    """The sandwich formula against the spread of 1500 estimates, with noise of its own and errors of ten beams."""
    monkeypatch.setattr(covariance, "REPEATED", 0.0)
    rng = np.random.default_rng(2)
    fits, errors = zip(*(room_fit(rng, noise, shared) for _ in range(1500)), strict=True)
    claimed = np.mean([np.linalg.inv(line_information(fit)) for fit in fits], axis=0)
    np.testing.assert_allclose(np.diag(claimed), np.var(errors, axis=0), rtol=0.2)


def test_errors_that_neighbours_share_widen_the_covariance():
    rng = np.random.default_rng(3)
    own, common = (line_information(room_fit(rng, *sizes)[0]) for sizes in ((0.01, 0.0), (0.006, 0.008)))
    assert np.linalg.det(own) > 50.0 * np.linalg.det(common)


def test_along_a_bare_corridor_the_variance_is_that_of_odometry():
    measured, predicted = np.diag([1e-6, 1e-6, 1e-8]), np.diag([0.04, 0.01, 1e-4])
    found = with_silent_direction(measured, np.array([1.0, 0.0]), predicted)
    np.testing.assert_allclose(found, np.diag([0.04, 1e-6, 1e-8]), atol=1e-15)


def test_a_motion_adds_its_variance_and_turns_heading_into_place():
    motion, sigma = np.array([5.0, 0.0, 0.3]), np.diag([0.0, 0.0, 1e-4])
    found = predicted_covariance(sigma, np.zeros(3), motion, np.array([0.01, 0.02]))
    expected = [[0.01, 0, 0], [0, 0.01 + 25e-4, 5e-4], [0, 5e-4, 1e-4 + 0.02]]
    np.testing.assert_allclose(found, expected, atol=1e-15)


FEW = replace(SlamConfig.refined(), particles=20, every=10)


@pytest.fixture(scope="module")
def hall():
    return replace(load("hall"), camera=None)


@pytest.fixture(scope="module")
def result(hall):
    return run_slam(hall, FEW)


def position_sigma(result):
    return np.sqrt(result.covariances[:, 0, 0] + result.covariances[:, 1, 1])


@pytest.mark.slow
def test_covariances_are_proper_and_grow_on_the_way_out_and_shrink_on_the_way_back(result):
    assert result.covariances.shape == (len(result.trajectory), 3, 3)
    np.testing.assert_array_equal(result.covariances, result.covariances.transpose(0, 2, 1))
    assert not result.covariances[0].any()  # the first scan fixes the frame
    assert np.linalg.eigvalsh(result.covariances[1:]).min() > 0.0
    away = np.hypot(*result.trajectory.poses[:, :2].T)
    sigma, far = position_sigma(result), int(np.argmax(away))
    begin, back = (away < 0.5) & (np.arange(len(away)) < far), (away < 2.0) & (np.arange(len(away)) > far)
    assert back.any()
    assert sigma[far] > 3 * sigma[begin].max()
    assert sigma[back].mean() < sigma[far] / 2


def test_it_holds_the_truth_about_as_often_as_it_says(hall, result):
    found = covariance_consistency(result.infos, hall.truth)
    assert 0.7 <= found.inside[0.9] <= 1.0
    assert 0.5 <= found.nees.mean() <= 6.0
    assert np.isfinite(found.nees).all()


def test_blind_the_robot_knows_less_and_less_until_it_sees_again(hall):
    begin = hall.lidar.t[0]
    part = blind(first_seconds(hall, 48.0), 40.0, 45.0)
    infos = run_slam(part, FEW).infos
    sigma = np.sqrt([np.trace(info.covariance[:2, :2]) for info in infos])
    unseen = np.flatnonzero([begin + 40.0 < info.t < begin + 45.0 for info in infos])
    assert (np.diff(sigma[unseen[0] - 1 : unseen[-1] + 1]) > 0.0).all()
    assert sigma[unseen[-1]] > 3 * sigma[unseen[0] - 1]
    assert sigma[unseen[-1] + 3] < sigma[unseen[-1]] / 2


def test_a_scan_that_is_drawn_keeps_the_error_of_all_that_it_drew():
    """Moved to the world's origin, and numbered as the map's cells remember it."""
    for belief, info in slam_steps(drive([(1.0, 10, 0.4)]), replace(FEW, every=1), np.random.default_rng(0)):
        if info.drawn:
            expected = transported(info.covariance, -info.estimate[:2])
            np.testing.assert_array_equal(belief.map.drawn[-1], expected)
            assert belief.map.moments.first.max() == len(belief.map.drawn) - 1


def test_along_a_bare_corridor_odometry_leads_and_its_variance_adds_up():
    walls = np.array([[-9.0, 1.01, 9.0, 1.01], [-9.0, -1.01, 9.0, -1.01]])
    data = drive([(2.0, 12, 0.0)], walls, replace(LIDAR, range_max=3.0))
    result = run_slam(data, replace(FEW, every=1))
    expected = data.truth.at(result.trajectory.t)
    np.testing.assert_allclose(result.trajectory.poses[:, 0], expected[:, 0], atol=1e-9)
    assert (np.diff(result.covariances[:, 0, 0]) > 1e-4).all()
    assert result.covariances[:, 1, 1].max() < 1e-4


def test_without_lines_there_is_none():
    config = replace(RefinedConfig.of(SlamConfig.report()), particles=2)
    assert run_slam(drive([(1.0, 10, 0.4)]), config).covariances is None
    assert config.start().covariance is None
