"""ROS bags: laser scans with odometry, read without ROS.

ROS 1 bags, ROS 2 bag folders (sqlite3 or mcap) and single mcap or db3 files are read through the pure Python library
rosbags, the extra ``ros``. The messages are the standard ones of ROS: LaserScan, Odometry, TFMessage, Imu, Image. What
is left out is counted in ``recording.dropped``; what had to be decided or looks odd is said in ``recording.notes``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.bag_images import INFO, choose_images, load_images
from pfslam.io.frames import Frames, seven, transforms
from pfslam.io.headings import with_better_headings
from pfslam.io.limits import LONGEST_SWEEP, check_size
from pfslam.io.messages import IMAGE, TF, Log, Messages, Topic, list_topics, ordered, read_messages
from pfslam.poses import Trajectory
from pfslam.recording import Imu, LidarScans, Recording
from pfslam.sensors import MAX_BEAMS, STANDARD_GRAVITY, LidarModel, RgbdModel, RobotModel

SCAN, ODOMETRY, IMU = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
USUAL = {SCAN: ("/scan",), ODOMETRY: ("/odom",), IMU: ("/imu/data", "/imu")}
"""Of several topics of a type, the one with such a name is used."""
OPTION = {SCAN: "--scan", ODOMETRY: "--odom", IMU: "--imu"}
ODOMETRY_FRAME, BASE_FRAMES = "odom", ("base_footprint", "base_link")
STEEPEST = float(np.deg2rad(10.0))
"""A LiDAR that leans more than this (rad) does not measure a floor plan."""


@dataclass(frozen=True)
class BagOptions:
    """What a bag does not say by itself: the topics to use, by name, and the LiDAR's place ``(x, y, yaw)`` m, rad."""

    scan: str | None = None
    odom: str | None = None
    imu: str | None = None
    rgb: str | None = None
    depth: str | None = None
    lidar_at: tuple[float, float, float] | None = None


def load_bag(path: str | Path, options: BagOptions | None = None) -> Recording:
    """Read a ROS bag: its scans, its odometry as logged, its IMU, and the LiDAR's place from the tree of frames.

    Header stamps count; the bag's own time takes their place only where all of them are zero. Messages are put in the
    order of their stamps; of those with the same stamp the first counts. Raises ``DataError`` naming topic and time.
    """
    path, options = Path(path), options or BagOptions()
    log, topics = Log(path), list_topics(path)
    chosen = choose_topics(log, topics, options)
    wanted = {topic: kind for kind, topic in chosen.items()}
    images = choose_images(log, topics, options.depth, options.rgb)
    wanted |= {topic: INFO if topic.endswith("camera_info") else IMAGE for topic in images}
    trees = {name: TF for name, topic in topics.items() if topic.kind == TF}
    streams = read_messages(path, wanted | trees)
    frames = Frames.of(path, (message for name in trees for message in streams[name].held))
    odometry, base = _odometry(log, streams.get(chosen.get(ODOMETRY, "")), frames)
    imu = _imu(log, streams.get(chosen.get(IMU, "")), frames, base)
    if imu is not None:
        odometry, note = with_better_headings(odometry, imu)
        log.notes += [note] if note else []
    model, lidar = LidarModel(), None
    if SCAN in chosen:
        model, lidar = _lidar(log, streams[chosen[SCAN]], frames, base, options.lidar_at)
        _check_clocks(path, chosen[SCAN], lidar, odometry)
    pictures = load_images(log, [streams[topic] for topic in images], frames, base) if images else None
    eye, camera = pictures or (RgbdModel(), None)
    said: dict[str, Any] = {"dropped": log.dropped, "notes": tuple(log.notes)}
    robot = RobotModel(lidar=model, camera=eye)
    return Recording(path.stem, robot, imu=imu, odometry=odometry, lidar=lidar, camera=camera, **said)


def _check_clocks(path: Path, topic: str, lidar: LidarScans, odometry: Trajectory) -> None:
    """Raise ``DataError`` if no scan was made within the odometry's time."""
    if not odometry.covers(lidar.t).any():
        found = f"{lidar.t[0]:.3f} to {lidar.t[-1]:.3f} s"
        expected = f"times within the odometry's, {odometry.t[0]:.3f} to {odometry.t[-1]:.3f} s"
        raise DataError(path, f"stamps on {topic}", found, expected)


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
        t, held = ordered(log, stream)
        T, base = np.array(held), pair[1]
    else:
        t, held = ordered(log, stream)
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
    t, held = ordered(log, stream)
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
    t, held = ordered(log, stream)
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
