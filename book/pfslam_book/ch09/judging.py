"""Chapter 09: ways to judge one path against the truth."""

from __future__ import annotations

import numpy as np

from pfslam.evaluation.trajectory import aligned_at_first, trajectory_error
from pfslam.poses import Trajectory, between, compose, transform_points, wrap_angle
from pfslam.recording import Recording
from pfslam_book.show.tables import Shown


def best_fit(estimate: Trajectory, truth: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return poses of the estimate ``(K, 3)``, turned and shifted as a whole to lie as near to the truth as can be.

    Least squares over positions, in closed form; true poses ``(K, 3)`` beside it.
    """
    poses, true_poses = aligned_at_first(estimate, truth)
    a = poses[:, :2] - poses[:, :2].mean(axis=0)
    b = true_poses[:, :2] - true_poses[:, :2].mean(axis=0)
    turn = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    pivot = np.array([0.0, 0.0, turn])
    shift = true_poses[:, :2].mean(axis=0) - transform_points(pivot, poses[:, :2]).mean(axis=0)
    return compose(np.array([*shift, turn]), poses), true_poses


def best_fit_rmse(estimate: Trajectory, truth: Trajectory) -> float:
    """Return the root mean square position error (m) that is left after the best fit."""
    poses, true_poses = best_fit(estimate, truth)
    return float(np.sqrt(np.mean(np.sum((poses - true_poses)[:, :2] ** 2, axis=1))))


def relative_rmse(estimate: Trajectory, truth: Trajectory, delta: int = 1) -> float:
    """Measure how far (m) the motion from pose i to i + delta is off, over all i (evo's RPE, all pairs, in frames).

    It does not depend on where either trajectory starts. Only times that the truth covers count.
    """
    known = truth.covers(estimate.t)
    poses, true_poses = estimate.poses[known], truth.at(estimate.t[known])
    error = between(between(true_poses[:-delta], true_poses[delta:]), between(poses[:-delta], poses[delta:]))
    return float(np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1))))


def turned_start(truth: Trajectory, degrees: float) -> Trajectory:
    """Return the path that follows if the heading of the first step is wrong by so many degrees."""
    first, turn = truth.poses[0], np.deg2rad(degrees)
    places = first[:2] + transform_points(np.array([0.0, 0.0, turn]), truth.poses[:, :2] - first[:2])
    poses = np.column_stack([places, wrap_angle(truth.poses[:, 2] + turn)])
    poses[0] = first  # the start is given; the mistake is made in the first step
    return Trajectory(truth.t, poses)


def judged_table(paths: dict[str, Trajectory], recording: Recording, delta: int = 10) -> Shown:
    """Return the errors in cm of each path by first pose, by best fit, and relative over ``delta`` poses."""
    truth, rows = recording.true_path(), []
    for name, path in paths.items():
        errors = (
            trajectory_error(path, truth).ate_rmse_m,
            best_fit_rmse(path, truth),
            relative_rmse(path, truth, delta),
        )
        rows.append((name, *(f"{100 * error:.2f}" for error in errors)))
    return Shown(("error [cm]", "first pose", "best fit", f"over {delta} poses"), rows)
