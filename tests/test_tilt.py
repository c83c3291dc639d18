"""The lean of the body: signs by hand, a hand-made slope, a drive on the level, and beams that strike the floor."""

from dataclasses import replace

import numpy as np
import pytest

from pfslam.config import SlamConfig
from pfslam.events import level_scan, scan_events
from pfslam.metrics import trajectory_error
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, Recording
from pfslam.runs import run_slam
from pfslam.sensors import STANDARD_GRAVITY, EncoderModel, LidarModel
from pfslam.simulator import RAMP, simulate
from pfslam.tilt import TiltConfig, estimate_tilt, standing_start

CONFIG = TiltConfig()
T = np.arange(0.0, 20.0, 0.01)


def leaning(pitch, roll=0.0, speed=0.0, yaw_rate=0.0, bias=(0.0, 0.0, 0.0)):
    """A recording whose gyro and accelerometer show given angles (K,), speed (K,) and yaw rate (K,), exactly."""
    pitch, roll, speed, yaw_rate = (
        np.broadcast_to(np.asarray(a, float), T.shape) for a in (pitch, roll, speed, yaw_rate)
    )
    metres = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(T))])
    counts = np.diff(np.rint(metres / EncoderModel().metres_per_count), prepend=0.0).astype(int)
    # Nose down turns x below the horizon: gravity's reaction, which points up, then has a share against x.
    gravity = np.column_stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
    own = np.column_stack([np.gradient(speed, T), speed * yaw_rate, np.zeros_like(T)]) / STANDARD_GRAVITY
    rates = np.column_stack([np.gradient(roll, T), np.gradient(pitch, T), yaw_rate]) + bias
    return Recording(
        "lean", encoders=Encoders(T, np.tile(counts[:, None], (1, 4))), imu=Imu(T, rates, gravity + own)
    )


def slope(angle, begin=8.0, end=14.0, over=0.5):
    """Level, then leaning by an angle, then level again, with ramps of ``over`` seconds."""
    return angle * (np.clip((T - begin) / over, 0, 1) - np.clip((T - end) / over, 0, 1))


MOVING = np.clip((T - 3.0) / 1.0, 0.0, 1.0)  # still for three seconds, then 1 m/s


@pytest.mark.parametrize("degrees", [-15.0, 6.0, 15.0])
def test_a_slope_is_followed_with_its_sign(degrees):
    tilt = estimate_tilt(leaning(slope(np.deg2rad(degrees)), speed=MOVING), CONFIG)
    on_it = (T > 8.6) & (T < 13.9)
    # Gyro and accelerometer agree here; what is left comes from whole wheel counts: one count in 10 ms is 0.22 m/s,
    # smoothed over 0.1 s and averaged over 2 s.
    np.testing.assert_allclose(tilt.pitch[on_it], np.deg2rad(degrees), atol=np.deg2rad(1.0))
    assert not tilt.roll.any()


def test_roll_has_its_own_sign():
    tilt = estimate_tilt(leaning(0.0, roll=slope(np.deg2rad(10.0)), speed=MOVING), CONFIG)
    on_it = (T > 8.6) & (T < 13.9)
    np.testing.assert_allclose(tilt.roll[on_it], np.deg2rad(10.0), atol=np.deg2rad(1.0))
    assert not tilt.pitch.any()


def test_speeding_up_and_turning_are_not_taken_for_slopes():
    """1 m/s^2 feels like 5.8 degrees, a turn at 1 m/s and 1 rad/s too: both are known from wheels and gyro."""
    speed = np.clip((T - 3.0) / 1.0, 0, 1)
    turning = np.where((T > 8.0) & (T < 12.0), 1.0, 0.0)
    tilt = estimate_tilt(leaning(0.0, speed=speed, yaw_rate=turning), CONFIG)
    assert not tilt.pitch.any()
    assert not tilt.roll.any()


def test_a_crooked_accelerometer_and_a_gyro_bias_are_learnt_at_the_standing_start():
    crooked = leaning(0.0, speed=MOVING, bias=(0.01, -0.01, 0.0))
    crooked = replace(
        crooked, imu=replace(crooked.imu, acceleration_g=crooked.imu.acceleration_g + [0.03, -0.03, 0.0])
    )
    tilt = estimate_tilt(crooked, CONFIG)
    assert not tilt.pitch.any()
    assert not tilt.roll.any()
    # Without the standing start the same offsets, 1.7 degrees each way plus the bias over the time constant, show.
    assert estimate_tilt(replace(crooked, encoders=_moving_from_the_start(crooked)), CONFIG).pitch.any()


def _moving_from_the_start(recording):
    counts = recording.encoders.counts.copy()
    counts[:2] = 5
    return replace(recording.encoders, counts=counts)


def test_standing_start_ends_with_the_first_count():
    still = standing_start(leaning(0.0, speed=MOVING))
    assert 3.0 <= T[still][-1] < 3.2  # the first count falls due soon after the start at 3 s
    assert still[: np.count_nonzero(still)].all()


def test_no_imu_no_tilt():
    log = Recording("log", odometry=Trajectory([0.0, 1.0], np.zeros((2, 3))))
    assert estimate_tilt(log, CONFIG) is None


def test_floor_beams_are_left_out_and_wall_beams_are_levelled():
    """Nose down 20 degrees, LiDAR 0.5 m up: the beam ahead meets the floor after 0.5 / sin(20 deg) = 1.46 m."""
    lidar = LidarModel(angle_min=-np.pi / 2, angle_max=np.pi / 2, beams=3, position_b=(0.0, 0.0, 0.5))
    pitch, down = np.deg2rad(20.0), 0.5 / np.sin(np.deg2rad(20.0))
    points, beams, sensor, struck = level_scan(np.array([2.0, down, 2.0]), lidar, (pitch, 0.0), 0.1)
    assert (struck, beams.tolist()) == (1, [0, 2])
    # The LiDAR has moved forward by 0.5 sin(20 deg); beams to the sides stay level and keep their length.
    np.testing.assert_allclose(sensor, [0.5 * np.sin(pitch), 0.0], atol=1e-12)
    np.testing.assert_allclose(points, sensor + [[0.0, -2.0], [0.0, 2.0]], atol=1e-12)


def test_a_flat_recording_is_untouched():
    recording = simulate("hall").recording
    with_tilt, without = (
        replace(SlamConfig.refined(), every=200, tilt=tilt) for tilt in (TiltConfig(), None)
    )
    for a, b in zip(scan_events(recording, with_tilt)[0], scan_events(recording, without)[0], strict=True):
        np.testing.assert_array_equal(a.points_b, b.points_b)
        assert a.struck_floor == 0


def test_slopes_are_driven_better_with_the_tilt_than_without():
    recording = simulate(RAMP).recording
    config = replace(SlamConfig.refined(), particles=5, every=10)
    errors, struck = {}, {}
    for name, tilt in (("with", TiltConfig()), ("without", None)):
        result = run_slam(recording, replace(config, tilt=tilt))
        errors[name] = trajectory_error(result.trajectory, recording.truth).ate_rmse_m
        struck[name] = result.dropped.get("beams that struck the floor", 0)
    assert struck["with"] > 0 == struck["without"]
    # The LiDAR stands 0.51 m up: 10 to 20 degrees carry it 0.09 to 0.18 m to the front, seen from above.
    assert errors["with"] < 0.5 * errors["without"]
