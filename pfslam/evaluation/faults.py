"""Faults on purpose: what goes wrong with real robots and in real programs, each a small pure function.

A fault of the data takes a recording and gives a changed copy; one of the camera takes its model. A fault of the filter
is a configuration, or takes the place of one of the ``Parts`` of ``slam_step``. Studies apply faults of the data by
name (``DISTURBANCES``). Unless a function says otherwise, times are seconds after the odometry's first stamp. What
changes the clock leaves the camera out, because images are known by their number in the whole recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from pfslam.config import SlamConfig
from pfslam.correlation import ScoreField
from pfslam.errors import DataError
from pfslam.evaluation.checkup import turned_by_wheels
from pfslam.grid import GridSpec
from pfslam.matching import Matched, match
from pfslam.motion import Controls
from pfslam.particles import RESAMPLERS, Particles
from pfslam.poses import Trajectory, between, compose
from pfslam.recording import Encoders, Imu, LidarScans, Recording
from pfslam.sensors import RgbdModel

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
    cut = _cut(
        recording,
        lambda t: (t < begin) | (t >= end),
        lambda t: np.where(t >= end, t - seconds, t),
        "kidnap",
        [at, seconds],
    )
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
    return _with_ranges(recording, ranges)


def range_noise(recording: Recording, sigma: float, rng: np.random.Generator) -> Recording:
    """Add normal noise of standard deviation ``sigma`` (m) to every measured range, on top of its own."""
    ranges, valid = _ranges(recording)
    noise = sigma * rng.standard_normal(ranges.shape, dtype=np.float32)
    return _with_ranges(recording, np.where(valid, ranges + noise, ranges))


def missing_beams(recording: Recording, share: float, rng: np.random.Generator) -> Recording:
    """Let each beam of each scan return nothing with probability ``share``."""
    ranges, _ = _ranges(recording)
    lost = rng.random(ranges.shape, dtype=np.float32) < share
    return _with_ranges(recording, np.where(lost, np.float32(NO_RETURN), ranges))


def random_ranges(recording: Recording, share: float, rng: np.random.Generator) -> Recording:
    """Let each beam of each scan read any range the scanner can give, with probability ``share``."""
    ranges, _ = _ranges(recording)
    wild = rng.random(ranges.shape, dtype=np.float32) < share
    lidar = recording.robot.lidar
    anything = rng.uniform(lidar.range_min, lidar.range_max, ranges.shape).astype(ranges.dtype)
    return _with_ranges(recording, np.where(wild, anything, ranges))


def scans_between(recording: Recording, begin: float, end: float) -> Recording:
    """Keep only the scans from ``begin`` to ``end`` s after the first one, and all other streams whole."""
    scans = recording.scans()
    t = scans.t - scans.t[0]
    some = (t >= begin) & (t < end)
    return replace(recording, lidar=LidarScans(scans.t[some], scans.ranges[some]))


def late_scans(recording: Recording, seconds: float) -> Recording:
    """Stamp every scan ``seconds`` too late: the LiDAR's clock runs ahead by so much."""
    scans = recording.scans()
    return replace(recording, lidar=LidarScans(scans.t + seconds, scans.ranges))


def clockwise(recording: Recording) -> Recording:
    """Read the scan in the wrong sense of rotation, as with a LiDAR mounted upside down."""
    return _with_ranges(recording, recording.scans().ranges[:, ::-1].copy())


def glass_pane(recording: Recording, first: int, beams: int) -> Recording:
    """Let ``beams`` beams from number ``first`` on never return: a fault of the world, not of a program."""
    ranges = recording.scans().ranges.copy()
    ranges[:, first : first + beams] = np.inf
    return _with_ranges(recording, ranges)


def renumbered(recording: Recording) -> Recording:
    """Throw invalid ranges away and number the rest 0, 1, 2: the bearings no longer belong to them."""
    ranges, valid = _ranges(recording)
    order = np.argsort(~valid, axis=1, kind="stable")
    return _with_ranges(recording, np.take_along_axis(np.where(valid, ranges, np.inf), order, axis=1))


def lidar_at(recording: Recording, x: float, y: float) -> Recording:
    """Take the LiDAR to sit at ``(x, y)`` m on the robot, wherever it really is."""
    lidar = recording.robot.lidar
    lidar = replace(lidar, position_b=(x, y, lidar.position_b[2]))
    return replace(recording, robot=replace(recording.robot, lidar=lidar))


def turned_lidar(recording: Recording, yaw: float) -> Recording:
    """Take the LiDAR to look ``yaw`` rad to the left of where it really does."""
    lidar = recording.robot.lidar
    lidar = replace(lidar, angle_min=lidar.angle_min + yaw, angle_max=lidar.angle_max + yaw)
    return replace(recording, robot=replace(recording.robot, lidar=lidar))


def scaled_ranges(recording: Recording, factor: float) -> Recording:
    """Read the ranges in another unit, ``factor`` times what they are."""
    return _with_ranges(recording, factor * recording.scans().ranges)


def silent_gyro(recording: Recording, begin: float, end: float) -> Recording:
    """Leave out the IMU's samples from ``begin`` to ``end``, both included."""
    _, imu = recording.wheels_and_gyro()
    t = imu.t - start_time(recording)
    kept = (t < begin) | (t > end)
    return replace(recording, imu=Imu(imu.t[kept], imu.angular_velocity[kept], imu.acceleration_g[kept]))


def skip_gaps(controls: Controls, longest: float = 0.1) -> Controls:
    """ "No gyro sample, so keep the old pose": intervals longer than ``longest`` s move the robot by nothing."""
    there = np.diff(controls.t) <= longest
    return Controls(controls.t, controls.v * there, controls.omega * there)


def scaled_gyro(recording: Recording, factor: float) -> Recording:
    """Read the gyro in other units (180 / pi: degrees), or with the wrong sign (-1)."""
    _, imu = recording.wheels_and_gyro()
    return replace(recording, imu=Imu(imu.t, factor * imu.angular_velocity, imu.acceleration_g))


def heading_from_wheels(recording: Recording) -> Recording:
    """Take the yaw rate from right less left wheels over the measured track, in the place of the gyro's."""
    _, imu = recording.wheels_and_gyro()
    turned = turned_by_wheels(recording, imu.t, recording.robot.encoders.track)
    rates = imu.angular_velocity.copy()
    rates[1:, recording.robot.imu.yaw_axis] = np.diff(turned) / np.diff(imu.t)
    return replace(recording, imu=Imu(imu.t, rates, imu.acceleration_g))


def _ranges(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    ranges = recording.scans().ranges
    return ranges, recording.robot.lidar.valid(ranges)


def _with_ranges(recording: Recording, ranges: np.ndarray) -> Recording:
    scans = recording.scans()
    return replace(recording, lidar=LidarScans(scans.t, ranges.astype(scans.ranges.dtype, copy=False)))


def _cut(recording: Recording, keep: Callable, clock: Callable, name: str, value) -> Recording:
    """Keep every stream's rows whose stamps ``keep`` accepts, at new stamps from ``clock``."""

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
    """Apply faults of the data by name, each with random numbers of its own that follow from ``seed``.

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


# Faults of the filter


def keep_weights(particles: Particles, rng: np.random.Generator, scheme: str) -> Particles:
    """Resample wrongly: each copy keeps the weight for which it was chosen, and so counts it twice."""
    rows = RESAMPLERS[scheme](particles.weights, rng)
    return Particles(particles.poses[rows], particles.log_weights[rows])


def torn_rows(particles: Particles, rng: np.random.Generator, scheme: str) -> Particles:
    """Resample wrongly: draw positions and headings separately."""
    rows, others = (rng.permutation(RESAMPLERS[scheme](particles.weights, rng)) for _ in range(2))
    poses = np.column_stack([particles.poses[rows, :2], particles.poses[others, 2]])
    return Particles(poses, np.zeros(len(rows)))


def match_without_translation(
    field: ScoreField, spec: GridSpec, points_b: np.ndarray, poses: np.ndarray, *rest
) -> Matched:
    """Match wrongly: end points are (x, y, 0, 0), not (x, y, 0, 1), so that a pose turns and never moves them."""
    matched = match(field, spec, points_b, poses * [0.0, 0.0, 1.0], *rest)
    return Matched(poses, matched.log_likelihood, matched.score)


def every_beam_a_witness(config: SlamConfig, beams: int = 1081) -> SlamConfig:
    """Weigh wrongly: take the softmax of the count, ``exp(beams)``, as if the beams of a scan were independent."""
    return replace(config, search=replace(config.search, sharpness=float(beams)))


# Faults of the camera


def swapped_centre(camera: RgbdModel) -> RgbdModel:
    """Take the principal point in (row, column) order, as in the K that the report prints; pixels are (column, row)."""
    return replace(camera, centre_u=camera.centre_v, centre_v=camera.centre_u)


def disparity_offset_by(camera: RgbdModel, counts: float) -> RgbdModel:
    """Make the program's depth law for a camera whose disparities are ``counts`` larger than it believes."""
    return replace(camera, disparity_offset=camera.disparity_offset + counts * camera.disparity_slope)


def pairs_by_number(count_disparity: int, count_rgb: int) -> tuple[np.ndarray, np.ndarray]:
    """Pair colour image i with depth image i, as if both cameras had taken the same pictures."""
    i = np.arange(min(count_disparity, count_rgb))
    return i, i
