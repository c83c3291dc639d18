"""Messages of a ROS bag, read without ROS: listed, in the order of their stamps, and as numbers and transforms.

The library rosbags, the extra ``ros``, is imported when a bag is opened and not before.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.limits import POSE_LIMIT
from pfslam.io.log import Log
from pfslam.poses import chain_transforms, quaternion_to_rotation

IMAGE, TF, OLD_TF = "sensor_msgs/msg/Image", "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"
INDEX = "metadata.yaml"
SUFFIXES = (".bag", ".mcap", ".db3", ".active", ".zstd")
"""Of the files of bags; one alone that is not closed (.active) or packed (.zstd) is refused."""
NEAR = 1e-6
"""Seconds: what double precision leaves of a time since 1970, and more."""
LATE = 1.0
"""Seconds of more delay than usual, from its stamp to the bag, that a message is called late for."""
EDGE = "translation xyz", "rotation xyzw"
MOVED = 0.01
"""A pair of frames whose transform changes by more than this (m, or in an entry of its rotation) is not fixed."""


@dataclass(frozen=True, eq=False)
class Topic:
    """The messages of one topic: their stamps and when they reached the bag (s), and their contents."""

    name: str
    kind: str
    t: np.ndarray
    arrived: np.ndarray
    contents: np.ndarray

    @classmethod
    def of(cls, name: str, kind: str, rows: Iterable[tuple[float, float, Any]]) -> Topic:
        """Arrange messages, each with its two times."""
        t, arrived, contents = np.array([*rows], dtype=object).reshape(-1, 3).T
        return cls(name, kind, t.astype(float), arrived.astype(float), contents)

    def __getitem__(self, rows: np.ndarray) -> Topic:
        return Topic(self.name, self.kind, self.t[rows], self.arrived[rows], self.contents[rows])

    def keep(self, log: Log, good: Any, why: str, expected: str | None = None) -> Topic:
        """Keep the good ``(K,)`` messages and count the others; ``DataError`` if none is what was expected."""
        good = np.asarray(good, dtype=bool)
        if expected and not good.any():
            raise DataError(log.path, f"{self.name} at {self.t[0]:.3f}", f"only messages {why}", expected)
        log.leave_out(f"messages on {self.name} {why}", ~good)
        return self[good]

    def numbers(self, *vectors: str) -> np.ndarray:
        """Collect the numbers ``(K, n)`` of vectors, each given as its field and its axes: ``"rotation xyzw"``."""
        get = attrgetter(*(f"{name}.{axis}" for name, axes in map(str.split, vectors) for axis in axes))
        return np.array([get(content) for content in self.contents], dtype=float)


def is_bag(path: Path) -> bool:
    """Tell from its name whether a path is a bag: a file of a bag's kind, or a folder that holds such files."""
    names = [entry.name for entry in path.iterdir()] if path.is_dir() else [path.name]
    return any(name == INDEX or Path(name).suffix.lower() in SUFFIXES for name in names)


def read_topics(path: Path, wanted: Collection[str] = (), at: float | None = None) -> dict[str, Topic]:
    """Read the wanted topics of a bag, or list all, without contents, by when their messages reached the bag.

    Of images, the pixels are kept only where one is read alone: what reached the bag ``at`` this time (s).
    """
    try:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        raise DataError(path, "package", f"no {error.name}", "the extra: pip install pfslam[ros]") from error
    is_old, place = path.suffix.lower() == ".bag", "bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_old else Stores.LATEST)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    span = (None, None) if at is None else (int((at - NEAR) * 1e9), int((at + NEAR) * 1e9))
    decode: Any = store.deserialize_ros1 if is_old else store.deserialize_cdr
    try:
        with rosbag1.Reader(path) if is_old else rosbag2.Reader(path) as reader:
            kinds = {c.topic: TF if c.msgtype == OLD_TF else c.msgtype for c in reader.connections}
            rows: dict[str, list[tuple[float, float, Any]]] = {name: [] for name in sorted(kinds)}
            chosen = [c for c in reader.connections if c.topic in wanted]
            for connection, nanoseconds, data in reader.messages(chosen, *span):
                name, arrived = connection.topic, nanoseconds // 10**9 + nanoseconds % 10**9 * 1e-9
                place = f"{name} at {arrived:.3f}"
                content: Any = decode(data, kinds[name]) if chosen else None
                t = stamp(content) if hasattr(content, "header") else arrived
                if chosen and kinds[name] == IMAGE and at is None:
                    content.data = None
                rows[name].append((t, arrived, content))
    except Exception as error:  # the library raises many kinds for a damaged bag
        found = ": ".join(filter(None, (type(error).__name__, str(error))))
        expected = f"a whole ROS bag, closed by its recorder: a file, or a folder with its {INDEX}"
        raise DataError(path, place, found, expected) from error
    return {name: Topic.of(name, kinds[name], rows[name]) for name in rows}


def stamp(message: Any) -> float:
    """Return the time in a message's header, in seconds, rounded once."""
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def frame_of(message: Any) -> str:
    """Return the frame of a message, without the slash that old robots write before it."""
    return message.header.frame_id.lstrip("/")


def ordered(log: Log, topic: Topic) -> Topic:
    """Put messages in the order of their stamps, each stamp once, and speak of what is odd."""
    if not topic.t.any():
        log.notes.append(f"the stamps on {topic.name} are zero: the bag's own time is used")
        topic = replace(topic, t=topic.arrived)
    topic = topic.keep(log, topic.t != 0, "without a stamp", "times")
    delay = topic.arrived - topic.t
    late = np.abs(delay - np.median(delay)) > LATE
    if late.any():
        first = topic.arrived[late.argmax()]
        log.notes.append(f"messages on {topic.name} late or early: {late.sum()}, the first at {first:.3f} s")
    return topic[log.in_order(f"messages on {topic.name}", topic.t)]


def transforms(log: Log, topic: Topic, *vectors: str) -> tuple[Topic, np.ndarray]:
    """Keep the messages whose position and quaternion are a pose, and return the transforms ``(K, 4, 4)``."""
    rows = topic.numbers(*vectors)
    length = np.linalg.norm(np.clip(rows[:, 3:], -2.0, 2.0), axis=1)
    good = (np.abs(rows) < POSE_LIMIT[0]).all(axis=1) & (np.abs(length - 1.0) < 0.01)
    topic = topic.keep(log, good, "that are no poses", "finite numbers, a quaternion of length 1")
    T = np.tile(np.eye(4), (len(topic.t), 1, 1))
    T[:, :3, :3] = quaternion_to_rotation(rows[good, 3:] / length[good, None])
    T[:, :3, 3] = rows[good, :3]
    return topic, T


@dataclass(frozen=True, eq=False)
class Frames:
    """The tree of frames: for each pair (parent, child) its messages and their transforms ``(K, 4, 4)``."""

    pairs: dict[tuple[str, str], tuple[Topic, np.ndarray]]

    @classmethod
    def of(cls, log: Log, topics: Iterable[Topic]) -> Frames:
        """Collect the transforms of TFMessages."""
        rows: dict[tuple[str, str], list[tuple[float, float, Any]]] = {}
        for topic in topics:
            for arrived, message in zip(topic.arrived, topic.contents, strict=True):
                for edge in message.transforms:
                    pair = frame_of(edge), edge.child_frame_id.lstrip("/")
                    rows.setdefault(pair, []).append((stamp(edge), arrived, edge.transform))
        named = {pair: Topic.of(f"/tf ({' -> '.join(pair)})", TF, rows[pair]) for pair in rows}
        return cls({pair: transforms(log, topic, *EDGE) for pair, topic in named.items()})

    def place(self, base: str, frame: str) -> np.ndarray | None:
        """Return the transform ``(4, 4)`` of ``frame`` in ``base``, None if no chain of fixed pairs joins them."""
        fixed = {pair: T[0] for pair, (_, T) in self.pairs.items() if np.abs(T - T[0]).max() <= MOVED}
        return chain_transforms(fixed, base, frame)
