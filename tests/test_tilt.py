"""The lean of the body: signs by hand, a hand-made slope, a drive on the level, and beams that strike the floor."""

from dataclasses import replace

import numpy as np
import pytest

from pfslam.events import level_scan
from pfslam.io.datasets import load
from pfslam.motion import controls
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, Recording
from pfslam.refined.tilt import LEVEL_BELOW, SPEED_SMOOTHING, TIME_CONSTANT, estimate_tilt, upright
from pfslam.run import used_scans
from pfslam.sensors import STANDARD_GRAVITY, EncoderModel, LidarModel
from pfslam.slam import SlamConfig

T = np.arange(0.0, 20.0, 0.01)


def leaning(pitch=0.0, roll=0.0, speed=0.0, yaw_rate=0.0, bias=(0.0, 0.0, 0.0)):
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
@pytest.mark.parametrize(("axis", "other"), [("pitch", "roll"), ("roll", "pitch")])
def test_a_slope_is_followed_with_its_sign(axis, other, degrees):
    tilt = estimate_tilt(leaning(**{axis: slope(np.deg2rad(degrees))}, speed=MOVING))
    on_it = (T > 8.6) & (T < 13.9)
    # Gyro and accelerometer agree here; what is left comes from whole wheel counts: one count in 10 ms is 0.22 m/s,
    # smoothed over 0.1 s and averaged over 2 s.
    np.testing.assert_allclose(vars(tilt)[axis][on_it], np.deg2rad(degrees), atol=np.deg2rad(1.0))
    assert not vars(tilt)[other].any()


def test_speeding_up_and_turning_are_not_taken_for_slopes():
    """1 m/s^2 feels like 5.8 degrees, a turn at 1 m/s and 1 rad/s too: both are known from wheels and gyro."""
    speed = np.clip((T - 3.0) / 1.0, 0, 1)
    turning = np.where((T > 8.0) & (T < 12.0), 1.0, 0.0)
    tilt = estimate_tilt(leaning(0.0, speed=speed, yaw_rate=turning))
    assert not tilt.pitch.any()
    assert not tilt.roll.any()


def slow_tilt(recording):
    """The filter sample by sample, as its definition says."""
    wheels, imu = controls(recording), recording.imu
    still = [k for k in range(len(imu.t)) if imu.t[k] < recording.encoders.t[first_count(recording)]]
    bias = sum(imu.angular_velocity[k] for k in still) / len(still) if still else np.zeros(3)
    level = sum(imu.acceleration_g[k] for k in still) / len(still) if still else np.zeros(3)
    middles = 0.5 * (wheels.t[1:] + wheels.t[:-1])
    before, angles, rows = np.interp(imu.t[0], middles, wheels.v), np.zeros(2), []
    for k, t in enumerate(imu.t):
        dt = t - imu.t[k - 1] if k else 0.0
        speed = before + min(dt / SPEED_SMOOTHING, 1.0) * (np.interp(t, middles, wheels.v) - before)
        forward = (speed - before) / dt if dt > 1e-3 else 0.0
        sideways = speed * imu.angular_velocity[k, 2]
        gx, gy, gz = imu.acceleration_g[k] - [level[0], level[1], 0.0]
        felt = np.array(
            [
                np.arctan2(forward / STANDARD_GRAVITY - gx, gz),
                np.arctan2(gy - sideways / STANDARD_GRAVITY, gz),
            ]
        )
        rates = (imu.angular_velocity[k] - bias)[[1, 0]]
        share = min(dt / TIME_CONSTANT, 1.0)
        angles = (1 - share) * (angles + rates * dt) + share * felt
        rows.append(np.where(np.abs(angles) < LEVEL_BELOW, 0.0, angles))
        before = speed
    return np.array(rows)


def first_count(recording):
    return int(np.flatnonzero(recording.encoders.counts.any(axis=1))[0])


@pytest.mark.parametrize("begin", [0, 1100])  # with a standing start, and from the middle of the drive
def test_the_lean_is_its_definition_through_gaps_and_noise(begin):
    rng = np.random.default_rng(4)
    drive = leaning(slope(0.2), roll=slope(-0.15, 6.0, 12.0), speed=MOVING, yaw_rate=np.sin(T))
    kept = np.flatnonzero((rng.random(len(T)) < 0.7) & ~((T > 15.0) & (T < 18.5)))
    kept = kept[kept >= begin]
    noisy = Imu(
        T[kept],
        drive.imu.angular_velocity[kept] + rng.normal(0, 0.02, (len(kept), 3)),
        drive.imu.acceleration_g[kept] + rng.normal(0, 0.02, (len(kept), 3)),
    )
    wheels = Encoders(T[begin:], drive.encoders.counts[begin:])
    recording = replace(drive, encoders=wheels, imu=noisy)
    found = estimate_tilt(recording)
    np.testing.assert_allclose(np.column_stack([found.pitch, found.roll]), slow_tilt(recording), atol=1e-9)


@pytest.mark.parametrize("sensor", ["encoders", "imu"])
def test_no_tilt_without_both_wheels_and_gyro(sensor):
    """A log has the poses of its maker's odometry; one sensor beside them does not make a tilt."""
    odometry = Trajectory(T[[0, -1]], np.zeros((2, 3)))
    alone = {sensor: getattr(leaning(0.0), sensor)}
    assert estimate_tilt(Recording("log", odometry=odometry)) is None
    assert estimate_tilt(Recording("log", odometry=odometry, **alone)) is None


def test_floor_beams_are_left_out_and_wall_beams_are_levelled():
    """Nose down 20 degrees, LiDAR 0.5 m up: the beam ahead meets the floor after 0.5 / sin(20 deg) = 1.46 m."""
    lidar = LidarModel(angle_min=-np.pi / 2, angle_max=np.pi / 2, beams=3, position_b=(0.0, 0.0, 0.5))
    pitch, down = np.deg2rad(20.0), 0.5 / np.sin(np.deg2rad(20.0))
    points, beams, sensor, struck = level_scan(np.array([2.0, down, 2.0]), lidar, (pitch, 0.0), 0.1)
    assert (struck, beams.tolist()) == (1, [0, 2])
    assert level_scan(np.array([np.inf, down, 2.0]), lidar, (pitch, 0.0), 0.1)[1].tolist() == [2]
    # The LiDAR has moved forward by 0.5 sin(20 deg); beams to the sides stay level and keep their length.
    np.testing.assert_allclose(sensor, [0.5 * np.sin(pitch), 0.0], atol=1e-12)
    np.testing.assert_allclose(points, sensor + [[0.0, -2.0], [0.0, 2.0]], atol=1e-12)


def test_wheels_measure_along_a_slope_and_the_map_is_seen_from_above():
    config = replace(SlamConfig.refined(), every=20)
    flat, leans = (used_scans(load("ramp"), replace(config, tilt=tilt)) for tilt in (False, True))
    shorter = np.cos(leans.tilt[:, :1])
    assert shorter.min() < 0.95
    np.testing.assert_allclose(
        leans.motion, flat.motion * np.hstack([shorter, shorter, np.ones_like(shorter)])
    )
    for plain, event, share in zip(flat.events(), leans.events(), shorter, strict=True):
        np.testing.assert_allclose(event.controls[0], share * plain.controls[0])
    assert not used_scans(load("hall"), config).tilt.any()


@pytest.mark.parametrize("up", [(0, 0, 1), (0.6, 0, 0.8), (0, -1, 0), (0.1, 0.2, -0.95), (0, 0, -1)])
def test_a_mean_acceleration_of_one_g_is_turned_upwards(up):
    rotation, words = upright(np.array(up, float))
    np.testing.assert_allclose(rotation @ up, [0.0, 0.0, np.linalg.norm(up)], atol=1e-12)
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert rotation[1, 0] == 0.0  # no yaw
    lean = np.degrees(np.arccos(up[2] / np.linalg.norm(up)))
    assert f"leaning by {lean:.0f} deg" in words


def test_an_accelerometer_that_does_not_show_one_g_is_taken_for_upright():
    rotation, words = upright(np.array([0.1, 0.0, 0.3]))
    np.testing.assert_array_equal(rotation, np.eye(3))
    assert "0.32 g" in words
