"""Chapter 06: the pixels that count as floor when the assumed pitch is wrong."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pfslam_book.ch06.pairs import (
    Shot,
    chosen_as_floor,
    floor_shares,
    pitched,
    points_of,
    registered_colours,
)
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.texture_error import nearest_floor

FARTHEST = 10.0  # m
PIXELS = {
    "letter, near": (310, 413),
    "letter, far": (268, 118),
}
"""Depth pixels (u, v) of the chapter's shot."""


def floor_picture(shot: Shot, pitch: float, tolerance: float) -> Picture:
    """Show which pixels count as floor for an assumed pitch (degrees) and a tolerance (cm)."""
    points = points_of(shot, pitched(shot.camera, pitch - np.rad2deg(shot.camera.pitch)))
    chosen = chosen_as_floor(points, tolerance / 100, FARTHEST)
    found, wrong = floor_shares(shot, points, chosen)
    far = points.points_b[chosen, 0].max()
    alt = f"""Assumed pitch {pitch:g} degrees (true: 18), tolerance {tolerance:g} cm: {100 * found:.0f} % of the floor's
    pixels count as floor, the farthest {far:.1f} m ahead; {100 * wrong:.1f} % of those that count are not floor. From
    the side the points of the floor sink below the two lines of the tolerance."""
    return Picture(draw_floor_choice(shot, points, chosen, tolerance, found, wrong), alt)


def draw_floor_choice(shot: Shot, points, chosen, tolerance: float, found: float, wrong: float) -> Figure:
    """Draw the chosen pixels in their colours, the others dark, and below all points from the side."""
    figure, axes = new_figure(5.1, 5.8, rows=2, height_ratios=[1.45, 1])
    colours = registered_colours(shot, points).astype(float)
    colours[~chosen] *= 0.3
    image = colours.reshape(shot.camera.height // 4, shot.camera.width // 4, 3).astype(np.uint8)
    axes[0].imshow(image, interpolation="bilinear")
    axes[0].axis("off")
    axes[0].set_title(f"floor found: {100 * found:.0f} %; wall among the bright: {100 * wrong:.1f} %")
    few = slice(None, None, 29)
    x, z = points.points_b[few, 0], points.points_b[few, 2]
    inside = chosen[few]
    axes[1].scatter(x[~inside], z[~inside], s=9, color=COLOURS["unknown"], linewidths=0)
    axes[1].scatter(x[inside], z[inside], s=12, color=COLOURS["free"], linewidths=0)
    for level in (-tolerance / 100, tolerance / 100):
        axes[1].axhline(level, color=COLOURS["highlight"], linewidth=1.4)
    axes[1].axvline(
        0.168 + nearest_floor(shot.camera), color=COLOURS["estimate"], linewidth=1.0, linestyle=":"
    )
    axes[1].set_xlim(0, 8.2)
    axes[1].set_ylim(-0.5, 0.5)
    axes[1].set_xlabel("ahead of the robot [m]")
    axes[1].set_ylabel("height [m]")
    return figure
