"""The lean of the body: signs by hand, a hand-made slope, a drive on the level, and beams that strike the floor."""

from dataclasses import replace

import numpy as np
import pytest

from pfslam.io.datasets import load
from pfslam.io.upright import upright
from pfslam.motion import controls
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, Recording
from pfslam.refined.events import level_scan
from pfslam.refined.tilt import LEVEL_BELOW, SPEED_SMOOTHING, TIME_CONSTANT, estimate_tilt, standing_start
from pfslam.sensors import STANDARD_GRAVITY, EncoderModel, LidarModel
from pfslam.slam import SlamConfig

T = np.arange(0.0, 20.0, 0.01)


def leaning(pitch=0.0, roll=0.0, speed=0.0, yaw_rate=0.0, bias=(0.0, 0.0, 0.0), shown=(0.0, 0.0, 0.0)):
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
    encoders = Encoders(T, np.tile(counts[:, None], (1, 4)))
    return Recording("lean", encoders=encoders, imu=Imu(T, rates, gravity + own + np.array(shown)))


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
    still = [k for k in range(len(imu.t)) if imu.t[k] <= stood_until(recording)]
    still = still if still and imu.t[still[-1]] - imu.t[0] >= TIME_CONSTANT else []
    bias = (
        sum(imu.angular_velocity[k] for k in still) / len(still)
        if still
        else np.median(imu.angular_velocity, 0)
    )
    level = sum(imu.acceleration_g[k] for k in still) / len(still) if still else np.zeros(3)
    middles = 0.5 * (wheels.t[1:] + wheels.t[:-1])
    before, turned, said, rows = np.interp(imu.t[0], middles, wheels.v), np.zeros(2), [], []
    for k, t in enumerate(imu.t):
        dt = t - imu.t[k - 1] if k else 0.0
        speed = before + min(dt / SPEED_SMOOTHING, 1.0) * (np.interp(t, middles, wheels.v) - before)
        forward = (speed - before) / dt if dt > 1e-3 else 0.0
        sideways = speed * imu.angular_velocity[k, 2]
        gx, gy, gz = imu.acceleration_g[k] - [level[0], level[1], 0.0]
        pushes = [forward / STANDARD_GRAVITY - gx, gy - sideways / STANDARD_GRAVITY]
        felt = np.arctan2(pushes, gz)
        rates = (imu.angular_velocity[k] - bias)[[1, 0]]
        turned = turned + rates * dt
        if imu.t[k] < imu.t[0] + TIME_CONSTANT and not still:
            said.append(felt - turned)  # of the lean in the beginning
        rows.append((dt, rates, felt))
        before = speed
    angles, found = np.median(said, axis=0) if said else np.zeros(2), []
    for dt, rates, felt in rows:
        share = min(dt / TIME_CONSTANT, 1.0)
        angles = (1 - share) * (angles + rates * dt) + share * felt
        found.append(np.where(np.abs(angles) < LEVEL_BELOW, 0.0, angles))
    return np.array(found)


def stood_until(recording):
    """The stamp of the last reading before the first that holds counts, the very first left out."""
    encoders = recording.encoders
    return next(encoders.t[k - 1] for k in range(1, len(encoders.t)) if encoders.counts[k].any())


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


def cut(recording, begin):
    """The recording from a time on, with one reading of the wheels before it, as a part of a drive has it."""
    first = max(int(np.searchsorted(T, begin, side="right")) - 1, 0)
    later = begin <= T
    wheels = Encoders(T[first:], recording.encoders.counts[first:])
    imu = Imu(T[later], recording.imu.angular_velocity[later], recording.imu.acceleration_g[later])
    return replace(recording, encoders=wheels, imu=imu)


def test_a_standing_start_is_known_to_stand_and_lasts():
    drive = leaning(speed=MOVING)
    moving = float(T[np.flatnonzero(drive.encoders.counts.any(axis=1))[0] - 1])  # not before this reading
    np.testing.assert_array_equal(T[standing_start(drive)], T[moving >= T])
    for begin in (0.5, 0.9):  # what the cut leaves of it
        part = cut(drive, begin)
        np.testing.assert_array_equal(part.imu.t[standing_start(part)], T[(begin <= T) & (moving >= T)])
    for begin in (moving - TIME_CONSTANT + 0.02, 2.9, 5.0, 7.503, 12.0, 19.9):
        assert not standing_start(cut(drive, begin)).any()


def test_before_the_first_reading_of_the_wheels_nothing_is_known_of_rest():
    """An IMU that is switched on first: the robot is carried to its place, put down, and stands for 3 s."""
    drive = leaning(speed=np.clip((T - 8.0) / 1.0, 0.0, 1.0))
    later = T >= 5.0
    rates, felt = drive.imu.angular_velocity.copy(), drive.imu.acceleration_g.copy()
    rates[~later], felt[~later] = 0.5, [0.5, 0.5, 0.5]
    counts = drive.encoders.counts.copy()
    counts[np.flatnonzero(later)[0]] = 7  # of the time before the first reading
    carried = replace(drive, encoders=Encoders(T[later], counts[later]), imu=Imu(T, rates, felt))
    still = T[standing_start(carried)]
    assert still.min() == T[later][0]
    assert 7.9 < still.max() < 8.2
    late = replace(carried, encoders=Encoders(T[T >= 7.0], drive.encoders.counts[T >= 7.0]))
    assert not standing_start(late).any()


def test_a_robot_that_never_moves_stands_as_long_as_its_wheels_say_so():
    drive = leaning()
    wheels = Encoders(T[:600], drive.encoders.counts[:600])
    np.testing.assert_array_equal(standing_start(replace(drive, encoders=wheels)), np.arange(len(T)) < 600)


@pytest.mark.parametrize("begin", np.arange(4.0, 17.0, 0.7).tolist())
def test_a_part_of_a_drive_leans_as_the_whole_of_it(begin):
    """Wherever it begins, on the slope too, and with a gyro that drifts and an accelerometer that is swayed."""
    sway = np.column_stack([np.sin(40.0 * T), np.cos(33.0 * T), np.zeros(len(T))])
    angle = slope(np.deg2rad(12.0), 8.0, 12.0)
    drive = leaning(angle, speed=MOVING, bias=(0.02, -0.02, 0.0), shown=0.05 * sway)
    tilt = estimate_tilt(cut(drive, begin))
    settled = tilt.t > begin + 0.2
    wrong = np.abs(tilt.pitch - np.interp(tilt.t, T, angle))
    # Below LEVEL_BELOW nothing is told; wheel counts and sway leave a degree.
    assert np.rad2deg(wrong[settled]).max() < 2.5 + 1.5
    assert np.rad2deg(np.sqrt(np.mean(wrong[settled] ** 2))) < 1.5
    assert not tilt.roll.any()


@pytest.mark.parametrize("begin", [0.0, 9.0])
@pytest.mark.parametrize("yaw_axis", [0, 1])
def test_the_lean_does_not_depend_on_the_order_of_the_columns(yaw_axis, begin):
    """Columns z, x, y or y, z, x in the place of x, y, z give the same to the last bit, in any layout of memory."""
    rng = np.random.default_rng(1)
    drive = leaning(slope(0.2), roll=slope(-0.15, 6.0, 12.0), speed=MOVING, yaw_rate=np.sin(T))
    drive = cut(
        replace(drive, imu=Imu(T, *(v + rng.normal(0, 0.01, v.shape) for v in vectors(drive.imu)))), begin
    )
    order = {0: [2, 0, 1], 1: [1, 2, 0]}[yaw_axis]
    robot = replace(drive.robot, imu=replace(drive.robot.imu, yaw_axis=yaw_axis))
    for laid_out in (np.ascontiguousarray, np.asfortranarray):
        imu = Imu(drive.imu.t, *(laid_out(v[:, order]) for v in vectors(drive.imu)))
        other = replace(drive, imu=imu, robot=robot)
        for name in ("pitch", "roll"):
            found, same = (getattr(estimate_tilt(r), name) for r in (drive, other))
            assert found.any()
            np.testing.assert_array_equal(found, same)
        np.testing.assert_array_equal(*(controls(r).omega for r in (drive, other)))


def vectors(imu):
    return imu.angular_velocity, imu.acceleration_g


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
    flat, leans = (replace(config, tilt=tilt).used_scans(load("ramp")) for tilt in (False, True))
    shorter = np.cos(leans.tilt[:, :1])
    assert shorter.min() < 0.95
    np.testing.assert_allclose(
        leans.motion, flat.motion * np.hstack([shorter, shorter, np.ones_like(shorter)])
    )
    for plain, event, share in zip(flat.events(), leans.events(), shorter, strict=True):
        np.testing.assert_allclose(event.controls[0], share * plain.controls[0])
    assert not config.used_scans(load("hall")).tilt.any()


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
