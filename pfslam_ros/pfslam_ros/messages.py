"""What the node publishes: each function fills a message whose class is given, so that none imports ROS."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from typing import Any

import numpy as np

from pfslam.grid import OccupancyGrid, probability


def fill_header(header: Any, t: float, frame: str) -> None:
    """Write a time (s) and the name of a frame into a header."""
    header.stamp.sec, header.stamp.nanosec = divmod(round(t * 1e9), 10**9)
    header.frame_id = frame


def fill_pose(pose: Any, planar: np.ndarray) -> None:
    """Write a pose ``(3,)`` (m, m, rad) into a geometry_msgs/Pose."""
    pose.position.x, pose.position.y, theta = map(float, planar)
    pose.orientation.z, pose.orientation.w = float(np.sin(0.5 * theta)), float(np.cos(0.5 * theta))


def transform_of(new: Any, t: float, frame: str, child: str, planar: np.ndarray) -> Any:
    """Make a TransformStamped: the pose ``(3,)`` of ``child`` in ``frame``."""
    message = new()
    fill_header(message.header, t, frame)
    message.child_frame_id, T = child, message.transform
    T.translation.x, T.translation.y, theta = map(float, planar)
    T.rotation.z, T.rotation.w = float(np.sin(0.5 * theta)), float(np.cos(0.5 * theta))
    return message


def pose_of(new: Any, t: float, frame: str, planar: np.ndarray, covariance: np.ndarray | None) -> Any:
    """Make a PoseWithCovarianceStamped; covariance ``(3, 3)`` of x, y and heading, None where it is not known."""
    message = new()
    fill_header(message.header, t, frame)
    fill_pose(message.pose.pose, planar)
    whole = np.zeros((6, 6))  # of x, y, z, roll, pitch, yaw
    if covariance is not None:
        whole[np.ix_([0, 1, 5], [0, 1, 5])] = covariance
    message.pose.covariance = whole.ravel()
    return message


def map_of(new: Any, t: float, frame: str, grid: OccupancyGrid) -> Any:
    """Make an OccupancyGrid: 0 to 100, and -1 where nothing was seen."""
    message = new()
    fill_header(message.header, t, frame)
    message.info.resolution = float(grid.spec.resolution)
    message.info.height, message.info.width = map(int, grid.spec.shape)
    fill_pose(message.info.origin, np.append(grid.spec.origin, 0.0))
    percent = np.rint(100.0 * probability(grid.log_odds))
    message.data = array("b", np.where(grid.log_odds == 0.0, -1, percent).astype(np.int8).tobytes())
    return message


def path_of(new: Any, new_pose: Any, path: Iterable[tuple[float, np.ndarray]], frame: str) -> Any:
    """Make a Path of poses with their times."""
    message, poses = new(), []
    for t, planar in path:
        poses.append(new_pose())
        fill_header(poses[-1].header, t, frame)
        fill_pose(poses[-1].pose, planar)
    message.poses = poses
    fill_header(message.header, t if poses else 0.0, frame)
    return message


def diagnosis_of(new: Any, new_status: Any, new_value: Any, t: float, doubt: str | None, values: dict) -> Any:
    """Make a DiagnosticArray of one status: OK, or a warning that gives the reason for doubt."""
    message, status = new(), new_status()
    fill_header(message.header, t, "")
    status.name, status.message = "pfslam: pose", doubt or "the pose is not in doubt"
    status.level = type(status).WARN if doubt else type(status).OK
    for key, value in values.items():
        status.values.append(new_value())
        status.values[-1].key, status.values[-1].value = key, str(value)
    message.status = [status]
    return message
