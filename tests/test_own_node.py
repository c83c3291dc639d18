"""The page *In your own node*: its loop on the messages of a bag, what it fills in, and its lines of Python."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import own_node
import pytest
from bag_files import Messages, rows_of, write_bag
from rooms import SQUARE, drive
from rosbags import rosbag2

import pfslam
from pfslam.io.datasets import load
from pfslam.refined.health import Steps
from pfslam.study.disturbances import first_seconds

PAGE = Path(own_node.__file__).with_suffix(".md").read_text(encoding="utf-8")
RECORDING = drive(SQUARE)
NEW = Messages()


@pytest.fixture(scope="module", params=[0.0, 0.05], ids=["at once", "with a sweep"])
def bag(request, tmp_path_factory):
    rows = rows_of(RECORDING, sweep=request.param)
    return write_bag(tmp_path_factory.mktemp("node") / "drive", "mcap", rows)


def messages_of(bag):
    """The messages of a bag as they arrived, each with its topic."""
    with rosbag2.Reader(bag) as reader:
        rows = [(c.topic, NEW.store.deserialize_cdr(data, c.msgtype)) for c, _, data in reader.messages()]
    # The drive begins at 0 s, which a bag takes for no stamp at all.
    return [(name, message) for name, message in rows if name != "/tf_static" and own_node.stamp(message) > 0]


def driven(loop, messages):
    for name, message in messages:
        if name == "/odom":
            loop.on_odometry(message)
        elif name == "/scan":
            yield from loop.on_scan(message)


@pytest.mark.slow
def test_the_loop_on_the_messages_of_a_bag_is_the_run_over_the_bag(bag, tmp_path):
    """The loop reads yaw off a quaternion by a formula of its own, so the last bits may differ.

    At the end it waits for odometry up to the last beam of a scan.
    """
    whole = pfslam.run_slam(pfslam.load(bag), second_look=False)
    loop = own_node.Loop(tmp_path / "belief.npz", RECORDING.robot.lidar.position_b)
    steps = [*driven(loop, messages_of(bag))]
    assert 0 <= len(whole.trajectory) - len(steps) <= 1
    np.testing.assert_array_equal([step.t for step in steps], whole.trajectory.t[: len(steps)])
    found = np.array([step.estimate for step in steps])
    np.testing.assert_allclose(found, whole.trajectory.poses[: len(steps)], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_loop_that_is_stopped_in_mid_drive_goes_on_from_its_file(bag, tmp_path):
    messages, file = messages_of(bag), tmp_path / "belief.npz"
    one = own_node.Loop(file, RECORDING.robot.lidar.position_b)
    whole = [*driven(one, messages)]
    half = own_node.Loop(file, RECORDING.robot.lidar.position_b)
    cut = next(k for k, (name, _) in enumerate(messages) if name == "/scan" and k > len(messages) // 2)
    before = [*driven(half, messages[:cut])]
    half.mapper.save(file)
    again = own_node.Loop(file)
    again.scans = half.scans  # nothing that was on its way is lost
    after = [*driven(again, messages[cut:])]
    np.testing.assert_array_equal(
        [step.estimate for step in before + after], [step.estimate for step in whole]
    )
    np.testing.assert_array_equal(again.mapper.grid.log_odds, one.mapper.grid.log_odds)


def test_what_is_published_says_where_and_how_sure():
    """By hand: a wall ahead of a robot that was put at (1, 2), looking left."""
    mapper = pfslam.Mapper(RECORDING.robot.lidar)
    mapper.add(7.25, np.full(361, 2.0), (0.0, 0.0, 0.0))
    mapper.belief = replace(mapper.belief, estimate=np.array([1.0, 2.0, np.pi / 2]))
    mapper._steps = Steps([replace(mapper.steps[-1], covariance=np.arange(9.0).reshape(3, 3))])
    pose = NEW.make("geometry_msgs/msg/PoseWithCovarianceStamped")
    own_node.fill_pose(pose, mapper)
    assert (pose.header.frame_id, pose.pose.pose.position.x, pose.pose.pose.position.y) == ("map", 1.0, 2.0)
    assert own_node.stamp(pose) == 7.25
    assert pose.pose.pose.orientation.z == pytest.approx(np.sqrt(0.5))
    assert pose.pose.covariance.reshape(6, 6)[5, [0, 1, 5]].tolist() == [6.0, 7.0, 8.0]
    assert np.count_nonzero(pose.pose.covariance) == 8
    grid = NEW.make("nav_msgs/msg/OccupancyGrid")
    own_node.fill_map(grid, mapper)
    info, cells = grid.info, np.array(grid.data).reshape(grid.info.height, grid.info.width)
    column = int((2.1 - info.origin.position.x) / info.resolution)
    row = int((0.0 - info.origin.position.y) / info.resolution)
    assert cells[row, column] > 60  # 2 m ahead of the LiDAR, which sits 0.1 m ahead of the robot
    assert 0 <= cells[row, column - 20] < 50
    assert cells[0, 0] == -1
    grid.data = np.array(grid.data)
    for message in (pose, grid):
        NEW.store.serialize_cdr(message, message.__msgtype__)  # refuses fields of another type


@pytest.mark.slow
def test_the_lines_of_python_run_as_they_stand(monkeypatch, tmp_path):
    """Over the hall's first seconds; the result is that of a run over them, but for the lean of the body."""
    hall = first_seconds(load("hall"), 8.0)
    monkeypatch.setattr(pfslam, "load", lambda _: hall)
    monkeypatch.chdir(tmp_path)
    (lines,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    node: dict = {}
    exec(lines, node)
    whole = pfslam.run_slam(hall, replace(pfslam.SlamConfig.refined(), tilt=False), second_look=False)
    np.testing.assert_allclose(node["mapper"].pose, whole.trajectory.poses[-1], atol=1e-3)
