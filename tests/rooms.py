"""Tiny worlds made by hand: walls as segments, scans by exact geometry, drives whose truth is a closed form.

Nothing here calls the code under test, except to pack the numbers into a ``Recording``.
"""

from dataclasses import replace

import numpy as np

from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, LidarScans, Recording
from pfslam.sensors import EncoderModel, LidarModel, RobotModel

LIDAR = LidarModel(beams=361, position_b=(0.1, 0.0, 0.5))
"""Three quarters of a degree between beams: enough for a small room."""
COUNT = EncoderModel(metres_per_count=0.001)
ENCODER_STEP, GYRO_STEP, SCAN_STEP = 0.025, 0.0125, 0.1


def box(x0, y0, x1, y1):
    """The four walls of a rectangle, rows (ax, ay, bx, by) in metres."""
    return np.array([[x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0]], dtype=float)


ROOM = np.vstack(
    [
        box(-2.03, -1.52, 4.01, 2.48),
        box(1.2, 1.7, 1.9, 2.2),
        box(2.6, -1.1, 3.1, -0.3),
        box(-1.3, 0.9, -1.0, 1.6),
    ]
)
"""A room of 6 m by 4 m with three pillars; no wall lies on a border between cells of 0.05 m."""


def ray_cast(walls, origin, angles, farthest=np.inf):
    """Distance from ``origin`` to the nearest wall in each direction: the ray o + r d meets a + s (b - a)."""
    d = np.column_stack([np.cos(angles), np.sin(angles)])[:, None]
    a, e = walls[:, :2] - origin, walls[:, 2:] - walls[:, :2]
    cross = d[..., 0] * e[:, 1] - d[..., 1] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (a[:, 0] * e[:, 1] - a[:, 1] * e[:, 0]) / cross
        s = (a[:, 0] * d[..., 1] - a[:, 1] * d[..., 0]) / cross
    r[~((s >= 0) & (s <= 1) & (r > 0))] = np.inf
    return np.minimum(r.min(axis=1), farthest)


def distance_to_walls(points, walls=ROOM):
    """Distance from each of ``points (N, 2)`` to the nearest wall."""
    a, b = np.reshape(walls, (-1, 2, 2)).transpose(1, 0, 2)
    to, edge = points[:, None] - a, b - a
    along = np.clip((to * edge).sum(axis=-1) / (edge**2).sum(axis=-1), 0.0, 1.0)
    return np.linalg.norm(to - along[..., None] * edge, axis=-1).min(axis=1)


def sensor_position(pose, lidar=LIDAR):
    x, y, theta = pose
    return np.array([x + lidar.position_b[0] * np.cos(theta), y + lidar.position_b[0] * np.sin(theta)])


def scan(walls, pose, lidar=LIDAR):
    """What a noiseless LiDAR reads at ``pose``; a beam that meets nothing reads 60 m, which is no reading."""
    return ray_cast(walls, sensor_position(pose, lidar), pose[2] + lidar.angles, farthest=60.0)


def arcs(legs):
    """The exact pose as a function of time for legs (seconds, m/s, rad/s), each an arc, a line or a turn."""
    starts, poses = [0.0], [np.zeros(3)]

    def along(pose, v, omega, t):
        x, y, theta = pose
        if omega == 0:
            return np.array([x + v * t * np.cos(theta), y + v * t * np.sin(theta), theta])
        turn = omega * t
        radius = v / omega
        return np.array(
            [
                x + radius * (np.sin(theta + turn) - np.sin(theta)),
                y - radius * (np.cos(theta + turn) - np.cos(theta)),
                theta + turn,
            ]
        )

    for seconds, v, omega in legs:
        starts.append(starts[-1] + seconds)
        poses.append(along(poses[-1], v, omega, seconds))

    def pose(t):
        leg = min(max(int(np.searchsorted(starts, t, side="right")) - 1, 0), len(legs) - 1)
        return along(poses[leg], *legs[leg][1:], t - starts[leg])

    return pose


def drive(legs, walls=ROOM, lidar=LIDAR, epoch=0.0, name="by hand"):
    """A noiseless recording of legs (seconds, counts per encoder reading, rad/s) in a world of walls.

    All legs last a whole number of encoder readings. Every gyro sample is the mean rate of the interval
    that ends at it.
    """
    speeds = [
        (seconds, counts * COUNT.metres_per_count / ENCODER_STEP, omega) for seconds, counts, omega in legs
    ]
    pose, total = arcs(speeds), sum(leg[0] for leg in legs)
    t_encoder = ENCODER_STEP * np.arange(round(total / ENCODER_STEP) + 1)
    t_gyro = GYRO_STEP * np.arange(round(total / GYRO_STEP) + 1)
    t_scan = SCAN_STEP * np.arange(round(total / SCAN_STEP) + 1)
    per_reading = np.concatenate([[0], *(np.full(round(leg[0] / ENCODER_STEP), leg[1]) for leg in legs)])
    per_sample = np.concatenate([[0.0], *(np.full(round(leg[0] / GYRO_STEP), leg[2]) for leg in legs)])
    rates = np.zeros((len(t_gyro), 3))
    rates[:, 2] = per_sample
    return Recording(
        name,
        RobotModel(encoders=COUNT, lidar=lidar),
        Encoders(epoch + t_encoder, np.repeat(per_reading[:, None], 4, axis=1).astype(np.int16)),
        Imu(epoch + t_gyro, rates, np.tile([0.0, 0.0, 1.0], (len(t_gyro), 1))),
        lidar=LidarScans(epoch + t_scan, np.array([scan(walls, pose(t), lidar) for t in t_scan])),
        truth=Trajectory(epoch + t_gyro, np.array([pose(t) for t in t_gyro])),
    )


SQUARE = [(2.0, 12, 0.0), (2.0, 0, np.pi / 4), (1.0, 12, 0.0), (2.0, 0, np.pi / 4), (2.0, 12, 0.0)]
"""Lines and turns on the spot, 0.48 m/s and 45 degrees a second: here Euler steps are exact. It ends facing back."""
CURVES = [(1.0, 10, 0.0), (2.0, 10, 0.8), (1.5, 8, -0.6), (1.0, 10, 0.0)]


def bare_corridor():
    """A drive along two long walls, of which a scanner that sees six metres sees no end."""
    walls = np.array([[-60.0, -1.03, 60.0, -1.03], [-60.0, 1.02, 60.0, 1.02]])
    return drive([(2.0, 12, 0.0)], walls, replace(LIDAR, range_max=6.0))


def blinded(recording, which):
    """The same drive, but these of its scans see nothing."""
    ranges = recording.lidar.ranges.copy()
    ranges[which] = np.inf
    return replace(recording, lidar=LidarScans(recording.lidar.t, ranges))
