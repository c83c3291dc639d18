"""Chapter 09: three kinds of SLAM in one table, and the histories of a filter with one map per particle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from pfslam.config import SlamConfig
from pfslam.grid import OccupancyGrid
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.runs import slam_steps
from pfslam.simulator import HALL, simulate
from pfslam.study.table import Table
from pfslam.teaching.ch09.tables import length, middle
from pfslam.teaching.show.figures import draw_map, draw_trajectory
from pfslam.teaching.show.pictures import steady
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.tables import ERROR, labels_of, read_table, select

FRAMES = 20


KINDS = {"scan matching": 1, "shared map": 200, "shared map, drawn as rarely": 200, "per-particle maps": 30}
"""Particles of each kind in the two studies."""


def kinds_lines() -> str:
    """Accuracy, processor time and memory of each kind, on ``hall``; and accuracy round the loop without polish."""
    hall, loop = read_table("ch09_kinds"), read_table("ch09_loop")
    lines = [f"{'':28s}{'N':>3s} {'error':>7s} {'CPU':>6s} {'memory':>7s} {'loop':>8s} {'worst':>8s}"]
    for label, particles in KINDS.items():
        rows = select(hall, label=label)
        cost = f"{middle(rows['cpu_seconds']):4.0f} s {middle(rows['peak_mb']):4.0f} MB"
        ring = loop_errors(loop, label, particles)
        spread = f"{length(middle(ring)):>8s} {length(ring.max()):>8s}"
        lines.append(f"{label:28s}{particles:3d} {length(middle(rows[ERROR])):>7s} {cost} {spread}")
    return "\n".join(lines)


def loop_errors(loop: Table, label: str, particles: int) -> np.ndarray:
    """Errors round the loop of one kind with so many particles; those without a number have their default."""
    rows = select(loop, label=label)
    given = np.isnan(rows["particles"]) | (rows["particles"] == particles)
    return rows[ERROR][given]


def medians(name: str, column: str = ERROR) -> dict[str, float]:
    """Median of a column for each label of a stored table."""
    table = read_table(name)
    return {label: middle(select(table, label=label)[column]) for label in labels_of(table)}


# ---- the player


@dataclass(frozen=True, eq=False)
class Histories:
    """A run with one map per particle, kept so that it can be played.

    ``clouds (T, N, 3)`` are the poses before each resampling, ``ancestors (T, N)`` who of them went on; ``shown``
    the steps of the frames, ``maps`` the heaviest particle's map there.
    """

    recording: Recording
    t: np.ndarray
    clouds: np.ndarray
    ancestors: np.ndarray
    shown: np.ndarray
    maps: tuple[OccupancyGrid, ...]

    def lineages(self, k: int) -> np.ndarray:
        """Indices ``(k + 1, N)``: through which particle of each step the N histories alive at step k came."""
        index = np.empty((k + 1, self.clouds.shape[1]), dtype=int)
        index[k] = np.arange(self.clouds.shape[1])
        for step in range(k, 0, -1):
            index[step - 1] = self.ancestors[step - 1][index[step]]
        return index

    def paths(self, k: int) -> np.ndarray:
        """Poses ``(k + 1, N, 3)`` of the histories alive at step k."""
        return self.clouds[np.arange(k + 1)[:, None], self.lineages(k)]

    def alive(self, k: int) -> np.ndarray:
        """How many different particles of each step ``(k + 1,)`` the histories alive at step k came through."""
        return np.array([len(np.unique(row)) for row in self.lineages(k)])

    def away(self, poses: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Distance (m) of poses ``(T, N, 3)`` from the truth at the given steps ``(T,)``."""
        truth = self.recording.true_path().at(self.t[steps])
        return np.hypot(*(poses - truth[:, None])[..., :2].T).T


def loop_recording() -> Recording:
    """A drive round a ring of corridors."""
    return simulate(replace(HALL, name="loop", layout="loop")).recording


def play_histories(recording: Recording, particles: int = 10, every: int = 40, seed: int = 0) -> Histories:
    """Run the filter with a map per particle, without the polish, and keep who descends from whom."""
    config = replace(SlamConfig.per_particle(), particles=particles, every=every, polish=None)
    t, clouds, ancestors, grids = [], [], [], []
    for state, info in slam_steps(recording, config, np.random.default_rng(seed)):
        assert info.particles is not None  # kept by every step; only run_slam drops it on demand
        t.append(info.t)
        clouds.append(info.particles.poses)
        same = (state.particles.poses[:, None] == info.particles.poses[None]).all(axis=2)
        # Where nobody was resampled everyone goes on as himself, equal poses or not.
        ancestors.append(same.argmax(axis=1) if info.resampled else np.arange(particles))
        grids.append(OccupancyGrid(state.grid.spec, state.grid.log_odds))
    shown = np.linspace(0, len(t) - 1, FRAMES + 1).astype(int)[1:]
    maps = tuple(grids[k] for k in shown)
    return Histories(recording, np.array(t), np.array(clouds), np.array(ancestors), shown, maps)


def histories_frame(run: Histories) -> Callable[..., Figure]:
    """The drawing function of the player: paths on the heaviest particle's map, and errors as a family tree."""
    seconds = run.t - run.t[0]
    everyone = 100 * run.away(run.clouds, np.arange(len(run.t)))

    def draw(frame: int) -> Figure:
        k = run.shown[frame - 1]
        paths = run.paths(k)
        figure, (left, right) = new_figure(6.4, 4.0, columns=2, width_ratios=[1.1, 1])
        draw_map(left, run.maps[frame - 1], f"{run.t[k] - run.t[0]:.0f} s")
        left.plot(paths[..., 0], paths[..., 1], color=COLOURS["particles"], linewidth=1.2)
        draw_trajectory(left, Trajectory(run.t, run.recording.true_path().at(run.t)), "truth")
        left.set_facecolor(COLOURS["unknown"])
        till = seconds[: k + 1]
        right.plot(till, everyone[: k + 1], ".", color=COLOURS["unknown"], markersize=3)
        right.plot(till, 100 * run.away(paths, np.arange(k + 1)), color=COLOURS["particles"], lw=1.2)
        right.set(xlim=(0, seconds[-1]), ylim=(0, 1.05 * everyone.max()))
        right.set(xlabel="time [s]", title="off the truth [cm]")
        return figure

    return steady(draw)


def histories_alt(run: Histories) -> Callable[..., str]:
    """The words for a frame of the player."""

    def alt(frame: int) -> str:
        k = run.shown[frame - 1]
        n, alive = run.clouds.shape[1], run.alive(k)
        away = 100 * run.away(run.clouds[k][None], np.array([k]))[0]
        return f"""After {run.t[k] - run.t[0]:.0f} s the {n} histories stand {away.min():.0f} to {away.max():.0f} cm off
        the truth. Half way back in time they came through {alive[k // 2]} of the {n} particles of that moment, at the
        second scan through {alive[min(1, k)]}."""

    return alt
