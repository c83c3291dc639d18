"""What more than one chapter asks of a drive: sparser controls and beams, scans along a path, a place to look from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pfslam.cli.figures import map_along
from pfslam.grid import OccupancyGrid
from pfslam.motion import Controls
from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording
from pfslam.sensors import LidarModel, scan_points
from pfslam_book.show.lab import lidar_options, packed_scan


def at_rate(inputs: Controls, hertz: float) -> Controls:
    """The same drive with ``hertz`` controls a second: distance and turning cumulated, then read off evenly."""
    tau = np.diff(inputs.t)
    travelled = np.concatenate([[0.0], np.cumsum(inputs.v * tau)])
    turned = np.concatenate([[0.0], np.cumsum(inputs.omega * tau)])
    steps = int((inputs.t[-1] - inputs.t[0]) * hertz)
    t = inputs.t[0] + np.arange(steps + 1) / hertz
    distance, angle = (np.diff(np.interp(t, inputs.t, total)) for total in (travelled, turned))
    return Controls(t, distance * hertz, angle * hertz)


def sparser(lidar: LidarModel, every: int) -> LidarModel:
    """A LiDAR with every ``every``-th of the beams; the last one must be among them."""
    return replace(lidar, beams=(lidar.beams - 1) // every + 1)


def scans_along(
    recording: Recording, path: Trajectory, which, beams_apart: int = 1, margin: float = 0.35
) -> dict:
    """What a script needs to draw some scans along a path, with stamps that are off by less than ``margin`` (s)."""
    scans, lidar = recording.scans(), sparser(recording.robot.lidar, beams_apart)
    t, ranges = scans.t[which], scans.ranges[which, ::beams_apart]
    near = (path.t > t[0] - margin) & (path.t < t[-1] + margin)
    return {
        "t": (t - t[0]).tolist(),
        "ranges": [packed_scan(one, lidar) for one in ranges],
        "times": np.round(path.t[near] - t[0], 6).tolist(),
        "poses": np.round(path.poses[near], 6).tolist(),
        "lidar": lidar_options(lidar),
    }


@dataclass(frozen=True, eq=False)
class Place:
    """A map drawn from true poses, a scan that is not in it, and a pose to look from: the true one at first.

    ``points_b (M, 2)`` end points in the body frame (m), ``pose (3,)`` in the world.
    """

    grid: OccupancyGrid
    points_b: np.ndarray
    pose: np.ndarray

    def moved(self, dx: float = 0.0, dy: float = 0.0, dtheta: float = 0.0) -> np.ndarray:
        """The end points ``(M, 2)`` in the world from beside the pose: dx, dy (m) along the world's axes, rad."""
        return transform_points(self.pose + [dx, dy, dtheta], self.points_b)

    def lost(self, dx: float, dy: float, dtheta: float) -> Place:
        """The same map and scan, looked at from a pose that is off by so much."""
        return replace(self, pose=self.pose + [dx, dy, dtheta])


def place_at(recording: Recording, seconds: float, every: int = 10) -> Place:
    """What the robot knows ``seconds`` after its first scan: the map of the scans before, and the scan of now."""
    scans, truth = recording.scans(), recording.true_path()
    stamps = scans.t
    now = int(np.searchsorted(stamps, stamps[0] + seconds))
    past = Trajectory(truth.t[truth.t < stamps[now]], truth.poses[truth.t < stamps[now]])
    points = scan_points(scans.ranges[now], recording.robot.lidar)
    return Place(map_along(recording, past, every=every), points, truth.at(stamps[now]))
