"""ROS bags, written by the library in every format: what is read equals the direct route, and oddities are named."""

import bz2
import json
import re
import sqlite3
import struct
import sys
import tracemalloc
from contextlib import closing
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import lz4.frame
import numpy as np
import pytest
from bag_files import (
    COMPRESSED,
    FORMATS,
    LATER,
    LEVEL,
    OLD_COMPRESSED,
    UPSIDE_DOWN,
    Messages,
    nanoseconds,
    rows_of,
    write_bag,
)
from box_recording import START, box_recording, room_ranges
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2.storage_mcap import zstd

import pfslam
from pfslam.__main__ import main
from pfslam.errors import DataError
from pfslam.io import packed
from pfslam.io.bags import BagOptions
from pfslam.io.headings import with_better_headings
from pfslam.io.topics import list_topics, read_topics
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, between, transform_points
from pfslam.recording import Imu, LidarScans
from pfslam.sensors import STANDARD_GRAVITY, LidarModel, RgbdModel, RobotModel, scan_points
from pfslam.texture import associate_rgb, depth_from_disparity

BOX = box_recording(images=0)
LIDAR = BOX.robot.lidar
WHEELS = dead_reckoning(BOX)
NEW = Messages()


def loaded(tmp_path, rows, form="mcap", **options):
    return pfslam.load(write_bag(tmp_path / "drive", form, rows), bag=BagOptions(**options))


def without(topic):
    return [row for row in rows_of(BOX) if row[0] != topic]


def of(rows, topic="/scan"):
    """The messages of a topic."""
    return [message for name, _, message in rows if name == topic]


def also_as(topic, new, rows):
    """The rows, and those of a topic under another name as well."""
    return [*rows, *((new, at, message) for name, at, message in rows if name == topic)]


def assert_equal_to_what_messages_carry(found, odometry):
    """The box's drive: stamps and ranges exactly, poses to rounding, angles and limits to float32."""
    np.testing.assert_array_equal(found.lidar.t, BOX.lidar.t)
    np.testing.assert_array_equal(found.lidar.ranges, BOX.lidar.ranges)
    np.testing.assert_array_equal(found.odometry.t, odometry.t)
    np.testing.assert_allclose(between(odometry.poses, found.odometry.poses), 0.0, atol=1e-9)
    lidar = found.robot.lidar
    assert (lidar.beams, lidar.sweep) == (LIDAR.beams, 0.0)
    np.testing.assert_allclose(lidar.position_b, LIDAR.position_b, atol=1e-12)
    for name in ("angle_min", "angle_max", "range_min", "range_max"):
        assert getattr(lidar, name) == pytest.approx(getattr(LIDAR, name), rel=1e-6, abs=1e-6)


# ---- the direct route --------------------------------------------------------------------------


@pytest.mark.parametrize("form", [*FORMATS, *COMPRESSED, *OLD_COMPRESSED])
def test_a_bag_holds_what_was_written(tmp_path, form):
    found = loaded(tmp_path, rows_of(BOX, form.startswith("ros1")), form)
    assert_equal_to_what_messages_carry(found, WHEELS)
    assert (found.dropped, found.notes, found.name) == ({}, (), "drive")


def test_the_sweep_is_stamped_at_its_first_beam(tmp_path):
    """This package stamps the middle beam: with the sweep known, the direct stamps come back."""
    found = loaded(tmp_path, rows_of(BOX, sweep=0.09))
    assert found.robot.lidar.sweep == pytest.approx(0.09, rel=1e-6)
    np.testing.assert_allclose(found.lidar.t, BOX.lidar.t, rtol=0, atol=1e-6)


def test_a_chunk_that_unpacks_to_gigabytes_is_refused(tmp_path):
    """Of a chunk, no more is unpacked than it says it holds."""
    path = write_bag(tmp_path / "drive", "mcap, zstd chunks", rows_of(BOX)) / "drive.mcap"
    before, kind, after = path.read_bytes().partition(b"zstd")  # then the size of what is packed, and that
    (size,) = struct.unpack("<Q", after[:8])
    bomb = (zstd.compress(bytes(2**30)) * 9)[:size]
    path.write_bytes(before + kind + after[:8] + bomb + after[8 + size :])
    with pytest.raises(DataError, match="unpack to more than"):
        pfslam.load(path.parent)


@pytest.mark.parametrize("form", [*OLD_COMPRESSED, "zstd messages", "zstd files"])
def test_what_does_not_say_how_much_it_holds_is_unpacked_up_to_a_limit(tmp_path, monkeypatch, form):
    monkeypatch.setattr(packed, "MOST", 2**20)
    bombs = {
        name: pack(bytes(2**24))
        for name, pack in (("bz2", bz2.compress), ("lz4", lz4.frame.compress), ("zstd", zstd.compress))
    }
    if form != "zstd files":
        monkeypatch.setattr(rosbag1.writer, "bz2_compress", lambda *_: bombs["bz2"])
        monkeypatch.setattr(rosbag1.writer, "lz4_compress", lambda *_: bombs["lz4"])
        monkeypatch.setattr(rosbag2.writer, "zstd", SimpleNamespace(compress=lambda _: bombs["zstd"]))
    path = write_bag(tmp_path / "drive", form, rows_of(BOX, form.startswith("ros1")))
    if form == "zstd files":
        next(path.glob("*.db3*")).write_bytes(bombs["zstd"])
    with pytest.raises(DataError, match=r"unpacks? to more than"):
        pfslam.load(path)


@pytest.mark.parametrize("base", ["base_link", "base_footprint"])
def test_odometry_that_does_not_say_what_it_moves_moves_the_base(tmp_path, base):
    rows = rows_of(BOX, child="", mount=[(base, "laser", LIDAR.position_b, LEVEL)])
    assert_equal_to_what_messages_carry(loaded(tmp_path, rows), WHEELS)


@pytest.mark.parametrize(
    ("form", "parent", "child", "clock"),
    [
        ("ros1", "odom", "base_link", 1.0),
        ("sqlite3", "odom_combined", "chassis", 0.0),
        ("mcap", "robot1/odom", "robot1/base_link", 0.0),
    ],
)
def test_odometry_from_the_tree_of_frames(tmp_path, form, parent, child, clock):
    """The frame of the odometry is one that begins with odom; the transforms' stamps may all be zero."""
    is_old = form == "ros1"
    rows = rows_of(BOX, is_old, mount=[(child, "laser", LIDAR.position_b, LEVEL)])
    rows, messages = [row for row in rows if row[0] != "/odom"], Messages(is_old)
    for t, (x, y, theta) in zip(WHEELS.t, WHEELS.poses, strict=True):
        turn = (0.0, 0.0, np.sin(theta / 2), np.cos(theta / 2))
        edges = ("map", parent, (9.0, 0.0, 0.0), LEVEL), (parent, child, (x, y, 0.0), turn)
        rows.append(("/tf", nanoseconds(t), messages.transforms(clock * t, *edges)))
    found = loaded(tmp_path, rows, form)
    assert_equal_to_what_messages_carry(found, WHEELS)
    pair = f"{parent} -> {child}"
    zero = f"the stamps on /tf ({pair}) are zero: the bag's own time is used"
    assert found.notes == (f"odometry is read from /tf: {pair}", *([] if clock else [zero]))


def test_without_scans_there_is_no_lidar(tmp_path):
    assert loaded(tmp_path, without("/scan")).lidar is None


# ---- where the LiDAR is ------------------------------------------------------------------------


def test_a_chain_of_frames_is_followed_up_and_down(tmp_path):
    """odom moves base_footprint; base_link stands on it; the plate is a child of base_link, and so on."""
    half = np.sqrt(0.5)
    mount = [
        ("base_footprint", "base_link", (0.0, 0.0, 0.1), LEVEL),
        ("plate", "base_link", (-0.2, 0.0, 0.0), LEVEL),
        ("plate", "mast", (0.0, 0.3, 0.2), (0.0, 0.0, half, half)),
        ("mast", "laser", (0.05, 0.0, 0.0), LEVEL),
    ]
    lidar = loaded(tmp_path, rows_of(BOX, mount=mount, child="base_footprint")).robot.lidar
    # plate is 0.2 m before base_link; the mast, 0.3 m to its left, looks left, and the laser 0.05 m further that way.
    np.testing.assert_allclose(lidar.position_b, (0.2, 0.35, 0.3), atol=1e-12)
    assert lidar.angle_min == pytest.approx(LIDAR.angle_min + np.pi / 2, abs=1e-6)


@pytest.mark.parametrize("way", ["upside down", "clockwise", "from behind"])
def test_beams_in_another_order_give_the_same_points(tmp_path, way):
    """A LiDAR that hangs or turns the other way; and a whole turn from angle_min = pi to angle_max = -pi."""
    round_about = LidarModel(-np.pi, np.pi - np.deg2rad(1.0), 360, position_b=LIDAR.position_b)
    lidar = round_about if way == "from behind" else LIDAR
    ranges = np.stack([room_ranges(pose, lidar) for pose in BOX.truth.poses])
    drive = replace(BOX, robot=RobotModel(lidar=lidar), lidar=LidarScans(BOX.lidar.t, ranges))
    turn = UPSIDE_DOWN if way == "upside down" else LEVEL
    rows = rows_of(drive, mount=[("base_link", "laser", lidar.position_b, turn)], sweep=0.05)
    for message in of(rows):
        if way != "upside down":
            message.angle_min, message.angle_max = message.angle_max, message.angle_min
        if way == "clockwise":
            message.angle_increment *= -1
        if way == "from behind":
            message.angle_min, message.angle_max = np.pi, -np.pi
        else:
            message.ranges = message.ranges[::-1].copy()
    found = loaded(tmp_path, rows)
    points = scan_points(found.lidar.ranges[7], found.robot.lidar)
    np.testing.assert_allclose(points, scan_points(ranges[7], lidar), atol=1e-4)
    assert found.robot.lidar.sweep == pytest.approx(0.05 if way == "from behind" else -0.05, rel=1e-6)
    hangs = "laser hangs upside down: the beams of /scan are put in the other order"
    assert found.notes == ((hangs,) if way == "upside down" else ())


# ---- the gyro ----------------------------------------------------------------------------------


def slalom():
    """Wheels that turn 1.8 times as far as the robot does, the truth, and a gyro with a bias."""
    t = START + np.arange(1200) / 20
    rate = np.where(t - START < 8, 0.0, 0.5 * np.sin(0.4 * (t - START)))
    speed = np.where(t - START < 8, 0.0, 0.4)

    def path(factor):
        heading = factor * np.concatenate([[0.0], np.cumsum(rate[1:] / 20)])
        middle = 0.5 * (heading[1:] + heading[:-1])
        steps = speed[1:, None] / 20 * np.column_stack([np.cos(middle), np.sin(middle)])
        return Trajectory(t, np.column_stack([np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]), heading]))

    imu = Imu(t, np.outer(rate + 0.01, [0, 0, 1]), np.tile([0.0, 0.0, 1.0], (len(t), 1)))
    return path(1.8), path(1.0), imu


def test_poor_turns_are_taken_from_a_gyro_that_can_be_believed():
    wheels, truth, imu = slalom()
    better, (note,) = with_better_headings(wheels, imu)
    assert note.startswith("the turns of odometry and gyro differ by 80 %: headings are taken from the gyro")
    np.testing.assert_allclose(better.poses, truth.poses, atol=1e-3)
    assert with_better_headings(truth, imu) == (truth, [])
    kept, (note,) = with_better_headings(truth, replace(imu, angular_velocity=-imu.angular_velocity))
    assert kept is truth
    assert "not alike (correlation -1.00): the gyro is not used" in note
    late = START + 1e13  # a clock that was set: a table of every second would fill the memory
    wheels, imu = (replace(part, t=np.append(part.t[:-1], late)) for part in (wheels, imu))
    assert with_better_headings(wheels, imu) == (wheels, [])


@pytest.mark.parametrize(
    ("up", "words"),
    [
        ((0.0, 0.0, -1.0), None),
        ((0.0, 1.0, 0.0), "leaning by 90 deg, as gravity says"),
        ((0.0, 0.0, -1.0), "leaning by 180 deg, as gravity says"),
        ((0.0, 0.6, 0.8), "leaning by 37 deg, as gravity says"),
        ((0.0, 0.0, 0.1), "upright, as it shows 0.10 g in the mean"),
    ],
)
def test_the_imu_is_turned_into_the_axes_of_the_body(tmp_path, up, words):
    """As its frame says (upside down), else as gravity does: the box turns left about the axis that points up."""
    at = ("base_link", "imu_link", (0, 0, 0.1), UPSIDE_DOWN)
    rows = rows_of(BOX, mount=[("base_link", "laser", LIDAR.position_b, LEVEL), *([] if words else [at])])
    size = np.linalg.norm(up)
    for t in BOX.imu.t:
        message = NEW.imu(t, 0.4 * np.array(up) / size, STANDARD_GRAVITY * np.array(up))
        rows.append(("/imu/data", nanoseconds(t), message))
    bad = NEW.imu(START + 3.001, (0, 0, np.nan), (0, 0, 9.8))
    found = loaded(tmp_path, [*rows, ("/imu/data", nanoseconds(START + 3) + 1, bad)])
    np.testing.assert_array_equal(found.imu.t, BOX.imu.t)
    np.testing.assert_allclose(found.imu.angular_velocity, BOX.imu.angular_velocity, atol=1e-9)
    np.testing.assert_allclose(found.imu.acceleration_g[:, 2], size)
    assert found.dropped == {"messages on /imu/data without usable numbers": 1}
    note = f"no chain of frames from base_link to imu_link: /imu/data is taken for {words}"
    assert found.notes == ((note,) if words else ())


# ---- scans -------------------------------------------------------------------------------------


def test_scans_with_other_angles_are_put_at_those_of_most(tmp_path):
    """A scanner that spins freely has a few beams more or less in each turn, from another first angle."""
    rows, rng = rows_of(BOX), np.random.default_rng(5)
    others = rng.choice(np.arange(1, 55), 30, replace=False)
    for k in others:
        message, fewer = of(rows)[k], replace(LIDAR, beams=LIDAR.beams - int(rng.integers(1, 5)))
        message.ranges = room_ranges(BOX.truth.poses[k], fewer).astype(np.float32)
        message.angle_increment = fewer.increment
    of(rows)[others[0]].angle_min += 1e-4  # noise
    found = loaded(tmp_path, rows)
    assert found.notes == ("scans on /scan put at the angles of most, by nearest beams: 30",)
    assert (found.dropped, len(found.lidar.t)) == ({}, 55)
    np.testing.assert_allclose(found.lidar.ranges, BOX.lidar.ranges, atol=0.05)


def test_a_scanner_of_one_beam_has_no_sweep(tmp_path):
    lidar = replace(LIDAR, angle_min=0.0, angle_max=0.0, beams=1)
    drive = replace(BOX, robot=RobotModel(lidar=lidar), lidar=replace(BOX.lidar, ranges=np.ones((55, 1))))
    found = loaded(tmp_path, rows_of(drive))
    assert (found.lidar.ranges.shape, found.robot.lidar.sweep, found.notes) == ((55, 1), 0.0, ())


# ---- what is left out is counted, and what is odd is said ---------------------------------------


def nothing_measured(rows):
    of(rows)[4].ranges[:6] = [np.nan, np.nan, np.inf, -np.inf, 0.0, 31.0]


def no_angles(rows):
    of(rows)[4].angle_increment = 0.0
    of(rows)[5].ranges = np.zeros(0, dtype=np.float32)


def two_frames(rows):
    for message in of(rows)[1::2]:
        message.header.frame_id = "rear"


def no_stamps(rows):
    for message in of(rows):
        message.header = NEW.header(0.0, "laser")


def one_without_a_stamp(rows):
    of(rows)[9].header = NEW.header(0.0, "laser")


def doubled(rows):
    rows += [row for row in rows if row[0] == "/odom"][30:32]


def no_poses(rows):
    of(rows, "/odom")[0].pose.pose.orientation = NEW.turn((0.0, 0.0, 0.0, 0.0))
    of(rows, "/odom")[9].pose.pose.position.x = np.nan


def sweep_without_end(rows):
    for message in of(rows):
        message.time_increment = 0.5 / 1080


def uneven_sweep(rows):
    for k, message in enumerate(of(rows)):
        message.time_increment = 0.08 / 1080 * (0.99, 1.0, 1.01)[k % 3]


def another_type(rows):
    cloud = NEW.make("sensor_msgs/msg/PointCloud2", header=NEW.header(START, "laser"))
    rows += [("/points", nanoseconds(t), cloud) for t in BOX.lidar.t]


def out_of_order(rows):
    scans = of(rows)
    scans[11].header, scans[12].header = scans[12].header, scans[11].header
    scans[11].ranges, scans[12].ranges = scans[12].ranges, scans[11].ranges


def late_and_silent(rows):
    """The fourth scan comes three seconds late, from the 21st on seven are missing, and nine poses: 0.25 s."""
    at = [i for i, row in enumerate(rows) if row[0] == "/scan"]
    rows[at[3]] = ("/scan", rows[at[3]][1] + 3 * 10**9, rows[at[3]][2])
    odometry = [i for i, row in enumerate(rows) if row[0] == "/odom"]
    for i in sorted(at[20:27] + odometry[200:209], reverse=True):
        del rows[i]


def clock_set(rows):
    """A robot without a battery for its clock is set when it finds the network."""
    for topic, at, message in rows:
        if topic != "/tf_static" and at > nanoseconds(START + 3.0) + LATER:
            message.header.stamp.sec += 3600


def recorder_stalls(rows):
    """For two seconds nothing reaches the bag, then everything at once: the stamps stand."""
    held, freed = nanoseconds(START + 2.0), nanoseconds(START + 4.0)
    rows[:] = [(topic, max(at, freed) if at > held else at, m) for topic, at, m in rows]


RANGES = {"not a number": 2, "infinite": 2, "zero": 1}
ODD = {
    nothing_measured: (55, {f"ranges on /scan that are {what}": n for what, n in RANGES.items()}),
    no_angles: (53, {"messages on /scan without usable angles": 2}),
    two_frames: (28, {"messages on /scan of other frames than laser": 27}),
    no_stamps: (55, {}, "the stamps on /scan are zero: the bag's own time is used"),
    one_without_a_stamp: (54, {"messages on /scan without a stamp": 1}),
    doubled: (55, {"messages on /odom with the stamp of another": 2}),
    no_poses: (55, {"messages on /odom that are no poses": 2}),
    sweep_without_end: (55, {}, "a sweep of 0.5 s on /scan is not used: a scan lasts less"),
    uneven_sweep: (55, {}),
    another_type: (55, {"messages of PointCloud2 on /points, which is not read": 55}),
    out_of_order: (55, {}, "messages on /scan out of order, put in order: 1, the first at 1300000001.400 s"),
    late_and_silent: (
        48,
        {},
        "messages on /scan late or early: 1, the first at 1300000003.602 s",
        "messages on /scan out of order, put in order: 1, the first at 1300000000.600 s",
        "no messages on /scan for 0.80 s after 1300000002.200 s, the longest gap",
    ),
    clock_set: (
        55,
        {},
        "messages on /scan late or early: 27, the first at 1300000003.102 s",
        "no messages on /scan for 3600.10 s after 1300000003.000 s, the longest gap",
        "messages on /odom late or early: 280, the first at 1300000003.012 s",
        "no messages on /odom for 3600.01 s after 1300000003.000 s, the longest gap",
    ),
    recorder_stalls: (
        55,
        {},
        "messages on /scan late or early: 10, the first at 1300000004.000 s",
        "messages on /odom late or early: 100, the first at 1300000004.000 s",
    ),
}
"""How many scans are left, what is counted as left out, and what is said."""


@pytest.mark.parametrize("change", ODD, ids=lambda change: change.__name__)
def test_what_is_left_out_is_counted_and_what_is_odd_is_said(tmp_path, change):
    rows = rows_of(BOX)
    change(rows)
    found = loaded(tmp_path, rows)
    scans, dropped, *notes = ODD[change]
    assert (len(found.lidar.t), found.dropped, found.notes) == (scans, dropped, tuple(notes))
    if change is nothing_measured:
        assert not found.robot.lidar.valid(found.lidar.ranges[4])[:6].any()
    if change is no_stamps:
        np.testing.assert_allclose(found.lidar.t, BOX.lidar.t + LATER * 1e-9, rtol=0, atol=1e-6)
    if change is uneven_sweep:
        assert found.robot.lidar.sweep == pytest.approx(0.08, rel=1e-6)
    if change in (out_of_order, recorder_stalls):
        np.testing.assert_array_equal(found.lidar.ranges, BOX.lidar.ranges)
        np.testing.assert_array_equal(found.lidar.t, BOX.lidar.t)


# ---- what cannot be used is refused by name ----------------------------------------------------


def mounted(child, place, turn):
    return rows_of(BOX, mount=[("base_link", child, place, turn)])


def moving(topic, parent, child):
    """Instead of a topic, a pair of frames whose transform changes."""
    edges = [(parent, child, (0.1 * k, 0.0, 0.3), LEVEL) for k in range(3)]
    at = [nanoseconds(START + k) for k in range(3)]
    return [
        *without(topic),
        *(("/tf", t, NEW.transforms(t * 1e-9, edge)) for t, edge in zip(at, edges, strict=True)),
    ]


def every_scan(**fields):
    rows = rows_of(BOX)
    for message in of(rows):
        vars(message).update(fields)
    return rows


def only_no_poses():
    rows = rows_of(BOX)
    for message in of(rows, "/odom"):
        message.pose.pose.orientation = NEW.turn((0.0, 0.0, 0.0, 0.0))
    return rows


NO_POSE = r"/tf .base_link -> laser. at 0\.000: found only messages that are no poses"
LEANING = (0.0, np.sin(0.2), 0.0, np.cos(0.2))
REFUSED = [
    (partial(mounted, "camera", (0, 0, 0), LEVEL), "no fixed chain of frames from base_link to laser"),
    (partial(mounted, "laser", (0, 0, 1), LEANING), "a lean of 23 deg"),
    (partial(mounted, "laser", (0, 0, 1), (0, 0, 0, 0)), NO_POSE),
    (partial(mounted, "laser", (0, 0, np.nan), LEVEL), NO_POSE),
    (partial(moving, "/tf_static", "base_link", "laser"), "place of the LiDAR: found no fixed chain"),
    (list, "odometry: found none, expected nav_msgs/Odometry, or odom -> base_link"),
    (only_no_poses, r"/odom at 1300000000\.200: found only messages that are no poses"),
    (partial(every_scan, angle_increment=0.1), "/scan.* beams over at most one turn"),
    (partial(every_scan, angle_increment=0.0), r"/scan at 1300000000\.300: .* without usable angles"),
    (partial(every_scan, angle_min=np.nan), "/scan.* beams over at most one turn"),
]


@pytest.mark.parametrize(("rows", "words"), REFUSED)
def test_what_cannot_be_used_is_refused_by_topic(tmp_path, rows, words):
    with pytest.raises(DataError, match=words):
        loaded(tmp_path, rows())


# ---- which topics ------------------------------------------------------------------------------


def test_of_two_lidars_the_usual_name_or_the_one_named(tmp_path):
    path = write_bag(tmp_path / "drive", "mcap", also_as("/scan", "/rear", rows_of(BOX))[:-5])
    found = pfslam.load(path)
    assert len(found.lidar.t) == 55
    assert found.dropped == {"messages of LaserScan on /rear, which is not read": 50}
    assert len(pfslam.load(path, bag=BagOptions(scan="rear")).lidar.t) == 50
    with pytest.raises(DataError, match="--scan /odom: found /rear, /scan, expected one topic of LaserScan"):
        pfslam.load(path, bag=BagOptions(scan="/odom"))


def test_two_lidars_without_a_usual_name_are_refused(tmp_path, capsys):
    rows = also_as("/scan", "/front", also_as("/scan", "/rear", rows_of(BOX)))
    path = str(write_bag(tmp_path / "drive", "mcap", [row for row in rows if row[0] != "/scan"]))
    assert main(["info", path]) == 2
    said = capsys.readouterr()
    assert "/front" in said.out
    assert "--scan NAME: found /front, /rear, expected one topic of LaserScan" in said.err
    assert main(["info", path, "--scan", "/front"]) == 0


def test_a_topic_of_a_type_that_nobody_defines_does_not_matter(tmp_path):
    messages, known = Messages(True), {}
    with rosbag1.Writer(tmp_path / "drive.bag") as writer:
        for topic, at, message in rows_of(BOX, True):
            kind = message.__msgtype__
            if topic not in known:
                known[topic] = writer.add_connection(topic, kind, typestore=messages.store)
            writer.write(known[topic], at, messages.store.serialize_ros1(message, kind))
        odd = writer.add_connection("/state", "acme/msg/State", msgdef="acme/Lost thing", md5sum=32 * "0")
        writer.write(odd, nanoseconds(START), bytes(8))
    assert len(pfslam.load(tmp_path / "drive.bag").lidar.t) == 55


# ---- images ------------------------------------------------------------------------------------

K = np.array([[58.0, 0.0, 31.5], [0.0, 57.0, 23.5], [0.0, 0.0, 1.0]])
PITCH, HIGH = 0.6, 0.4
EYE = RgbdModel(64, 48, 58.0, 57.0, 0.0, 31.5, 23.5, pitch=PITCH, position_b=(0.1, 0.0, HIGH))
"""A camera that looks down at the floor; its intrinsics are those of K."""
OPTICAL = [
    ("base_link", "laser", LIDAR.position_b, LEVEL),
    ("base_link", "camera", EYE.position_b, (0.0, np.sin(PITCH / 2), 0.0, np.cos(PITCH / 2))),
    ("camera", "optical", (0, 0, 0), (-0.5, 0.5, -0.5, 0.5)),  # x right, y down, z forward
]
DEPTH, COLOUR, INFO = "/camera/depth/image", "/camera/color/image", "/camera/depth/camera_info"


def view(pose):
    """What the camera sees of the floor: depth (m), 0 above the horizon; blue where y > 0 in the world, else red."""
    v, u = np.indices((48, 64))
    rays = np.stack([u, v, np.ones(u.shape)], axis=-1) @ np.linalg.inv(K).T @ EYE.T_bo[:3, :3].T
    depth = np.where(rays[..., 2] < -0.05, HIGH / np.maximum(-rays[..., 2], 0.05), 0.0)
    points_b = (depth[..., None] * rays + EYE.position_b)[..., :2].reshape(-1, 2)
    left = transform_points(pose, points_b)[:, 1].reshape(48, 64) > 0
    return depth, np.where(left[..., None], (10, 20, 250), (250, 20, 10)).astype(np.uint8)


def rows_with_images(form="mcap", encoding="32FC1", colour="rgb8", padding=0, frame="optical", order="<"):
    """The box drive with eleven pairs of images, half a second apart."""
    messages = Messages(form == "ros1")
    rows = rows_of(BOX, form == "ros1", mount=OPTICAL)
    for t in START + 0.4 + 0.5 * np.arange(11):
        depth, rgb = view(WHEELS.at(t))
        depth = (
            depth.astype(f"{order}f4") if encoding == "32FC1" else np.round(1000 * depth).astype(f"{order}u2")
        )
        rgb = rgb if colour == "rgb8" else rgb[..., ::-1]
        at = nanoseconds(t) + LATER
        rows += [
            (INFO, at, messages.camera_info(t, K, 48, 64)),
            (DEPTH, at, messages.image(t, depth, encoding, padding=padding)),
            (COLOUR, at, messages.image(t, rgb, colour, frame, padding)),
        ]
    return rows


@pytest.mark.parametrize(
    ("form", "encoding", "colour", "padding", "order"),
    [
        ("ros1", "16UC1", "bgr8", 0, "<"),
        ("mcap", "32FC1", "rgb8", 4, "<"),
        ("sqlite3", "16UC1", "rgb8", 8, ">"),
        ("mcap", "32FC1", "rgb8", 4, ">"),
    ],
)
def test_depth_and_colour_come_back(tmp_path, form, encoding, colour, padding, order):
    found = loaded(tmp_path, rows_with_images(form, encoding, colour, padding, order=order), form)
    camera, model = found.camera, found.robot.camera
    np.testing.assert_allclose(model.T_bo, EYE.T_bo, atol=1e-9)
    np.testing.assert_array_equal(model.K, K)
    assert (len(camera.disparity_index), len(camera.rgb_index), found.dropped) == (11, 11, {})
    depth, rgb = view(found.odometry.at(camera.rgb_t[7]))
    measured = depth_from_disparity(camera.read_disparity(7), model)
    np.testing.assert_array_equal(np.isnan(measured), depth == 0)
    np.testing.assert_allclose(measured[depth > 0], depth[depth > 0], atol=0.004)
    assert (camera.read_rgb(7) == rgb).mean() > 0.995
    np.testing.assert_allclose(associate_rgb(9.0, 8.0, 500.0, model), (9.0, 8.0))


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("frame", "another", "depth and colour are not registered: sizes or frames differ"),
        ("colour", "yuv422", "not read: encoding yuv422"),
        ("k", np.zeros(9), "the depth camera is not calibrated: no focal length in its CameraInfo"),
        ("k", np.full(9, np.nan), "the depth camera is not calibrated: no focal length in its CameraInfo"),
        ("info", None, None),
    ],
)
def test_images_that_do_not_fit_are_counted(tmp_path, field, value, words):
    rows = rows_with_images(**({field: value} if field in ("frame", "colour") else {}))
    for message in of(rows, INFO) if field == "k" else ():
        message.k = value
    found = loaded(tmp_path, [row for row in rows if field != "info" or row[0] != INFO])
    assert found.camera is None
    unread = [f"messages of Image on {topic}, which is not read" for topic in (DEPTH, COLOUR)]
    unfit = [f"images on {topic} ({words})" for topic in (DEPTH, COLOUR)]
    assert found.dropped == dict.fromkeys(unfit if words else unread, 11)


def test_a_damaged_image_is_named_when_it_is_read(tmp_path):
    rows = rows_with_images()
    of(rows, DEPTH)[4].data = of(rows, DEPTH)[4].data[:-5]
    camera = loaded(tmp_path, rows).camera
    assert camera.read_disparity(3).shape == (48, 64)
    with pytest.raises(DataError, match=r"/camera/depth/image at 1300000002\.402: found ValueError"):
        camera.read_disparity(4)


def test_of_two_colour_cameras_one_is_named(tmp_path):
    path = write_bag(tmp_path / "drive", "mcap", also_as(COLOUR, "/rear", rows_with_images()))
    assert pfslam.load(path).camera is None
    found = pfslam.load(path, bag=BagOptions(rgb=COLOUR))
    assert len(found.camera.rgb_index) == 11
    assert found.dropped == {"messages of Image on /rear, which is not read": 11}
    with pytest.raises(DataError, match="--depth /nowhere: found /camera/color/image"):
        pfslam.load(path, bag=BagOptions(depth="/nowhere"))


# ---- bags that are none ------------------------------------------------------------------------


def test_without_the_library_the_extra_is_named(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "drive", "ros1", [])
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(
        DataError, match=r"package: found no rosbags, expected the extra ros, or: pip install rosbags"
    ):
        pfslam.load(path)


@pytest.mark.parametrize("form", FORMATS)
def test_a_bag_that_was_cut_off_is_named(tmp_path, form):
    """The battery died while it was written."""
    path = write_bag(tmp_path / "drive", form, rows_of(BOX, form == "ros1"))
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))
    whole = file.read_bytes()
    for share in (0.3, 0.9):
        file.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(
            DataError, match=f"{path.name}: .* expected a whole ROS bag, closed by its recorder"
        ):
            pfslam.load(path)


@pytest.mark.parametrize(
    "name",
    ["a.bag", "a.mcap", "a.db3", "metadata.yaml", "drive.bag.active", "drive.mcap.zstd", "folder/a.db3"],
)
def test_files_that_are_no_bags_or_not_closed_or_packed_or_lack_their_metadata(tmp_path, name):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"not a bag")
    path = path.parent if "/" in name else path
    with pytest.raises(
        DataError, match=rf"{path.name}: bag: .* expected a whole ROS bag, .* with its metadata.yaml"
    ):
        pfslam.load(path)


def test_a_name_in_capitals_as_a_memory_stick_gives_it(tmp_path):
    path = write_bag(tmp_path / "drive", "ros1", rows_of(BOX, True)).rename(tmp_path / "DRIVE.BAG")
    assert len(pfslam.load(path).lidar.t) == 55


def test_a_recording_in_several_files_of_ros_1_is_one(tmp_path):
    rows = rows_of(BOX, True)
    half = rows[len(rows) // 2][1]
    (tmp_path / "drive").mkdir()
    for name, part in (
        ("drive_0", [r for r in rows if r[1] <= half]),
        ("drive_1", [r for r in rows if r[1] > half]),
    ):
        write_bag(tmp_path / "drive" / name, "ros1", part)
    assert_equal_to_what_messages_carry(pfslam.load(tmp_path / "drive"), WHEELS)


@pytest.mark.parametrize("form", ["sqlite3", "mcap"])
def test_a_folder_without_its_index_says_what_writes_one(tmp_path, form):
    path = write_bag(tmp_path / "drive", form, rows_of(BOX))
    (path / "metadata.yaml").unlink()
    with pytest.raises(DataError, match=r"drive: bag: found no metadata.yaml, .* `ros2 bag reindex` writes"):
        pfslam.load(path)


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (0.1, np.inf, "a largest range of inf m on /scan is none"),
        (0.1, 0.0, "a largest range of 0 m on /scan is none"),
        (0.0, 3.4e38, "a largest range of 3.4e\\+38 m on /scan is none"),
        (np.inf, 30.0, "a least range of inf m on /scan is none: 0 is used"),
    ],
)
def test_a_driver_that_states_no_limits_of_range(tmp_path, low, high, said):
    rows = rows_of(BOX)
    for scan in of(rows):
        scan.range_min, scan.range_max = low, high
    found = loaded(tmp_path, rows)
    (note,) = found.notes
    assert re.match(said, note)
    lidar = found.robot.lidar
    ranges = found.lidar.ranges
    farthest = ranges[np.isfinite(ranges)].max()
    assert lidar.range_max == pytest.approx(30.0 if high == 30.0 else farthest)
    # What is left unused is the farthest range alone, which may be what a scanner writes where nothing came back.
    assert np.count_nonzero(lidar.valid(ranges)) >= np.count_nonzero(ranges < min(farthest, lidar.range_max))


# ---- the commands ------------------------------------------------------------------------------


def test_info_lists_the_topics(tmp_path, capsys):
    assert main(["info", str(write_bag(tmp_path / "drive", "sqlite3", rows_of(BOX)))]) == 0
    said = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert said[0] == ["topic", "type", "messages", "used"]
    assert said[2] == ["/scan", "sensor_msgs/LaserScan", "55", "yes"]
    assert ["lidar", "55", "5.4", "10.0", "0.10", "s"] in said


def test_an_index_that_does_not_count_or_counts_what_is_not_there(tmp_path):
    path = write_bag(tmp_path / "drive", "mcap", rows_of(BOX))
    index = path / "metadata.yaml"
    for said in ("message_count: .*", "message_count: 55"):  # of every topic, or of the scans alone
        whole = index.read_text()
        index.write_text(re.sub(said, "message_count: 0", whole))
        assert list_topics(path)["/scan"] == ("sensor_msgs/msg/LaserScan", 55)
        assert len(pfslam.load(path).lidar.t) == 55
        index.write_text(whole)
    path = write_bag(tmp_path / "empty", "sqlite3", rows_of(BOX))
    with closing(sqlite3.connect(next(path.glob("*.db3")))) as file, file:
        file.execute("DELETE FROM messages WHERE topic_id = (SELECT id FROM topics WHERE name = '/scan')")
    with pytest.raises(DataError, match="empty: /scan: found no messages, expected 55, as the index"):
        pfslam.load(path)


def test_a_run_ends_with_what_was_left_out_and_which_checks_failed(tmp_path, capsys):
    """Odometry leaps by five metres: the leap is left out, and the check still tells."""
    rows = rows_of(BOX)
    for topic, at, message in rows:
        if topic == "/odom" and at > nanoseconds(START + 3.0):
            message.pose.pose.position.x += 5.0
    of(rows)[4].ranges[:2] = np.nan
    path, out = write_bag(tmp_path / "drive", "mcap", rows), tmp_path / "out"
    assert main(["run", str(path), "--out", str(out), "--particles", "9"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "left out: 2 ranges on /scan that are not a number"
    assert said[1] == "left out: 1 jumps of the odometry"
    assert said[2].startswith("check failed: How fast was a wheel at most? ")
    assert said[2].endswith(" m/s and 1 jumps of the odometry, expected below 10 m/s")
    (failed,) = json.loads((out / "summary.json").read_text())["checks_failed"]
    assert failed["question"] == "How fast was a wheel at most?"
    assert main(["check", str(path)]) == 1


def test_clocks_that_do_not_meet_are_refused(tmp_path, capsys):
    rows = rows_of(BOX)
    for k, message in enumerate(of(rows)):
        message.header = NEW.header(5.0 + 0.1 * k, "laser")
    path = str(write_bag(tmp_path / "drive", "mcap", rows))
    assert main(["run", path]) == 2
    apart = WHEELS.t[0] - of(rows)[-1].header.stamp.sec - of(rows)[-1].header.stamp.nanosec * 1e-9
    assert f"no scan within the odometry's time, {apart:.1f} s apart" in capsys.readouterr().err
    assert main(["check", path]) == 1
    assert "warning  Do the streams overlap?                0 %" in capsys.readouterr().out


def test_a_converted_bag_loads_without_ros_and_the_lidars_place_can_be_said(tmp_path, monkeypatch, capsys):
    path = write_bag(tmp_path / "drive", "mcap", without("/tf_static"))
    line = ["convert", str(path), str(tmp_path / "drive.npz")]
    assert main(line) == 2
    assert "--lidar-at X Y YAW" in capsys.readouterr().err
    assert main([*line, "--lidar-at", "-0.1", "0.5", "0.3"]) == 0
    note = "the LiDAR is taken to be at x -0.1 m, y 0.5 m, yaw 0.3 rad, as asked for"
    assert f"note: {note}\n" in capsys.readouterr().out
    monkeypatch.setitem(sys.modules, "rosbags", None)
    found = pfslam.load(tmp_path / "drive.npz")
    assert found.notes == (note,)
    np.testing.assert_array_equal(found.lidar.ranges, BOX.lidar.ranges)
    np.testing.assert_allclose(found.robot.lidar.position_b[:2], (-0.1, 0.5))
    assert found.robot.lidar.angle_min == pytest.approx(LIDAR.angle_min + 0.3, abs=1e-6)


@pytest.mark.slow
def test_an_hour_of_an_imu_is_kept_as_numbers_while_it_is_read(tmp_path):
    """As objects a reading takes some 2,500 bytes; its numbers, two times and a name take 72. The library adds some."""
    readings, seen = 10_000, []
    message = NEW.imu(START, (0.0, 0.0, 0.1), (0.0, 0.0, STANDARD_GRAVITY))
    rows = [("/imu", nanoseconds(START) + 5_000_000 * k, message) for k in range(readings)]
    path = write_bag(tmp_path / "imu", "mcap", rows)
    read_topics(path, ["/imu"])  # what the library itself builds up
    tracemalloc.start()
    found = read_topics(path, ["/imu"], progress=lambda them, total: seen.append(total) or them)["/imu"]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.rows.shape == (readings, 6)
    assert seen == [readings]
    assert peak < 600 * readings


@pytest.mark.slow
def test_an_hour_of_ranges_is_held_once(tmp_path):
    """A scan more takes its ranges, 8,648 bytes, and some 200 more; with its ranges held twice it would be 17,000."""
    fine, ranges = replace(LIDAR, beams=2162), np.full(2162, 2.0)
    place = [row for row in rows_of(BOX) if row[0] in ("/odom", "/tf_static")]
    peaks = []
    for scans in (500, 500, 1500):  # the first builds up what the library keeps
        stamps = nanoseconds(START) + 2_000_000 * np.arange(scans)
        rows = [("/scan", int(at), NEW.scan(at * 1e-9, ranges, fine)) for at in stamps]
        path = write_bag(tmp_path / f"drive{len(peaks)}", "mcap", rows + place)
        tracemalloc.start()
        found = pfslam.load(path)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert found.lidar.ranges.shape == (scans, 2162)
    assert peaks[2] - peaks[1] < 1000 * 1.3 * 8648


def test_a_yaw_in_degrees_is_refused_and_named(tmp_path):
    with pytest.raises(DataError, match=r"YAW: found 180, expected radians.*180 degrees are 3\.1416"):
        loaded(tmp_path, rows_of(BOX), lidar_at=(0.05, 0.0, 180.0))


def test_a_bag_with_another_kind_of_scans_only_fails_its_check_and_is_not_run(tmp_path, capsys):
    rows = rows_of(BOX)
    echoes = NEW.make("sensor_msgs/msg/MultiEchoLaserScan", header=NEW.header(START, "laser"))
    rows += [("/echoes", nanoseconds(t), echoes) for t in BOX.lidar.t]
    path = str(write_bag(tmp_path / "drive", "mcap", [row for row in rows if row[0] != "/scan"]))
    assert main(["check", path]) == 1
    assert "55 messages of MultiEchoLaserScan on /echoes, which is not read" in capsys.readouterr().out
    line = ["run", path, "--out", str(tmp_path / "out")]
    assert main(line) == 3
    assert "laser_proc" in capsys.readouterr().err
    assert main([*line, "--anyway"]) == 4
