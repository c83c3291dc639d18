"""A ROS 2 bag of a drive, as a robot would record it: scans, odometry and the place of the LiDAR."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.motion import dead_reckoning
from pfslam.recording import Recording

SECONDS = 30.0
"""How much of the drive is recorded."""
SCAN_EVERY = 4
"""Of a scanner with 40 scans a second, every fourth: robots with ROS scan about ten times a second."""


class Pen:
    """Writes messages by their types and the values of their fields, in order."""

    def __init__(self, writer: Any, store: Any):
        self.writer, self.store = writer, store
        self.topics: dict[str, Any] = {}

    def make(self, kind: str, *values: Any) -> Any:
        """Make a message such as ``geometry_msgs/Point`` from its values."""
        return self.store.types[kind.replace("/", "/msg/")](*values)

    def header(self, t: float, frame: str) -> Any:
        """Make the header of a message: its time (s) and its frame."""
        stamp = self.make("builtin_interfaces/Time", int(t // 1), round(float(t % 1) * 1e9))
        return self.make("std_msgs/Header", stamp, frame)

    def turn(self, yaw: float) -> Any:
        """Make the quaternion of a turn about z by ``yaw`` rad."""
        return self.make("geometry_msgs/Quaternion", 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))

    def write(self, topic: str, t: float, message: Any) -> None:
        """Write a message that reached the bag at time ``t`` (s)."""
        kind = message.__msgtype__
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        self.writer.write(self.topics[topic], round(t * 1e9), self.store.serialize_cdr(message, kind))


def record_bag(recording: Recording, path: str | Path) -> Path:
    """Write half a minute of a drive, from its tenth second, as a ROS 2 bag: scans, odometry, the LiDAR's place.

    The odometry is the recording's dead reckoning. Returns the folder of the bag, which must not exist yet.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise DataError("record_bag", "package", f"no {error.name}", "pip install rosbags") from error
    scans, odometry = recording.scans(), dead_reckoning(recording)
    begin = scans.t[0] + 10.0
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        pen = Pen(writer, get_typestore(Stores.LATEST))
        write_place(pen, begin, recording)
        for t, pose in zip(odometry.t, odometry.poses, strict=True):
            if begin <= t < begin + SECONDS:
                write_odometry(pen, t, *pose.tolist())
        for t, ranges in zip(scans.t[::SCAN_EVERY], scans.ranges[::SCAN_EVERY], strict=True):
            if begin <= t < begin + SECONDS:
                write_scan(pen, t, ranges, recording)
    return Path(path)


def write_place(pen: Pen, t: float, recording: Recording) -> None:
    """Write where the LiDAR sits on the robot."""
    place = pen.make("geometry_msgs/Vector3", *recording.robot.lidar.position_b)
    moved = pen.make("geometry_msgs/Transform", place, pen.turn(0.0))
    edge = pen.make("geometry_msgs/TransformStamped", pen.header(t, "base_link"), "laser", moved)
    pen.write("/tf_static", t, pen.make("tf2_msgs/TFMessage", [edge]))


def write_odometry(pen: Pen, t: float, x: float, y: float, yaw: float) -> None:
    """Write a pose of the odometry (m, rad)."""
    unknown, zero = np.zeros(36), pen.make("geometry_msgs/Vector3", 0.0, 0.0, 0.0)
    pose = pen.make("geometry_msgs/Pose", pen.make("geometry_msgs/Point", x, y, 0.0), pen.turn(yaw))
    pose = pen.make("geometry_msgs/PoseWithCovariance", pose, unknown)
    twist = pen.make(
        "geometry_msgs/TwistWithCovariance", pen.make("geometry_msgs/Twist", zero, zero), unknown
    )
    pen.write("/odom", t, pen.make("nav_msgs/Odometry", pen.header(t, "odom"), "base_link", pose, twist))


def write_scan(pen: Pen, t: float, ranges: np.ndarray, recording: Recording) -> None:
    """Write a scan ``(beams,)`` in m, all beams measured at once."""
    lidar = recording.robot.lidar
    angles, limits = (lidar.angle_min, lidar.angle_max, lidar.increment), (lidar.range_min, lidar.range_max)
    values = np.ascontiguousarray(ranges, dtype=np.float32)
    scan = (pen.header(t, "laser"), *angles, 0.0, 0.0, *limits, values, values[:0])
    pen.write("/scan", t, pen.make("sensor_msgs/LaserScan", *scan))
