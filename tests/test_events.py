"""Scans of a scanner that takes its time: beams measured one after the other, from where the robot was by then."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from rooms import ENCODER_STEP, LIDAR, ROOM, SQUARE, arcs, distance_to_walls, drive, ray_cast, sensor_position

from pfslam import events, motion
from pfslam.config import SlamConfig
from pfslam.events import Drive, deskewed, level_scan
from pfslam.motion import dead_reckoning
from pfslam.poses import between, rotation_matrix, transform_points
from pfslam.recording import LidarScans
from pfslam.refined import tilt
from pfslam.run import run_slam

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
            for event in Drive.of(recording, CONFIG).events()
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
    one_by_one = np.array([event.motion for event in Drive.of(recording, config).events()])
    np.testing.assert_allclose(Drive.of(recording, config).motion, one_by_one, atol=1e-12)


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
    assert calls == Counter(controls=1, dead_reckoning=1, tilt=config.tilt is not None)


def test_a_run_begins_at_its_first_scan_or_for_the_report_at_the_first_stamp_of_the_odometry():
    recording, late = drive(LEGS), drive(LEGS).lidar
    recording = replace(recording, lidar=LidarScans(late.t[10:], late.ranges[10:]))
    first, report = (next(Drive.of(recording, c).events()) for c in (CONFIG, SlamConfig.report()))
    np.testing.assert_array_equal(first.motion, np.zeros(3))
    assert first.controls[2].sum() == 0.0
    odometry = dead_reckoning(recording)
    np.testing.assert_allclose(report.motion, odometry.at(report.t), atol=1e-12)
    assert report.controls[2].sum() == pytest.approx(report.t - odometry.t[0])


def test_before_its_first_and_after_its_last_moment_the_robot_stands():
    """Half of the first scan was measured before the odometry begins, half of the last after it ends."""
    recording, odometry = told(drive(LEGS), SWEEP), dead_reckoning(drive(LEGS))
    used = list(Drive.of(recording, CONFIG).events())
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
