"""CARMEN logs: laser scans with odometry, one message a line.

Read are the old laser message FLASER, the new one ROBOTLASER1, and RAWLASER1 with ODOM. The time of a scan is
when its message was sent (``ipc_timestamp``); the relations of the benchmark use the same.

A log too long to hold its scans in memory is read twice: all lines for their stamps and poses, and those of the scans
again, one by one, for their ranges, which go into a file. ``streams.carmen_to_file`` does the same with a file to keep.
"""

from __future__ import annotations

import os
import tempfile
from array import array
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pfslam.errors import DataError
from pfslam.io.carmen_lines import CarmenLog, ranges_again, read_log
from pfslam.io.files import reason
from pfslam.io.formats import numbers
from pfslam.poses import Trajectory, between
from pfslam.recording import LidarScans, Recording
from pfslam.sensors import LidarModel, RobotModel

MAX_COORDINATE = 1e8
LONG_LOG_BYTES = 256 * 2**20
"""A log of so many bytes is long: its ranges are not held in memory."""
SENSOR_HEIGHT = 0.35
"""The logs do not say how high the scanner sits; for a flat floor it does not matter."""


def load_carmen(path: str | Path) -> Recording:
    """The recording of a CARMEN log: scans, odometry poses as logged, and the laser as the log describes it.

    Lines are put in the order of their stamps; of those with the same stamp the first counts. What is left
    out is counted in ``recording.dropped``. The ranges of a long log lie in a nameless file in the system's temporary
    folder, and cannot be changed. Raises ``DataError`` naming the line for what cannot be read.
    """
    if os.path.isfile(path) and os.path.getsize(path) >= LONG_LOG_BYTES:
        log = read_log(path, lambda ranges: None)
        return log_recording(log, lambda order: _ranges_in_a_file(log, order))
    ranges: list[np.ndarray] = []
    log = read_log(path, ranges.append)
    return log_recording(log, lambda order: np.stack([ranges[k] for k in order]))


def _ranges_in_a_file(log: CarmenLog, order: np.ndarray) -> np.ndarray:
    """The ranges ``(K, beams)`` of scans by number, in a file without a name: it goes with its last reader."""
    try:
        with tempfile.TemporaryFile() as file:
            for ranges in ranges_again(log, order):
                file.write(ranges.astype("<f4").tobytes())
            file.flush()
            return np.memmap(file, "<f4", "r", shape=(len(order), log.beams))
    except OSError as error:
        room = (
            f"{4 * len(order) * log.beams / 1e6:.0f} MB of room in the temporary folder, which TMPDIR names"
        )
        raise DataError(log.path, "scans", reason(error), room) from error


def log_recording(log: CarmenLog, ranges_of: Callable[[np.ndarray], np.ndarray]) -> Recording:
    """The recording that a log adds up to. ``ranges_of(order)`` gives the ranges ``(K, beams)`` of scans by number."""
    if not log.scan_t:
        raise DataError(log.path, "laser messages", "none", "lines of FLASER, ROBOTLASER1 or RAWLASER1")
    order = _increasing(log, np.array(log.scan_t), "scans with the stamp of another")
    t = np.array(log.scan_t)[order]
    if len(log.robot_at_scan) == 3 * len(log.scan_t):
        odometry = Trajectory(t, _pose_columns(log, log.robot_at_scan, 3)[order])
    elif log.odometry and not log.robot_at_scan:
        rows = _pose_columns(log, log.odometry, 4)
        rows = rows[_increasing(log, rows[:, 0], "odometry with the stamp of another")]
        odometry = Trajectory(rows[:, 0], rows[:, 1:])
    else:
        raise DataError(log.path, "odometry", "none for some scans", "poses in the scans, or ODOM lines")
    robot = RobotModel(lidar=_lidar(log))
    lidar = LidarScans(t, ranges_of(order))
    not_numbers = sum(int(np.count_nonzero(np.isnan(scan))) for scan in lidar.ranges)
    log.count("ranges that are not a number", not_numbers)
    return Recording(log.path.stem, robot, None, None, odometry, lidar, default_every=1, dropped=log.dropped)


def _pose_columns(log: CarmenLog, values: array, columns: int) -> np.ndarray:
    """Rows of odometry as an array, refused if a robot cannot have been there."""
    table = np.array(values).reshape(-1, columns)
    if np.abs(table[:, -3:]).max() > MAX_COORDINATE:
        at = int(np.argmax(np.abs(table[:, -3:]).max(axis=1)))
        found = " ".join(f"{value:g}" for value in table[at, -3:])
        raise DataError(log.path, f"odometry {at + 1}", found, f"m and rad, at most {MAX_COORDINATE:g}")
    return table


def _increasing(log: CarmenLog, t: np.ndarray, reason: str) -> np.ndarray:
    """Indices that put stamps in strictly increasing order."""
    order = np.argsort(t, kind="stable")
    first = np.concatenate([[True], np.diff(t[order]) > 0])
    log.count(reason, int(np.count_nonzero(~first)))
    return order[first]


def _lidar(log: CarmenLog) -> LidarModel:
    """The laser: angles and range limit from its messages, mounting from PARAM lines or the poses."""
    x, y, yaw = _mounting(log)
    low, high = (float(angle + yaw) for angle in log.angles)
    position = float(x), float(y), SENSOR_HEIGHT
    try:
        return LidarModel(low, high, log.beams, range_max=log.range_max, position_b=position)
    except DataError as error:
        raise DataError(log.path, f"laser, {error.field}", error.found, error.expected) from None


def _mounting(log: CarmenLog) -> np.ndarray:
    """Pose ``(3,)`` of the laser on the robot: as a parameter, else the logged offset if it never changes.

    Some logs carry corrected poses in place of the laser's: their difference changes, and says nothing.
    """
    if log.laser_offset is not None:
        return np.array([*numbers(log.path, "PARAM", [log.laser_offset], 1), 0.0, 0.0])
    if not log.laser_at_scan:
        return np.zeros(3)
    robot, laser = (np.array(poses).reshape(-1, 3) for poses in (log.robot_at_scan, log.laser_at_scan))
    offsets = between(robot, laser)
    changes = np.abs(between(offsets[0], offsets)).max()
    return offsets[0] if changes < 0.01 and np.hypot(*offsets[0, :2]) < 2.0 else np.zeros(3)
