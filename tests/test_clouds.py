"""Slices of point clouds: a scanner of many rings, mounted anyhow, sees what a level scanner in its place would see."""

import json

import numpy as np
import pytest
from bag_files import LATER, LEVEL, UPSIDE_DOWN, Messages, nanoseconds, rows_of, write_bag
from box_recording import ROOM, START, box_recording, true_pose
from rooms import box, distance_to_walls, sensor_position

import pfslam
from pfslam.__main__ import main
from pfslam.errors import DataError
from pfslam.io.bags import BagOptions
from pfslam.io.clouds import BEAMS
from pfslam.poses import between, quaternion_to_rotation, transform_points
from pfslam.sensors import scan_points

BOX = box_recording(images=0)
LIDAR = BOX.robot.lidar
RINGS = np.radians([-15.0, -2.0, 0.0, 2.0, 15.0])
X, Y, HEIGHT = LIDAR.position_b
TILTED = (*(np.sin(0.25) * np.array([0.6, 0.64, 0.48])), np.cos(0.25))
"""Half a radian about an axis that is none of the robot's."""


def rings(ranges, turn=LEVEL):
    """The points (5 beams, 3) of a scanner of five rings that is turned by a quaternion, in its own frame.

    Walls are upright and have no end; the lowest ring meets the floor before them, the highest sees above the slice.
    """
    away, up = np.repeat(ranges[None], len(RINGS), axis=0), np.tan(RINGS)[:, None]
    away = np.where(up < 0.0, np.minimum(away, HEIGHT / -np.minimum(up, -1e-9)), away)
    level = np.stack([away * np.cos(LIDAR.angles), away * np.sin(LIDAR.angles), away * up], axis=-1)
    return level.reshape(-1, 3) @ quaternion_to_rotation(np.array(turn))


def rows_of_clouds(is_old=False, turn=LEVEL, count=None, **layout):
    """The drive in the box with clouds in the place of its scans."""
    mount, make = [("base_link", "laser", LIDAR.position_b, turn)], Messages(is_old).cloud
    rows = [row for row in rows_of(BOX, is_old, mount=mount) if row[0] != "/scan"]
    for t, ranges in list(zip(BOX.lidar.t, BOX.lidar.ranges, strict=True))[:count]:
        points = rings(ranges, turn)
        points[:5], points[5:8] = np.nan, 0.0  # as drivers write where nothing came back
        rows.append(("/points", nanoseconds(t) + LATER, make(t, points, **layout)))
    return rows


def loaded(tmp_path, rows, form="mcap", **options):
    return pfslam.load(write_bag(tmp_path / "drive", form, rows), bag=BagOptions(**options))


def walls_are_met(found):
    """All ends of the scans lie on the walls, to a quarter of a degree of the bearing, and most beams have one."""
    lidar, off = found.robot.lidar, []
    for t, ranges in zip(found.lidar.t, found.lidar.ranges, strict=True):
        points = transform_points(BOX.truth.at(t), scan_points(ranges, lidar))
        off.append(distance_to_walls(points, box(ROOM[0], ROOM[2], ROOM[1], ROOM[3])).max())
        assert lidar.valid(ranges).mean() > 0.98
    return max(off) < 0.03


LAYOUTS = {
    "plain": {},
    "double": {"kind": "<f8"},
    "other end first": {"kind": ">f4", "lead": 3, "tail": 5},
    "double, other end first": {"kind": ">f8", "lead": 1},
    "organised": {"rows": 5, "tail": 20, "padding": 7},
}


@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_slice_is_what_a_level_scanner_sees(tmp_path, form, layout):
    found = loaded(tmp_path, rows_of_clouds(form == "ros1", count=4, **LAYOUTS[layout]), form)
    np.testing.assert_array_equal(found.lidar.t, BOX.lidar.t[:4])
    np.testing.assert_allclose(found.robot.lidar.position_b, LIDAR.position_b)
    assert found.robot.lidar.increment == pytest.approx(2.0 * np.pi / BEAMS, rel=1e-6)
    assert walls_are_met(found)


@pytest.mark.parametrize("turn", [LEVEL, UPSIDE_DOWN, TILTED])
def test_however_the_scanner_is_mounted(tmp_path, turn):
    """The floor and what is high up are left out by their height in the robot's frame, not in the scanner's."""
    assert walls_are_met(loaded(tmp_path, rows_of_clouds(turn=turn, count=4)))


def test_a_run_over_clouds_is_as_good_as_one_over_scans(tmp_path):
    write_bag(tmp_path / "drive", "mcap", rows_of_clouds(turn=TILTED))
    line = ["run", str(tmp_path / "drive"), "--particles", "20", "--quiet", "--out", str(tmp_path / "out")]
    assert main(line) == 0
    path = pfslam.read_tum(tmp_path / "out" / "trajectory.tum")
    off = between(between(BOX.truth.poses[0], BOX.truth.at(path.t)), path.poses)
    assert np.abs(off).max() < 0.01
    notes = json.loads((tmp_path / "out" / "summary.json").read_text())["notes"]
    assert (
        f"scans are slices of the clouds on /points, from 0.1 to {2 * HEIGHT - 0.1:g} m high; all points of a "
        "cloud are taken to be as old as its stamp"
    ) in notes


def test_a_cloud_from_ahead_has_beams_ahead_only(tmp_path):
    """A depth camera looks ahead: bearings that it never sees are none of its beams."""
    rows = rows_of_clouds(count=3)
    for _, _, message in (row for row in rows if row[0] == "/points"):
        points = np.frombuffer(message.data.tobytes(), "<f4").reshape(-1, 3).copy()
        points[~(np.abs(np.arctan2(points[:, 1], points[:, 0])) < np.radians(30.1))] = np.nan
        message.data = points.view(np.uint8).ravel()
    lidar = loaded(tmp_path, rows).robot.lidar
    assert np.degrees([lidar.angle_min, lidar.angle_max]) == pytest.approx([-30.25, 30.25], abs=0.01)
    assert lidar.beams == 122


# ---- the nearest surface ------------------------------------------------------------------------

CENTRES = np.arange(-80, 81) * 2.0 * np.pi / BEAMS + np.pi / BEAMS
"""The middles of some of a slice's beams, by their bearings (rad)."""


def seen_ahead(tmp_path, *surfaces):
    """The ranges at ``CENTRES`` from clouds of points at bearings and distances ``(N, 2)`` from the LiDAR."""
    rows = rows_of(BOX, mount=[("base_link", "laser", LIDAR.position_b, LEVEL)])
    rows = [row for row in rows if row[0] != "/scan"]
    bearings, away = np.vstack(surfaces).T
    points = np.column_stack([away * np.cos(bearings), away * np.sin(bearings), np.zeros(len(away))])
    for t in BOX.lidar.t[:2]:
        rows.append(("/points", nanoseconds(t) + LATER, Messages().cloud(t, points)))
    found = loaded(tmp_path, rows)
    beams = np.rint((CENTRES - found.robot.lidar.angle_min) / found.robot.lidar.increment).astype(int)
    return found.lidar.ranges[0][beams]


def slanting(bearings, tangent):
    """A wall 3 m ahead that is turned: ``tangent`` metres along the beam that looks ahead for one across it."""
    return np.column_stack([bearings, 3.0 / (np.cos(bearings) - tangent * np.sin(bearings))])


@pytest.mark.parametrize("tangent", [0.0, 0.5, -0.5])
def test_a_slanting_wall_is_where_it_is(tmp_path, tangent):
    """Eight points lie around each bearing. The nearest of them would put the walls too near by 5 to 12 mm."""
    dense = np.radians(np.arange(-61.0, 61.0, 0.0625) + 0.02)
    off = seen_ahead(tmp_path, slanting(dense, tangent)) - slanting(CENTRES, tangent)[:, 1]
    assert abs(off.mean()) < 0.002
    assert np.abs(off).max() < 0.02


def test_what_stands_before_a_wall_is_seen_beside_a_bearing_too(tmp_path):
    """A post that one ring meets a fifth of a degree beside the bearing hides the wall that others meet right at it."""
    wall = slanting(np.radians(np.arange(-61.0, 61.0, 0.0625)), 0.5)
    behind = slanting(CENTRES, 0.5)[:, 1]
    post = np.column_stack([CENTRES + np.radians(0.2), 0.75 * behind])
    np.testing.assert_allclose(seen_ahead(tmp_path, wall, post), 0.75 * behind, rtol=1e-6)


# ---- clouds that take a time -------------------------------------------------------------------

SWEEP = 0.1
DRIVERS = {
    "time since a stamp that is the last point's": ("time", "<f4", 0.5, lambda t, stamp: t - stamp),
    "nanoseconds since the first point's": ("t", "<u4", -0.5, lambda t, stamp: (t - stamp) * 1e9),
    "the time itself": ("timestamp", "<f8", -0.5, lambda t, stamp: t),
    "the time itself in nanoseconds": ("timestamp", "<f8", -0.5, lambda t, stamp: t * 1e9),
    "signed nanoseconds": ("offset_time", "<i4", 0.0, lambda t, stamp: (t - stamp) * 1e9),
}
"""As drivers do: the field of a point's time, its kind, the share of a sweep at which the stamp is, what it says."""
OTHER_CLOCK = ("timestamp", "<f8", -0.5, lambda t, stamp: t - START + 100.0)


def swept(field, kind, share, says, order=slice(None), count=None):
    """The drive in the box with clouds that take ``SWEEP`` seconds each, their beams measured in some ``order``."""
    rows = rows_of(BOX, mount=[("base_link", "laser", LIDAR.position_b, LEVEL)])
    rows = [row for row in rows if row[0] != "/scan"]
    looks = np.column_stack([np.cos(LIDAR.angles), np.sin(LIDAR.angles), np.zeros(LIDAR.beams)])
    for middle in BOX.lidar.t[:count]:
        t = middle + SWEEP * np.linspace(-0.5, 0.5, LIDAR.beams)[order]
        stamp = middle + share * SWEEP
        ranges = room_ranges_from(true_pose(t - BOX.imu.t[0]))
        cloud = Messages().timed_cloud(stamp, ranges[:, None] * looks, field, kind, says(t, stamp))
        rows.append(("/points", nanoseconds(stamp) + LATER, cloud))
    return rows


def room_ranges_from(poses):
    """What each beam (N,) sees that is measured from a pose of its own, (N, 3)."""
    angles, origin = poses[:, 2] + LIDAR.angles, np.array([sensor_position(pose, LIDAR) for pose in poses])
    to_walls = np.reshape(ROOM, (2, 2)) - origin[..., None]
    looks = np.column_stack([np.cos(angles), np.sin(angles)])
    return (to_walls / looks[..., None]).max(axis=2).min(axis=1)


def off_the_walls(found):
    """How far the farthest end of all scans is from the walls (m), seen from where the robot was at their stamps."""
    ends = [
        transform_points(true_pose(t - BOX.imu.t[0]), scan_points(ranges, found.robot.lidar))
        for t, ranges in zip(found.lidar.t, found.lidar.ranges, strict=True)
    ]
    return distance_to_walls(np.vstack(ends), box(ROOM[0], ROOM[2], ROOM[1], ROOM[3])).max()


@pytest.mark.parametrize("driver", DRIVERS)
def test_points_are_moved_to_where_they_are_at_the_stamp(tmp_path, driver):
    """In a tenth of a second the robot turns by two degrees: a wall 4 m away is off by 0.16 m."""
    found = loaded(tmp_path, swept(*DRIVERS[driver], count=4))
    assert off_the_walls(found) < 0.03
    field, _, share, _ = DRIVERS[driver]
    first, last = SWEEP * (-0.5 - share), SWEEP * (0.5 - share)
    assert (
        f"as its field {field} tells (in 4 clouds, usually {first:+.3f} to {last:+.3f} s from the stamp)"
        in found.notes[0]
    )


def test_beams_may_be_measured_in_any_order(tmp_path):
    """A scanner that draws rosettes has no first bearing, and one that turns begins its cloud at any of them."""
    for name, order in (
        ("rosette", np.random.default_rng(0).permutation(LIDAR.beams)),
        ("turn", np.roll(np.arange(LIDAR.beams)[::-1], 300)),
    ):
        found = loaded(tmp_path / name, swept(*DRIVERS["signed nanoseconds"], order=order, count=4))
        assert off_the_walls(found) < 0.03


@pytest.mark.parametrize(
    ("way", "options", "words"),
    [
        (("ring", *DRIVERS["the time itself"][1:]), {}, "as old as its stamp"),
        (
            OTHER_CLOCK,
            {},
            "as old as its stamp: they have a field timestamp, but it does not fit their stamps",
        ),
        (
            DRIVERS["the time itself"],
            {"odometry": False},
            "as old as its stamp: they have a field timestamp, but there is no odometry",
        ),
    ],
    ids=["no field", "another clock", "no odometry"],
)
def test_where_nothing_tells_the_motion_all_points_are_as_old_as_the_stamp(tmp_path, way, options, words):
    found = loaded(tmp_path, swept(*way, count=4), **options)
    assert off_the_walls(found) > 0.06
    assert any(note.endswith(words) for note in found.notes)


def test_times_since_a_stamp_that_is_none_are_not_used(tmp_path):
    """The bag's own time is used then, which is that of no point."""
    rows = swept(*DRIVERS["signed nanoseconds"], count=4)
    for message in (message for name, _, message in rows if name == "/points"):
        message.header.stamp.sec = message.header.stamp.nanosec = 0
    found = loaded(tmp_path, rows)
    assert found.notes[0].endswith("they have a field offset_time, but it does not fit their stamps")
    np.testing.assert_allclose(found.lidar.t, BOX.lidar.t[:4] + 1e-9 * LATER, atol=1e-6)


def test_a_cloud_whose_times_are_damaged_is_as_old_as_its_stamp(tmp_path):
    rows = swept(*DRIVERS["the time itself"], count=4)
    clouds = [message for name, _, message in rows if name == "/points"]
    for value, message in zip((np.nan, np.inf, 1.7e308), clouds[1:], strict=True):
        message.data.reshape(-1, 20)[500, 12:] = np.array([value]).view(np.uint8)
    found = loaded(tmp_path, rows)
    assert "in 1 clouds" in found.notes[0]
    assert len(found.lidar.t) == 4


def test_a_run_over_clouds_that_take_a_time_is_as_good(tmp_path):
    write_bag(tmp_path / "drive", "mcap", swept(*DRIVERS["nanoseconds since the first point's"]))
    line = ["run", str(tmp_path / "drive"), "--particles", "20", "--quiet", "--out", str(tmp_path / "out")]
    assert main(line) == 0
    path = pfslam.read_tum(tmp_path / "out" / "trajectory.tum")
    truth = true_pose(path.t - BOX.imu.t[0])
    assert np.abs(between(between(truth[0], truth), path.poses)).max() < 0.015


# ---- which topic, which heights ----------------------------------------------------------------


def test_clouds_beside_scans_are_read_where_they_are_asked_for(tmp_path):
    both = [*rows_of_clouds(count=3), *(row for row in rows_of(BOX) if row[0] == "/scan")]
    path = write_bag(tmp_path / "drive", "mcap", both)
    assert pfslam.load(path).dropped == {"messages of PointCloud2 on /points, which is not read": 3}
    for options in ({"scan": "points"}, {"slice": (0.2, 0.8)}):
        found = pfslam.load(path, bag=BagOptions(**options))
        assert len(found.lidar.t) == 3
        assert found.dropped["messages of LaserScan on /scan, which is not read"] == 55
    with pytest.raises(DataError, match="--scan /scan: found /points, expected one topic of PointCloud2"):
        pfslam.load(path, bag=BagOptions(scan="/scan", slice=(0.2, 0.8)))


def test_heights_are_those_above_the_floor(tmp_path):
    """Between 0.9 and 3 m there is only what the highest ring sees: walls from 1.5 m away on."""
    found = loaded(tmp_path, rows_of_clouds(count=3), slice=(0.9, 3.0))
    ranges = found.lidar.ranges[np.isfinite(found.lidar.ranges)]
    assert ranges.min() > (0.9 - HEIGHT) / np.tan(RINGS[-1]) - 1e-3
    with pytest.raises(DataError, match="points between the heights of the slice: found none"):
        loaded(tmp_path / "none", rows_of_clouds(count=3), slice=(5.0, 6.0))


@pytest.mark.parametrize("heights", [(0.5, 0.5), (1.0, 0.2), (np.nan, 1.0), (0.1, np.inf)])
def test_heights_that_are_none_are_refused(tmp_path, heights):
    with pytest.raises(DataError, match=r"/points, heights: found .*expected --slice LOW HIGH in m"):
        loaded(tmp_path, rows_of_clouds(count=2), slice=heights)


def test_the_command_line_takes_heights_and_keeps_them(tmp_path, capsys):
    path = str(write_bag(tmp_path / "drive", "mcap", rows_of_clouds(count=20)))
    assert main(["info", path, "--slice", "0.2", "0.8"]) == 0
    assert "slices of the clouds on /points, from 0.2 to 0.8 m high" in capsys.readouterr().out
    line = ["run", path, "--slice", "0.2", "0.8", "--no-odometry", "--particles", "5", "--quiet"]
    assert main([*line, "--out", str(tmp_path / "out")]) == 0
    kept = json.loads((tmp_path / "out" / "summary.json").read_text())["selection"]
    assert kept[kept.index("--slice") + 1 :][:2] == ["0.2", "0.8"]


# ---- what cannot be read -----------------------------------------------------------------------


def only(*names):
    def change(message):
        message.fields = [field for field in message.fields if field.name in names]

    return change


def each_field(**values):
    def change(message):
        for field in message.fields:
            vars(field).update(values)

    return change


def cut_off(message):
    message.data = message.data[:-1]


def with_values(**values):
    return lambda message: vars(message).update(values)


WHOLE = "x, y and z of type 7 .float32. or 8 .float64. within"
BAD = {
    "no height": (only("x", "y"), f"found x of type 7 at 0, y of type 7 at 4, expected {WHOLE}"),
    "no fields": (only(), f"found no fields, expected {WHOLE}"),
    "whole numbers": (each_field(datatype=5), f"found x of type 5 at 0.*expected {WHOLE}"),
    "beyond the point": (each_field(offset=9), f"found x of type 7 at 9.*expected {WHOLE} 12 bytes"),
    "far beyond": (each_field(offset=2**32 - 1), f"expected {WHOLE}"),
    "where 32 bits end": (each_field(offset=2**31 - 1), f"expected {WHOLE} 12 bytes"),
    "no step": (with_values(point_step=0), f"expected {WHOLE} 0 bytes"),
    "short step": (with_values(point_step=11), f"expected {WHOLE} 11 bytes"),
    "long step": (
        with_values(point_step=13),
        "5405 points of 13, 64860 bytes in all, expected a whole cloud",
    ),
    "huge step": (with_values(point_step=2**32 - 1), "expected"),
    "more than there is": (with_values(width=2**31), "expected a whole cloud"),
    "more rows than there are": (with_values(height=2), "expected a whole cloud"),
    "rows that overlap": (with_values(height=2, row_step=4), "expected a whole cloud"),
    "cut off": (cut_off, "64859 bytes in all, expected a whole cloud"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_cloud_that_cannot_be_read_is_named_by_its_stamp(tmp_path, case):
    change, words = BAD[case]
    rows = rows_of_clouds(count=3)
    change([message for name, _, message in rows if name == "/points"][1])
    with pytest.raises(DataError, match=words) as raised:
        loaded(tmp_path, rows)
    assert f"/points at {START + 0.4:.3f}" in str(raised.value)


def test_clouds_of_odd_numbers_leave_nothing_odd(tmp_path):
    """Points at infinity, at the ends of what a number can be, and clouds of no points at all."""
    rows = rows_of_clouds(count=3, kind="<f8")
    first, second = [message for name, _, message in rows if name == "/points"][:2]
    points = np.frombuffer(first.data.tobytes(), "<f8").reshape(-1, 3).copy()
    points[10:20], points[20:30, 0], points[30:40] = np.inf, -1.7e308, 1.7e308
    first.data = points.view(np.uint8).ravel()
    second.width, second.row_step, second.data = 0, 0, second.data[:0]
    found = loaded(tmp_path, rows)
    assert np.isinf(found.lidar.ranges[1]).all()
    assert found.lidar.ranges[[0, 2]].min() > 0.5
