"""Depth and colour images of a ROS bag, read one at a time.

The package works on the disparity of the report's camera; depth in metres becomes one over depth, in whole steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.frames import Frames
from pfslam.io.messages import IMAGE, Log, Messages, Topic, ordered, read_message
from pfslam.recording import RgbdStream
from pfslam.sensors import RgbdModel

INFO = "sensor_msgs/msg/CameraInfo"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
STEP = 1e-4
"""One step of the disparity, in 1/m: 1 mm of depth at 3 m, and the largest value is a depth of 0.15 m."""
NO_READING = 2047
"""The value of a disparity that stands for nothing."""
DEPTHS = {"16UC1": (np.uint16, 1e-3), "mono16": (np.uint16, 1e-3), "32FC1": (np.float32, 1.0)}
"""Encodings of depth: the type of a pixel, and what one of it is in m."""
COLOURS = {"rgb8": (3, (0, 1, 2)), "bgr8": (3, (2, 1, 0)), "rgba8": (4, (0, 1, 2)), "bgra8": (4, (2, 1, 0))}
"""Encodings of colour: bytes of a pixel, and where red, green and blue are."""


def choose_images(
    log: Log, topics: Mapping[str, Topic], depth: str | None, rgb: str | None
) -> tuple[str, str, str] | tuple[()]:
    """Choose the topics of depth, of colour and of the depth camera's description; none if one of them is missing.

    A topic is chosen by its name, or if it is the only one with, or without, the word depth in its name.
    """
    found = [t.name for t in topics.values() if t.kind == IMAGE and len(t.t)]
    chosen = {}
    for option, name, is_depth in (("--depth", depth, True), ("--rgb", rgb, False)):
        fitting = [topic for topic in found if ("depth" in topic.lower()) == is_depth]
        if name is not None:
            fitting = ["/" + name.lstrip("/")]
            if fitting[0] not in found:
                raise DataError(log.path, f"{option} {name}", ", ".join(found) or "none", "a topic of Image")
        if len(fitting) == 1:
            chosen[is_depth] = fitting[0]
    described = chosen.get(True, "").rpartition("/")[0] + "/camera_info"
    whole = (
        len(chosen) == 2
        and described in topics
        and topics[described].kind == INFO
        and len(topics[described].t)
    )
    for topic in topics.values():
        if topic.kind == COMPRESSED or (
            topic.kind == IMAGE and not (whole and topic.name in chosen.values())
        ):
            log.count(f"images on {topic.name}, which are not read", len(topic.t))
    return (chosen[True], chosen[False], described) if whole else ()


def load_images(
    log: Log, streams: list[Messages], frames: Frames, base: str
) -> tuple[RgbdModel, RgbdStream] | None:
    """Describe the camera and give its images, or count them if they are not to be used."""
    depth, rgb, described = streams
    first, colour, info = depth.held[0], rgb.held[0], described.held[0]
    frame = first.header.frame_id.lstrip("/")
    T_bo = np.eye(4) if frame == base else frames.fixed(base, frame)
    shapes = {(m.height, m.width) for m in (*depth.held, *rgb.held)} | {(info.height, info.width)}
    if len(shapes) > 1 or frame != colour.header.frame_id.lstrip("/"):
        why = "depth and colour are not registered: sizes or frames differ"
    elif first.encoding not in DEPTHS or colour.encoding not in COLOURS:
        why = f"the encodings {first.encoding} and {colour.encoding} are not read"
    elif T_bo is None:
        why = f"no fixed chain of frames from {base} to {frame}"
    else:
        camera = _camera(info, T_bo)
        (t, read_disparity), (t_rgb, read_rgb) = (
            _stamped(log, s, f) for s, f in ((depth, disparity), (rgb, colours))
        )
        index, index_rgb = np.arange(len(t)), np.arange(len(t_rgb))
        return camera, RgbdStream(t, t_rgb, read_disparity, read_rgb, index, index_rgb)
    for stream in (depth, rgb):
        log.count(f"images on {stream.topic} ({why})", len(stream.held))
    return None


def _camera(info: Any, T_bo: np.ndarray) -> RgbdModel:
    """Describe a depth camera whose colour image is registered to it, by its intrinsics and its place."""
    k = np.asarray(info.k if hasattr(info, "k") else info.K, dtype=float)
    level = RgbdModel(roll=0.0, pitch=0.0, yaw=0.0, position_b=(0.0, 0.0, 0.0))
    R = T_bo[:3, :3] @ level.T_bo[:3, :3].T
    return RgbdModel(
        width=int(info.width),
        height=int(info.height),
        focal_u=k[0],
        focal_v=k[4],
        skew=k[1],
        centre_u=k[2],
        centre_v=k[5],
        disparity_slope=STEP,
        disparity_offset=0.0,
        depth_scale=1.0,
        rgb_focal=1.0,  # a pixel of depth is the same pixel of colour
        rgb_divisor=1.0,
        rgb_baseline=0.0,
        rgb_offset_u=0.0,
        rgb_offset_v=0.0,
        position_b=tuple(T_bo[:3, 3].tolist()),
        roll=float(np.arctan2(R[2, 1], R[2, 2])),
        pitch=float(-np.arcsin(np.clip(R[2, 0], -1.0, 1.0))),
        yaw=float(np.arctan2(R[1, 0], R[0, 0])),
    )


def _stamped(
    log: Log, stream: Messages, convert: Callable[[Any], np.ndarray]
) -> tuple[np.ndarray, BagImages]:
    """Return the stamps of a stream of images in order, and what reads them."""
    keys = list(zip(stream.arrived, stream.stamped, strict=True))
    t, kept = ordered(log, Messages(stream.topic, stream.stamped, stream.arrived, keys))
    return t, BagImages(log.path, stream.topic, kept, convert)


class BagImages:
    """Reads image k of a topic; ``keys`` are its times of arrival and its stamps, in nanoseconds."""

    def __init__(
        self, path: Path, topic: str, keys: list[tuple[int, int]], convert: Callable[[Any], np.ndarray]
    ):
        self.path, self.topic, self.keys, self.convert = path, topic, keys, convert

    def __call__(self, k: int) -> np.ndarray:
        """Return the pixels of image ``k``; ``DataError`` if it is damaged."""
        arrived, stamped = self.keys[int(k)]
        message = read_message(self.path, self.topic, IMAGE, arrived, stamped)
        try:
            return self.convert(message)
        except (ValueError, KeyError) as error:
            place = f"{self.topic} at {arrived * 1e-9:.3f}"
            raise DataError(self.path, place, f"{type(error).__name__}: {error}", "a whole image") from error


def disparity(message: Any) -> np.ndarray:
    """Turn depth into disparity ``(H, W)`` uint16: one over depth in steps of ``STEP``, 0 where there is none."""
    dtype, unit = DEPTHS[message.encoding]
    depth = (
        unit * _pixels(message, np.dtype(dtype).newbyteorder(">" if message.is_bigendian else "<"), 1)[..., 0]
    )
    seen = np.isfinite(depth) & (depth > 1.0 / (STEP * 65535.0))
    steps = np.round(np.divide(1.0 / STEP, depth, out=np.zeros(depth.shape), where=seen)).astype(np.uint16)
    steps[steps == NO_READING] = NO_READING + 1
    return steps


def colours(message: Any) -> np.ndarray:
    """Arrange colours as ``(H, W, 3)`` uint8, red first."""
    channels, order = COLOURS[message.encoding]
    return np.ascontiguousarray(_pixels(message, np.dtype(np.uint8), channels)[..., list(order)])


def _pixels(message: Any, dtype: np.dtype, channels: int) -> np.ndarray:
    """Cut rows out of the bytes of an image; ``ValueError`` if there are too few."""
    rows = np.asarray(message.data, dtype=np.uint8)[: message.height * message.step]
    used = message.width * channels * dtype.itemsize
    if message.step < used:
        raise ValueError(f"rows of {message.step} bytes, {used} needed")
    rows = np.ascontiguousarray(rows.reshape(message.height, message.step)[:, :used])
    return rows.view(dtype).reshape(message.height, message.width, channels)
