"""Odometry and the motion model: drives whose end is known, and the real one."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rooms import COUNT, CURVES, SQUARE, drive

import pfslam
from pfslam.errors import DataError
from pfslam.io.jumps import jumps
from pfslam.motion import (
    Controls,
    controls,
    dead_reckoning,
    integrate,
    motion_model,
    motion_model_arc,
    wheel_distance,
    wheel_speed,
)
from pfslam.poses import Trajectory, between, compose, wrap_angle
from pfslam.recording import Encoders, Imu, Recording
from pfslam.sensors import EncoderModel, ImuModel, RobotModel

ROUND_OFF = 1e-9


def assert_same_poses(found, expected, atol):
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=atol)
    np.testing.assert_allclose(wrap_angle(found[:, 2] - expected[:, 2]), 0.0, atol=atol)


def test_euler_step_by_hand():
    # Facing +y at 2 m/s for half a second, turning by 0.6 rad: one metre up. Eq. 5.
    np.testing.assert_allclose(
        motion_model(np.array([1.0, 1.0, np.pi / 2]), 2.0, 1.2, 0.5), [1.0, 2.0, np.pi / 2 + 0.6]
    )


@pytest.mark.parametrize("step", [motion_model, motion_model_arc])
def test_heading_is_wrapped_on_both_sides(step):
    assert step(np.array([0, 0, 3.1]), 0.0, 1.0, 0.1)[2] == pytest.approx(3.2 - 2 * np.pi)
    assert step(np.array([0, 0, -3.1]), 0.0, -1.0, 0.1)[2] == pytest.approx(2 * np.pi - 3.2)


def test_arc_step_is_the_circle():
    # A quarter of a circle of radius 2 from the origin facing +x ends at (2, 2) facing +y.
    np.testing.assert_allclose(motion_model_arc(np.zeros(3), 2.0, 1.0, np.pi / 2), [2.0, 2.0, np.pi / 2])


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3), st.floats(1e-6, 0.5))
def test_euler_approaches_the_arc_with_the_square_of_the_interval(v, omega, theta, dt):
    # Taylor: both agree to first order; what is left is at most |v omega| dt^2 / 2 plus higher terms, below
    # |v omega| dt^2.
    start = np.array([0.0, 0.0, theta])
    difference = motion_model(start, v, omega, dt) - motion_model_arc(start, v, omega, dt)
    assert np.hypot(*difference[:2]) <= abs(v * omega) * dt**2 + 1e-14
    assert difference[2] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("epoch", [0.0, 1.4e9])
def test_without_noise_dead_reckoning_is_the_truth(epoch):
    # Lines and turns on the spot: the Euler step is exact. A stamp of 1.4e9 s has steps of 2.4e-7 s: 480 of
    # 0.5 m/s each.
    recording = drive(SQUARE, epoch=epoch)
    found = dead_reckoning(recording)
    np.testing.assert_array_equal(found.t, recording.truth.t)
    assert_same_poses(found.poses, recording.truth.poses, ROUND_OFF if epoch == 0 else 480 * 2.4e-7)
    assert abs(found.poses[-1, 2]) == pytest.approx(np.pi, abs=1e-4)


def test_without_noise_exact_arcs_are_the_truth_on_curves():
    recording = drive(CURVES)
    assert_same_poses(
        integrate(controls(recording), model=motion_model_arc).poses, recording.truth.poses, ROUND_OFF
    )
    euler = integrate(controls(recording)).poses
    # Every step is off by at most |v omega| dt^2 / 2: 360 steps of 0.4 m/s, 0.8 rad/s, 12.5 ms.
    assert_same_poses(euler, recording.truth.poses, 360 * 0.5 * 0.4 * 0.8 * 0.0125**2)


def test_integration_is_the_motion_model_applied_step_after_step():
    recording = drive(CURVES)
    inputs, pose = controls(recording), np.array([1.0, 2.0, 3.0])
    for model in (motion_model, motion_model_arc):
        expected = [pose]
        for v, omega, dt in zip(inputs.v, inputs.omega, np.diff(inputs.t), strict=True):
            expected.append(model(expected[-1], v, omega, dt))
        assert_same_poses(integrate(inputs, pose, model).poses, np.array(expected), ROUND_OFF)


def by_hand(t_wheels, t_gyro, yaw_rates):
    """A robot that stands, with a gyro that reads ``yaw_rates`` at its stamps."""
    rates = np.zeros((len(t_gyro), 3))
    rates[:, 2] = yaw_rates
    wheels = Encoders(np.array(t_wheels), np.zeros((len(t_wheels), 4)))
    return Recording("by hand", RobotModel(), wheels, Imu(np.array(t_gyro), rates, rates))


def test_gyro_sample_speaks_for_the_interval_that_ends_at_it():
    """The first, of 100 rad/s, ends an interval that nobody saw."""
    recording = by_hand([0.0, 3.0], [0.0, 1.0, 2.0, 3.0], [100.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(dead_reckoning(recording).poses[:, 2], wrap_angle([0.0, 1.0, 3.0, 6.0]))


def test_only_gyro_samples_within_the_encoders_time_are_used():
    recording = by_hand([1.0, 2.0, 3.0], [0.5, 1.5, 2.0, 2.5, 3.5], np.zeros(5))
    np.testing.assert_array_equal(controls(recording).t, [1.5, 2.0, 2.5])
    with pytest.raises(DataError, match="by hand: imu time_stamps"):
        dead_reckoning(by_hand([0.0, 1.0], [5.0, 6.0], np.zeros(2)))


def test_calibration_enters_dead_reckoning():
    # 0.75 % more metres per count is 0.75 % more path; the gyro's bias is taken off.
    straight = replace(drive([(4.0, 10, 0.0)]), lidar=None)
    longer = replace(straight, robot=RobotModel(encoders=EncoderModel(1.0075 * COUNT.metres_per_count)))
    assert dead_reckoning(longer).poses[-1, 0] == pytest.approx(1.0075 * 1.6)
    biased = replace(straight, robot=RobotModel(encoders=COUNT, imu=ImuModel(gyro_bias=0.01)))
    assert dead_reckoning(biased).poses[-1, 2] == pytest.approx(-0.01 * 4.0)


@given(st.integers(0, 2**32 - 1))
def test_distance_is_conserved_whatever_the_clocks_do(seed):
    # Counts are exact, stamps jitter: the speeds times their intervals add up to all counts after the first.
    # Eq. 19.
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.003, 0.068, 200))
    counts = rng.integers(-5, 60, (200, 4))
    stamps = np.concatenate([[t[0]], np.sort(rng.uniform(t[0], t[-1], 300)), [t[-1]]])
    stamps = np.unique(stamps)
    speed = wheel_speed(Encoders(t, counts), EncoderModel(), stamps)
    assert np.sum(speed * np.diff(stamps)) == pytest.approx(counts[1:].sum() / 4 * 0.0022)


def test_wheel_speed_by_hand():
    encoders = Encoders(
        np.array([0.0, 1.0, 2.0]), np.array([[9, 9, 9, 9], [100, 200, 300, 400], [0, 0, 0, 1000]])
    )
    np.testing.assert_allclose(
        wheel_distance(encoders, EncoderModel(0.01), [0.0, 0.5, 1.0, 2.0]), [0.0, 1.25, 2.5, 5.0]
    )
    np.testing.assert_allclose(wheel_speed(encoders, EncoderModel(0.01), [0.5, 1.5]), [2.5])


def test_distance_outside_the_encoders_time_is_refused():
    encoders = Encoders(np.array([1.0, 2.0]), np.zeros((2, 4)))
    for t in ([0.9, 1.5], [1.5, 2.1]):
        with pytest.raises(DataError, match="wheel_distance"):
            wheel_distance(encoders, EncoderModel(), t)


@given(st.lists(st.floats(0.0, 3.0), min_size=2, max_size=8, unique=True))
def test_controls_of_adjoining_times_add_up_to_the_whole(times):
    inputs = Controls(np.array([0.0, 0.7, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]))
    cuts = sorted({0.0, 3.0, *times})
    parts = [inputs.during(a, b) for a, b in pairwise(cuts)]
    assert sum(float(v @ dt) for v, _, dt in parts) == pytest.approx(1 * 0.7 + 2 * 1.3 + 3 * 1.0)
    assert sum(float(omega @ dt) for _, omega, dt in parts) == pytest.approx(4 * 0.7 + 5 * 1.3 + 6 * 1.0)


def test_log_of_odometry_poses_starts_at_the_origin():
    log = Recording(
        "log", odometry=Trajectory([0.0, 1.0, 2.0], [[5, 5, np.pi / 2], [5, 6, np.pi / 2], [4, 6, np.pi]])
    )
    np.testing.assert_allclose(
        dead_reckoning(log).poses, [[0, 0, 0], [1, 0, 0], [1, 1, np.pi / 2]], atol=1e-15
    )
    np.testing.assert_allclose(controls(log).omega, [0.0, np.pi / 2])


def arc(count=200, seconds=0.05):
    """A robot that drives 0.8 m/s along a circle, to the left."""
    inputs = Controls(seconds * np.arange(count), np.full(count - 1, 0.8), np.full(count - 1, 0.3))
    return integrate(inputs, (2.0, 1.0, 0.5))


def set_to(path, k, pose):
    """The odometry of a robot whose node starts again at reading ``k``, from ``pose``."""
    poses = path.poses.copy()
    poses[k:] = compose(pose, between(poses[k], poses[k:]))
    return Trajectory(path.t, poses)


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (-50.0, 3.0, 3.0)])
def test_an_odometry_that_jumps_goes_on_from_where_it_was_once_it_is_loaded(pose, tmp_path):
    """It was set anew twice: the two steps are missing, all others are there."""
    path = arc()
    twice = set_to(set_to(path, 80, pose), 120, (9.0, 9.0, -2.0))
    assert np.flatnonzero(jumps(twice)).tolist() == [79, 119]
    pfslam.save(Recording("log", odometry=twice), tmp_path / "log.npz")
    log = pfslam.load(tmp_path / "log.npz")
    assert log.dropped == {"jumps of the odometry": 2}
    found, step = dead_reckoning(log).poses, between(path.poses[:-1], path.poses[1:])
    step[[79, 119]] = 0.0
    assert_same_poses(between(found[:-1], found[1:]), step, ROUND_OFF)
    np.testing.assert_allclose(found[0], 0.0, atol=ROUND_OFF)
    np.testing.assert_allclose(controls(log).v[[79, 119]], 0.0, atol=ROUND_OFF)
    np.testing.assert_allclose(np.delete(controls(log).v, [79, 119]), 0.8, rtol=1e-3)


def test_short_steps_and_slow_ones_are_no_jumps():
    """A quarter of a metre within a hundredth of a second is a stamp that came late; two metres in a second a drive."""
    poses = np.array([[0, 0, 0], [0.25, 0, 0], [2.25, 0, 0], [2.25, 0, 3.0]])
    assert not jumps(Trajectory([0.0, 0.01, 1.01, 1.02], poses)).any()
    assert jumps(Trajectory([0.0, 0.01, 0.11, 0.12], poses)).tolist() == [False, True, False]


@pytest.mark.parametrize("rate", [50.0, 20.0, 8.0, 5.0])
@pytest.mark.parametrize("metres", [0.5, 1.0, 1.2, 3.0])
def test_a_jump_is_one_at_any_rate(rate, metres):
    """At five a second a robot that brakes or speeds up with 1 g comes 0.2 m farther than one that does not."""
    t = np.arange(0.0, 10.0, 1.0 / rate)
    path = Trajectory(t, np.column_stack([0.8 * t, 0.0 * t, 0.0 * t]))
    assert not jumps(path).any()
    k = len(t) // 2
    assert np.flatnonzero(jumps(set_to(path, k, (0.8 * t[k] + metres, 0.0, 0.0)))).tolist() == [k - 1] * (
        metres > 0.3 + 0.5 * 9.81 / rate**2
    )


@pytest.mark.parametrize("rate", [50.0, 8.0, 4.0, 2.0, 1.0])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_robot_that_hurries_does_not_jump(rate, backwards):
    """From rest to 10 m/s with half a g, or from there to rest; a log may begin in the middle of it."""
    t = np.arange(-2.0, 2.001, 1.0 / rate)
    way = 0.25 * 9.81 * np.maximum(t, 0.0) ** 2
    way = way[::-1] if backwards else way
    for begin in range(len(t) - 1):
        poses = np.column_stack([way, 0.0 * t, 0.0 * t])[begin:]
        assert not jumps(Trajectory(t[begin:], poses)).any()


def test_two_odometries_on_one_topic_jump_to_and_fro_for_as_long_as_they_like():
    """Five metres, fifty times a second, for a minute: the robot is not thought to be faster and faster."""
    t = 0.02 * np.arange(3000)
    poses = np.column_stack([5.0 * (np.arange(3000) % 2), 0.0 * t, 0.0 * t])
    assert jumps(Trajectory(t, poses)).all()
