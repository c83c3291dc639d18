"""Slices of point clouds as scans: for each bearing the nearest surface between two heights.

A scanner of many rings writes a PointCloud2: points ``x y z`` in its own frame, each somewhere in a record of
``point_step`` bytes. A floor plan needs one plane of them. So the points are turned upright, as the tree of frames
says, and those between two heights are what a level scanner in the same place would have seen. A cloud is measured
while the robot drives: where it says when each point was, all are moved to where they were, seen from the robot, at its
stamp. Clouds are large, so each becomes a scan while the bag is read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.loading import POSE_LIMIT, Log
from pfslam.io.topics import Beams, Topic, frame_of, stamp_of
from pfslam.poses import Trajectory, apply_transform, between, compose, transform
from pfslam.sensors import FLOOR_CLEARANCE

BEAMS = 720
"""Bearings of a slice: half a degree apart, as many as ``pointcloud_to_laserscan`` has by default."""
STEEPEST = 8.0
"""Metres along a beam for each metre across it, on a wall that is met at a slant: the tangent of 83 degrees."""
NUMBERS = {7: "f4", 8: "f8"}
"""The types of a coordinate that are read, by their number in a PointField."""
TIMES = ("t", "time", "timestamp", "offset_time")
"""The fields of a point's time, as drivers name them: of whole numbers in ns, of floating point numbers in s."""
CLOCKS = NUMBERS | {5: "i4", 6: "u4"}
"""The types of a time that are read."""
ONE_CLOCK = 1.0
"""Seconds: no cloud takes longer, and a point that is farther from the stamp of its cloud has another clock."""


@dataclass(eq=False)
class Slicer:
    """Makes scans of the clouds on a topic: ``place`` finds the LiDAR ``(4, 4)`` in the robot's frame by its own.

    ``heights`` are those of the slice in the robot's frame (m). Without them it goes from ``FLOOR_CLEARANCE`` up to as
    far above the LiDAR as that is below it. The ``odometry`` tells how the robot moved while a cloud was measured.
    ``spans`` are the first and the last time of each cloud's points, in seconds after its stamp, NaN if it tells none.
    """

    log: Log
    name: str
    place: Callable[[str], np.ndarray]
    heights: tuple[float, float] | None
    odometry: Trajectory | None
    clock: str = ""
    places: dict[str, np.ndarray] = field(default_factory=dict)
    spans: list[tuple[float, float]] = field(default_factory=list)

    def __call__(self, message: Any) -> tuple[Beams, np.ndarray]:
        """Return the beams and the ranges of a message as those of a level scanner that looks ahead.

        It begins behind. A range is inf where no point lies in the slice.
        """
        frame, step = frame_of(message), 2.0 * np.pi / BEAMS
        return Beams(frame, BEAMS, 0.5 * step - np.pi, step, 0.0, 0.0, np.inf), self.ranges(message, frame)

    def at(self, frame: str) -> np.ndarray:
        """Return the place ``(4, 4)`` of the LiDAR that has this frame; heights that nobody stated follow from it."""
        if frame not in self.places:
            self.places[frame] = self.place(frame)
            height = float(self.places[frame][2, 3])
            self.heights = self.heights or (FLOOR_CLEARANCE, 2.0 * height - FLOOR_CLEARANCE)
            low, high = self.heights
            if not -np.inf < low < high < np.inf:
                expected = f"--slice LOW HIGH in m, LOW less than HIGH (the LiDAR is {height:g} m high)"
                raise DataError(self.log.path, f"{self.name}, heights", f"{low:g} to {high:g}", expected)
        return self.places[frame]

    def level(self, frame: str) -> np.ndarray:
        """Return the place ``(4, 4)`` of the level scanner whose scans are made, by the LiDAR's frame."""
        return transform(translation=self.at(frame)[:3, 3])

    def ranges(self, message: Any, frame: str) -> np.ndarray:
        """Return the ranges ``(BEAMS,)`` float32 to the nearest surfaces of a message, bearing by bearing.

        The nearest point around a bearing may lie beside it. On a slanting wall it always lies on the near side.
        So the range is that of the point closest in bearing, of those that can lie on one wall with the nearest.
        """
        T, (points, told), stamp = self.at(frame), self.points(message), stamp_of(message)
        # Many drivers write zeros where nothing came back.
        some = (np.abs(points) < POSE_LIMIT[0]).all(axis=1) & points.any(axis=1)
        x, y, z = apply_transform(T, points[some]).T
        low, high = self.heights or (0.0, 0.0)
        within = (z >= low) & (z <= high)
        later = self.later(stamp, told[some])[within]
        x, y = (self.at_stamp(stamp, later, np.column_stack([x, y])[within]) - T[:2, 3]).T
        bearing, away = (np.arctan2(y, x) + np.pi) * (BEAMS / (2.0 * np.pi)), np.hypot(x, y)
        beam, nearest = bearing.astype(int) % BEAMS, np.full(BEAMS, np.inf)
        np.minimum.at(nearest, beam, away)
        one_wall = away <= nearest[beam] * (1.0 + STEEPEST * 2.0 * np.pi / BEAMS)
        beam, away, beside = beam[one_wall], away[one_wall], np.abs(bearing[one_wall] % 1.0 - 0.5)
        # The points closest to their bearing come last: where several are written to one beam, the last stays.
        order = np.argsort(-beside, kind="stable")
        nearest[beam[order]] = away[order]
        return nearest.astype(np.float32)

    def later(self, stamp: float, told: np.ndarray) -> np.ndarray:
        """Return how many seconds after the stamp of their cloud points were measured, by what is told, both ``(N,)``.

        That may be a time, or the time since the stamp: it is what is nearer to the stamp. Some drivers write
        nanoseconds as floating point numbers; in seconds, these are farther apart than a cloud is long. If the points
        are not within ``ONE_CLOCK`` of the stamp, or it is 0, which is no stamp, all are taken to be as old as that.
        """
        since = told.astype(float)
        with np.errstate(over="ignore", invalid="ignore"):
            is_in_seconds = since.max(initial=-np.inf) - since.min(initial=np.inf) <= ONE_CLOCK
        since *= 1.0 if told.dtype.kind == "f" and is_in_seconds else 1e-9
        since = min(since, since - stamp, key=lambda seconds: np.abs(seconds).max(initial=0.0))
        if stamp and len(since) and np.abs(since).max() <= ONE_CLOCK:
            self.spans.append((since.min(), since.max()))
            return since
        self.spans.append((np.nan, np.nan))
        return np.zeros(len(told))

    def at_stamp(self, stamp: float, later: np.ndarray, points_b: np.ndarray) -> np.ndarray:
        """Put points ``(N, 2)`` of the robot's frame ``later (N,)`` s after a stamp into its frame at the stamp."""
        if self.odometry is None or not later.any():
            return points_b
        poses = self.odometry.at(np.clip(stamp + np.append(0.0, later), *self.odometry.t[[0, -1]]))
        return compose(between(poses[0], poses[1:]), np.column_stack([points_b, 0.0 * later]))[:, :2]

    def said(self) -> str:
        """Say of what the scans are slices, and how old their points are taken to be."""
        low, high = self.heights or (0.0, 0.0)
        said = f"scans are slices of the clouds on {self.name}, from {low:g} to {high:g} m high"
        spans = np.array(self.spans)[np.isfinite(self.spans).all(axis=1)]
        if self.odometry and self.clock and len(spans):
            first, last = np.median(spans, axis=0)
            said += f"; each point is moved to where it is at the stamp of its cloud, as its field {self.clock} tells"
            return f"{said} (in {len(spans)} clouds, usually {first:+.3f} to {last:+.3f} s from the stamp)"
        said += "; all points of a cloud are taken to be as old as its stamp"
        why = "it does not fit their stamps" if self.odometry else "there is no odometry"
        return said + (f": they have a field {self.clock}, but {why}" if self.clock else "")

    def points(self, message: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return the points ``(N, 3)`` of a message in its own frame (m), and what their field of times tells ``(N,)``.

        Without such a field it tells zeros. Raises ``DataError`` if the message is not whole.
        """
        fields = {field.name: field for field in message.fields}
        layout = (f"{f.name} of type {f.datatype} at {f.offset}" for f in fields.values())
        found = ", ".join(layout) or "no fields"
        times = [name for name in TIMES if name in fields and fields[name].datatype in CLOCKS][:1]
        self.clock = times[0] if times else ""
        step, order = message.point_step, ">" if message.is_bigendian else "<"
        try:
            names = [*"xyz", *times]
            kinds = [order + (CLOCKS if name in TIMES else NUMBERS)[fields[name].datatype] for name in names]
            places = [fields[name].offset for name in names]
            if max(places) >= step:  # NumPy counts in 32 bits, and would read before the data
                raise OverflowError
            point = np.dtype({"names": names, "formats": kinds, "offsets": places, "itemsize": step})
        except (KeyError, ValueError, OverflowError):
            expected = f"x, y and z of type 7 (float32) or 8 (float64) within {step} bytes"
            raise self.wrong(message, found, expected) from None
        width, height, data = message.width, message.height, message.data
        row = message.row_step if height > 1 else width * step
        if not width * step <= row or height * row > len(data):
            sizes = f"{height} rows of {row} bytes for {width} points of {step}, {len(data)} bytes in all"
            raise self.wrong(message, sizes, "a whole cloud")
        rows = np.ascontiguousarray(data[: height * row]).reshape(height, row)[:, : width * step]
        read = np.ascontiguousarray(rows).reshape(-1).view(point)
        points = np.column_stack([read[axis].astype(float) for axis in "xyz"])
        return points, read[times[0]] if times else np.zeros(len(points))

    def wrong(self, message: Any, found: str, expected: str) -> DataError:
        """Make the error that names a message by its stamp."""
        return DataError(self.log.path, f"{self.name} at {stamp_of(message):.3f}", found, expected)


def without_blind_ends(log: Log, topic: Topic) -> Topic:
    """Leave out the bearings at both ends to which no cloud has a point: not every LiDAR looks all around."""
    some = np.flatnonzero(np.isfinite(topic.rows).any(axis=0))
    if not len(some):
        what = f"{topic.name}, points between the heights of the slice"
        raise DataError(log.path, what, "none", "another --slice")
    first, last = int(some[0]), int(some[-1])
    cut = {
        b: b._replace(number=last - first + 1, angle_min=b.angle_min + first * b.angle_increment)
        for b in set(topic.contents)
    }
    contents = np.fromiter((cut[beams] for beams in topic.contents), object, len(topic.t))
    return replace(topic, contents=contents, rows=topic.rows[:, first : last + 1])
