"""What is used of a drive, and how: a span of time, ranges and beams; a clock, a direction and a scale put right."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import Trajectory
from pfslam.recording import LidarScans, Recording, RgbdStream, chosen
from pfslam.settings import changed

PART = "scans before --from or after --until"
"""Why scans were left out of a recording that is a part of a drive, in its ``dropped``; a file keeps that, too."""
ROUND_OFF = 1e-3
"""Degrees: beams lie 0.018 apart or more, and angles in single precision are off by 1e-5."""


def select(
    recording: Recording,
    *,
    start: float | None = None,
    until: float | None = None,
    limits: Sequence[float] | None = None,
    masks: Sequence[Sequence[float]] = (),
    delay: float = 0.0,
    yaw: float = 0.0,
    scale: float = 1.0,
) -> Recording:
    """Return a recording of what is wanted; scans and ranges that are left out are counted in its ``dropped``.

    ``start`` and ``until`` are seconds after the first reading of the LiDAR (without one, of the odometry), ``limits``
    the least and the largest range (m) that are believed, and ``masks`` sectors (degrees in the LiDAR's frame, counted
    counter-clockwise from the first angle to the second, both included) whose beams are not. Scans were taken ``delay``
    s before their stamps, the LiDAR looks ``yaw`` degrees to the left of what is stated, and the robot drives ``scale``
    times as far as its odometry says. Angles of masks are those that were stated. Raises ``DataError`` where nothing
    would be left, and for numbers that no robot has.
    """
    stated = {"--scan-delay": (delay, abs(delay) < np.inf, "seconds")}
    stated["--lidar-yaw"] = yaw, abs(yaw) <= 360.0, "degrees, at most one turn"
    stated["--odometry-scale"] = scale, 0.0 < scale < np.inf, "a factor above 0"
    for option, (value, possible, expected) in stated.items():
        if not possible:
            raise DataError(recording.name, option, value, expected)
    if delay:
        scans = recording.scans()
        recording = replace(recording, lidar=LidarScans(scans.t - delay, scans.ranges))
    if start is not None or until is not None:
        recording = _within(recording, start or 0.0, np.inf if until is None else until)
    if limits is not None:
        recording = _with_lidar(recording, "--range ", range_min=limits[0], range_max=limits[1])
    recording = _masked(recording, masks) if masks else recording
    if yaw:
        low, high = np.radians(yaw) + [recording.robot.lidar.angle_min, recording.robot.lidar.angle_max]
        recording = _with_lidar(recording, "--lidar-yaw ", angle_min=low, angle_max=high)
    return recording if scale == 1.0 else _scaled(recording, scale)


def _with_lidar(recording: Recording, option: str, **values: Any) -> Recording:
    lidar = changed(recording.robot.lidar, values, recording.name, option)
    return replace(recording, robot=replace(recording.robot, lidar=lidar))


def _scaled(recording: Recording, scale: float) -> Recording:
    """Let every way of the odometry be so many times as long; its turns stay."""
    if recording.motion == "scans":
        raise DataError(recording.name, "--odometry-scale", scale, "a drive with odometry")
    if (odometry := recording.odometry) is not None:
        poses = odometry.poses * [scale, scale, 1.0]
        return replace(recording, odometry=Trajectory(odometry.t, poses))
    robot = recording.robot
    longer = {"metres_per_count": scale * robot.encoders.metres_per_count}
    wheels = changed(robot.encoders, longer, recording.name, "--odometry-scale ")
    return replace(recording, robot=replace(robot, encoders=wheels))


def _within(recording: Recording, start: float, until: float) -> Recording:
    """Keep what was measured from ``start`` to ``until`` (s), and the motion up to the readings on either side."""
    parts = recording.streams()
    clock = parts.get("lidar") or parts.get("odometry") or parts["encoders"]
    begin, end = clock.t[0] + start, clock.t[0] + until
    inside = int(np.count_nonzero((clock.t >= begin) & (clock.t <= end)))
    if inside < 2 or not start < until:
        span = f"a span of 0 to {clock.t[-1] - clock.t[0]:.3f} s"
        raise DataError(recording.name, "--from, --until", f"{start:g} to {until:g} s", span)
    left_out = recording.dropped.get(PART, 0) + (len(clock.t) - inside) * ("lidar" in parts)
    kept = {name: _cut(part, begin, end, around=name != "lidar") for name, part in parts.items()}
    camera = recording.camera and _images_within(recording.camera, begin, end)
    return replace(recording, **kept, camera=camera, dropped=_with(recording.dropped, {PART: left_out}))


def _cut(stream: Any, begin: float, end: float, around: bool) -> Any:
    """Cut a stream to the readings between two times, and with ``around`` to the last before and the first after."""
    t = stream.t
    if around:
        begin = t[max(int(np.searchsorted(t, begin, side="right")) - 1, 0)]
        end = t[min(int(np.searchsorted(t, end)), len(t) - 1)]
    return chosen(stream, (t >= begin) & (t <= end))


def _images_within(camera: RgbdStream, begin: float, end: float) -> RgbdStream | None:
    """Cut both streams of images to a span; where one has no image in it, nothing is left."""
    kept = {}
    for kind in ("disparity", "rgb"):
        t, index = getattr(camera, f"{kind}_t"), getattr(camera, f"{kind}_index")
        first, last = int(np.searchsorted(t, begin)), int(np.searchsorted(t, end, side="right"))
        kept[f"{kind}_t"] = t[first:last]
        kept[f"{kind}_index"] = index[(index >= first) & (index < last)] - first
        kept[f"read_{kind}"] = partial(_read_from, getattr(camera, f"read_{kind}"), first)
    return RgbdStream(**kept) if all(len(kept[key]) for key in ("disparity_t", "rgb_t")) else None


def _read_from(read: Callable[[int], np.ndarray], first: int, k: int) -> np.ndarray:
    return read(first + int(k))


def _masked(recording: Recording, masks: Sequence[Sequence[float]]) -> Recording:
    """Set the ranges of masked beams to NaN, which no filter takes for a measurement."""
    scans, angles = recording.scans(), np.degrees(recording.robot.lidar.angles)
    masked = np.zeros(len(angles), dtype=bool)
    for low, high in masks:
        if not (abs(low) <= 360.0 and abs(high) <= 360.0):
            raise DataError(recording.name, "--mask", f"{low:g} to {high:g}", "degrees, at most one turn")
        width = (high - low) % 360.0 or 360.0 * (high != low)
        masked |= (angles - low + ROUND_OFF) % 360.0 <= width + 2.0 * ROUND_OFF
    if not masked.any() or masked.all():
        ends = f"some of the beams from {angles[0]:.1f} to {angles[-1]:.1f} deg"
        raise DataError(recording.name, "--mask", f"{masked.sum()} beams", ends)
    left_out = {f"ranges of the {masked.sum()} beams under --mask": int(masked.sum()) * len(scans.t)}
    lidar = replace(scans, ranges=np.where(masked, np.float32(np.nan), scans.ranges))
    return replace(recording, lidar=lidar, dropped=_with(recording.dropped, left_out))


def _with(dropped: dict[str, int], more: dict[str, int]) -> dict[str, int]:
    return dropped | {reason: count for reason, count in more.items() if count}
