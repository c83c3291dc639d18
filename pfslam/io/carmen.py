"""CARMEN logs: laser scans with odometry, one message a line.

The old laser message FLASER is read, the new one ROBOTLASER1, and RAWLASER1 with ODOM. The time of a scan is when its
message was sent (``ipc_timestamp``), as in the relations of the SLAM benchmark.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pfslam.errors import DataError, naming_source
from pfslam.io.files import open_file, reason
from pfslam.io.formats import numbers
from pfslam.io.loading import Log, check_size
from pfslam.poses import Trajectory, between
from pfslam.recording import LidarScans, Recording
from pfslam.sensors import MAX_BEAMS, LidarModel, RobotModel

MAX_LINE_BYTES = 2**20
FARTHEST = 80.0
"""SICK scanners report 81.83 m and the like where nothing came back."""
SENSOR_HEIGHT = 0.35
"""The logs do not say how high the scanner is mounted; on a flat floor it does not matter."""


class Scan(NamedTuple):
    """A scan: its stamp (s), its ranges ``(beams,)`` float32, and poses of laser and robot if the message has them."""

    t: float
    ranges: np.ndarray
    poses: list[float]


@dataclass(eq=False)
class CarmenLog(Log):
    """What the lines of a log add up to; ``odometry`` has rows of stamp, x, y, theta."""

    angles: tuple[float, float] = (0.0, 0.0)
    range_max: float = FARTHEST
    scans: list[Scan] = field(default_factory=list)
    odometry: list[list[float]] = field(default_factory=list)
    laser_offset: str | None = None


def load_carmen(path: str | Path) -> Recording:
    """Read a CARMEN log: its scans, its odometry poses as logged, and the laser as the log describes it.

    Lines are put in the order of their stamps; of those with the same stamp the first counts. What is left out is
    counted in ``recording.dropped``. Raises ``DataError`` naming the line for what cannot be read.
    """
    log = read_log(path)
    if not log.scans:
        raise DataError(log.path, "laser messages", "none", "lines of FLASER, ROBOTLASER1 or RAWLASER1")
    t = np.array([scan.t for scan in log.scans])
    order = log.in_order("scans", t)
    lidar = LidarScans(t[order], np.stack([log.scans[k].ranges for k in order]))
    log.leave_out("ranges that are not a number", np.isnan(lidar.ranges))
    if all(scan.poses for scan in log.scans):
        rows = np.array([[log.scans[k].t, *log.scans[k].poses[3:]] for k in order])
    elif log.odometry and not any(scan.poses for scan in log.scans):
        rows = np.array(log.odometry)
        rows = rows[log.in_order("poses of the odometry", rows[:, 0])]
    elif any(scan.poses for scan in log.scans):
        raise DataError(log.path, "odometry", "none for some scans", "poses in the scans, or ODOM lines")
    else:
        rows = np.zeros((0, 4))
    columns = {"odometry.t": rows[:, 0], "odometry.pose": rows[:, 1:]} if len(rows) else {}
    for key, values in ({"stamps": lidar.t} | columns).items():
        check_size(log.path, key, values)
    odometry, robot = Trajectory(*columns.values()) if columns else None, RobotModel(lidar=_lidar(log))
    return Recording(log.path.stem, robot, odometry=odometry, lidar=lidar, **log.said())


def _lidar(log: CarmenLog) -> LidarModel:
    """Describe the laser: angles and range limit from its messages, mounting from PARAM lines or the poses."""
    x, y, yaw = _mounting(log).tolist()
    low, high = (float(angle + yaw) for angle in log.angles)
    if high - low > 2.0 * np.pi + 1e-3:
        raise DataError(log.path, "laser", f"angles from {low:g} to {high:g}", "radians, at most one turn")
    beams, place = len(log.scans[0].ranges), (x, y, SENSOR_HEIGHT)
    with naming_source(log.path, "laser, "):
        return LidarModel(low, high, beams, range_max=log.range_max, position_b=place)


def _mounting(log: CarmenLog) -> np.ndarray:
    """Find the pose ``(3,)`` of the laser on the robot: a parameter, else the logged offset if it never changes.

    Some logs carry corrected poses in place of the laser's; their offset changes, and is not used.
    """
    if log.laser_offset is not None:
        return np.array([*numbers(log.path, "PARAM", [log.laser_offset], 1), 0.0, 0.0])
    poses = np.array([scan.poses for scan in log.scans if scan.poses]).reshape(-1, 6)
    if not len(poses):
        return np.zeros(3)
    offsets = between(poses[:, 3:], poses[:, :3])
    changes = np.abs(between(offsets[0], offsets)).max()
    return offsets[0] if changes < 0.01 and np.hypot(*offsets[0, :2]) < 2.0 else np.zeros(3)


def read_log(path: str | Path) -> CarmenLog:
    """Read and check all lines of a log."""
    log = CarmenLog(Path(path))
    try:
        with open_file(path) as file:
            for number, line in enumerate(iter(lambda: file.readline(MAX_LINE_BYTES + 1), b""), start=1):
                if len(line) > MAX_LINE_BYTES:
                    expected = f"at most {MAX_LINE_BYTES} bytes a line"
                    raise DataError(path, f"line {number}", "a longer line", expected)
                words = line.decode("utf-8", errors="replace").split()
                if words and words[0] in READERS:
                    READERS[words[0]](log, f"line {number}", words[1:])
                elif words and not words[0].startswith("#"):
                    log.leave_out("messages of other kinds")
    except OSError as error:
        raise DataError(path, "reading", reason(error), "a file that can be read") from error
    return log


def _flaser(log: CarmenLog, line: str, words: list[str]) -> None:
    """count, ranges, laser x y theta, odometry x y theta, ipc time, host, logger time."""
    count = _whole(log, line, words, 0)
    _expect(log, line, words, 1 + count + 9)
    *poses, stamp = numbers(log.path, line, words[count + 1 : count + 8], 7)
    # Old logs leave the angles out: half a turn from -90 deg, the last beam of an even number one step short.
    step = np.pi / (count if count % 2 == 0 else max(count - 1, 1))
    _add_scan(log, line, stamp, words[1 : count + 1], -np.pi / 2, step, poses)


def _laser(log: CarmenLog, line: str, words: list[str], tail: int) -> None:
    """Type, start, field of view, resolution, maximum, accuracy, mode, ranges, remissions, and a tail.

    That of ROBOTLASER1 is laser and robot poses, five safety values, ipc time, host, logger time: 14 words. That of
    RAWLASER1 is the last three.
    """
    count = _whole(log, line, words, 7)
    at = 9 + count + _whole(log, line, words, 8 + count)
    _expect(log, line, words, at + tail)
    start, _, step, range_max = numbers(log.path, line, words[1:5], 4)
    (stamp,) = numbers(log.path, line, words[-3:-2], 1)
    # A scanner that sees nothing reports its maximum or a little less.
    log.range_max = min(FARTHEST, 0.99 * range_max) if range_max > 0 else FARTHEST
    poses = numbers(log.path, line, words[at : at + 6], 6) if tail > 3 else []
    _add_scan(log, line, stamp, words[8 : 8 + count], start, step, poses)


def _add_scan(
    log: CarmenLog, line: str, stamp: float, words: list[str], start: float, step: float, poses: list[float]
) -> None:
    angles = (start, start + (len(words) - 1) * step)
    beams = len(log.scans[0].ranges) if log.scans else len(words)
    if log.scans and (len(words) != beams or not np.allclose(angles, log.angles, atol=1e-6)):
        found = f"{len(words)} beams from {angles[0]:.4f} to {angles[1]:.4f} rad"
        expected = f"{beams} from {log.angles[0]:.4f} to {log.angles[1]:.4f} rad as before"
        raise DataError(log.path, line, found, expected)
    try:
        with np.errstate(over="ignore"):
            ranges = np.array(words, dtype=float).astype(np.float32)
    except ValueError:
        raise DataError(log.path, line, "a range that is no number", f"{beams} numbers") from None
    log.angles = angles
    log.scans.append(Scan(stamp, ranges, poses))


def _odom(log: CarmenLog, line: str, words: list[str]) -> None:
    """x, y, theta, speeds and acceleration, ipc time, host, logger time."""
    _expect(log, line, words, 9)
    log.odometry.append(numbers(log.path, line, [words[6], *words[:3]], 4))


def _param(log: CarmenLog, line: str, words: list[str]) -> None:
    """Only the parameter that says where the laser is mounted is used."""
    if len(words) >= 2 and words[0] == "robot_frontlaser_offset":
        log.laser_offset = words[1]


READERS: dict[str, Callable[[CarmenLog, str, list[str]], None]] = {
    "FLASER": _flaser,
    "ROBOTLASER1": partial(_laser, tail=14),
    "RAWLASER1": partial(_laser, tail=3),
    "ODOM": _odom,
    "PARAM": _param,
}


def _whole(log: CarmenLog, line: str, words: list[str], at: int) -> int:
    word = words[at] if at < len(words) else "the end of the line"
    lowest = 1 if at in (0, 7) else 0
    if not (word.isascii() and word.isdigit() and len(word) < 7 and lowest <= int(word) <= MAX_BEAMS):
        expected = f"a count from {lowest} to {MAX_BEAMS}"
        raise DataError(log.path, f"{line}, word {at + 2}", word[:60], expected)
    return int(word)


def _expect(log: CarmenLog, line: str, words: list[str], count: int) -> None:
    if len(words) != count:
        raise DataError(log.path, line, f"{len(words)} values", f"{count} values")
