"""Laser scans of a ROS bag: of one scanner, at one set of angles, counter-clockwise, with its place on the robot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.frames import Frames
from pfslam.io.limits import LONGEST_SWEEP
from pfslam.io.messages import Log, Messages, ordered
from pfslam.poses import wrap_angle
from pfslam.recording import LidarScans
from pfslam.sensors import MAX_BEAMS, LidarModel

STEEPEST = float(np.deg2rad(10.0))
"""A LiDAR that leans more than this (rad) does not measure a floor plan."""
ALIKE = 0.25
"""Share of the step from beam to beam by which the angles of two scans may differ and be taken for the same."""


def load_scans(
    log: Log, stream: Messages, frames: Frames, base: str, place: tuple[float, float, float] | None
) -> tuple[LidarModel, LidarScans]:
    """Describe the LiDAR and arrange its scans counter-clockwise, as seen from above."""
    t, held = ordered(log, stream)
    t, held, first = _of_one_scanner(log, stream.topic, t, held)
    position, yaw, flipped = _mounting(log, stream.topic, _frame(first), frames, base, place)
    count, step = len(first.ranges), float(first.angle_increment)
    _count_odd_ranges(log, stream.topic, held)
    ranges = _at_the_angles_of(log, stream.topic, first, held)
    _check_end(log, stream.topic, first)
    side = -1.0 if flipped else 1.0
    low = yaw + side * first.angle_min
    high = low + side * (count - 1) * step
    sweep = (count - 1) * float(np.median([message.time_increment for message in held]))
    sweep = _sweep(log, stream.topic, t, sweep, first.scan_time)
    t = t + 0.5 * sweep  # ROS stamps the first beam, this package the middle one
    if low > high:
        ranges, low, high, sweep = ranges[:, ::-1], high, low, -sweep
    turns = 2.0 * np.pi * np.round((low + high) / (4.0 * np.pi))
    try:
        limits = first.range_min, first.range_max
        model = LidarModel(low - turns, high - turns, count, *limits, position, sweep)
        return model, LidarScans(t, np.ascontiguousarray(ranges))
    except DataError as error:
        raise DataError(log.path, f"{stream.topic}, {error.field}", error.found, error.expected) from None


def _frame(message: Any) -> str:
    return message.header.frame_id.lstrip("/")


def _of_one_scanner(
    log: Log, topic: str, t: np.ndarray, held: list[Any]
) -> tuple[np.ndarray, list[Any], Any]:
    """Keep the scans of the commonest frame and limits whose angles can be; also return one that stands for most."""
    beams = (
        f"{len(held[0].ranges)} beams from {held[0].angle_min:g} in steps of {held[0].angle_increment:g} rad"
    )
    whole = np.array([_has_angles(message) for message in held])
    if not whole.any():
        raise DataError(log.path, f"{topic} at {t[0]:.3f}", beams, "beams over at most one turn")
    log.count(f"scans on {topic} without usable angles", np.count_nonzero(~whole))
    t, held = t[whole], [message for message, is_whole in zip(held, whole, strict=True) if is_whole]
    frames = Counter(map(_frame, held))
    if len(frames) > 1:
        named = " and ".join(f"{frame} ({count} scans)" for frame, count in frames.most_common(4))
        log.notes.append(f"the scans on {topic} are of {len(frames)} frames: {named}; the first is used")
    same = _commonest(held, _frame)
    log.count(f"scans on {topic} of other frames than {_frame(held[same.argmax()])}", np.count_nonzero(~same))
    alike = _commonest(held, lambda m: (_frame(m), float(m.range_min), float(m.range_max)), same)
    log.count(f"scans on {topic} with other limits of range", np.count_nonzero(same & ~alike))
    kept = [message for message, is_kept in zip(held, alike, strict=True) if is_kept]
    usual = _commonest(kept, lambda m: (len(m.ranges), round(m.angle_min, 3), round(m.angle_increment, 5)))
    return t[alike], kept, kept[int(usual.argmax())]


def _commonest(
    held: list[Any], kind: Callable[[Any], Hashable], among: np.ndarray | None = None
) -> np.ndarray:
    """Mark which messages ``(K,)`` are of the commonest kind, among all or those marked."""
    kinds = [kind(message) for message in held]
    among = np.ones(len(held), dtype=bool) if among is None else among
    best = Counter(k for k, is_one in zip(kinds, among, strict=True) if is_one).most_common(1)[0][0]
    return among & np.array([k == best for k in kinds])


def _has_angles(message: Any) -> bool:
    """Tell whether a scan has beams at different angles, over at most one turn."""
    beams, low, step = len(message.ranges), abs(message.angle_min), abs(message.angle_increment)
    turns = (beams - 1) * step <= 2.0 * np.pi + 0.02 and (step > 0.0 or beams == 1)
    return bool(1 <= beams <= MAX_BEAMS and low < 7.0 and turns)


def _count_odd_ranges(log: Log, topic: str, held: list[Any]) -> None:
    everything = np.concatenate([message.ranges for message in held])
    for what, which in (
        ("not a number", np.isnan(everything)),
        ("zero", everything == 0),
        ("infinite", np.isinf(everything)),
    ):
        log.count(f"ranges on {topic} that are {what}", np.count_nonzero(which))


def _at_the_angles_of(log: Log, topic: str, first: Any, held: list[Any]) -> np.ndarray:
    """Put all scans at the angles of one of them, ``(K, beams)``: a scanner that spins freely varies its beams."""
    count, step = len(first.ranges), float(first.angle_increment)
    angles = first.angle_min + step * np.arange(count)
    ranges, moved = np.empty((len(held), count), dtype=np.float32), 0
    for row, message in zip(ranges, held, strict=True):
        ends = message.angle_min - first.angle_min, (message.angle_increment - step) * (count - 1)
        if len(message.ranges) == count and np.abs([ends[0], sum(ends)]).max() <= ALIKE * abs(step):
            row[:] = message.ranges
        else:
            row[:], moved = nearest_ranges(angles, message), moved + 1
    if moved:
        log.notes.append(
            f"{moved} scans on {topic} have other angles than most: of their beams the nearest are taken"
        )
    return ranges


def nearest_ranges(angles: np.ndarray, message: Any) -> np.ndarray:
    """Return the ranges ``(K,)`` of a LaserScan at ``angles (K,)``: the nearest beam's, NaN where there is none."""
    step, count = float(message.angle_increment), len(message.ranges)
    beyond = (angles - message.angle_min) * np.sign(step) + 0.5 * abs(step)
    k = (beyond % (2.0 * np.pi) / max(abs(step), 1e-9)).astype(int)
    return np.where(k < count, np.asarray(message.ranges)[np.minimum(k, count - 1)], np.nan)


def _check_end(log: Log, topic: str, first: Any) -> None:
    """Speak of beams that do not end where the message says that they do."""
    end = first.angle_min + (len(first.ranges) - 1) * first.angle_increment
    off = abs(float(wrap_angle(end - first.angle_max)))
    if not off <= max(0.02, 3.0 * abs(first.angle_increment)):
        log.notes.append(
            f"the beams on {topic} end at {end:.3f} rad by angle_increment, and at {first.angle_max:.3f} rad "
            "by angle_max: the former is used"
        )


def _sweep(log: Log, topic: str, t: np.ndarray, sweep: float, scan_time: float) -> float:
    """Return the time (s) from first beam to last, or 0 where what the messages say cannot be."""
    if sweep == 0.0 and scan_time > 0.0:
        log.notes.append(
            f"on {topic} time_increment is 0 and scan_time {scan_time:g} s: all beams of a scan are taken at once"
        )
    longest = min(LONGEST_SWEEP, 1.1 * float(np.median(np.diff(t)))) if len(t) > 1 else LONGEST_SWEEP
    if abs(sweep) <= longest:
        return sweep
    log.notes.append(f"a sweep of {sweep:g} s on {topic} is longer than a scan lasts: it is not used")
    return 0.0


def _mounting(
    log: Log, topic: str, frame: str, frames: Frames, base: str, place: tuple[float, float, float] | None
) -> tuple[tuple[float, float, float], float, bool]:
    """Find the LiDAR's position (m) and yaw (rad) in the body frame, and whether it hangs upside down."""
    if place is not None:
        x, y, yaw = place
        log.notes.append(f"the LiDAR is taken to be at x {x:g} m, y {y:g} m, yaw {yaw:g} rad, as asked for")
        return (x, y, LidarModel().position_b[2]), yaw, False
    T = np.eye(4) if frame == base else frames.fixed(base, frame)
    if T is None:
        moving = "".join(f" ({a} -> {b} moves)" for a, b in frames.moving() if frame in (a, b))
        found = f"no fixed chain of frames from {base} to {frame or 'a frame without a name'}{moving}"
        raise DataError(
            log.path, f"{topic}, place of the LiDAR", found, "one on /tf_static, or --lidar-at X Y YAW"
        )
    if abs(T[2, 2]) < np.cos(STEEPEST):
        lean = np.degrees(np.arccos(abs(T[2, 2])))
        raise DataError(log.path, f"{topic}, {frame}", f"a lean of {lean:.0f} deg", "a level LiDAR")
    if T[2, 2] < 0:
        log.notes.append(f"{frame} hangs upside down: the beams of {topic} are put in the other order")
    x, y, z = T[:3, 3].tolist()
    return (x, y, z), float(np.arctan2(T[1, 0], T[0, 0])), bool(T[2, 2] < 0)
