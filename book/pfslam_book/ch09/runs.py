"""Chapter 09: short live runs, one for each stop of the ladder, and what the grid does to a heading."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from pfslam.correlation import score_field
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec, OccupancyGrid, integrate_scan
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording
from pfslam.refined.lines import HitMoments, LineConfig, align_to_lines, nearby_lines
from pfslam.refined.search.matching import SearchConfig
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam.study.disturbances import first_seconds
from pfslam_book.show.checks import Check, attempt, is_unanswered, unanswered
from pfslam_book.show.figures import draw_map, draw_trajectory, map_along
from pfslam_book.show.pictures import Picture, steady
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.tables import Shown
from pfslam_book.show.widgets import Explorer, Slider

SECONDS, EVERY, PARTICLES = 65.0, 20, 20
"""Of each live run: the first minute of the drive, at every twentieth scan."""


@dataclass(frozen=True, eq=False)
class Rung:
    """One live run: its map, and its path."""

    grid: OccupancyGrid
    path: Trajectory


def rung_configs() -> dict[str, SlamConfig]:
    """Return five stops between the report's filter and the refined one; each keeps the changes of those before it."""
    report, best = SlamConfig.report(), SlamConfig.refined()
    gentle = replace(report, map=best.map)
    field = SearchConfig(field="distance", weight="likelihood")
    weights = replace(gentle, search=field, estimate="mean", resample_below=0.5)
    no_polish = replace(best, lines=None)
    return {
        "report": report,
        "clearing and clamp": gentle,
        "field, likelihood, mean": weights,
        "prior, sub-cell, noise": no_polish,
        "polish": best,
    }


def live_rungs(recording: Recording) -> dict[str, Rung]:
    """Return dead reckoning and the five stops, on the first minute."""
    start = first_seconds(recording, SECONDS)
    rungs = {}
    for name, config in rung_configs().items():
        small = replace(config, particles=PARTICLES, every=EVERY)
        result = run_slam(start, small, keep_particles=False)
        rungs[name] = Rung(result.grid, result.trajectory)
    t, odometry = rungs["report"].path.t, dead_reckoning(start)
    path = Trajectory(t, odometry.at(t))
    return {"dead reckoning": Rung(map_along(start, path, every=EVERY), path)} | rungs


def rungs_explorer(recording: Recording, rungs: dict[str, Rung]) -> Explorer:
    """Return the widget of the ladder: choose a stop, see its map and path, and its error over time."""
    stops = Slider("rung", list(rungs), 1, "Stop")
    draw, alt = rung_frame(recording, rungs), rung_alt(recording, rungs)
    return Explorer(draw, [stops], title="Map and error, stop by stop", alt=alt, play="rung", pause=1200)


def rung_frame(recording: Recording, rungs: dict[str, Rung]) -> Callable[..., Figure]:
    """Return the drawing function of the ladder's widget: map and path of one stop, and its error over time."""

    def draw(rung: str) -> Figure:
        run = rungs[rung]
        figure, (left, right) = new_figure(6.4, 4.2, columns=2, width_ratios=[1.15, 1])
        draw_map(left, run.grid, rung)
        draw_trajectory(left, run.path, "odometry" if rung == "dead reckoning" else "estimate", "path")
        draw_trajectory(left, Trajectory(run.path.t, recording.true_path().at(run.path.t)), "truth")
        _same_window(left, recording, run.path.t)
        left.legend(loc="upper left", fontsize=10)
        for name, other in rungs.items():
            seconds, away = other.path.t - other.path.t[0], _distance(recording, other.path)
            own = COLOURS["odometry" if name == "dead reckoning" else "estimate"]
            chosen = name == rung
            right.plot(seconds, away, color=own if chosen else COLOURS["unknown"], zorder=3 if chosen else 1)
        right.set(yscale="log", ylim=(0.0005, 3), xlabel="time [s]", title="off the truth by [cm]")
        right.set_yticks([0.001, 0.01, 0.1, 1], ["0.1", "1", "10", "100"])
        right.set_yticks([0.002, 0.005, 0.02, 0.05, 0.2, 0.5], minor=True)  # few: each tick takes its time
        return figure

    return steady(draw)


def _same_window(axes, recording: Recording, t: np.ndarray) -> None:
    x, y = recording.true_path().at(t)[:, :2].T
    axes.set(xlim=(x.min() - 2.5, x.max() + 2.5), ylim=(y.min() - 2.5, y.max() + 2.5))
    axes.set_facecolor(COLOURS["unknown"])


def _distance(recording: Recording, path: Trajectory) -> np.ndarray:
    away = path.poses[:, :2] - recording.true_path().at(path.t)[:, :2]
    return np.maximum(np.hypot(*away.T), 5e-4)


def rung_alt(recording: Recording, rungs: dict[str, Rung]) -> Callable[..., str]:
    """Return the words for a stop of the ladder."""

    def alt(rung: str) -> str:
        error = trajectory_error(rungs[rung].path, recording.true_path())
        return f"""{rung}: map and path of the first minute beside the truth. The path is off by
        {100 * error.ate_rmse_m:.1f} cm (root mean square), at most {100 * error.ate_max_m:.1f} cm. Grey lines:
        the errors of the other stops over time."""

    return alt


# ---- grid lock


LOCK_SPEC = GridSpec((-8.0, -4.0), 0.05, (160, 320))
BEAMS = np.deg2rad(np.linspace(-135.0, 135.0, 541))


def corridor_scan(tilt: float, walls: np.ndarray, rng: np.random.Generator, reach: float = 4.0) -> tuple:
    """Return end points ``(M, 2)`` and beams of a scan between two walls, turned by ``tilt`` rad; 1 cm of noise.

    ``walls`` are the distances (m) to the left and to the right.
    """
    slope = np.sin(BEAMS - tilt)
    slope = np.where(np.abs(slope) < 1e-6, 1e-6, slope)
    ranges = np.where(slope > 0, walls[0], -walls[1]) / slope
    seen = ranges < reach
    r = ranges[seen] + 0.01 * rng.standard_normal(np.count_nonzero(seen))
    return np.column_stack([r * np.cos(BEAMS[seen]), r * np.sin(BEAMS[seen])]), np.flatnonzero(seen)


@dataclass(frozen=True, eq=False)
class PolishCase:
    """A robot at the origin in a corridor, with the lines of the map it drew there, and a pose that is a little off."""

    points_b: np.ndarray
    moments: HitMoments
    pose: np.ndarray

    @classmethod
    def make(cls, tilt: float = 0.03, seed: int = 0) -> PolishCase:
        """Return a corner of two walls at right angles, turned by ``tilt`` rad against the grid."""
        rng, moments = np.random.default_rng(seed), HitMoments(LOCK_SPEC)
        scans = [corner_scan(tilt, rng) for _ in range(4)]
        for points in scans[:3]:
            moments.add(points)
        return cls(scans[3], moments, np.array([0.03, -0.04, 0.01]))

    def lines(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the arms ``(M, 2)`` to the end points, and the centres and normals ``(M, 2)`` of their lines."""
        arms = transform_points([0.0, 0.0, pose[2]], self.points_b)
        lines = nearby_lines(self.moments, arms + pose[:2], LineConfig())
        return arms[lines.found], lines.centre[lines.found], lines.normal[lines.found]


def repeat_step(step: Callable, case: PolishCase, times: int = 4) -> Shown | Check:
    """Return how far off the pose of a case is after each repetition of a reader's step of the polish."""
    pose, rows = case.pose.copy(), []
    for k in range(times):
        arms, centres, normals = case.lines(pose)
        answer = attempt(step, arms, pose[:2], centres, normals)
        if is_unanswered(answer):
            return unanswered()
        if isinstance(answer, Check):
            return answer
        pose = pose + np.asarray(answer, dtype=float)
        rows.append((str(k + 1), f"{100 * np.hypot(*pose[:2]):.2f}", f"{np.rad2deg(pose[2]):+.2f}"))
    return Shown(("step", "off by [cm]", "and by [deg]"), rows)


def corner_scan(tilt: float, rng: np.random.Generator) -> np.ndarray:
    """Return end points ``(M, 2)`` on a wall to the left and one ahead, with 1 cm of noise."""
    along = np.linspace(-1.5, 1.5, 121)
    left = np.column_stack([along, 1.2 + 0.01 * rng.standard_normal(len(along))])
    ahead = np.column_stack([2.1 + 0.01 * rng.standard_normal(len(along)), along - 0.3])
    return transform_points([0.0, 0.0, tilt], np.concatenate([left, ahead]))


def heading_errors(tilt: float, rng: np.random.Generator) -> tuple[float, float]:
    """A robot stands at the origin and maps a corridor from its true pose; then it asks the map for its heading.

    Returns the answers (rad) of the best score over a fine sweep, and of the polish. The truth is 0.
    """
    walls = 0.9 + 0.1 * rng.random(2)
    grid, moments = OccupancyGrid.empty(LOCK_SPEC), HitMoments(LOCK_SPEC)
    for _ in range(3):
        points, beams = corridor_scan(tilt, walls, rng)
        integrate_scan(grid, points, beams, np.zeros(2), SlamConfig.refined().map)
        moments.add(points)
    field, (points, _) = score_field(grid.occupied, "distance").values, corridor_scan(tilt, walls, rng)
    yaws = np.deg2rad(np.linspace(-1.0, 1.0, 51))
    cells = [LOCK_SPEC.world_to_cell(transform_points(np.array([0.0, 0.0, yaw]), points)) for yaw in yaws]
    best = float(yaws[np.argmax([field[c[:, 1], c[:, 0]].sum() for c in cells])])
    polished = align_to_lines(moments, points, np.array([0.0, 0.0, best]), np.zeros(3), LineConfig())
    return best, float(polished.pose[2])


TILTS_DEG = np.array([-0.5, -0.4, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.4, 0.5])
"""Angles between wall and grid (deg) at which the heading is asked for."""


def grid_lock(tilts_deg: np.ndarray = TILTS_DEG, repeats: int = 4) -> np.ndarray:
    """Return heading errors in degrees ``(tilts, repeats, 2)``: of the grid, and after the polish."""
    rng = np.random.default_rng(0)
    found = [[heading_errors(np.deg2rad(t), rng) for _ in range(repeats)] for t in tilts_deg]
    return np.rad2deg(np.array(found))


def grid_lock_picture(errors: np.ndarray, tilts_deg: np.ndarray = TILTS_DEG) -> Picture:
    """Draw heading errors against the angle between wall and grid."""
    figure, axes = new_figure(6.2, 3.2)
    for k, (name, colour) in enumerate(
        (("best score on the grid", "hits"), ("after the polish", "estimate"))
    ):
        x = np.repeat(tilts_deg, errors.shape[1]) + 0.012 * (2 * k - 1)
        axes.scatter(
            x, errors[:, :, k].ravel(), s=28, color=COLOURS[colour], alpha=0.8, linewidths=0, label=name
        )
    axes.axhline(0.0, color=COLOURS["truth"], linestyle=":")
    axes.set(xlabel="angle between wall and grid [deg]", ylabel="heading error [deg]")
    axes.legend(loc="upper right", fontsize=10)
    worst = np.abs(errors).max(axis=(0, 1))
    alt = f"""Heading that the map of a corridor suggests, for walls turned by {tilts_deg[0]:.1f} to
    {tilts_deg[-1]:.1f} degrees against the grid. The best score is off by up to {worst[0]:.2f} degrees, after the
    polish by at most {worst[1]:.2f}."""
    return Picture(figure, alt)


def polish_picture(case: PolishCase) -> Picture:
    """Draw some end points before the polish, the pieces of wall near them, and their distances."""
    arms, centres, normals = case.lines(case.pose)
    points = arms + case.pose[:2]
    figure, axes = new_figure(6.2, 3.8)
    some = (np.abs(points[:, 0]) < 0.42) & (points[:, 1] > 0.9)
    along = np.column_stack([normals[:, 1], -normals[:, 0]])
    for k in np.flatnonzero(some)[::3]:
        ends = centres[k] + np.outer([-0.07, 0.07], along[k])
        axes.plot(*ends.T, color=COLOURS["estimate"], linewidth=2.0)
        foot = points[k] - normals[k] * (normals[k] @ (points[k] - centres[k]))
        axes.plot(*np.array([points[k], foot]).T, color=COLOURS["highlight"], linewidth=1.4)
        axes.plot(*points[k], "o", color=COLOURS["hits"], markersize=5)
    axes.set_xticks(np.arange(-0.4, 0.41, 0.05), minor=True)
    axes.set_yticks(np.arange(1.0, 1.36, 0.05), minor=True)
    axes.grid(True, which="both")
    axes.set(xlabel="x [m]", ylabel="y [m]", ylim=(1.1, 1.25))
    residual = np.sum(normals * (points - centres), axis=1)
    alt = f"""A wall turned by 1.7 degrees against the grid. Blue: the short pieces of wall that the hits of 3 x 3 cells
    form. Dots: end points of a scan from a pose that is a little off. Orange: their distances from the lines, which
    the polish makes small; {100 * np.abs(residual[some]).mean():.1f} cm in the mean."""
    return Picture(figure, alt)
