"""Chapter 06: how a camera sees, drawn; and how one is calibrated."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from pfslam.refined.floor import fit_floor_plane
from pfslam.sensors import RgbdModel
from pfslam.texture import disparity_from_depth
from pfslam_book.ch06.pairs import Shot, points_of
from pfslam_book.show.pictures import Picture, steady
from pfslam_book.show.style import COLOURS, INK, new_figure
from pfslam_book.show.texture_error import nearest_floor
from pfslam_book.show.widgets import Explorer, Slider

TAPE = (0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0)
"""Distances (m) at which a board is held before the camera to calibrate it."""
SUBPIXEL = 8
"""The camera reports its shift in eighths of a pixel."""


def _arrow(axes: Axes, tail, tip, colour: str, style: str = "-|>") -> None:
    look = {"arrowstyle": style, "color": colour, "linewidth": 1.8, "mutation_scale": 13}
    axes.annotate("", xy=tip, xytext=tail, arrowprops=look)


def pinhole_picture() -> Picture:
    """Draw a pinhole camera from above: two similar triangles."""
    figure, axes = new_figure(5.4, 3.2)
    f, z, x = 1.4, 4.0, 1.6
    u = f * x / z
    axes.fill([0, z, z], [0, 0, x], color=COLOURS["particles"], alpha=0.25, linewidth=0)
    axes.fill([0, f, f], [0, 0, u], color=COLOURS["highlight"], alpha=0.45, linewidth=0)
    axes.plot([0, z], [0, x], color=COLOURS["estimate"])
    axes.plot([0, 5], [0, 0], color=INK, linewidth=1)
    axes.plot([f, f], [-1.1, 1.1], color=INK, linewidth=2.4)
    axes.plot(0, 0, "o", color=INK, markersize=7)
    axes.plot(z, x, "o", color=COLOURS["hits"], markersize=9)
    axes.plot(f, u, "o", color=COLOURS["highlight"], markersize=8)
    axes.text(z + 0.12, x, "point", va="center")
    axes.text(z + 0.1, x / 2, "$X$", va="center", fontsize=15)
    axes.text(f + 0.1, u / 2 - 0.03, "$u - c_u$", va="center", fontsize=13)
    axes.text(0.05, 0.18, "lens", ha="right")
    axes.text(f, -1.2, "image, column $u$", ha="center", va="top")
    axes.text(5.02, 0, "axis", va="center")
    for reach, level, name in ((f, -0.3, "$f$"), (z, -0.75, "$Z$")):
        _arrow(axes, (0, level), (reach, level), INK, "<|-|>")
        axes.text(reach / 2 if name == "$f$" else 2.7, level - 0.08, name, ha="center", va="top", fontsize=15)
    axes.set(xlim=(-0.6, 5.5), ylim=(-1.6, 1.9))
    axes.set_axis_off()
    return Picture(
        figure,
        """A camera from above. The ray from the lens to a point at depth Z and X to the right of the axis crosses the
        image, drawn in front of the lens at the distance f, at u minus c_u from its centre. The small triangle with
        the sides f and u minus c_u and the large one with Z and X are similar.""",
    )


def structured_light_explorer(camera: RgbdModel) -> Explorer:
    """Move a wall and watch one dot of the projected pattern shift in the image."""
    focal_times_baseline = abs(camera.depth_scale / camera.disparity_slope) / SUBPIXEL
    baseline = focal_times_baseline / camera.focal_u

    def shift(z: float) -> float:
        return focal_times_baseline / z

    def draw(z: float) -> Figure:
        figure, (above, below) = new_figure(5.1, 5.0, rows=2, height_ratios=[1, 1])
        _draw_triangle(above, z, baseline)
        depths = np.linspace(0.45, 8.2, 200)
        below.plot(depths, disparity_from_depth(depths, camera), color=COLOURS["estimate"])
        below.plot(z, disparity_from_depth(z, camera), "o", markersize=11, color=COLOURS["hits"])
        below.axhline(1089, color=COLOURS["truth"], linestyle=":", linewidth=1.2)
        below.text(8.3, 1100, "1089: infinitely far", ha="right", va="bottom")
        below.set(xlabel="depth $Z$ [m]", ylabel="raw disparity $d$", xlim=(-2.1, 8.4), ylim=(300, 1210))
        above.set_title(
            f"shift {shift(z):.1f} px, raw disparity {float(disparity_from_depth(z, camera)):.0f}"
        )
        return figure

    def alt(z: float) -> str:
        return (
            f"A wall at {z:g} m. From above: the projector sends one dot straight ahead, the camera {baseline:.3f} m "
            f"beside it sees it {shift(z):.1f} pixels away from where a dot at infinity would be. Below, the raw "
            f"disparity against depth, rising from 383 at 0.5 m towards 1089: here "
            f"{disparity_from_depth(z, camera):.0f}."
        )

    slider = Slider("z", [0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0], 2, "Wall at", "m", live=(0.5, 8.0, 0.1))
    return Explorer(
        steady(draw), [slider], alt=alt, title="A dot of light, seen from beside", play="z", pause=900
    )


def _draw_triangle(axes: Axes, z: float, baseline: float) -> None:
    """Projector, camera, wall and the dot, from above; sideways distances are stretched."""
    axes.plot([z, z], [-0.03, 0.11], color=COLOURS["truth"], linewidth=4)
    axes.plot([0, z], [baseline, baseline], color=COLOURS["hits"])
    axes.plot([0, z], [0, baseline], color=COLOURS["estimate"])
    axes.plot([0, 8.4], [0, 0], color=COLOURS["estimate"], linestyle=":", linewidth=1.4)
    axes.plot(0, baseline, "s", markersize=10, color=COLOURS["hits"])
    axes.plot(0, 0, "s", markersize=10, color=COLOURS["estimate"])
    axes.plot(z, baseline, "o", markersize=9, color=COLOURS["hits"], markeredgecolor=INK)
    axes.text(-0.2, baseline, "projector", color=COLOURS["hits"], ha="right", va="center")
    axes.text(-0.2, 0, "camera", color=COLOURS["estimate"], ha="right", va="center")
    axes.text(8.3, -0.006, "to a dot at infinity", ha="right", va="top", color=COLOURS["estimate"])
    axes.set(xlim=(-2.1, 8.4), ylim=(-0.035, 0.115), xlabel="ahead [m]", ylabel="sideways [m]")
    axes.set_xticks(range(0, 9, 2))


def tape_and_raw(shots: list[Shot], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Give what a calibration starts from: taped distances ``(N,)`` (m) and the mean raw disparity at each.

    The tape is good to 3 mm. The readings are those pixels of the shots that show something at that depth.
    """
    depth = np.concatenate([shot.true_depth.ravel() for shot in shots])
    raw = np.concatenate([shot.disparity.ravel() for shot in shots])
    raw_at = [raw[(np.abs(depth - z) < 0.01 * z) & (raw < 2047)].mean() for z in TAPE]
    return np.array(TAPE) + 0.003 * rng.standard_normal(len(TAPE)), np.array(raw_at)


def calibration_picture(tape: np.ndarray, raw: np.ndarray, slope: float, offset: float) -> Picture:
    """Draw inverse depth against raw disparity with the line fitted to it."""
    figure, axes = new_figure(5.4, 3.6)
    d = np.array([400.0, 1100.0])
    axes.plot(d, slope * d + offset, color=COLOURS["estimate"], label="fitted line")
    axes.plot(raw, 1 / tape, "o", color=COLOURS["hits"], markersize=8, label="board at a taped distance")
    axes.axhline(0, color=COLOURS["truth"], linewidth=1)
    axes.set(
        xlabel="raw disparity $d$", ylabel="1 / taped distance [1/m]", xlim=(400, 1120), ylim=(-0.1, 2.0)
    )
    axes.legend()
    return Picture(
        figure,
        f"""Inverse distance against raw disparity for {len(tape)} distances from {min(TAPE):g} to {max(TAPE):g} m: the
        points lie on a falling straight line, which reaches zero at d = {-offset / slope:.0f}.""",
    )


def frames_picture(camera: RgbdModel) -> Picture:
    """Draw the robot from its right side with the frames b, c and o, and the nearest floor that the camera sees."""
    (x, _, z), pitch, ring = camera.position_b, camera.pitch, nearest_floor(camera)
    forward, up = np.array([np.cos(pitch), -np.sin(pitch)]), np.array([np.sin(pitch), np.cos(pitch)])
    figure, axes = new_figure(5.4, 3.9)
    axes.fill([-0.25, 0.25, 0.25, -0.25], [0.06, 0.06, 0.24, 0.24], color=COLOURS["unknown"], alpha=0.5)
    for wheel in (-0.16, 0.16):
        axes.add_patch(Circle((wheel, 0.06), 0.06, color=INK, linewidth=0))
    axes.plot([x, x], [0.24, z], color=COLOURS["unknown"], linewidth=5)
    axes.axhline(0, color=INK, linewidth=1.4)
    axes.plot([x, x + ring], [z, 0], color=COLOURS["highlight"], linestyle="--")
    axes.plot([x, x + z / np.tan(pitch)], [z, 0], color=COLOURS["estimate"], linestyle=":")
    for start, direction, name, colour, beside in (
        ((0, 0), (1, 0), "$x_b$", "truth", (0.06, 0.04)),
        ((0, 0), (0, 1), "$z_b$", "truth", (0, 0.06)),
        ((x, z), forward, "$x_c = z_o$", "estimate", (0.1, 0.06)),
        ((x, z), up, "$z_c$", "estimate", (0.02, 0.06)),
        ((x, z), -up, "$y_o$", "hits", (-0.06, -0.01)),
    ):
        tip = np.array(start) + 0.26 * np.array(direction)
        _arrow(axes, start, tip, COLOURS[colour])
        axes.text(*(tip + beside), name, color=COLOURS[colour], fontsize=14, ha="center", va="center")
    for level, reach, words in (
        (-0.09, (x, x + ring), f"{ring:.2f} m"),
        (-0.22, (0, x + ring), f"{x + ring:.2f} m"),
    ):
        _arrow(axes, (reach[0], level), (reach[1], level), INK, "<|-|>")
        axes.text(reach[1] + 0.03, level, words, va="center")
    axes.text(1.0, 0.17, "optical axis", color=COLOURS["estimate"], rotation=-16)
    axes.text(0.62, 0.03, "lowest row", color="#8a5f00")
    axes.set(xlim=(-0.35, 1.45), ylim=(-0.3, 0.8), aspect="equal")
    axes.set_axis_off()
    return Picture(
        figure,
        f"""The robot from its right side. The body frame b sits on the floor under the chassis centre, x ahead and z
        up. The camera stands {x:.2f} m ahead and {z:.2f} m up and looks down by {np.rad2deg(pitch):.0f} degrees: x of
        the camera frame c points along its view and is z of the optical frame o; y of the optical frame points down.
        The lowest row of the image meets the floor {ring:.2f} m ahead of the camera, {x + ring:.2f} m ahead of the
        chassis centre.""",
    )


def floor_votes(x: np.ndarray, z: np.ndarray, slopes: np.ndarray, thickness: float = 0.02) -> np.ndarray:
    """Count for each slope how many points ``(x, z)`` the best line of that slope and some height holds."""
    edges = np.arange(-0.1, 0.1 + thickness / 2, thickness / 2)
    counts = np.array([np.histogram(z - slope * x, edges)[0] for slope in slopes])
    return (counts[:, 1:] + counts[:, :-1]).max(
        axis=1
    )  # two bins: a line on an edge must not lose half its votes


def plane_picture(shot: Shot, camera: RgbdModel) -> Picture:
    """Draw one shot from the side as a wrongly pitched camera reports it, the votes, and the fitted floor."""
    points = points_of(shot, camera, step=6)
    near = np.isfinite(points.depth) & (points.depth < 4.0)
    x, z = points.points_b[near, 0], points.points_b[near, 2]
    plane = fit_floor_plane(points.points_b[near])
    slopes = np.arange(-20, 21) * 0.01
    figure, (left, right) = new_figure(5.4, 3.6, columns=2, width_ratios=[1.5, 1])
    left.scatter(x, z, s=4, color=COLOURS["unknown"], linewidths=0)
    reach = np.array([0.5, 4.2])
    left.plot(
        reach, plane.height + np.tan(plane.pitch_error) * reach, color=COLOURS["estimate"], linewidth=2.4
    )
    left.axhline(0, color=COLOURS["truth"], linestyle=":")
    left.set(xlabel="ahead [m]", ylabel="height [m]", xlim=(0, 4.3), ylim=(-0.35, 0.6))
    votes = floor_votes(x, z, slopes)
    right.plot(slopes, votes, color=COLOURS["estimate"], marker="o", markersize=3)
    right.set(xlabel="slope", ylabel="points on the line", ylim=(0, None))
    right.set_xticks([-0.2, 0, 0.2])
    return Picture(
        figure,
        f"""Left, the points of one image from the side: most lie on a line that falls by
        {-100 * np.tan(plane.pitch_error):.1f} cm per metre, walls rise from it; the fitted line lies on them. Right,
        the most points that a line of each slope holds: a sharp peak of {votes.max()} votes at a slope of
        {slopes[votes.argmax()]:.2f}, of {len(x)} points.""",
    )
