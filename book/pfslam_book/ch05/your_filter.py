"""Chapter 05, your filter: the exercises of six chapters put together, driven, and broken on purpose."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from pfslam.evaluation.trajectory import TrajectoryError, trajectory_error
from pfslam.grid import LOG_4, GridSpec, OccupancyGrid
from pfslam.motion import controls, dead_reckoning, motion_model
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam_book.show.figures import draw_map, draw_trajectory
from pfslam_book.show.keep import FILE, giving, kept
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import new_figure

FILTER_TABLE = Path(__file__).parent / "your_filter.csv"


@dataclass(frozen=True)
class Settings:
    """What the filter is set to: noise per control sample, sharpness per beam, map updates and resampling."""

    sigma_v: float = 0.2
    sigma_omega: float = 0.1
    sharpness: float = 0.05
    """Log-likelihood that one more end point on a wall is worth."""
    hit: float = LOG_4
    free: float = 0.1 * LOG_4
    clamp: float = 10.0
    resample_below: float = 0.5
    """Resample when N_eff is at most this share of N; 0: never."""
    origin: tuple[float, float] = (-12.0, -12.0)
    resolution: float = 0.05
    shape: tuple[int, int] = (960, 960)
    lidar_xy: tuple[float, float] = (0.13323, 0.0)


# ---- the printed solutions of the exercises; a test holds them to the notebooks


def scan_points(ranges, angles, lidar_xy):
    """End points (K, 2) of the valid beams of one scan, in the body frame."""
    good = (ranges >= 0.1) & (ranges < 30.0)
    r, angle = ranges[good], angles[good]
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)]) + lidar_xy


def to_world(pose_wb, points_b):
    """Points (M, 2) of the body frame in the world."""
    x, y, theta = pose_wb
    c, s = np.cos(theta), np.sin(theta)
    return points_b @ np.array([[c, -s], [s, c]]).T + [x, y]


def cell_of(points, origin, resolution):
    """Row and column (M, 2) of the cells in which points lie."""
    return np.floor((points - np.array(origin)) / resolution).astype(int)[:, ::-1]


def update_log_odds(log_odds, hits, free, hit_step, free_step, clamp):
    """The map after one scan: hits win over free cells, each cell changes once."""
    change = np.zeros_like(log_odds)
    change[free[:, 0], free[:, 1]] = -free_step  # repeated cells: written once
    change[hits[:, 0], hits[:, 1]] = hit_step  # after the free ones: hits win
    return np.clip(log_odds + change, -clamp, clamp)


def move(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    """Every pose driven by its own noisy control: Eq. 11 of the report."""
    noisy_v = v + sigma_v * rng.standard_normal(len(poses))
    noisy_omega = omega + sigma_omega * rng.standard_normal(len(poses))
    return motion_model(poses, noisy_v, noisy_omega, dt)


def count_on_walls(points, occupied, origin, resolution):
    """How many points lie in occupied cells: Eq. 8 of the report."""
    ix, iy = np.floor((points - np.array(origin)) / resolution).astype(int).T
    rows, columns = occupied.shape
    inside = (ix >= 0) & (ix < columns) & (iy >= 0) & (iy < rows)
    return np.count_nonzero(occupied[iy[inside], ix[inside]])


def update(weights, likelihood):
    """Weights times likelihood, normalised: Eq. 12 of the report."""
    joint = weights * likelihood
    if joint.sum() == 0:
        return weights
    return joint / joint.sum()


def resample(poses, weights, rng):
    """Poses drawn by weight with a comb, and equal weights."""
    n = len(poses)
    teeth = (np.arange(n) + rng.random()) / n
    ancestors = np.searchsorted(np.cumsum(weights), teeth, side="right")
    return poses[np.minimum(ancestors, n - 1)], np.full(n, 1 / n)


def mean_pose(poses, weights):
    """The weighted mean of a cloud, its heading averaged on the circle."""
    sine, cosine = weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2])
    return np.array([*(weights @ poses[:, :2]), np.arctan2(sine, cosine)])


def step(f, s, poses, weights, log_odds, points_b, drive, rng):
    """One scan: predict, weigh, estimate, resample, draw."""
    for v, omega, dt in drive:  # predict; at rest the gyro's noise turns no particle
        sigma_omega = s.sigma_omega * (v != 0)
        poses = f.move(poses, v, omega, dt, s.sigma_v, sigma_omega, rng)
    walls = log_odds > 0
    if walls.any():  # score every particle where it stands, and weigh it
        scans = [f.to_world(pose, points_b) for pose in poses]
        grid = (walls, s.origin, s.resolution)
        counts = np.array([f.count_on_walls(points, *grid) for points in scans])
        likelihood = np.exp(s.sharpness * (counts - counts.max()))
        weights = f.update(weights, likelihood)
    estimate = f.mean_pose(poses, weights)
    if 1 / np.sum(weights**2) <= s.resample_below * len(weights):  # the comb
        poses, weights = f.resample(poses, weights, rng)
    ends = f.to_world(estimate, points_b)
    sensor = f.to_world(estimate, np.array([s.lidar_xy]))
    along = np.linspace(0, 1, 120)[:-1, None, None]  # 119 points on every ray
    crossed = (sensor + along * (ends[::2] - sensor)).reshape(-1, 2)
    hits = f.cell_of(ends, s.origin, s.resolution)
    free = f.cell_of(crossed, s.origin, s.resolution)
    log_odds = f.update_log_odds(log_odds, hits, free, s.hit, s.free, s.clamp)
    return poses, weights, log_odds, estimate


CHAPTERS = {
    "scan_points": "00",
    "to_world": "00",
    "cell_of": "02",
    "update_log_odds": "02",
    "move": "03",
    "count_on_walls": "04",
    "update": "05",
    "resample": "05",
    "mean_pose": "05",
}
"""The parts of the filter, and the chapter that asks for each."""
KINDS: Mapping[str, tuple[type, ...]] = {
    "cell_of": (int,),
    "crossed_cells": (int,),
    "resample": (float, float),
}
"""What a part returns, if not one array of floats."""
BOOK: Mapping[str, Callable] = {name: globals()[name] for name in CHAPTERS}


class Filter(SimpleNamespace):
    """The nine parts of the filter as attributes; it shows whose they are."""

    def __repr__(self) -> str:
        whose = {name: "the book's" if vars(self)[name] is BOOK[name] else "yours" for name in CHAPTERS}
        return "\n".join(f"{chapter} {name:16s} {whose[name]}" for name, chapter in CHAPTERS.items())


def my_filter(file=FILE, **parts: Callable) -> Filter:
    """The reader's parts from ``my_filter.py``, or those given by name; the book's own where one is missing.

    Whatever a part returns becomes an array: lists, tuples and float cells are right answers too.
    """
    own = {
        name: giving(f, *KINDS.get(name, (float,)))
        for name, f in (kept(file) | parts).items()
        if name in CHAPTERS
    }
    return Filter(**{**BOOK, **own})


CHANGES: dict[str, dict] = {
    "as printed": {},
    "half the noise": {"sigma_v": 0.1, "sigma_omega": 0.05},
    "full clearing": {"free": LOG_4},
    "never resampled": {"resample_below": 0.0},
}
"""Ways to harm the filter on purpose, as settings of `drive`."""


# ---- driving


@dataclass(frozen=True, eq=False)
class Driven:
    """What a drive of the filter left: ``trajectory``, ``log_odds``, N_eff / N at each scan, and resamplings."""

    trajectory: Trajectory
    log_odds: np.ndarray
    n_eff: np.ndarray
    settings: Settings

    @property
    def grid(self) -> OccupancyGrid:
        """The map, for the book's drawings."""
        s = self.settings
        return OccupancyGrid(GridSpec(s.origin, s.resolution, s.shape), self.log_odds.astype(np.float32))


def scans_and_controls(f: Filter, s: Settings, recording: Recording, every: int, seconds: float) -> Iterator:
    """Time, points (M, 2) and controls since the scan before, for every ``every``-th scan."""
    inputs, scans, lidar = controls(recording), recording.scans(), recording.robot.lidar
    previous = inputs.t[0]
    for i in range(0, len(scans.t), every):
        t = scans.t[i]
        if inputs.t[0] <= t <= inputs.t[-1] and t - scans.t[0] <= seconds:
            points_b = f.scan_points(scans.ranges[i], lidar.angles, np.array(s.lidar_xy))
            yield t, points_b, list(zip(*inputs.during(previous, t), strict=True))
            previous = t


def drive(
    step: Callable,
    f: Filter,
    recording: Recording,
    *,
    particles: int = 60,
    every: int = 20,
    seconds: float = 65.0,
    seed: int = 0,
    **changes,
) -> Driven:
    """Run a filter over a drive: ``step`` with the parts ``f``; ``changes`` are settings other than the usual."""
    s, rng = Settings(**changes), np.random.default_rng(seed)
    poses, weights, log_odds = np.zeros((particles, 3)), np.full(particles, 1 / particles), np.zeros(s.shape)
    t, estimates, n_eff = [], [], []
    for stamp, points_b, inputs in scans_and_controls(f, s, recording, every, seconds):
        poses, weights, log_odds, estimate = step(f, s, poses, weights, log_odds, points_b, inputs, rng)
        t.append(stamp)
        estimates.append(np.asarray(estimate, dtype=float))
        n_eff.append(1 / np.sum(np.square(weights)) / particles)
    return Driven(Trajectory(np.array(t), np.array(estimates)), log_odds, np.array(n_eff), s)


def error(driven: Driven | Trajectory, recording: Recording) -> TrajectoryError:
    """The error of a path against the truth, by the first pose."""
    path = driven.trajectory if isinstance(driven, Driven) else driven
    return trajectory_error(path, recording.true_path())


def odometry_error(recording: Recording, path: Trajectory) -> float:
    """What dead reckoning is off by (m, RMS) at the times of a path."""
    return error(Trajectory(path.t, dead_reckoning(recording).at(path.t)), recording).ate_rmse_m


# ---- pictures


def driven_picture(runs: dict[str, Driven], recording: Recording) -> Picture:
    """Map and path of each run, with the truth and what dead reckoning made of the same drive."""
    figure, row = new_figure(5.1, 3.4, columns=len(runs), sharey=True, squeeze=False)
    words = []
    for axes, (name, run) in zip(row[0], runs.items(), strict=True):
        draw_map(axes, run.grid, name)
        at = run.trajectory.t
        draw_trajectory(axes, Trajectory(at, dead_reckoning(recording).at(at)), "odometry")
        draw_trajectory(axes, run.trajectory, "estimate")
        draw_trajectory(axes, Trajectory(at, recording.true_path().at(at)), "truth")
        off = error(run, recording)
        words.append(f"{name}: {off.ate_rmse_m:.2f} m off (RMS), at most {off.ate_max_m:.2f} m")
        axes.set_ylabel("y [m]" if axes is row[0, 0] else "")
    handles = row[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3)
    return Picture(figure, f"Map, odometry, estimate and truth. {'; '.join(words)}.")
