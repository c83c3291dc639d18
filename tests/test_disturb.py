"""Harm done to recordings on purpose, against counts and geometry worked out by hand."""

import numpy as np
import pytest
from box_recording import START, box_recording

from pfslam import DataError, dead_reckoning
from pfslam.poses import Trajectory, between
from pfslam.recording import LidarScans, Recording
from pfslam.study.disturbances import (
    blind,
    disturb,
    first_seconds,
    kidnap,
    missing_beams,
    random_ranges,
    range_noise,
)

BOX = box_recording(images=2)  # six seconds: encoders at 40 Hz, IMU at 100 Hz, scans at 10 Hz from 0.3 s on


def test_first_seconds_cut_every_stream_at_the_same_time():
    short = first_seconds(BOX, 2.0)
    assert len(short.encoders.t) == 81  # both ends of two seconds at 40 Hz
    assert len(short.imu.t) == 181  # 0.2, 0.21, ... 2.0
    assert len(short.lidar.t) == len(short.truth.t) == 18  # 0.3, 0.4, ... 2.0
    assert short.camera is None
    np.testing.assert_array_equal(short.lidar.ranges, BOX.lidar.ranges[:18])
    with pytest.raises(DataError, match=r"disturb.seconds: found 0.05"):
        first_seconds(BOX, 0.05)


def test_blind_scans_arrive_without_a_single_return():
    dark = blind(BOX, 1.05, 2.05)
    valid = BOX.robot.lidar.valid(dark.lidar.ranges).any(axis=1)
    elapsed = BOX.lidar.t - START
    np.testing.assert_array_equal(valid, (elapsed < 1.05) | (elapsed > 2.05))
    assert np.count_nonzero(~valid) == 10
    np.testing.assert_array_equal(dark.lidar.ranges[valid], BOX.lidar.ranges[valid])


def test_a_kidnapped_robot_has_no_odometry_of_the_way():
    taken = kidnap(BOX, 2.0, 1.5)
    # 60 of 241 encoder readings lie in [2.0, 3.5); the clock closes up, and each reading keeps its counts.
    assert len(taken.encoders.t) == 241 - 60
    np.testing.assert_allclose(np.diff(taken.encoders.t), 1 / 40, atol=1e-6)
    gap = np.flatnonzero(np.diff(np.hypot(*np.diff(taken.truth.poses[:, :2], axis=0).T)) > 0.2)
    assert len(gap) == 1  # the truth jumps once
    # Odometry: 4.5 s of the 6 s of driving are left, at constant speed on the same circle.
    whole, left = dead_reckoning(BOX), dead_reckoning(taken)
    length = [np.hypot(*np.diff(t.poses[:, :2], axis=0).T).sum() for t in (whole, left)]
    assert length[0] - length[1] == pytest.approx(0.44 * 1.5, abs=0.02)
    assert np.hypot(*np.diff(left.poses[:, :2], axis=0).T).max() < 0.02  # and it does not jump


def test_a_kidnapped_robot_with_logged_odometry_goes_on_from_where_it_was():
    odometry = dead_reckoning(BOX)
    log = Recording("log", BOX.robot, odometry=odometry, lidar=BOX.lidar)
    taken = kidnap(log, 2.0, 1.5).odometry
    k = np.count_nonzero(taken.t < odometry.t[0] + 2.0)
    np.testing.assert_array_equal(taken.poses[:k], odometry.poses[:k])
    after, original = taken.poses[k:], odometry.poses[k - len(taken) :]
    np.testing.assert_allclose(after[0], taken.poses[k - 1], atol=1e-12)
    np.testing.assert_allclose(
        between(after[:-1], after[1:]), between(original[:-1], original[1:]), atol=1e-9
    )
    np.testing.assert_array_equal(kidnap(log, 60.0, 1.0).odometry.poses, odometry.poses)  # after its end


def many_beams():
    """A recording of 200 scans of 1081 beams at 5 m."""
    t = START + 0.1 * np.arange(200)
    still = Trajectory(t, np.zeros((200, 3)))
    return Recording("wall", odometry=still, lidar=LidarScans(t, np.full((200, 1081), 5.0, np.float32)))


def test_random_harm_has_the_share_and_size_that_was_asked_for():
    wall, rng = many_beams(), np.random.default_rng(3)
    n = 200 * 1081
    lost = missing_beams(wall, 0.3, rng).lidar.ranges
    share = np.mean(~wall.robot.lidar.valid(lost))
    assert share == pytest.approx(0.3, abs=4 * np.sqrt(0.3 * 0.7 / n))
    noisy = range_noise(wall, 0.03, rng).lidar.ranges
    assert noisy.std() == pytest.approx(0.03, rel=4 / np.sqrt(2 * n))
    assert noisy.mean() == pytest.approx(5.0, abs=4 * 0.03 / np.sqrt(n) + 1e-5)
    wild = random_ranges(wall, 0.1, rng).lidar.ranges
    changed = wild != 5.0
    assert changed.mean() == pytest.approx(0.1, abs=4 * np.sqrt(0.09 / n))
    assert wild[changed].mean() == pytest.approx(15.05, abs=4 * (29.9 / np.sqrt(12)) / np.sqrt(changed.sum()))
    assert {r.dtype for r in (lost, noisy, wild)} == {np.dtype(np.float32)}


def test_harm_follows_from_the_seed_and_leaves_the_original_alone():
    original = BOX.lidar.ranges.copy()
    what = {"missing_beams": 0.5, "seconds": 3.0, "blind": (1.0, 1.5), "range_noise": 0.01}
    once, again, other = (disturb(BOX, what, seed).lidar.ranges for seed in (7, 7, 8))
    np.testing.assert_array_equal(once, again)
    assert (once != other).any()
    np.testing.assert_array_equal(BOX.lidar.ranges, original)
    # Adding one kind of harm does not change the random numbers of another.
    alone = disturb(BOX, {"missing_beams": 0.5}, 7).lidar.ranges[: len(once)]
    lit = ~((BOX.lidar.t >= START + 1.0) & (BOX.lidar.t <= START + 1.5))[: len(once)]
    np.testing.assert_array_equal((once == 0)[lit], (alone == 0)[lit])
    # Two kinds do not hit the same beams: of those lost, half read a random range afterwards.
    both = disturb(BOX, {"missing_beams": 0.5, "random_ranges": 0.5}, 7).lidar.ranges
    assert np.mean(both == 0) == pytest.approx(0.25, abs=0.01)
    # Noise leaves beams without return alone.
    dark = blind(BOX, 0.0, 6.0)
    np.testing.assert_array_equal(disturb(dark, {"range_noise": 1.0}, 0).lidar.ranges, dark.lidar.ranges)
    assert disturb(BOX, {}, 0) is BOX
    with pytest.raises(DataError, match="found fog, expected one of seconds"):
        disturb(BOX, {"fog": 1.0}, 0)
