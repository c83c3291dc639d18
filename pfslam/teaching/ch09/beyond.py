"""Chapter 09: buildings nobody tuned on, a real log, and five ways to judge one path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import pfslam
from pfslam.config import SlamConfig
from pfslam.datasets import data_folder, load
from pfslam.evaluation.trajectory import aligned_at_first, relative_error, trajectory_error
from pfslam.poses import Trajectory, compose, transform_points, wrap_angle
from pfslam.recording import Recording
from pfslam.runs import run_slam
from pfslam.teaching.ch09.tables import length, middle
from pfslam.teaching.show.figures import draw_map, draw_trajectory
from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import new_figure
from pfslam.teaching.show.tables import labels_of, read_table, select

LOG = "intel/intel.log"


def relations_lines(name: str = "ch09_intel") -> str:
    """Mean error over the relations in metres and degrees: median and worst of the seeds, for each method."""
    table = read_table(name)
    lines = [f"{'':22s} {'runs':>4s} {'median':>8s} {'worst':>8s} {'heading':>9s}"]
    for label in labels_of(table):
        rows = select(table, label=label)
        metres, degrees = rows["relation_xy_m"], rows["relation_deg"]
        lines.append(
            f"{label:22s} {len(metres):4d} {length(middle(metres)):>8s} {length(metres.max()):>8s} "
            f"{middle(degrees):5.2f} deg"
        )
    return "\n".join(lines)


def real_log() -> Path | None:
    """The Intel log: in the data folder, or beside a checkout of this book; None where it is absent."""
    beside = Path(pfslam.__file__).resolve().parents[2] / "shared" / "data"
    found = [folder / LOG for folder in (data_folder(), beside) if (folder / LOG).is_file()]
    return found[0] if found else None


def intel_picture(counterpart: Recording) -> Picture:
    """The map of the real log where it is at hand, of the counterpart where not: one pose, matched and polished."""
    log = real_log()
    recording = load(log) if log else counterpart
    config = replace(SlamConfig.matching(), every=None if log else 20)
    result = run_slam(recording, config, keep_particles=False)
    figure, axes = new_figure(6.2, 6.2 if log else 5.2)
    name = "Intel Research Lab" if log else f"{recording.name} (built in: the real log is not here)"
    draw_map(axes, result.grid, name)
    draw_trajectory(axes, result.trajectory, "estimate", "path")
    axes.legend(loc="lower right")
    walked = np.hypot(*np.diff(result.trajectory.poses[:, :2], axis=0).T).sum()
    alt = f"Map and path of {name}: {walked:.0f} m driven; each wall is drawn once."
    return Picture(figure, alt)


# ---- judging a path


def best_fit(estimate: Trajectory, truth: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Poses of the estimate ``(K, 3)``, turned and shifted as a whole to lie as near to the truth as can be.

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
    """Root mean square position error (m) that is left after the best fit."""
    poses, true_poses = best_fit(estimate, truth)
    return float(np.sqrt(np.mean(np.sum((poses - true_poses)[:, :2] ** 2, axis=1))))


def turned_start(truth: Trajectory, degrees: float) -> Trajectory:
    """The true path of somebody who took his first heading wrong by so many degrees: one mistake, made once."""
    first, turn = truth.poses[0], np.deg2rad(degrees)
    places = first[:2] + transform_points(np.array([0.0, 0.0, turn]), truth.poses[:, :2] - first[:2])
    poses = np.column_stack([places, wrap_angle(truth.poses[:, 2] + turn)])
    poses[0] = first  # the start is given; the mistake is made in the first step
    return Trajectory(truth.t, poses)


def judged_lines(paths: dict[str, Trajectory], recording: Recording, delta: int = 10) -> str:
    """Error of each path by first pose, by best fit, and relative over ``delta`` poses."""
    truth = recording.true_path()
    lines = [f"{'':22s} {'first pose':>10s} {'best fit':>9s} {f'over {delta} poses':>14s}"]
    for name, path in paths.items():
        first, fit = trajectory_error(path, truth).ate_rmse_m, best_fit_rmse(path, truth)
        relative = relative_error(path, truth, delta).rmse_m
        lines.append(f"{name:22s} {length(first):>10s} {length(fit):>9s} {length(relative):>14s}")
    return "\n".join(lines)
