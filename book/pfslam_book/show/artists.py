"""The handful of artists with which the chapters draw, on plain Matplotlib axes: one thing has one colour.

>>> from pfslam_book.show.artists import draw_path, draw_pose, plan, sheet, show
>>> figure, axes = sheet(4.0)
>>> draw_path(axes, [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]], "truth")
>>> draw_pose(axes, (2.0, 1.0, 1.57))
>>> plan(axes).legend()  # doctest: +ELLIPSIS
<matplotlib.legend.Legend object at ...>
>>> show(figure, "A path of two straight pieces, and the robot at its end.")
[picture: A path of two straight pieces, and the robot at its end.]
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba_array
from numpy.typing import ArrayLike

from pfslam.grid import OccupancyGrid
from pfslam.particles import Particles
from pfslam.poses import Trajectory
from pfslam_book.show.pictures import Picture as show
from pfslam_book.show.style import COLOURS, LINE_STYLES, sheet
from pfslam_book.show.style import metric_axes as plan

__all__ = ["COLOURS", "draw_beams", "draw_cloud", "draw_map", "draw_path", "draw_pose", "draw_scan"]
__all__ += ["plan", "sheet", "show"]


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
    return plan(axes, title)


def draw_path(
    axes: Axes, path: Trajectory | ArrayLike, kind: str = "estimate", label: str | None = None
) -> None:
    """A trajectory, or poses or points ``(K, 2 or 3)``, in colour and line of its kind: a name of ``COLOURS``."""
    x, y = np.asarray(path.poses if isinstance(path, Trajectory) else path)[:, :2].T
    axes.plot(x, y, color=COLOURS[kind], linestyle=LINE_STYLES.get(kind, "-"), label=label or kind)


def draw_cloud(axes: Axes, particles: Particles, size: float = 10.0, label: str | None = "particles") -> None:
    """Particles as points; the heavier one is, the more opaque."""
    alpha = 0.25 + 0.75 * particles.weights / particles.weights.max()
    x, y = particles.poses[:, :2].T
    axes.scatter(x, y, s=size, color=COLOURS["particles"], alpha=alpha, linewidths=0, label=label, zorder=3)


def draw_scan(axes: Axes, points: ArrayLike, size: float = 4.0, label: str | None = "scan") -> None:
    """End points ``(M, 2)`` of a scan."""
    x, y = np.asarray(points).T
    axes.scatter(x, y, s=size, color=COLOURS["hits"], linewidths=0, label=label, zorder=3)


def draw_beams(axes: Axes, sensor: ArrayLike, points: ArrayLike, label: str | None = "beams") -> None:
    """Beams from the sensor ``(2,)`` to their end points ``(M, 2)``: what lies along them is free."""
    lines = [(tuple(np.asarray(sensor)), tuple(point)) for point in np.asarray(points)]
    axes.add_collection(LineCollection(lines, color=COLOURS["free"], linewidths=0.8, alpha=0.6, label=label))
    axes.autoscale_view()


def draw_pose(axes: Axes, pose: ArrayLike, kind: str = "estimate", length: float = 0.6) -> None:
    """A pose (x, y, heading) as an arrow of ``length`` metres along its heading."""
    x, y, theta = np.asarray(pose)
    tip = (x + length * np.cos(theta), y + length * np.sin(theta))
    arrow = {"arrowstyle": "-|>", "color": COLOURS[kind], "linewidth": 2.0, "mutation_scale": 14}
    axes.annotate("", xy=tip, xytext=(x, y), arrowprops=arrow, zorder=4)
    axes.plot(x, y, marker="o", markersize=4, color=COLOURS[kind])
