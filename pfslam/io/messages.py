"""Messages of a ROS bag: listed, read and put in order by their stamps, without ROS.

The library rosbags, the extra ``ros``, is imported when a bag is opened and not before.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError

IMAGE, TF, OLD_TF = "sensor_msgs/msg/Image", "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"
INDEX = "metadata.yaml"
SUFFIXES = (".bag", ".mcap", ".db3", ".active", ".zstd")
"""Of the files of bags; the last two are those of a bag that is not closed, or packed, and are refused."""
LATE, LONG_GAP = 1.0, 0.5
"""Seconds of more delay than usual, and of silence (five usual intervals at least), that are spoken of."""


@dataclass(frozen=True, eq=False)
class Topic:
    """The messages of one topic: when they were stamped and when they reached the bag (ns), and their contents."""

    name: str
    kind: str
    stamped: np.ndarray
    arrived: np.ndarray
    contents: np.ndarray

    @classmethod
    def of(cls, name: str, kind: str, rows: Iterable[tuple[int, int, Any]] = ()) -> Topic:
        """Arrange messages, each with its two times."""
        stamped, arrived, contents = np.array([*rows], dtype=object).reshape(-1, 3).T
        return cls(name, kind, stamped.astype(np.int64), arrived.astype(np.int64), contents)

    @property
    def t(self) -> np.ndarray:
        """The stamps ``(K,)`` in seconds, rounded once."""
        return self.stamped // 10**9 + self.stamped % 10**9 * 1e-9

    def __getitem__(self, rows: np.ndarray) -> Topic:
        kept = (self.stamped[rows], self.arrived[rows], self.contents[rows])
        return Topic(self.name, self.kind, *kept)

    def numbers(self, *vectors: str) -> np.ndarray:
        """Collect the numbers ``(K, n)`` of vectors, each given as its field and its axes: ``"rotation xyzw"``."""
        get = attrgetter(*(f"{name}.{axis}" for name, axes in map(str.split, vectors) for axis in axes))
        return np.array([get(content) for content in self.contents], dtype=float)


@dataclass(eq=False)
class Log:
    """Collects what is left out, by reason, and what is to be said."""

    path: Path
    dropped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    def keep(self, topic: Topic, good: Any, why: str, expected: str | None = None) -> Topic:
        """Keep the good ``(K,)`` messages and count the others; ``DataError`` if none is what was expected."""
        good = np.asarray(good, dtype=bool)
        if expected and not good.any():
            raise DataError(self.path, f"{topic.name} at {topic.t[0]:.3f}", f"only messages {why}", expected)
        self.dropped[f"messages on {topic.name} {why}"] += int(np.count_nonzero(~good))
        return topic[good]


def is_bag(path: Path) -> bool:
    """Tell from its name whether a path is a bag: a file of a bag's kind, or a folder that holds such files."""
    names = [entry.name for entry in path.iterdir()] if path.is_dir() else [path.name]
    return any(name == INDEX or Path(name).suffix.lower() in SUFFIXES for name in names)


def read_topics(path: Path, wanted: Collection[str] = (), at: int | None = None) -> dict[str, Topic]:
    """Read the wanted topics of a bag, or list all, without contents, by when their messages reached the bag.

    Of images, the pixels are kept only where one is read alone: what reached the bag at ``at`` nanoseconds.
    """
    try:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        raise DataError(path, "package", f"no {error.name}", "the extra: pip install pfslam[ros]") from error
    is_old, place = path.suffix.lower() == ".bag", "bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_old else Stores.LATEST)
    if is_old:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    decode: Any = store.deserialize_ros1 if is_old else store.deserialize_cdr
    try:
        with rosbag1.Reader(path) if is_old else rosbag2.Reader(path) as reader:
            kinds = {c.topic: TF if c.msgtype == OLD_TF else c.msgtype for c in reader.connections}
            rows: dict[str, list[tuple[int, int, Any]]] = {name: [] for name in sorted(kinds)}
            chosen = [c for c in reader.connections if c.topic in wanted]
            for connection, arrived, data in reader.messages(chosen, at, None if at is None else at + 1):
                name, stamped, content = connection.topic, arrived, None
                if chosen:
                    place = f"{name} at {arrived * 1e-9:.3f}"
                    content = decode(data, kinds[name])
                    stamped = nanoseconds(content.header) if hasattr(content, "header") else arrived
                    if kinds[name] == IMAGE and at is None:
                        content.data = None
                rows[name].append((stamped, arrived, content))
    except Exception as error:  # the library raises many kinds for a damaged bag
        found = ": ".join(filter(None, (type(error).__name__, str(error))))
        expected = f"a whole ROS bag, closed by its recorder: a file, or a folder with its {INDEX}"
        raise DataError(path, place, found, expected) from error
    return {name: Topic.of(name, kinds[name], rows[name]) for name in rows}


def nanoseconds(header: Any) -> int:
    """Return the stamp of a message's header in whole nanoseconds."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def ordered(log: Log, topic: Topic) -> Topic:
    """Put messages in the order of their stamps, each stamp once, and speak of what is odd."""
    if not topic.stamped.any():
        log.notes.append(f"the stamps on {topic.name} are zero: the bag's own time is used")
        topic = replace(topic, stamped=topic.arrived)
    topic = log.keep(topic, topic.stamped != 0, "without a stamp", "times")
    delay = (topic.arrived - topic.stamped) * 1e-9
    for what, odd in (
        ("are late or early", np.abs(delay - np.median(delay)) > LATE),
        ("are out of order, put in order", np.diff(topic.stamped, prepend=topic.stamped[0]) < 0),
    ):
        if odd.any():
            first = topic.arrived[odd.argmax()] * 1e-9
            log.notes.append(f"{odd.sum()} messages on {topic.name} {what}, the first at {first:.3f} s")
    topic = topic[np.argsort(topic.stamped, kind="stable")]
    later = np.diff(topic.stamped, prepend=topic.stamped[0] - 1) > 0
    topic = log.keep(topic, later, "with the stamp of another")
    t, gaps = topic.t, np.diff(topic.t)
    if len(gaps) and gaps.max() > max(LONG_GAP, 5.0 * np.median(gaps)):
        longest, since = gaps.max(), t[gaps.argmax()]
        log.notes.append(f"{topic.name} is silent for {longest:.2f} s after {since:.3f} s, its longest gap")
    return topic
