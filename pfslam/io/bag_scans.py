"""Laser scans of a ROS bag: of one scanner, at one set of angles, counter-clockwise, with its place on the robot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.frames import Frames, frame_of
from pfslam.io.limits import LONGEST_SWEEP
from pfslam.io.messages import Log, Topic
from pfslam.poses import wrap_angle
from pfslam.recording import LidarScans
from pfslam.sensors import MAX_BEAMS, LidarModel

STEEPEST = float(np.deg2rad(10.0))
"""A LiDAR that leans more than this (rad) does not measure a floor plan."""


def load_scans(
    log: Log, topic: Topic, frames: Frames, base: str, place: tuple[float, float, float] | None
) -> tuple[LidarModel, LidarScans]:
    """Describe the LiDAR and arrange its scans counter-clockwise, as seen from above."""
    topic = _of_one_scanner(log, topic)
    first, ranges = _at_usual_angles(log, topic)
    position, yaw, side = _mounting(log, topic.name, frame_of(first), frames, base, place)
    sweep = _sweep(log, topic, first)
    low = yaw + side * first.angle_min
    high = low + side * (ranges.shape[1] - 1) * first.angle_increment
    t = topic.t + 0.5 * sweep  # ROS stamps the first beam, this package the middle one
    if low > high:
        ranges, low, high, sweep = ranges[:, ::-1], high, low, -sweep
    turns = 2.0 * np.pi * np.round((low + high) / (4.0 * np.pi))
    ends, limits = (low - turns, high - turns), (first.range_min, first.range_max)
    try:
        model = LidarModel(*ends, ranges.shape[1], *limits, position, sweep)
    except DataError as error:
        raise DataError(log.path, f"{topic.name}, {error.field}", error.found, error.expected) from None
    return model, LidarScans(t, np.ascontiguousarray(ranges))


def _of_one_scanner(log: Log, topic: Topic) -> Topic:
    """Keep the scans whose angles can be, of the commonest frame and limits, and count ranges that say nothing."""
    whole = [_has_angles(message) for message in topic.contents]
    topic = log.keep(topic, whole, "without usable angles", "beams over at most one turn")
    kinds = [(frame_of(m), float(m.range_min), float(m.range_max)) for m in topic.contents]
    frame, low, high = usual = _commonest(kinds)
    why = f"of other frames or limits than {frame}, {low:g} to {high:g} m"
    topic = log.keep(topic, [kind == usual for kind in kinds], why)
    ranges = np.concatenate([message.ranges for message in topic.contents])
    odd = {"not a number": np.isnan(ranges), "infinite": np.isinf(ranges), "zero": ranges == 0}
    for what, which in odd.items():
        log.count(f"ranges on {topic.name} that are {what}", np.count_nonzero(which))
    return topic


def _commonest(kinds: Iterable[Hashable]) -> Any:
    return Counter(kinds).most_common(1)[0][0]


def _has_angles(message: Any) -> bool:
    """Tell whether a scan has beams at different angles, over at most one turn."""
    beams, low, step = len(message.ranges), abs(message.angle_min), abs(message.angle_increment)
    turns = (beams - 1) * step <= 2.0 * np.pi + 0.02 and (step > 0.0 or beams == 1)
    return bool(1 <= beams <= MAX_BEAMS and low < 7.0 and turns)


def _at_usual_angles(log: Log, topic: Topic) -> tuple[Any, np.ndarray]:
    """Put all scans at the angles of most, ``(K, beams)``, and return one of those as well.

    A scanner that spins freely varies its beams from turn to turn.
    """
    held = topic.contents
    ends = [(m.angle_min, m.angle_min + (len(m.ranges) - 1) * m.angle_increment) for m in held]
    shapes = [(len(m.ranges), *np.round(end, 4)) for m, end in zip(held, ends, strict=True)]
    at = shapes.index(usual := _commonest(shapes))
    first, angles = held[at], np.linspace(*ends[at], len(held[at].ranges))
    alike = [shape == usual for shape in shapes]
    ranges = [m.ranges if same else nearest_ranges(angles, m) for m, same in zip(held, alike, strict=True)]
    if moved := alike.count(False):
        log.notes.append(
            f"{moved} scans on {topic.name} have other angles than most: of their beams the nearest are taken"
        )
    if not abs(wrap_angle(ends[at][1] - first.angle_max)) <= max(0.02, 3.0 * abs(first.angle_increment)):
        log.notes.append(
            f"the beams on {topic.name} end at {ends[at][1]:.3f} rad by angle_increment, and at "
            f"{first.angle_max:.3f} rad by angle_max: the former is used"
        )
    return first, np.array(ranges, dtype=np.float32)


def nearest_ranges(angles: np.ndarray, message: Any) -> np.ndarray:
    """Return the ranges ``(K,)`` of a LaserScan at ``angles (K,)``: the nearest beam's, NaN where there is none."""
    step, count = float(message.angle_increment), len(message.ranges)
    beyond = (angles - message.angle_min) * np.sign(step) + 0.5 * abs(step)
    k = (beyond % (2.0 * np.pi) / max(abs(step), 1e-9)).astype(int)
    return np.where(k < count, np.asarray(message.ranges)[np.minimum(k, count - 1)], np.nan)


def _sweep(log: Log, topic: Topic, first: Any) -> float:
    """Return the time (s) from first beam to last, or 0 where what the messages say cannot be."""
    beams, t = len(first.ranges), topic.t
    sweep = (beams - 1) * float(np.median([message.time_increment for message in topic.contents]))
    longest = min(LONGEST_SWEEP, 1.1 * float(np.median(np.diff(t)))) if len(t) > 1 else LONGEST_SWEEP
    if not abs(sweep) <= longest:
        log.notes.append(
            f"a sweep of {sweep:g} s on {topic.name} is longer than a scan lasts: it is not used"
        )
        return 0.0
    if sweep == 0.0 and beams > 1 and first.scan_time > 0.0:
        log.notes.append(
            f"on {topic.name} time_increment is 0 and scan_time {first.scan_time:g} s: "
            "all beams of a scan are taken at once"
        )
    return sweep


def _mounting(
    log: Log, topic: str, frame: str, frames: Frames, base: str, place: tuple[float, float, float] | None
) -> tuple[tuple[float, float, float], float, float]:
    """Find the LiDAR's position (m) and yaw (rad) in the body frame, and -1 if it hangs upside down, else 1."""
    if place is not None:
        x, y, yaw = place
        log.notes.append(f"the LiDAR is taken to be at x {x:g} m, y {y:g} m, yaw {yaw:g} rad, as asked for")
        return (x, y, LidarModel().position_b[2]), yaw, 1.0
    T = frames.fixed(base, frame)
    if T is None:
        found = f"no fixed chain of frames from {base} to {frame or 'a frame without a name'}"
        expected = "one on /tf_static, or --lidar-at X Y YAW"
        raise DataError(log.path, f"{topic}, place of the LiDAR", found, expected)
    if abs(T[2, 2]) < np.cos(STEEPEST):
        lean = np.degrees(np.arccos(abs(T[2, 2])))
        raise DataError(log.path, f"{topic}, {frame}", f"a lean of {lean:.0f} deg", "a level LiDAR")
    if T[2, 2] < 0:
        log.notes.append(f"{frame} hangs upside down: the beams of {topic} are put in the other order")
    x, y, z = T[:3, 3].tolist()
    return (x, y, z), float(np.arctan2(T[1, 0], T[0, 0])), float(np.sign(T[2, 2]))
