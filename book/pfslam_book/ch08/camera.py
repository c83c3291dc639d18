"""Chapter 08, faults of the camera: where one image puts the floor, and which images belong together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording, RgbdStream, nearest_stamp
from pfslam.refined.floor import read_disparity
from pfslam.sensors import RgbdModel, scan_points
from pfslam.simulator.cache import cached_simulation
from pfslam.texture import back_project, depth_from_disparity, to_world

SHOT = 900
"""A disparity image with floor ahead and walls on both sides."""
AHEAD = np.array([[2.0, 0.0]])
"""A point of the floor two metres ahead of the robot."""


@dataclass(frozen=True, eq=False)
class Look:
    """A disparity image, which of its pixels truly show floor ``(H, W)``, and the LiDAR's points ``(M, 2)`` (b, m)."""

    disparity: np.ndarray
    ground: np.ndarray
    walls_b: np.ndarray


def look(name: str = "hall", number: int = SHOT) -> Look:
    """Return disparity image ``number`` of a built-in set with the scan nearest in time."""
    simulation = cached_simulation(name)
    recording = simulation.recording
    stream, scans, camera = recording.camera, recording.scans(), recording.robot.camera
    if stream is None:  # the simulator makes one
        raise ValueError(f"{name}: no camera")
    nearest = int(nearest_stamp(scans.t, stream.disparity_t[number : number + 1])[0])
    renderer = simulation.renderer
    ground = renderer.see(renderer.depth_eye, float(renderer.disparity_t[number])).ground
    walls = scan_points(scans.ranges[nearest], recording.robot.lidar)
    return Look(read_disparity(stream, number, camera), ground, walls)


def seen_points(shot: Look, camera: RgbdModel, floor: bool, step: int = 4) -> np.ndarray:
    """Return where a camera model puts the pixels that truly show floor, or those that do not: ``(M, 3)`` (body, m)."""
    v, u = (axis.ravel() for axis in np.mgrid[: camera.height : step, : camera.width : step])
    depth = depth_from_disparity(shot.disparity[v, u], camera)
    chosen = (shot.ground[v, u] == floor) & np.isfinite(depth)
    v, u, depth = v[chosen], u[chosen], depth[chosen]
    return to_world(back_project(u, v, depth, camera.K), np.zeros(3), camera)


def wall_range_error(shot: Look, points: np.ndarray, turn: float = 0.0) -> np.ndarray:
    """Return how much farther (m) than the LiDAR's nearest beam the camera sees each wall point after a turn (rad)."""
    c, s = np.cos(turn), np.sin(turn)
    x, y = c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]
    bearing = np.arctan2(shot.walls_b[:, 1], shot.walls_b[:, 0])
    order = np.argsort(bearing)
    beam = order[nearest_stamp(bearing[order], np.arctan2(y, x))]
    return np.hypot(x, y) - np.hypot(*shot.walls_b[beam].T)


def wall_turn_deg(shot: Look, points: np.ndarray) -> float:
    """Return by how many degrees the camera's walls have to be turned to lie on the LiDAR's."""
    turns = np.deg2rad(np.arange(-12.0, 12.01, 0.25))
    misfit = [np.median(np.abs(wall_range_error(shot, points, turn))) for turn in turns]
    return float(np.rad2deg(turns[int(np.argmin(misfit))]))


def floor_tilt_deg(points: np.ndarray, to: float = 3.5) -> float:
    """Return how steep (deg) the floor seems to rise ahead of the robot."""
    x, z = points[:, 0], points[:, 2]
    near = (x > 0.5) & (x < to)
    return float(np.rad2deg(np.arctan(np.polyfit(x[near], z[near], 1)[0])))


def heights(points: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return middle of each bin of distance (m), and the median height of the points in it."""
    bins = np.digitize(points[:, 0], edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    z = [np.median(points[bins == k + 1, 2]) if (bins == k + 1).any() else np.nan for k in range(len(middle))]
    return middle, np.array(z)


def pair_gap(stream: RgbdStream, disparity: np.ndarray, rgb: np.ndarray) -> np.ndarray:
    """Return seconds between the two images of each pair."""
    return np.abs(stream.rgb_t[rgb] - stream.disparity_t[disparity])


def nearest_pairs(stream: RgbdStream) -> tuple[np.ndarray, np.ndarray]:
    """Return each colour image with the disparity image nearest in time."""
    rgb = np.arange(len(stream.rgb_t))
    return nearest_stamp(stream.disparity_t, stream.rgb_t), rgb


def colour_shift(
    stream: RgbdStream, disparity: np.ndarray, rgb: np.ndarray, truth: Trajectory
) -> tuple[np.ndarray, np.ndarray]:
    """Return the yaw rate (rad/s) and how far off (m) the colour two metres ahead comes from, for each pair."""
    t, t_rgb = stream.disparity_t[disparity], stream.rgb_t[rgb]
    inside = truth.covers(t - 0.05) & truth.covers(t + 0.05) & truth.covers(t_rgb)
    t, t_rgb = t[inside], t_rgb[inside]
    there, here = (
        np.array([transform_points(pose, AHEAD)[0] for pose in truth.at(times)]) for times in (t_rgb, t)
    )
    turned = truth.at(t + 0.05)[:, 2] - truth.at(t - 0.05)[:, 2]
    rate = np.abs((turned + np.pi) % (2 * np.pi) - np.pi) / 0.1
    return rate, np.hypot(*(there - here).T)


def swap_pixels(recording: Recording) -> float:
    """Return by how many columns a swapped principal point moves every pixel."""
    camera = recording.robot.camera
    return camera.centre_u - camera.centre_v


def swap_angle_deg(recording: Recording, edge: float) -> float:
    """Return the turn (deg) of a ray by the swapped principal point, from the image's middle (0) to its edge (1)."""
    camera = recording.robot.camera
    across = edge * 0.5 * camera.width / camera.focal_u
    return float(np.rad2deg(swap_pixels(recording) / camera.focal_u / (1.0 + across**2)))
