"""Chapter 03, one pose for a whole cloud: means of angles, and means of two opinions."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from pfslam.poses import average_pose
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, INK, metric_axes, new_figure

CORRIDOR_Y = (0.0, 4.0)
"""Middle lines (m) of the two corridors, each 2 m wide."""


def facing_west(n: int = 40, seed: int = 0) -> np.ndarray:
    """Headings ``(n,)`` in (-pi, pi] of a robot that faces west, give or take 10 degrees."""
    theta = np.pi + np.deg2rad(10.0) * np.random.default_rng(seed).standard_normal(n)
    return np.arctan2(np.sin(theta), np.cos(theta))


def two_corridors(n: int = 100, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Poses ``(n, 3)`` and equal weights ``(n,)``: 55 % of the particles in one corridor, the rest in the next."""
    rng = np.random.default_rng(seed)
    in_first = np.arange(n) < 0.55 * n
    y = np.where(in_first, *CORRIDOR_Y) + 0.25 * rng.standard_normal(n)
    poses = np.column_stack([5.0 + 0.5 * rng.standard_normal(n), y, 0.1 * rng.standard_normal(n)])
    return poses, np.full(n, 1.0 / n)


def means_picture() -> Picture:
    """Headings on a circle with both means; and two clusters with their mean between them."""
    figure, (left, right) = new_figure(5.1, 3.5, columns=2)
    theta, (poses, weights) = facing_west(), two_corridors()
    plain, mean = theta.mean(), average_pose(poses, weights)
    _draw_circle(left, theta, plain)
    for y in CORRIDOR_Y:
        right.axhspan(y - 1.0, y + 1.0, color="white", linewidth=0)
        for wall in (y - 1.0, y + 1.0):
            right.axhline(wall, color=COLOURS["truth"], linewidth=2.5)
    right.set_facecolor(COLOURS["unknown"])
    right.scatter(*poses[:, :2].T, s=14, color=COLOURS["particles"], linewidths=0, zorder=3)
    right.scatter(*mean[:2], s=120, marker="X", color=COLOURS["highlight"], zorder=4)
    right.annotate("mean", mean[:2], (10, -5), textcoords="offset points", color=INK)
    metric_axes(right, "two corridors").set(xlim=(1, 9), ylim=(-1.8, 5.8), xticks=(2, 5, 8), yticks=(0, 2, 4))
    alt = f"""Left: {len(theta)} headings around west on a circle. Their plain mean points to {np.rad2deg(plain):.0f}
    degrees, the mean of their directions to {np.rad2deg(abs(_circular(theta))):.0f}. Right: two corridors with a
    cluster of particles in each; the mean pose, at y = {mean[1]:.1f} m, lies in the wall between them."""
    return Picture(figure, alt)


def _draw_circle(axes: Axes, theta: np.ndarray, plain: float) -> None:
    """Headings as dots on the unit circle, and arrows for the two means."""
    around = np.linspace(0.0, 2.0 * np.pi, 100)
    axes.plot(np.cos(around), np.sin(around), color=COLOURS["unknown"], linewidth=1.0)
    axes.scatter(np.cos(theta), np.sin(theta), s=20, color=COLOURS["particles"], linewidths=0, zorder=3)
    means = ((plain, "highlight", "plain mean", 0.22), (_circular(theta), "estimate", "of directions", -0.22))
    for angle, colour, name, above in means:
        tip = (0.85 * np.cos(angle), 0.85 * np.sin(angle))
        arrow = {"arrowstyle": "-|>", "color": COLOURS[colour], "linewidth": 2.5, "mutation_scale": 16}
        axes.annotate("", xy=tip, xytext=(0, 0), arrowprops=arrow, zorder=4)
        axes.text(
            0.5 * tip[0],
            0.5 * tip[1] + above,
            name,
            ha="center",
            va="center",
            color=INK,
            fontsize=11,
        )
    axes.set(
        xlim=(-1.25, 1.25), ylim=(-1.25, 1.25), xticks=(), yticks=(), title="facing west", aspect="equal"
    )
    axes.grid(False)
    axes.spines[["left", "bottom"]].set_visible(False)


def _circular(theta: np.ndarray) -> float:
    """Direction (rad) of the sum of the unit vectors."""
    return float(np.arctan2(np.sin(theta).sum(), np.cos(theta).sum()))
