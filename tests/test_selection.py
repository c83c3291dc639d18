"""A part of a drive: a span of time, limits of the ranges, beams that are left out."""

import dataclasses

import numpy as np
import pytest
from bag_files import LEVEL, Messages, nanoseconds, rows_of, write_bag
from box_recording import box_recording

import pfslam
from pfslam.cli.parser import main
from pfslam.errors import DataError
from pfslam.io.selection import select

BOX = box_recording()
SCANS = BOX.lidar
ANGLES = np.degrees(BOX.robot.lidar.angles)


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


def test_a_part_of_a_drive_is_mapped_as_it_is_by_itself():
    """The motion in a span is that of the whole drive."""
    part, t = select(BOX, start=1.0, until=2.5), np.linspace(1.0, 2.5, 9) + SCANS.t[0]
    whole, alone = pfslam.dead_reckoning(BOX).at(t), pfslam.dead_reckoning(part).at(t)
    steps = (pfslam.poses.between(path[:-1], path[1:]) for path in (whole, alone))
    np.testing.assert_allclose(*steps, atol=1e-3)


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
