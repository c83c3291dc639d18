"""Chapter 05, the report's own filter: a film of its runs, and its walls. It goes where chapter 09 explains it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.grid import OccupancyGrid
from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording, nearest_stamp
from pfslam.run import slam_steps, used_scans
from pfslam.sensors import scan_points
from pfslam.slam import SlamConfig, Step
from pfslam_book.show.artists import COLOURS, draw_cloud, draw_map, draw_path, draw_pose, draw_scan, sheet
from pfslam_book.show.pictures import steady
from pfslam_book.show.widgets import Explorer, Slider

LATTICE_TABLE = Path(__file__).parent / "lattice.csv"
FRAMES = 14


@dataclass(frozen=True, eq=False)
class Played:
    """A run with what a film of it needs: every step, and the map at ``FRAMES`` of them (``shown``)."""

    recording: Recording
    config: SlamConfig
    infos: tuple[Step, ...]
    shown: np.ndarray
    maps: tuple[OccupancyGrid, ...]

    @property
    def trajectory(self) -> Trajectory:
        return Trajectory(np.array([i.t for i in self.infos]), np.array([i.estimate for i in self.infos]))

    @property
    def seconds(self) -> np.ndarray:
        """Time of every step since the first."""
        return self.trajectory.t - self.infos[0].t

    def off(self, k: int) -> float:
        """How far (m) the estimate of a step is from the truth."""
        return float(np.hypot(*(self.infos[k].estimate - self.recording.true_path().at(self.infos[k].t))[:2]))


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


# ---- the film


def film_explorer(runs: dict[str, Played]) -> Explorer:
    """The runs as films of ``FRAMES`` pictures: choose one and play it."""
    first = next(iter(runs.values()))
    worst = int(np.argmax([first.off(k) for k in first.shown]))
    return Explorer(
        steady(partial(draw_frame, runs)),
        [
            Slider("name", list(runs), 0, "Filter"),
            Slider("frame", list(range(1, FRAMES + 1)), worst, "Frame"),
        ],
        alt=partial(describe_frame, runs),
        title="The filter at work",
        play="frame",
    )


def draw_frame(runs: dict[str, Played], name: str, frame: int) -> Figure:
    """The building with the path, the cloud from near, and the effective number so far."""
    run = runs[name]
    figure, axes = sheet(5.2, 2, 2, width_ratios=[1.6, 1], height_ratios=[1.4, 1])
    for ax in axes[:, 0]:
        ax.remove()
    k = run.shown[frame - 1]
    whole = figure.add_subplot(axes[0, 0].get_gridspec()[:, 0])
    draw_map(whole, run.maps[frame - 1], f"{run.seconds[k]:.0f} s")
    draw_path(whole, run.trajectory.poses[: k + 1], "estimate")
    draw_pose(whole, run.infos[k].estimate, length=1.6)
    x, y = run.recording.true_path().poses[:, :2].T
    whole.set(
        xlim=(x.min() - 3.5, x.max() + 3), ylim=(y.min() - 3, y.max() + 3), facecolor=COLOURS["unknown"]
    )
    draw_near(axes[0, 1], run, frame)
    draw_n_eff(axes[1, 1], run, k)
    return figure


def draw_near(axes: Axes, run: Played, frame: int, reach: float = 0.4) -> None:
    """The particles near the estimate, with scan, map and truth."""
    info = run.infos[run.shown[frame - 1]]
    scans = run.recording.scans()
    points = scan_points(
        scans.ranges[nearest_stamp(scans.t, np.array([info.t]))[0]], run.recording.robot.lidar
    )
    draw_map(axes, run.maps[frame - 1], f"{2 * reach:g} m wide")
    draw_scan(axes, transform_points(info.estimate, points), size=8)
    draw_cloud(axes, info.particles, size=14)
    draw_pose(axes, info.estimate, length=0.35)
    axes.plot(*run.recording.true_path().at(info.t)[:2], "x", ms=11, mew=3, color=COLOURS["truth"])
    (x, y, _), none = info.estimate, {"xticks": (), "yticks": (), "xlabel": "", "ylabel": ""}
    axes.set(xlim=(x - reach, x + reach), ylim=(y - reach, y + reach), facecolor=COLOURS["unknown"], **none)


def draw_n_eff(axes: Axes, run: Played, k: int) -> None:
    """N_eff / N_p up to a step; where the cloud was resampled it rises to 1."""
    t, share = [], []
    for seconds, info in zip(run.seconds[1 : k + 1], run.infos[1 : k + 1], strict=True):
        t += [seconds] * (1 + info.resampled)
        share += [info.effective_sample_size / run.config.particles] + [1.0] * info.resampled
    axes.plot(t, share, color=COLOURS["estimate"], lw=0.7)
    axes.axhline(run.config.resample_below, color=COLOURS["highlight"], ls="--")
    axes.set(xlim=(0, run.seconds[-1]), ylim=(0, 1.08), xlabel="time [s]", ylabel="$N_{eff}$ / $N_p$")
    axes.set(xticks=(0, 60, 120), yticks=(0, 0.5, 1))


def describe_frame(runs: dict[str, Played], name: str, frame: int) -> str:
    """The same in words."""
    run = runs[name]
    k = run.shown[frame - 1]
    info = run.infos[k]
    spread = np.hypot(*info.particles.poses[:, :2].std(axis=0))
    resamplings = sum(i.resampled for i in run.infos[: k + 1])
    return f"""Filter {name}, {run.seconds[k]:.0f} s: estimate {run.off(k):.2f} m from the truth, particles spread over
    {spread:.2f} m, N_eff {info.effective_sample_size / run.config.particles:.2f} of N_p, {resamplings} resamplings
    so far."""
