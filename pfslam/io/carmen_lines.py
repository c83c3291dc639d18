"""The lines of a CARMEN log: what each kind of message says, and what a whole log adds up to.

A log is read once from end to end, and only a few numbers a line are kept. The ranges of a scan are handed on as they
come; whoever does not hold them can have them read again, scan by scan in any order.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from pfslam.errors import DataError
from pfslam.io.files import reason
from pfslam.io.formats import numbers
from pfslam.limits import MAX_BEAMS

MAX_LINE_BYTES = 2**20
MAX_STAMP = 1e11
NO_RETURN = 80.0
"""SICK scanners report 81.83 m and the like where nothing came back."""


@dataclass
class CarmenLog:
    """What the lines of a log add up to, a few numbers a line; the ranges of each scan go to ``keep`` as they come.

    One after the other stand, for each scan, its stamp and the byte at which its line begins, and if it has them the
    poses of robot and laser, three numbers each; for each odometry message four: stamp, x, y, theta.
    """

    path: Path
    keep: Callable[[np.ndarray], None]
    beams: int = 0
    angles: tuple[float, float] = (0.0, 0.0)
    range_max: float = NO_RETURN
    line_at: int = 0
    """Where in the file the line begins that is being read."""
    scan_t: array = field(default_factory=partial(array, "d"))
    scan_at: array = field(default_factory=partial(array, "q"))
    robot_at_scan: array = field(default_factory=partial(array, "d"))
    laser_at_scan: array = field(default_factory=partial(array, "d"))
    odometry: array = field(default_factory=partial(array, "d"))
    laser_offset: str | None = None
    dropped: dict[str, int] = field(default_factory=dict)

    def count(self, reason: str, number: int = 1) -> None:
        """Note that so many things were left out for this reason."""
        if number:
            self.dropped[reason] = self.dropped.get(reason, 0) + number


def read_log(path: str | Path, keep: Callable[[np.ndarray], None]) -> CarmenLog:
    """All lines of a log, checked. ``keep`` is handed the ranges ``(beams,)`` float32 of each scan, in file order."""
    log = CarmenLog(Path(path), keep)
    try:
        with open(path, "rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(MAX_LINE_BYTES + 1), b""), start=1):
                if len(line) > MAX_LINE_BYTES:
                    raise DataError(
                        path, f"line {number}", "a longer line", f"at most {MAX_LINE_BYTES} bytes a line"
                    )
                _read_line(log, number, line)
                log.line_at += len(line)
    except OSError as error:
        raise DataError(path, "reading", reason(error), "a file that can be read") from error
    return log


def ranges_again(log: CarmenLog, order: np.ndarray) -> Iterator[np.ndarray]:
    """The ranges ``(1, beams)`` of scans by number, each read from its line in the file once more."""
    changed = DataError(log.path, "reading", "other lines than before", "a log that nobody changes meanwhile")
    try:
        with open(log.path, "rb") as file:
            for k in order:
                found: list[np.ndarray] = []
                again = CarmenLog(log.path, found.append, log.beams, log.angles)
                file.seek(log.scan_at[k])
                _read_line(again, 0, file.readline(MAX_LINE_BYTES))
                if list(again.scan_t) != [log.scan_t[k]]:
                    raise changed
                yield found[0][None]
    except (OSError, DataError) as error:
        raise changed from error


def _read_line(log: CarmenLog, number: int, line: bytes) -> None:
    words = line.decode("utf-8", errors="replace").split()
    if words and words[0] in READERS:
        READERS[words[0]](log, number, words[1:])
    elif words and not words[0].startswith("#"):
        log.count("messages of other kinds")


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
    """Read a new-style scan with ``tail`` words after its remissions; gives where these begin."""
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
    log.scan_at.append(log.line_at)
    log.keep(ranges)


def _odom(log: CarmenLog, line: int, words: list[str]) -> None:
    """x, y, theta, speeds and acceleration, ipc time, host, logger time."""
    _expect(log.path, line, words, 9)
    log.odometry.extend(numbers(log.path, f"line {line}", [words[6], *words[:3]], 4))


def _param(log: CarmenLog, line: int, words: list[str]) -> None:
    """Of the parameters only where the laser sits is of use."""
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
