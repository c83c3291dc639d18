"""Chapter 00, the robot: its wheels, its instruments and their frames, from the side and from above."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle

from pfslam.sensors import RobotModel
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure

WHEEL_RADIUS = 0.127  # m, half the diameter from which the report takes its metres per count
AXLES = (-0.165, 0.165)  # m, drawn; no equation needs the distance between front and rear
WHEEL_WIDTH = 0.06
AXIS = 0.2  # m, the length of an axis that is drawn
HALF_VIEW = np.deg2rad(22.3)  # the depth camera, up and down
DARK = COLOURS["truth"]


def robot_picture(robot: RobotModel) -> Picture:
    """Draw the robot from the side and from above, with the frames b, l and c where they are."""
    figure, (side, top) = new_figure(5.0, 7.0, 2, 1, height_ratios=[1.0, 1.0])
    _draw_side(side, robot)
    _draw_top(top, robot)
    for axes, height in ((side, "z [m]"), (top, "y [m]")):
        axes.set_aspect("equal")
        axes.grid(False)
        axes.set(
            xlabel="x, ahead [m]", ylabel=height, xlim=(-0.55, 1.15), xticks=(0, 0.5, 1), yticks=(0, 0.5)
        )
    (lx, _, lz), (cx, _, cz) = robot.lidar.position_b, robot.camera.position_b
    alt = f"""The robot from the side and from above, looking to the right. Its body frame b lies on the floor under
    the middle of four wheels, {robot.encoders.track:.2f} m apart. The LiDAR, frame l, sits {lx:.2f} m ahead and
    {lz:.2f} m high and scans 270 degrees in a level plane; the camera, frame c, sits {cx:.2f} m ahead and {cz:.2f} m
    high and looks {np.rad2deg(robot.camera.pitch):.0f} degrees down."""
    return Picture(figure, alt)


def _draw_side(axes: Axes, robot: RobotModel) -> None:
    (lx, _, lz), (cx, _, cz) = robot.lidar.position_b, robot.camera.position_b
    axes.axhline(0.0, color=COLOURS["unknown"], linewidth=2)
    axes.add_patch(Rectangle((-0.28, 0.12), 0.56, 0.14, color=COLOURS["unknown"]))
    axes.plot([-0.12, -0.12, lx], [0.26, lz, lz], color=COLOURS["unknown"], linewidth=5, zorder=0)
    for x in AXLES:
        axes.add_patch(
            Circle((x, WHEEL_RADIUS), WHEEL_RADIUS, facecolor="white", edgecolor=DARK, linewidth=2)
        )
    axes.plot([lx, 1.1], [lz, lz], color=COLOURS["hits"], linestyle="--")
    axes.text(0.62, lz + 0.02, "beams", color=COLOURS["hits"])
    axes.plot(lx, lz, marker="s", markersize=11, color=COLOURS["hits"])
    edges = [(cx + cz / np.tan(a), 0.0) for a in (robot.camera.pitch + HALF_VIEW,)]
    far = cx + 0.9, cz - 0.9 * np.tan(robot.camera.pitch - HALF_VIEW)
    axes.fill(*zip((cx, cz), *edges, (1.15, 0.0), far, strict=True), color=COLOURS["highlight"], alpha=0.2)
    axes.plot(cx, cz, marker="D", markersize=9, color=COLOURS["highlight"])
    axes.text(0.6, 0.13, "camera's view")
    _draw_axes(
        axes, (0.0, 0.0), 0.0, "b", ("x", "z"), words_at=((0.0, -0.1), (0.02, 0.02)), name_at=(-0.04, -0.08)
    )
    _draw_axes(axes, (lx, lz), 0.0, "l", ("", "z"))
    _draw_axes(axes, (cx, cz), -robot.camera.pitch, "c", ("x", ""))
    axes.set_ylim(-0.16, 0.85)


def _draw_top(axes: Axes, robot: RobotModel) -> None:
    lx, cx = robot.lidar.position_b[0], robot.camera.position_b[0]
    half = 0.5 * robot.encoders.track
    axes.add_patch(Rectangle((-0.28, -0.14), 0.56, 0.28, color=COLOURS["unknown"]))
    for x, end in zip(AXLES, "RF", strict=True):
        for y, hand in ((half, "L"), (-half, "R")):
            corner = (x - WHEEL_RADIUS, y - WHEEL_WIDTH / 2)
            wheel = Rectangle(
                corner, 2 * WHEEL_RADIUS, WHEEL_WIDTH, facecolor="white", edgecolor=DARK, linewidth=2
            )
            axes.add_patch(wheel)
            axes.text(x, y + np.sign(y) * 0.05, end + hand, ha="center", va="bottom" if y > 0 else "top")
    axes.annotate("", (-0.37, half), (-0.37, -half), arrowprops={"arrowstyle": "<->", "color": DARK})
    axes.text(-0.45, 0.0, "track", rotation=90, va="center", ha="center")
    for angle in np.linspace(robot.lidar.angle_min, robot.lidar.angle_max, 19):
        x, y = lx + 0.95 * np.cos(angle), 0.95 * np.sin(angle)
        axes.plot([lx, x], [0, y], color=COLOURS["hits"], linewidth=0.8, alpha=0.6, zorder=0)
    axes.plot(cx, 0.0, marker="D", markersize=9, color=COLOURS["highlight"])
    axes.plot(lx, 0.0, marker="s", markersize=9, color=COLOURS["hits"])
    axes.text(lx + 0.01, 0.04, "$l$, $c$")
    _draw_axes(axes, (0.0, 0.0), 0.0, "b", ("", "y"), words_at=((0.0, 0.0), (-0.02, 0.04)))
    axes.set(ylim=(-0.62, 0.62), yticks=(-0.5, 0, 0.5))


def _draw_axes(
    axes: Axes,
    origin,
    tilt: float,
    name: str,
    labels: tuple[str, str],
    words_at=((0.02, 0.02), (0.02, 0.02)),
    name_at=(-0.04, 0.02),
) -> None:
    """Draw two arrows from the origin of a frame, with its letter; an axis without a label is not drawn.

    ``words_at`` (m) is where the label of each axis begins, seen from the tip of its arrow, and ``name_at`` where the
    letter of the frame ends, seen from the origin.
    """
    for turn, label, at in zip((0.0, np.pi / 2), labels, words_at, strict=True):
        if not label:
            continue
        tip = np.add(origin, AXIS * np.array([np.cos(tilt + turn), np.sin(tilt + turn)]))
        arrow = {"arrowstyle": "-|>", "color": COLOURS["estimate"], "linewidth": 2}
        axes.annotate("", tip, origin, arrowprops=arrow, zorder=5)
        x, y = np.add(tip, at)
        axes.text(x, y, f"${label}$", color=COLOURS["estimate"], zorder=6)
    x, y = np.add(origin, name_at)
    axes.text(x, y, f"${name}$", color=COLOURS["estimate"], ha="right", fontsize=15, zorder=6)
