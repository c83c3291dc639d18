"""Laser scans of a ROS bag: of one scanner, at one set of angles, counter-clockwise, with its place on the robot."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.limits import LONGEST_SWEEP
from pfslam.io.log import Log
from pfslam.io.messages import Frames, Topic, frame_of
from pfslam.poses import rotation_matrix, transform
from pfslam.recording import LidarScans
from pfslam.sensors import MAX_BEAMS, LidarModel

STEEPEST = float(np.deg2rad(10.0))
"""A LiDAR that leans more than this (rad) does not measure a floor plan."""
Pose = tuple[float, float, float]


def place_of_lidar(log: Log, topic: Topic, frames: Frames, base: str, said: Pose | None) -> np.ndarray:
    """Find the transform ``(4, 4)`` of the LiDAR in the body frame: level, or upside down."""
    if said is not None:
        x, y, yaw = said
        log.notes.append(f"the LiDAR is taken to be at x {x:g} m, y {y:g} m, yaw {yaw:g} rad, as asked for")
        return transform(rotation_matrix(yaw=yaw), (x, y, LidarModel().position_b[2]))
    frame = frame_of(topic.contents[0])
    T = frames.place(base, frame)
    if T is None:
        found = f"no fixed chain of frames from {base} to {frame or 'a frame without a name'}"
        expected = "one on /tf_static, or --lidar-at X Y YAW"
        raise DataError(log.path, f"{topic.name}, place of the LiDAR", found, expected)
    if abs(T[2, 2]) < np.cos(STEEPEST):
        lean = np.degrees(np.arccos(abs(T[2, 2])))
        raise DataError(log.path, f"{topic.name}, {frame}", f"a lean of {lean:.0f} deg", "a level LiDAR")
    if T[2, 2] < 0:
        log.notes.append(f"{frame} hangs upside down: the beams of {topic.name} are put in the other order")
    return T


def load_scans(log: Log, topic: Topic, T: np.ndarray) -> tuple[LidarModel, LidarScans]:
    """Describe the LiDAR, at ``T (4, 4)`` on the robot, and arrange its scans counter-clockwise, seen from above."""
    frame = frame_of(topic.contents[0])
    topic = topic.keep(log, [frame_of(m) == frame for m in topic.contents], f"of other frames than {frame}")
    usable = [_has_angles(message) for message in topic.contents]
    topic = topic.keep(log, usable, "without usable angles", "beams over at most one turn")
    said = np.concatenate([message.ranges for message in topic.contents])
    for what, odd in (("not a number", np.isnan), ("infinite", np.isinf), ("zero", np.logical_not)):
        log.leave_out(f"ranges on {topic.name} that are {what}", odd(said))
    usual, ranges = _at_usual_angles(log, topic)
    beams, between = ranges.shape[1], np.median([message.time_increment for message in topic.contents])
    sweep, period = (beams - 1) * float(between), float(np.median(np.diff(topic.t, append=np.inf)))
    if not abs(sweep) <= min(LONGEST_SWEEP, 1.1 * period):
        log.notes.append(f"a sweep of {sweep:g} s on {topic.name} is not used: a scan lasts less")
        sweep = 0.0
    t = topic.t + 0.5 * sweep  # ROS stamps the first beam, this package the middle one
    ends = np.arctan2(T[1, 0], T[0, 0]) + np.sign(T[2, 2]) * np.array(_ends(usual))
    if ends[0] > ends[1]:
        ranges, ends, sweep = ranges[:, ::-1], ends[::-1], -sweep
    low, high = (ends - 2.0 * np.pi * np.round(ends.mean() / (2.0 * np.pi))).tolist()
    place = tuple(T[:3, 3].tolist())
    with log.naming(topic.name):
        model = LidarModel(low, high, beams, usual.range_min, usual.range_max, place, sweep)
    return model, LidarScans(t, np.ascontiguousarray(ranges))


def _has_angles(message: Any) -> bool:
    """Tell whether a scan has beams at different angles, over at most one turn."""
    beams, low, step = len(message.ranges), abs(message.angle_min), abs(message.angle_increment)
    turns = (beams - 1) * step <= 2.0 * np.pi + 0.02 and (step > 0.0 or beams == 1)
    return bool(1 <= beams <= MAX_BEAMS and low < 7.0 and turns)


def _ends(message: Any) -> tuple[float, float]:
    """Return the angles (rad) of the first beam and of the last, as the scanner counts them."""
    return message.angle_min, message.angle_min + (len(message.ranges) - 1) * message.angle_increment


def _at_usual_angles(log: Log, topic: Topic) -> tuple[Any, np.ndarray]:
    """Put all scans at the angles of most, ``(K, beams)``, and return one of those as well.

    A scanner that spins freely varies its beams from turn to turn.
    """
    held = topic.contents
    shapes = [(len(message.ranges), *np.round(_ends(message), 4)) for message in held]
    shape, alike = Counter(shapes).most_common(1)[0]
    usual = held[shapes.index(shape)]
    angles = np.linspace(*_ends(usual), len(usual.ranges))
    rows = [m.ranges if s == shape else nearest_ranges(angles, m) for m, s in zip(held, shapes, strict=True)]
    if moved := len(held) - alike:
        log.notes.append(f"scans on {topic.name} put at the angles of most, by nearest beams: {moved}")
    return usual, np.array(rows, dtype=np.float32)


def nearest_ranges(angles: np.ndarray, message: Any) -> np.ndarray:
    """Return the ranges ``(K,)`` of a LaserScan at ``angles (K,)``: the nearest beam's, NaN where there is none."""
    step, count = float(message.angle_increment), len(message.ranges)
    beyond = (angles - message.angle_min) * np.sign(step) + 0.5 * abs(step)
    k = (beyond % (2.0 * np.pi) / max(abs(step), 1e-9)).astype(int)
    return np.where(k < count, np.asarray(message.ranges)[np.minimum(k, count - 1)], np.nan)
