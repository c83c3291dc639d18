"""How good is a result: trajectory error, relative error, relations, map agreement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import Trajectory, between, compose, invert, wrap_angle


@dataclass(frozen=True)
class TrajectoryError:
    """Absolute trajectory error: position in metres (root mean square, largest), heading in degrees (r.m.s.)."""

    ate_rmse_m: float
    ate_max_m: float
    heading_rmse_deg: float
    poses: int


def aligned_at_first(estimate: Trajectory, truth: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Poses ``(K, 3)`` of the estimate, moved as a whole so that the first agrees with the truth, and the true ones.

    Only the times that the truth covers are compared. Nothing is fitted: an error of heading at the start counts.
    """
    known = truth.covers(estimate.t)
    if not known.any():
        raise DataError("aligned_at_first", "estimate times", "none within the truth's time", "trajectories that overlap")
    true_poses, poses = truth.at(estimate.t[known]), estimate.poses[known]
    return compose(compose(true_poses[0], invert(poses[0])), poses), true_poses


def trajectory_error(estimate: Trajectory, truth: Trajectory) -> TrajectoryError:
    """Absolute error of an estimate at its own times, aligned at its first pose, without any fitting."""
    poses, true_poses = aligned_at_first(estimate, truth)
    distance = np.hypot(*(poses - true_poses)[:, :2].T)
    heading = wrap_angle(poses[:, 2] - true_poses[:, 2])
    return TrajectoryError(
        float(np.sqrt(np.mean(distance**2))), float(distance.max()), float(np.rad2deg(np.sqrt(np.mean(heading**2)))), len(poses)
    )


def relations_error(estimate: Trajectory, t1: np.ndarray, t2: np.ndarray, relative: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors ``(R,)`` in metres and radians over known relative poses ``(R, 3)`` of time ``t2`` seen from ``t1``."""
    error = between(relative, between(estimate.at(t1), estimate.at(t2)))
    return np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])
