"""Harm done to a recording on purpose: each function takes a recording and gives a changed copy.

Times are seconds after the odometry's first stamp. What changes the clock leaves the camera out, because images are
known by their number in the whole recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import Trajectory, between, compose
from pfslam.recording import Encoders, Imu, LidarScans, Recording

NO_RETURN = 0.0
"""The range of a beam that nothing comes back from: below every scanner's least range."""


def start_time(recording: Recording) -> float:
    """The first stamp (s) of the odometry, which is when a drive begins."""
    stream = recording.odometry if recording.odometry is not None else recording.wheels_and_gyro()[0]
    return float(stream.t[0])


def first_seconds(recording: Recording, seconds: float) -> Recording:
    """The drive's first ``seconds``."""
    end = start_time(recording) + seconds
    return _cut(recording, lambda t: t <= end, lambda t: t, "seconds", seconds)


def kidnap(recording: Recording, at: float, seconds: float) -> Recording:
    """All streams cut for ``seconds`` from ``at`` on and the clocks closed up: the robot wakes up elsewhere.

    The odometry knows nothing of the way in between; the truth does, and jumps.
    """
    begin = start_time(recording) + at
    end = begin + seconds
    cut = _cut(
        recording,
        lambda t: (t < begin) | (t >= end),
        lambda t: np.where(t >= end, t - seconds, t),
        "kidnap",
        [at, seconds],
    )
    return cut if cut.odometry is None else replace(cut, odometry=_closed_up(cut.odometry, begin))


def _closed_up(odometry: Trajectory, begin: float) -> Trajectory:
    """Odometry poses without the motion of the cut at time ``begin``."""
    after = odometry.t >= begin
    if after.all() or not after.any():
        return odometry
    last, first = odometry.poses[~after][-1], odometry.poses[after][0]
    poses = np.concatenate([odometry.poses[~after], compose(last, between(first, odometry.poses[after]))])
    return Trajectory(odometry.t, poses)


def blind(recording: Recording, begin: float, end: float) -> Recording:
    """No beam returns between ``begin`` and ``end``; the scans still arrive."""
    scans, start = recording.scans(), start_time(recording)
    ranges = scans.ranges.copy()
    ranges[(scans.t >= start + begin) & (scans.t <= start + end)] = NO_RETURN
    return _with_ranges(recording, ranges)


def range_noise(recording: Recording, sigma: float, rng: np.random.Generator) -> Recording:
    """Every measured range gets normal noise of standard deviation ``sigma`` (m) on top of its own."""
    ranges, valid = _ranges(recording)
    noise = sigma * rng.standard_normal(ranges.shape, dtype=np.float32)
    return _with_ranges(recording, np.where(valid, ranges + noise, ranges))


def missing_beams(recording: Recording, share: float, rng: np.random.Generator) -> Recording:
    """Each beam of each scan returns nothing with probability ``share``."""
    ranges, _ = _ranges(recording)
    lost = rng.random(ranges.shape, dtype=np.float32) < share
    return _with_ranges(recording, np.where(lost, np.float32(NO_RETURN), ranges))


def random_ranges(recording: Recording, share: float, rng: np.random.Generator) -> Recording:
    """Each beam of each scan reads any range the scanner can give, with probability ``share``."""
    ranges, _ = _ranges(recording)
    wild = rng.random(ranges.shape, dtype=np.float32) < share
    lidar = recording.robot.lidar
    anything = rng.uniform(lidar.range_min, lidar.range_max, ranges.shape).astype(ranges.dtype)
    return _with_ranges(recording, np.where(wild, anything, ranges))


def _ranges(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    ranges = recording.scans().ranges
    return ranges, recording.robot.lidar.valid(ranges)


def _with_ranges(recording: Recording, ranges: np.ndarray) -> Recording:
    scans = recording.scans()
    return replace(recording, lidar=LidarScans(scans.t, ranges.astype(scans.ranges.dtype, copy=False)))


def _cut(recording: Recording, keep: Callable, clock: Callable, name: str, value) -> Recording:
    """Every stream's rows whose stamps ``keep`` accepts, at new stamps from ``clock``."""

    def kept(kind, stream, *fields):
        if stream is None:
            return None
        rows = keep(stream.t)
        if not rows.any():
            raise DataError(recording.name, f"disturb.{name}", value, "some readings of every stream left")
        return kind(clock(stream.t[rows]), *(getattr(stream, field)[rows] for field in fields))

    return replace(
        recording,
        encoders=kept(Encoders, recording.encoders, "counts"),
        imu=kept(Imu, recording.imu, "angular_velocity", "acceleration_g"),
        odometry=kept(Trajectory, recording.odometry, "poses"),
        lidar=kept(LidarScans, recording.lidar, "ranges"),
        truth=kept(Trajectory, recording.truth, "poses"),
        camera=None,
    )


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
    unknown = [name for name in what if name not in DISTURBANCES]
    if unknown:
        raise DataError("disturb", "name", unknown[0], f"one of {', '.join(DISTURBANCES)}")
    for stream, (name, (function, is_random)) in enumerate(DISTURBANCES.items()):
        if name in what:
            arguments = what[name] if isinstance(what[name], (tuple, list)) else (what[name],)
            rng = (np.random.default_rng([stream, seed]),) if is_random else ()
            recording = function(recording, *arguments, *rng)
    return recording
