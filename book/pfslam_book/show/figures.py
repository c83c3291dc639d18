"""Drawings that more than one chapter needs; the map along a given path comes from the command line's figures.

Every function draws on axes that it is given. Maps are drawn with ``origin="lower"`` in metres.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure

from pfslam.cli.figures import map_along as map_along
from pfslam.grid import OccupancyGrid
from pfslam.particles import Particles
from pfslam.poses import Trajectory
from pfslam_book.show.style import COLOURS, LINE_STYLES, metric_axes, new_figure


def draw_map(axes: Axes, grid: OccupancyGrid, title: str = "") -> Axes:
    """The map as a grey picture: black occupied, white free, grey unknown; cut to what has been seen."""
    known = grid.log_odds != 0
    seen_y, seen_x = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    low, high = (seen_x[0], seen_y[0]), (seen_x[-1] + 1, seen_y[-1] + 1)
    x, y, r = *grid.spec.origin, grid.spec.resolution
    shown = grid.log_odds[low[1] : high[1], low[0] : high[0]]
    # Colours by sign: 0, 1, and -1, which is the last. As bytes with opacity they are drawn fastest.
    shades = np.rint(255 * to_rgba_array([COLOURS["unknown"], COLOURS["truth"], "white"])).astype(np.uint8)
    image = shades[np.sign(shown).astype(int)]
    extent = (x + low[0] * r, x + high[0] * r, y + low[1] * r, y + high[1] * r)
    axes.imshow(image, origin="lower", extent=extent, interpolation="nearest")
    return metric_axes(axes, title)


def draw_trajectory(axes: Axes, trajectory: Trajectory, kind: str, label: str | None = None) -> None:
    """A path in the colour and line style of its kind: "truth", "odometry" or "estimate"."""
    x, y = trajectory.poses[:, :2].T
    axes.plot(x, y, color=COLOURS[kind], linestyle=LINE_STYLES[kind], label=label or kind)


def draw_particles(
    axes: Axes, particles: Particles, size: float = 10.0, label: str | None = "particles"
) -> None:
    """The cloud as points; the heavier a particle, the more opaque."""
    alpha = 0.25 + 0.75 * particles.weights / particles.weights.max()
    x, y = particles.poses[:, :2].T
    axes.scatter(x, y, s=size, color=COLOURS["particles"], alpha=alpha, linewidths=0, label=label, zorder=3)


def draw_robot(axes: Axes, pose: np.ndarray, kind: str = "estimate", length: float = 0.6) -> None:
    """The robot as an arrow of ``length`` metres along its heading."""
    x, y, theta = pose
    tip = (x + length * np.cos(theta), y + length * np.sin(theta))
    arrow = {"arrowstyle": "-|>", "color": COLOURS[kind], "linewidth": 2.0, "mutation_scale": 14}
    axes.annotate("", xy=tip, xytext=(x, y), arrowprops=arrow, zorder=4)


def draw_scan(axes: Axes, points: np.ndarray, size: float = 4.0, label: str | None = "scan") -> None:
    """End points ``(M, 2)`` of a scan."""
    axes.scatter(
        points[:, 0], points[:, 1], s=size, color=COLOURS["hits"], linewidths=0, label=label, zorder=3
    )


def map_figure(grid: OccupancyGrid, title: str, trajectory: Trajectory | None = None) -> Figure:
    """A map, with a path on it if one is given."""
    figure, axes = new_figure(6.8, 6.4)
    draw_map(axes, grid, title)
    if trajectory is not None:
        draw_trajectory(axes, trajectory, "estimate")
        axes.legend()
    return figure
