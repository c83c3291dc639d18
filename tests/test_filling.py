"""Filling in the wall between the beams of a coarse scanner."""

from dataclasses import replace

import numpy as np
import pytest

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.events import ScanEvent
from pfslam.recording import LidarScans
from pfslam.refined.filling import STEEPEST, filled
from pfslam.run import run_slam
from pfslam.sensors import LidarModel
from pfslam.simulator import HALL, simulate
from pfslam.slam import SlamConfig

SENSOR = np.array([0.2, -0.1])
SPACING = SlamConfig.refined().beam_spacing


def event(angles, ranges, beams=None):
    """A scan of beams at these angles (deg) from a sensor that is not at the robot's centre."""
    angles, ranges = np.radians(angles), np.asarray(ranges, dtype=float)
    points = SENSOR + ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    beams = np.arange(len(ranges)) if beams is None else np.asarray(beams)
    nothing = np.zeros(0)
    return ScanEvent(0.0, points, beams, SENSOR, np.zeros(3), (nothing, nothing, nothing))


def wall(step, distance=3.0, to=70.0):
    """A scan of a straight wall across the way ahead."""
    angles = np.arange(-to, to + step / 2, step)
    return event(angles, distance / np.cos(np.radians(angles)))


@pytest.mark.parametrize("step", [1.5, 2.0, 4.0])
def test_points_on_a_straight_wall_lie_on_it_and_close_enough(step):
    coarse = wall(step)
    dense = filled(coarse, SPACING)
    np.testing.assert_allclose(dense.points_b[:, 0], 3.0 + SENSOR[0])
    seen = np.arctan2(*(dense.points_b - SENSOR).T[::-1])
    # Points at even steps along the wall are not at quite even angles.
    assert 0 < np.diff(seen).min() <= np.diff(seen).max() < 1.2 * SPACING
    at = np.flatnonzero(np.diff(dense.beams, prepend=-1))
    np.testing.assert_array_equal(dense.points_b[at], coarse.points_b)
    np.testing.assert_array_equal(np.unique(dense.beams), coarse.beams)
    assert np.all(np.diff(dense.beams) >= 0)


@pytest.mark.parametrize("step", [0.25, 0.5, 1.0])
def test_a_scanner_that_is_dense_enough_is_left_as_it_is(step):
    dense = wall(step)
    np.testing.assert_array_equal(filled(dense, SPACING).points_b, dense.points_b)
    assert filled(wall(4.0), 0.0).beams.tolist() == wall(4.0).beams.tolist()


def test_nothing_is_put_between_two_walls_nor_where_a_beam_has_no_return():
    near_and_far = event([0.0, 2.0, 4.0, 6.0], [2.0, 2.0, 5.0, 5.0])
    assert filled(near_and_far, SPACING).beams.tolist() == [0, 0, 1, 2, 2, 3]
    steep = np.radians(2.0) * STEEPEST
    assert len(filled(event([0.0, 2.0], [2.0, 2.0 * (1 + 0.9 * steep)]), SPACING).beams) == 3
    assert len(filled(event([0.0, 2.0], [2.0, 2.0 * (1 + 1.1 * steep)]), SPACING).beams) == 2
    missing = event([0.0, 2.0, 6.0, 8.0], [2.0, 2.0, 2.0, 2.0], beams=[0, 1, 3, 4])
    assert filled(missing, SPACING).beams.tolist() == [0, 0, 1, 3, 3, 4]


def test_beams_on_both_sides_of_straight_behind_are_neighbours_by_number_and_by_angle():
    behind = filled(event([178.0, 180.0, -178.0], [2.0, 2.0, 2.0]), SPACING)
    assert behind.beams.tolist() == [0, 0, 1, 1, 2]
    assert filled(event([10.0], [2.0]), SPACING).beams.tolist() == [0]


@pytest.mark.slow
def test_a_scanner_of_two_degrees_does_not_lose_its_heading_at_the_start():
    """Without the points between its beams it loses a degree within the first metre."""
    coarse = LidarModel(-np.pi, np.pi - np.radians(2.0), 180, 0.1, 12.0, (0.13, 0.05, 0.3))
    drive = simulate(replace(HALL, robot=replace(HALL.robot, lidar=coarse)), 3).recording
    scans = drive.scans()
    short = scans.t < scans.t[0] + 20.0
    drive = replace(drive, lidar=LidarScans(scans.t[short], scans.ranges[short]))
    off = {}
    for spacing in (0.0, SPACING):
        result = run_slam(drive, replace(SlamConfig.matching(), beam_spacing=spacing), second_look=False)
        off[spacing] = trajectory_error(result.trajectory, drive.true_path()).heading_rmse_deg
    assert off[SPACING] < 0.3 < off[0.0]
