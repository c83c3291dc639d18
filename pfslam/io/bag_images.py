"""Depth and colour images of a ROS bag, read one at a time.

The package works on the disparity of the report's camera; depth in metres becomes one over depth, in whole steps.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.frames import Frames, frame_of
from pfslam.io.messages import Log, Topic, read_topics
from pfslam.recording import RgbdStream
from pfslam.sensors import RgbdModel

INFO = "sensor_msgs/msg/CameraInfo"
STEP = 1e-4
"""One step of the disparity, in 1/m: 1 mm of depth at 3 m, and the largest value is a depth of 0.15 m."""
NO_READING = 2047
"""The value of a disparity that stands for nothing."""
DEPTHS = {"16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3), "32FC1": ("f4", 1.0)}
"""Encodings of depth: the type of a pixel, and what one of it is in m."""
COLOURS = ("rgb8", "bgr8", "rgba8", "bgra8")
REGISTERED: dict[str, Any] = {"disparity_slope": STEP, "disparity_offset": 0.0}
REGISTERED |= dict.fromkeys(("depth_scale", "rgb_focal", "rgb_divisor"), 1.0)
REGISTERED |= dict.fromkeys(("rgb_baseline", "rgb_offset_u", "rgb_offset_v"), 0.0)
"""Constants of a camera with depth in m, and with the same pixel of colour for each pixel of depth."""


def load_images(
    log: Log, depth: Topic, rgb: Topic, info: Any, frames: Frames, base: str
) -> tuple[RgbdModel, RgbdStream] | None:
    """Describe the camera and give its images, or count them if they are not to be used."""
    first, colour = depth.contents[0], rgb.contents[0]
    T_bo = frames.fixed(base, frame_of(first))
    shapes = {(m.height, m.width) for m in (*depth.contents, *rgb.contents, info)}
    if len(shapes) > 1 or frame_of(first) != frame_of(colour):
        why = "depth and colour are not registered: sizes or frames differ"
    elif first.encoding not in DEPTHS or colour.encoding not in COLOURS:
        why = f"the encodings {first.encoding} and {colour.encoding} are not read"
    elif T_bo is None:
        why = f"no fixed chain of frames from {base} to {frame_of(first)}"
    else:
        read = partial(_read, log.path, depth, disparity), partial(_read, log.path, rgb, colours)
        index = np.arange(len(depth.messages)), np.arange(len(rgb.messages))
        return _camera(info, T_bo), RgbdStream(depth.t, rgb.t, *read, *index)
    for topic in (depth, rgb):
        log.count(f"images on {topic.name} ({why})", len(topic.messages))
    return None


def _camera(info: Any, T_bo: np.ndarray) -> RgbdModel:
    """Describe a depth camera whose colour image is registered to it, by its intrinsics and its place."""
    fu, skew, u, _, fv, v = (info.k if hasattr(info, "k") else info.K)[:6].tolist()
    level = RgbdModel(roll=0.0, pitch=0.0, yaw=0.0, position_b=(0.0, 0.0, 0.0))
    R = T_bo[:3, :3] @ level.T_bo[:3, :3].T
    roll, yaw = np.arctan2(R[[2, 1], [1, 0]], R[[2, 0], [2, 0]]).tolist()
    turned = {"roll": roll, "pitch": float(-np.arcsin(np.clip(R[2, 0], -1.0, 1.0))), "yaw": yaw}
    place: dict[str, Any] = {"position_b": tuple(T_bo[:3, 3].tolist())} | turned
    return RgbdModel(info.width, info.height, fu, fv, skew, u, v, **place, **REGISTERED)


def _read(path: Path, topic: Topic, convert: Callable[[Any], np.ndarray], k: int) -> np.ndarray:
    """Read image ``k`` of a topic, its pixels included; ``DataError`` if it is damaged."""
    _, arrived, known = topic.messages[k]
    found = read_topics(path, [topic.name], at=arrived)[topic.name].contents
    try:
        return convert(next(message for message in found if message.header == known.header))
    except (ValueError, KeyError, StopIteration) as error:
        place = f"{topic.name} at {arrived * 1e-9:.3f}"
        raise DataError(path, place, f"{type(error).__name__}: {error}", "a whole image") from error


def disparity(message: Any) -> np.ndarray:
    """Turn depth into disparity ``(H, W)`` uint16: one over depth in steps of ``STEP``, 0 where there is none."""
    dtype, unit = DEPTHS[message.encoding]
    depth = unit * _pixels(message, np.dtype((">" if message.is_bigendian else "<") + dtype), 1)[..., 0]
    seen = np.isfinite(depth) & (depth > 1.0 / (STEP * 65535.0))
    steps = np.round(np.divide(1.0 / STEP, depth, out=np.zeros(depth.shape), where=seen)).astype(np.uint16)
    steps[steps == NO_READING] = NO_READING + 1
    return steps


def colours(message: Any) -> np.ndarray:
    """Arrange colours as ``(H, W, 3)`` uint8, red first."""
    letters = message.encoding.removesuffix("8")
    pixels = _pixels(message, np.dtype(np.uint8), len(letters))
    return np.ascontiguousarray(pixels[..., [letters.index(letter) for letter in "rgb"]])


def _pixels(message: Any, dtype: np.dtype, channels: int) -> np.ndarray:
    """Cut rows out of the bytes of an image; ``ValueError`` if there are too few."""
    rows = message.data[: message.height * message.step].reshape(message.height, message.step)
    used = message.width * channels * dtype.itemsize
    rows = np.ascontiguousarray(rows[:, :used])
    return rows.view(dtype).reshape(message.height, message.width, channels)
