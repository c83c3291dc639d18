"""Chapter 02, one scan: its beams, the cells they cross and hit, and the ways to count them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Rectangle

from pfslam.grid import LOG_4, GridSpec, free_cells, probability, trace_rays
from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording
from pfslam.sensors import scan_points
from pfslam_book.show.figures import draw_robot
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, metric_axes, new_figure

CELL = 0.05


@dataclass(frozen=True, eq=False)
class Placed:
    """One scan in the world: end points ``(M, 2)`` m, their beam numbers ``(M,)``, the LiDAR ``(2,)``, the pose."""

    points: np.ndarray
    beams: np.ndarray
    sensor: np.ndarray
    pose: np.ndarray

    def spec(self, resolution: float = CELL) -> GridSpec:
        """Return a grid that holds the scan."""
        return GridSpec.around(np.vstack([self.points, self.sensor]), resolution, margin=0.2)


def placed(recording: Recording, trajectory: Trajectory, index: int) -> Placed:
    """Return scan number ``index``, drawn from where the trajectory says."""
    scans, lidar = recording.scans(), recording.robot.lidar
    pose, ranges = trajectory.at(scans.t[index]), scans.ranges[index]
    points = transform_points(pose, scan_points(ranges, lidar))
    sensor = transform_points(pose, np.array([lidar.position_b[:2]]))[0]
    return Placed(points, np.flatnonzero(lidar.valid(ranges)), sensor, pose)


def scan_after(recording: Recording, trajectory: Trajectory, seconds: float) -> Placed:
    """Return the first scan at least so many seconds after the first scan of all."""
    t = recording.scans().t
    return placed(recording, trajectory, int(np.searchsorted(t, t[0] + seconds)))


# ---- the question, and a beam by hand


def question_picture(scan: Placed) -> Picture:
    """Draw a scan from above: every tenth beam as a line, every end point as a dot."""
    figure, axes = new_figure(5.0, 4.3)
    for x, y in scan.points[::10]:
        axes.plot([scan.sensor[0], x], [scan.sensor[1], y], color=COLOURS["free"], linewidth=0.7, alpha=0.7)
    axes.scatter(*scan.points.T, s=6, color=COLOURS["hits"], linewidths=0, zorder=3)
    draw_robot(axes, scan.pose, length=0.9)
    metric_axes(axes)
    reach = np.hypot(*(scan.points - scan.sensor).T)
    alt = f"""One scan from above: {len(scan.points)} end points on the walls around the robot, {reach.min():.1f} to
    {reach.max():.1f} m away, and a line for every tenth beam. Behind the robot a wedge of 90 degrees is empty."""
    return Picture(figure, alt)


def crossed(start, end, samples: int = 2000) -> set[tuple[int, int]]:
    """Find the cells ``(ix, iy)`` that the line between the middles of two cells runs through, by sampling it."""
    along = np.linspace(0.0, 1.0, samples)[:, None]
    cells = np.floor(np.array(start) + 0.5 + along * np.subtract(end, start)).astype(int)
    return {(int(ix), int(iy)) for ix, iy in cells}


def ray_picture(start=(0, 0), end=(7, 3)) -> Picture:
    """Draw the cells of one beam on squared paper: Bresenham's, the one that is hit, and those that it leaves out."""
    cells = trace_rays(np.array(start), np.array([end]))
    left_out = sorted(crossed(start, end) - {tuple(cell) for cell in cells.tolist()} - {end})
    figure, axes = new_figure(5.0, 3.1)
    image = np.ones((5, 9, 3)) * to_rgb(COLOURS["unknown"])
    image[cells[:, 1], cells[:, 0]] = 1.0
    image[end[1], end[0]] = to_rgb(COLOURS["hits"])
    axes.imshow(image, origin="lower")
    for ix, iy in left_out:
        axes.add_patch(
            Rectangle((ix - 0.5, iy - 0.5), 1, 1, fill=False, hatch="//", edgecolor=COLOURS["highlight"])
        )
    axes.plot(*np.array([start, end]).T, color=COLOURS["free"], marker="o")
    axes.set(xticks=range(9), yticks=range(5), xlabel="ix", ylabel="iy")
    axes.grid(False)
    axes.set_xticks(np.arange(-0.5, 9), minor=True)
    axes.set_yticks(np.arange(-0.5, 5), minor=True)
    axes.grid(True, which="minor", color="white", linewidth=1.5)
    axes.tick_params(which="minor", length=0)
    path, others = (", ".join(f"({ix}, {iy})" for ix, iy in group) for group in (cells, left_out))
    alt = f"""A beam from cell {start} to cell {end}. Bresenham's line takes the cells {path}; the hit is in {end}. The
    beam also runs through the hatched cells {others}."""
    return Picture(figure, alt)


def logistic_picture() -> Picture:
    """Draw probability against log-odds, with the five values that hits, free beams and the clamp allow."""
    figure, axes = new_figure(5.0, 3.2)
    axis = np.linspace(-6, 6, 200)
    axes.plot(axis, probability(axis), color=COLOURS["estimate"])
    marks = LOG_4 * np.arange(-2, 3)
    axes.scatter(marks, probability(marks), color=COLOURS["hits"], zorder=3)
    for edge in marks[[0, -1]]:
        axes.axvline(edge, color=COLOURS["truth"], linestyle=":")
    axes.set(
        xlabel=r"log-odds $\lambda$",
        ylabel=r"probability $\gamma$",
        ylim=(0, 1),
        yticks=(0, 0.2, 0.5, 0.8, 1),
    )
    values = ", ".join(f"{g:.2f}" for g in probability(marks))
    alt = f"""The S-shaped curve from log-odds to probability. At -2, -1, 0, 1 and 2 times log 4 it gives {values}.
    Dotted: the report's clamp."""
    return Picture(figure, alt)


# ---- rays against the polygon


def cleared(scan: Placed, rays: str) -> np.ndarray:
    """Return cells ``(H, W)`` bool of the scan's own grid that it saw through; "bresenham" or "polygon"."""
    spec = scan.spec()
    mask, rectangle = free_cells(spec, scan.points, scan.beams, scan.sensor, rays)
    whole = np.zeros(spec.shape, dtype=bool)
    whole[rectangle] = mask
    whole[tuple(spec.world_to_cell(scan.points).T[::-1])] = False
    return whole


def rays_picture(scan: Placed) -> Picture:
    """Draw what both ways clear, and what the polygon adds."""
    traced, filled = cleared(scan, "bresenham"), cleared(scan, "polygon")
    image = np.ones((*traced.shape, 3)) * to_rgb(COLOURS["unknown"])
    image[traced] = 1.0
    image[filled & ~traced] = to_rgb(COLOURS["highlight"])
    image[tuple(scan.spec().world_to_cell(scan.points).T[::-1])] = to_rgb(COLOURS["hits"])
    figure, axes = new_figure(5.0, 4.5)
    axes.imshow(image, origin="lower", extent=scan.spec().extent)
    draw_robot(axes, scan.pose, length=0.9)
    metric_axes(axes)
    extra = np.count_nonzero(filled & ~traced)
    alt = f"""One scan as cells. White: crossed by a beam, {np.count_nonzero(traced)} cells. Orange: {extra} cells more
    that the filled outline clears, slits between far beams. Purple: cells with an end point. Grey: nothing is said."""
    return Picture(figure, alt)


# ---- how often a cell is counted


def crossings(scan: Placed) -> np.ndarray:
    """Return how many beams of the scan cross each cell ``(H, W)``."""
    spec = scan.spec()
    ix, iy = trace_rays(spec.world_to_cell(scan.sensor), spec.world_to_cell(scan.points)).T
    count = np.zeros(spec.shape, dtype=int)
    np.add.at(count, (iy, ix), 1)
    return count


def crossings_at(scan: Placed, metres: float) -> float:
    """Return the mean number of beams through a crossed cell so far from the LiDAR, within 10 cm."""
    count, spec = crossings(scan), scan.spec()
    iy, ix = np.nonzero(count)
    away = np.hypot(*(spec.cell_to_world(np.column_stack([ix, iy])) - scan.sensor).T)
    return float(count[iy, ix][np.abs(away - metres) <= 0.1].mean())


def crossings_picture(
    scan: Placed, distances: Iterable[float] = (0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0)
) -> Picture:
    """Draw beams through a cell against its distance: what "once per beam" would count."""
    distances = tuple(distances)
    mean = [crossings_at(scan, metres) for metres in distances]
    figure, axes = new_figure(5.0, 3.1)
    axes.plot(distances, mean, color=COLOURS["free"], marker="o", label="once per beam")
    axes.plot(distances, np.ones(len(mean)), color=COLOURS["estimate"], marker="s", label="once per scan")
    axes.set(xlabel="distance from the LiDAR [m]", ylabel="counted", yscale="log", xlim=(0, None))
    axes.set_yticks([1, 10, 100], ["1", "10", "100"])
    axes.legend()
    words = ", ".join(f"{n:.0f} at {metres:g} m" for metres, n in zip(distances, mean, strict=True))
    return Picture(
        figure, f"How often one scan counts a free cell if every beam counts: {words}. Once per scan: 1."
    )


RULES = ("hits win, once per scan", "sum over the beams", "the last beam wins")


def one_scan(scan: Placed, rule: str) -> np.ndarray:
    """Return log-odds ``(H, W)`` after this scan on an empty map, without a clamp, by one of ``RULES``."""
    spec = scan.spec()
    start, ends = spec.world_to_cell(scan.sensor), spec.world_to_cell(scan.points)
    grid, hit = np.zeros(spec.shape), (ends[:, 1], ends[:, 0])
    if rule == RULES[0]:
        grid[crossings(scan) > 0] = -LOG_4
        grid[hit] = LOG_4
    elif rule == RULES[1]:
        grid -= LOG_4 * crossings(scan)
        np.add.at(grid, hit, LOG_4)
    else:
        for end in ends:
            ix, iy = trace_rays(start, end[None]).T
            grid[iy, ix] = -LOG_4
            grid[end[1], end[0]] = LOG_4
    return grid


def walls_left(scan: Placed, rule: str) -> float:
    """Tell which share of the cells that hold an end point are occupied after the scan."""
    hit = scan.spec().world_to_cell(scan.points)
    cells = np.unique(hit, axis=0)
    return float(np.mean(one_scan(scan, rule)[cells[:, 1], cells[:, 0]] > 0))


def rules_picture(scan: Placed, window: tuple[float, float, float, float]) -> Picture:
    """Draw the same scan written by the three rules; ``window`` is x_min, x_max, y_min, y_max."""
    figure, axes = new_figure(5.0, 4.6, 1, 3, sharey=True)
    words = []
    for ax, rule in zip(axes, RULES, strict=True):
        share = walls_left(scan, rule)
        draw_log_odds(ax, one_scan(scan, rule), scan.spec(), clamp=LOG_4)
        ax.set(xlim=window[:2], ylim=window[2:], title=fill(rule, 12))
        words.append(f"{rule}: {100 * share:.0f} %")
    for ax in axes[1:]:
        ax.set_ylabel("")
    alt = (
        f"One scan written by three rules. Share of its wall cells that end up occupied: {'; '.join(words)}."
    )
    return Picture(figure, alt)


def draw_log_odds(axes: Axes, log_odds: np.ndarray, spec: GridSpec, clamp: float = 2 * LOG_4) -> Axes:
    """Draw log-odds in grey: white is free, the grey of "unknown" is zero, black is occupied; steps stay visible."""
    part = np.clip(log_odds / clamp, -1, 1)[..., None]
    unknown, black = np.array(to_rgb(COLOURS["unknown"])), np.array(to_rgb(COLOURS["truth"]))
    image = np.where(part > 0, unknown + (black - unknown) * part, unknown - (1.0 - unknown) * part)
    axes.imshow(image, origin="lower", extent=spec.extent, interpolation="nearest")
    return metric_axes(axes)
