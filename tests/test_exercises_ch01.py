"""Exercises of chapter 01: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
import pytest
from notebook_cells import defined

from pfslam.motion import motion_model, motion_model_arc
from pfslam.teaching.ch01 import checks as checks_ch01
from pfslam.teaching.ch01.checks import check_arc, check_distance_between, check_gyro_bias, check_path_length
from pfslam.teaching.ch01.odometry import nearest


def from_notebook(tag, name):
    checks = {name: value for name, value in vars(checks_ch01).items() if name.startswith("check_")}
    return defined("01", tag, **checks)[name]


def test_path_length_stub_and_solution():
    assert check_path_length(from_notebook("exercise-1", "path_length")).verdict == "unanswered"
    assert check_path_length(from_notebook("solution-1", "path_length_solution"))


def test_path_length_hints():
    assert "added the wheels" in check_path_length(lambda counts, per_count: counts.sum() * per_count).message
    differenced = check_path_length(
        lambda counts, per_count: np.diff(counts, axis=0).mean(axis=1).sum() * per_count
    )
    assert "increment since" in differenced.message
    assert "in counts" in check_path_length(lambda counts, per_count: counts.mean(axis=1).sum()).message
    assert "ZeroDivisionError" in check_path_length(lambda counts, per_count: 1 / 0).message
    assert "expected 0.0990 m" in check_path_length(lambda counts, per_count: 0.5).message


def test_gyro_bias_stub_and_solution():
    assert check_gyro_bias(from_notebook("exercise-2", "gyro_bias")).verdict == "unanswered"
    assert check_gyro_bias(from_notebook("solution-2", "gyro_bias_solution"))


def test_gyro_bias_hints():
    assert "whole drive" in check_gyro_bias(lambda t, rate, speed: rate.mean()).message
    assert "warms up" in check_gyro_bias(lambda t, rate, speed: rate[t < 1.0].mean()).message
    assert "Leave them out" in check_gyro_bias(lambda t, rate, speed: rate[speed == 0].mean()).message
    assert "sign" in check_gyro_bias(lambda t, rate, speed: -rate[(speed == 0) & (t > 5)].mean()).message


def test_distance_between_stub_and_solution():
    assert check_distance_between(from_notebook("exercise-3", "distance_between")).verdict == "unanswered"
    assert check_distance_between(from_notebook("solution-3", "distance_between_solution"))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda t, each, scans: each[nearest(t, scans)][1:], "one reading for each scan"),
        (lambda t, each, scans: np.interp(scans, t, each)[1:], "one reading for each scan"),
        (lambda t, each, scans: np.diff(np.interp(scans, t, each)), "increments already"),
        (lambda t, each, scans: np.diff(np.cumsum(each)[nearest(t, scans)]), "Interpolate the sum"),
        (lambda t, each, scans: np.interp(scans, t, np.cumsum(each)), "since the start"),
        (lambda t, each, scans: 4 * np.diff(np.interp(scans, t, np.cumsum(each))), "added the wheels"),
        (lambda t, each, scans: np.diff(np.interp(scans, t, np.cumsum(each))) / 0.0022, "in counts"),
        (lambda t, each, scans: each, "39 distances"),
        (lambda t, each, scans: np.ones(39), "expected"),
        (lambda t, each, scans: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_distance_between_hints(answer, words):
    def wrong(t, counts, metres_per_count, t_scans):
        return answer(t, counts.mean(axis=1) * metres_per_count, t_scans)

    assert words in check_distance_between(wrong).message


def test_arc_stub_and_solution():
    assert check_arc(from_notebook("exercise-4", "arc_step")).verdict == "unanswered"
    assert check_arc(from_notebook("solution-4", "arc_step_solution"))
    assert check_arc(motion_model_arc)


def chord_step(length, direction):
    def step(pose, v, omega, dt):
        half = 0.5 * omega * dt
        way, angle = v * dt * length(half), pose[2] + direction * half
        return np.array([pose[0] + way * np.cos(angle), pose[1] + way * np.sin(angle), pose[2] + 2 * half])

    return step


def radius_step(pose, v, omega, dt):
    radius, end = v / omega, pose[2] + omega * dt
    return pose + [
        radius * (np.sin(end) - np.sin(pose[2])),
        radius * (np.cos(pose[2]) - np.cos(end)),
        omega * dt,
    ]


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (motion_model, "straight step"),
        (chord_step(np.sinc, 1.0), "by pi"),
        (chord_step(lambda half: 1.0, 1.0), "chord is shorter"),
        (chord_step(lambda half: np.sinc(half / np.pi), 0.0), "half way"),
        (chord_step(lambda half: np.sin(half) / half, 1.0), "divide by zero"),
        (radius_step, "divide by zero"),
        (lambda pose, v, omega, dt: pose[:2], "three numbers"),
        (lambda pose, v, omega, dt: pose, "heading should be"),
    ],
)
def test_arc_hints(answer, words):
    assert words in check_arc(answer).message
