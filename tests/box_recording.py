"""A drive made by hand, small enough to check: a robot circles in a rectangular room without any noise."""

import numpy as np
from rooms import box, ray_cast, sensor_position

from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, LidarScans, Recording, RgbdStream
from pfslam.sensors import RobotModel

START = 1_300_000_000.0
ROOM = (-2.0, 3.0, -1.5, 2.5)  # x_min, x_max, y_min, y_max of the walls (m)
SPEED, TURN_RATE = 0.44, 0.4  # 0.44 m/s are 200 counts a second


def box_recording(seconds=6.0, images=4):
    """The drive: encoders at 40 Hz, IMU at 100 Hz 0.2 s less at both ends, scans at 10 Hz, exact truth."""
    t_encoder = START + np.arange(round(seconds * 40) + 1) / 40
    t_imu = START + 0.2 + np.arange(round((seconds - 0.4) * 100) + 1) / 100
    t_scan = START + 0.3 + np.arange(round((seconds - 0.6) * 10) + 1) / 10
    counts = np.full((len(t_encoder), 4), 5, dtype=np.int16)
    turning = np.zeros((len(t_imu), 3))
    turning[:, 2] = TURN_RATE
    gravity = np.tile([0.0, 0.0, 1.0], (len(t_imu), 1))
    poses = true_pose(t_scan - t_imu[0])
    robot = RobotModel()
    ranges = np.stack([room_ranges(pose, robot.lidar) for pose in poses]).astype(np.float32)
    camera = box_camera(START + 0.5, images) if images else None
    seen = {"lidar": LidarScans(t_scan, ranges), "camera": camera, "truth": Trajectory(t_scan, poses)}
    return Recording("box", robot, Encoders(t_encoder, counts), Imu(t_imu, turning, gravity), **seen)


def true_pose(elapsed):
    """Poses (K, 3) on the circle that constant speed and turn rate drive, from (0, 0, 0)."""
    theta = TURN_RATE * np.asarray(elapsed)
    radius = SPEED / TURN_RATE
    return np.stack([radius * np.sin(theta), radius * (1 - np.cos(theta)), theta], axis=-1)


def room_ranges(pose, lidar):
    """What the LiDAR sees from ``pose``: the distance to the walls of the room along each beam."""
    x0, x1, y0, y1 = ROOM
    return ray_cast(box(x0, y0, x1, y1), sensor_position(pose, lidar), pose[2] + lidar.angles)


def box_camera(start, count):
    """Images that can be told apart: disparity k everywhere 400 + k; colour (10 + k, 20, 30)."""
    t = start + np.arange(count) * 0.5
    return RgbdStream(
        t,
        t + 0.01,
        lambda k: np.full((480, 640), 400 + k, dtype=np.uint16),
        lambda j: np.tile(np.array([10 + j, 20, 30], dtype=np.uint8), (480, 640, 1)),
        np.arange(count),
        np.arange(count),
    )


def rewrite(path, **changes):
    """Write an archive again with some arrays changed (or removed, if None); ``__`` in a name is a dot."""
    with np.load(path) as data:
        arrays = {**data} | {name.replace("__", "."): values for name, values in changes.items()}
    np.savez(path, **{name: values for name, values in arrays.items() if values is not None})
