"""A whole drive in one ``.npz`` file of plain numbers: what ``save`` writes, ``load`` reads back bit for bit.

The names of the arrays are those of the attributes: ``lidar.ranges`` is ``recording.lidar.ranges``, and
``robot.lidar.sweep`` is ``recording.robot.lidar.sweep``. A stream that the recording lacks has no arrays. An image is
kept as the bytes of a PNG file under its index, such as ``camera.rgb.12``. The three texts (``name``; ``notes``, one a
line; ``dropped``, lines of a count and its reason) are kept as their UTF-8 bytes, so that no array holds objects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError, naming_source
from pfslam.io.files import decode_png, encode_png, read_npz, write_npz
from pfslam.io.loading import check_size, stamps
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, LidarScans, Recording, RgbdStream
from pfslam.sensors import RobotModel
from pfslam.settings import changed, flat, plain

FORMAT = 1
"""The number of this layout, in the array ``format``."""
STREAMS = {
    "encoders": Encoders,
    "imu": Imu,
    "odometry": Trajectory,
    "lidar": LidarScans,
    "camera": RgbdStream,
    "truth": Trajectory,
}
"""The types of the streams, whose fields are the arrays of the file; what reads a picture is no array."""
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
    if recording.camera is not None and not images:
        recording = replace(recording, camera=replace(recording.camera, disparity_index=NONE, rgb_index=NONE))
    write_npz(path, progress or iter, **dict(_arrays(recording)))


def _names(stream: str) -> list[str]:
    """List the names of a stream's arrays."""
    return [field.name for field in fields(STREAMS[stream]) if not field.name.startswith("read_")]


def _arrays(recording: Recording) -> Iterator[tuple[str, Any]]:
    """List the arrays of the file by name; of pictures, which are many, what makes them when they are written."""
    dropped = "\n".join(f"{count} {reason}" for reason, count in recording.dropped.items())
    texts = {"name": recording.name, "notes": "\n".join(recording.notes), "dropped": dropped}
    yield "format", FORMAT
    yield from ((key, np.frombuffer(text.encode(), dtype=np.uint8)) for key, text in texts.items())
    yield from ((f"robot.{key}", value) for key, value in _robot_values(recording.robot))
    for stream in STREAMS:
        if (part := getattr(recording, stream)) is not None:
            yield from ((f"{stream}.{name}", getattr(part, name)) for name in _names(stream))
    if (camera := recording.camera) is not None:
        for kind, read in (("disparity", camera.read_disparity), ("rgb", camera.read_rgb)):
            for k in getattr(camera, f"{kind}_index").tolist():
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
    layout = [f"{stream}.{name}" for stream in STREAMS for name in _names(stream)]
    settings = [f"robot.{key}" for key, _ in _robot_values(RobotModel())]
    data = read_npz(path, ("format",), (*TEXTS, *layout, *settings), partial(_check, path))
    given = {key.removeprefix("robot."): data[key].tolist() for key in settings if key in data}
    robot = changed(RobotModel(), given, path, "robot.")
    size = robot.camera.height, robot.camera.width
    readers = {
        "read_disparity": partial(_read_image, path, "camera.disparity", (*size, 1), np.uint16),
        "read_rgb": partial(_read_image, path, "camera.rgb", (*size, 3), np.uint8),
    }
    parts = {name: _stream(path, data, name, readers if name == "camera" else {}) for name in STREAMS}
    texts = {key: _text(path, data, key) for key in TEXTS}
    notes = tuple(texts["notes"].split("\n")) if texts["notes"] else ()
    dropped = _counts(path, texts["dropped"])
    with naming_source(path):
        return Recording(texts["name"] or path.stem, robot, dropped=dropped, notes=notes, **parts)


def _check(path: Path, name: str, stated: np.ndarray, before: Mapping[str, np.ndarray]) -> None:
    """Raise ``DataError`` for another format, and for readings of which there are not as many as stamps."""
    if name == "format":
        return
    if before["format"].shape != () or before["format"] != FORMAT:
        raise DataError(path, "format", before["format"], f"the number {FORMAT}")
    t = before.get(f"{name.partition('.')[0]}.t")
    if t is not None and (stated.ndim == 0 or len(stated) != t.size):
        found = f"{stated.dtype} of shape {stated.shape}"
        raise DataError(path, name, found, f"one reading for each of {t.size} stamps")


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


def _stream(path: Path, data: Mapping[str, np.ndarray], stream: str, readers: Mapping[str, Callable]) -> Any:
    """Read one stream, or None if none of its arrays is there."""
    held = {name: data[f"{stream}.{name}"] for name in _names(stream) if f"{stream}.{name}" in data}
    if not held:
        return None
    if missing := [name for name in _names(stream) if name not in held]:
        raise DataError(path, stream, ", ".join(held), f"an array named {stream}.{missing[0]} as well")
    for name, values in held.items():
        key = f"{stream}.{name}"
        what, _, last = name.rpartition("_")
        if last == "t":
            held[name] = stamps(path, values, key)
        elif last == "index":
            _check_index(path, key, values, len(held[f"{what}_t"]))
        elif values.dtype.kind not in "fiu":
            raise DataError(path, key, values.dtype, "numbers")
        elif name != "ranges":
            check_size(path, key, values)
    with naming_source(path, f"{stream}."):
        return STREAMS[stream](**held, **readers)


def _check_index(path: Path, key: str, index: np.ndarray, count: int) -> None:
    """Check which of ``count`` pictures are kept."""
    whole = index.ndim == 1 and index.dtype.kind in "iu" and (np.diff(index.astype(float)) > 0).all()
    if not whole or (len(index) and not 0 <= index[0] <= index[-1] < count):
        raise DataError(path, key, index.ravel()[:4], f"increasing whole numbers from 0 to {count - 1}")


def _read_image(path: Path, kind: str, shape: tuple[int, int, int], dtype: type, k: int) -> np.ndarray:
    """Read image ``k`` of a stream from the archive; ``shape`` is (height, width, channels)."""
    key = f"{kind}.{int(k)}"
    return decode_png(f"{path}: {key}", read_npz(path, (key,))[key].tobytes(), shape, dtype)
