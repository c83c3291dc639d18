"""Messages of a ROS bag: opened, listed, read and put in order by their stamps, without ROS.

The library rosbags, the extra ``ros``, is imported when a bag is opened and not before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.frames import nanoseconds, seconds
from pfslam.io.limits import check_size

IMAGE, TF = "sensor_msgs/msg/Image", "tf2_msgs/msg/TFMessage"
OLD_NAMES = {"tf/msg/tfMessage": TF}
"""Types that have the layout of another."""
SUFFIXES = (".bag", ".mcap", ".db3")
UNREAD = {
    ".active": "a bag closed by its recorder: rosbag reindex mends a copy named .bag",
    ".zstd": "the folder of a compressed bag",
    ".yaml": "the folder that it lies in",
}
"""Files of bags that are not opened by themselves, and what is, by their suffix."""
INDEX = "metadata.yaml"
"""The file in the folder of a ROS 2 bag that says what else is there."""
LATE = 1.0
"""Seconds that a message may reach the bag later than its topic's messages usually do."""
EACH_SIDE = 5
"""Messages that there have to be before and after a jump of a clock."""
LONG_GAP = 0.5
"""Seconds without a message, and five usual intervals, that are spoken of."""


@dataclass(frozen=True, eq=False)
class Topic:
    """One topic of a bag: its type, and when its messages reached the bag, ``t (K,)`` s."""

    name: str
    kind: str
    t: np.ndarray


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


@dataclass(eq=False)
class Messages:
    """The messages of one topic: when they were stamped and when they reached the bag, each in whole nanoseconds."""

    topic: str
    stamped: list[int] = field(default_factory=list)
    arrived: list[int] = field(default_factory=list)
    held: list[Any] = field(default_factory=list)

    def with_arrival(self) -> Iterator[tuple[int, Any]]:
        """Yield each message after the nanoseconds at which it reached the bag."""
        return zip(self.arrived, self.held, strict=True)


def is_bag(path: Path) -> bool:
    """Tell from its name whether a path is a bag: a file of a bag's kind, or a folder that holds bag files."""
    if not path.is_dir():
        return path.name == INDEX or _kind(path) in (*SUFFIXES, ".active", ".zstd")
    return any(entry.name == INDEX or _kind(entry) in SUFFIXES for entry in path.iterdir())


def _kind(path: Path) -> str:
    """Return a file's suffix in small letters: memory sticks may have capitals."""
    return path.suffix.lower()


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a bag; whatever goes wrong while it is open becomes one ``DataError``."""
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise DataError(path, "package", f"no {error.name}", "the extra: pip install pfslam[ros]") from error
    if expected := UNREAD.get(_kind(path)):
        raise DataError(path, "file", path.suffix, expected)
    if path.is_dir() and not (path / INDEX).is_file():
        files = sorted(entry.name for entry in path.iterdir() if _kind(entry) in SUFFIXES)
        raise DataError(path, "folder", f"no {INDEX}", f"the folder of a ROS 2 bag, or a file: {files[0]}")
    try:
        with rosbag1.Reader(path) if _kind(path) == ".bag" else rosbag2.Reader(path) as reader:
            yield reader
    except DataError:
        raise
    except Exception as error:  # the library raises many kinds for a damaged bag
        found = ": ".join(filter(None, (type(error).__name__, str(error))))
        raise DataError(path, "bag", found, "a whole ROS bag, closed by its recorder") from error


def list_topics(path: str | Path) -> dict[str, Topic]:
    """List the topics of a bag by name."""
    path, found = Path(path), {}
    with opened(path) as reader:
        times: dict[str, list[int]] = {connection.topic: [] for connection in reader.connections}
        kinds = {c.topic: OLD_NAMES.get(c.msgtype, c.msgtype) for c in reader.connections}
        for connection, arrived, _ in reader.messages(connections=reader.connections):
            times[connection.topic].append(arrived)
        for name in sorted(times):
            found[name] = Topic(name, kinds[name], seconds(np.sort(np.array(times[name], dtype=np.int64))))
    return found


def read_messages(path: Path, kinds: Mapping[str, str]) -> dict[str, Messages]:
    """Read the messages of the given topics, whose types are given by name."""
    found = {topic: Messages(topic) for topic in kinds}
    with opened(path) as reader:
        decode = _decoder(path)
        wanted = [connection for connection in reader.connections if connection.topic in kinds]
        for connection, arrived, data in reader.messages(connections=wanted) if wanted else ():
            try:
                message = decode(data, kinds[connection.topic])
            except Exception as error:
                place = f"{connection.topic} at {arrived * 1e-9:.3f}"
                raise DataError(path, place, f"{type(error).__name__}: {error}", "a whole message") from error
            if kinds[connection.topic] == IMAGE:
                message.data = None  # pictures are read again, one at a time
            stream = found[connection.topic]
            stream.held.append(message)
            stream.arrived.append(arrived)
            stream.stamped.append(nanoseconds(message.header) if hasattr(message, "header") else arrived)
    return found


def read_message(path: Path, topic: str, kind: str, arrived: int, stamped: int) -> Any:
    """Read the one message of a topic that arrived and was stamped at these times, in nanoseconds."""
    with opened(path) as reader:
        decode = _decoder(path)
        wanted = [connection for connection in reader.connections if connection.topic == topic]
        for _, _, data in reader.messages(connections=wanted, start=arrived, stop=arrived + 1):
            message = decode(data, kind)
            if nanoseconds(message.header) == stamped:
                return message
    raise DataError(path, f"{topic} at {arrived * 1e-9:.3f}", "nothing", "the message that was there")


def _decoder(path: Path) -> Callable[[bytes, str], Any]:
    """Return what turns the bytes of a message into an object, by the standard types of ROS 1 or ROS 2."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if _kind(path) != ".bag":
        return get_typestore(Stores.LATEST).deserialize_cdr
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))  # not among them
    return store.deserialize_ros1


def ordered(log: Log, stream: Messages) -> tuple[np.ndarray, list[Any]]:
    """Return stamps ``(K,)`` in seconds and their messages in strictly increasing order, and speak of what is odd."""
    topic, stamped, arrived = stream.topic, np.array(stream.stamped), np.array(stream.arrived)
    if not arrived.any() and not stamped.any():
        raise DataError(log.path, f"stamps on {topic}", "only zeros", "times")
    if not stamped.any():
        log.notes.append(f"the stamps on {topic} are zero: the bag's own time is used")
        stamped = arrived
    elif (jump := clock_jump(stamped, arrived)) is not None:
        log.notes.append(f"the stamps on {topic} {jump}: the bag's own time is used")
        stamped = arrived
    log.count(f"messages on {topic} without a stamp", np.count_nonzero(stamped == 0))
    delay = (arrived - stamped) * 1e-9
    _speak(log, topic, "late", delay - np.median(delay[stamped != 0]) > LATE, arrived)
    _speak(log, topic, "out of order, put in order", np.diff(stamped, prepend=stamped[0]) < 0, arrived)
    order = np.argsort(stamped, kind="stable")
    first = np.diff(stamped[order], prepend=stamped.min() - 1) > 0
    log.count(f"messages on {topic} with the stamp of another", np.count_nonzero(~first))
    order = order[first & (stamped[order] != 0)]
    t = seconds(stamped[order])
    check_size(log.path, f"{topic}.t", t)
    gaps = np.diff(t)
    if len(gaps) and gaps.max() > max(LONG_GAP, 5.0 * np.median(gaps)):
        at = int(np.argmax(gaps))
        log.notes.append(f"{topic} is silent for {gaps[at]:.2f} s after {t[at]:.3f} s, its longest gap")
    return t, [stream.held[k] for k in order]


def clock_jump(stamped: np.ndarray, arrived: np.ndarray) -> str | None:
    """Say when and by how much the clock of stamps ``(K,)`` was set, if it was: before and after, both clocks agree."""
    ahead = (stamped - arrived) * 1e-9
    if len(ahead) < 2 * EACH_SIDE:
        return None
    at = int(np.argmax(np.abs(np.diff(ahead)))) + 1
    sides = ahead[:at], ahead[at:]
    before, after = map(np.median, sides)
    steady = [np.quantile(np.abs(side - np.median(side)), 0.9) < 0.1 * LATE for side in sides]
    if not all(steady) or min(map(len, sides)) < EACH_SIDE or abs(after - before) <= LATE:
        return None
    return f"jump by {after - before:+.1f} s at {arrived[at] * 1e-9:.3f} s"


def _speak(log: Log, topic: str, what: str, which: np.ndarray, arrived: np.ndarray) -> None:
    if count := int(np.count_nonzero(which)):
        first = arrived[int(np.argmax(which))] * 1e-9
        log.notes.append(f"{count} messages on {topic} are {what}, the first at {first:.3f} s")
