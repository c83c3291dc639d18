"""Chapter 05: runs of the filter, kept so that they can be played, and their pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import OccupancyGrid
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording, nearest_stamp
from pfslam.run import slam_steps, used_scans
from pfslam.sensors import scan_points
from pfslam.slam import SlamConfig, Step
from pfslam_book.show.figures import (
    draw_map,
    draw_particles,
    draw_robot,
    draw_scan,
    draw_trajectory,
    map_along,
)
from pfslam_book.show.pictures import Picture, steady
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.widgets import Explorer, Slider

FRAMES = 20


@dataclass(frozen=True, eq=False)
class Played:
    """A run with what a film of it needs: every info, and the map at ``FRAMES`` of the steps (``shown``)."""

    recording: Recording
    config: SlamConfig
    infos: tuple[Step, ...]
    shown: np.ndarray
    maps: tuple[OccupancyGrid, ...]

    @property
    def trajectory(self) -> Trajectory:
        return Trajectory(np.array([i.t for i in self.infos]), np.array([i.estimate for i in self.infos]))

    @property
    def grid(self) -> OccupancyGrid:
        return self.maps[-1]

    @property
    def seconds(self) -> np.ndarray:
        """Time of every step since the first."""
        return np.array([i.t for i in self.infos]) - self.infos[0].t

    @property
    def n_eff_share(self) -> np.ndarray:
        """N_eff / N_p at every step."""
        return np.array([i.effective_sample_size for i in self.infos]) / self.config.particles


def play(recording: Recording, config: SlamConfig, seed: int = 0) -> Played:
    """Run the filter and keep what the film shows; the last frame is the last step."""
    steps = len(used_scans(recording, config).t)
    shown = np.linspace(0, steps - 1, FRAMES + 1).astype(int)[1:]
    infos, maps = [], []
    for k, (state, info) in enumerate(slam_steps(recording, config, np.random.default_rng(seed))):
        infos.append(info)
        if k in shown:  # the maps of all steps would fill gigabytes
            maps.append(state.grid.copy())
    return Played(recording, config, tuple(infos), shown, tuple(maps))


def odometry_at(recording: Recording, t: np.ndarray) -> Trajectory:
    """Dead reckoning at the given times."""
    return Trajectory(t, dead_reckoning(recording).at(t))


# ---- pictures


def dead_reckoned_maps_picture(recordings: dict[str, Recording]) -> Picture:
    """Figures 5 and 6 of the report: what dead reckoning draws."""
    figure, axes = new_figure(5.1, 3.4, columns=len(recordings))
    words = []
    for ax, (name, recording) in zip(axes, recordings.items(), strict=True):
        odometry = dead_reckoning(recording)
        draw_map(ax, map_along(recording, odometry, every=20), name)
        error = trajectory_error(odometry, recording.true_path())
        words.append(f"{name}: the path is off by up to {error.ate_max_m:.1f} m")
    axes[1].set_ylabel("")
    return Picture(
        figure, f"Maps drawn along dead reckoning. Corridors appear twice, turned. {'; '.join(words)}."
    )


def results_picture(runs: dict[str, Played]) -> Picture:
    """Figures 7 and 8 of the report in one: map and trajectory of each run, with the truth."""
    figure, axes = new_figure(5.1, 3.4, columns=len(runs))
    words = []
    for ax, (name, run) in zip(axes, runs.items(), strict=True):
        draw_map(ax, run.grid, name)
        draw_trajectory(ax, run.trajectory, "estimate")
        draw_trajectory(ax, run.recording.true_path(), "truth")
        error = trajectory_error(run.trajectory, run.recording.true_path())
        words.append(f"{name}: error {error.ate_rmse_m:.2f} m, at most {error.ate_max_m:.2f} m")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    axes[1].set_ylabel("")
    return Picture(figure, f"Map, estimated path and true path of two runs. {'; '.join(words)}.")


def with_resamplings(run: Played) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and N_eff / N_p, with a second value, 1, wherever the cloud was resampled: the teeth of a saw."""
    resampled = np.flatnonzero([info.resampled for info in run.infos])
    t, share = (
        np.append(run.seconds, run.seconds[resampled]),
        np.append(run.n_eff_share, np.ones(len(resampled))),
    )
    order = np.argsort(t, kind="stable")
    return t[order], share[order]


# ---- the film


def film_explorer(runs: dict[str, Played]) -> Explorer:
    """The runs as films of ``FRAMES`` pictures: choose one and play it."""
    frames, first = range(1, FRAMES + 1), next(iter(runs.values()))
    off = [
        np.hypot(*(first.infos[k].estimate - first.recording.true_path().at(first.infos[k].t))[:2])
        for k in first.shown
    ]
    return Explorer(
        steady(partial(_film_frame, runs)),
        [
            Slider("name", list(runs), 0, "Filter"),
            Slider("frame", list(frames), int(np.argmax(off)), "Frame"),
        ],
        alt=partial(_film_alt, runs),
        title="The filter at work",
        play="frame",
    )


def _film_frame(runs: dict[str, Played], name: str, frame: int) -> Figure:
    run = runs[name]
    figure, axes = new_figure(5.1, 4.4, 2, 2, width_ratios=[1.6, 1], height_ratios=[1.5, 1])
    grid_spec = axes[0, 0].get_gridspec()
    for ax in axes[:, 0]:
        ax.remove()
    _draw_building(figure.add_subplot(grid_spec[:, 0]), run, frame)
    _draw_cloud(axes[0, 1], run, frame)
    _draw_n_eff(axes[1, 1], run, frame)
    return figure


def _film_alt(runs: dict[str, Played], name: str, frame: int) -> str:
    run = runs[name]
    k = run.shown[frame - 1]
    info = run.infos[k]
    error = np.hypot(*(info.estimate - run.recording.true_path().at(info.t))[:2])
    spread = np.hypot(*info.particles.poses[:, :2].std(axis=0))
    resamplings = sum(i.resampled for i in run.infos[: k + 1])
    return f"""Filter {name}, {run.seconds[k]:.0f} s: estimate {error:.2f} m from the truth, particles spread over
    {spread:.2f} m, N_eff {run.n_eff_share[k]:.2f} of N_p, {resamplings} resamplings so far."""


def _draw_building(axes: Axes, run: Played, frame: int) -> None:
    k = run.shown[frame - 1]
    draw_map(axes, run.maps[frame - 1], f"{run.seconds[k]:.0f} s")
    past = Trajectory(run.trajectory.t[: k + 1], run.trajectory.poses[: k + 1])
    draw_trajectory(axes, past, "estimate")
    draw_robot(axes, run.infos[k].estimate, length=1.6)
    x, y = run.recording.true_path().poses[:, :2].T
    axes.set(xlim=(x.min() - 3.5, x.max() + 3), ylim=(y.min() - 3, y.max() + 3))
    axes.set_facecolor(COLOURS["unknown"])


def _draw_cloud(axes: Axes, run: Played, frame: int, reach: float = 0.4) -> None:
    """The particles near the estimate, with scan, map and truth."""
    info = run.infos[run.shown[frame - 1]]
    true = run.recording.true_path().at(info.t)
    scans = run.recording.scans()
    i = nearest_stamp(scans.t, np.array([info.t]))[0]
    points = scan_points(scans.ranges[i], run.recording.robot.lidar)
    draw_map(axes, run.maps[frame - 1])
    draw_scan(axes, transform_points(info.estimate, points), size=8, label=None)
    draw_particles(axes, info.particles, size=14)
    draw_robot(axes, info.estimate, length=0.35)
    axes.plot(*true[:2], marker="x", markersize=9, markeredgewidth=2.5, color=COLOURS["truth"])
    x, y, _ = info.estimate
    axes.set(
        xlim=(x - reach, x + reach), ylim=(y - reach, y + reach), xticks=(), yticks=(), xlabel="", ylabel=""
    )
    axes.set_facecolor(COLOURS["unknown"])
    axes.set_title(f"{2 * reach:g} m wide")


def _draw_n_eff(axes: Axes, run: Played, frame: int) -> None:
    k = run.shown[frame - 1]
    t, share = with_resamplings(run)
    past = (t > 0) & (t <= run.seconds[k])
    axes.plot(t[past], share[past], color=COLOURS["estimate"], linewidth=0.7)
    axes.axhline(run.config.resample_below, color=COLOURS["highlight"], linestyle="--")
    axes.set(xlim=(0, run.seconds[-1]), ylim=(0, 1.08), xlabel="time [s]", ylabel="$N_{eff}$ / $N_p$")
    axes.set(xticks=(0, 60, 120), yticks=(0, 0.5, 1))
