"""Exercises of chapter 01: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
from notebook_cells import defined

from pfslam.teaching.checks_ch01 import check_gyro_bias, check_path_length


def from_notebook(tag, name):
    return defined("01", tag, check_path_length=check_path_length, check_gyro_bias=check_gyro_bias)[name]


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
