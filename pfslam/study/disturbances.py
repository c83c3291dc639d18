"""Disturbances by name: what a study can do to a recording before a run.

Each takes a recording and gives a changed copy. Times are seconds after the odometry's first stamp. What changes the
clock leaves the camera out, because images are known by their number in the whole recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import Trajectory, between, compose
from pfslam.recording import LidarScans, Recording, chosen

NO_RETURN = 0.0
"""The range of a beam that returned nothing: below every scanner's least range."""


def start_time(recording: Recording) -> float:
    """Return the first stamp (s) of the odometry, which is when a drive begins."""
    stream = recording.odometry if recording.odometry is not None else recording.wheels_and_gyro()[0]
    return float(stream.t[0])


def first_seconds(recording: Recording, seconds: float) -> Recording:
    """Keep the drive's first ``seconds``."""
    end = start_time(recording) + seconds
    return _cut(recording, lambda t: t <= end, lambda t: t, "seconds", seconds)


def kidnap(recording: Recording, at: float, seconds: float) -> Recording:
    """Kidnap the robot: cut ``seconds`` from ``at`` on out of all streams, and close up the clocks.

    The odometry misses the way in between; the truth does not, and jumps.
    """
    begin = start_time(recording) + at
    end = begin + seconds
    outside, closed = lambda t: (t < begin) | (t >= end), lambda t: np.where(t >= end, t - seconds, t)
    cut = _cut(recording, outside, closed, "kidnap", [at, seconds])
    return cut if cut.odometry is None else replace(cut, odometry=_closed_up(cut.odometry, begin))


def _closed_up(odometry: Trajectory, begin: float) -> Trajectory:
    """Return odometry poses without the motion of the cut at time ``begin``."""
    after = odometry.t >= begin
    if after.all() or not after.any():
        return odometry
    last, first = odometry.poses[~after][-1], odometry.poses[after][0]
    poses = np.concatenate([odometry.poses[~after], compose(last, between(first, odometry.poses[after]))])
    return Trajectory(odometry.t, poses)


def blind(recording: Recording, begin: float, end: float) -> Recording:
    """Let no beam return between ``begin`` and ``end``; the scans still arrive."""
    scans, start = recording.scans(), start_time(recording)
    ranges = scans.ranges.copy()
    ranges[(scans.t >= start + begin) & (scans.t <= start + end)] = NO_RETURN
    return with_ranges(recording, ranges)


def range_noise(recording: Recording, sigma: float, rng: np.random.Generator) -> Recording:
    """Add normal noise of standard deviation ``sigma`` (m) to every measured range, on top of its own."""
    ranges, valid = ranges_and_valid(recording)
    noise = sigma * rng.standard_normal(ranges.shape, dtype=np.float32)
    return with_ranges(recording, np.where(valid, ranges + noise, ranges))


def missing_beams(recording: Recording, share: float, rng: np.random.Generator) -> Recording:
    """Let each beam of each scan return nothing with probability ``share``."""
    ranges, _ = ranges_and_valid(recording)
    lost = rng.random(ranges.shape, dtype=np.float32) < share
    return with_ranges(recording, np.where(lost, np.float32(NO_RETURN), ranges))


def random_ranges(recording: Recording, share: float, rng: np.random.Generator) -> Recording:
    """Let each beam of each scan read any range the scanner can give, with probability ``share``."""
    ranges, _ = ranges_and_valid(recording)
    wild = rng.random(ranges.shape, dtype=np.float32) < share
    lidar = recording.robot.lidar
    anything = rng.uniform(lidar.range_min, lidar.range_max, ranges.shape).astype(ranges.dtype)
    return with_ranges(recording, np.where(wild, anything, ranges))


DISTURBANCES: dict[str, tuple[Callable, bool]] = {
    "seconds": (first_seconds, False),
    "kidnap": (kidnap, False),
    "blind": (blind, False),
    "range_noise": (range_noise, True),
    "missing_beams": (missing_beams, True),
    "random_ranges": (random_ranges, True),
}
"""By name: the function, and whether it draws random numbers. They are applied in this order."""


def disturb(recording: Recording, what: dict[str, Any], seed: int) -> Recording:
    """Apply disturbances by name, each with random numbers of its own that follow from ``seed``.

    A value is the function's argument, or a tuple of them: ``{"seconds": 60.0, "blind": (20.0, 25.0)}``.
    """
    if unknown := [name for name in what if name not in DISTURBANCES]:
        raise DataError("disturb", "name", unknown[0], f"one of {', '.join(DISTURBANCES)}")
    for stream, (name, (function, is_random)) in enumerate(DISTURBANCES.items()):
        if name in what:
            arguments = what[name] if isinstance(what[name], (tuple, list)) else (what[name],)
            rng = (np.random.default_rng([stream, seed]),) if is_random else ()
            recording = function(recording, *arguments, *rng)
    return recording


def ranges_and_valid(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Return the ranges ``(K, M)`` (m) of all scans, and which of them are measurements (bool)."""
    ranges = recording.scans().ranges
    return ranges, recording.robot.lidar.valid(ranges)


def with_ranges(recording: Recording, ranges: np.ndarray) -> Recording:
    """Return the recording with other ranges ``(K, M)`` (m) at the same stamps."""
    scans = recording.scans()
    return replace(recording, lidar=LidarScans(scans.t, ranges.astype(scans.ranges.dtype, copy=False)))


def _cut(recording: Recording, keep: Callable, clock: Callable, name: str, value) -> Recording:
    """Keep every stream's rows whose stamps ``keep`` accepts, at new stamps from ``clock``."""
    kept = {}
    for stream, part in recording.streams().items():
        rows = keep(part.t)
        if not rows.any():
            raise DataError(recording.name, f"disturb.{name}", value, "some readings of every stream left")
        kept[stream] = chosen(part, rows, t=clock(part.t[rows]))
    return replace(recording, camera=None, **kept)
