"""ROS bags: laser scans with odometry, read without ROS.

ROS 1 bags, ROS 2 bag folders (sqlite3 or mcap) and single mcap or db3 files are read through the pure Python library
rosbags, the extra ``ros``. The messages are the standard ones of ROS: LaserScan, Odometry, TFMessage, Imu, Image. What
is left out is counted in ``recording.dropped``; what had to be decided or looks odd is said in ``recording.notes``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pfslam.errors import DataError
from pfslam.io.bag_images import load_images
from pfslam.io.bag_scans import load_scans, place_of_lidar
from pfslam.io.headings import with_better_headings
from pfslam.io.limits import GRAVITY_LIMIT
from pfslam.io.log import Log
from pfslam.io.messages import EDGE, IMAGE, TF, Frames, Topic, frame_of, ordered, read_topics, transforms
from pfslam.poses import Trajectory
from pfslam.recording import Imu, Recording
from pfslam.sensors import STANDARD_GRAVITY, LidarModel, RgbdModel, RobotModel
from pfslam.tilt import upright

USES = {
    "scan": ("sensor_msgs/msg/LaserScan", ("/scan",)),
    "odom": ("nav_msgs/msg/Odometry", ("/odom",)),
    "imu": ("sensor_msgs/msg/Imu", ("/imu/data", "/imu")),
    "depth": (IMAGE, ()),
    "rgb": (IMAGE, ()),
}
"""The type of the messages for each use, and the usual names of their topic."""
INFO = "sensor_msgs/msg/CameraInfo"
OTHERS = [f"sensor_msgs/msg/{kind}" for kind in ("PointCloud2", "MultiEchoLaserScan", "CompressedImage")]
COUNTED = {*OTHERS, *(kind for kind, _ in USES.values())}
"""The types of messages that are counted where their topic is not read."""


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
    log, topics = Log(path), read_topics(path)
    chosen = choose_topics(log, topics, options)
    trees = [topic.name for topic in topics.values() if topic.kind == TF]
    topics = read_topics(path, {*chosen.values(), *trees})
    read = {use: ordered(log, topics[name]) for use, name in chosen.items() if use != "info"}
    frames = Frames.of(log, [topics[name] for name in trees])
    odometry, base = _odometry(log, read.get("odom"), frames)
    imu = _imu(log, read["imu"], frames, base) if "imu" in read else None
    odometry, notes = with_better_headings(odometry, imu)
    log.notes += notes
    model, lidar, eye, camera = LidarModel(), None, RgbdModel(), None
    if "scan" in read:
        T = place_of_lidar(log, read["scan"], frames, base, options.lidar_at)
        model, lidar = load_scans(log, read["scan"], T)
    if "info" in chosen:
        info = topics[chosen["info"]].contents[0]
        eye, camera = load_images(log, read["depth"], read["rgb"], info, frames, base)
    robot, said = RobotModel(lidar=model, camera=eye), (dict(log.dropped), tuple(log.notes))
    return Recording(path.stem, robot, None, imu, odometry, lidar, camera, None, *said)


def choose_topics(log: Log, topics: Mapping[str, Topic], options: BagOptions) -> dict[str, str]:
    """Choose the topics for each use: the one named, the only one of its type, or one of the usual name.

    Images are used where depth, with the word in its name, colour and the depth camera's description are all there.
    """
    chosen = {}
    for use, (kind, usual) in USES.items():
        named = getattr(options, use)
        found = [topic.name for topic in topics.values() if topic.kind == kind and len(topic.t)]
        if named:
            fit = [name for name in found if name.lstrip("/") == named.lstrip("/")]
        else:
            fit = [name for name in found if kind != IMAGE or ("depth" in name.lower()) == (use == "depth")]
        best = fit if len(fit) == 1 else [name for name in usual if name in fit]
        if best:
            chosen[use] = best[0]
        elif named or (fit and use in ("scan", "odom")):
            field, expected = f"--{use} {named or 'NAME'}", f"one topic of {kind.rpartition('/')[2]}"
            raise DataError(log.path, field, ", ".join(found) or "none", expected)
    info = topics.get(chosen.get("depth", "").rpartition("/")[0] + "/camera_info")
    if "rgb" in chosen and info is not None and info.kind == INFO and len(info.t):
        chosen["info"] = info.name
    else:
        chosen = {use: name for use, name in chosen.items() if USES[use][0] != IMAGE}
    for topic in topics.values():
        if topic.kind in COUNTED and topic.name not in chosen.values():
            short = topic.kind.rpartition("/")[2]
            log.leave_out(f"messages of {short} on {topic.name}, which is not read", len(topic.t))
    return chosen


def _odometry(log: Log, topic: Topic | None, frames: Frames) -> tuple[Trajectory, str]:
    """Return the odometry and the frame that it moves: from Odometry messages, else from the tree of frames."""
    if topic is not None:
        usual = "base_footprint" if any("base_footprint" in pair for pair in frames.pairs) else "base_link"
        base = topic.contents[0].child_frame_id.lstrip("/") or usual
        topic, T = transforms(log, topic, "pose.pose.position xyz", "pose.pose.orientation xyzw")
    else:
        # Frames of a robot's own name are known by their last part, as in robot1/odom.
        pairs = [pair for pair in frames.pairs if pair[0].rpartition("/")[2].startswith("odom")]
        if not pairs:
            moving = [f"{a} -> {b} on /tf" for (a, b), (said, _) in frames.pairs.items() if len(said.t) > 1]
            expected = "nav_msgs/Odometry, or odom -> base_link on /tf"
            raise DataError(log.path, "odometry", ", ".join(moving) or "none", expected)
        parent, base = pair = min(pairs, key=lambda pair: ("base" not in pair[1], pair))
        log.notes.append(f"odometry is read from /tf: {parent} -> {base}")
        topic, T = transforms(log, ordered(log, frames.pairs[pair][0]), *EDGE)
    return Trajectory(topic.t, np.column_stack([T[:, :2, 3], np.arctan2(T[:, 1, 0], T[:, 0, 0])])), base


def _imu(log: Log, topic: Topic, frames: Frames, base: str) -> Imu | None:
    """Read the IMU, its axes turned into the body's: as the tree of frames says, or gravity."""
    rows = topic.numbers("angular_velocity xyz", "linear_acceleration xyz")
    rows[:, 3:] /= STANDARD_GRAVITY
    good = (np.abs(rows) < GRAVITY_LIMIT[0]).all(axis=1)
    frame, topic = frame_of(topic.contents[0]), topic.keep(log, good, "without usable numbers")
    if len(topic.t) < 2:
        return None
    rates, pushes = rows[good, :3], rows[good, 3:]
    T = frames.place(base, frame)
    R, taken = upright(pushes.mean(axis=0)) if T is None else (T[:3, :3], "")
    if T is None:
        log.notes.append(f"no chain of frames from {base} to {frame}: {topic.name} is taken for {taken}")
    return Imu(topic.t, rates @ R.T, pushes @ R.T)
