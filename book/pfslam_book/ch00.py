"""Chapter 00: all instruments at one moment, a turn on the spot, and a clock that is late."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.motion import wheel_distance
from pfslam.poses import invert, transform_points
from pfslam.recording import Recording, nearest_stamp
from pfslam.sensors import LidarModel, scan_points
from pfslam_book.exercises.ch00 import (
    check_distance_at,
    check_nearest_within,
    check_scan_points,
    check_to_world,
)
from pfslam_book.show.artists import COLOURS, draw_pose, draw_scan, plan, sheet
from pfslam_book.show.keep import keep
from pfslam_book.show.source import show_source
from pfslam_book.show.widgets import Explorer, Slider

__all__ = ["check_distance_at", "check_nearest_within", "check_scan_points", "check_to_world", "keep"]
__all__ += ["late_clock_explorer", "scrub_explorer", "show_source", "turn_explorer"]

# ---- everything that the robot knows at one moment

PANELS = (
    (0.1, 0.13, 0.42, 0.8),
    (0.58, 0.62, 0.4, 0.31),
    (0.63, 0.37, 0.35, 0.16),
    (0.63, 0.13, 0.35, 0.16),
)


def at_rest_and_moving(recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (s from the first encoder reading), speed (m/s) and yaw rate (rad/s), means over tenths of a second."""
    encoders, imu = recording.wheels_and_gyro()
    edges = np.arange(imu.t[0], imu.t[-1], 0.1)
    speed = np.diff(wheel_distance(encoders, recording.robot.encoders, edges)) / 0.1
    turned = np.cumsum(imu.angular_velocity[:, 2] * np.diff(imu.t, prepend=imu.t[0]))
    return edges[:-1] + 0.05 - encoders.t[0], speed, np.diff(np.interp(edges, imu.t, turned)) / 0.1


def scan_at(recording: Recording, time: float) -> np.ndarray:
    """The points ``(M, 2)`` of the scan nearest to a time (s from the first encoder reading), in the body frame."""
    scans, t0 = recording.scans(), recording.wheels_and_gyro()[0].t[0]
    return scan_points(scans.ranges[nearest_stamp(scans.t, np.array([t0 + time]))[0]], recording.robot.lidar)


def image_at(recording: Recording, time: float) -> tuple[np.ndarray, float]:
    """The stored colour image nearest in time, every second pixel, and how much later it was taken (s)."""
    camera, t0 = recording.camera, recording.wheels_and_gyro()[0].t[0]
    assert camera is not None
    stored = camera.rgb_t[camera.rgb_index]
    j = nearest_stamp(stored, np.array([t0 + time]))[0]
    return camera.read_rgb(int(camera.rgb_index[j]))[::2, ::2], float(stored[j] - t0 - time)


def draw_scrub(recording: Recording, curves: tuple, image_at: Callable, time: float) -> Figure:
    """Scan, colour image, wheels and gyro around one moment; the scan with "ahead" at the top."""
    figure, grid = sheet(5.2, 2, 2)
    figure.set_layout_engine("none")  # placed by hand: looking for room takes longer than drawing
    scan, camera, wheels, gyro = grid.ravel()
    for axes, place in zip(grid.ravel(), PANELS, strict=True):
        axes.set_position(place)
    draw_scan(scan, scan_at(recording, time)[:, ::-1])  # y across, x up
    draw_pose(scan, (0.0, 0.0, np.pi / 2), length=0.8)
    scan.set(xlim=(5, -5), ylim=(-3, 7), aspect="equal", xticks=(4, 0, -4), title=f"LiDAR at {time:.0f} s")
    scan.set(xlabel="left, y [m]", ylabel="ahead, x [m]")
    camera.imshow(image_at(time)[0], interpolation="bilinear")
    camera.set(xticks=(), yticks=(), title="camera")
    camera.grid(False)
    t, speed, yaw_rate = curves
    for axes, values, name, high in (
        (wheels, speed, "wheels [m/s]", 1.5),
        (gyro, yaw_rate, "gyro [rad/s]", 1.7),
    ):
        axes.plot(t, values, color=COLOURS["odometry"], linewidth=1.0)
        axes.axvline(time, color=COLOURS["truth"], linewidth=1.5)
        axes.set(
            title=name, xlim=(0, 125), xticks=(0, 60, 120), ylim=(-0.1 if axes is wheels else -high, high)
        )
    wheels.tick_params(labelbottom=False)
    gyro.set_xlabel("time [s]")
    return figure


def describe_scrub(recording: Recording, curves: tuple, image_at: Callable, time: float) -> str:
    """The same in words."""
    t, speed, yaw_rate = curves
    k, reach, later = np.argmin(np.abs(t - time)), np.hypot(*scan_at(recording, time).T), image_at(time)[1]
    return f"""At {time:.0f} s: wheels {speed[k]:.2f} m/s, gyro {yaw_rate[k]:+.2f} rad/s, nearest LiDAR point
    {reach.min():.1f} m away, farthest {reach.max():.1f} m; the image shown was taken {abs(1e3 * later):.0f} ms
    {"later" if later > 0 else "earlier"}."""


def scrub_explorer(recording: Recording) -> Explorer:
    """One slider: the time; a play button runs through the drive."""
    times = np.round(np.linspace(8.0, 116.0, 13), 1).tolist()
    images = {time: image_at(recording, time) for time in times}
    view = recording, at_rest_and_moving(recording), images.__getitem__
    return Explorer(
        partial(draw_scrub, *view),
        [Slider("time", times, 6, "Time", "s", ".0f")],
        title="Everything the robot knows",
        alt=partial(describe_scrub, *view),
        play="time",
    )


# ---- a turn on the spot, in a small room with a thin round post

ROOM = (-1.0, 3.0, -1.0, 2.0)  # m: x_min, x_max, y_min, y_max
POST = (2.0, 1.2, 0.06)  # m: x, y, radius
PLACE = (0.6, 0.3)  # m, where the robot turns
BEAMS = np.deg2rad(np.arange(-135.0, 135.1, 2.0))
WAYS = ("right", "no lever arm", "lever arm on y", "inverse pose")


def room_ranges(sensor: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Exact distances ``(M,)`` from ``sensor (2,)`` along ``directions (M,)`` rad to the walls or the post."""
    d = np.column_stack([np.cos(directions), np.sin(directions)])
    x_min, x_max, y_min, y_max = ROOM
    with np.errstate(divide="ignore"):
        to_x = np.where(d[:, 0] > 0, x_max - sensor[0], sensor[0] - x_min) / np.abs(d[:, 0])
        to_y = np.where(d[:, 1] > 0, y_max - sensor[1], sensor[1] - y_min) / np.abs(d[:, 1])
    to_post = np.subtract(POST[:2], sensor)
    along = d @ to_post
    inside = POST[2] ** 2 - (to_post @ to_post - along**2)
    meets = (inside >= 0) & (along > 0)
    return np.where(meets, along - np.sqrt(np.maximum(inside, 0.0)), np.minimum(to_x, to_y))


def turn_points(way: str, turned_deg: float) -> np.ndarray:
    """All end points ``(M, 2)`` of the scans of a turn on the spot, brought to the world in one of ``WAYS``."""
    arm = np.array(LidarModel().position_b[:2])
    assumed = {"no lever arm": np.zeros(2), "lever arm on y": arm[::-1]}.get(way, arm)
    points = []
    for heading in np.deg2rad(np.arange(0.0, turned_deg + 1.0, 15.0)):
        pose = np.array([*PLACE, heading])
        r = room_ranges(transform_points(pose, arm[None])[0], BEAMS + heading)
        points_b = assumed + np.column_stack([r * np.cos(BEAMS), r * np.sin(BEAMS)])
        points.append(transform_points(invert(pose) if way == "inverse pose" else pose, points_b))
    return np.concatenate(points)


def draw_room(axes: Axes) -> None:
    """The walls and the post, as they are."""
    x_min, x_max, y_min, y_max = ROOM
    corners = [x_min, x_max, x_max, x_min, x_min], [y_min, y_min, y_max, y_max, y_min]
    axes.plot(*corners, color=COLOURS["unknown"], lw=5)
    around = np.linspace(0, 2 * np.pi, 60)
    x, y = POST[0] + POST[2] * np.cos(around), POST[1] + POST[2] * np.sin(around)
    axes.plot(x, y, color=COLOURS["unknown"], lw=4)


def draw_turn(way: str, turned: float) -> Figure:
    """The whole room, and the post close up, as the robot draws them while it turns."""
    points = turn_points(way, turned)
    figure, (room, post) = sheet(4.4, 1, 2)
    figure.set_layout_engine("none")
    for axes, place, size in ((room, (0.09, 0.14, 0.54, 0.77), 7), (post, (0.72, 0.14, 0.27, 0.77), 20)):
        axes.set_position(place)
        draw_room(axes)
        draw_scan(axes, points, size)
        plan(axes)
    draw_pose(room, (*PLACE, np.deg2rad(turned)), length=0.5)
    room.set(xlim=(-1.8, 3.8), ylim=(-1.8, 2.8), title=f"turned by {turned:.0f}°")
    post.set(xlim=(1.65, 2.35), ylim=(0.85, 1.55), title="the post", ylabel="")
    post.set(xticks=(1.8, 2.2), yticks=(1.0, 1.4))
    return figure


def describe_turn(way: str, turned: float) -> str:
    """The same in words: how far the walls are smeared."""
    x, y = turn_points(way, turned).T
    beyond = max(x.max() - ROOM[1], ROOM[0] - x.min(), y.max() - ROOM[3], ROOM[2] - y.min())
    return f"""A room with a post, drawn ({way}) by a robot that has turned on the spot by {turned:.0f} degrees.
    Points lie up to {100 * max(beyond, 0.0):.0f} cm beyond the walls."""


def turn_explorer() -> Explorer:
    """What is wrong, and how far the robot has turned."""
    controls = [
        Slider("way", WAYS, 1, "Drawn with"),
        Slider("turned", (0.0, 45.0, 90.0, 180.0, 360.0), 0, "Turned by", "deg", "g"),
    ]
    return Explorer(draw_turn, controls, title="A turn on the spot", alt=describe_turn, play="turned")


# ---- scans drawn from the pose of another moment

STRETCHES = {"straight": 78.0, "turn": 86.4}
"""Two moments of ``hall``, s from the first encoder reading: down a corridor, and in its fastest turn."""
AROUND = 0.1 * np.arange(-4, 4)


def shifted_scans(recording: Recording, moment: float, offset: float) -> np.ndarray:
    """Points ``(M, 2)`` of eight scans around a moment, each drawn from the pose ``offset`` s after its stamp."""
    scans, truth, points = recording.scans(), recording.true_path(), []
    for i in nearest_stamp(scans.t, recording.wheels_and_gyro()[0].t[0] + moment + AROUND):
        points_b = scan_points(scans.ranges[i], recording.robot.lidar)[::5]
        points.append(transform_points(truth.at(scans.t[i] + offset), points_b))
    return np.concatenate(points)


def spread(drawn: np.ndarray, right: np.ndarray) -> float:
    """How far (m, median) a drawn point lies from the nearest of the right ones; every third is asked."""
    dx, dy = (np.subtract.outer(drawn[::3, k], right[:, k]) for k in (0, 1))
    return float(np.median(np.sqrt((dx**2 + dy**2).min(axis=1))))


def draw_late_clock(recording: Recording, right: dict[str, np.ndarray], offset: float) -> Figure:
    """A straight stretch and a turn with the same clock offset (ms), over where the points belong."""
    start, truth = recording.wheels_and_gyro()[0].t[0], recording.true_path()
    figure, row = sheet(4.1, 1, 2)
    figure.set_layout_engine("none")
    for k, (axes, (name, moment)) in enumerate(zip(row, STRETCHES.items(), strict=True)):
        axes.set_position((0.1 + 0.5 * k, 0.15, 0.39, 0.76))
        axes.scatter(*right[name].T, s=22, color=COLOURS["unknown"], linewidths=0)
        points = shifted_scans(recording, moment, offset / 1e3)
        draw_scan(axes, points)
        x, y = truth.at(start + moment)[:2]
        plan(axes, f"{name}: {100 * spread(points, right[name]):.0f} cm")
        axes.set(xlim=(x - 3.5, x + 3.5), ylim=(y - 3.5, y + 3.5))
    row[1].set_ylabel("")
    return figure


def describe_late_clock(recording: Recording, right: dict[str, np.ndarray], offset: float) -> str:
    """The same in words."""
    words = [
        f"{name}: in the median a point lies "
        f"{100 * spread(shifted_scans(recording, moment, offset / 1e3), right[name]):.1f} cm off the walls"
        for name, moment in STRETCHES.items()
    ]
    return f"Eight scans drawn with stamps wrong by {offset:.0f} ms. {'; '.join(words)}."


def late_clock_explorer(recording: Recording) -> Explorer:
    """One slider: by how much the LiDAR's clock is wrong."""
    right = {name: shifted_scans(recording, moment, 0.0) for name, moment in STRETCHES.items()}
    offset = Slider("offset", (0, 20, 50, 100, 150, 200), 0, "Clock offset", "ms", "g", (-300, 300, 5))
    return Explorer(
        partial(draw_late_clock, recording, right),
        [offset],
        title="Scans with a late clock",
        alt=partial(describe_late_clock, recording, right),
    )
