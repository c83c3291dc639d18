"""Faults on purpose: what goes wrong with real robots and in real programs, each a small pure function.

A fault of the data takes a recording and gives a changed copy; one of the camera takes its model. A fault of the filter
is a configuration, or takes the place of a function that the filter's step calls.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from pfslam.evaluation.checkup import turned_by_wheels
from pfslam.grid import GridSpec
from pfslam.motion import Controls
from pfslam.particles import RESAMPLERS, Particles
from pfslam.recording import Imu, LidarScans, Recording
from pfslam.refined.matching import Match, match
from pfslam.refined.step import RefinedConfig
from pfslam.sensors import RgbdModel
from pfslam.settings import changed
from pfslam.study.disturbances import ranges_and_valid, start_time, with_ranges


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
    return with_ranges(recording, recording.scans().ranges[:, ::-1].copy())


def glass_pane(recording: Recording, first: int, beams: int) -> Recording:
    """Let ``beams`` beams from number ``first`` on never return: a fault of the world, not of a program."""
    ranges = recording.scans().ranges.copy()
    ranges[:, first : first + beams] = np.inf
    return with_ranges(recording, ranges)


def renumbered(recording: Recording) -> Recording:
    """Throw invalid ranges away and number the rest 0, 1, 2: the bearings no longer belong to them."""
    ranges, valid = ranges_and_valid(recording)
    order = np.argsort(~valid, axis=1, kind="stable")
    return with_ranges(recording, np.take_along_axis(np.where(valid, ranges, np.inf), order, axis=1))


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
    return with_ranges(recording, factor * recording.scans().ranges)


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


def with_fault(faults: dict[str, Callable], function: Callable, *arguments):
    """Call a function while names of the package, such as ``"slam.resample"``, stand for faulty functions."""
    with ExitStack() as stack:
        for name, fault in faults.items():
            stack.enter_context(patch(f"pfslam.{name}", fault))
        return function(*arguments)


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
    field: np.ndarray, spec: GridSpec, points_b: np.ndarray, poses: np.ndarray, *rest
) -> Match:
    """Match wrongly: end points are (x, y, 0, 0), not (x, y, 0, 1), so that a pose turns and never moves them."""
    matched = match(field, spec, points_b, poses * [0.0, 0.0, 1.0], *rest)
    return Match(poses, matched.log_likelihood, matched.score)


def every_beam_a_witness(config: RefinedConfig, beams: int = 1081) -> RefinedConfig:
    """Weigh wrongly: take the softmax of the count, ``exp(beams)``, as if the beams of a scan were independent."""
    return changed(config, {"search.sharpness": float(beams)})


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
