"""Chapter 00, the streams: when each instrument spoke, what its numbers are, and how they are paired."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.errors import DataError
from pfslam.motion import wheel_distance
from pfslam.recording import Recording, RgbdStream, nearest_stamp
from pfslam.sensors import scan_points
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.widgets import Explorer, Slider

STREAM_COLOURS = ("odometry", "odometry", "hits", "highlight", "highlight")
SEEN_TO = 5.0  # m to either side that the scan panel shows
PANELS = (
    (0.13, 0.48, 0.35, 0.45),
    (0.55, 0.48, 0.44, 0.45),
    (0.13, 0.12, 0.33, 0.22),
    (0.63, 0.12, 0.33, 0.22),
)


def camera_of(recording: Recording) -> RgbdStream:
    """Return the recording's camera; ``DataError`` where the robot had none."""
    if recording.camera is None:
        raise DataError(recording.name, "camera", "no images", "a recording with a camera")
    return recording.camera


def streams(recording: Recording) -> dict[str, np.ndarray]:
    """Return the stamps (s) of every stream, counted from the first encoder reading."""
    (encoders, imu), camera = recording.wheels_and_gyro(), camera_of(recording)
    stamps = {
        "encoders": encoders.t,
        "IMU": imu.t,
        "LiDAR": recording.scans().t,
        "disparity": camera.disparity_t,
        "colour": camera.rgb_t,
    }
    return {name: t - encoders.t[0] for name, t in stamps.items()}


def raster_picture(recording: Recording, start: float = 60.0, seconds: float = 0.25) -> Picture:
    """Draw one tick for every reading of every stream within a quarter of a second."""
    figure, axes = new_figure(5.0, 2.8)
    words = []
    for row, (name, t) in enumerate(streams(recording).items()):
        shown = t[(t >= start) & (t < start + seconds)]
        colour = COLOURS[STREAM_COLOURS[row]]
        axes.vlines((shown - start) * 1e3, -row - 0.35, -row + 0.35, color=colour, linewidth=3)
        words.append(f"{name} {len(shown)}")
    axes.set_yticks(-np.arange(5), list(streams(recording)))
    axes.set(xlabel="time [ms]", xlim=(0, 1e3 * seconds), ylim=(-4.6, 0.6))
    alt = f"""Every reading within {1e3 * seconds:.0f} milliseconds of the drive, one row for each stream. Readings:
    {", ".join(words)}. Hardly two of them stand under one another."""
    return Picture(figure, alt)


# ---- scrub through time


@dataclass(frozen=True, eq=False)
class Scrub:
    """What the side-by-side view needs: times (s from the first encoder reading), curves, images taken once."""

    recording: Recording
    times: np.ndarray
    t: np.ndarray
    speed: np.ndarray
    yaw_rate: np.ndarray
    images: dict[float, tuple[np.ndarray, float]]
    """For each time the nearest stored colour image, every second pixel, and how much later it was taken (s)."""


def scrub(recording: Recording, frames: int = 24, first: float = 8.0, last: float = 116.0) -> Scrub:
    """Read what the view needs; speed and yaw rate are means over tenths of a second."""
    times = np.round(np.linspace(first, last, frames), 1)
    (encoders, imu), t0 = recording.wheels_and_gyro(), recording.wheels_and_gyro()[0].t[0]
    edges = np.arange(imu.t[0], imu.t[-1], 0.1)
    speed = np.diff(wheel_distance(encoders, recording.robot.encoders, edges)) / 0.1
    rate = recording.robot.imu.yaw_rate(imu.angular_velocity)
    bins = np.digitize(imu.t, edges) - 1
    inside = bins < len(speed)
    yaw_rate = np.bincount(bins[inside], rate[inside], len(speed)) / np.bincount(
        bins[inside], minlength=len(speed)
    )
    images = {float(time): _image_at(recording, time + t0) for time in times}
    return Scrub(recording, times, edges[:-1] - t0 + 0.05, speed, yaw_rate, images)


def _image_at(recording: Recording, t: float) -> tuple[np.ndarray, float]:
    """Return the stored colour image nearest in time, at half its size, and how much later it was taken."""
    camera = camera_of(recording)
    stored = camera.rgb_t[camera.rgb_index]
    j = nearest_stamp(stored, np.array([t]))[0]
    return camera.read_rgb(int(camera.rgb_index[j]))[::2, ::2], float(stored[j] - t)


def draw_scrub(view: Scrub, time: float) -> Figure:
    """Draw everything the robot knows around one moment: scan, colour image, wheels and gyro."""
    figure, grid = new_figure(5.0, 5.0, 2, 2)
    figure.set_layout_engine("none")  # placed by hand: looking for room takes longer than drawing
    scan, camera, wheels, gyro = grid.ravel()
    for axes, place in zip(grid.ravel(), PANELS, strict=True):
        axes.set_position(place)
    _draw_scan_ahead(scan, view, time)
    camera.imshow(view.images[time][0], interpolation="bilinear")
    camera.set(xticks=(), yticks=(), title="camera")
    camera.grid(False)
    _draw_curve(wheels, view.t, view.speed, time, "wheels [m/s]", (-0.1, 1.6))
    _draw_curve(gyro, view.t, view.yaw_rate, time, "gyro [rad/s]", (-1.7, 1.7))
    return figure


def _scan_at(view: Scrub, time: float) -> np.ndarray:
    scans, t0 = view.recording.scans(), view.recording.wheels_and_gyro()[0].t[0]
    i = nearest_stamp(scans.t, np.array([t0 + time]))[0]
    return scan_points(scans.ranges[i], view.recording.robot.lidar)


def _draw_scan_ahead(axes: Axes, view: Scrub, time: float) -> None:
    """Draw the scan with "ahead" at the top; the body's y axis points to the left."""
    points = _scan_at(view, time)
    axes.scatter(points[:, 1], points[:, 0], s=3, color=COLOURS["hits"], linewidths=0)
    axes.plot(0, 0, marker="^", markersize=9, color=COLOURS["estimate"])
    axes.set(xlim=(SEEN_TO, -SEEN_TO), ylim=(-0.6 * SEEN_TO, 1.4 * SEEN_TO), aspect="equal")
    axes.set(xticks=(5, 0, -5), xlabel="left, y [m]", ylabel="ahead, x [m]", title=f"LiDAR, {time:.0f} s")


def _draw_curve(axes: Axes, t, values, now: float, label: str, limits: tuple) -> None:
    axes.plot(t, values, color=COLOURS["odometry"], linewidth=1.0)
    axes.axvline(now, color=COLOURS["truth"], linewidth=1.5)
    axes.set(xlabel="time [s]", ylabel=label, ylim=limits, xlim=(0, 125), xticks=(0, 60, 120))


def describe_scrub(view: Scrub, time: float) -> str:
    """Describe the picture of these values in words."""
    k = int(np.argmin(np.abs(view.t - time)))
    reach = np.hypot(*_scan_at(view, time).T)
    later = 1e3 * view.images[time][1]
    return f"""At {time:.0f} s: wheels {view.speed[k]:.2f} m/s, gyro {view.yaw_rate[k]:+.2f} rad/s, nearest LiDAR
    point {reach.min():.1f} m away, farthest {reach.max():.1f} m; the image shown was taken {abs(later):.0f} ms
    {"later" if later > 0 else "earlier"}."""


def scrub_explorer(recording: Recording) -> Explorer:
    """Make the explorer with one slider: the time; a play button runs through the drive."""
    view = scrub(recording)
    return Explorer(
        partial(draw_scrub, view),
        [Slider("time", list(view.times), 12, "Time", "s", ".0f")],
        title="Everything the robot knows",
        alt=partial(describe_scrub, view),
        play="time",
    )


# ---- pairing


def distance_by_pairing(recording: Recording, every: int) -> tuple[float, float]:
    """Return metres from first to last of every ``every``-th scan: by nearest increments, and from the sum."""
    encoders, _ = recording.wheels_and_gyro()
    t, model = recording.scans().t[::every], recording.robot.encoders
    t = t[(t >= encoders.t[0]) & (t <= encoders.t[-1])]
    per_reading = encoders.counts.mean(axis=1) * model.metres_per_count
    nearest = per_reading[nearest_stamp(encoders.t, t[1:])].sum()
    return float(nearest), float(np.diff(wheel_distance(encoders, model, t[[0, -1]]))[0])


def all_stored(camera: RgbdStream) -> RgbdStream:
    """Return the camera with every image that has a stamp marked as stored: to pair stamps without reading images."""
    every = np.arange(len(camera.disparity_t)), np.arange(len(camera.rgb_t))
    return replace(camera, disparity_index=every[0], rgb_index=every[1])


# ---- raw units


def counts_picture(recording: Recording, start: float = 50.0, seconds: float = 4.0) -> Picture:
    """Draw the same four seconds of one wheel, logged in the two ways that exist; which is which is the question."""
    encoders, _ = recording.wheels_and_gyro()
    t = encoders.t - encoders.t[0] - start
    shown = (t >= 0) & (t < seconds)
    counts = encoders.counts[shown, 0]
    figure, axes = new_figure(5.0, 2.9, 1, 2)
    for ax, values, name in zip(axes, (np.cumsum(counts), counts), "AB", strict=True):
        ax.plot(t[shown], values, color=COLOURS["odometry"], marker=".", linewidth=0.8)
        ax.set(xlabel="time [s]", ylabel="counts" if name == "A" else "", title=name, ylim=(0, None))
    alt = f"""Two logs of one wheel over {seconds:.0f} seconds of steady driving. A climbs from
    {counts[0]} to {counts.sum()} counts; B stays on a plateau around {np.median(counts):.0f} counts."""
    return Picture(figure, alt)
