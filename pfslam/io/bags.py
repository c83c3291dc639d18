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
from pfslam.io.bag_scans import load_scans
from pfslam.io.frames import Frames, are_poses, seven, transforms
from pfslam.io.headings import with_better_headings
from pfslam.io.limits import check_size
from pfslam.io.messages import IMAGE, TF, Log, Messages, Topic, list_topics, ordered, read_messages
from pfslam.poses import Trajectory
from pfslam.recording import Imu, LidarScans, Recording
from pfslam.sensors import STANDARD_GRAVITY, LidarModel, RgbdModel, RobotModel

SCAN, ODOMETRY, IMU = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
USUAL = {SCAN: ("/scan",), ODOMETRY: ("/odom",), IMU: ("/imu/data", "/imu")}
"""Of several topics of a type, the one with such a name is used."""
OPTION = {SCAN: "--scan", ODOMETRY: "--odom", IMU: "--imu"}
ODOMETRY_FRAME, BASE_FRAMES = "odom", ("base_footprint", "base_link")
OTHER_SCANS = {
    "sensor_msgs/msg/PointCloud2": "pointcloud_to_laserscan",
    "sensor_msgs/msg/MultiEchoLaserScan": "laser_proc",
}
"""Types that are not read, and the ROS package that makes a LaserScan of each."""


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
    _check_topics(path, topics, chosen)
    wanted = {topic: kind for kind, topic in chosen.items()}
    images = choose_images(log, topics, options.depth, options.rgb)
    wanted |= {topic: INFO if topic.endswith("camera_info") else IMAGE for topic in images}
    trees = {name: TF for name, topic in topics.items() if topic.kind == TF}
    streams = read_messages(path, wanted | trees)
    frames = Frames.of(path, [pair for name in trees for pair in streams[name].with_arrival()])
    odometry, base = _odometry(log, streams.get(chosen.get(ODOMETRY, "")), frames)
    imu = _imu(log, streams.get(chosen.get(IMU, "")), frames, base)
    if imu is not None:
        odometry, note = with_better_headings(odometry, imu)
        log.notes += [note] if note else []
    model, lidar = LidarModel(), None
    if SCAN in chosen:
        model, lidar = load_scans(log, streams[chosen[SCAN]], frames, base, options.lidar_at)
        _check_clocks(path, chosen[SCAN], lidar, odometry)
    pictures = load_images(log, [streams[topic] for topic in images], frames, base) if images else None
    eye, camera = pictures or (RgbdModel(), None)
    said: dict[str, Any] = {"dropped": log.dropped, "notes": tuple(log.notes)}
    robot = RobotModel(lidar=model, camera=eye)
    return Recording(path.stem, robot, imu=imu, odometry=odometry, lidar=lidar, camera=camera, **said)


def _check_topics(path: Path, topics: Mapping[str, Topic], chosen: Mapping[str, str]) -> None:
    """Raise ``DataError`` for a bag without messages, or one whose scans are of a type that is not read."""
    if not any(len(topic.t) for topic in topics.values()):
        raise DataError(path, "bag", "no messages", "scans and odometry")
    others = [topic for topic in topics.values() if topic.kind in OTHER_SCANS and len(topic.t)]
    if others and SCAN not in chosen:
        found = ", ".join(f"{topic.name} ({topic.kind.rpartition('/')[2]})" for topic in others)
        maker = OTHER_SCANS[others[0].kind]
        expected = f"a topic of LaserScan, as the ROS package {maker} makes one of it"
        raise DataError(path, "scans", found, expected)


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
        stream, base = _moved_on_tf(log, frames)
        t, held = ordered(log, stream)
        T = np.array(held)
    else:
        t, held = ordered(log, stream)
        rows = np.array([seven(m.pose.pose.position, m.pose.pose.orientation) for m in held])
        if (good := are_poses(rows)).any():  # a robot that has just been started may send an empty one
            log.count(f"messages on {stream.topic} that are no poses", np.count_nonzero(~good))
            t, rows = t[good], rows[good]
        T = transforms(log.path, stream.topic, t * 1e9, rows)
        known = {frame for pair in frames.edges for frame in pair}
        base = held[0].child_frame_id.lstrip("/") or next(
            (b for b in BASE_FRAMES if b in known), BASE_FRAMES[1]
        )
    poses = np.column_stack([T[:, :2, 3], np.arctan2(T[:, 1, 0], T[:, 0, 0])])
    check_size(log.path, f"{stream.topic}.poses", poses)
    return Trajectory(t, poses), base


def _moved_on_tf(log: Log, frames: Frames) -> tuple[Messages, str]:
    """Return the transforms of the odometry on /tf, and the frame that it moves."""
    pairs = [pair for pair in frames.edges if _last_part(pair[0]).startswith(ODOMETRY_FRAME)]
    pairs.sort(key=lambda pair: pair[0] != ODOMETRY_FRAME)
    if not pairs:
        moving = "".join(f"; on /tf {a} -> {b} moves" for a, b in frames.moving()[:3])
        expected = f"nav_msgs/Odometry, or {ODOMETRY_FRAME} -> {BASE_FRAMES[1]} on /tf"
        raise DataError(log.path, "odometry", f"none{moving}", expected)
    pair = next((p for base in BASE_FRAMES for p in pairs if _last_part(p[1]) == base), pairs[0])
    log.notes.append(f"odometry is read from /tf: {pair[0]} -> {pair[1]}")
    stamped, arrived, found = frames.edges[pair]
    topic = f"/tf ({pair[0]} -> {pair[1]})"
    return Messages(topic, stamped.tolist(), arrived.tolist(), list(found)), pair[1]


def _last_part(frame: str) -> str:
    """Return the name of a frame without the robot's: ``odom`` for ``robot1/odom``."""
    return frame.rpartition("/")[2]


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
