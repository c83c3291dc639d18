"""CARMEN logs: laser scans with odometry, one message a line.

The old laser message FLASER is read, the new one ROBOTLASER1, and RAWLASER1 with ODOM. The time of a scan is when its
message was sent (``ipc_timestamp``), as in the relations of the SLAM benchmark.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from pfslam.errors import DataError
from pfslam.io.files import reason
from pfslam.io.formats import numbers
from pfslam.io.log import Log
from pfslam.poses import Trajectory, between
from pfslam.recording import LidarScans, Recording
from pfslam.sensors import MAX_BEAMS, LidarModel, RobotModel

MAX_LINE_BYTES = 2**20
MAX_STAMP = 1e11
MAX_COORDINATE = 1e8
NO_RETURN = 80.0
"""SICK scanners report 81.83 m and the like where nothing came back."""
SENSOR_HEIGHT = 0.35
"""The logs do not say how high the scanner is mounted; on a flat floor it does not matter."""


@dataclass(eq=False)
class CarmenLog(Log):
    """What the lines of a log add up to.

    For each scan there is a stamp, its ranges ``(beams,)`` float32 and, if the message has them, the poses of robot and
    laser, three numbers each; for each odometry message four numbers: stamp, x, y, theta.
    """

    beams: int = 0
    angles: tuple[float, float] = (0.0, 0.0)
    range_max: float = NO_RETURN
    ranges: list[np.ndarray] = field(default_factory=list)
    scan_t: array = field(default_factory=partial(array, "d"))
    robot_at_scan: array = field(default_factory=partial(array, "d"))
    laser_at_scan: array = field(default_factory=partial(array, "d"))
    odometry: array = field(default_factory=partial(array, "d"))
    laser_offset: str | None = None


def load_carmen(path: str | Path) -> Recording:
    """Read a CARMEN log: its scans, its odometry poses as logged, and the laser as the log describes it.

    Lines are put in the order of their stamps; of those with the same stamp the first counts. What is left out is
    counted in ``recording.dropped``. Raises ``DataError`` naming the line for what cannot be read.
    """
    log = read_log(path)
    if not log.scan_t:
        raise DataError(log.path, "laser messages", "none", "lines of FLASER, ROBOTLASER1 or RAWLASER1")
    t = np.array(log.scan_t)
    order = log.in_order("scans", t)
    t = t[order]
    lidar = LidarScans(t, np.stack([log.ranges[k] for k in order]))
    log.leave_out("ranges that are not a number", np.isnan(lidar.ranges))
    if len(log.robot_at_scan) == 3 * len(log.scan_t):
        odometry = Trajectory(t, _pose_columns(log, log.robot_at_scan, 3)[order])
    elif log.odometry and not log.robot_at_scan:
        rows = _pose_columns(log, log.odometry, 4)
        rows = rows[log.in_order("poses of the odometry", rows[:, 0])]
        odometry = Trajectory(rows[:, 0], rows[:, 1:])
    else:
        raise DataError(log.path, "odometry", "none for some scans", "poses in the scans, or ODOM lines")
    robot, said = RobotModel(lidar=_lidar(log)), (dict(log.dropped), tuple(log.notes))
    return Recording(log.path.stem, robot, None, None, odometry, lidar, None, None, *said)


def _pose_columns(log: CarmenLog, values: array, columns: int) -> np.ndarray:
    """Arrange rows of odometry as an array; poses that no robot can have reached are refused."""
    table = np.array(values).reshape(-1, columns)
    if np.abs(table[:, -3:]).max() > MAX_COORDINATE:
        at = int(np.argmax(np.abs(table[:, -3:]).max(axis=1)))
        found = " ".join(f"{value:g}" for value in table[at, -3:])
        raise DataError(log.path, f"odometry {at + 1}", found, f"m and rad, at most {MAX_COORDINATE:g}")
    return table


def _lidar(log: CarmenLog) -> LidarModel:
    """Describe the laser: angles and range limit from its messages, mounting from PARAM lines or the poses."""
    x, y, yaw = _mounting(log)
    low, high = (float(angle + yaw) for angle in log.angles)
    position = float(x), float(y), SENSOR_HEIGHT
    with log.naming("laser"):
        return LidarModel(low, high, log.beams, range_max=log.range_max, position_b=position)


def _mounting(log: CarmenLog) -> np.ndarray:
    """Find the pose ``(3,)`` of the laser on the robot: a parameter, else the logged offset if it never changes.

    Some logs carry corrected poses in place of the laser's; their offset changes, and is not used.
    """
    if log.laser_offset is not None:
        return np.array([*numbers(log.path, "PARAM", [log.laser_offset], 1), 0.0, 0.0])
    if not log.laser_at_scan:
        return np.zeros(3)
    robot, laser = (np.array(poses).reshape(-1, 3) for poses in (log.robot_at_scan, log.laser_at_scan))
    offsets = between(robot, laser)
    changes = np.abs(between(offsets[0], offsets)).max()
    return offsets[0] if changes < 0.01 and np.hypot(*offsets[0, :2]) < 2.0 else np.zeros(3)


def read_log(path: str | Path) -> CarmenLog:
    """Read and check all lines of a log."""
    log = CarmenLog(Path(path))
    try:
        with open(path, "rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(MAX_LINE_BYTES + 1), b""), start=1):
                if len(line) > MAX_LINE_BYTES:
                    expected = f"at most {MAX_LINE_BYTES} bytes a line"
                    raise DataError(path, f"line {number}", "a longer line", expected)
                _read_line(log, number, line)
    except OSError as error:
        raise DataError(path, "reading", reason(error), "a file that can be read") from error
    return log


def _read_line(log: CarmenLog, number: int, line: bytes) -> None:
    words = line.decode("utf-8", errors="replace").split()
    if words and words[0] in READERS:
        READERS[words[0]](log, number, words[1:])
    elif words and not words[0].startswith("#"):
        log.leave_out("messages of other kinds")


def _flaser(log: CarmenLog, line: int, words: list[str]) -> None:
    """count, ranges, laser x y theta, odometry x y theta, ipc time, host, logger time."""
    count = _whole(log.path, line, words, 0)
    _expect(log.path, line, words, 1 + count + 9)
    pose = numbers(log.path, f"line {line}", words[count + 1 : count + 7], 6)
    (stamp,) = numbers(log.path, f"line {line}", words[count + 7 : count + 8], 1)
    # Old logs leave the angles out: half a turn from -90 deg, the last beam of an even number one step short.
    step = np.pi / (count if count % 2 == 0 else max(count - 1, 1))
    _add_scan(log, line, stamp, words[1 : count + 1], -np.pi / 2, step)
    log.laser_at_scan.extend(pose[:3])
    log.robot_at_scan.extend(pose[3:])


def _robotlaser(log: CarmenLog, line: int, words: list[str]) -> None:
    """Laser head as RAWLASER1, laser and robot poses, five safety values, ipc time, host, logger time."""
    at = _laser_head(log, line, words, 14)
    log.laser_at_scan.extend(numbers(log.path, f"line {line}", words[at : at + 3], 3))
    log.robot_at_scan.extend(numbers(log.path, f"line {line}", words[at + 3 : at + 6], 3))


def _rawlaser(log: CarmenLog, line: int, words: list[str]) -> None:
    """Type, start, field of view, resolution, maximum, accuracy, mode, ranges, remissions, times."""
    _laser_head(log, line, words, 3)


def _laser_head(log: CarmenLog, line: int, words: list[str], tail: int) -> int:
    """Read a new-style scan with ``tail`` words after its remissions, and return where these begin."""
    count = _whole(log.path, line, words, 7)
    remissions = _whole(log.path, line, words, 8 + count)
    at = 9 + count + remissions
    _expect(log.path, line, words, at + tail)
    start, _, step, range_max = numbers(log.path, f"line {line}", words[1:5], 4)
    (stamp,) = numbers(log.path, f"line {line}", words[-3:-2], 1)
    # A scanner that sees nothing reports its maximum or a little less.
    log.range_max = min(NO_RETURN, 0.99 * range_max) if range_max > 0 else NO_RETURN
    _add_scan(log, line, stamp, words[8 : 8 + count], start, step)
    return at


def _add_scan(log: CarmenLog, line: int, stamp: float, words: list[str], start: float, step: float) -> None:
    angles = (start, start + (len(words) - 1) * step)
    if log.beams and (len(words) != log.beams or not np.allclose(angles, log.angles, atol=1e-6)):
        found = f"{len(words)} beams from {angles[0]:.4f} to {angles[1]:.4f} rad"
        expected = f"{log.beams} from {log.angles[0]:.4f} to {log.angles[1]:.4f} rad as before"
        raise DataError(log.path, f"line {line}", found, expected)
    if not (abs(start) < 7.0 and 0.0 <= angles[1] - start <= 2.0 * np.pi + 1e-3):
        found = f"angles from {start:g} to {angles[1]:g}"
        raise DataError(log.path, f"line {line}", found, "increasing radians, at most one turn")
    if abs(stamp) > MAX_STAMP:
        raise DataError(log.path, f"line {line}", f"stamp {stamp:g}", f"seconds, at most {MAX_STAMP:g}")
    try:
        with np.errstate(over="ignore"):
            ranges = np.array(words, dtype=float).astype(np.float32)
    except ValueError:
        raise DataError(
            log.path, f"line {line}", "a range that is no number", f"{len(words)} numbers"
        ) from None
    log.beams, log.angles = len(words), angles
    log.scan_t.append(stamp)
    log.ranges.append(ranges)


def _odom(log: CarmenLog, line: int, words: list[str]) -> None:
    """x, y, theta, speeds and acceleration, ipc time, host, logger time."""
    _expect(log.path, line, words, 9)
    log.odometry.extend(numbers(log.path, f"line {line}", [words[6], *words[:3]], 4))


def _param(log: CarmenLog, line: int, words: list[str]) -> None:
    """Only the parameter that says where the laser is mounted is used."""
    if len(words) >= 2 and words[0] == "robot_frontlaser_offset":
        log.laser_offset = words[1]


READERS = {
    "FLASER": _flaser,
    "ROBOTLASER1": _robotlaser,
    "RAWLASER1": _rawlaser,
    "ODOM": _odom,
    "PARAM": _param,
}


def _whole(path: Path, line: int, words: list[str], at: int) -> int:
    word = words[at] if at < len(words) else "the end of the line"
    lowest = 1 if at in (0, 7) else 0
    if not (word.isascii() and word.isdigit() and len(word) < 7 and lowest <= int(word) <= MAX_BEAMS):
        raise DataError(
            path, f"line {line}, word {at + 2}", word[:60], f"a count from {lowest} to {MAX_BEAMS}"
        )
    return int(word)


def _expect(path: Path, line: int, words: list[str], count: int) -> None:
    if len(words) != count:
        raise DataError(path, f"line {line}", f"{len(words)} values", f"{count} values")
