"""Slices of point clouds as scans: for each bearing the nearest point between two heights.

A scanner of many rings writes a PointCloud2: points ``x y z`` in its own frame, each somewhere in a record of
``point_step`` bytes. A floor plan needs one plane of them. So the points are turned upright, as the tree of frames
says, and those between two heights are what a level scanner in the same place would have seen. Clouds are large, so
each becomes a scan while the bag is read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.loading import POSE_LIMIT, Log
from pfslam.io.topics import Beams, Topic, frame_of
from pfslam.poses import apply_transform, transform
from pfslam.sensors import FLOOR_CLEARANCE

BEAMS = 720
"""Bearings of a slice: half a degree apart, as many as ``pointcloud_to_laserscan`` has by default."""
NUMBERS = {7: "f4", 8: "f8"}
"""The types of a coordinate that are read, by their number in a PointField."""


class Slicer:
    """Makes scans of the clouds on a topic: ``place`` finds the LiDAR ``(4, 4)`` in the robot's frame by its own.

    ``heights`` are those of the slice in the robot's frame (m). Without them it goes from ``FLOOR_CLEARANCE`` up to as
    far above the LiDAR as that is below it.
    """

    def __init__(
        self, log: Log, name: str, place: Callable[[str], np.ndarray], heights: tuple[float, float] | None
    ):
        self.log, self.name, self.place, self.heights = log, name, place, heights
        self.places: dict[str, np.ndarray] = {}

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
                expected = (
                    f"--slice LOW HIGH in m, of which the first is less (the LiDAR is {height:g} m high)"
                )
                raise DataError(self.log.path, f"{self.name}, heights", f"{low:g} to {high:g}", expected)
            said = f"scans are slices of the clouds on {self.name}, from {low:g} to {high:g} m high"
            self.log.notes.append(f"{said}; all points of a cloud are taken to be as old as its stamp")
        return self.places[frame]

    def level(self, frame: str) -> np.ndarray:
        """Return the place ``(4, 4)`` of the level scanner whose scans are made, by the LiDAR's frame."""
        return transform(translation=self.at(frame)[:3, 3])

    def ranges(self, message: Any, frame: str) -> np.ndarray:
        """Return the ranges ``(BEAMS,)`` float32 to the nearest points of a message, bearing by bearing."""
        T, points = self.at(frame), self.points(message)
        # Many drivers write zeros where nothing came back.
        points = points[(np.abs(points) < POSE_LIMIT[0]).all(axis=1) & points.any(axis=1)]
        x, y, z = (apply_transform(T, points) - [*T[:2, 3], 0.0]).T
        low, high = self.heights or (0.0, 0.0)
        within = (z >= low) & (z <= high)
        beam = ((np.arctan2(y, x) + np.pi) * (BEAMS / (2.0 * np.pi))).astype(int) % BEAMS
        nearest = np.full(BEAMS, np.inf)
        np.minimum.at(nearest, beam[within], np.hypot(x, y)[within])
        return nearest.astype(np.float32)

    def points(self, message: Any) -> np.ndarray:
        """Return the points ``(N, 3)`` of a message in its own frame (m); ``DataError`` if it is not whole."""
        fields = {field.name: field for field in message.fields}
        found = (
            ", ".join(f"{f.name} of type {f.datatype} at {f.offset}" for f in fields.values()) or "no fields"
        )
        step, order = message.point_step, ">" if message.is_bigendian else "<"
        try:
            kinds = [order + NUMBERS[fields[axis].datatype] for axis in "xyz"]
            places = [fields[axis].offset for axis in "xyz"]
            if max(places) >= step:  # NumPy counts in 32 bits, and would read before the data
                raise OverflowError
            point = np.dtype({"names": list("xyz"), "formats": kinds, "offsets": places, "itemsize": step})
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
        return np.column_stack([read[axis].astype(float) for axis in "xyz"])

    def wrong(self, message: Any, found: str, expected: str) -> DataError:
        """Make the error that names a message by its stamp."""
        stamp = message.header.stamp
        return DataError(
            self.log.path, f"{self.name} at {stamp.sec + stamp.nanosec * 1e-9:.3f}", found, expected
        )


def without_blind_ends(log: Log, topic: Topic) -> Topic:
    """Leave out the bearings at both ends to which no cloud has a point: not every LiDAR looks all around."""
    some = np.flatnonzero(np.isfinite(topic.rows).any(axis=0))
    if not len(some):
        raise DataError(
            log.path, f"{topic.name}, points between the heights of the slice", "none", "another --slice"
        )
    first, last = int(some[0]), int(some[-1])
    cut = {
        b: b._replace(number=last - first + 1, angle_min=b.angle_min + first * b.angle_increment)
        for b in set(topic.contents)
    }
    contents = np.fromiter((cut[beams] for beams in topic.contents), object, len(topic.t))
    return replace(topic, contents=contents, rows=topic.rows[:, first : last + 1])
