"""SLAM in a robot's own node. The loop knows no ROS: it takes what looks like its messages. ``main`` is the node."""

import sys
from array import array
from collections import deque
from pathlib import Path

import numpy as np

import pfslam
from pfslam.grid import probability
from pfslam.sensors import LidarModel

PLACE = (0.1, 0.0, 0.3)
"""Where the LiDAR sits on the robot: forward, left and up, in metres."""


class Loop:
    """Odometry goes to the mapper as it comes, and scans wait for it; a drive that was saved is gone on with."""

    def __init__(self, file, place=PLACE):
        self.file, self.place = Path(file), place
        self.mapper = pfslam.Mapper.load(file) if self.file.exists() else None
        self.scans, self.odometry, self.last = deque(), deque(maxlen=500), 0.0

    def on_odometry(self, message):
        p, q = message.pose.pose.position, message.pose.pose.orientation
        t = stamp(message)
        if t > self.last:  # a message may come twice
            self.odometry.append((t, (p.x, p.y, 2.0 * np.arctan2(q.z, q.w))))
            self.last = t
        while self.mapper and self.odometry:  # until the first scan they wait
            self.mapper.add_odometry(*self.odometry.popleft())

    def on_scan(self, message):
        """Keep a scan, and yield a step for each one whose time has come."""
        sweep = (len(message.ranges) - 1) * message.time_increment
        self.mapper = self.mapper or pfslam.Mapper(self.lidar_of(message, sweep))
        self.scans.append((stamp(message) + 0.5 * sweep, message.ranges))  # ROS stamps the first beam
        while self.scans and self.mapper.reaches(self.scans[0][0]):
            t, ranges = self.scans.popleft()
            if self.mapper.covers(t):
                yield self.mapper.add(t, ranges)

    def lidar_of(self, scan, sweep):
        last = scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment
        limits = scan.range_min, scan.range_max
        return LidarModel(scan.angle_min, last, len(scan.ranges), *limits, self.place, sweep)


def stamp(message):
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def fill_header(header, mapper):
    """The map's frame, and the time of the last scan that the mapper took; others may wait already."""
    t, header.frame_id = mapper.steps[-1].t, "map"
    header.stamp.sec, header.stamp.nanosec = int(t), int(t % 1.0 * 1e9)


def fill_map(message, mapper):
    """Write the map into an OccupancyGrid: 0 to 100, and -1 where nothing was seen."""
    fill_header(message.header, mapper)
    grid, message.info.resolution = mapper.grid, mapper.grid.spec.resolution
    message.info.height, message.info.width = grid.spec.shape
    message.info.origin.position.x, message.info.origin.position.y = grid.spec.origin
    message.info.origin.orientation.w = 1.0
    percent = np.rint(100.0 * probability(grid.log_odds))
    message.data = array("b", np.where(grid.log_odds == 0.0, -1, percent).astype(np.int8).tobytes())


def fill_pose(message, mapper):
    """Write pose and covariance into a PoseWithCovarianceStamped."""
    fill_header(message.header, mapper)
    (x, y, theta), pose = map(float, mapper.pose), message.pose.pose
    pose.position.x, pose.position.y = x, y
    pose.orientation.z, pose.orientation.w = float(np.sin(theta / 2)), float(np.cos(theta / 2))
    covariance = np.zeros((6, 6))  # of x, y, z, roll, pitch, yaw
    covariance[np.ix_([0, 1, 5], [0, 1, 5])] = mapper.covariance
    message.pose.covariance = covariance.ravel()


def main(file="belief.npz"):
    import rclpy
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import OccupancyGrid, Odometry
    from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
    from sensor_msgs.msg import LaserScan

    rclpy.init()
    node, loop = rclpy.create_node("pfslam"), Loop(file)
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    maps = node.create_publisher(OccupancyGrid, "map", kept)
    poses = node.create_publisher(PoseWithCovarianceStamped, "pose", 10)

    def on_scan(scan):
        for _ in loop.on_scan(scan):
            message = PoseWithCovarianceStamped()
            fill_pose(message, loop.mapper)
            poses.publish(message)

    def every_second():
        if loop.mapper:
            message = OccupancyGrid()
            fill_map(message, loop.mapper)
            maps.publish(message)
            if loop.mapper.doubt:
                node.get_logger().warning(loop.mapper.doubt)

    node.create_subscription(Odometry, "odom", loop.on_odometry, qos_profile_sensor_data)
    node.create_subscription(LaserScan, "scan", on_scan, qos_profile_sensor_data)
    node.create_timer(1.0, every_second)
    node.create_timer(60.0, lambda: loop.mapper and loop.mapper.save(loop.file))
    rclpy.spin(node)


if __name__ == "__main__":
    main(*sys.argv[1:])
