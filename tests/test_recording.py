"""Streams are checked when they are built, and paired by time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfslam.errors import DataError
from pfslam.io.datasets import load
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, LidarScans, Recording, RgbdStream, image_pairs, nearest_stamp
from pfslam.sensors import LidarModel, RobotModel

T = np.arange(3.0)
increasing = st.lists(st.integers(-50, 50), min_size=1, max_size=20, unique=True).map(
    lambda t: np.array(sorted(t), float)
)


@given(increasing, st.lists(st.integers(-120, 120), min_size=1, max_size=20))
def test_nearest_stamp_is_the_nearest_and_the_earlier_of_two(t, halves):
    query = np.array(halves) / 2.0  # halves between whole stamps: exact ties occur
    found = nearest_stamp(t, query)
    for q, k in zip(query, found, strict=True):
        assert k == int(np.argmin(np.abs(t - q)))  # argmin takes the first, the earlier stamp


def stream(disparity_t, rgb_t, disparity_index=None, rgb_index=None):
    everything = [np.arange(len(t)) for t in (disparity_t, rgb_t)]
    return RgbdStream(
        np.array(disparity_t, float),
        np.array(rgb_t, float),
        lambda k: None,
        lambda k: None,
        everything[0] if disparity_index is None else np.array(disparity_index),
        everything[1] if rgb_index is None else np.array(rgb_index),
    )


@pytest.mark.parametrize(
    ("stored", "every", "disparity", "rgb", "unpaired"),
    [
        ((None, None), 1, [1, 3], [0, 2], 2),
        # Frame 1 would fit best, but only frames 0 and 3 were kept.
        (([0, 3], [0, 2]), 1, [0, 3], [0, 2], 0),
        ((None, None), 2, [1], [0], 2),
        (([], [0, 1]), 1, [], [], 2),
    ],
)
def test_stored_images_are_paired_by_time_and_the_rest_is_counted(stored, every, disparity, rgb, unpaired):
    camera = stream([0.0, 0.03, 0.06, 1.0], [0.028, 0.5, 0.95, 1.2], *stored)
    pairs = image_pairs(camera, max_gap=0.1, every=every)
    assert (pairs.disparity.tolist(), pairs.rgb.tolist(), pairs.unpaired) == (disparity, rgb, unpaired)


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (
            lambda: Encoders(np.array([0.0, 2.0, 1.0]), np.zeros((3, 4))),
            r"encoders: time_stamps\[2\]: found 1.0+ after 2.0+",
        ),
        (lambda: Encoders(np.array([0.0, 1.0, 1.0]), np.zeros((3, 4))), r"time_stamps\[2\]"),
        (lambda: Encoders(np.array([0.0, np.nan, 1.0]), np.zeros((3, 4))), r"time_stamps\[1\]"),
        (lambda: Encoders(T, np.zeros((4, 3))), r"encoders: counts: .*shape \(4, 3\), expected .*\(3, 4\)"),
        (lambda: Encoders(np.zeros(0), np.zeros((0, 4))), r"encoders: time_stamps"),
        (lambda: Encoders(np.array(["a", "b", "c"]), np.zeros((3, 4))), r"encoders: time_stamps"),
        (
            lambda: Imu(T, np.full((3, 3), np.inf), np.zeros((3, 3))),
            r"imu: angular_velocity\[0, 0\]: found inf",
        ),
        (lambda: Imu(T, np.zeros((3, 3)), np.zeros(3)), r"imu: acceleration_g"),
        (lambda: LidarScans(T, np.zeros((5, 2))), r"lidar: ranges"),
        (lambda: LidarScans(T, np.zeros((3, 0))), r"lidar: ranges"),
        (lambda: Recording("set 7"), r"set 7: odometry"),
        (
            lambda: Recording(
                "set 7", odometry=Trajectory(T, np.zeros((3, 3))), lidar=LidarScans(T, np.ones((3, 9)))
            ),
            r"set 7: lidar ranges: found 9 beams, expected 1081",
        ),
    ],
)
def test_bad_input_is_one_line_that_names_the_field(build, says):
    with pytest.raises(DataError, match=says) as caught:
        build()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("hertz", "every"), [(41.4, 5), (40.0, 5), (25.0, 3), (10.0, 1), (6.0, 1), (0.3, 1)])
def test_a_filter_sees_about_eight_scans_a_second(hertz, every):
    t = np.cumsum(np.full(200, 1.0 / hertz))
    robot = RobotModel(lidar=LidarModel(beams=1))
    odometry = Trajectory(t, np.zeros((200, 3)))
    scans = LidarScans(t, np.ones((200, 1), dtype=np.float32))
    assert Recording("set", robot, odometry=odometry, lidar=scans).default_every == every
    assert Recording("log", robot, odometry=odometry).default_every == 1


@pytest.mark.parametrize("metres", [0.0, 0.01, 0.05])
def test_the_scatter_of_ranges_is_their_noise_whatever_stands_far_away_and_is_missing(metres):
    rng, lidar = np.random.default_rng(0), LidarModel()
    room = np.minimum(2.0 / np.maximum(np.abs(np.cos(lidar.angles)), 0.1), 5.0)  # two walls, and a round end
    room[room > 2.5] += rng.uniform(0.0, 1.0, np.count_nonzero(room > 2.5))  # full of chairs
    ranges = room + metres * rng.standard_normal((40, lidar.beams))
    ranges[rng.random(ranges.shape) < 0.2] = 0.0
    ranges[:, 300:400] = lidar.range_max
    scans = LidarScans(np.arange(40.0), ranges.astype(np.float32))
    odometry = Trajectory(np.arange(40.0), np.zeros((40, 3)))
    recording = Recording("room", RobotModel(lidar=lidar), odometry=odometry, lidar=scans)
    assert recording.range_scatter() == pytest.approx(metres, rel=0.05, abs=1e-4)
    assert replace(recording, lidar=None).range_scatter() == 0.0
    apart = np.where(np.arange(lidar.beams) % 2, scans.ranges, 0.0)  # never three beams side by side
    with_one = np.where(np.arange(lidar.beams) % 3, scans.ranges, 0.0)
    assert replace(recording, lidar=LidarScans(scans.t, with_one)).range_scatter() == 0.0
    assert replace(recording, lidar=LidarScans(scans.t, apart)).range_scatter() == 0.0


def thinned(recording, step):
    """The recording as every ``step``-th beam would have measured it, the first and the last among them."""
    model, ranges = recording.robot.lidar, recording.lidar.ranges[:, ::step]
    model = replace(model, beams=ranges.shape[1])
    assert model.angles[-1] == pytest.approx(recording.robot.lidar.angles[-1])
    robot = replace(recording.robot, lidar=model)
    return replace(recording, robot=robot, lidar=LidarScans(recording.lidar.t, ranges))


@pytest.mark.parametrize("more", [0.0, 0.01, 0.03, 0.06])
def test_the_scatter_does_not_depend_on_how_far_apart_beams_are(more):
    """A simulated drive of 1 cm, and more noise on top; where beams are too few to tell, none is claimed."""
    drive, rng = load("hall"), np.random.default_rng(0)
    kept = np.arange(360, len(drive.lidar.t), 5)
    ranges = drive.lidar.ranges[kept] + more * rng.standard_normal((len(kept), 1081)).astype(np.float32)
    noisy = replace(drive, camera=None, lidar=LidarScans(drive.lidar.t[kept], ranges))
    truth = np.hypot(0.01, more)
    for step in (1, 2, 3, 4, 6, 9, 12, 18, 20, 30):  # up to 37 beams, 7.5 degrees apart
        assert thinned(noisy, step).range_scatter() == pytest.approx(truth, rel=0.25)
    for step in (36, 40, 45, 54, 60, 72, 90, 108, 120, 135, 180, 216, 270, 360, 540):
        assert thinned(noisy, step).range_scatter() < 1.5 * truth


def test_beams_on_one_straight_wall_scatter_by_their_noise_alone_even_where_they_are_few():
    """The wall is 1 m to the left of a scanner of 9 beams, 20 degrees apart."""
    lidar = LidarModel(angle_min=np.deg2rad(10.0), angle_max=np.deg2rad(170.0), beams=9)
    rng, t = np.random.default_rng(0), np.arange(400.0)
    for noise in (0.0, 0.02):
        ranges = 1.0 / np.sin(lidar.angles) + noise * rng.standard_normal((400, 9))
        scans, odometry = LidarScans(t, ranges), Trajectory(t, np.zeros((400, 3)))
        log = Recording("wall", RobotModel(lidar=lidar), odometry=odometry, lidar=scans)
        assert log.range_scatter() == pytest.approx(noise, rel=0.1, abs=1e-9)
