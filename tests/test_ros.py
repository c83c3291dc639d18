"""The package for ROS 2: its logic on the messages of bags, and its node on a stand-in for rclpy."""

import copy
import importlib
import inspect
import re
import shutil
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import cache, partial
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np
import pytest
import ros_stand_in
import yaml
from bag_files import LEVEL, UPSIDE_DOWN, Messages, rows_of, write_bag
from pfslam_ros.core import Core, Parameters, findings
from rooms import SQUARE, drive
from ros_stand_in import INTERFACE, installed
from rosbags import rosbag2

import pfslam
from pfslam.errors import DataError
from pfslam.io.selection import select
from pfslam.io.topics import stamp_of
from pfslam.motion import dead_reckoning
from pfslam.poses import between, compose
from pfslam.recording import LidarScans
from pfslam.sensors import nearest_ranges
from pfslam.study.disturbances import first_seconds
from pfslam_ros import core as ros_core
from pfslam_ros import messages

RECORDING = drive(SQUARE, epoch=1000.0)
LIDAR = RECORDING.robot.lidar
PLACE = LIDAR.position_b
WHEELS = dead_reckoning(RECORDING)
NEW = Messages()


def quaternion(yaw):
    return (0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw))


def scans_of(rows):
    return [message for topic, _, message in rows if topic == "/scan"]


def mounted(turn, sweep=0.0):
    """The drive's messages with the LiDAR at its place, turned by a quaternion; ranges are left as they are."""
    half = 0.5 * PLACE[2]
    chain = [("base_link", "mast", (0.0, 0.0, half), LEVEL), ("mast", "laser", (*PLACE[:2], half), turn)]
    return rows_of(RECORDING, sweep=sweep, mount=chain)


def turned(yaw, sweep=0.0):
    """A LiDAR that looks ``yaw`` to the left: its beams are the same, and so their angles are less."""
    rows = mounted(quaternion(yaw), sweep)
    for message in scans_of(rows):
        message.angle_min, message.angle_max = message.angle_min - yaw, message.angle_max - yaw
    return rows


def upside_down():
    """A LiDAR that hangs: what it takes for its left is the robot's right."""
    rows = mounted(UPSIDE_DOWN, sweep=0.05)
    for message in scans_of(rows):
        message.angle_min, message.angle_max = -message.angle_max, -message.angle_min
        message.ranges = message.ranges[::-1].copy()
    return rows


def clockwise():
    rows = mounted(LEVEL, sweep=0.05)
    for message in scans_of(rows):
        message.angle_min, message.angle_max = message.angle_max, message.angle_min
        message.angle_increment *= -1
        message.ranges = message.ranges[::-1].copy()
    return rows


def varying():
    """A scanner that spins freely: every third scan has one to four beams less, over the same angles."""
    rows, rng = mounted(LEVEL), np.random.default_rng(5)
    for message in scans_of(rows)[::3]:
        fewer = replace(LIDAR, beams=LIDAR.beams - int(rng.integers(1, 5)))
        message.ranges = nearest_ranges(fewer.angles, LIDAR.angle_min, LIDAR.increment, message.ranges)
        message.ranges = message.ranges.astype(np.float32)
        message.angle_increment = fewer.increment
    return rows


ROBOTS = {
    "plain": lambda: rows_of(RECORDING),
    "with a sweep": lambda: rows_of(RECORDING, sweep=0.05),
    "yaw 60": lambda: turned(np.radians(60.0)),
    "yaw 180": lambda: turned(np.pi, sweep=0.05),
    "upside down": upside_down,
    "clockwise": clockwise,
    "varying": varying,
}


@cache
def bag_of(name):
    """The bag of a robot, and its messages as they arrived: written and read, as single precision leaves them."""
    folder = Path(mkdtemp())
    bag = write_bag(folder / "drive", "mcap", ROBOTS[name]())
    recording, rows = pfslam.load(bag), messages_through(bag)
    shutil.rmtree(folder)
    return recording, rows


def messages_through(bag):
    """The messages of a bag as they arrived, each with its topic."""
    with rosbag2.Reader(bag) as reader:
        return [(c.topic, NEW.store.deserialize_cdr(data, c.msgtype)) for c, _, data in reader.messages()]


def played(core, rows):
    """Give the messages to the core as they arrived, and return the steps."""
    take = {"/scan": core.on_scan, "/odom": core.on_odometry, "/tf": core.on_tf, "/tf_static": core.on_tf}
    steps = []
    for topic, message in rows:
        take[topic](message)
        steps += core.due()
    return steps


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_the_core_on_the_messages_of_a_bag_is_the_run_over_the_bag(name):
    """Headings come by another formula, so the last bits differ. The last scan would wait for more odometry."""
    recording, rows = bag_of(name)
    last = max(k for k, (topic, _) in enumerate(rows) if topic == "/scan")
    scans = LidarScans(recording.lidar.t[:-1], recording.lidar.ranges[:-1])
    whole = pfslam.run_slam(replace(recording, lidar=scans), second_look=False)
    core = Core(Parameters(odom_topic="odom"))
    steps = played(core, rows[:last] + rows[last + 1 :])
    assert core.left_out == {}
    found = np.array([step.estimate for step in steps])
    np.testing.assert_array_equal([step.t for step in steps], whole.trajectory.t)
    np.testing.assert_allclose(between(found, whole.trajectory.poses), 0.0, atol=1e-9)
    np.testing.assert_allclose(between(found[-1], RECORDING.truth.at(steps[-1].t)), 0.0, atol=0.02)
    assert core.filter.grid.spec == whole.grid.spec
    np.testing.assert_allclose(core.filter.grid.log_odds, whole.grid.log_odds, atol=1e-6)


def from_tf(rows):
    """The same drive with its odometry on /tf: odom moves base_footprint, which carries the LiDAR and base_link."""
    up = ("base_footprint", "base_link", (0.2, 0.1, 0.1), quaternion(0.5))
    found = [("/tf_static", NEW.transforms(0.0, ("base_footprint", "laser", PLACE, LEVEL), up))]
    for topic, message in rows:
        if topic == "/odom":
            t, pose = stamp_of(message), message.pose.pose
            p, q = pose.position, pose.orientation
            edge = ("odom", "base_footprint", (p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
            wheel = ("base_link", "wheel", (0.0, 0.2, 0.0), quaternion(t))
            found.append(("/tf", NEW.transforms(t, edge, wheel)))
        elif topic == "/scan":
            found.append((topic, message))
    return found


def test_with_tf_alone_the_frames_fit_together_at_each_scan():
    """map -> odom, odom -> base_footprint and what is fixed above it give the estimate, which is that of base_link."""
    core, place = Core(Parameters()), np.array([0.2, 0.1, 0.5])
    steps = []
    for row in from_tf(bag_of("plain")[1]):
        for step in played(core, [row]):
            steps.append(step)
            odom = core.map_to_odom(step)
            base = compose(compose(odom, WHEELS.at(step.t)), place)
            np.testing.assert_allclose(between(step.estimate, base), 0.0, atol=1e-9)
    assert len(steps) > 50
    assert core.left_out == {}
    truth = [between(compose(WHEELS.at(steps[0].t), place), compose(WHEELS.at(s.t), place)) for s in steps]
    np.testing.assert_allclose(between(np.array(truth), [s.estimate for s in steps]), 0.0, atol=0.02)


def test_without_a_chain_of_frames_nothing_begins_and_the_reason_is_told_once():
    rows = [row for row in bag_of("plain")[1] if row[0] != "/tf_static"]
    core = Core(Parameters(odom_topic="odom"))
    assert played(core, rows[:200]) == []
    (line,) = core.news()
    assert "laser in base_link: expected a fixed chain of frames" in line
    assert line.endswith("found no frames at all")
    assert core.news() == []
    assert core.doubt() == "not begun: tf does not tell where the LiDAR is"
    assert not core.located
    moving = Core(Parameters(odom_topic="odom"))
    for angle in (0.0, 0.1, 0.2):  # a LiDAR that nods is not mounted
        moving.on_tf(NEW.transforms(0.0, ("base_link", "laser", PLACE, quaternion(angle))))
    assert played(moving, rows[:200]) == []
    assert "base_link -> laser" in moving.news()[0]


def test_what_cannot_be_used_is_counted_and_told_and_spoils_nothing():
    rows = bag_of("plain")[1]
    whole = played(Core(Parameters(odom_topic="odom")), rows[:300])
    core, steps, spoiled = Core(Parameters(odom_topic="odom")), [], []
    for k, (topic, message) in enumerate(rows[:300]):
        spoiled.append((topic, message))
        if k > 100 and k % 20 == 0:
            bad = copy.deepcopy(message)
            if topic == "/odom":
                bad.pose.pose.orientation.w += 9.0
                spoiled += [(topic, message), (topic, bad)]
            elif topic == "/scan":
                spoiled += [(topic, message)]
        if topic == "/scan" and k % 7 == 0:
            for name, value in (("angle_increment", np.nan), ("ranges", np.zeros(0, np.float32))):
                spoiled.append((topic, copy.copy(message)))
                setattr(spoiled[-1][1], name, value)
            spoiled.append((topic, NEW.scan(0.0, message.ranges, LIDAR)))
            other = NEW.scan(stamp_of(message) + 1e-3, message.ranges, LIDAR)
            other.header.frame_id = "camera"
            spoiled.append((topic, other))
    steps = played(core, spoiled)
    np.testing.assert_array_equal([s.estimate for s in steps], [s.estimate for s in whole])
    told = "\n".join(core.news())
    for words in (
        "quaternion of length 1",
        "increasing times",
        "at most one turn",
        "a later one",
        "the first beam",
    ):
        assert words in told


def test_a_clock_that_is_set_back_is_gone_on_from():
    """Half of the drive comes an hour too early: the estimates are the same, but for the scans around the change."""
    rows, back = bag_of("plain")[1], 3600
    early = copy.deepcopy(rows)
    change = 250
    for _, message in early[change:]:
        message.header.stamp.sec += 7200 - back
    for _, message in early[1:change]:
        message.header.stamp.sec += 7200
    whole = played(Core(Parameters(odom_topic="odom")), rows)
    core = Core(Parameters(odom_topic="odom"))
    steps = played(core, early)
    assert len(whole) - 12 <= len(steps) <= len(whole)
    assert any("the clock was set back" in line for line in core.decided())
    np.testing.assert_allclose(between(steps[-1].estimate, whole[-1].estimate), 0.0, atol=0.01)
    assert core.stamp(steps[-1].t) == pytest.approx(whole[-1].t + 7200 - back, abs=1e-3)


@pytest.mark.parametrize("mask", [(), (80.0, 100.0)], ids=["all beams", "some masked"])
def test_a_node_that_is_stopped_goes_on_from_its_file(tmp_path, mask):
    """Ten scans are waited for again, and then they are taken."""
    rows, file = bag_of("with a sweep")[1], tmp_path / "map.npz"
    one = Core(Parameters(odom_topic="odom", mask=mask))
    whole = played(one, rows)
    settings = Parameters(odom_topic="odom", mask=mask, map_file_name=str(file))
    half = Core(settings)
    assert half.save() is None
    before, rest = played(half, rows[:300]), [*half.waiting]
    assert half.save() == f"{len(before)} scans are saved in {file}"
    again = Core(settings)
    assert len(again.path) == again.steps == len(before)
    after = played(again, [rows[0], *(("/scan", message) for message in rest), *rows[300:]])
    np.testing.assert_array_equal([s.estimate for s in before + after], [s.estimate for s in whole])
    np.testing.assert_array_equal(again.filter.grid.log_odds, one.filter.grid.log_odds)
    assert again.scanner.masked.any() == bool(mask)


def test_a_saved_map_of_another_lidar_is_refused_and_left_alone(tmp_path):
    file = tmp_path / "map.npz"
    lidar = replace(LIDAR, beams=300)
    mapper = pfslam.Mapper(lidar)
    mapper.add(1.0, np.full(300, 2.0), (0.0, 0.0, 0.0))
    mapper.save(file)
    before, core = file.read_bytes(), Core(Parameters(odom_topic="odom", map_file_name=str(file)))
    assert played(core, bag_of("plain")[1][:200]) == []
    assert "that of the saved map" in core.news()[0]
    assert core.save() is None
    assert file.read_bytes() == before
    file.write_bytes(b"no map at all")
    with pytest.raises(DataError):
        Core(Parameters(map_file_name=str(file)))


@pytest.mark.slow
def test_localization_is_locate_in_the_same_map(tmp_path):
    recording, rows = bag_of("with a sweep")
    grid = pfslam.run_slam(recording, second_look=False).grid
    pfslam.write_map(tmp_path / "map.yaml", grid)
    core = Core(Parameters(mode="localization", odom_topic="odom", map_file_name=str(tmp_path / "map.yaml")))
    steps = played(core, rows)
    whole = pfslam.locate(pfslam.read_known_map(tmp_path / "map.yaml"), recording)
    found = np.array([step.estimate for step in steps])
    np.testing.assert_allclose(between(found, whole.trajectory.poses[: len(found)]), 0.0, atol=1e-6)
    assert (core.located, core.save()) == (bool(whole.located[-1]), None)
    assert (core.doubt() is None) == whole.found
    assert core.filter.covariance.shape == (3, 3)
    assert np.sqrt(core.filter.covariance[0, 0]) < 0.5


def test_localization_begins_where_it_is_told(tmp_path):
    rows, file = bag_of("plain")[1], tmp_path / "map.npz"
    made = Core(Parameters(odom_topic="odom", map_file_name=str(file)))
    played(made, rows[:400])
    made.save()
    core = Core(Parameters(mode="localization", odom_topic="odom", map_file_name=str(file)))
    message = NEW.make("geometry_msgs/msg/PoseWithCovarianceStamped")
    message.pose.pose.orientation.w = 1.0
    message.pose.covariance[[0, 7, 35]] = 0.01, 0.01, 0.001
    core.on_initial_pose(message)
    assert "after the first scans" in core.news()[0]  # nothing to tell it to
    steps = played(core, rows[:200])
    core.on_initial_pose(message)
    assert core.doubt() == "the robot is not found yet: 0 % of the particles agree on a place"
    truth = WHEELS.at(steps[-1].t)
    message.pose.pose.position.x, message.pose.pose.position.y = truth[:2]
    core.on_initial_pose(message)
    steps = played(core, rows[200:350])
    assert core.located
    assert core.doubt() is None
    np.testing.assert_allclose(between(WHEELS.at(steps[-1].t), steps[-1].estimate), 0.0, atol=0.1)


# ---- the node ----------------------------------------------------------------------------------

PACKAGE = Path(ros_core.__file__).parents[1]


@contextmanager
def node_of(**parameters):
    """The node on the stand-in, with these parameters."""
    with installed(odom_topic="odom", **parameters):
        yield importlib.import_module("pfslam_ros.node").SlamNode()


def spun(node, rows):
    """Deliver messages to whom they concern, at the time of their stamps."""
    names = {"/scan": "scan", "/odom": "odom"}
    for topic, message in rows:
        if topic != "/tf_static":
            node.until(stamp_of(message))
        node.subscribed[names.get(topic, topic)](message)


def stored(message):
    """The message as bytes, which fields of another type have none of."""
    for name in ("data", "covariance"):
        if hasattr(message, name):
            setattr(message, name, np.array(getattr(message, name)))
    return NEW.store.serialize_cdr(message, message.__msgtype__)


def test_the_node_publishes_what_the_core_finds(tmp_path):
    rows = bag_of("plain")[1]
    core = Core(Parameters(odom_topic="odom"))
    steps = played(core, rows)
    with node_of(map_file_name=str(tmp_path / "map.npz")) as node:
        spun(node, rows)
        answer = node.services["~/save"](None, SimpleNamespace())
        node.until(node.now + 20.0)
    poses, sent, maps, paths, told = (
        node.published[name] for name in ("pose", "/tf", "map", "path", "/diagnostics")
    )
    assert [stamp_of(message) for message in poses] == pytest.approx([step.t for step in steps], abs=1e-6)
    where = poses[-1].pose.pose
    assert (where.position.x, where.position.y) == tuple(steps[-1].estimate[:2])
    assert np.reshape(poses[-1].pose.covariance, (6, 6))[5, 5] == steps[-1].covariance[2, 2]
    (transform,) = sent[-1].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "odom")
    assert stamp_of(transform) == pytest.approx(steps[-1].t + 0.5)
    x, y, _ = core.map_to_odom(steps[-1])
    assert (transform.transform.translation.x, transform.transform.translation.y) == pytest.approx((x, y))
    assert len(maps) == len(paths) == 2  # after five seconds, and after ten; no more while nothing is new
    assert len(paths[-1].poses) == len(steps)
    assert [told[k].status[0].level for k in (0, 5, -1)] == [1, 0, 1]  # not begun, on its way, without scans
    assert (answer.success, answer.message) == (True, f"{len(steps)} scans are saved in {tmp_path}/map.npz")
    assert pfslam.Mapper.load(tmp_path / "map.npz").steps[-1].t == steps[-1].t
    for message in (poses[-1], sent[-1], maps[-1], paths[-1], told[-1]):
        stored(message)


def test_a_cell_of_the_map_says_what_was_seen_there():
    mapper = pfslam.Mapper(LIDAR)
    mapper.add(7.25, np.full(LIDAR.beams, 2.0), (0.0, 0.0, 0.0))
    grid = messages.map_of(partial(NEW.make, "nav_msgs/msg/OccupancyGrid"), 7.25, "map", mapper.grid)
    info, cells = grid.info, np.array(grid.data).reshape(grid.info.height, grid.info.width)
    column, row = (
        int((at - origin) / info.resolution)
        for at, origin in ((2.1, info.origin.position.x), (0.0, info.origin.position.y))
    )
    assert cells[row, column] > 60  # 2 m ahead of the LiDAR, which sits 0.1 m ahead of the robot
    assert 0 <= cells[row, column - 20] < 50
    assert cells[0, 0] == -1
    assert (stamp_of(grid), grid.header.frame_id) == (7.25, "map")


def test_the_node_says_each_doubt_once_and_goes_on():
    rows = bag_of("plain")[1]
    with node_of() as node:
        spun(node, rows[1:100])  # no mounting yet
        node.until(node.now + 30.0)
        lines = [line for line in node.said if "left out" in line]
        assert len(lines) == 1
        assert node.published["pose"] == []
        answer = node.services["~/save"](None, SimpleNamespace())
        assert not answer.success
        spun(node, [rows[0], *rows[100:]])
        node.until(node.now + 5.0)
    assert len(node.published["pose"]) > 50
    doubts = ["not begun: no scans come", "not begun: tf does not tell where the LiDAR is"]
    doubts += ["the pose is not in doubt any more", "no scan was used for more than 2 s: no scans come"]
    assert [line for line in node.said if line in doubts] == doubts


def test_the_node_localizes_and_sends_no_transform_before_it_has_found_the_robot(tmp_path):
    rows, file = bag_of("plain")[1], tmp_path / "map.npz"
    made = Core(Parameters(odom_topic="odom", map_file_name=str(file)))
    played(made, rows)
    made.save()
    with node_of(mode="localization", map_file_name=str(file)) as node:
        spun(node, rows)
    assert 0 < len(node.published["/tf"]) < len(node.published["pose"])
    assert len(node.published["map"]) == 1
    assert not node.services["~/save"](None, SimpleNamespace()).success


def test_the_node_ends_with_a_save(tmp_path, monkeypatch):
    with installed(map_file_name=str(tmp_path / "map.npz"), odom_topic="odom"):
        module, made = importlib.import_module("pfslam_ros.node"), []
        monkeypatch.setattr(module.SlamNode, "__init__", _noting(module.SlamNode.__init__, made))
        monkeypatch.setattr(module.rclpy, "spin", lambda node: _spin(node, bag_of("plain")[1]))
        module.main([])
    assert made[0].destroyed
    assert len(pfslam.Mapper.load(tmp_path / "map.npz").steps) > 80


def test_parameters_that_cannot_be_end_the_node_in_one_line():
    for mode, words in (("lifelong", "expected mapping or localization"), ("localization", "the map to")):
        with installed(mode=mode):
            with pytest.raises(SystemExit) as ended:
                importlib.import_module("pfslam_ros.node").main([])
            assert words in str(ended.value)
            assert "\n" not in str(ended.value)


def _noting(init, made):
    def noted(self):
        init(self)
        made.append(self)

    return noted


def _spin(node, rows):
    spun(node, rows)
    raise KeyboardInterrupt


@pytest.mark.slow
def test_the_check_up_names_the_parameters_that_put_a_robot_right(tmp_path):
    """The hall's robot, whose scans are 150 ms late, and whose LiDAR looks 20 degrees to the left of what tf says."""
    hall = pfslam.load("hall")
    odometry = pfslam.dead_reckoning(hall)
    wrong = select(
        replace(hall, encoders=None, imu=None, odometry=odometry, truth=None), delay=-0.15, yaw=-20.0
    )
    wrong = replace(wrong, lidar=LidarScans(wrong.lidar.t[::4], wrong.lidar.ranges[::4]))
    rows = messages_through(write_bag(tmp_path / "drive", "mcap", rows_of(first_seconds(wrong, 25.0))))
    core = Core(Parameters(odom_topic="odom"))
    drives = []
    for row in rows:
        played(core, [row])
        drives += [core.first_seconds()]
    (drive,) = [drive for drive in drives if drive is not None]
    assert 20.0 <= drive.lidar.t[-1] - drive.lidar.t[0] < 20.2
    assert "scan_delay to 0.15 and" in findings(drive, core.parameters)[0]
    right = Parameters(odom_topic="odom", scan_delay=0.15, lidar_yaw=20.0)
    core = Core(right)
    steps = played(core, rows)
    assert findings(core.first_seconds(), right) == []
    truth = np.array([hall.truth.at(step.t) for step in steps])
    found = between(between(truth[0], truth), [step.estimate for step in steps])
    assert np.abs(found[:, :2]).max() < 0.1


def test_odometry_from_before_the_lidar_was_switched_on_is_no_fault():
    """A minute of it, and then twenty seconds of scans as well."""
    core = Core(Parameters(odom_topic="odom"))
    played(core, bag_of("plain")[1][:200])
    ranges = core.first.scans[0][1]
    core.first.odometry[:] = [(0.1 * k, np.zeros(3)) for k in range(810)]
    core.first.scans[:] = [(60.0 + 0.1 * k, ranges) for k in range(202)]
    assert not [line for line in findings(core.first_seconds(), core.parameters) if "overlap" in line]


def test_a_robot_that_sees_itself_is_masked_as_its_parameters_say():
    """The beams that are masked read nothing: to the left, between 80 and 100 degrees."""
    core = Core(Parameters(odom_topic="odom", mask=(80.0, 100.0), odometry_scale=1.1))
    played(core, bag_of("plain")[1][:200])
    angles = np.degrees(LIDAR.angles)
    np.testing.assert_array_equal(core.scanner.masked, (angles > 79.99) & (angles < 100.01))
    first = core.first
    np.testing.assert_allclose(first.odometry[-1][1][0], 1.1 * WHEELS.at(first.odometry[-1][0])[0])
    assert np.isnan(first.scans[0][1][core.scanner.masked]).all()


def test_the_path_keeps_its_ends_and_stays_short():
    core = Core(Parameters())
    for k in range(20_001):
        core._keep(float(k), np.array([float(k), 0.0, 0.0]))
    times = [t for t, _ in core.path]
    assert len(times) <= ros_core.MOST_POSES
    assert np.unique(np.diff(times)).tolist() == [16.0]
    assert (times[0], times[-1]) == (0.0, 20_000.0)


# ---- the stand-in is like rclpy, and the package like one of ROS 2 -----------------------------


def parameters_of(function):
    taken = inspect.signature(function).parameters.values()
    return ["*" * (p.kind == p.KEYWORD_ONLY) + p.name for p in taken if p.name != "self"]


NODE = ros_stand_in.Node
CALLED = [ros_stand_in.init, ros_stand_in.spin, ros_stand_in.try_shutdown, ros_stand_in.QoSProfile.__init__]
CALLED += [NODE.__init__, NODE.create_publisher, NODE.create_subscription, NODE.create_service]
CALLED += [NODE.create_timer, NODE.declare_parameter, NODE.get_logger, NODE.get_clock, NODE.destroy_node]


@pytest.mark.parametrize("function", CALLED, ids=lambda f: f.__qualname__)
def test_the_stand_in_takes_no_more_than_rclpy(function):
    """Positional parameters are its first ones, in its order; those that need their name are among all of its."""
    real, ours = INTERFACE[function.__qualname__], parameters_of(function)
    by_place = [name for name in ours if not name.startswith("*")]
    assert by_place == real[: len(by_place)]
    assert {name.lstrip("*") for name in ours} <= {name.lstrip("*") for name in real}


def test_the_description_is_that_of_rclpy_where_it_is_installed():
    rclpy = pytest.importorskip("rclpy", reason="the description was made from rclpy 9.1.2")
    parts = {"Node": "rclpy.node", "QoSProfile": "rclpy.qos"}
    places = {name: getattr(importlib.import_module(module), name) for name, module in parts.items()}
    for name, described in INTERFACE.items():
        if name != "attributes of a Node":
            owner, _, method = name.rpartition(".")
            assert parameters_of(getattr(places.get(owner, rclpy), method)) == described, name


def test_the_node_hides_nothing_of_a_node():
    with node_of() as node:
        own = {*vars(node), *vars(type(node))} - {*vars(ros_stand_in.Node("x"))}
    assert own & {*INTERFACE["attributes of a Node"]} == {"__module__"}


def test_the_package_says_what_it_needs_and_what_its_parameters_are():
    described = ElementTree.parse(PACKAGE / "package.xml")
    assert described.findtext("version") == pfslam.__version__
    needed = {e.text for e in described.iter("exec_depend")}
    sources = [path.read_text() for path in PACKAGE.rglob("*.py") if path.name != "setup.py"]
    used = {
        name for source in sources for name in re.findall(r"^(?:from|import) (\w+)", source, re.MULTILINE)
    }
    assert used - needed <= {*sys.stdlib_module_names, "numpy", "pfslam", "pfslam_ros"}
    assert needed <= used
    stored = yaml.safe_load((PACKAGE / "config" / "params.yaml").read_text())["pfslam"]["ros__parameters"]
    defaults = {field.name: field.default for field in fields(Parameters) if field.name != "mask"}
    assert stored == defaults
    assert {name: type(value) for name, value in stored.items()} == {n: type(v) for n, v in defaults.items()}


@pytest.mark.slow
def test_what_is_installed_lies_where_ros_looks_for_it(tmp_path):
    copy = shutil.copytree(PACKAGE, tmp_path / "pfslam_ros", ignore=shutil.ignore_patterns("__pycache__"))
    command = [sys.executable, "setup.py", "-q", "bdist_wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=copy, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = {name.rpartition(".data/data/")[2] for name in ZipFile(wheel).namelist()}
    share = {
        f"share/pfslam_ros/{name}" for name in ("package.xml", "launch/slam.launch.py", "config/params.yaml")
    }
    assert share | {"share/ament_index/resource_index/packages/pfslam_ros", "pfslam_ros/node.py"} <= names
    (entry,) = (name for name in names if name.endswith("entry_points.txt"))
    assert b"slam = pfslam_ros.node:main" in ZipFile(wheel).read(entry)


@pytest.mark.slow
def test_the_lines_of_python_on_the_page_run_as_they_stand(monkeypatch, tmp_path):
    """Over the hall's first seconds; the result is that of a run over them, but for the lean of the body."""
    page = (PACKAGE.parent / "book" / "own_node.md").read_text(encoding="utf-8")
    hall = first_seconds(pfslam.load("hall"), 8.0)
    monkeypatch.setattr(pfslam, "load", lambda _: hall)
    monkeypatch.chdir(tmp_path)
    (lines,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    node: dict = {}
    exec(lines, node)
    whole = pfslam.run_slam(hall, replace(pfslam.SlamConfig.refined(), tilt=False), second_look=False)
    np.testing.assert_allclose(node["mapper"].pose, whole.trajectory.poses[-1], atol=1e-3)
