"""A part of a drive: a span of time, limits of the ranges, beams that are left out."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from bag_files import LEVEL, Messages, nanoseconds, rows_of, write_bag
from box_recording import box_recording

import pfslam
from pfslam.__main__ import main
from pfslam.errors import DataError
from pfslam.io.selection import select
from pfslam.poses import Trajectory
from pfslam.recording import LidarScans, Recording
from pfslam.sensors import LidarModel, RobotModel

BOX = box_recording()
SCANS = BOX.lidar
ANGLES = np.arange(-540, 541) / 4  # the course's, in degrees


def test_nothing_asked_for_is_the_recording_itself():
    assert select(BOX) is BOX


def test_a_span_keeps_its_scans_and_images_and_the_motion_around_them():
    begin, end = SCANS.t[0] + 1.0, SCANS.t[0] + 2.5
    part = select(BOX, start=1.0, until=2.5)
    inside = (SCANS.t >= begin) & (SCANS.t <= end)
    np.testing.assert_array_equal(part.lidar.t, SCANS.t[inside])
    np.testing.assert_array_equal(part.lidar.ranges, SCANS.ranges[inside])
    assert part.dropped == {"scans before --from or after --until": np.count_nonzero(~inside)}
    for stream, whole in ((part.encoders, BOX.encoders), (part.imu, BOX.imu)):
        assert stream.t[0] <= begin < stream.t[1]
        assert stream.t[-2] < end <= stream.t[-1]
        assert set(stream.t) <= set(whole.t)
    camera, whole = part.camera, BOX.camera
    stored = whole.rgb_t[whole.rgb_index]
    np.testing.assert_array_equal(camera.rgb_t[camera.rgb_index], stored[(stored >= begin) & (stored <= end)])
    first = np.flatnonzero(whole.rgb_t == camera.rgb_t[camera.rgb_index[0]])[0]
    np.testing.assert_array_equal(camera.read_rgb(camera.rgb_index[0]), whole.read_rgb(first))


def test_what_a_part_of_a_part_leaves_out_adds_up(tmp_path):
    """A file keeps the count of its part; a part of that has left out both."""
    names = [str(tmp_path / f"{name}.npz") for name in ("whole", "part", "part of it")]
    pfslam.save(BOX, names[0])
    for (given, made), until in zip(pairwise(names), ("4", "2"), strict=True):
        assert main(["convert", given, made, "--until", until]) == 0
    found = pfslam.load(names[-1])
    assert len(found.lidar.t) + sum(found.dropped.values()) == len(BOX.lidar.t)
    assert select(found, start=0.0).dropped == found.dropped


def test_limits_are_the_lidars():
    lidar = select(BOX, limits=(0.5, 3)).robot.lidar
    assert (lidar.range_min, lidar.range_max) == (0.5, 3)


@pytest.mark.parametrize(
    ("masks", "hidden"),
    [
        ([(-10, 10)], np.abs(ANGLES) <= 10),
        ([(100, -100)], np.abs(ANGLES) >= 100),
        ([(-30, -20), (20, 30)], (np.abs(ANGLES) >= 20) & (np.abs(ANGLES) <= 30)),
    ],
    ids=["ahead", "across the back", "two posts"],
)
def test_masked_beams_measure_nothing(masks, hidden):
    part = select(BOX, masks=masks)
    assert np.isnan(part.lidar.ranges[:, hidden]).all()
    np.testing.assert_array_equal(part.lidar.ranges[:, ~hidden], SCANS.ranges[:, ~hidden])
    assert part.lidar.ranges.dtype == SCANS.ranges.dtype
    assert sum(part.dropped.values()) == np.count_nonzero(hidden) * len(SCANS.t)


def scanner(first, step, beams):
    """A log of two scans; angles are whole steps of ``1 / step`` degrees, in the single precision of many files."""
    ends = np.deg2rad(np.array([first, first + beams - 1], np.float32) / step, dtype=np.float32)
    lidar = LidarModel(angle_min=float(ends[0]), angle_max=float(ends[1]), beams=beams)
    scans = LidarScans(np.arange(2.0), np.full((2, beams), 3.0, np.float32))
    odometry = Trajectory(np.arange(2.0), np.zeros((2, 3)))
    return Recording("log", RobotModel(lidar=lidar), odometry=odometry, lidar=scans)


@pytest.mark.parametrize(
    ("first", "step", "beams"),
    [
        (-540, 4, 1081),
        (-180, 1, 360),
        (0, 1, 360),
        (-180, 2, 361),
        (-1350, 10, 2701),
        (-27, 0.2, 55),
        (0, 50, 18000),
    ],
)
def test_both_ends_of_a_mask_belong_to_it(first, step, beams):
    """Whole numbers of steps are compared with whole numbers: no rounding can lose an edge."""
    log, rng, turn = scanner(first, step, beams), np.random.default_rng(3), round(360 * step)
    of_beams = first + np.arange(beams)
    for _ in range(60):
        low, width = int(rng.integers(-turn, turn + 1)), int(rng.integers(0, turn))
        low, high = (low, low + width) if low + width <= turn else (low, low + width - turn)
        hidden = (of_beams - low) % turn <= (high - low) % turn
        if 0 < hidden.sum() < beams and low != high:
            part = select(log, masks=[(low / step, high / step)])
            np.testing.assert_array_equal(np.isnan(part.lidar.ranges[0]), hidden, err_msg=f"{low}, {high}")
    middle = int(of_beams[beams // 2])
    part = select(log, masks=[(middle / step, middle / step)])
    np.testing.assert_array_equal(np.isnan(part.lidar.ranges[0]), of_beams == middle)
    for low, high in ((-180, 180), (0, 360), (360, 0)):
        with pytest.raises(DataError, match=f"found {beams} beams, expected some of the beams"):
            select(log, masks=[(low, high)])


@pytest.mark.parametrize(
    ("wish", "complaint"),
    [
        ({"start": 3.0, "until": 1.0}, "--from, --until: found 3 to 1 s, expected a span of 0 to"),
        ({"start": 1e9}, "expected a span of 0 to"),
        ({"until": np.nan}, "expected a span of 0 to"),
        ({"limits": (8, 1)}, "--range range_min, range_max"),
        ({"limits": (0, np.nan)}, "--range range_max: found nan"),
        ({"masks": [(0, 400)]}, "degrees, at most one turn"),
        ({"masks": [(np.nan, 4)]}, "degrees, at most one turn"),
        ({"masks": [(-180, 180)]}, "expected some of the beams"),
        ({"masks": [(178, 179)]}, "--mask: found 0 beams"),
    ],
)
def test_wishes_that_leave_nothing_are_refused(wish, complaint):
    with pytest.raises(DataError, match=complaint):
        select(BOX, **wish)


def test_a_robot_without_a_lidar_has_no_beams_to_mask():
    blind = dataclasses.replace(BOX, lidar=None)
    assert select(blind, start=1.0).encoders.t[1] > SCANS.t[0] + 0.5
    with pytest.raises(DataError, match="a recording with LiDAR"):
        select(blind, masks=[(0, 5)])


def test_the_command_line_selects_and_says_what_is_left_out(tmp_path, capsys):
    options = ["--from", "1", "--until", "2.5", "--range", "0.2", "6", "--mask", "-10", "10"]
    pfslam.save(BOX, tmp_path / "box.npz")
    assert main(["info", str(tmp_path / "box.npz"), *options]) == 0
    said = capsys.readouterr().out
    assert "0.2 to 6 m" in said
    assert "scans before --from or after --until" in said
    assert f"ranges of the {np.count_nonzero(np.abs(ANGLES) <= 10)} beams under --mask" in said
    assert main(["convert", str(tmp_path / "box.npz"), str(tmp_path / "part.npz"), *options]) == 0
    part = pfslam.load(tmp_path / "part.npz")
    assert (part.robot.lidar.range_max, len(part.lidar.t)) == (
        6.0,
        np.count_nonzero((SCANS.t <= SCANS.t[0] + 2.5)[SCANS.t >= SCANS.t[0] + 1.0]),
    )


def test_the_frame_of_the_odometry_can_be_named(tmp_path, capsys):
    """Two frames of odometry on /tf, and Odometry messages beside them: the one that is asked for is read."""
    pytest.importorskip("rosbags")
    rows = rows_of(BOX)
    for k in range(20):
        edges = (
            ("odom_combined", "base_link", (0.1 * k, 0.0, 0.0), LEVEL),
            ("odom", "base_link", (0.0, k, 0.0), LEVEL),
        )
        t = SCANS.t[0] + 0.1 * k
        rows.append(("/tf", nanoseconds(t), Messages().transforms(t, *edges)))
    path = str(write_bag(tmp_path / "drive", "mcap", rows))
    assert main(["info", path, "--odom-frame", "odom_combined"]) == 0
    assert "note: odometry is read from /tf: odom_combined -> base_link" in capsys.readouterr().out
    assert main(["info", path, "--odom-frame", "map"]) == 2
    assert "expected map -> base_link on /tf" in capsys.readouterr().err
