"""ROS bags: laser scans with odometry, read without ROS.

ROS 1 bags, ROS 2 bag folders (sqlite3 or mcap) and single mcap or db3 files are read through the pure Python library
rosbags, the extra ``ros``. The messages are the standard ones of ROS: LaserScan, Odometry, TFMessage, Imu. What is left
out is counted in ``recording.dropped``; what had to be decided or looks odd is said in ``recording.notes``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.frames import Frames, nanoseconds, seconds, seven, transforms
from pfslam.io.headings import with_better_headings
from pfslam.io.limits import LONGEST_SWEEP, check_size
from pfslam.poses import Trajectory
from pfslam.recording import Imu, LidarScans, Recording
from pfslam.sensors import MAX_BEAMS, STANDARD_GRAVITY, LidarModel, RobotModel

SCAN, ODOMETRY, IMU = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
IMAGE, TF = "sensor_msgs/msg/Image", "tf2_msgs/msg/TFMessage"
OLD_NAMES = {"tf/msg/tfMessage": TF}
"""Types that have the layout of another."""
USUAL = {SCAN: ("/scan",), ODOMETRY: ("/odom",), IMU: ("/imu/data", "/imu")}
"""Of several topics of a type, the one with such a name is used."""
OPTION = {SCAN: "--scan", ODOMETRY: "--odom", IMU: "--imu"}
ODOMETRY_FRAME, BASE_FRAMES = "odom", ("base_footprint", "base_link")
SUFFIXES = (".bag", ".mcap", ".db3")
LATE = 1.0
"""Seconds that a message may reach the bag later than its topic's messages usually do."""
LONG_GAP = 0.5
"""Seconds without a message, and five usual intervals, that are spoken of."""
STEEPEST = float(np.deg2rad(10.0))
"""A LiDAR that leans more than this (rad) does not measure a floor plan."""


@dataclass(frozen=True)
class BagOptions:
    """What a bag does not say by itself: the topics to use, by name, and the LiDAR's place ``(x, y, yaw)`` m, rad."""

    scan: str | None = None
    odom: str | None = None
    imu: str | None = None
    lidar_at: tuple[float, float, float] | None = None


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


def is_bag(path: Path) -> bool:
    """Tell from its name whether a path is a bag: a file of a bag's kind, or a folder that holds bag files."""
    if not path.is_dir():
        return path.suffix in SUFFIXES
    return any(entry.name == "metadata.yaml" or entry.suffix in SUFFIXES for entry in path.iterdir())


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a bag; whatever goes wrong while it is open becomes one ``DataError``."""
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise DataError(path, "package", f"no {error.name}", "the extra: pip install pfslam[ros]") from error
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        raise DataError(path, "folder", "no metadata.yaml", "a ROS 2 bag, or the path of one .mcap file")
    try:
        with rosbag1.Reader(path) if path.suffix == ".bag" else rosbag2.Reader(path) as reader:
            yield reader
    except DataError:
        raise
    except Exception as error:  # the library raises many kinds for a damaged bag
        found = f"{type(error).__name__}: {error}"
        raise DataError(path, "bag", found, "a whole ROS bag, closed by its recorder") from error


def list_topics(path: str | Path) -> dict[str, Topic]:
    """List the topics of a bag by name."""
    path, found = Path(path), {}
    with _opened(path) as reader:
        times: dict[str, list[int]] = {connection.topic: [] for connection in reader.connections}
        kinds = {c.topic: OLD_NAMES.get(c.msgtype, c.msgtype) for c in reader.connections}
        for connection, arrived, _ in reader.messages(connections=reader.connections):
            times[connection.topic].append(arrived)
        for name in sorted(times):
            found[name] = Topic(name, kinds[name], seconds(np.sort(np.array(times[name], dtype=np.int64))))
    return found


def _read(path: Path, kinds: Mapping[str, str]) -> dict[str, Messages]:
    """Read the messages of the given topics, whose types are given by name."""
    found = {topic: Messages(topic) for topic in kinds}
    with _opened(path) as reader:
        decode = _decoder(path)
        wanted = [connection for connection in reader.connections if connection.topic in kinds]
        for connection, arrived, data in reader.messages(connections=wanted) if wanted else ():
            try:
                message = decode(data, kinds[connection.topic])
            except Exception as error:
                place = f"{connection.topic} at {arrived * 1e-9:.3f}"
                raise DataError(path, place, f"{type(error).__name__}: {error}", "a whole message") from error
            stream = found[connection.topic]
            stream.held.append(message)
            stream.arrived.append(arrived)
            stream.stamped.append(nanoseconds(message.header) if hasattr(message, "header") else arrived)
    return found


def _decoder(path: Path) -> Callable[[bytes, str], Any]:
    """Return what turns the bytes of a message into an object, by the standard types of ROS 1 or ROS 2."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if path.suffix != ".bag":
        return get_typestore(Stores.LATEST).deserialize_cdr
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))  # not among them
    return store.deserialize_ros1


def load_bag(path: str | Path, options: BagOptions | None = None) -> Recording:
    """Read a ROS bag: its scans, its odometry as logged, its IMU, and the LiDAR's place from the tree of frames.

    Header stamps count; the bag's own time takes their place only where all of them are zero. Messages are put in the
    order of their stamps; of those with the same stamp the first counts. Raises ``DataError`` naming topic and time.
    """
    path, options = Path(path), options or BagOptions()
    log, topics = Log(path), list_topics(path)
    chosen = choose_topics(log, topics, options)
    wanted = {topic: kind for kind, topic in chosen.items()}
    streams = _read(path, wanted | {name: TF for name, topic in topics.items() if topic.kind == TF})
    for name, topic in topics.items():
        if topic.kind == IMAGE:
            log.count(f"images on {name}, which are not read", len(topic.t))
    frames = Frames.of(
        path, (m for name, stream in streams.items() if name not in wanted for m in stream.held)
    )
    odometry, base = _odometry(log, streams.get(chosen.get(ODOMETRY, "")), frames)
    imu = _imu(log, streams.get(chosen.get(IMU, "")), frames, base)
    if imu is not None:
        odometry, note = with_better_headings(odometry, imu)
        log.notes += [note] if note else []
    robot, lidar = RobotModel(), None
    if (scans := streams.get(chosen.get(SCAN, ""))) is not None:
        model, lidar = _lidar(log, scans, frames, base, options.lidar_at)
        robot = RobotModel(lidar=model)
        if not odometry.covers(lidar.t).any():
            found = f"{lidar.t[0]:.3f} to {lidar.t[-1]:.3f} s"
            expected = f"times within the odometry's, {odometry.t[0]:.3f} to {odometry.t[-1]:.3f} s"
            raise DataError(path, f"stamps on {scans.topic}", found, expected)
    notes = tuple(log.notes)
    return Recording(path.stem, robot, None, imu, odometry, lidar, dropped=log.dropped, notes=notes)


def choose_topics(log: Log, topics: Mapping[str, Topic], options: BagOptions) -> dict[str, str]:
    """Choose the topics to read, by type."""
    named = {SCAN: options.scan, ODOMETRY: options.odom, IMU: options.imu}
    chosen = {kind: _choose(log, topics, kind, name) for kind, name in named.items()}
    return {kind: topic for kind, topic in chosen.items() if topic is not None}


def _choose(log: Log, topics: Mapping[str, Topic], kind: str, name: str | None) -> str | None:
    """Choose the topic of a type: the one named, else the only one with messages, else one of the usual name."""
    short, option = kind.rpartition("/")[2], OPTION[kind]
    found = [topic.name for topic in topics.values() if topic.kind == kind and len(topic.t)]
    if name is not None:
        if "/" + name.lstrip("/") not in found:
            raise DataError(log.path, f"{option} {name}", ", ".join(found) or "none", f"a topic of {short}")
        return "/" + name.lstrip("/")
    if len(found) < 2:
        return found[0] if found else None
    best = next((usual for usual in USUAL[kind] if usual in found), None)
    if best is None and kind != IMU:
        raise DataError(log.path, f"topics of {short}", ", ".join(found), f"one, named with {option}")
    for other in found:
        if other != best:
            log.count(f"messages on {other}, since {best or 'none'} is used", len(topics[other].t))
    return best


def _ordered(log: Log, stream: Messages) -> tuple[np.ndarray, list[Any]]:
    """Return stamps ``(K,)`` in seconds and their messages in strictly increasing order, and speak of what is odd."""
    topic, stamped, arrived = stream.topic, np.array(stream.stamped), np.array(stream.arrived)
    if not stamped.any():
        log.notes.append(f"the stamps on {topic} are zero: the bag's own time is used")
        stamped = arrived
    if not stamped.any():
        raise DataError(log.path, f"stamps on {topic}", "only zeros", "times")
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


def _speak(log: Log, topic: str, what: str, which: np.ndarray, arrived: np.ndarray) -> None:
    if count := int(np.count_nonzero(which)):
        first = arrived[int(np.argmax(which))] * 1e-9
        log.notes.append(f"{count} messages on {topic} are {what}, the first at {first:.3f} s")


def _odometry(log: Log, stream: Messages | None, frames: Frames) -> tuple[Trajectory, str]:
    """Return the odometry and the frame that it moves: from Odometry messages, else from the tree of frames."""
    if stream is None:
        pairs = [pair for pair in frames.edges if pair[0] == ODOMETRY_FRAME]
        pair = next((p for base in BASE_FRAMES for p in pairs if p[1] == base), pairs[0] if pairs else None)
        if pair is None:
            expected = f"nav_msgs/Odometry, or {ODOMETRY_FRAME} -> {BASE_FRAMES[1]} on /tf"
            raise DataError(log.path, "odometry", "none", expected)
        log.notes.append(f"odometry is read from /tf: {pair[0]} -> {pair[1]}")
        stamps, found = frames.edges[pair]
        stream = Messages(f"/tf ({pair[0]} -> {pair[1]})", stamps.tolist(), stamps.tolist(), list(found))
        t, held = _ordered(log, stream)
        T, base = np.array(held), pair[1]
    else:
        t, held = _ordered(log, stream)
        rows = np.array([seven(m.pose.pose.position, m.pose.pose.orientation) for m in held])
        T = transforms(log.path, stream.topic, t * 1e9, rows)
        known = {frame for pair in frames.edges for frame in pair}
        base = held[0].child_frame_id.lstrip("/") or next(
            (b for b in BASE_FRAMES if b in known), BASE_FRAMES[1]
        )
    poses = np.column_stack([T[:, :2, 3], np.arctan2(T[:, 1, 0], T[:, 0, 0])])
    check_size(log.path, f"{stream.topic}.poses", poses)
    return Trajectory(t, poses), base


def _imu(log: Log, stream: Messages | None, frames: Frames, base: str) -> Imu | None:
    """Read the IMU, its axes turned into the body's."""
    if stream is None:
        return None
    t, held = _ordered(log, stream)
    rates = np.array([[getattr(m.angular_velocity, axis) for axis in "xyz"] for m in held])
    pushes = np.array([[getattr(m.linear_acceleration, axis) for axis in "xyz"] for m in held])
    good = np.isfinite(rates).all(axis=1) & np.isfinite(pushes).all(axis=1)
    log.count(f"messages on {stream.topic} that are not numbers", np.count_nonzero(~good))
    if np.count_nonzero(good) < 2:
        return None
    frame = held[0].header.frame_id.lstrip("/")
    T = np.eye(4) if frame == base else frames.fixed(base, frame)
    if T is None:
        log.notes.append(
            f"no chain of frames from {base} to {frame}: {stream.topic} is taken for level and upright"
        )
        T = np.eye(4)
    rates, pushes = rates[good] @ T[:3, :3].T, pushes[good] @ T[:3, :3].T / STANDARD_GRAVITY
    check_size(log.path, f"{stream.topic}.angular_velocity", rates)
    check_size(log.path, f"{stream.topic}.acceleration_g", pushes)
    return Imu(t[good], rates, pushes)


def _lidar(
    log: Log, stream: Messages, frames: Frames, base: str, place: tuple[float, float, float] | None
) -> tuple[LidarModel, LidarScans]:
    """Describe the LiDAR and arrange its scans counter-clockwise, as seen from above."""
    t, held = _ordered(log, stream)
    t, held = _of_one_kind(log, stream.topic, t, held)
    position, yaw, flipped = _mounting(
        log, stream.topic, held[0].header.frame_id.lstrip("/"), frames, base, place
    )
    first, count = held[0], len(held[0].ranges)
    ranges = np.stack([message.ranges for message in held]).astype(np.float32)
    for what, which in (
        ("not a number", np.isnan(ranges)),
        ("zero", ranges == 0),
        ("infinite", np.isinf(ranges)),
    ):
        log.count(f"ranges on {stream.topic} that are {what}", np.count_nonzero(which))
    side = -1.0 if flipped else 1.0
    low = yaw + side * first.angle_min
    high = low + side * (count - 1) * first.angle_increment
    sweep = _sweep(log, stream.topic, t, (count - 1) * float(first.time_increment))
    t = t + 0.5 * sweep  # ROS stamps the first beam, this package the middle one
    if low > high:
        ranges, low, high, sweep = ranges[:, ::-1], high, low, -sweep
    try:
        model = LidarModel(low, high, count, first.range_min, first.range_max, position, sweep)
        return model, LidarScans(t, np.ascontiguousarray(ranges))
    except DataError as error:
        raise DataError(log.path, f"{stream.topic}, {error.field}", error.found, error.expected) from None


def _of_one_kind(log: Log, topic: str, t: np.ndarray, held: list[Any]) -> tuple[np.ndarray, list[Any]]:
    """Keep the scans with the commonest number of beams, angles and limits."""
    names = ("angle_min", "angle_increment", "time_increment", "range_min", "range_max")
    kinds = [(len(m.ranges), *(round(float(getattr(m, name)), 6) for name in names)) for m in held]
    common = max(set(kinds), key=kinds.count)
    keep = np.array([kind == common for kind in kinds])
    log.count(f"scans on {topic} unlike the others in beams, angles or limits", np.count_nonzero(~keep))
    beams, low, step = common[:3]
    span = abs(step) * (beams - 1)
    if not (1 <= beams <= MAX_BEAMS and abs(low) < 7.0 and span <= 2.0 * np.pi + 0.02):
        found = f"{beams} beams from {low:g} in steps of {step:g} rad"
        raise DataError(log.path, f"{topic} at {t[0]:.3f}", found, "beams over at most one turn")
    return t[keep], [message for message, is_kept in zip(held, keep, strict=True) if is_kept]


def _sweep(log: Log, topic: str, t: np.ndarray, sweep: float) -> float:
    """Return the time (s) from first beam to last, or 0 where what the messages say cannot be."""
    longest = min(LONGEST_SWEEP, 1.1 * float(np.median(np.diff(t)))) if len(t) > 1 else LONGEST_SWEEP
    if abs(sweep) <= longest:
        return sweep
    log.notes.append(f"a sweep of {sweep:g} s on {topic} is longer than a scan lasts: it is not used")
    return 0.0


def _mounting(
    log: Log, topic: str, frame: str, frames: Frames, base: str, place: tuple[float, float, float] | None
) -> tuple[tuple[float, float, float], float, bool]:
    """Find the LiDAR's position (m) and yaw (rad) in the body frame, and whether it hangs upside down."""
    if place is not None:
        x, y, yaw = place
        log.notes.append(f"the LiDAR is taken to be at x {x:g} m, y {y:g} m, yaw {yaw:g} rad, as asked for")
        return (x, y, LidarModel().position_b[2]), yaw, False
    T = np.eye(4) if frame == base else frames.fixed(base, frame)
    if T is None:
        found = f"no fixed chain of frames from {base} to {frame}"
        raise DataError(
            log.path, f"{topic}, place of the LiDAR", found, "one on /tf_static, or --lidar-at X Y YAW"
        )
    if abs(T[2, 2]) < np.cos(STEEPEST):
        lean = np.degrees(np.arccos(abs(T[2, 2])))
        raise DataError(log.path, f"{topic}, {frame}", f"a lean of {lean:.0f} deg", "a level LiDAR")
    if T[2, 2] < 0:
        log.notes.append(f"{frame} hangs upside down: the beams of {topic} are put in the other order")
    x, y, z = T[:3, 3].tolist()
    return (x, y, z), float(np.arctan2(T[1, 0], T[0, 0])), bool(T[2, 2] < 0)
