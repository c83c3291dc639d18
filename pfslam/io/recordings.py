"""A whole drive in one ``.npz`` file of plain numbers: what ``save`` writes, ``load`` reads back bit for bit.

The names of the arrays are those of the attributes: ``lidar.ranges`` is ``recording.lidar.ranges``, and
``robot.lidar.sweep`` is ``recording.robot.lidar.sweep``. A stream that the recording lacks has no arrays. An image is
kept as the bytes of a PNG file under its index, such as ``camera.rgb.12``. The three texts (``name``; ``notes``, one a
line; ``dropped``, lines of a count and its reason) are kept as their UTF-8 bytes, so that no array holds objects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError, naming_source
from pfslam.io.files import decode_png, encode_png, read_npz, write_npz
from pfslam.io.loading import check_size, stamps
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, LidarScans, Recording, RgbdStream
from pfslam.sensors import RgbdModel, RobotModel
from pfslam.settings import changed, flat, plain

FORMAT = 1
"""The number of this layout, in the array ``format``."""
STREAMS: dict[str, tuple[type, tuple[str, ...]]] = {
    "encoders": (Encoders, ("t", "counts")),
    "imu": (Imu, ("t", "angular_velocity", "acceleration_g")),
    "odometry": (Trajectory, ("t", "poses")),
    "lidar": (LidarScans, ("t", "ranges")),
    "truth": (Trajectory, ("t", "poses")),
}
"""Streams of numbers: their types, and the names of their arrays."""
CAMERA = ("disparity_t", "rgb_t", "disparity_index", "rgb_index")
TEXTS = ("name", "notes", "dropped")
NONE = np.zeros(0, dtype=int)


def save(
    recording: Recording, path: str | Path, *, images: bool = True, progress: Callable | None = None
) -> None:
    """Write a recording into one ``.npz`` file, which ``load`` reads back as it was.

    ``images=False`` leaves the pictures out and keeps their stamps; ``progress`` wraps the list of what is written. The
    file appears when it is whole. Raises ``DataError`` for a name that does not end in ``.npz``.
    """
    if Path(path).suffix != ".npz":
        raise DataError(path, "file name", Path(path).suffix or "no extension", "a name that ends in .npz")
    write_npz(path, progress or iter, **dict(_arrays(recording, images)))


def _arrays(recording: Recording, images: bool) -> Iterator[tuple[str, Any]]:
    """List the arrays of the file by name; of pictures, which are many, what makes them when they are written."""
    dropped = "\n".join(f"{count} {reason}" for reason, count in recording.dropped.items())
    texts = {"name": recording.name, "notes": "\n".join(recording.notes), "dropped": dropped}
    yield "format", FORMAT
    yield from ((key, np.frombuffer(text.encode(), dtype=np.uint8)) for key, text in texts.items())
    yield from ((f"robot.{key}", value) for key, value in _robot_values(recording.robot))
    for stream, (_, names) in STREAMS.items():
        if (part := getattr(recording, stream)) is not None:
            yield from ((f"{stream}.{name}", getattr(part, name)) for name in names)
    if (camera := recording.camera) is not None:
        kept = camera if images else replace(camera, disparity_index=NONE, rgb_index=NONE)
        yield from ((f"camera.{name}", getattr(kept, name)) for name in CAMERA)
        for kind, read in (("disparity", camera.read_disparity), ("rgb", camera.read_rgb)):
            for k in getattr(kept, f"{kind}_index").tolist():
                yield f"camera.{kind}.{k}", lambda read=read, k=k: encode_png(read(k))


def _robot_values(robot: RobotModel) -> Iterator[tuple[str, Any]]:
    """Yield the robot's settings by dotted name."""
    return ((key, value) for key, value in flat(plain(robot)) if key.rpartition(".")[2] != "kind")


def load_recording(path: str | Path) -> Recording:
    """Read a recording that ``save`` wrote; pictures are read one at a time, when they are asked for.

    Arrays by other names are not looked at, and settings of the robot that are not there have their defaults. Raises
    ``DataError`` naming the array that cannot be used.
    """
    path = Path(path)
    layout = [f"{stream}.{name}" for stream, (_, names) in STREAMS.items() for name in names]
    layout += [f"camera.{name}" for name in CAMERA]
    settings = [f"robot.{key}" for key, _ in _robot_values(RobotModel())]
    data = read_npz(path, ("format",), (*TEXTS, *layout, *settings))
    if data["format"].shape != () or data["format"] != FORMAT:
        raise DataError(path, "format", data["format"], f"the number {FORMAT}")
    given = {key.removeprefix("robot."): data[key].tolist() for key in settings if key in data}
    robot = changed(RobotModel(), given, path, "robot.")
    parts = {stream: _stream(path, data, stream) for stream in STREAMS}
    texts = {key: _text(path, data, key) for key in TEXTS}
    notes = tuple(texts["notes"].split("\n")) if texts["notes"] else ()
    camera, dropped = _camera(path, data, robot.camera), _counts(path, texts["dropped"])
    name = texts["name"] or path.stem
    with naming_source(path):
        return Recording(name, robot, camera=camera, dropped=dropped, notes=notes, **parts)


def _text(path: Path, data: Mapping[str, np.ndarray], key: str) -> str:
    value = data.get(key, np.zeros(0, dtype=np.uint8))
    try:
        if value.dtype != np.uint8 or value.ndim != 1:
            raise ValueError
        return value.tobytes().decode()
    except ValueError:
        raise DataError(path, key, f"{value.dtype} of shape {value.shape}", "the bytes of a text") from None


def _counts(path: Path, text: str) -> dict[str, int]:
    """Read lines of a count and its reason."""
    lines = (line.partition(" ") for line in text.split("\n") if line)
    try:
        return {reason: int(count) for count, _, reason in lines}
    except ValueError:
        raise DataError(path, "dropped", repr(text), "lines of a count and its reason") from None


def _stream(path: Path, data: Mapping[str, np.ndarray], stream: str) -> Any:
    """Read one stream, or None if none of its arrays is there."""
    kind, names = STREAMS[stream]
    held = [name for name in names if f"{stream}.{name}" in data]
    if not held:
        return None
    if missing := [name for name in names if name not in held]:
        raise DataError(path, stream, ", ".join(held), f"an array named {stream}.{missing[0]} as well")
    arrays = {name: data[f"{stream}.{name}"] for name in names}
    arrays["t"] = stamps(path, arrays["t"], f"{stream}.t")
    for name in names[1:]:
        if arrays[name].dtype.kind not in "fiu":
            raise DataError(path, f"{stream}.{name}", arrays[name].dtype, "numbers")
        if name != "ranges":
            check_size(path, f"{stream}.{name}", arrays[name])
    with naming_source(path, f"{stream}."):
        return kind(**arrays)


def _camera(path: Path, data: Mapping[str, np.ndarray], model: RgbdModel) -> RgbdStream | None:
    held = {name: data[f"camera.{name}"] for name in CAMERA if f"camera.{name}" in data}
    if not held:
        return None
    if missing := [name for name in CAMERA if name not in held]:
        raise DataError(path, "camera", ", ".join(held), f"an array named camera.{missing[0]} as well")
    for kind in ("disparity", "rgb"):
        held[f"{kind}_t"] = stamps(path, held[f"{kind}_t"], f"camera.{kind}_t")
        index, count = held[f"{kind}_index"], len(held[f"{kind}_t"])
        whole = index.ndim == 1 and index.dtype.kind in "iu" and (np.diff(index.astype(float)) > 0).all()
        if not whole or (len(index) and not 0 <= index[0] <= index[-1] < count):
            expected = f"increasing whole numbers from 0 to {count - 1}"
            raise DataError(path, f"camera.{kind}_index", index.ravel()[:4], expected)
    size = (model.height, model.width)
    read_disparity = partial(_read_image, path, "camera.disparity", (*size, 1), np.uint16)
    read_rgb = partial(_read_image, path, "camera.rgb", (*size, 3), np.uint8)
    return RgbdStream(read_disparity=read_disparity, read_rgb=read_rgb, **held)


def _read_image(path: Path, kind: str, shape: tuple[int, int, int], dtype: type, k: int) -> np.ndarray:
    """Read image ``k`` of a stream from the archive; ``shape`` is (height, width, channels)."""
    key = f"{kind}.{int(k)}"
    return decode_png(f"{path}: {key}", read_npz(path, (key,))[key].tobytes(), shape, dtype)
