"""Your filter: the exercises of six chapters, the loop that joins them, and a drive with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import wraps
from types import SimpleNamespace

import numpy as np

from pfslam.evaluation.trajectory import TrajectoryError, trajectory_error
from pfslam.grid import LOG_4, GridSpec, OccupancyGrid
from pfslam.motion import motion_model
from pfslam.particles import Particles
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam_book.show.keep import FILE, giving, kept
from pfslam_book.show.tables import errors_by_label, read_table, select


@dataclass(frozen=True)
class Settings:
    """The numbers that the filter needs."""

    sigma_v: float = 0.2  # noise of every control sample, m/s
    sigma_omega: float = 0.1  # and of its turning, rad/s
    sharpness: float = 54.0  # exponent of a scan with all its points on walls
    resample_below: float = 0.5  # resample when N_eff is at most this share of N
    hit: float = LOG_4  # what a hit adds to a cell
    free: float = 0.1 * LOG_4  # what a crossing takes away
    clamp: float = 10.0  # how far log-odds may go
    origin: tuple[float, float] = (-30.0, -30.0)  # corner of the map, m
    resolution: float = 0.05  # side of a cell, m
    shape: tuple[int, int] = (1200, 1200)  # rows and columns of the map
    lidar_xy: tuple[float, float] = (0.13323, 0.0)  # where the LiDAR sits, m


# ---- the printed solutions of the exercises; a test holds them to the notebooks


def scan_points(ranges, angles, lidar_xy):
    """End points (K, 2) of the valid beams of one scan, in the body frame."""
    good = (ranges >= 0.1) & (ranges < 30.0)
    r, angle = ranges[good], angles[good]
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)]) + lidar_xy


def to_world(pose_wb, points_b):
    """Carry points (M, 2) from the body frame to the world."""
    x, y, theta = pose_wb
    c, s = np.cos(theta), np.sin(theta)
    return points_b @ np.array([[c, -s], [s, c]]).T + [x, y]


def inputs_between(begin, end, t_wheels, counts, t_gyro, yaw_rate, metres_per_count):
    """What wheels and gyro say of the time between two scans: rows (v, omega, dt)."""
    travelled = np.cumsum(counts.mean(axis=1) * metres_per_count)
    v = np.diff(np.interp(t_gyro, t_wheels, travelled)) / np.diff(t_gyro)
    first = np.searchsorted(t_gyro, begin, side="right") - 1
    last = np.searchsorted(t_gyro, end)
    dt = np.diff(np.clip(t_gyro[first : last + 1], begin, end))
    return np.column_stack([v[first:last], yaw_rate[1:][first:last], dt])


def cell_of(points, origin, resolution):
    """Row and column (M, 2) of the cells in which points lie."""
    return np.floor((points - np.array(origin)) / resolution).astype(int)[:, ::-1]


def crossed_cells(start, ends):
    """Row and column (F, 2) of the cells that beams cross on their way to their ends."""
    cells = []
    for end in ends:
        n = np.abs(end - start).max()  # one cell for each step of the longer way
        share = np.arange(n)[:, None] / max(n, 1)
        cells.append(np.rint(start + share * (end - start)))
    return np.concatenate(cells).astype(int)


def update_log_odds(log_odds, hits, free, hit_step, free_step, clamp):
    """The map after one scan: hits win over free cells, each cell changes once."""
    change = np.zeros_like(log_odds)
    change[free[:, 0], free[:, 1]] = -free_step  # repeated: written once
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


def step(f, s, poses, weights, log_odds, points_b, inputs, rng):
    """One scan: predict, weigh, estimate, resample, draw."""
    for v, omega, dt in inputs:
        poses = f.move(poses, v, omega, dt, s.sigma_v, s.sigma_omega, rng)
    walls, corner, side = log_odds > 0, s.origin, s.resolution
    scans = [f.to_world(pose, points_b) for pose in poses]
    counts = [f.count_on_walls(scan, walls, corner, side) for scan in scans]
    share = np.array(counts) / len(points_b)
    likelihood = np.exp(s.sharpness * (share - share.max()))
    weights = f.update(weights, likelihood)
    estimate = f.mean_pose(poses, weights)
    if 1 / np.sum(weights**2) <= s.resample_below * len(weights):
        poses, weights = f.resample(poses, weights, rng)
    beams = f.to_world(estimate, np.vstack([s.lidar_xy, points_b]))
    cells = f.cell_of(beams, corner, side)
    if (cells < 0).any() or (cells >= log_odds.shape).any():
        raise IndexError("a scan leaves the map: change origin or shape")
    start, ends = cells[0], cells[1:]
    free = f.crossed_cells(start, ends)
    log_odds = f.update_log_odds(log_odds, ends, free, s.hit, s.free, s.clamp)
    return poses, weights, log_odds, estimate


CHAPTERS = {
    "scan_points": "00",
    "to_world": "00",
    "inputs_between": "01",
    "cell_of": "02",
    "crossed_cells": "02",
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
BOOK: dict[str, Callable] = {name: globals()[name] for name in CHAPTERS}


class Filter(SimpleNamespace):
    """The eleven parts of the filter as attributes; it shows whose they are."""

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
    if count := own.get("count_on_walls"):  # one number, even if it comes in a list
        own["count_on_walls"] = wraps(count)(lambda *case: count(*case).item())
    return Filter(**{**BOOK, **own})


# ---- driving


@dataclass(frozen=True, eq=False)
class Driven:
    """What a drive of the filter left: its path, the clouds after each scan, and the map as log-odds."""

    trajectory: Trajectory
    clouds: list[Particles]
    log_odds: np.ndarray
    settings: Settings

    @property
    def grid(self) -> OccupancyGrid:
        """The map, for the book's drawings."""
        s = self.settings
        return OccupancyGrid(GridSpec(s.origin, s.resolution, s.shape), self.log_odds.astype(np.float32))


def moments(f: Filter, recording: Recording, every: int, seconds: float) -> Iterator:
    """Yield time and points (M, 2) of each scan, and the inputs (v, omega, dt) since the scan before."""
    scans, robot, (wheels, imu) = recording.scans(), recording.robot, recording.wheels_and_gyro()
    both = (imu.t >= wheels.t[0]) & (imu.t <= wheels.t[-1])
    t_gyro, yaw_rate = imu.t[both], robot.imu.yaw_rate(imu.angular_velocity[both])
    streams = wheels.t, wheels.counts, t_gyro, yaw_rate, robot.encoders.metres_per_count
    last = t_gyro[0]
    for t, ranges in zip(scans.t[::every], scans.ranges[::every], strict=True):
        if t_gyro[0] <= t <= t_gyro[-1] and t <= scans.t[0] + seconds:
            points_b = f.scan_points(ranges.astype(float), robot.lidar.angles, np.array(Settings().lidar_xy))
            yield t, points_b, [tuple(row) for row in f.inputs_between(last, t, *streams)]
            last = t


def drive(step, f, recording, particles=60, every=20, seconds=65.0, seed=0, **changes):
    """Run a filter over a drive; ``changes`` replace the settings of the same name."""
    s, rng = Settings(**changes), np.random.default_rng(seed)
    poses, weights = np.zeros((particles, 3)), np.full(particles, 1 / particles)
    log_odds, rows, clouds = np.zeros(s.shape), [], []
    for t, *scan in moments(f, recording, every, seconds):
        poses, weights, log_odds, estimate = step(f, s, poses, weights, log_odds, *scan, rng)
        rows.append((t, *estimate))
        with np.errstate(divide="ignore"):
            clouds.append(Particles(poses, np.log(weights)))
    path = np.array(rows, dtype=float)
    return Driven(Trajectory(path[:, 0], path[:, 1:]), clouds, log_odds, s)


def error(driven: Driven, recording: Recording) -> TrajectoryError:
    """The error of a drive's path against the truth, by the first pose."""
    return trajectory_error(driven.trajectory, recording.true_path())


def stored_errors(study: str = "ch05_your_filter", *, whole: bool) -> dict[str, np.ndarray]:
    """The errors (m, RMS) by label that a study has stored, on whole drives or on their first 65 s."""
    table = read_table(study)
    return errors_by_label(select(table, seconds=max(table["seconds"]) if whole else 65))
