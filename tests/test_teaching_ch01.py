"""What chapter 01 claims about steps and smoothing, on drives whose answers are known beforehand."""

import numpy as np
import pytest
from pfslam_book.ch01 import smoothed, smoothing_errors

from pfslam.motion import Controls, integrate, motion_model_arc


def turn(rest):
    """A second straight, a left turn by one radian in one second, then ``rest`` seconds straight, at 1 m/s."""
    t = np.arange(0.0, 2.0 + rest + 0.005, 0.01)
    return Controls(t, np.ones(len(t) - 1), np.where((t[1:] > 1.0) & (t[1:] <= 2.0), 1.0, 0.0))


def test_smoothing_keeps_the_heading_and_moves_the_corner():
    degrees, away = smoothing_errors(turn(rest=3.0), 0.5)
    assert degrees == pytest.approx(0.0, abs=1e-6)
    # Late by 0.25 s less a sample: the new corridor is driven 0.25 m further on, seen along the old one.
    assert away == pytest.approx(2.0 * 0.25 * np.sin(0.5), rel=0.1)


def test_no_smoothing_changes_nothing_and_a_cut_turn_is_short():
    inputs = turn(rest=0.0)
    np.testing.assert_allclose(smoothed(inputs, 0.0).omega, inputs.omega)
    degrees, _ = smoothing_errors(inputs, 0.5)
    assert degrees == pytest.approx(np.rad2deg(0.25), abs=0.5)


def test_the_corners_of_euler_steps_lie_on_a_circle_turned_by_half_a_step_and_hardly_larger():
    v, omega, tau, n = 1.0, 0.8, 0.5, 12
    inputs = Controls(tau * np.arange(n + 1), np.full(n, v), np.full(n, omega))
    euler, arc = integrate(inputs).poses[:, :2], integrate(inputs, model=motion_model_arc).poses[:, :2]
    half = omega * tau / 2
    turned = arc @ np.array(
        [[np.cos(half), -np.sin(half)], [np.sin(half), np.cos(half)]]
    )  # by -half, in rows
    np.testing.assert_allclose(euler, turned * half / np.sin(half), atol=1e-12)
