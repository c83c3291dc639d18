"""Scans of a scanner that takes its time: beams measured one after the other, from where the robot was by then."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rooms import ENCODER_STEP, LIDAR, ROOM, SQUARE, arcs, distance_to_walls, drive, ray_cast, sensor_position

from pfslam import events, motion
from pfslam.errors import DataError
from pfslam.events import Drive, Odometer, deskewed, level_scan
from pfslam.io.datasets import load
from pfslam.motion import dead_reckoning
from pfslam.poses import between, rotation_matrix, transform_points
from pfslam.recording import LidarScans
from pfslam.refined import tilt
from pfslam.run import run_slam, used_scans
from pfslam.sensors import RobotModel
from pfslam.slam import SlamConfig
from pfslam.study.disturbances import first_seconds

LEGS = [(1.0, 12, 0.0), (2.0, 0, 1.2), (1.0, 12, 0.0), (2.0, 6, -0.9)]
SWEEP = 0.08
CONFIG = replace(SlamConfig.refined(), particles=1)


def swept(sweep):
    """The drive of LEGS, every beam cast from the exact pose of its own moment; the middle one at the stamp."""
    recording = drive(LEGS)
    pose = arcs([(s, counts * 0.001 / ENCODER_STEP, omega) for s, counts, omega in LEGS])
    delays = sweep * (np.arange(LIDAR.beams) / (LIDAR.beams - 1) - 0.5)
    # The robot stands before its first and after its last moment.
    last = sum(leg[0] for leg in LEGS)
    ranges = [
        [
            ray_cast(ROOM, sensor_position(p), p[2] + np.array([angle]), farthest=60.0)[0]
            for angle, p in zip(LIDAR.angles, (pose(min(max(t + d, 0.0), last)) for d in delays), strict=True)
        ]
        for t in recording.lidar.t[1:-1:6]
    ]
    return replace(recording, lidar=LidarScans(recording.lidar.t[1:-1:6], np.array(ranges)))


def told(recording, sweep):
    robot = recording.robot
    return replace(recording, robot=replace(robot, lidar=replace(robot.lidar, sweep=sweep)))


def off_the_walls(recording):
    """Distances (m) of all end points from the nearest wall, each scan laid at the true pose of its stamp."""
    return np.concatenate(
        [
            distance_to_walls(transform_points(recording.truth.at(event.t), event.points_b))
            for event in used_scans(recording, CONFIG).events()
        ]
    )


def test_a_sweep_that_is_told_is_undone():
    recording = swept(SWEEP)
    smeared, mended = off_the_walls(recording), off_the_walls(told(recording, SWEEP))
    # 1.2 rad/s over 0.04 s either way turns an end point 3 m off by 0.14 m.
    assert smeared.max() > 0.08
    # What is left: a scan across the moment when a leg ends, and chords for arcs.
    assert np.percentile(mended, 95) < 0.002
    assert np.median(mended) < 1e-4
    assert mended.mean() < 0.1 * smeared.mean()


def test_a_scanner_that_says_nothing_is_taken_at_its_word():
    recording = drive(SQUARE)
    assert recording.robot.lidar.sweep == 0.0
    assert off_the_walls(recording).max() < 1e-6


@pytest.mark.parametrize("beam", [0, 180, 360])
def test_first_middle_and_last_beam_by_hand(beam):
    """A quarter turn and one metre ahead during the scan: half of it before the stamp, half after."""
    point = deskewed(np.array([[2.0, 0.0]]), np.array([beam]), LIDAR, np.array([1.0, 0.0, np.pi / 2]))[0]
    share = beam / 360 - 0.5
    turn = share * np.pi / 2
    np.testing.assert_allclose(point, [share + 2 * np.cos(turn), 2 * np.sin(turn)], atol=1e-12)


@pytest.mark.parametrize(
    "config", [CONFIG, replace(CONFIG, every=3), SlamConfig.report()], ids=["all", "third", "report"]
)
def test_motions_asked_for_at_once_are_those_of_the_events(config):
    recording = drive(LEGS)
    one_by_one = np.array([event.motion for event in used_scans(recording, config).events()])
    np.testing.assert_allclose(used_scans(recording, config).motion, one_by_one, atol=1e-12)


@pytest.mark.parametrize("config", [CONFIG, SlamConfig.report()], ids=["refined", "report"])
def test_odometry_controls_and_tilt_are_computed_once_a_run(monkeypatch, config):
    calls = Counter()

    def counted(name, function):
        def call(*args, **kwargs):
            calls[name] += 1
            return function(*args, **kwargs)

        return call

    for module, name in (
        (events, "controls"),
        (motion, "controls"),
        (tilt, "controls"),
        (events, "dead_reckoning"),
    ):
        monkeypatch.setattr(module, name, counted(name, getattr(module, name)))
    monkeypatch.setattr(events, "estimate_tilt", counted("tilt", events.estimate_tilt))
    run_slam(drive(LEGS), replace(config, every=10, particles=2))
    assert calls == Counter(controls=1, dead_reckoning=1, tilt=config.tilt)


def test_a_run_begins_at_its_first_scan_or_for_the_report_at_the_first_stamp_of_the_odometry():
    recording, late = drive(LEGS), drive(LEGS).lidar
    recording = replace(recording, lidar=LidarScans(late.t[10:], late.ranges[10:]))
    first, report = (next(used_scans(recording, c).events()) for c in (CONFIG, SlamConfig.report()))
    np.testing.assert_array_equal(first.motion, np.zeros(3))
    assert first.controls[2].sum() == 0.0
    odometry = dead_reckoning(recording)
    np.testing.assert_allclose(report.motion, odometry.at(report.t), atol=1e-12)
    assert report.controls[2].sum() == pytest.approx(report.t - odometry.t[0])


def test_before_its_first_and_after_its_last_moment_the_robot_stands():
    """Half of the first scan was measured before the odometry begins, half of the last after it ends."""
    recording, odometry = told(drive(LEGS), SWEEP), dead_reckoning(drive(LEGS))
    used = list(used_scans(recording, CONFIG).events())
    t0, t1 = odometry.t[[0, -1]]
    for event, (begin, end) in ((used[0], (t0, t0 + SWEEP / 2)), (used[-1], (t1 - SWEEP / 2, t1))):
        points, beams, _, _ = level_scan(
            recording.lidar.ranges[recording.lidar.t == event.t][0],
            recording.robot.lidar,
            (0.0, 0.0),
            -np.inf,
        )
        motion = between(odometry.at(begin), odometry.at(end))
        np.testing.assert_allclose(event.points_b, deskewed(points, beams, LIDAR, motion), atol=1e-12)


def test_pitch_and_roll_move_the_scanner_each_in_its_own_way():
    pitch, roll = 0.2, -0.1
    _, _, sensor, _ = level_scan(np.full(LIDAR.beams, 2.0), LIDAR, (pitch, roll), -np.inf)
    expected = rotation_matrix(roll, pitch) @ np.array(LIDAR.position_b)
    np.testing.assert_allclose(sensor, expected[:2], atol=1e-12)


@pytest.mark.parametrize("sweep", [0.0, -0.05])
def test_an_odometer_fed_sample_by_sample_makes_the_events_of_the_drive_to_the_last_bit(sweep):
    """Wheel counts and yaw rates come in the order of their stamps; a scan is asked for once both have passed it."""
    hall = load("hall")
    robot = replace(hall.robot, lidar=replace(hall.robot.lidar, sweep=sweep))
    drive = Drive.of(first_seconds(replace(hall, robot=robot), 14.0), tilt=False)
    recording, odometer = drive.recording, Odometer(robot)
    samples = [(t, "counts", c) for t, c in zip(recording.encoders.t, recording.encoders.counts, strict=True)]
    rates = robot.imu.yaw_rate(recording.imu.angular_velocity)
    samples += [(t, "rate", w) for t, w in zip(recording.imu.t, rates, strict=True)]
    waiting, compared = list(drive.events())[:-1], 0
    for t, kind, value in sorted(samples, key=lambda sample: sample[:2]):
        (odometer.add_counts if kind == "counts" else odometer.add_rate)(t, value)
        while waiting and waiting[0].t + 0.1 < t:
            expected = waiting.pop(0)
            same_event(odometer.event(expected.t, recording.lidar.ranges[drive.scans[compared]]), expected)
            compared += 1
    assert compared > 60


def test_an_odometer_fed_with_poses_makes_the_events_of_a_log(real_data):
    log = load(str(real_data / "intel" / "intel.log"))
    odometer, drive, k = Odometer(log.robot), Drive.of(log), 0
    events = iter(drive.events())
    for t, pose in zip(log.odometry.t, log.odometry.poses, strict=True):
        odometer.add_pose(t, pose)
        while k < len(drive) - 1 and t > log.odometry.t[0] and drive.t[k] <= t:
            same_event(odometer.event(drive.t[k], log.lidar.ranges[drive.scans[k]]), next(events))
            k += 1
    assert k == len(drive) - 1  # the last stamp of a log has nothing after it


def same_event(found, expected):
    for name, value in vars(expected).items():
        for a, b in zip(np.atleast_1d(getattr(found, name)), np.atleast_1d(value), strict=True):
            np.testing.assert_array_equal(a, b, err_msg=name)


def test_an_odometer_refuses_what_it_cannot_use():
    odometer = Odometer(RobotModel())
    with pytest.raises(DataError, match="odometry: found no sample"):
        odometer.event(1.0, np.full(1081, 2.0))
    odometer.add_pose(1.0, [0.0, 0.0, 0.0])
    with pytest.raises(DataError, match=r"stamp: found 1.0 after 1.0"):
        odometer.add_pose(1.0, [0.0, 0.0, 0.0])
    with pytest.raises(DataError, match="finite numbers of shape"):
        odometer.add_pose(2.0, [0.0, np.nan, 0.0])
    odometer.add_pose(2.0, [1.0, 0.0, 0.0])
    with pytest.raises(DataError, match=r"samples on both sides of 2.1"):
        odometer.event(2.1, np.full(1081, 2.0))


@pytest.mark.slow
def test_the_node_of_the_reference_is_the_run_to_the_last_bit():
    """The lines that the page prints, run as they stand."""
    page = (Path(__file__).resolve().parents[1] / "book" / "api.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"```python\n(import heapq.*?)```", page, re.DOTALL)
    node: dict = {}
    exec(lines, node)
    whole = run_slam(load("hall"))
    np.testing.assert_array_equal(node["step"].estimate, whole.trajectory.poses[-1])
    np.testing.assert_array_equal(node["belief"].grid.log_odds, whole.grid.log_odds)
