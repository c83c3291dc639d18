"""Errors by hand, against evo, and the cost of Eq. 2 against its definition."""

from dataclasses import replace

import numpy as np
import pytest
from evo.core import metrics as evo_metrics
from evo.core.trajectory import PoseTrajectory3D
from rooms import LIDAR, ROOM, SQUARE, drive, sensor_position

from pfslam.errors import DataError
from pfslam.evaluation.trajectory import (
    map_agreement,
    predicted_ranges,
    relations_error,
    slam_cost,
    trajectory_error,
)
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, compose

T = np.linspace(10.0, 20.0, 60)


def wandering(seed, scale=1.0):
    rng = np.random.default_rng(seed)
    return Trajectory(
        T, np.cumsum(scale * rng.normal(0, [0.1, 0.1, 0.2], (60, 3)), axis=0) + [3.0, -2.0, 1.0]
    )


TRUTH = wandering(0)
ESTIMATE = Trajectory(T, TRUTH.poses + 0.3 * (wandering(1).poses - wandering(1).poses[0]) + [1.0, 2.0, 0.5])


def evo_trajectory(trajectory):
    half = 0.5 * trajectory.poses[:, 2]
    xyz = np.column_stack([trajectory.poses[:, :2], np.zeros(len(half))])
    return PoseTrajectory3D(
        xyz, np.column_stack([np.cos(half), 0 * half, 0 * half, np.sin(half)]), trajectory.t
    )


def test_trajectory_error_by_hand():
    truth = Trajectory([0.0, 1.0, 2.0], [[0, 0, 0], [1, 0, 3.1], [2, 0, 0]])
    moved = Trajectory(truth.t, compose([5.0, -3.0, 2.0], truth.poses))
    nothing = trajectory_error(moved, truth)
    assert max(nothing.ate_rmse_m, nothing.ate_max_m, nothing.heading_rmse_deg) < 1e-12
    # Aligned: (0, 0), (1, 0), (2, 3), headings 0.1 rad, the short way round, and 6 degrees off.
    poses = [[7, 7, np.pi / 2], [7, 8, np.pi / 2 + 3.2], [4, 9, np.pi / 2 + np.deg2rad(6)]]
    error = trajectory_error(Trajectory(truth.t, poses), truth)
    assert error.ate_rmse_m == pytest.approx(np.sqrt(3))
    assert error.ate_max_m == pytest.approx(3)
    assert error.heading_rmse_deg == pytest.approx(np.sqrt((np.rad2deg(0.1) ** 2 + 36) / 3))
    assert error.poses == 3


def test_only_times_that_the_truth_covers_are_compared():
    truth = Trajectory(T[5:50], TRUTH.poses[5:50])
    inside = Trajectory(T[5:50], ESTIMATE.poses[5:50])
    assert trajectory_error(ESTIMATE, truth) == trajectory_error(inside, truth)
    with pytest.raises(DataError):
        trajectory_error(Trajectory(T + 100.0, ESTIMATE.poses), TRUTH)


def test_absolute_error_agrees_with_evo():
    reference, estimate = evo_trajectory(TRUTH), evo_trajectory(ESTIMATE)
    estimate.align_origin(reference)
    metric = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    metric.process_data((reference, estimate))
    ours = trajectory_error(ESTIMATE, TRUTH)
    assert ours.ate_rmse_m == pytest.approx(metric.get_statistic(evo_metrics.StatisticsType.rmse))
    assert ours.ate_max_m == pytest.approx(metric.get_statistic(evo_metrics.StatisticsType.max))
    metric = evo_metrics.APE(evo_metrics.PoseRelation.rotation_angle_deg)
    metric.process_data((reference, estimate))
    assert ours.heading_rmse_deg == pytest.approx(metric.get_statistic(evo_metrics.StatisticsType.rmse))


def test_relations_error_by_hand():
    # From (1, 0) facing +y to (1, 2) facing -x is two ahead and a quarter turn left.
    estimate = Trajectory([0.0, 1.0], [[1, 0, np.pi / 2], [1, 2, np.pi]])
    metres, radians = relations_error(
        estimate, [0.0, 0.0], [1.0, 1.0], np.array([[2.0, 0, np.pi / 2], [2.3, 0.4, np.pi / 2 - 0.2]])
    )
    np.testing.assert_allclose(metres, [0.0, 0.5], atol=1e-15)
    np.testing.assert_allclose(radians, [0.0, 0.2], atol=1e-15)


def test_map_agreement_by_hand():
    grid = OccupancyGrid(
        GridSpec((0, 0), 1.0, (2, 4)), np.array([[1, 1, -1, -1], [0, 1, -1, -1]], np.float32)
    )
    occupied = np.array([[1, 0, 0, 0], [1, 1, 0, 0]], bool)
    free = np.array([[0, 1, 1, 1], [0, 0, 0, 0]], bool)
    found = map_agreement(grid, occupied, free)  # the last two of the second row are labelled by neither
    assert found.occupied_iou == pytest.approx(2 / 4)
    assert found.free_iou == pytest.approx(2 / 3)
    assert found.known == pytest.approx(5 / 6)
    assert map_agreement(grid, grid.occupied, grid.free).occupied_iou == 1.0
    assert np.isnan(map_agreement(OccupancyGrid.empty(grid.spec), np.zeros((2, 4), bool), free).occupied_iou)
    with pytest.raises(DataError, match="true_free"):
        map_agreement(grid, occupied, free[:1])


def rasterised(walls, resolution=0.05):
    """Every cell that a wall passes through: walls sampled a hundred times a cell."""
    spec = GridSpec.around(walls.reshape(-1, 2), resolution)
    grid = OccupancyGrid.empty(spec)
    for ax, ay, bx, by in walls:
        s = np.linspace(0, 1, int(100 * np.hypot(bx - ax, by - ay) / resolution) + 2)[:, None]
        ix, iy = spec.world_to_cell(np.array([ax, ay]) + s * [bx - ax, by - ay]).T
        grid.log_odds[iy, ix] = 1.0
    return grid


GRID = rasterised(ROOM)


def first_occupied(grid, origin, angle, farthest, step):
    """One beam walked in a loop."""
    r = LIDAR.range_min
    while r < farthest:
        ix, iy = np.floor(
            (origin + r * np.array([np.cos(angle), np.sin(angle)]) - grid.spec.origin) / grid.spec.resolution
        ).astype(int)
        if 0 <= ix < grid.spec.shape[1] and 0 <= iy < grid.spec.shape[0] and grid.log_odds[iy, ix] > 0:
            return r
        r += step
    return farthest


FULL = OccupancyGrid(GRID.spec, np.ones_like(GRID.log_odds))
"""A map whose border is a wall: nothing is met outside it all the same."""


@pytest.mark.parametrize(
    ("grid", "pose"),
    [(GRID, (0.3, 0.2, 0.5)), (GRID, (3.4, 1.9, -3.0)), (GRID, (-9.0, 0.0, 0.1)), (FULL, (9.0, 5.0, -2.0))],
)
def test_predicted_ranges_are_those_of_beams_walked_one_by_one(grid, pose):
    # Off the room too: a beam may enter the grid from outside. Sums of steps differ from products in the last
    # bits.
    found = predicted_ranges(grid, np.array(pose), LIDAR)
    origin = sensor_position(pose)
    expected = [first_occupied(grid, origin, pose[2] + a, LIDAR.range_max, 0.025) for a in LIDAR.angles[::10]]
    agree = np.abs(found[::10] - expected) < 1e-9
    assert agree.sum() >= len(agree) - 1
    np.testing.assert_allclose(found[::10], expected, atol=0.025 + 1e-9)


def test_motion_cost_by_hand():
    # The odometry says: straight on by 0.24 m, twice. The trajectory goes 0.3 m and turns by 0.1, then does
    # as told.
    recording = drive([(1.0, 12, 0.0)])
    t = recording.lidar.t[[0, 5, 10]]
    second = np.array([0.3, 0.0, 0.1])
    bent = Trajectory(t, [[0, 0, 0], second, compose(second, [0.24, 0, 0])])
    cost = slam_cost(bent, GRID, recording)
    assert cost.motion == pytest.approx(0.06**2 + 0.1**2)


def test_cost_of_the_odometrys_own_trajectory_is_all_observation_by_the_beams_that_read_something():
    walls = ROOM[1:]  # the lower wall is missing: beams through it have no reading
    recording, grid = drive(SQUARE, walls), rasterised(walls)
    t = recording.lidar.t[::4]
    own = Trajectory(t, dead_reckoning(recording).at(t))
    assert (np.abs(np.diff(own.poses[:, 2])) > 6).any() or np.abs(own.poses[-1, 2]) > 3.1  # across the seam
    cost = slam_cost(own, grid, recording)
    z, h = recording.lidar.ranges[::4], np.array([predicted_ranges(grid, pose, LIDAR) for pose in own.poses])
    read = z < 30.0
    assert cost.motion == pytest.approx(0.0, abs=1e-18)
    assert cost.observation == pytest.approx(np.sum((z - h)[read] ** 2))
    assert (cost.scans, cost.beams) == (len(t), np.count_nonzero(read))
    assert not read.all()
    turned = Trajectory(t, compose([0.0, 0.0, np.pi / 2 + 0.01], own.poses))
    assert slam_cost(turned, grid, recording).motion == pytest.approx(0.0, abs=1e-18)
    between_scans = Trajectory([0.05, 0.15], np.zeros((2, 3)))
    for cannot, words in (
        (recording, "lidar time_stamps"),
        (replace(recording, lidar=None), "found no scans"),
    ):
        with pytest.raises(DataError, match=words):
            slam_cost(between_scans, grid, cannot)
