"""Chapter 09: kinds of SLAM in one table, one particle beside two hundred, and the histories of private maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import OccupancyGrid
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.refined.lines import LineConfig
from pfslam.run import run_slam, slam_steps, used_scans
from pfslam.simulator import HALL, simulate
from pfslam.slam import SlamConfig
from pfslam.study.disturbances import first_seconds
from pfslam_book.show.figures import draw_map, draw_trajectory
from pfslam_book.show.pictures import steady
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.tables import Shown, errors_by_label, read_table, select
from pfslam_book.show.widgets import Explorer, Slider

FRAMES = 20
NO_POLISH = ", and no polish"
BUILDINGS, RINGS, MOVING = "ch09_kinds", "ch09_ring", "ch09_hard_kinds"
PLACES = {"buildings": BUILDINGS, "rings": RINGS, "the world moves": MOVING}
PRIVATE, SHARED = "a map for each particle", "shared map"
KINDS = ("dead reckoning", "scan matching", SHARED, PRIVATE)


def kind_errors(study: str, polish: bool) -> dict[str, np.ndarray]:
    """Return the error (m) of each kind in every building of a study, always in the same order of buildings."""
    found = errors_by_label(read_table(study))
    return {
        label.removesuffix(NO_POLISH): errors
        for label, errors in found.items()
        if label.endswith(NO_POLISH) != polish
    }


def kinds_table() -> Shown:
    """Return the median and worst error of each kind: in buildings, round rings and where the world moves."""
    rows: list[tuple[str, ...]] = []
    for place, study in PLACES.items():
        bare = kind_errors(study, True)["dead reckoning"]
        for polish, name in ((True, place), (False, f"{place}, no polish")):
            errors = kind_errors(study, polish) | {"dead reckoning": bare}
            cells = (f"{100 * np.median(errors[k]):.1f} ({100 * errors[k].max():.1f})" for k in KINDS)
            rows.append((name, str(len(bare)), *cells))
    return Shown(("median (worst) [cm]", "drives", *KINDS), rows)


def medians_cm(places: str, polish: bool, first: int | None = None) -> dict[str, float]:
    """Return the median error (cm) of each kind in one of ``PLACES``, over all of its drives or the ``first`` few."""
    errors = kind_errors(PLACES[places], polish)
    return {label: 100 * float(np.median(e[:first])) for label, e in errors.items()}


def private_better(places: str, polish: bool) -> str:
    """Return in how many drives of one of ``PLACES`` private maps have a smaller error than a shared map, in words."""
    errors = kind_errors(PLACES[places], polish)
    return f"{np.count_nonzero(errors[PRIVATE] < errors[SHARED])} of {len(errors[SHARED])}"


def cost_ratio(one: str = PRIVATE, other: str = SHARED) -> float:
    """Return how many times the processor time of another kind one kind needs, both with the polish."""
    table = read_table(BUILDINGS)
    seconds = [np.median(select(table, label=label)["cpu_seconds"]) for label in (one, other)]
    return float(seconds[0] / seconds[1])


# ---- one particle and two hundred


def one_and_many(recording: Recording, seconds: float = 40.0, every: int = 20) -> Shown:
    """Return the errors (mm) of one and of two hundred particles, and how far their maps' poses lie apart at most."""
    part, rows = first_seconds(recording, seconds), []
    for name, polish in (("no polish", None), ("polish", LineConfig())):
        paths = []
        for particles in (1, 200):
            config = replace(SlamConfig.refined(), particles=particles, every=every, lines=polish)
            result = run_slam(part, config, rng=np.random.default_rng(0), keep_particles=False)
            paths.append(result.trajectory)
        errors = [trajectory_error(path, recording.true_path()).ate_rmse_m for path in paths]
        apart = np.hypot(*(paths[0].poses - paths[1].poses)[:, :2].T).max()
        rows.append((name, *(f"{1000 * value:.2f}" for value in (*errors, apart))))
    return Shown(("error [mm]", "1 particle", "200 particles", "greatest distance between the two"), rows)


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
        """Return indices ``(k + 1, N)``: through which particle of each step the N histories alive at step k came."""
        index = np.empty((k + 1, self.clouds.shape[1]), dtype=int)
        index[k] = np.arange(self.clouds.shape[1])
        for step in range(k, 0, -1):
            index[step - 1] = self.ancestors[step - 1][index[step]]
        return index

    def paths(self, k: int) -> np.ndarray:
        """Return poses ``(k + 1, N, 3)`` of the histories alive at step k."""
        return self.clouds[np.arange(k + 1)[:, None], self.lineages(k)]

    def alive(self, k: int) -> np.ndarray:
        """Return how many different particles of each step ``(k + 1,)`` the histories alive at step k came through."""
        return np.array([len(np.unique(row)) for row in self.lineages(k)])

    def away(self, poses: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Return distance (m) of poses ``(T, N, 3)`` from the truth at the given steps ``(T,)``."""
        truth = self.recording.true_path().at(self.t[steps])
        return np.hypot(*(poses - truth[:, None])[..., :2].T).T


def loop_recording() -> Recording:
    """Return a drive round a ring of corridors."""
    return simulate(replace(HALL, name="loop", layout="loop")).recording


def play_histories(recording: Recording, particles: int = 10, every: int = 40, seed: int = 0) -> Histories:
    """Run the filter with a map per particle, without the polish, and keep who descends from whom."""
    config = replace(SlamConfig.per_particle(), particles=particles, every=every, lines=None)
    shown = np.linspace(0, len(used_scans(recording, config)) - 1, FRAMES + 1).astype(int)[1:]
    t, clouds, ancestors, maps = [], [], [], []
    for k, (state, info) in enumerate(slam_steps(recording, config, np.random.default_rng(seed))):
        assert info.particles is not None  # kept by every step; only run_slam drops it on demand
        t.append(info.t)
        clouds.append(info.particles.poses)
        same = (state.particles.poses[:, None] == info.particles.poses[None]).all(axis=2)
        # Where nobody was resampled everyone goes on as himself, equal poses or not.
        ancestors.append(same.argmax(axis=1) if info.resampled else np.arange(particles))
        maps += [state.grid.copy()] * np.count_nonzero(shown == k)
    return Histories(recording, np.array(t), np.array(clouds), np.array(ancestors), shown, tuple(maps))


def histories_explorer(run: Histories) -> Explorer:
    """Return the widget that plays a run with a map for each particle."""
    frames = Slider("frame", list(range(1, FRAMES + 1)), FRAMES - 1, "Frame")
    draw, alt = histories_frame(run), histories_alt(run)
    return Explorer(draw, [frames], title="Private maps, shared ancestors", alt=alt, play="frame")


def histories_frame(run: Histories) -> Callable[..., Figure]:
    """Return the drawing function of the player: paths on the heaviest particle's map, and errors as a family tree."""
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
    """Return the words for a frame of the player."""

    def alt(frame: int) -> str:
        k = run.shown[frame - 1]
        n, alive = run.clouds.shape[1], run.alive(k)
        away = 100 * run.away(run.clouds[k][None], np.array([k]))[0]
        return f"""After {run.t[k] - run.t[0]:.0f} s the {n} histories stand {away.min():.0f} to {away.max():.0f} cm off
        the truth. Half way back in time they came through {alive[k // 2]} of the {n} particles of that moment, at the
        second scan through {alive[min(1, k)]}."""

    return alt
