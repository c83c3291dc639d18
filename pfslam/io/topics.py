"""The messages of ROS bags, topic by topic: stamps, and of each type what is used, kept small.

An hour of an IMU is a million messages; as objects they would take some gigabytes. What comes so often is kept as plain
numbers while the bag is read.
"""

from __future__ import annotations

import heapq
from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pfslam.errors import DataError, need
from pfslam.io.files import check_ends
from pfslam.io.loading import Log
from pfslam.io.packed import limit_unpacking

SCAN, CLOUD, IMAGE, IMU = (f"sensor_msgs/msg/{kind}" for kind in ("LaserScan", "PointCloud2", "Image", "Imu"))
ODOMETRY, TF, OLD_TF = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"
INDEX = "metadata.yaml"
MENDED = dict.fromkeys((".bag", ".active"), "`rosbag reindex` mends one that was cut off")
MENDED |= {
    ".mcap": "`mcap recover` mends a file that was cut off, `ros2 bag reindex` writes the folder's index"
}
MENDED |= {
    ".db3": "`sqlite3 FILE .recover` mends a file that was cut off, `ros2 bag reindex` writes the folder's index"
}
"""What mends a bag, by the kind of its files."""
NEAR = 1e-6
"""Seconds: what double precision leaves of a time since 1970, and more."""


def _numbers(*vectors: str) -> Callable[[Any], tuple[float, ...]]:
    """Make what gets the numbers of vectors, each given as its field and its axes: ``"rotation xyzw"``."""
    return attrgetter(*(f"{name}.{axis}" for name, axes in map(str.split, vectors) for axis in axes))


NUMBERS = {
    ODOMETRY: _numbers("pose.pose.position xyz", "pose.pose.orientation xyzw"),
    IMU: _numbers("angular_velocity xyz", "linear_acceleration xyz"),
    TF: _numbers("transform.translation xyz", "transform.rotation xyzw"),
}
"""What is kept of messages that come by the hundred thousand, beside the frames that they name."""
SWEEP = attrgetter("angle_min", "angle_increment", "time_increment", "range_min", "range_max")


class Names(NamedTuple):
    """The frames that a message names: of what it speaks, and what moves there."""

    frame: str
    child: str


class Beams(NamedTuple):
    """What a scan says of its beams: frame, number, angles (rad), time between two (s), and limits of range (m)."""

    frame: str
    number: int
    angle_min: float
    angle_increment: float
    time_increment: float
    range_min: float
    range_max: float


Slicer = Callable[[Any], tuple[Beams, np.ndarray]]
"""Makes a scan of a cloud: its beams, and their ranges ``(beams,)`` float32 (m)."""


@dataclass(frozen=True, eq=False)
class Topic:
    """The messages of one topic: their stamps and when they reached the bag (s), and what is kept of them.

    Of the types in ``NUMBERS`` that is ``rows (K, n)``, and ``Names`` as contents; a TFMessage is one message for each
    of its pairs of frames. Of scans and clouds, ``rows`` are the ranges, ``(K, beams)`` float32, or ``(K,)`` arrays
    where not all have as many, and the contents are ``Beams``.
    """

    name: str
    kind: str
    t: np.ndarray
    arrived: np.ndarray
    contents: np.ndarray
    rows: np.ndarray

    @classmethod
    def joined(cls, name: str, kind: str, parts: Iterable[Topic]) -> Topic:
        """Put the messages of several topics one after the other."""
        parts = tuple(parts)
        if len(parts) == 1:
            return replace(parts[0], name=name, kind=kind)
        columns = zip(*((p.t, p.arrived, p.contents, p.rows) for p in parts), strict=True)
        return cls(name, kind, *map(np.concatenate, columns))

    def __getitem__(self, rows: np.ndarray) -> Topic:
        picked = (column[rows] for column in (self.t, self.arrived, self.contents, self.rows))
        return Topic(self.name, self.kind, *picked)

    def keep(self, log: Log, good: Any, why: str, expected: str | None = None) -> Topic:
        """Keep the good ``(K,)`` messages and count the others; ``DataError`` if none is what was expected."""
        good = np.asarray(good, dtype=bool)
        if expected and not good.any():
            raise DataError(log.path, f"{self.name} at {self.t[0]:.3f}", f"only messages {why}", expected)
        log.leave_out(f"messages on {self.name} {why}", ~good)
        return self if good.all() else self[good]


def list_topics(path: Path) -> dict[str, tuple[str, int]]:
    """List the topics of a bag by name: the type of their messages, and how many there are.

    The index of the bag says so; only where it counts none, as that of an mcap may, are messages looked for.
    """
    with _opened(path, ["bag"]) as (reader, kinds, _):
        count: Counter[str] = Counter()
        for c in reader.connections:
            count[c.topic] += c.msgcount
        if uncounted := [c for c in reader.connections if not count[c.topic]]:
            count.update(c.topic for c, *_ in reader.messages(uncounted))
    return {name: (kinds[name], count[name]) for name in sorted(kinds)}


def read_topics(
    path: Path,
    wanted: Collection[str],
    at: float | None = None,
    progress: Callable | None = None,
    slicer: Slicer | None = None,
) -> dict[str, Topic]:
    """Read topics of a bag, by when their messages reached it.

    Of images, the pixels are kept only where one is read alone: what reached the bag ``at`` this time (s). A
    ``slicer`` makes scans of clouds.
    """
    span = (None, None) if at is None else (int((at - NEAR) * 1e9), int((at + NEAR) * 1e9))
    place = ["bag"]
    with _opened(path, place) as (reader, kinds, decode):
        chosen = [c for c in reader.connections if c.topic in wanted]
        found = {c.topic: Columns(kinds[c.topic], at is not None, slicer) for c in chosen}
        messages = reader.messages(chosen, *span) if chosen else ()
        if progress:
            messages = progress(messages, total=sum(c.msgcount for c in chosen))
        for connection, nanoseconds, data in messages:
            name, arrived = connection.topic, nanoseconds // 10**9 + nanoseconds % 10**9 * 1e-9
            place[:] = [f"{name} at {arrived:.3f}"]
            found[name].add(arrived, decode(data, kinds[name]))
    return {name: found.pop(name).topic(name) for name in sorted(found)}


@contextmanager
def _opened(path: Path, place: list[str]) -> Iterator[tuple[Any, dict[str, str], Callable]]:
    """Open a bag: its reader, the types by topic and what decodes a message; ``place`` is where an error is."""
    need("rosbags", "ros")
    inside = sorted(path.iterdir()) if path.is_dir() else []
    for part in (path, *inside):
        check_ends(part)
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    limit_unpacking()
    # ROS 1 splits a long recording into files that each are a whole bag.
    old = [part for part in inside or [path] if part.suffix.lower() == ".bag"]
    is_old = bool(old) and not (path / INDEX).exists()
    expected = f"a whole ROS bag, closed by its recorder: a file, or a folder with its {INDEX}"
    expected += next(
        (f" ({hint})" for part in (*inside, path) if (hint := MENDED.get(part.suffix.lower()))), ""
    )
    if inside and not is_old and not (path / INDEX).exists():
        raise DataError(path, place[0], f"no {INDEX}", expected)
    store = get_typestore(Stores.ROS1_NOETIC if is_old else Stores.LATEST)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    decode: Any = store.deserialize_ros1 if is_old else store.deserialize_cdr
    try:
        with ExitStack() as opened:
            reader: Any = (
                _Parts([opened.enter_context(rosbag1.Reader(part)) for part in old]) if is_old else None
            )
            reader = reader or opened.enter_context(rosbag2.Reader(path))
            kinds = {c.topic: TF if c.msgtype == OLD_TF else c.msgtype for c in reader.connections}
            yield reader, kinds, decode
    except DataError:
        raise
    except Exception as error:  # the library raises many kinds for a damaged bag
        what = ": ".join(filter(None, (type(error).__name__, str(error))))
        raise DataError(path, place[0], what, expected) from error


class _Parts:
    """The files of one recording of ROS 1, read as one: their messages in the order in which they arrived."""

    def __init__(self, readers: list[Any]):
        self.readers = readers
        self.connections = [c for reader in readers for c in reader.connections]

    def messages(self, chosen: Iterable[Any], *span: Any) -> Iterator[Any]:
        """Yield connection, time of arrival and bytes of the messages of some topics."""
        topics = {c.topic for c in chosen}
        of_each = (
            reader.messages([c for c in reader.connections if c.topic in topics], *span)
            for reader in self.readers
            if any(c.topic in topics for c in reader.connections)  # of none chosen, all would be read
        )
        return heapq.merge(*of_each, key=lambda message: message[1])


class Columns:
    """Messages of one topic while they are read: numbers in plain arrays, whatever else in a list."""

    def __init__(self, kind: str, with_pixels: bool, slicer: Slicer | None):
        self.kind, self.with_pixels, self.slicer = kind, with_pixels, slicer
        self.is_scans = kind in (SCAN, CLOUD)
        self.t, self.arrived, self.rows = array("d"), array("d"), array("f" if self.is_scans else "d")
        self.contents: list[Any] = []
        self.seen: dict[Any, Any] = {}

    def add(self, arrived: float, message: Any) -> None:
        """Keep of a message what will be used."""
        for part in message.transforms if self.kind == TF else (message,):
            self.t.append(stamp_of(part) if hasattr(part, "header") else arrived)
            self.arrived.append(arrived)
            self.contents.append(self._kept(part))

    def _kept(self, message: Any) -> Any:
        if self.kind in NUMBERS:
            self.rows.extend(NUMBERS[self.kind](message))
            names = Names(frame_of(message), getattr(message, "child_frame_id", "").lstrip("/"))
            return self.seen.setdefault(names, names)
        if self.is_scans:
            beams, ranges = self.slicer(message) if self.slicer else _scan(message)
            self.rows.frombytes(ranges.tobytes())
            return self.seen.setdefault(beams, beams)
        if self.kind == IMAGE and not self.with_pixels:
            message.data = None
        return message

    def topic(self, name: str) -> Topic:
        """Arrange what was kept."""
        contents = np.fromiter(self.contents, dtype=object, count=len(self.contents))
        columns = self.t, self.arrived, self.rows
        t, arrived, rows = (np.frombuffer(c, c.typecode) if c else np.zeros(0, c.typecode) for c in columns)
        numbers = [beams.number for beams in self.seen] if self.is_scans else [1]
        if len(set(numbers)) < 2:
            rows = rows.reshape(len(t), len(rows) // max(len(t), 1))
        else:
            ends = np.cumsum([beams.number for beams in contents])
            rows = np.fromiter(np.split(rows, ends[:-1]), dtype=object, count=len(t))
        return Topic(name, self.kind, t, arrived, contents, rows)


def _scan(message: Any) -> tuple[Beams, np.ndarray]:
    """Return the beams of a LaserScan, and their ranges (m)."""
    return Beams(frame_of(message), len(message.ranges), *SWEEP(message)), message.ranges


def stamp_of(message: Any) -> float:
    """Return the time in a message's header, in seconds, rounded once."""
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def frame_of(message: Any) -> str:
    """Return the frame of a message, without the slash that old robots write before it."""
    return message.header.frame_id.lstrip("/")
