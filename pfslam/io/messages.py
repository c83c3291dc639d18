"""Messages of a ROS bag: listed, read and put in order by their stamps, without ROS.

The library rosbags, the extra ``ros``, is imported when a bag is opened and not before.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pfslam.errors import DataError

IMAGE, TF, OLD_TF = "sensor_msgs/msg/Image", "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"
SUFFIXES = (".bag", ".mcap", ".db3", ".active", ".zstd")
"""Of the files of bags; the last two are those of a bag that is not closed, or packed, and are refused."""
INDEX = "metadata.yaml"
"""The file in the folder of a ROS 2 bag that says what else is there."""
LATE = 1.0
"""Seconds by which the delay of a message, from its stamp to its arrival, may differ from what is usual."""
LONG_GAP = 0.5
"""Seconds without a message, and five usual intervals, that are spoken of."""


class Message(NamedTuple):
    """One message, with the times at which it was stamped and reached the bag, in whole nanoseconds."""

    stamped: int
    arrived: int
    content: Any


@dataclass(frozen=True, eq=False)
class Topic:
    """The messages of one topic, and their type."""

    name: str
    kind: str
    messages: list[Message] = field(default_factory=list)

    @property
    def times(self) -> np.ndarray:
        """Stamps and arrivals ``(2, K)`` in whole nanoseconds."""
        messages = self.messages
        return np.array([[m.stamped for m in messages], [m.arrived for m in messages]], dtype=np.int64)

    @property
    def t(self) -> np.ndarray:
        """The stamps ``(K,)`` in seconds, rounded once."""
        stamped, _ = self.times
        return stamped // 10**9 + stamped % 10**9 * 1e-9

    @property
    def contents(self) -> list[Any]:
        """The messages themselves."""
        return [message.content for message in self.messages]

    def numbers(self, axes: Mapping[str, str]) -> np.ndarray:
        """Collect the numbers ``(K, n)`` of vectors, each by its field and the letters of its axes."""
        get = attrgetter(*(f"{vector}.{axis}" for vector, letters in axes.items() for axis in letters))
        return np.array([get(content) for content in self.contents], dtype=float)


@dataclass(eq=False)
class Log:
    """Collects what is left out, by reason, and what is to be said."""

    path: Path
    dropped: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def count(self, reason: str, number: int | np.integer) -> None:
        """Note that this many items were left out for this reason."""
        if number:
            self.dropped[reason] = self.dropped.get(reason, 0) + int(number)

    def keep(
        self, topic: Topic, good: Sequence[bool] | np.ndarray, why: str, expected: str | None = None
    ) -> Topic:
        """Keep the good ``(K,)`` messages and count the others; ``DataError`` if none is what was expected."""
        if expected and not np.any(good):
            raise DataError(self.path, f"{topic.name} at {topic.t[0]:.3f}", f"only messages {why}", expected)
        self.count(f"messages on {topic.name} {why}", len(good) - np.count_nonzero(good))
        return replace(topic, messages=list(compress(topic.messages, good)))


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
    decode: Callable[[bytes, str], Any] = store.deserialize_ros1 if is_old else store.deserialize_cdr
    try:
        with rosbag1.Reader(path) if is_old else rosbag2.Reader(path) as reader:
            kinds = {c.topic: TF if c.msgtype == OLD_TF else c.msgtype for c in reader.connections}
            topics = {name: Topic(name, kinds[name]) for name in sorted(kinds)}
            chosen = [c for c in reader.connections if c.topic in wanted]
            for connection, arrived, data in reader.messages(chosen, at, None if at is None else at + 1):
                topic, stamped, content = topics[connection.topic], arrived, None
                if chosen:
                    place = f"{topic.name} at {arrived * 1e-9:.3f}"
                    content = decode(data, topic.kind)
                    stamped = nanoseconds(content.header) if hasattr(content, "header") else arrived
                    if topic.kind == IMAGE and at is None:
                        content.data = None
                topic.messages.append(Message(stamped, arrived, content))
    except Exception as error:  # the library raises many kinds for a damaged bag
        found = ": ".join(filter(None, (type(error).__name__, str(error))))
        expected = f"a whole ROS bag, closed by its recorder: a file, or a folder with its {INDEX}"
        raise DataError(path, place, found, expected) from error
    return topics


def nanoseconds(header: Any) -> int:
    """Return the stamp of a message's header in whole nanoseconds."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def ordered(log: Log, topic: Topic) -> Topic:
    """Put messages in the order of their stamps, each stamp once, and speak of what is odd."""
    if why := _wrong_clock(topic):
        log.notes.append(f"the stamps on {topic.name} {why}: the bag's own time is used")
        topic = replace(topic, messages=[m._replace(stamped=m.arrived) for m in topic.messages])
    topic = log.keep(topic, topic.times[0] != 0, "without a stamp", "times")
    stamped, arrived = topic.times
    delay = (arrived - stamped) * 1e-9
    for what, odd in (
        ("are late or early", np.abs(delay - np.median(delay)) > LATE),
        ("are out of order, put in order", np.diff(stamped, prepend=stamped[0]) < 0),
    ):
        if odd.any():
            first = arrived[odd.argmax()] * 1e-9
            log.notes.append(f"{odd.sum()} messages on {topic.name} {what}, the first at {first:.3f} s")
    topic = replace(topic, messages=sorted(topic.messages, key=lambda message: message.stamped))
    news = np.diff(np.sort(stamped), prepend=stamped.min() - 1) > 0
    topic = log.keep(topic, news, "with the stamp of another")
    t, gaps = topic.t, np.diff(topic.t)
    if len(gaps) and gaps.max() > max(LONG_GAP, 5.0 * np.median(gaps)):
        longest, since = gaps.max(), t[gaps.argmax()]
        log.notes.append(f"{topic.name} is silent for {longest:.2f} s after {since:.3f} s, its longest gap")
    return topic


def _wrong_clock(topic: Topic) -> str | None:
    """Say what is wrong with stamps that are all zero, or whose clock was set: at one moment, and for good."""
    stamped, arrived = topic.times[:, topic.times[0] != 0]
    if len(stamped) == 0:
        return "are zero"
    ahead = (stamped - arrived) * 1e-9
    at = np.abs(np.diff(stamped, prepend=stamped[0])).argmax()
    gained, leap = np.median(ahead[-5:]) - np.median(ahead[:5]), ahead[at] - ahead[at - 1]
    if abs(gained) > LATE and abs(gained - leap) < 0.1 * LATE:
        return f"jump by {gained:+.1f} s at {arrived[at] * 1e-9:.3f} s"
    return None
