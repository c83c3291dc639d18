"""Chapter 00, frames and clocks gone wrong: a turn on the spot, and scans drawn from the pose of another moment."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.poses import invert, transform_points
from pfslam.recording import Recording, nearest_stamp
from pfslam.sensors import LidarModel, scan_points
from pfslam_book.show.figures import draw_robot
from pfslam_book.show.style import COLOURS, metric_axes, new_figure
from pfslam_book.show.widgets import Explorer, Slider

# ---- a turn on the spot

ROOM = (-1.0, 3.0, -1.0, 2.0)
"""The walls of a small room: x_min, x_max, y_min, y_max (m)."""
POST = (2.0, 1.2, 0.06)
"""A thin round post in it: x, y, radius (m)."""
PLACE = (0.6, 0.3)
"""Where the robot turns (m)."""
BEAMS = np.deg2rad(np.arange(-135.0, 135.1, 2.0))
STEP_DEG = 15.0
WAYS = ("right", "no lever arm", "lever arm on y", "inverse pose")


def room_ranges(sensor: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return exact distances ``(M,)`` from ``sensor (2,)`` along ``directions (M,)`` rad to the walls or the post."""
    d = np.column_stack([np.cos(directions), np.sin(directions)])
    x_min, x_max, y_min, y_max = ROOM
    with np.errstate(divide="ignore"):
        to_x = np.where(d[:, 0] > 0, x_max - sensor[0], sensor[0] - x_min) / np.abs(d[:, 0])
        to_y = np.where(d[:, 1] > 0, y_max - sensor[1], sensor[1] - y_min) / np.abs(d[:, 1])
    wall = np.minimum(to_x, to_y)
    to_post = np.subtract(POST[:2], sensor)
    along = d @ to_post
    inside = POST[2] ** 2 - (to_post @ to_post - along**2)
    meets = (inside >= 0) & (along > 0)
    return np.where(meets, along - np.sqrt(np.maximum(inside, 0.0)), wall)


def turn_points(way: str, turned_deg: float) -> np.ndarray:
    """Return all end points ``(M, 2)`` of the scans of a turn on the spot, brought to the world in one of ``WAYS``."""
    arm = np.array(LidarModel().position_b[:2])
    assumed = {"no lever arm": np.zeros(2), "lever arm on y": arm[::-1]}.get(way, arm)
    points = []
    for heading in np.deg2rad(np.arange(0.0, turned_deg + 1.0, STEP_DEG)):
        pose = np.array([*PLACE, heading])
        sensor = transform_points(pose, arm[None])[0]
        r = room_ranges(sensor, BEAMS + heading)
        points_b = assumed + np.column_stack([r * np.cos(BEAMS), r * np.sin(BEAMS)])
        points.append(transform_points(invert(pose) if way == "inverse pose" else pose, points_b))
    return np.concatenate(points)


def off_walls(points: np.ndarray) -> np.ndarray:
    """Return the distance (m) of each point ``(M, 2)`` from the nearest wall or from the post's surface."""
    x, y = points.T
    x_min, x_max, y_min, y_max = ROOM
    outside = np.hypot(
        np.maximum(np.maximum(x_min - x, x - x_max), 0), np.maximum(np.maximum(y_min - y, y - y_max), 0)
    )
    inside = np.minimum(np.minimum(x - x_min, x_max - x), np.minimum(y - y_min, y_max - y))
    wall = np.where(outside > 0, outside, np.maximum(inside, 0))
    return np.minimum(wall, np.abs(np.hypot(x - POST[0], y - POST[1]) - POST[2]))


def turn_frame(way: str, turned: float) -> Figure:
    """Draw the whole room, and the post close up, as the robot draws them while it turns."""
    points = turn_points(way, turned)
    figure, axes = new_figure(5.0, 3.3, 1, 2, width_ratios=[1.5, 1])
    figure.set_layout_engine("none")
    for ax, place in zip(axes, ((0.11, 0.17, 0.49, 0.72), (0.72, 0.17, 0.27, 0.72)), strict=True):
        ax.set_position(place)
        _draw_room(ax)
        ax.scatter(*points.T, s=5 if ax is axes[0] else 14, color=COLOURS["hits"], linewidths=0, zorder=3)
        metric_axes(ax)
    draw_robot(axes[0], np.array([*PLACE, np.deg2rad(turned)]), length=0.5)
    axes[0].set(xlim=(-1.8, 3.8), ylim=(-1.8, 2.8), title=f"turned by {turned:.0f}°")
    axes[1].set(xlim=(1.65, 2.35), ylim=(0.85, 1.55), title="the post", ylabel="")
    axes[1].set(xticks=(1.8, 2.2), yticks=(1.0, 1.4))
    return figure


def turn_explorer() -> Explorer:
    """Make the explorer with a choice of what is wrong, and how far the robot has turned."""
    controls = [
        Slider("way", WAYS, 1, "Drawn with"),
        Slider("turned", (0.0, 45.0, 90.0, 180.0, 360.0), 0, "Turned by", "deg", "g"),
    ]
    return Explorer(turn_frame, controls, title="A turn on the spot", alt=turn_alt, play="turned")


def _draw_room(axes: Axes) -> None:
    x_min, x_max, y_min, y_max = ROOM
    around = np.linspace(0, 2 * np.pi, 60)
    axes.plot(
        [x_min, x_max, x_max, x_min, x_min],
        [y_min, y_min, y_max, y_max, y_min],
        color=COLOURS["unknown"],
        lw=4,
    )
    axes.plot(
        POST[0] + POST[2] * np.cos(around), POST[1] + POST[2] * np.sin(around), color=COLOURS["unknown"], lw=3
    )


def turn_alt(way: str, turned: float) -> str:
    """Return the words for one state of the turn."""
    off = off_walls(turn_points(way, turned))
    return f"""A room with a post, drawn ({way}) by a robot that has turned on the spot by {turned:.0f} degrees. End
    points lie {100 * np.mean(off):.1f} cm from what they hit on average, {100 * off.max():.0f} cm at most."""


# ---- scans drawn from the pose of another moment

STRETCHES = {"straight": 78.0, "turn": 86.4}
"""Two moments of ``hall``, s from the first encoder reading: down a corridor, and in its fastest turn."""
SCANS, APART = 8, 0.1


def shifted_scans(recording: Recording, moment: float, offset: float) -> np.ndarray:
    """Return points ``(M, 2)`` of scans around a moment, each drawn from the pose ``offset`` s after its stamp."""
    (encoders, _), scans, lidar = recording.wheels_and_gyro(), recording.scans(), recording.robot.lidar
    times = encoders.t[0] + moment + APART * (np.arange(SCANS) - SCANS / 2)
    truth, points = recording.true_path(), []
    for i in nearest_stamp(scans.t, times):
        points_b = scan_points(scans.ranges[i], lidar)[::5]
        points.append(transform_points(truth.at(scans.t[i] + offset), points_b))
    return np.concatenate(points)


def turn_rate(recording: Recording, moment: float) -> float:
    """Return the mean true yaw rate (rad/s) over the scans around a moment."""
    t = recording.wheels_and_gyro()[0].t[0] + moment + APART * SCANS / 2 * np.array([-1.0, 1.0])
    heading = np.unwrap(recording.true_path().at(t)[:, 2])
    return float(np.diff(heading)[0] / np.diff(t)[0])


def spread(drawn: np.ndarray, right: np.ndarray) -> float:
    """Return how far (m, median) a drawn point lies from the nearest of the right ones; every third is asked."""
    dx, dy = (np.subtract.outer(drawn[::3, k], right[:, k]) for k in (0, 1))
    return float(np.median(np.sqrt((dx**2 + dy**2).min(axis=1))))


def late_clock(recording: Recording, moment: float, offset: float) -> dict[str, float]:
    """Return what a clock late by ``offset`` s does to the scans around a moment.

    ``angle`` (rad) that the robot turns in that time, ``range`` (m) of a beam in the median, ``sideways`` (m) that its
    end point moves, and ``off_walls`` (m): how far a point then lies from the nearest one drawn with the right stamp.
    """
    t0, scans = recording.wheels_and_gyro()[0].t[0], recording.scans()
    ranges = scans.ranges[nearest_stamp(scans.t, np.array([t0 + moment]))[0]]
    median = float(np.median(ranges[recording.robot.lidar.valid(ranges)]))
    angle = abs(turn_rate(recording, moment)) * offset
    blur = spread(*(shifted_scans(recording, moment, s) for s in (offset, 0.0)))
    return {"angle": angle, "range": median, "sideways": angle * median, "off_walls": blur}


def draw_late_clock(recording: Recording, right: dict[str, np.ndarray], offset: float) -> Figure:
    """Draw a straight stretch and a turn with the same clock offset (ms), over where the points belong."""
    start, truth = recording.wheels_and_gyro()[0].t[0], recording.true_path()
    figure, axes = new_figure(5.0, 3.3, 1, 2)
    figure.set_layout_engine("none")
    for k, (ax, (name, moment)) in enumerate(zip(axes, STRETCHES.items(), strict=True)):
        ax.set_position((0.12 + 0.48 * k, 0.17, 0.38, 0.72))
        points = shifted_scans(recording, moment, offset / 1e3)
        ax.scatter(*right[name].T, s=14, color=COLOURS["unknown"], linewidths=0)
        ax.scatter(*points.T, s=3, color=COLOURS["hits"], linewidths=0)
        x, y = truth.at(start + moment)[:2]
        metric_axes(ax, f"{name}: {100 * spread(points, right[name]):.0f} cm")
        ax.set(xlim=(x - 3.5, x + 3.5), ylim=(y - 3.5, y + 3.5))
    axes[1].set_ylabel("")
    return figure


def describe_late_clock(recording: Recording, right: dict[str, np.ndarray], offset: float) -> str:
    """Describe the picture of these values in words."""
    words = [
        f"{name} ({turn_rate(recording, moment):+.2f} rad/s): in the median a point lies "
        f"{100 * spread(shifted_scans(recording, moment, offset / 1e3), right[name]):.1f} cm off the walls"
        for name, moment in STRETCHES.items()
    ]
    return f"{SCANS} scans drawn with stamps wrong by {offset:.0f} ms. {'; '.join(words)}."


def late_clock_explorer(recording: Recording) -> Explorer:
    """Make the explorer with one slider: by how much the LiDAR's clock is wrong."""
    right = {name: shifted_scans(recording, moment, 0.0) for name, moment in STRETCHES.items()}
    offset = Slider("offset", (0, 20, 50, 100, 150, 200), 0, "Clock offset", "ms", "g", (-300, 300, 5))
    return Explorer(
        partial(draw_late_clock, recording, right),
        [offset],
        title="Scans with a late clock",
        alt=partial(describe_late_clock, recording, right),
    )
