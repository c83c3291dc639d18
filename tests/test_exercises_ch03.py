"""Exercises of chapter 03, and the two things that its pictures rest on."""

import numpy as np
import pytest
from notebook_cells import defined

from pfslam.motion import Controls, motion_model
from pfslam.particles import ControlNoise, Particles, predict
from pfslam.poses import average_pose, wrap_angle
from pfslam.teaching.ch03 import mean as ch03_mean
from pfslam.teaching.ch03 import models as ch03_models
from pfslam.teaching.ch03.checks import check_heading_spread, check_mean_pose, check_predict
from pfslam.teaching.ch03.cloud import fan
from pfslam.teaching.ch03.corridor import STEP, corridor_walk, predict_belief, update_belief


def from_notebook(tag, name):
    return defined("03", tag, motion_model=motion_model)[name]


def test_heading_spread_stub_and_solution():
    assert check_heading_spread(from_notebook("exercise-1", "spread_of_heading")).verdict == "unanswered"
    assert check_heading_spread(from_notebook("solution-1", "spread_of_heading_solution"))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda sigma, rate, seconds: np.rad2deg(sigma * seconds), "a bias"),
        (lambda sigma, rate, seconds: np.rad2deg(sigma * np.sqrt(seconds)), "where is the sample rate"),
        (lambda sigma, rate, seconds: sigma * np.sqrt(seconds / rate), "in radians"),
        (lambda sigma, rate, seconds: np.rad2deg(np.sqrt(sigma * seconds / rate)), "for a variance"),
        (lambda sigma, rate, seconds: "wide", "One number"),
        (lambda sigma, rate, seconds: 1.0, "expected 4.584 degrees"),
    ],
)
def test_heading_spread_hints(answer, words):
    assert words in check_heading_spread(answer).message


def test_predict_stub_and_solution():
    assert check_predict(from_notebook("exercise-2", "my_predict")).verdict == "unanswered"
    assert check_predict(from_notebook("solution-2", "my_predict_solution"))


def one_draw(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    return motion_model(poses, v + rng.normal(0, sigma_v), omega + rng.normal(0, sigma_omega), dt)


def jitter_on_the_pose(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    noise = [sigma_v, sigma_v, sigma_omega] * rng.standard_normal(poses.shape)
    return motion_model(poses, v, omega, dt) + dt * noise


def variance_for_deviation(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    n = len(poses)
    return motion_model(poses, v + rng.normal(0, sigma_v**2, n), omega + rng.normal(0, sigma_omega**2, n), dt)


def no_noise(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    return motion_model(poses, v, omega, dt)


def in_place(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    poses += 1.0
    return poses


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (one_draw, "one number for the whole cloud"),
        (jitter_on_the_pose, "sideways"),
        (variance_for_deviation, "taken for a variance"),
        (no_noise, "dead reckoning"),
        (in_place, "changes the poses"),
        (lambda *arguments: arguments[0][0], "shape"),
        (lambda poses, v: poses, "TypeError"),
    ],
)
def test_predict_hints(answer, words):
    assert words in check_predict(answer).message


def test_mean_pose_stub_and_solution():
    assert check_mean_pose(from_notebook("exercise-3", "mean_pose")).verdict == "unanswered"
    assert check_mean_pose(from_notebook("solution-3", "mean_pose_solution"))


def with_heading(heading):
    return lambda poses, w: np.array(
        [*(w @ poses[:, :2]), heading(np.sin(poses[:, 2]), np.cos(poses[:, 2]), w)]
    )


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda poses, w: w @ poses, "mean of the numbers"),
        (lambda poses, w: poses[np.argmax(w)], "heaviest particle"),
        (with_heading(lambda sin, cos, w: np.arctan((w @ sin) / (w @ cos))), "Use arctan2"),
        (with_heading(lambda sin, cos, w: np.arctan2(w @ cos, w @ sin)), "the sine first"),
        (with_heading(lambda sin, cos, w: np.arctan2(sin.mean(), cos.mean())), "without the weights"),
        (with_heading(lambda sin, cos, w: np.rad2deg(np.arctan2(w @ sin, w @ cos))), "in radians"),
        (with_heading(lambda sin, cos, w: 1.0), "yours is 1.000"),
        (lambda poses, w: average_pose(poses), "Weigh them"),
        (lambda poses, w: poses.mean(axis=0), "each is one sum"),
        (lambda poses, w: poses, "three numbers"),
        (lambda poses: poses, "TypeError"),
    ],
)
def test_mean_pose_hints(answer, words):
    assert words in check_mean_pose(answer).message


def test_noise_models_differ_where_the_chapter_says_so():
    spread = {
        (drive, model): ch03_models.widths(ch03_models.model_cloud(drive, model)[-1], np.zeros(3))
        for drive in ch03_models.DRIVES
        for model in ch03_models.MODELS
    }
    assert spread["straight", "own share"]["heading"] == pytest.approx(0.0, abs=1e-9)
    assert spread["standing", "with motion"]["ahead"] == pytest.approx(0.0, abs=1e-9)
    expected = np.rad2deg(ch03_models.SIGMA_OMEGA * np.sqrt(ch03_models.TAU * 60.0))
    assert spread["standing", "constant"]["heading"] == pytest.approx(expected, rel=0.15)
    assert spread["standing", "on x and y"]["across"] == pytest.approx(0.04 * np.sqrt(600), rel=0.15)


def test_the_mean_of_two_corridors_is_in_neither():
    poses, weights = ch03_mean.two_corridors()
    middle = weights @ poses[:, 1]
    assert min(abs(middle - y) for y in ch03_mean.CORRIDOR_Y) > 1.0


@pytest.mark.parametrize("per_root_second", [False, True])
def test_the_fan_is_predict_control_after_control(per_root_second):
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.005, 0.02, 301))
    inputs = Controls(t, rng.uniform(0, 1, 300), rng.uniform(-1, 1, 300))
    noise = ControlNoise(0.3, 0.2, per_root_second)
    paths = fan(inputs, noise, 4, np.random.default_rng(0))
    particles, rng = Particles.at(np.zeros(3), 4), np.random.default_rng(0)
    for v, omega, dt in zip(inputs.v, inputs.omega, np.diff(inputs.t), strict=True):
        particles = predict(particles, v, omega, dt, noise, rng)
    np.testing.assert_allclose(paths[-1, :, :2], particles.poses[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap_angle(paths[-1, :, 2] - particles.poses[:, 2]), 0.0, atol=1e-9)


def test_a_belief_stays_a_probability():
    for moment in corridor_walk():
        assert moment.belief.sum() == pytest.approx(1.0)
        assert (moment.belief >= 0).all()


def test_bayes_by_hand_on_three_cells():
    moved = predict_belief(np.array([1.0, 0.0, 0.0]), STEP)
    np.testing.assert_allclose(moved, [0.1, 0.8, 0.1])
    np.testing.assert_allclose(update_belief(moved, np.array([0.5, 0.0, 1.0])), [1 / 3, 0.0, 2 / 3])
