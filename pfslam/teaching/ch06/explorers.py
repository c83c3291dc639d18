"""Chapter 06: the two pictures with sliders."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from pfslam.grid import GridSpec
from pfslam.teaching.ch06.pairs import (
    Shot,
    chosen_as_floor,
    floor_shares,
    journey,
    pitched,
    points_of,
    registered_colours,
)
from pfslam.teaching.show.pictures import steady
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.widgets import Explorer, Slider
from pfslam.texture.floor import (
    NO_READING,
    associate_rgb,
    back_project,
    depth_from_disparity,
    nearest_floor,
    to_world,
)

PIXELS = {
    "letter, near": (310, 413),
    "letter, far": (268, 118),
    "foot of a wall": (528, 190),
    "end wall": (300, 40),
    "a hole": (0, 0),  # set to a pixel without a reading
}
STEPS = ("0 start", "1 colour", "2 depth", "3 trust", "4 world", "5 floor?", "6 paint")
SCALE = 160  # rows of a camera image in a widget


def pixels_of(shot: Shot) -> dict[str, tuple[int, int]]:
    """Give the pixels of the journey; the last one has no reading."""
    v, u = np.argwhere(shot.disparity[200:300, 100:200] == NO_READING)[0]
    return PIXELS | {"a hole": (100 + int(u), 200 + int(v))}


def journey_explorer(shot: Shot, spec: GridSpec) -> Explorer:
    """Choose a pixel and follow it through the six steps."""
    pixels = pixels_of(shot)
    stories = {name: journey(shot, *uv, spec) for name, uv in pixels.items()}

    def story(pixel: str, step: str) -> tuple[int, list[tuple[str, str]]]:
        rows = stories[pixel]
        last = min(STEPS.index(step), len(rows) - 1)
        return last, rows[: last + 1]

    def draw(pixel: str, step: str) -> Figure:
        return draw_journey(shot, pixels[pixel], *story(pixel, step))

    def alt(pixel: str, step: str) -> str:
        last, rows = story(pixel, step)
        ended = " It goes no further." if last < STEPS.index(step) or not _goes_on(rows) else ""
        return f"Pixel: {pixel}. " + "; ".join(f"{name}: {value}" for name, value in rows) + "." + ended

    controls = [
        Slider("pixel", list(pixels), label="Pixel"),
        Slider("step", list(STEPS), start=2, label="Step"),
    ]
    return Explorer(
        steady(draw), controls, alt=alt, title="The journey of one pixel", play="step", pause=1200
    )


def _goes_on(rows: list[tuple[str, str]]) -> bool:
    return not any(word in rows[-1][1] for word in ("no reading", "refused", "not floor"))


def draw_journey(shot: Shot, pixel: tuple[int, int], last: int, rows: list[tuple[str, str]]) -> Figure:
    """Draw the camera image, the side view, and the words of the step."""
    figure, axes = new_figure(5.1, 5.8, rows=2, height_ratios=[1.45, 1])
    u, v = pixel
    colour = COLOURS["highlight"] if _goes_on(rows) else COLOURS["hits"]
    small = cv2.resize(shot.rgb, (SCALE * 4 // 3, SCALE), interpolation=cv2.INTER_AREA)
    axes[0].imshow(small, extent=(0, 640, 480, 0), interpolation="bilinear")
    axes[0].axis("off")
    axes[0].plot(u, v, "o", markersize=15, markerfacecolor="none", markeredgewidth=3, color=COLOURS["truth"])
    axes[0].plot(u, v, "o", markersize=15, markerfacecolor="none", markeredgewidth=1.6, color=colour)
    _side_view(axes[1])
    if (last >= 1 and len(rows) > 2) or (last == 1 and _goes_on(rows)):
        u_rgb, v_rgb = associate_rgb(u, v, int(shot.disparity[v, u]), shot.camera)
        axes[0].plot(u_rgb, v_rgb, "+", markersize=17, markeredgewidth=4, color=COLOURS["truth"])
        axes[0].plot(u_rgb, v_rgb, "+", markersize=15, markeredgewidth=2, color=COLOURS["particles"])
    if last >= 2:
        point = _body_point(shot, pixel)
        camera = shot.camera.position_b
        axes[1].plot([camera[0], point[0]], [camera[2], point[2]], color=colour, linewidth=1.6)
        face = _colour_at(shot, pixel) if last >= 6 else np.array(to_rgb(colour))
        axes[1].plot(point[0], point[2], "o", markersize=13, color=face, markeredgecolor=COLOURS["truth"])
    name, value = rows[-1]
    figure.suptitle(f"{name}: {value}", fontsize=13)
    return figure


def _body_point(shot: Shot, pixel: tuple[int, int]) -> np.ndarray:
    """Give the pixel's point in the body frame."""
    depth = depth_from_disparity(int(shot.disparity[pixel[1], pixel[0]]), shot.camera)
    return to_world(back_project(*pixel, depth, shot.camera.K), np.zeros(3), shot.camera)[0]


def _colour_at(shot: Shot, pixel: tuple[int, int]) -> np.ndarray:
    u, v = associate_rgb(*pixel, int(shot.disparity[pixel[1], pixel[0]]), shot.camera)
    return shot.rgb[round(float(v)), round(float(u))] / 255


def _side_view(axes: Axes) -> None:
    """Draw the robot's camera and the floor, from the side; heights are stretched."""
    axes.axhline(0.0, color=COLOURS["truth"], linewidth=1.2)
    axes.plot(0.168, 0.38, "s", markersize=9, color=COLOURS["estimate"])
    axes.set_xlim(-0.2, 8.2)
    axes.set_ylim(-0.35, 1.7)
    axes.set_xlabel("ahead of the robot [m]")
    axes.set_ylabel("height [m]")


def floor_explorer(shot: Shot) -> Explorer:
    """Choose a pitch, a tolerance and a Z_MAX, and see which pixels count as floor."""
    true_pitch = np.rad2deg(shot.camera.pitch)

    @lru_cache(maxsize=8)
    def cloud(pitch: float):
        return points_of(shot, pitched(shot.camera, pitch - true_pitch))

    @lru_cache(maxsize=4)
    def choice(pitch: float, tolerance: float, z_max: float):
        points = cloud(pitch)
        chosen = chosen_as_floor(points, tolerance / 100, z_max)
        return points, chosen, floor_shares(shot, points, chosen)

    def draw(pitch: float, tolerance: float, z_max: float) -> Figure:
        points, chosen, (found, wrong) = choice(pitch, tolerance, z_max)
        return draw_floor_choice(shot, points, chosen, tolerance, found, wrong)

    def alt(pitch: float, tolerance: float, z_max: float) -> str:
        points, chosen, (found, wrong) = choice(pitch, tolerance, z_max)
        far = points.points_b[chosen, 0].max() if chosen.any() else 0.0
        return (
            f"Pitch {pitch:g} degrees (true: 18), tolerance {tolerance:g} cm, greatest depth {z_max:g} m: "
            f"{100 * found:.0f} % of the floor's pixels count as floor, the farthest {far:.1f} m ahead; "
            f"{100 * wrong:.1f} % of those that count are not floor."
        )

    controls = [
        Slider(
            "pitch",
            [15.0, 17.0, 18.0, 19.0, 20.6],
            start=2,
            label="Pitch",
            unit="degrees",
            live=(14, 22, 0.1),
        ),
        Slider("tolerance", [1.0, 3.0, 10.0], label="Tolerance", unit="cm", live=(0.2, 15, 0.1)),
        Slider("z_max", [3.0, 10.0], start=1, label="Greatest depth", unit="m", live=(0.5, 10, 0.1)),
    ]
    return Explorer(steady(draw), controls, alt=alt, title="Which pixels are floor?")


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
