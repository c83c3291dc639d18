"""ROS bags, written by the library in every format: what is read equals the direct route, and oddities are named."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from bag_files import (
    COMPRESSED,
    FORMATS,
    LATER,
    LEVEL,
    UPSIDE_DOWN,
    Messages,
    nanoseconds,
    rows_of,
    store_of,
    write_bag,
)
from box_recording import ROOM, START, box_recording, room_ranges, true_pose
from rosbags import rosbag1

import pfslam
from pfslam.__main__ import main
from pfslam.errors import DataError
from pfslam.io.bags import BagOptions
from pfslam.io.headings import with_better_headings
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, between, transform_points
from pfslam.recording import Imu, LidarScans
from pfslam.run import used_scans
from pfslam.sensors import STANDARD_GRAVITY, LidarModel, RgbdModel, RobotModel, scan_points
from pfslam.texture import associate_rgb, depth_from_disparity

BOX = box_recording(images=0)
NEW = Messages()
MOUNT = ("base_link", "laser", BOX.robot.lidar.position_b, LEVEL)


def poses_and_scans(recording):
    """The same drive as a robot with poses and scans records it: the direct route."""
    return replace(recording, encoders=None, imu=None, odometry=dead_reckoning(recording), truth=None)


def loaded(tmp_path, rows, form="mcap", **options):
    return pfslam.load(write_bag(tmp_path / "drive", form, rows), bag=BagOptions(**options))


def without(rows, topic):
    return [row for row in rows if row[0] != topic]


def changed(rows, topic, k, change):
    """Rows with the message number ``k`` of a topic replaced by ``change(arrival, message)``: a list of rows."""
    at = [i for i, row in enumerate(rows) if row[0] == topic][k]
    return [*rows[:at], *((topic, *new) for new in change(*rows[at][1:])), *rows[at + 1 :]]


def of(rows, topic="/scan"):
    """The messages of a topic."""
    return [message for name, _, message in rows if name == topic]


def restamped(message, t):
    message.header = NEW.header(t, message.header.frame_id)
    return message


def assert_equal_to_what_messages_carry(found, wanted):
    """Stamps and ranges exactly, poses to rounding, angles and limits to float32."""
    np.testing.assert_array_equal(found.lidar.t, wanted.lidar.t)
    np.testing.assert_array_equal(found.lidar.ranges, wanted.lidar.ranges.astype(np.float32))
    np.testing.assert_array_equal(found.odometry.t, wanted.odometry.t)
    np.testing.assert_allclose(between(wanted.odometry.poses, found.odometry.poses), 0.0, atol=1e-9)
    a, b = found.robot.lidar, wanted.robot.lidar
    assert (a.beams, a.sweep) == (b.beams, b.sweep)
    np.testing.assert_allclose(a.position_b, b.position_b, atol=1e-12)
    for name in ("angle_min", "angle_max", "range_min", "range_max"):
        assert getattr(a, name) == pytest.approx(getattr(b, name), rel=1e-6, abs=1e-6)


# ---- the direct route --------------------------------------------------------------------------


@pytest.mark.parametrize("form", [*FORMATS, *COMPRESSED])
def test_a_bag_holds_what_was_written(tmp_path, form):
    found = loaded(tmp_path, rows_of(BOX, form == "ros1"), form)
    assert_equal_to_what_messages_carry(found, poses_and_scans(BOX))
    assert (found.dropped, found.notes, found.name) == ({}, (), "drive")


@pytest.mark.parametrize("dataset", ["corridor20", "intel/intel.log"])
def test_real_drives_come_back(tmp_path, real_data, dataset):
    direct = pfslam.load(real_data / dataset)
    if direct.odometry is None:
        keep = slice(None, 1000)
        direct = poses_and_scans(
            replace(direct, lidar=LidarScans(direct.lidar.t[keep], direct.lidar.ranges[keep]))
        )
    rows = rows_of(direct, odometry=direct.odometry)
    assert_equal_to_what_messages_carry(loaded(tmp_path, rows), direct)


def test_the_sweep_is_stamped_at_its_first_beam(tmp_path):
    """This package stamps the middle beam: with the sweep known, the direct stamps come back."""
    found = loaded(tmp_path, rows_of(BOX, sweep=0.09))
    assert found.robot.lidar.sweep == pytest.approx(0.09, rel=1e-6)
    np.testing.assert_allclose(found.lidar.t, BOX.lidar.t, atol=1e-6)


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
    rows = rows_of(BOX, mount=mount, child="base_footprint")
    lidar = loaded(tmp_path, rows).robot.lidar
    # plate is 0.2 m before base_link; the mast, 0.3 m to its left, looks left, and the laser 0.05 m further that way.
    np.testing.assert_allclose(lidar.position_b, (0.2, 0.35, 0.3), atol=1e-12)
    assert lidar.angle_min == pytest.approx(BOX.robot.lidar.angle_min + np.pi / 2, abs=1e-6)


def test_upside_down_gives_the_same_points(tmp_path):
    """A LiDAR that hangs upside down measures the same room in the other order."""
    x, y, z = BOX.robot.lidar.position_b
    hanging = replace(BOX, lidar=replace(BOX.lidar, ranges=BOX.lidar.ranges[:, ::-1]))
    rows = rows_of(hanging, mount=[("base_link", "laser", (x, y, z), UPSIDE_DOWN)], sweep=0.05)
    found = loaded(tmp_path, rows)
    wanted = scan_points(BOX.lidar.ranges[7], BOX.robot.lidar)
    np.testing.assert_allclose(scan_points(found.lidar.ranges[7], found.robot.lidar), wanted, atol=1e-6)
    assert found.robot.lidar.sweep == pytest.approx(-0.05, rel=1e-6)
    assert "laser hangs upside down: the beams of /scan are put in the other order" in found.notes


def test_a_clockwise_scanner_gives_the_same_points(tmp_path):
    rows = rows_of(BOX)
    for message in of(rows):
        message.angle_min, message.angle_max = message.angle_max, message.angle_min
        message.angle_increment, message.ranges = -message.angle_increment, message.ranges[::-1].copy()
    found = loaded(tmp_path, rows)
    wanted = scan_points(BOX.lidar.ranges[7], BOX.robot.lidar)
    np.testing.assert_allclose(scan_points(found.lidar.ranges[7], found.robot.lidar), wanted, atol=1e-6)


def test_a_clockwise_sweep_is_straightened():
    """Each beam is cast from where the robot is at its moment; with the sweep's sign, all end on the walls."""
    lidar = LidarModel(-2.0, 2.0, 61, position_b=(0.1, 0.0, 0.3))
    t, x = BOX.lidar.t[25], np.arange(61)
    at = t + (0.5 - x / 60) * 0.2  # the last beam first
    poses = true_pose(at - BOX.imu.t[0])
    ranges = np.array([room_ranges(pose, lidar)[k] for k, pose in enumerate(poses)])
    off = {}
    for sweep in (-0.2, 0.0, 0.2):
        scans = LidarScans(np.array([t]), ranges[None])
        drive = replace(BOX, robot=RobotModel(lidar=replace(lidar, sweep=sweep)), lidar=scans)
        (event,) = used_scans(drive, pfslam.SlamConfig.refined()).events()
        px, py = transform_points(true_pose(t - BOX.imu.t[0]), event.points_b).T
        walls = np.abs([px - ROOM[0], px - ROOM[1], py - ROOM[2], py - ROOM[3]])
        off[sweep] = walls.min(axis=0).max()
    assert off[-0.2] < 0.005
    assert off[0.0] > 0.04
    assert off[0.2] > 0.08


def test_the_place_can_be_said(tmp_path):
    rows = without(rows_of(BOX), "/tf_static")
    found = loaded(tmp_path, rows, lidar_at=(0.5, -0.1, 0.3))
    np.testing.assert_allclose(found.robot.lidar.position_b[:2], (0.5, -0.1))
    assert found.robot.lidar.angle_min == pytest.approx(BOX.robot.lidar.angle_min + 0.3, abs=1e-6)
    assert "the LiDAR is taken to be at x 0.5 m, y -0.1 m, yaw 0.3 rad, as asked for" in found.notes


NO_POSE = (
    r"/tf .base_link -> laser. at 0\.000: found only messages that are no poses, .* quaternion of length 1"
)


@pytest.mark.parametrize(
    ("mount", "words"),
    [
        ([("base_link", "camera", (0, 0, 0), LEVEL)], "no fixed chain of frames from base_link to laser"),
        ([("base_link", "laser", (0, 0, 1), (0.0, np.sin(0.2), 0.0, np.cos(0.2)))], "a lean of 23 deg"),
        ([("base_link", "laser", (0, 0, 1), (0, 0, 0, 0))], NO_POSE),
        ([("base_link", "laser", (0, 0, np.nan), LEVEL)], NO_POSE),
    ],
)
def test_a_place_that_is_no_place_is_refused(tmp_path, mount, words):
    with pytest.raises(DataError, match=words):
        loaded(tmp_path, rows_of(BOX, mount=mount))


def test_a_lidar_that_moves_on_the_robot_is_refused(tmp_path):
    rows = without(rows_of(BOX), "/tf_static")
    for k in range(3):
        moving = NEW.transforms(START + k, ("base_link", "laser", (0.1 * k, 0.0, 0.3), LEVEL))
        rows.append(("/tf", nanoseconds(START + k), moving))
    with pytest.raises(DataError, match="/scan, place of the LiDAR: found no fixed chain"):
        loaded(tmp_path, sorted(rows, key=lambda row: row[1]))


# ---- odometry ----------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["ros1", "sqlite3"])
def test_odometry_from_the_tree_of_frames(tmp_path, form):
    messages, wanted = Messages(form == "ros1"), dead_reckoning(BOX)
    rows = without(rows_of(BOX, form == "ros1"), "/odom")
    for t, (x, y, theta) in zip(wanted.t, wanted.poses, strict=True):
        turn = (0.0, 0.0, np.sin(theta / 2), np.cos(theta / 2))
        edges = [("map", "odom", (9.0, 0.0, 0.0), LEVEL), ("odom", "base_link", (x, y, 0.0), turn)]
        rows.append(("/tf", nanoseconds(t), messages.transforms(t, *edges)))
    found = loaded(tmp_path, sorted(rows, key=lambda row: row[1]), form)
    np.testing.assert_array_equal(found.odometry.t, wanted.t)
    np.testing.assert_allclose(found.odometry.poses, wanted.poses, atol=1e-9)
    assert found.notes == ("odometry is read from /tf: odom -> base_link",)


@pytest.mark.parametrize("base", ["base_link", "base_footprint"])
def test_odometry_that_does_not_say_what_it_moves_moves_the_base(tmp_path, base):
    rows = rows_of(BOX, child="", mount=[(base, "laser", BOX.robot.lidar.position_b, LEVEL)])
    assert_equal_to_what_messages_carry(loaded(tmp_path, rows), poses_and_scans(BOX))


def test_without_any_odometry_it_says_what_would_do(tmp_path):
    with pytest.raises(
        DataError, match="odometry: found none, expected nav_msgs/Odometry, or odom -> base_link"
    ):
        loaded(tmp_path, without(rows_of(BOX), "/odom"))


def test_without_scans_there_is_dead_reckoning(tmp_path, capsys):
    path = write_bag(tmp_path / "drive", "mcap", without(rows_of(BOX), "/scan"))
    assert pfslam.load(path).lidar is None
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 0
    assert "no LiDAR" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("parent", "child"), [("odom_combined", "chassis"), ("robot1/odom", "robot1/base_link")]
)
def test_other_names_of_frames_and_a_clock_at_zero(tmp_path, parent, child):
    """The frame of the odometry is one that begins with odom; the transforms' stamps are all zero."""
    wanted = dead_reckoning(BOX)
    mount = [(child, "laser", BOX.robot.lidar.position_b, LEVEL)]
    rows = without(rows_of(BOX, mount=mount), "/odom")
    for t, (x, y, theta) in zip(wanted.t, wanted.poses, strict=True):
        turn = (0.0, 0.0, np.sin(theta / 2), np.cos(theta / 2))
        rows.append(("/tf", nanoseconds(t), NEW.transforms(0.0, (parent, child, (x, y, 0.0), turn))))
    found = loaded(tmp_path, sorted(rows, key=lambda row: row[1]))
    np.testing.assert_array_equal(found.odometry.t, wanted.t)
    np.testing.assert_allclose(found.odometry.poses, wanted.poses, atol=1e-9)
    assert found.notes == (
        f"odometry is read from /tf: {parent} -> {child}",
        f"the stamps on /tf ({parent} -> {child}) are zero: the bag's own time is used",
    )


def test_what_moves_is_named_where_no_odometry_is_found(tmp_path):
    rows = without(rows_of(BOX), "/odom")
    for k in range(3):
        moved = NEW.transforms(START + k, ("world", "base_link", (0.1 * k, 0.0, 0.0), LEVEL))
        rows.append(("/tf", nanoseconds(START + k), moved))
    with pytest.raises(
        DataError, match="odometry: found world -> base_link on /tf, expected nav_msgs/Odometry"
    ):
        loaded(tmp_path, sorted(rows, key=lambda row: row[1]))


def test_odometry_that_is_no_pose_is_counted(tmp_path):
    rows = rows_of(BOX)
    said = of(rows, "/odom")
    said[0].pose.pose.orientation = NEW.turn((0.0, 0.0, 0.0, 0.0))
    said[9].pose.pose.position.x = np.nan
    found = loaded(tmp_path, rows)
    assert found.dropped == {"messages on /odom that are no poses": 2}
    assert len(found.odometry) == len(dead_reckoning(BOX)) - 2
    for message in said:
        message.pose.pose.orientation = NEW.turn((0.0, 0.0, 0.0, 0.0))
    with pytest.raises(DataError, match=r"/odom at 1300000000\.200: found only messages that are no poses"):
        pfslam.load(write_bag(tmp_path / "none", "mcap", rows))


# ---- the gyro ----------------------------------------------------------------------------------


def slalom(seconds=60.0):
    """Wheels that turn 1.8 times as far as the robot does, a gyro with a bias, and the truth."""
    t = START + np.arange(round(seconds * 20)) / 20
    rate = np.where(t - START < 8, 0.0, 0.5 * np.sin(0.4 * (t - START)))
    speed = np.where(t - START < 8, 0.0, 0.4)

    def path(factor):
        heading = factor * np.concatenate([[0.0], np.cumsum(rate[1:] / 20)])
        middle = 0.5 * (heading[1:] + heading[:-1])
        steps = speed[1:, None] / 20 * np.column_stack([np.cos(middle), np.sin(middle)])
        return Trajectory(t, np.column_stack([np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]), heading]))

    gyro = np.zeros((len(t), 3))
    gyro[:, 2] = rate + 0.01
    return path(1.8), path(1.0), Imu(t, gyro, np.tile([0.0, 0.0, 1.0], (len(t), 1)))


def test_poor_turns_are_taken_from_the_gyro():
    wheels, truth, imu = slalom()
    better, (note,) = with_better_headings(wheels, imu)
    assert note.startswith("the turns of odometry and gyro differ by 80 %: headings are taken from the gyro")
    np.testing.assert_allclose(better.poses, truth.poses, atol=1e-3)


def test_good_turns_are_left_alone_and_a_flipped_gyro_is_not_believed():
    _, truth, imu = slalom()
    assert with_better_headings(truth, imu) == (truth, [])
    flipped = replace(imu, angular_velocity=-imu.angular_velocity)
    kept, (note,) = with_better_headings(truth, flipped)
    assert kept is truth
    assert "not alike (correlation -1.00): the gyro is not used" in note


def test_the_check_up_does_not_praise_turns_that_were_replaced(tmp_path, capsys):
    """Headings that are the gyro's agree with the gyro: that is said, and no answer."""
    wheels, _, imu = slalom()
    scans = LidarScans(wheels.t[:2], np.ones((2, BOX.robot.lidar.beams), dtype=np.float32))
    rows = rows_of(
        replace(BOX, lidar=scans), odometry=wheels, mount=[MOUNT, ("base_link", "imu_link", (0, 0, 0), LEVEL)]
    )
    for t, rates, pushes in zip(imu.t, imu.angular_velocity, imu.acceleration_g, strict=True):
        rows.append(("/imu", nanoseconds(t), NEW.imu(t, rates, STANDARD_GRAVITY * pushes)))
    path = write_bag(tmp_path / "drive", "mcap", sorted(rows, key=lambda row: row[1]))
    main(["check", str(path)])
    said = capsys.readouterr().out
    assert "-        Do wheels and gyro turn the same way?  the odometry turns by the gyro" in said
    assert "note: the turns of odometry and gyro differ by 80 %: headings are taken from the gyro" in said


def test_stamps_that_span_an_age_are_left_alone():
    wheels, _, imu = slalom()
    late = START + 1e13  # a clock that was set: a table of every second would fill the memory
    odometry, gyro = (
        replace(wheels, t=np.append(wheels.t[:-1], late)),
        replace(imu, t=np.append(imu.t[:-1], late)),
    )
    assert with_better_headings(odometry, gyro) == (odometry, [])


def test_the_imu_is_turned_into_the_axes_of_the_body(tmp_path):
    """It hangs upside down and shows -0.4 rad/s for the box's turn to the left, and gravity pointing down."""
    mount = [MOUNT, ("base_link", "imu_link", (0, 0, 0.1), UPSIDE_DOWN)]
    rows = rows_of(BOX, mount=mount)
    for t, rates, pushes in zip(BOX.imu.t, BOX.imu.angular_velocity, BOX.imu.acceleration_g, strict=True):
        rows.append(("/imu/data", nanoseconds(t), NEW.imu(t, -rates, -STANDARD_GRAVITY * pushes)))
    rows.append(
        ("/imu/data", nanoseconds(START + 3) + 1, NEW.imu(START + 3.001, (0, 0, np.nan), (0, 0, 9.8)))
    )
    found = loaded(tmp_path, sorted(rows, key=lambda row: row[1]))
    np.testing.assert_array_equal(found.imu.t, BOX.imu.t)
    np.testing.assert_allclose(found.imu.angular_velocity[:, 2], 0.4, atol=1e-12)
    np.testing.assert_allclose(found.imu.acceleration_g[:, 2], 1.0, atol=1e-12)
    assert found.dropped == {"messages on /imu/data without usable numbers": 1}
    assert found.notes == ()


@pytest.mark.parametrize(
    ("up", "level", "words"),
    [
        ((0.0, 0.0, 1.0), 1.0, "leaning by 0 deg, as gravity says"),
        ((0.0, 1.0, 0.0), 1.0, "leaning by 90 deg, as gravity says"),
        ((0.0, 0.0, -1.0), 1.0, "leaning by 180 deg, as gravity says"),
        ((0.0, 0.6, 0.8), 1.0, "leaning by 37 deg, as gravity says"),
        ((0.0, 0.0, 0.1), 0.1, "upright, as it shows 0.10 g in the mean"),
    ],
)
def test_an_imu_without_a_frame_stands_as_gravity_says(tmp_path, up, level, words):
    """The box turns left by 0.4 rad/s; the axis about which the gyro shows that points up."""
    rows = rows_of(BOX)
    about = np.array(up) / np.linalg.norm(up)
    for t in BOX.imu.t:
        rows.append(("/imu/data", nanoseconds(t), NEW.imu(t, 0.4 * about, STANDARD_GRAVITY * np.array(up))))
    found = loaded(tmp_path, sorted(rows, key=lambda row: row[1]))
    np.testing.assert_allclose(
        found.imu.angular_velocity, np.tile([0, 0, 0.4], (len(BOX.imu.t), 1)), atol=1e-9
    )
    np.testing.assert_allclose(found.imu.acceleration_g[:, 2], level)
    assert found.notes == (f"no chain of frames from base_link to imu_link: /imu/data is taken for {words}",)


# ---- time --------------------------------------------------------------------------------------


def test_messages_out_of_order_are_put_in_order(tmp_path):
    rows = rows_of(BOX)
    at = [i for i, row in enumerate(rows) if row[0] == "/scan"]
    i, j = at[11], at[12]
    rows[i], rows[j] = (*rows[i][:2], rows[j][2]), (*rows[j][:2], rows[i][2])
    found = loaded(tmp_path, rows)
    np.testing.assert_array_equal(found.lidar.ranges, BOX.lidar.ranges)
    when = f"{BOX.lidar.t[11]:.3f}"
    assert found.notes == (f"messages on /scan out of order, put in order: 1, the first at {when} s",)


def test_late_messages_and_gaps_are_spoken_of(tmp_path):
    rows = changed(rows_of(BOX), "/scan", 3, lambda at, m: [(at + 3 * 10**9, m)])
    for _ in range(9):
        rows = changed(rows, "/odom", 200, lambda at, m: [])
    rows = changed(rows, "/scan", 20, lambda at, m: [])
    for _ in range(6):
        rows = changed(rows, "/scan", 20, lambda at, m: [])
    found = loaded(tmp_path, sorted(rows, key=lambda row: row[1]))
    late = START + 0.6 + 3 + LATER * 1e-9
    assert f"messages on /scan late or early: 1, the first at {late:.3f} s" in found.notes
    assert any(note.startswith("no messages on /scan for 0.80 s after") for note in found.notes)
    assert not any("no messages on /odom" in note for note in found.notes)


def test_a_clock_that_is_set_during_the_drive_is_spoken_of(tmp_path):
    """A robot without a battery for its clock starts at some time, and is set when it finds the network."""
    rows = rows_of(BOX)
    for topic, at, message in rows:
        if topic != "/tf_static" and at > nanoseconds(START + 3.0) + LATER:
            message.header.stamp.sec += 3600
    found = loaded(tmp_path, rows)
    assert len(found.lidar.t) == len(BOX.lidar.t)
    for topic in ("/scan", "/odom"):
        assert any(note.startswith(f"no messages on {topic} for 3600.") for note in found.notes)
    assert any("late or early" in note for note in found.notes)


def test_a_recorder_that_stalls_is_no_jump_of_a_clock(tmp_path):
    """For two seconds nothing reaches the bag, then everything at once: the stamps stand."""
    held, freed = nanoseconds(START + 2.0), nanoseconds(START + 4.0)
    rows = [(topic, max(at, freed) if at > held else at, m) for topic, at, m in rows_of(BOX)]
    found = loaded(tmp_path, rows)
    np.testing.assert_array_equal(found.lidar.t, BOX.lidar.t)
    assert [note.split(",")[0] for note in found.notes] == [
        f"messages on {topic} late or early: {count}" for count, topic in ((10, "/scan"), (100, "/odom"))
    ]


def test_clocks_that_do_not_meet_are_refused(tmp_path, capsys):
    rows = rows_of(BOX)
    for message in of(rows):
        restamped(message, message.header.stamp.sec - START + 5.0)
    path = str(write_bag(tmp_path / "drive", "mcap", rows))
    assert main(["run", path]) == 2
    assert "no scan within the odometry's time" in capsys.readouterr().err
    assert main(["check", path]) == 1
    assert "FAILED   Do the streams overlap?                0 %" in capsys.readouterr().out


# ---- scans -------------------------------------------------------------------------------------


def test_scans_with_other_angles_are_put_at_those_of_most(tmp_path):
    """A scanner that spins freely has a few beams more or less in each turn, from another first angle."""
    rows, lidar = rows_of(BOX), BOX.robot.lidar
    rng = np.random.default_rng(5)
    others = rng.choice(np.arange(1, 55), 30, replace=False)
    for k in others:
        message, fewer = of(rows)[k], replace(lidar, beams=lidar.beams - int(rng.integers(1, 5)))
        message.ranges = room_ranges(BOX.truth.poses[k], fewer).astype(np.float32)
        message.angle_increment = fewer.increment
    of(rows)[others[0]].angle_min += 1e-4  # noise
    found = loaded(tmp_path, rows)
    assert found.notes == ("scans on /scan put at the angles of most, by nearest beams: 30",)
    assert (found.dropped, len(found.lidar.t)) == ({}, 55)
    np.testing.assert_allclose(found.lidar.ranges, BOX.lidar.ranges, atol=0.05)
    run = pfslam.run_slam(found, replace(pfslam.SlamConfig.refined(), particles=20))
    assert pfslam.trajectory_error(run.trajectory, BOX.truth).ate_max_m < 0.05


def test_a_scanner_of_one_beam_has_no_sweep(tmp_path):
    lidar = LidarModel(0.0, 0.0, 1, position_b=BOX.robot.lidar.position_b)
    ranges = np.stack([room_ranges(pose, lidar) for pose in BOX.truth.poses])
    rows = rows_of(replace(BOX, robot=RobotModel(lidar=lidar), lidar=LidarScans(BOX.lidar.t, ranges)))
    for message in of(rows):
        message.scan_time = 0.1
    found = loaded(tmp_path, rows)
    assert (found.lidar.ranges.shape, found.robot.lidar.sweep, found.notes) == ((55, 1), 0.0, ())


def test_a_whole_turn_may_end_before_it_begins(tmp_path):
    """From 180 degrees on, all around, as angle_min = pi and angle_max = -pi say it."""
    lidar = LidarModel(-np.pi, np.pi - np.deg2rad(1.0), 360)
    ranges = np.stack([room_ranges(pose, lidar) for pose in BOX.truth.poses])
    round_about = replace(BOX, robot=RobotModel(lidar=lidar), lidar=LidarScans(BOX.lidar.t, ranges))
    rows = rows_of(round_about, mount=[("base_link", "laser", lidar.position_b, LEVEL)])
    for message in of(rows):
        message.angle_min, message.angle_max = np.pi, -np.pi
    found = loaded(tmp_path, rows)
    assert found.notes == ()
    assert found.robot.lidar.angle_min == pytest.approx(-np.pi, abs=1e-6)
    points = scan_points(found.lidar.ranges[9], found.robot.lidar)
    np.testing.assert_allclose(points, scan_points(ranges[9], lidar), atol=1e-4)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("angle_increment", 0.1, "beams over at most one turn"),
        ("angle_increment", 0.0, r"/scan at 1300000000\.300: found only messages without usable angles"),
        ("range_max", 0.05, "range_min, range_max"),
        ("range_max", np.inf, "range_max: found inf"),
        ("angle_min", np.nan, "beams over at most one turn"),
    ],
)
def test_a_scanner_that_cannot_be_is_refused_by_topic(tmp_path, field, value, words):
    rows = rows_of(BOX)
    for message in of(rows):
        setattr(message, field, value)
    with pytest.raises(DataError, match=words) as caught:
        loaded(tmp_path, rows)
    assert "/scan" in str(caught.value)


# ---- what is left out is counted, and what is odd is said ---------------------------------------


def nothing_measured(rows):
    of(rows)[4].ranges[:6] = [np.nan, np.nan, np.inf, -np.inf, 0.0, 31.0]


def no_angles(rows):
    of(rows)[4].angle_increment = 0.0
    of(rows)[5].ranges = np.zeros(0, dtype=np.float32)


def two_frames(rows):
    for message in of(rows)[1::2]:
        message.header = NEW.header(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec, "rear")


def no_stamps(rows):
    for message in of(rows):
        restamped(message, 0.0)


def one_without_a_stamp(rows):
    restamped(of(rows)[9], 0.0)


def doubled(rows):
    i = [k for k, row in enumerate(rows) if row[0] == "/odom"][30]
    rows[i:i] = [rows[i], rows[i]]


def endless_sweep(rows):
    for message in of(rows):
        message.time_increment = 0.5 / 1080


def uneven_sweep(rows):
    for k, message in enumerate(of(rows)):
        message.time_increment = 0.08 / 1080 * (0.99, 1.0, 1.01)[k % 3]


def other_types(rows):
    for kind in ("PointCloud2", "MultiEchoLaserScan"):
        rows += [(f"/{kind}s", nanoseconds(t) + LATER, NEW.other_scan(kind, t)) for t in BOX.lidar.t]


ODD = {
    nothing_measured: (
        55,
        {
            "ranges on /scan that are not a number": 2,
            "ranges on /scan that are infinite": 2,
            "ranges on /scan that are zero": 1,
        },
        (),
    ),
    no_angles: (53, {"messages on /scan without usable angles": 2}, ()),
    two_frames: (28, {"messages on /scan of other frames than laser": 27}, ()),
    no_stamps: (55, {}, ("the stamps on /scan are zero: the bag's own time is used",)),
    one_without_a_stamp: (54, {"messages on /scan without a stamp": 1}, ()),
    doubled: (55, {"messages on /odom with the stamp of another": 2}, ()),
    endless_sweep: (55, {}, ("a sweep of 0.5 s on /scan is not used: a scan lasts less",)),
    uneven_sweep: (55, {}, ()),
    other_types: (
        55,
        {
            f"messages of {kind} on /{kind}s, which is not read": 55
            for kind in ("MultiEchoLaserScan", "PointCloud2")
        },
        (),
    ),
}


@pytest.mark.parametrize("change", ODD, ids=lambda change: change.__name__)
def test_what_is_left_out_is_counted_and_what_is_odd_is_said(tmp_path, change):
    rows = rows_of(BOX)
    change(rows)
    found = loaded(tmp_path, sorted(rows, key=lambda row: row[1]))
    assert (len(found.lidar.t), found.dropped, found.notes) == ODD[change]
    assert len(found.odometry.t) == len(dead_reckoning(BOX).t)
    if change is nothing_measured:
        assert not found.robot.lidar.valid(found.lidar.ranges[4])[:6].any()
    if change is no_stamps:
        np.testing.assert_allclose(found.lidar.t, BOX.lidar.t + LATER * 1e-9, atol=1e-6)
    if change is uneven_sweep:
        assert found.robot.lidar.sweep == pytest.approx(0.08, rel=1e-6)


# ---- which topics ------------------------------------------------------------------------------


def test_of_two_lidars_the_usual_name_or_the_one_named(tmp_path):
    rows = rows_of(BOX)
    rear = [("/rear", at, message) for topic, at, message in rows if topic == "/scan"][:30]
    both = sorted([*rows, *rear], key=lambda row: row[1])
    path = write_bag(tmp_path / "drive", "mcap", both)
    found = pfslam.load(path)
    assert (len(found.lidar.t), found.dropped) == (
        55,
        {"messages of LaserScan on /rear, which is not read": 30},
    )
    assert len(pfslam.load(path, bag=BagOptions(scan="rear")).lidar.t) == 30
    with pytest.raises(DataError, match="--scan /odom: found /rear, /scan, expected one topic of LaserScan"):
        pfslam.load(path, bag=BagOptions(scan="/odom"))


def test_two_lidars_without_a_usual_name_are_refused(tmp_path, capsys):
    rows = rows_of(BOX)
    rear = [("/rear", at, message) for topic, at, message in rows if topic == "/scan"]
    rows = sorted(
        [("/front" if topic == "/scan" else topic, *row) for topic, *row in rows] + rear,
        key=lambda row: row[1],
    )
    path = write_bag(tmp_path / "drive", "mcap", rows)
    assert main(["info", str(path)]) == 2
    said = capsys.readouterr()
    assert "/front" in said.out
    assert "--scan NAME: found /front, /rear, expected one topic of LaserScan" in said.err
    assert main(["info", str(path), "--scan", "/front"]) == 0


def test_a_topic_of_a_type_that_nobody_defines_does_not_matter(tmp_path):
    store, known = store_of(True), {}
    with rosbag1.Writer(tmp_path / "drive.bag") as writer:
        for topic, at, message in rows_of(BOX, True):
            kind = message.__msgtype__
            if topic not in known:
                known[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(known[topic], at, store.serialize_ros1(message, kind))
        odd = writer.add_connection("/state", "acme/msg/State", msgdef="acme/Lost thing", md5sum=32 * "0")
        writer.write(odd, nanoseconds(START), bytes(8))
    assert len(pfslam.load(tmp_path / "drive.bag").lidar.t) == 55


# ---- images ------------------------------------------------------------------------------------

K = np.array([[58.0, 0.0, 31.5], [0.0, 57.0, 23.5], [0.0, 0.0, 1.0]])
PITCH = 0.6
HIGH = 0.4
EYE = RgbdModel(64, 48, 58.0, 57.0, 0.0, 31.5, 23.5, pitch=PITCH, position_b=(0.1, 0.0, HIGH))
"""A camera that looks down at the floor; its intrinsics are those of K."""


def rotation(axis, angle):
    return (*np.sin(angle / 2) * np.eye(3)[axis], np.cos(angle / 2))


OPTICAL = [
    MOUNT,
    ("base_link", "camera", EYE.position_b, rotation(1, PITCH)),
    ("camera", "optical", (0, 0, 0), (-0.5, 0.5, -0.5, 0.5)),  # x right, y down, z forward
]


def view(pose):
    """What the camera sees of the floor: depth (m), 0 above the horizon; blue where y > 0 in the world, else red."""
    v, u = np.indices((48, 64))
    rays = np.stack([u, v, np.ones(u.shape)], axis=-1) @ np.linalg.inv(K).T @ EYE.T_bo[:3, :3].T
    depth = np.where(rays[..., 2] < -0.05, HIGH / np.maximum(-rays[..., 2], 0.05), 0.0)
    points_b = (depth[..., None] * rays + EYE.position_b)[..., :2].reshape(-1, 2)
    left = transform_points(pose, points_b)[:, 1].reshape(48, 64) > 0
    return depth, np.where(left[..., None], (10, 20, 250), (250, 20, 10)).astype(np.uint8)


def rows_with_images(form, encoding="32FC1", colour="rgb8", padding=0, frame="optical"):
    """The box drive with eleven pairs of images, half a second apart."""
    messages, path = Messages(form == "ros1"), dead_reckoning(BOX)
    rows = rows_of(BOX, form == "ros1", mount=OPTICAL)
    for t in START + 0.4 + 0.5 * np.arange(11):
        depth, rgb = view(path.at(t))
        depth = depth.astype(np.float32) if encoding == "32FC1" else np.round(1000 * depth).astype(np.uint16)
        rgb = rgb if colour == "rgb8" else rgb[..., ::-1]
        at = nanoseconds(t) + LATER
        rows += [
            ("/camera/depth/camera_info", at, messages.camera_info(t, K, 48, 64)),
            ("/camera/depth/image", at, messages.image(t, depth, encoding, padding=padding)),
            ("/camera/color/image", at, messages.image(t, rgb, colour, frame, padding)),
        ]
    return sorted(rows, key=lambda row: row[1])


@pytest.mark.parametrize(
    ("form", "encoding", "colour", "padding"),
    [("ros1", "16UC1", "bgr8", 0), ("mcap", "32FC1", "rgb8", 4), ("sqlite3", "16UC1", "rgb8", 8)],
)
def test_depth_and_colour_come_back(tmp_path, form, encoding, colour, padding):
    found = loaded(tmp_path, rows_with_images(form, encoding, colour, padding), form)
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


def test_the_floor_is_painted_from_a_bag(tmp_path):
    """Blue lies where y > 0, red elsewhere."""
    found = loaded(tmp_path, rows_with_images("mcap"))
    texture = pfslam.map_texture(found, found.odometry)
    iy, ix = np.nonzero(texture.seen)
    y = texture.spec.cell_to_world(np.column_stack([ix, iy]))[:, 1]
    blue = texture.rgb[iy, ix, 2] > 128
    assert len(y) > 300
    assert (blue == (y > 0))[np.abs(y) > 0.06].all()
    assert 0.1 < blue.mean() < 0.9


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
    rows = rows_with_images("mcap", **({field: value} if field in ("frame", "colour") else {}))
    for message in of(rows, "/camera/depth/camera_info") if field == "k" else ():
        message.k = value
    found = loaded(tmp_path, without(rows, "/camera/depth/camera_info") if field == "info" else rows)
    assert found.camera is None
    topics = [f"/camera/{kind}/image" for kind in ("depth", "color")]
    unread = [f"messages of Image on {topic}, which is not read" for topic in topics]
    unfit = [f"images on {topic} ({words})" for topic in topics]
    assert found.dropped == dict.fromkeys(unfit if words else unread, 11)


def test_a_damaged_image_is_named_when_it_is_read(tmp_path):
    rows = rows_with_images("mcap")
    short = of(rows, "/camera/depth/image")[4]
    short.data = short.data[:-5]
    camera = loaded(tmp_path, rows).camera
    assert camera.read_disparity(3).shape == (48, 64)
    with pytest.raises(DataError, match=r"/camera/depth/image at 1300000002\.402: found ValueError"):
        camera.read_disparity(4)


def test_of_two_colour_cameras_one_is_named(tmp_path):
    rows = rows_with_images("mcap")
    rows += [("/rear", at, message) for topic, at, message in rows if topic == "/camera/color/image"]
    path = write_bag(tmp_path / "drive", "mcap", sorted(rows, key=lambda row: row[1]))
    assert pfslam.load(path).camera is None
    found = pfslam.load(path, bag=BagOptions(rgb="/camera/color/image"))
    assert len(found.camera.rgb_index) == 11
    assert found.dropped == {"messages of Image on /rear, which is not read": 11}
    with pytest.raises(DataError, match="--depth /nowhere: found /camera/color/image"):
        pfslam.load(path, bag=BagOptions(depth="/nowhere"))


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_depth_of_another_byte_order(tmp_path, encoding):
    rows = rows_with_images("mcap", encoding, padding=4)
    for message in of(rows, "/camera/depth/image"):
        pixels = message.data.reshape(48, -1)[:, :-4].reshape(48, 64, int(encoding[:2]) // 8)[..., ::-1]
        message.data, message.is_bigendian = np.pad(pixels.reshape(48, -1), ((0, 0), (0, 4))).ravel(), 1
    camera = loaded(tmp_path, rows).camera
    plain = pfslam.load(write_bag(tmp_path / "plain", "mcap", rows_with_images("mcap", encoding))).camera
    np.testing.assert_array_equal(camera.read_disparity(7), plain.read_disparity(7))


# ---- bags that are none ------------------------------------------------------------------------


def test_without_the_library_the_extra_is_named(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "drive", "ros1", rows_of(BOX, True))
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(
        DataError, match=r"package: found no rosbags, expected the extra: pip install pfslam\[ros\]"
    ):
        pfslam.load(path)


def test_importing_the_package_does_not_import_the_library():
    code = "import sys, pfslam.io.datasets, pfslam.cli.commands; print('rosbags' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]


def test_a_bag_without_messages(tmp_path):
    for form in ("ros1", "sqlite3", "mcap"):
        with pytest.raises(DataError, match="odometry: found none, expected nav_msgs/Odometry"):
            pfslam.load(write_bag(tmp_path / form, form, []))


@pytest.mark.parametrize("form", FORMATS)
def test_a_bag_that_was_cut_off(tmp_path, form, capsys):
    """The battery died while it was written: one line, for each command."""
    path = write_bag(tmp_path / "drive", form, rows_of(BOX, form == "ros1"))
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))
    whole = file.read_bytes()
    for share in (0.3, 0.9):
        file.write_bytes(whole[: int(share * len(whole))])
        for command in ("info", "check", "run"):
            assert main([command, str(path)]) == 2
            said = capsys.readouterr().err
            assert said.count("\n") == 1
            assert "expected a whole ROS bag, closed by its recorder" in said


def test_a_folder_without_metadata_and_files_that_are_no_bags(tmp_path):
    path = write_bag(tmp_path / "drive", "sqlite3", rows_of(BOX))
    (path / "metadata.yaml").unlink()
    with pytest.raises(
        DataError, match=r"drive: bag: .* expected a whole ROS bag, .* with its metadata.yaml"
    ):
        pfslam.load(path)
    (tmp_path / "metadata.yaml").write_text("anything")
    with pytest.raises(DataError, match=r"metadata.yaml: bag: .* expected a whole ROS bag"):
        pfslam.load(tmp_path / "metadata.yaml")
    for name in ("a.bag", "a.mcap", "a.db3"):
        (tmp_path / name).write_bytes(b"not a bag")
        with pytest.raises(DataError, match=rf"{name}: bag: .* expected a whole ROS bag"):
            pfslam.load(tmp_path / name)


def test_a_name_in_capitals_as_a_memory_stick_gives_it(tmp_path):
    path = write_bag(tmp_path / "drive", "ros1", rows_of(BOX, True)).rename(tmp_path / "DRIVE.BAG")
    assert len(pfslam.load(path).lidar.t) == 55


@pytest.mark.parametrize("name", ["drive.bag.active", "drive.mcap.zstd"])
def test_bags_that_are_not_closed_or_packed(tmp_path, name):
    (tmp_path / name).write_bytes(b"anything")
    with pytest.raises(DataError, match=rf"{name}: bag: .* expected a whole ROS bag, closed by its recorder"):
        pfslam.load(tmp_path / name)


# ---- the commands ------------------------------------------------------------------------------


def test_two_commands_from_a_bag_to_a_map(tmp_path, capsys):
    path = str(write_bag(tmp_path / "drive", "sqlite3", rows_of(BOX)))
    assert main(["info", path]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].split() == [
        "topic",
        "type",
        "messages",
        "seconds",
        "per",
        "second",
        "longest",
        "gap",
        "used",
    ]
    assert said[2].split() == ["/scan", "sensor_msgs/LaserScan", "55", "5.4", "10.0", "0.10", "s", "yes"]
    assert main(["run", path, "--out", str(tmp_path / "out"), "--particles", "9"]) == 0
    assert (tmp_path / "out" / "map.pgm").exists()


def test_a_run_ends_with_what_was_left_out_and_which_checks_failed(tmp_path, capsys):
    """Odometry that leaps by five metres misleads the filter without a word from the scans: the check tells."""
    rows = rows_of(BOX)
    for topic, at, message in rows:
        if topic == "/odom" and at > nanoseconds(START + 3.0):
            message.pose.pose.position.x += 5.0
    of(rows)[4].ranges[:2] = np.nan
    path = write_bag(tmp_path / "drive", "mcap", rows)
    out = tmp_path / "out"
    assert main(["run", str(path), "--out", str(out), "--particles", "9"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "left out: 2 ranges on /scan that are not a number"
    assert said[1].startswith("check failed: How fast was a wheel at most? ")
    assert said[1].endswith(" m/s, expected below 10 m/s")
    (failed,) = json.loads((out / "summary.json").read_text())["checks_failed"]
    assert failed["question"] == "How fast was a wheel at most?"
    assert main(["check", str(path)]) == 1


def test_a_converted_bag_loads_without_ros(tmp_path, monkeypatch, capsys):
    path = write_bag(tmp_path / "drive", "mcap", without(rows_of(BOX), "/tf_static"))
    line = ["convert", str(path), str(tmp_path / "drive.npz")]
    assert main(line) == 2
    assert "--lidar-at X Y YAW" in capsys.readouterr().err
    assert main([*line, "--lidar-at", "-0.1", "0", "3.1"]) == 0
    assert "note: the LiDAR is taken to be at x -0.1 m" in capsys.readouterr().out
    direct = pfslam.load(path, bag=BagOptions(lidar_at=(-0.1, 0.0, 3.1)))
    monkeypatch.setitem(sys.modules, "rosbags", None)
    found = pfslam.load(tmp_path / "drive.npz")
    assert_equal_to_what_messages_carry(found, direct)
    assert found.notes == direct.notes
