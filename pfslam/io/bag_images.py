"""Depth and colour images of a ROS bag, read one at a time.

The package works on the disparity of the report's camera, so depth in metres becomes disparity when it is read.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.log import Log
from pfslam.io.messages import Frames, Topic, frame_of, read_topics
from pfslam.recording import RgbdStream
from pfslam.sensors import RgbdModel
from pfslam.texture.floor import disparity_from_depth_image

DEPTHS = {"16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3), "32FC1": ("f4", 1.0)}
"""Encodings of depth: the type of a pixel, and what one of it is in m."""
COLOURS = {"rgb8", "bgr8", "rgba8", "bgra8"}


def load_images(
    log: Log, depth: Topic, rgb: Topic, info: Any, frames: Frames, base: str
) -> tuple[RgbdModel, RgbdStream | None]:
    """Describe the camera and give its images, or count them if they are not to be used."""
    frame = frame_of(depth.contents[0])
    T_bo, K = frames.place(base, frame), (info.k if hasattr(info, "k") else info.K).reshape(3, 3)
    shapes = {(m.height, m.width) for m in (*depth.contents, *rgb.contents, info)}
    unread = {m.encoding for m in depth.contents} - {*DEPTHS} | {m.encoding for m in rgb.contents} - COLOURS
    if len(shapes) > 1 or frame_of(rgb.contents[0]) != frame:
        why = "depth and colour are not registered: sizes or frames differ"
    elif unread:
        why = f"not read: encoding {', '.join(sorted(unread))}"
    elif not (np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0):
        why = "the depth camera is not calibrated: no focal length in its CameraInfo"
    elif T_bo is None:
        why = f"no fixed chain of frames from {base} to {frame}"
    else:
        camera = RgbdModel.registered(info.width, info.height, K, T_bo)
        read = partial(_disparity, log.path, depth, camera), partial(_colours, log.path, rgb)
        return camera, RgbdStream(depth.t, rgb.t, *read, np.arange(len(depth.t)), np.arange(len(rgb.t)))
    for topic in (depth, rgb):
        log.leave_out(f"images on {topic.name} ({why})", len(topic.t))
    return RgbdModel(), None


def _disparity(path: Path, topic: Topic, camera: RgbdModel, k: int) -> np.ndarray:
    """Read depth image ``k`` as disparity ``(H, W)`` uint16."""
    dtype, unit = DEPTHS[topic.contents[k].encoding]
    order = ">" if topic.contents[k].is_bigendian else "<"
    return disparity_from_depth_image(unit * _pixels(path, topic, k, order + dtype, 1)[..., 0], camera)


def _colours(path: Path, topic: Topic, k: int) -> np.ndarray:
    """Read colour image ``k`` as ``(H, W, 3)`` uint8, red first."""
    letters = topic.contents[k].encoding.removesuffix("8")
    pixels = _pixels(path, topic, k, "u1", len(letters))
    return np.ascontiguousarray(pixels[..., [letters.index(letter) for letter in "rgb"]])


def _pixels(path: Path, topic: Topic, k: int, dtype: str, channels: int) -> np.ndarray:
    """Read the pixels ``(H, W, channels)`` of image ``k``; ``DataError`` if it is damaged."""
    m, arrived = topic.contents[k], topic.arrived[k]
    found = read_topics(path, [topic.name], at=arrived)[topic.name].contents
    try:
        data = next(message.data for message in found if message.header == m.header)
        rows = data[: m.height * m.step].reshape(m.height, m.step)
        used = np.ascontiguousarray(rows[:, : m.width * channels * np.dtype(dtype).itemsize])
        return used.view(dtype).reshape(m.height, m.width, channels)
    except (ValueError, StopIteration) as error:
        place = f"{topic.name} at {arrived:.3f}"
        raise DataError(path, place, f"{type(error).__name__}: {error}", "a whole image") from error
