"""Scans of a scanner that takes its time: beams measured one after the other, from where the robot was by then."""

from dataclasses import replace

import numpy as np
import pytest
from rooms import ENCODER_STEP, LIDAR, ROOM, SQUARE, arcs, distance_to_walls, drive, ray_cast, sensor_position

from pfslam.errors import DataError
from pfslam.motion import dead_reckoning
from pfslam.poses import between, compose, rotation_matrix, transform_points
from pfslam.recording import LidarScans
from pfslam.refined.events import deskewed, level_scan
from pfslam.refined.odometer import Odometer
from pfslam.run import run_slam
from pfslam.sensors import RobotModel
from pfslam.slam import SlamConfig

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
            for event in CONFIG.used_scans(recording).events()
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


def test_a_run_takes_account_of_a_sweep_that_is_told():
    """A scan takes a tenth of a second, and the robot turns by seven degrees meanwhile."""
    recording, config = swept(0.1), replace(CONFIG, particles=20, every=1)
    worst = {}
    for sweep in (0.0, 0.1):
        path = run_slam(told(recording, sweep), config, second_look=False).trajectory
        truth = recording.truth.at(path.t)
        off = between(between(truth[0], truth), between(path.poses[0], path.poses))
        worst[sweep] = np.abs(off[:, :2]).max()
    assert worst[0.1] < 0.002
    assert worst[0.0] > 0.015


@pytest.mark.parametrize("beam", [0, 180, 360])
def test_first_middle_and_last_beam_by_hand(beam):
    """A quarter turn and one metre ahead during the scan: half of it before the stamp, half after."""
    point = deskewed(np.array([[2.0, 0.0]]), np.array([beam]), LIDAR, np.array([1.0, 0.0, np.pi / 2]))[0]
    share = beam / 360 - 0.5
    turn = share * np.pi / 2
    np.testing.assert_allclose(point, [share + 2 * np.cos(turn), 2 * np.sin(turn)], atol=1e-12)


@pytest.mark.parametrize(
    ("config", "legs"),
    [(replace(CONFIG, every=3), LEGS), (SlamConfig.report(), SQUARE)],
    ids=["third", "report"],
)
def test_the_events_of_a_drive_add_up_to_its_odometry(config, legs):
    recording = drive(legs)
    used, odometry = list(config.used_scans(recording).events()), dead_reckoning(recording)
    pose = np.zeros(3)
    for event in used:
        pose = compose(pose, event.motion)
    np.testing.assert_allclose(pose, odometry.at(used[-1].t), atol=1e-9)
    driven = np.hypot(*np.diff(odometry.poses[odometry.t <= used[-1].t, :2], axis=0).T).sum()
    assert sum(float(v @ dt) for v, _, dt in (e.controls for e in used)) == pytest.approx(driven)
    if type(config) is SlamConfig:
        assert sum(e.controls[2].sum() for e in used) == pytest.approx(used[-1].t - odometry.t[0])


def test_a_run_begins_at_its_first_scan_or_for_the_report_at_the_first_stamp_of_the_odometry():
    recording, late = drive(LEGS), drive(LEGS).lidar
    recording = replace(recording, lidar=LidarScans(late.t[10:], late.ranges[10:]))
    first, report = (next(c.used_scans(recording).events()) for c in (CONFIG, SlamConfig.report()))
    np.testing.assert_array_equal(first.motion, np.zeros(3))
    assert first.controls[2].sum() == 0.0
    odometry = dead_reckoning(recording)
    np.testing.assert_allclose(report.motion, odometry.at(report.t), atol=1e-12)
    assert report.controls[2].sum() == pytest.approx(report.t - odometry.t[0])


def test_pitch_and_roll_move_the_scanner_each_in_its_own_way():
    pitch, roll = 0.2, -0.1
    _, _, sensor, _ = level_scan(np.full(LIDAR.beams, 2.0), LIDAR, (pitch, roll), -np.inf)
    expected = rotation_matrix(roll, pitch) @ np.array(LIDAR.position_b)
    np.testing.assert_allclose(sensor, expected[:2], atol=1e-12)


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.01, 0.0)])
@pytest.mark.parametrize("limit", [5.6, 5.9])  # rounded to single precision one grows, the other shrinks
def test_a_range_at_the_limit_is_one_point_and_one_beam_or_neither(limit, tilt):
    ranges = np.full(LIDAR.beams, 2.0, dtype=np.float32)
    ranges[3] = limit
    points, beams, _, _ = level_scan(ranges, replace(LIDAR, range_max=limit), tilt, -np.inf)
    assert len(points) == len(beams)


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
    odometer.event(1.5, np.full(1081, 2.0))
    for t in (1.5, 1.2):
        with pytest.raises(DataError, match=rf"stamp: found {t} after 1.5, expected increasing times"):
            odometer.event(t, np.full(1081, 2.0))
