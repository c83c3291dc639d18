"""One scanner on one robot: what is learned from its first messages, and how every later one is put in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.bags import at_usual_angles, ends, has_angles, read_scans
from pfslam.io.loading import Log
from pfslam.io.selection import select
from pfslam.io.topics import SCAN, SWEEP, Beams, Columns, frame_of, stamp_of
from pfslam.poses import Trajectory
from pfslam.recording import LidarScans, Recording
from pfslam.sensors import LidarModel, RobotModel, nearest_ranges

LEARN = 10
"""Scans from which a scanner is learned: how many beams it usually has, and how often it scans."""


def beams_of(message: Any) -> Beams:
    """Read what a LaserScan says of its beams; raise ``DataError`` where they have no usable angles or no stamp."""
    beams = Beams(frame_of(message), len(message.ranges), *SWEEP(message))
    if not has_angles(beams):
        raise DataError("scan", "angles", f"{beams.number} beams", "beams over at most one turn")
    if not stamp_of(message):
        raise DataError("scan", "stamp", "0 s", "the time of the first beam")
    return beams


@dataclass(frozen=True, eq=False)
class Scanner:
    """A scanner: its ``model``, the ``usual`` beams, the ``step`` that puts them counter-clockwise, seen from above.

    Scans are used ``later`` (s) than their messages are stamped, every ``every``-th of them, without the beams that are
    ``masked (beams,)``. ``notes`` is what had to be decided.
    """

    model: LidarModel
    usual: Beams
    step: int
    later: float
    every: int
    masked: np.ndarray
    notes: tuple[str, ...]

    @classmethod
    def of(cls, messages: Sequence[Any], T_bl: np.ndarray, corrections: dict[str, Any]) -> Scanner:
        """Learn a scanner at ``T_bl (4, 4)`` on the robot from its first messages, as ``run`` does from all of a bag.

        ``corrections`` are those of ``pfslam.io.selection.select``.
        """
        log, columns = Log(Path("scan")), Columns(SCAN, with_pixels=False, slicer=None)
        for message in messages:
            columns.add(stamp_of(message), message)
        topic = columns.topic("scan")
        stated, scans = read_scans(log, topic, lambda _: T_bl)
        usual, _ = at_usual_angles(Log(log.path), topic)
        limits = stated.range_min, stated.range_max
        _, step = LidarModel.mounted(T_bl, ends(usual), usual.number, limits)
        odometry = Trajectory(np.array([0.0, 1.0]), np.zeros((2, 3)))  # a recording has one
        seen = LidarScans(scans.t, np.zeros_like(scans.ranges))
        first = select(
            Recording("parameters", RobotModel(lidar=stated), odometry=odometry, lidar=seen), **corrections
        )
        masked, later = np.isnan(first.scans().ranges[0]), 0.5 * step * stated.sweep
        later -= corrections.get("delay", 0.0)
        return cls(first.robot.lidar, usual, step, later, first.default_every, masked, tuple(log.notes))

    def time(self, message: Any) -> float:
        """Return the time (s) of the middle beam: ROS stamps the first."""
        return stamp_of(message) + self.later

    def ranges(self, message: Any) -> np.ndarray:
        """Return the ranges ``(beams,)`` in the model's order; where there are more beams or fewer, by the nearest."""
        beams, ranges = beams_of(message), np.asarray(message.ranges, dtype=np.float32)
        if not np.array_equal(np.round(ends(beams), 4), np.round(ends(self.usual), 4)) or len(ranges) != len(
            self.masked
        ):
            angles = np.linspace(*ends(self.usual), self.usual.number)
            ranges = nearest_ranges(angles, beams.angle_min, beams.angle_increment, ranges)
        return np.where(self.masked, np.float32(np.nan), ranges[:: self.step])
