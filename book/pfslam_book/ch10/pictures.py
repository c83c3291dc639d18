"""Chapter 10: the cloud over the map, what a scan says about a pose, and what happens when a robot is carried away."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.beyond.localization import (
    BEAMS,
    KnownMap,
    LocalizationConfig,
    LocalizationInfo,
    LocalizationResult,
)
from pfslam.grid import OccupancyGrid
from pfslam.poses import compose, transform_points
from pfslam.recording import Recording
from pfslam.sensors import scan_points
from pfslam_book.ch10.building import Place, distances, match_along, part
from pfslam_book.show.figures import draw_robot
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, metric_axes, new_figure
from pfslam_book.show.tables import Shown
from pfslam_book.show.widgets import Explorer, Slider

SHOWN = 1500
"""Most particles in one picture."""
STOPS = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 16.0, 20.0, 22.0, 24.0, 25.0, 26.0, 27.0, 28.0, 30.0)
"""Seconds after the first scan at which the search is shown."""
IN_CORRIDOR = 24.0
"""Seconds after the first scan of a scan in the corridor, between doorways."""
OFFSETS = ((0.0, 0.0), (0.2, 5.0), (0.5, 10.0), (1.0, 20.0), (2.0, 45.0), (5.0, 90.0))
"""Errors of a given start: metres to the side, degrees."""


def draw_known_map(axes: Axes, grid: OccupancyGrid) -> None:
    """Draw a known map: walls black, floor white, the rest grey."""
    shade = np.where(grid.occupied, 0, np.where(grid.free, 255, 205)).astype(np.uint8)
    axes.imshow(shade, cmap="gray", vmin=0, vmax=255, origin="lower", extent=grid.spec.extent)
    metric_axes(axes)


def info_at(result: LocalizationResult, seconds: float) -> LocalizationInfo:
    """Return what happened at the scan nearest to so many seconds after the first."""
    t = result.trajectory.t - result.trajectory.t[0]
    return result.infos[int(np.argmin(np.abs(t - seconds)))]


def shares(place: Place, info: LocalizationInfo) -> tuple[float, float]:
    """Return the share of the weight within a metre of the true position, and within a metre of its twin."""
    assert info.particles is not None
    truth = place.recording.true_path().at(info.t)
    away = [np.hypot(*(info.particles.poses - pose)[:, :2].T) for pose in (truth, place.twin(truth))]
    weights = info.particles.weights
    return float(weights[away[0] < 1.0].sum()), float(weights[away[1] < 1.0].sum())


def search_explorer(place: Place, result: LocalizationResult) -> Explorer:
    """Return the widget that scrubs through a search: the cloud over the map, with the robot and its twin."""
    last = float(result.trajectory.t[-1] - result.trajectory.t[0])
    stops = [s for s in STOPS if s <= last]
    slider = Slider("seconds", stops, 5, "Time", "s")

    def draw(seconds: float) -> Figure:
        return _search_frame(place, info_at(result, seconds), seconds)

    def alt(seconds: float) -> str:
        info = info_at(result, seconds)
        here, there = shares(place, info)
        return (
            f"{seconds:g} s: {info.number:,} particles; {100 * here:.0f} % of the weight near the robot, "
            f"{100 * there:.0f} % near its twin half a turn round."
        )

    title = "Lost in a building with two like halves"
    return Explorer(draw, [slider], title=title, alt=alt, play="seconds", pause=700)


def _search_frame(place: Place, info: LocalizationInfo, seconds: float) -> Figure:
    assert info.particles is not None
    figure, axes = new_figure(7.2, 3.9)
    draw_known_map(axes, place.grid)
    poses = info.particles.poses[:: max(1, info.number // SHOWN)]
    axes.plot(*poses[:, :2].T, ".", color=COLOURS["particles"], markersize=2.5, alpha=0.5)
    truth = place.recording.true_path().at(info.t)
    draw_robot(axes, place.twin(truth), "odometry", 1.4)
    draw_robot(axes, truth, "truth", 1.4)
    here, there = shares(place, info)
    axes.set_title(
        f"{seconds:g} s: {info.number:,} particles, {100 * here:.0f} % here, {100 * there:.0f} % at the twin"
    )
    axes.title.set_fontsize(11)
    return figure


# ---- two ways to judge a scan


def cast_ranges(
    grid: OccupancyGrid, pose: np.ndarray, angles: np.ndarray, longest: float = 8.0
) -> np.ndarray:
    """Follow each ray in steps of half a cell until it meets a wall: the ranges ``(B,)`` (m) that a map predicts."""
    steps = np.arange(0.0, longest, 0.5 * grid.spec.resolution)
    way = np.stack([np.cos(pose[2] + angles), np.sin(pose[2] + angles)], axis=-1)
    cells = grid.spec.world_to_cell(pose[:2] + steps[:, None, None] * way)
    cells = np.clip(cells, 0, np.array(grid.spec.shape[::-1]) - 1)
    met = grid.occupied[cells[..., 1], cells[..., 0]]
    return np.where(met.any(axis=0), steps[np.argmax(met, axis=0)], longest)


def ray_log_likelihood(known: KnownMap, pose: np.ndarray, ranges: np.ndarray, lidar) -> float:
    """Compare measured ranges with those that the map predicts along the same rays, with the field's own numbers."""
    valid = np.flatnonzero(lidar.valid(ranges))
    chosen = valid[:: max(len(valid) // BEAMS, 1)]
    sensor = transform_points(pose, np.array([lidar.position_b[:2]]))[0]
    at = np.array([*sensor, pose[2]])
    apart = ranges[chosen] - cast_ranges(known.grid, at, lidar.angles[chosen])
    near = np.exp(-0.5 * (apart / known.config.sigma) ** 2)
    share = known.config.random
    return float(known.config.effective_beams * np.log(share + (1.0 - share) * near).mean())


def likelihoods(place: Place, seconds: float, ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the log-likelihood by field and by rays of one scan from poses ahead of the true one (m)."""
    scans, lidar = place.recording.scans(), place.recording.robot.lidar
    k = int(np.searchsorted(scans.t, scans.t[0] + seconds))
    truth = place.recording.true_path().at(scans.t[k])
    offsets = np.column_stack([ahead, np.zeros_like(ahead), np.zeros_like(ahead)])
    poses = compose(truth, offsets)
    known = KnownMap.of(place.grid, LocalizationConfig())
    field = known.log_likelihood(poses, scan_points(scans.ranges[k], lidar))
    return field, np.array([ray_log_likelihood(known, pose, scans.ranges[k], lidar) for pose in poses])


def likelihood_picture(place: Place) -> Picture:
    """Draw both log-likelihoods of one scan in the corridor against a displacement of the pose along it."""
    ahead = np.linspace(-1.0, 1.0, 161)
    field, rays = likelihoods(place, IN_CORRIDOR, ahead)
    figure, axes = new_figure(6.4, 3.3)
    axes.plot(ahead, field, color=COLOURS["estimate"], label="likelihood field")
    axes.plot(ahead, rays, "--", color=COLOURS["odometry"], label="ray casting")
    axes.set(xlabel="displacement along the corridor [m]", ylabel="log-likelihood")
    axes.legend(loc="lower center")
    best = [ahead[np.argmax(values)] for values in (field, rays)]
    steps = [float(np.abs(np.diff(values)).max()) for values in (field, rays)]
    alt = (
        "Log-likelihood of one scan against a displacement along the corridor. "
        f"The field is highest at {best[0]:.2f} m "
        f"and the rays at {best[1]:.2f} m. The largest step between neighbouring poses is {steps[0]:.2f} for the field "
        f"and {steps[1]:.2f} for the rays."
    )
    return Picture(figure, alt)


# ---- numbers of particles, and the kidnapping


def numbers_picture(result: LocalizationResult) -> Picture:
    """Draw how many particles a search has and what share of the weight lies at one place, against time."""
    t = result.trajectory.t - result.trajectory.t[0]
    numbers = np.array([info.number for info in result.infos])
    share = np.array([info.share for info in result.infos])
    figure, (upper, lower) = new_figure(6.4, 4.2, 2, 1, sharex=True)
    upper.plot(t, numbers, color=COLOURS["particles"])
    upper.set(yscale="log", ylabel="particles")
    lower.plot(t, share, color=COLOURS["estimate"])
    lower.axhline(result.config.found, color=COLOURS["truth"], linestyle=":", linewidth=1.2)
    lower.set(ylim=(0, 1.05), ylabel="share at one place", xlabel="time [s]")
    few = t[np.argmax(numbers <= result.config.least)]
    alt = (
        f"Number of particles and share of the weight at one place, against time: {numbers[0]:,} particles at first, "
        f"{numbers.min():,} from {few:.0f} s on; the share passes {result.config.found:g} when the door is seen."
    )
    return Picture(figure, alt)


def kidnap_picture(
    recording: Recording, at: float, cured: LocalizationResult, lost: LocalizationResult
) -> Picture:
    """Draw the error of two searches with and without injection, and the share injected, for a robot carried away."""
    figure, (upper, lower) = new_figure(6.4, 4.4, 2, 1, sharex=True)
    for result, label, colour, style in (
        (lost, "without injection", "odometry", "--"),
        (cured, "with injection", "estimate", "-"),
    ):
        t = result.trajectory.t - result.trajectory.t[0]
        upper.plot(
            t, distances(result.trajectory, recording) + 1e-3, style, color=COLOURS[colour], label=label
        )
    upper.set(yscale="log", ylabel="error [m]")
    upper.legend(loc="center right")
    used = [info for info in cured.infos if info.used]
    times = np.array([info.t for info in used]) - cured.trajectory.t[0]
    lower.plot(times, [info.injected for info in used], color=COLOURS["estimate"])
    lower.set(ylim=(0, 1), ylabel="share injected", xlabel="time [s]")
    for axes in (upper, lower):
        axes.axvline(at, color=COLOURS["truth"], linestyle=":", linewidth=1.2)
    ends = [distances(result.trajectory, recording)[-1] for result in (cured, lost)]
    alt = (
        f"Error of the position against time for a robot that is carried away after {at:g} s: at the end "
        f"{ends[0]:.2f} m with injection and {ends[1]:.1f} m without. Below, the share of particles injected."
    )
    return Picture(figure, alt)


# ---- scan matching, the baseline that needs a start


def start_table(place: Place, seconds: float = 8.0) -> Shown:
    """Return where scan matching ends from starts that are wrong by more and more, and from the twin."""
    recording = part(place.recording, 0.0, seconds)
    truth = recording.true_path().at(recording.scans().t[0])
    rows = []
    for metres, degrees in OFFSETS:
        start = compose(truth, np.array([0.0, metres, np.deg2rad(degrees)]))
        rows.append((f"{metres:g} m, {degrees:g} deg", f"{_end(place, recording, start):.2f}"))
    rows.append(("the twin", f"{_end(place, recording, place.twin(truth)):.2f}"))
    return Shown(("start is wrong by", "error at the end [m]"), rows)


def _end(place: Place, recording: Recording, start: np.ndarray) -> float:
    return float(distances(match_along(place.grid, recording, start), recording)[-1])
