"""How good a result is: trajectory error, relations, map agreement, and the cost of Eq. 2."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.errors import DataError
from pfslam.grid import OccupancyGrid
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, between, compose, invert, transform_points, wrap_angle
from pfslam.recording import Recording, nearest_stamp
from pfslam.sensors import LidarModel

SAME_TIME = 1e-3
"""A scan belongs to a pose if their stamps differ by at most this (s); files keep microseconds."""


@dataclass(frozen=True)
class TrajectoryError:
    """Absolute trajectory error: position in metres (root mean square, largest), heading in degrees."""

    ate_rmse_m: float
    ate_max_m: float
    heading_rmse_deg: float
    poses: int


def aligned_at_first(estimate: Trajectory, truth: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Move the estimate as a whole so that its first pose is true; return its poses ``(K, 3)`` and the true ones.

    Only the times that the truth covers are compared. Nothing is fitted: a wrong first heading counts.
    """
    known = truth.covers(estimate.t)
    if not known.any():
        raise DataError("aligned_at_first", "estimate times", "none within the truth's time", "some overlap")
    true_poses, poses = truth.at(estimate.t[known]), estimate.poses[known]
    return compose(compose(true_poses[0], invert(poses[0])), poses), true_poses


def trajectory_error(estimate: Trajectory, truth: Trajectory) -> TrajectoryError:
    """Measure the absolute error of an estimate at its own times, aligned at its first pose, nothing fitted."""
    poses, true_poses = aligned_at_first(estimate, truth)
    distance = np.hypot(*(poses - true_poses)[:, :2].T)
    heading = wrap_angle(poses[:, 2] - true_poses[:, 2])
    degrees = float(np.rad2deg(rms(heading)))
    return TrajectoryError(rms(distance), float(distance.max()), degrees, len(poses))


def rms(values: np.ndarray) -> float:
    """Return the root mean square of ``values``."""
    return float(np.sqrt(np.mean(values**2)))


def relations_error(
    estimate: Trajectory, t1: np.ndarray, t2: np.ndarray, relative: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return errors ``(R,)`` in metres and radians over known poses ``(R, 3)`` at ``t2`` seen from ``t1``."""
    error = between(relative, between(estimate.at(t1), estimate.at(t2)))
    return np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])


@dataclass(frozen=True)
class MapAgreement:
    """Intersection over union of occupied and of free cells (NaN where both sets are empty).

    ``known`` is the share of the cells labelled by the truth on which the map has an opinion.
    """

    occupied_iou: float
    free_iou: float
    known: float


def map_agreement(grid: OccupancyGrid, true_occupied: np.ndarray, true_free: np.ndarray) -> MapAgreement:
    """Compare the map with true masks ``(H, W)`` bool on its own grid; cells in neither mask are left out."""
    for name, mask in (("true_occupied", true_occupied), ("true_free", true_free)):
        if np.shape(mask) != grid.spec.shape:
            raise DataError("map_agreement", name, f"shape {np.shape(mask)}", f"the grid's {grid.spec.shape}")
    labelled = true_occupied | true_free
    occupied, free = grid.occupied & labelled, grid.free & labelled
    return MapAgreement(
        occupied_iou=share_of(occupied & true_occupied, occupied | true_occupied),
        free_iou=share_of(free & true_free, free | true_free),
        known=share_of(occupied | free, labelled),
    )


def share_of(part: np.ndarray, whole: np.ndarray) -> float:
    """Divide the number of cells in one mask by that in another; NaN if the other is empty."""
    return np.count_nonzero(part) / np.count_nonzero(whole) if whole.any() else float("nan")


def predicted_ranges(grid: OccupancyGrid, pose_w: np.ndarray, lidar: LidarModel) -> np.ndarray:
    """Predict the ranges ``(beams,)`` (m) that the LiDAR should read at ``pose_w (3,)``: the h of Eq. 1 and 2.

    Every beam walks from ``range_min`` in steps of half a cell to the first sample in an occupied cell, so a range is
    at most one step too long.
    ``range_max`` where no cell on the way is occupied; outside the grid none is.
    """
    occupied = np.pad(grid.occupied, 1)  # a free rim stands for everything outside
    sensor = transform_points(pose_w, np.array([lidar.position_b[:2]]))[0]
    angles = pose_w[2] + lidar.angles
    direction = np.column_stack([np.cos(angles), np.sin(angles)])
    ranges = np.full(lidar.beams, lidar.range_max)
    walking, at_once = np.arange(lidar.beams), 64
    distance = np.arange(lidar.range_min, lidar.range_max, 0.5 * grid.spec.resolution)
    for some in np.split(distance, range(at_once, len(distance), at_once)):
        cells = grid.spec.world_to_cell(sensor + some[:, None] * direction[walking, None]) + 1
        ix, iy = np.clip(cells, 0, np.array(occupied.shape[::-1]) - 1).transpose(2, 0, 1)
        hit = occupied[iy, ix]
        ends = hit.any(axis=1)
        ranges[walking[ends]] = some[np.argmax(hit[ends], axis=1)]
        walking = walking[~ends]
        if len(walking) == 0:
            break
    return ranges


@dataclass(frozen=True)
class SlamCost:
    """The two sums of Eq. 2: ``observation`` in m^2 and ``motion`` in m^2 + rad^2.

    ``scans`` and ``beams`` count what went into the first sum: compare only costs of the same scans.
    """

    observation: float
    motion: float
    scans: int
    beams: int


def slam_cost(trajectory: Trajectory, grid: OccupancyGrid, recording: Recording) -> SlamCost:
    """Compute the least-squares cost of a trajectory and a map. Implements Eq. 2.

    First sum: measured less predicted ranges, over the valid beams of each scan at one of the poses' times.
    Second sum: each pose less the motion model's prediction from the one before, heading on the circle; the
    odometry's own trajectory costs nothing there. Metres, radians and beams weigh alike, as in the report.
    """
    lidar, measured = recording.robot.lidar, recording.scans()
    observation, scans, beams = 0.0, 0, 0
    nearest = nearest_stamp(measured.t, trajectory.t)
    for i, t, pose in zip(nearest, trajectory.t, trajectory.poses, strict=True):
        z = measured.ranges[i]
        valid = lidar.valid(z)
        if abs(measured.t[i] - t) <= SAME_TIME:
            observation += float(np.sum((z - predicted_ranges(grid, pose, lidar))[valid] ** 2))
            scans, beams = scans + 1, beams + int(np.count_nonzero(valid))
    if scans == 0:
        raise DataError(recording.name, "lidar time_stamps", "none at a pose's time", "poses at scan times")
    odometry, poses = dead_reckoning(recording).at(trajectory.t), trajectory.poses
    error = poses[1:] - compose(poses[:-1], between(odometry[:-1], odometry[1:]))
    error[:, 2] = wrap_angle(error[:, 2])
    return SlamCost(observation, float(np.sum(error**2)), scans, beams)
