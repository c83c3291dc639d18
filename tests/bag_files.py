"""Bags to test with, in all formats: a list of messages becomes a bag, by the library that the package reads with."""

from pathlib import Path

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pfslam.motion import dead_reckoning

FORMATS = ("ros1", "sqlite3", "mcap", "mcap file")
COMPRESSED = ("zstd files", "zstd messages")
"""As recorders compress on request: folders of sqlite3."""
SCAN, ODOMETRY, IMU = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
TF, IMAGE = "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/Image"
INFO = "sensor_msgs/msg/CameraInfo"
LEVEL = (0.0, 0.0, 0.0, 1.0)
UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)
"""Half a turn about x, as a quaternion x, y, z, w."""
LATER = 2_000_000
"""Nanoseconds from a message's stamp to its arrival in the bag."""


def store_of(is_old):
    """The standard types of ROS 1 or ROS 2."""
    store = get_typestore(Stores.ROS1_NOETIC if is_old else Stores.LATEST)
    if is_old:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


class Messages:
    """Makes messages of ROS 1 or ROS 2; ``t`` is in seconds."""

    def __init__(self, is_old=False):
        self.is_old = is_old
        self.store = store_of(is_old)

    def make(self, kind, **fields):
        return self.store.types[kind](**fields)

    def header(self, t, frame):
        nanoseconds = round(float(t % 1.0) * 1e9)
        stamp = self.make("builtin_interfaces/msg/Time", sec=int(t // 1.0), nanosec=nanoseconds)
        extra = {"seq": 0} if self.is_old else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **extra)

    def vector(self, xyz, kind="Vector3"):
        return self.make(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", map(float, xyz), strict=True)))

    def turn(self, xyzw):
        return self.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, xyzw), strict=True)))

    def scan(self, t, ranges, lidar, frame="laser", sweep=0.0, **changes):
        steps = max(len(ranges) - 1, 1)
        fields = {
            "angle_min": lidar.angle_min,
            "angle_max": lidar.angle_max,
            "angle_increment": lidar.increment,
            "time_increment": sweep / steps,
            "scan_time": 0.0,
            "range_min": lidar.range_min,
            "range_max": lidar.range_max,
        }
        ranges = np.array(ranges, dtype=np.float32, order="C")
        none = np.zeros(0, dtype=np.float32)
        return self.make(
            SCAN, header=self.header(t, frame), ranges=ranges, intensities=none, **(fields | changes)
        )

    def other_scan(self, kind, t):
        """An empty scan of a type that is not LaserScan."""
        if kind == "PointCloud2":
            fields = {"height": 1, "width": 0, "fields": [], "is_bigendian": False, "point_step": 12}
            fields |= {"row_step": 0, "data": np.zeros(0, dtype=np.uint8), "is_dense": True}
        else:
            names = "angle_min angle_max angle_increment time_increment scan_time range_min range_max"
            fields = dict.fromkeys(names.split(), 0.1) | {"ranges": [], "intensities": []}
        return self.make(f"sensor_msgs/msg/{kind}", header=self.header(t, "laser"), **fields)

    def odometry(self, t, pose, child="base_link"):
        x, y, theta = pose
        place = self.make(
            "geometry_msgs/msg/Pose",
            position=self.vector((x, y, 0.0), "Point"),
            orientation=self.turn((0.0, 0.0, np.sin(theta / 2), np.cos(theta / 2))),
        )
        still = self.make(
            "geometry_msgs/msg/Twist", linear=self.vector((0,) * 3), angular=self.vector((0,) * 3)
        )
        unknown = np.zeros(36)
        return self.make(
            ODOMETRY,
            header=self.header(t, "odom"),
            child_frame_id=child,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=place, covariance=unknown),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=still, covariance=unknown),
        )

    def imu(self, t, rates, pushes, frame="imu_link"):
        return self.make(
            IMU,
            header=self.header(t, frame),
            orientation=self.turn(LEVEL),
            orientation_covariance=np.zeros(9),
            angular_velocity=self.vector(rates),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(pushes),
            linear_acceleration_covariance=np.zeros(9),
        )

    def transforms(self, t, *edges):
        """``edges`` are (parent, child, position, quaternion)."""
        stamped = [
            self.make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(t, parent),
                child_frame_id=child,
                transform=self.make(
                    "geometry_msgs/msg/Transform", translation=self.vector(place), rotation=self.turn(turn)
                ),
            )
            for parent, child, place, turn in edges
        ]
        return self.make(TF, transforms=stamped)

    def image(self, t, pixels, encoding, frame="optical", padding=0):
        """``pixels`` are (H, W) or (H, W, channels); ``padding`` bytes follow each row."""
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        fields = {
            "encoding": encoding,
            "is_bigendian": int(pixels.dtype.byteorder == ">"),
            "step": rows.shape[1],
        }
        size = {"height": pixels.shape[0], "width": pixels.shape[1]}
        return self.make(IMAGE, header=self.header(t, frame), data=rows.ravel().copy(), **size, **fields)

    def camera_info(self, t, K, height, width):
        names = "DKRP" if self.is_old else "dkrp"
        values = np.zeros(5), K.ravel(), np.eye(3).ravel(), np.zeros(12)
        region = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        fields = {
            "height": height,
            "width": width,
            "distortion_model": "plumb_bob",
            "binning_x": 0,
            "binning_y": 0,
        }
        fields |= dict(zip(names, values, strict=True)) | {"roi": region}
        return self.make(INFO, header=self.header(t, "optical"), **fields)


def nanoseconds(t):
    return int(t // 1.0) * 10**9 + round(float(t % 1.0) * 1e9)


def write_bag(path, form, rows):
    """Write rows of (topic, arrival in nanoseconds, message) and return the path to read."""
    path = Path(path)
    if form == "ros1":
        writer, store = rosbag1.Writer(path.with_suffix(".bag")), store_of(True)
        serialize = store.serialize_ros1
    else:
        plugin = StoragePlugin.MCAP if "mcap" in form else StoragePlugin.SQLITE3
        writer, store = rosbag2.Writer(path, version=9, storage_plugin=plugin), store_of(False)
        if form in COMPRESSED:
            mode = CompressionMode.FILE if form == "zstd files" else CompressionMode.MESSAGE
            writer.set_compression(mode, CompressionFormat.ZSTD)
        serialize = store.serialize_cdr
    with writer:
        known = {}
        for topic, arrived, message in rows:
            kind = message.__msgtype__
            if topic not in known:
                known[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(known[topic], arrived, serialize(message, kind))
    if form == "ros1":
        return path.with_suffix(".bag")
    return next(path.glob("*.mcap")) if form == "mcap file" else path


def rows_of(recording, is_old=False, *, odometry=None, sweep=0.0, mount=None, child="base_link"):
    """The messages of a recording: its scans and its odometry, with the LiDAR's place in two hops of /tf_static."""
    messages, lidar = Messages(is_old), recording.robot.lidar
    odometry = dead_reckoning(recording) if odometry is None else odometry
    x, y, z = lidar.position_b
    mount = mount or [(child, "plate", (0.0, 0.0, z), LEVEL), ("plate", "laser", (x, y, 0.0), LEVEL)]
    start = nanoseconds(odometry.t[0])
    rows = [("/tf_static", start, messages.transforms(0.0, *mount))]
    for t, ranges in zip(recording.lidar.t, recording.lidar.ranges, strict=True):
        stamp = t - 0.5 * sweep
        rows.append(("/scan", nanoseconds(t) + LATER, messages.scan(stamp, ranges, lidar, sweep=sweep)))
    for t, pose in zip(odometry.t, odometry.poses, strict=True):
        rows.append(("/odom", nanoseconds(t) + LATER, messages.odometry(t, pose, child)))
    return sorted(rows, key=lambda row: row[1])
