"""Bags to test with, in all formats: a list of messages becomes a bag, by the library that the package reads with."""

from functools import cache
from pathlib import Path

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pfslam.motion import dead_reckoning

FORMATS = ("ros1", "sqlite3", "mcap", "mcap file")
COMPRESSED = ("zstd files", "zstd messages", "mcap, zstd chunks")
"""As recorders compress on request: the first two are folders of sqlite3."""
OLD_COMPRESSED = ("ros1, bz2", "ros1, lz4")
LEVEL = (0.0, 0.0, 0.0, 1.0)
UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)
"""Half a turn about x, as a quaternion x, y, z, w."""
LATER = 2_000_000
"""Nanoseconds from a message's stamp to its arrival in the bag."""


@cache
def store_of(is_old):
    """The standard types of ROS 1 or ROS 2."""
    store = get_typestore(Stores.ROS1_NOETIC if is_old else Stores.LATEST)
    if is_old:
        text = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
    return store


class Messages:
    """Makes messages of ROS 1 or ROS 2; ``t`` is in seconds."""

    def __init__(self, is_old=False):
        self.is_old = is_old
        self.store = store_of(is_old)

    def make(self, kind, **fields):
        """A message with these fields, and nothing or zeros in all others."""
        empty = {name: self._empty(*what) for name, what in self.store.fielddefs[kind][1]}
        return self.store.types[kind](**(empty | fields))

    def _empty(self, node, what):
        if node == Nodetype.NAME:
            return self.make(what)
        if node == Nodetype.BASE:
            return {"string": "", "bool": False}.get(what[0], 0.0 if "float" in what[0] else 0)
        (node, inner), count = what
        return np.zeros(count, dtype=inner[0]) if node == Nodetype.BASE and inner[0] != "string" else []

    def header(self, t, frame):
        parts = {"sec": int(t // 1.0), "nanosec": round(float(t % 1.0) * 1e9)}
        stamp = self.make("builtin_interfaces/msg/Time", **parts)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def vector(self, xyz, kind="Vector3"):
        return self.make(f"geometry_msgs/msg/{kind}", **dict(zip("xyzw", map(float, xyz), strict=False)))

    def turn(self, xyzw):
        return self.vector(xyzw, "Quaternion")

    def scan(self, t, ranges, lidar, sweep=0.0):
        fields = {name: getattr(lidar, name) for name in ("angle_min", "angle_max", "range_min", "range_max")}
        fields |= {"angle_increment": lidar.increment, "time_increment": sweep / max(len(ranges) - 1, 1)}
        fields["ranges"] = np.array(ranges, dtype=np.float32, order="C")
        return self.make("sensor_msgs/msg/LaserScan", header=self.header(t, "laser"), **fields)

    def cloud(self, t, points, frame="laser", kind="<f4", lead=0, tail=0, rows=1, padding=0):
        """``points`` (N, 3) between ``lead`` and ``tail`` bytes each, in ``rows`` with ``padding`` bytes after them."""
        size = np.dtype(kind).itemsize
        records = np.full((len(points), lead + 3 * size + tail), 77, dtype=np.uint8)
        records[:, lead : lead + 3 * size] = (
            np.ascontiguousarray(points, kind).view(np.uint8).reshape(-1, 3 * size)
        )
        lines = np.pad(records.reshape(rows, -1), ((0, 0), (0, padding)))
        about = {"height": rows, "width": len(points) // rows, "is_bigendian": kind[0] == ">"}
        about |= {"point_step": records.shape[1], "row_step": lines.shape[1], "data": lines.ravel().copy()}
        of = {"datatype": {4: 7, 8: 8}[size], "count": 1}
        about["fields"] = [
            self.make("sensor_msgs/msg/PointField", name=axis, offset=lead + k * size, **of)
            for k, axis in enumerate("xyz")
        ]
        return self.make("sensor_msgs/msg/PointCloud2", header=self.header(t, frame), **about)

    def timed_cloud(self, t, points, field, kind, times):
        """``points`` (N, 3) with a ``field`` of that ``kind`` of number: what a driver says of their ``times`` (N,)."""
        tail = np.dtype(kind).itemsize
        message = self.cloud(t, points, tail=tail)
        records = message.data.reshape(-1, 12 + tail)
        records[:, 12:] = np.asarray(times, kind)[:, None].view(np.uint8)
        of = {"datatype": {"<i4": 5, "<u4": 6, "<f4": 7, "<f8": 8}[kind], "count": 1, "offset": 12}
        message.fields.append(self.make("sensor_msgs/msg/PointField", name=field, **of))
        return message

    def odometry(self, t, pose, child="base_link"):
        x, y, theta = pose
        turn = self.turn((0.0, 0.0, np.sin(theta / 2), np.cos(theta / 2)))
        place = self.make(
            "geometry_msgs/msg/Pose", position=self.vector((x, y, 0), "Point"), orientation=turn
        )
        covered = self.make("geometry_msgs/msg/PoseWithCovariance", pose=place)
        fields = {"header": self.header(t, "odom"), "child_frame_id": child, "pose": covered}
        return self.make("nav_msgs/msg/Odometry", **fields)

    def imu(self, t, rates, pushes, frame="imu_link"):
        fields = {"angular_velocity": self.vector(rates), "linear_acceleration": self.vector(pushes)}
        return self.make("sensor_msgs/msg/Imu", header=self.header(t, frame), **fields)

    def transforms(self, t, *edges):
        """``edges`` are (parent, child, position, quaternion)."""
        stamped = []
        for parent, child, place, turn in edges:
            parts = {"translation": self.vector(place), "rotation": self.turn(turn)}
            fields = {"transform": self.make("geometry_msgs/msg/Transform", **parts), "child_frame_id": child}
            fields["header"] = self.header(t, parent)
            stamped.append(self.make("geometry_msgs/msg/TransformStamped", **fields))
        return self.make("tf2_msgs/msg/TFMessage", transforms=stamped)

    def image(self, t, pixels, encoding, frame="optical", padding=0):
        """``pixels`` are (H, W) or (H, W, channels); ``padding`` bytes follow each row."""
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        fields = {"encoding": encoding, "is_bigendian": int(pixels.dtype.byteorder == ">")}
        fields |= {"height": pixels.shape[0], "width": pixels.shape[1], "step": rows.shape[1]}
        header = self.header(t, frame)
        return self.make("sensor_msgs/msg/Image", header=header, data=rows.ravel().copy(), **fields)

    def camera_info(self, t, K, height, width):
        fields = {"height": height, "width": width, "K" if self.is_old else "k": K.ravel()}
        return self.make("sensor_msgs/msg/CameraInfo", header=self.header(t, "optical"), **fields)


def nanoseconds(t):
    return int(t // 1.0) * 10**9 + round(float(t % 1.0) * 1e9)


def write_bag(path, form, rows):
    """Write rows of (topic, arrival in nanoseconds, message), as they arrive, and return the path to read."""
    path = Path(path)
    if form.startswith("ros1"):
        path, store = path.with_suffix(".bag"), store_of(True)
        writer, serialize = rosbag1.Writer(path), store.serialize_ros1
        if form in OLD_COMPRESSED:
            writer.set_compression(rosbag1.Writer.CompressionFormat[form[-3:].upper()])
    else:
        plugin = StoragePlugin.MCAP if "mcap" in form else StoragePlugin.SQLITE3
        writer, store = rosbag2.Writer(path, version=9, storage_plugin=plugin), store_of(False)
        if form in COMPRESSED:
            modes = CompressionMode.FILE, CompressionMode.MESSAGE, CompressionMode.STORAGE
            writer.set_compression(modes[COMPRESSED.index(form)], CompressionFormat.ZSTD)
        serialize = store.serialize_cdr
    with writer:
        known = {}
        for topic, arrived, message in sorted(rows, key=lambda row: row[1]):
            kind = message.__msgtype__
            if topic not in known:
                known[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(known[topic], arrived, serialize(message, kind))
    return next(path.glob("*.mcap")) if form == "mcap file" else path


def rows_of(recording, is_old=False, *, sweep=0.0, mount=None, child="base_link"):
    """The messages of a recording: its scans and its odometry, with the LiDAR's place in two hops of /tf_static."""
    messages, lidar, odometry = Messages(is_old), recording.robot.lidar, dead_reckoning(recording)
    x, y, z = lidar.position_b
    mount = mount or [(child, "plate", (0.0, 0.0, z), LEVEL), ("plate", "laser", (x, y, 0.0), LEVEL)]
    rows = [("/tf_static", nanoseconds(odometry.t[0]), messages.transforms(0.0, *mount))]
    for t, ranges in zip(recording.lidar.t, recording.lidar.ranges, strict=True):
        scan = messages.scan(t - 0.5 * sweep, ranges, lidar, sweep)
        rows.append(("/scan", nanoseconds(t) + LATER, scan))
    for t, pose in zip(odometry.t, odometry.poses, strict=True):
        rows.append(("/odom", nanoseconds(t) + LATER, messages.odometry(t, pose, child)))
    return rows
