"""Chapter 05, the measurements: errors over seeds, the cost of Eq. 2, and walls that are rubbed out."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from pfslam.evaluation.trajectory import SlamCost, slam_cost
from pfslam.grid import LOG_4, MapConfig, OccupancyGrid
from pfslam.io.files import read_text
from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording
from pfslam.run import run_slam
from pfslam.sensors import scan_points
from pfslam.slam import SlamConfig
from pfslam_book.show.figures import draw_map, map_along
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure

LATTICE_TABLE = Path(__file__).parent / "lattice.csv"
GENTLE = 0.25 * LOG_4
"""Log-odds that a free cell loses in the cure for erosion: a quarter of what a hit gains."""


def paths_over_seeds(recording: Recording, config: SlamConfig, seeds: int) -> list[Trajectory]:
    """The estimated path of one run per seed."""
    rngs = [np.random.default_rng(seed) for seed in range(seeds)]
    return [run_slam(recording, config, rng=rng, keep_particles=False).trajectory for rng in rngs]


FIRST_CORRIDOR = (17.0, 31.0)
"""When the robot drives up the first corridor of ``hall``, in seconds after the first scan."""


def corridor_excess(recording: Recording, path: Trajectory) -> float:
    """How much longer (m) the first corridor is on this path than in truth, from one end to the other."""
    t = recording_start(recording) + np.array(FIRST_CORRIDOR)
    drives = [np.hypot(*np.diff(p.at(t)[:, :2], axis=0)[0]) for p in (path, recording.true_path())]
    return float(drives[0] - drives[1])


def recording_start(recording: Recording) -> float:
    """Time of the first scan (s)."""
    return float(recording.scans().t[0])


def slip_picture(excess: dict[str, np.ndarray]) -> Picture:
    """One dot per run, one row per case."""
    figure, axes = new_figure(5.1, 2.9)
    words = []
    for row, (name, values) in enumerate(excess.items()):
        colour = COLOURS[("odometry", "report", "report", "refined")[row]]
        axes.scatter(values, np.full(len(values), -row), color=colour, s=40, alpha=0.8)
        words.append(f"{name}: {np.min(values):.2f} to {np.max(values):.2f} m (runs: {len(values)})")
    axes.axvline(0.0, color=COLOURS["truth"], linestyle=":")
    axes.set_yticks(-np.arange(len(excess)), list(excess))
    axes.set(xlabel="the corridor is too long by [m]", ylim=(-len(excess) + 0.5, 0.5))
    axes.locator_params(axis="x", nbins=5)
    return Picture(
        figure, f"How much too long the first corridor becomes. {'; '.join(words)}. Dotted: truth."
    )


def stored_errors(table: Path) -> dict[str, np.ndarray]:
    """The errors (m, RMS) of a table that ``book/_tools/filter_tables.py`` made, one array for each label."""
    rows = list(csv.DictReader(io.StringIO(read_text(table))))
    labels = dict.fromkeys(row["label"] for row in rows)
    return {
        name: np.array([float(row["ate_rmse_m"]) for row in rows if row["label"] == name]) for name in labels
    }


def cost_at(trajectory: Trajectory, grid: OccupancyGrid, recording: Recording, times: np.ndarray) -> SlamCost:
    """Eq. 2 at the given scan times only, so that different trajectories are judged by the same scans."""
    return slam_cost(Trajectory(times, trajectory.at(times)), grid, recording)


def hits_per_cell(recording: Recording, spec, every: int) -> np.ndarray:
    """How many end points fell into each cell ``(H, W)`` when every scan is placed at its true pose."""
    hits, scans, truth = np.zeros(spec.shape, dtype=int), recording.scans(), recording.true_path()
    for i in range(0, len(scans.t), every):
        pose = truth.at(scans.t[i])
        points = transform_points(pose, scan_points(scans.ranges[i], recording.robot.lidar))
        ix, iy = spec.world_to_cell(points).T
        np.add.at(hits, (iy, ix), 1)
    return hits


def erosion(
    recording: Recording, free: float, every: int = 10, at_least: int = 10
) -> tuple[OccupancyGrid, float]:
    """The map from true poses with free cells lowered by ``free``, and the share of its walls that it rubbed out.

    Walls are the cells hit by ``at_least`` end points; rubbed out are those whose log-odds ended at zero or below.
    """
    grid = map_along(recording, recording.true_path(), MapConfig(free=free), every=every)
    wall = hits_per_cell(recording, grid.spec, every) >= at_least
    return grid, float(np.mean(~grid.occupied[wall]))


def erosion_picture(
    maps: dict[str, tuple[OccupancyGrid, float]], window: tuple[float, float, float, float]
) -> Picture:
    """The same piece of wall drawn with each amount of clearing; ``window`` is x_min, x_max, y_min, y_max."""
    figure, axes = new_figure(5.1, 4.8, rows=len(maps), sharex=True)
    words = []
    for ax, (name, (grid, share)) in zip(axes, maps.items(), strict=True):
        draw_map(ax, grid, f"{name}: {share:.0%} of wall cells rubbed out")
        ax.set(xlim=window[:2], ylim=window[2:], yticks=(-1, 0, 1))
        words.append(f"{name}: {100 * share:.0f} %")
    axes[0].set_xlabel("")
    alt = f"""A corridor drawn twice from true poses. Share of well-seen wall cells that end up not occupied:
    {"; ".join(words)}."""
    return Picture(figure, alt)
