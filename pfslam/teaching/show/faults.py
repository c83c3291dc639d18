"""One switch for each fault of the laboratory: what real programs do wrong, as small pure functions.

A fault of the data takes a recording and returns one. A fault of the filter is a configuration, or a part of the
step that ``lab_step`` puts in the place of the right one. Nothing here draws.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pfslam.config import SlamConfig
from pfslam.errors import DataError
from pfslam.events import ScanEvent
from pfslam.matching import Matched
from pfslam.motion import Controls
from pfslam.particles import Particles, effective_sample_size, reweight, systematic_resample
from pfslam.recording import Imu, LidarScans, Recording
from pfslam.sensors import EncoderModel, RgbdModel
from pfslam.slam import SlamState, after_match, draw, estimate_pose, has_moved, match_scan, predict_motion

# ---- faults of the data


def late_scans(recording: Recording, seconds: float) -> Recording:
    """The LiDAR's clock runs ``seconds`` ahead: every scan is stamped that much too late."""
    scans = recording.scans()
    return replace(recording, lidar=LidarScans(scans.t + seconds, scans.ranges))


def lidar_at(recording: Recording, x: float, y: float) -> Recording:
    """The program takes the LiDAR to sit at ``(x, y)`` m on the robot, wherever it really is."""
    lidar = recording.robot.lidar
    lidar = replace(lidar, position_b=(x, y, lidar.position_b[2]))
    return replace(recording, robot=replace(recording.robot, lidar=lidar))


def heading_from_wheels(recording: Recording) -> Recording:
    """Yaw rate from right less left wheels over the measured track, in the place of the gyro's."""
    encoders, imu = recording.wheels_and_gyro()
    model: EncoderModel = recording.robot.encoders
    right, left = encoders.counts[:, [0, 2]].mean(axis=1), encoders.counts[:, [1, 3]].mean(axis=1)
    turned = np.cumsum((right - left) * model.metres_per_count / model.track)
    at_imu = np.interp(imu.t, encoders.t, turned)
    rates = imu.angular_velocity.copy()
    rates[1:, recording.robot.imu.yaw_axis] = np.diff(at_imu) / np.diff(imu.t)
    return replace(recording, imu=Imu(imu.t, rates, imu.acceleration_g))


def glass_pane(recording: Recording, first: int, beams: int) -> Recording:
    """No fault of a program but of the world: ``beams`` beams from number ``first`` on never return."""
    scans = recording.scans()
    ranges = scans.ranges.copy()
    ranges[:, first : first + beams] = np.inf
    return replace(recording, lidar=LidarScans(scans.t, ranges))


def renumbered(recording: Recording) -> Recording:
    """Invalid ranges are thrown away and the rest numbered 0, 1, 2: the bearings no longer belong to them."""
    scans, valid = recording.scans(), recording.robot.lidar.valid(recording.scans().ranges)
    order = np.argsort(~valid, axis=1, kind="stable")
    ranges = np.take_along_axis(np.where(valid, scans.ranges, np.inf), order, axis=1)
    return replace(recording, lidar=LidarScans(scans.t, ranges))


def gyro_gap(recording: Recording, begin: float, seconds: float) -> Recording:
    """The IMU is silent for ``seconds`` from ``begin`` on (s after the first scan). The package lives with that."""
    _, imu = recording.wheels_and_gyro()
    t = imu.t - recording.scans().t[0]
    keep = (t < begin) | (t > begin + seconds)
    return replace(recording, imu=Imu(imu.t[keep], imu.angular_velocity[keep], imu.acceleration_g[keep]))


def skip_gaps(controls: Controls, longest: float = 0.1) -> Controls:
    """ "No gyro sample, so keep the old pose": intervals longer than ``longest`` s move the robot by nothing."""
    there = np.diff(controls.t) <= longest
    return Controls(controls.t, controls.v * there, controls.omega * there)


def clockwise(recording: Recording) -> Recording:
    """The scan is read in the wrong sense of rotation, as with a LiDAR mounted upside down."""
    scans = recording.scans()
    return replace(recording, lidar=LidarScans(scans.t, scans.ranges[:, ::-1].copy()))


def gyro_flipped(recording: Recording) -> Recording:
    """The yaw rate with the wrong sign. Together with ``clockwise`` the whole world is a mirror image."""
    _, imu = recording.wheels_and_gyro()
    return replace(recording, imu=Imu(imu.t, -imu.angular_velocity, imu.acceleration_g))


# ---- faults of the filter


def whole_rows(particles: Particles, rng: np.random.Generator) -> tuple[Particles, np.ndarray]:
    """Right: one set of row numbers for whole poses, and equal weights afterwards."""
    rows = systematic_resample(particles.weights, rng)
    return Particles(particles.poses[rows], np.zeros(len(rows))), rows


def keep_weights(particles: Particles, rng: np.random.Generator) -> tuple[Particles, np.ndarray]:
    """Wrong: each copy keeps the weight that won it its place, and so is paid twice."""
    rows = systematic_resample(particles.weights, rng)
    return Particles(particles.poses[rows], particles.log_weights[rows]), rows


def tear(particles: Particles, rng: np.random.Generator) -> tuple[Particles, np.ndarray]:
    """Wrong: positions by one draw and headings by another."""
    rows = rng.permutation(systematic_resample(particles.weights, rng))
    others = rng.permutation(systematic_resample(particles.weights, rng))
    poses = np.column_stack([particles.poses[rows, :2], particles.poses[others, 2]])
    return Particles(poses, np.zeros(len(rows))), rows


@dataclass(frozen=True)
class Parts:
    """The parts of a step that a fault may replace; the defaults are right.

    ``match`` as ``slam.match_scan``; ``resample(particles, rng)`` returns new particles and ``rows (N,)``, from which
    particle the position of each new one came.
    """

    match: Callable[..., Matched] = match_scan
    resample: Callable[[Particles, np.random.Generator], tuple[Particles, np.ndarray]] = whole_rows


def match_without_translation(state: SlamState, event, particles: Particles, *rest) -> Matched:
    """Wrong: end points are (x, y, 0, 0) and not (x, y, 0, 1), so that a pose turns them and never moves them."""
    turned_only = Particles(particles.poses * [0.0, 0.0, 1.0], particles.log_weights)
    matched = match_scan(state, event, turned_only, *rest)
    return Matched(particles.poses, matched.log_likelihood, matched.score)


def every_beam_a_witness(config: SlamConfig, beams: int = 1081) -> SlamConfig:
    """Wrong: the softmax of the count. A perfect scan is worth ``exp(beams)``, as if beams were independent."""
    return replace(config, search=replace(config.search, sharpness=float(beams)))


@dataclass(frozen=True, eq=False)
class LabInfo:
    """What the laboratory writes down at each step: the cloud before and after resampling, and who it came from."""

    t: float
    estimate: np.ndarray
    particles: Particles
    effective_sample_size: float
    resampled: Particles | None
    rows: np.ndarray
    score: float


def lab_step(
    state: SlamState, event: ScanEvent, config: SlamConfig, rng: np.random.Generator, parts: Parts
) -> tuple[SlamState, LabInfo]:
    """``slam_step`` with replaceable parts, for configurations without polish. The right parts give the same run."""
    if config.polish is not None or len(event.points_b) < config.min_beams:
        raise DataError("lab_step", "config", "a polish, or an empty scan", "no polish, and scans with beams")
    particles, variance = predict_motion(state.particles, event, config, rng)
    matched = parts.match(state, event, particles, state.variance + variance, config, rng)
    particles, _ = reweight(Particles(matched.poses, particles.log_weights), matched.log_likelihood)
    estimate = estimate_pose(particles, config)
    before, n_eff = particles, effective_sample_size(particles.weights)
    rows, resampled = np.arange(len(particles)), None
    if n_eff <= config.resample_below * len(particles):
        particles, rows = parts.resample(particles, rng)
        resampled = particles
    state = after_match(state, particles, estimate)
    if has_moved(state, config):
        state = draw(state, event, config)
    score = float(before.weights @ matched.score)
    return state, LabInfo(event.t, estimate, before, n_eff, resampled, rows, score)


# ---- faults of the camera


def swapped_centre(camera: RgbdModel) -> RgbdModel:
    """The principal point in (row, column) order where pixels are (column, row): the K that the report prints."""
    return replace(camera, centre_u=camera.centre_v, centre_v=camera.centre_u)


def disparity_offset_by(camera: RgbdModel, counts: float) -> RgbdModel:
    """The program's depth law for a camera whose disparities are ``counts`` larger than it believes."""
    return replace(camera, disparity_offset=camera.disparity_offset + counts * camera.disparity_slope)


def pairs_by_number(count_disparity: int, count_rgb: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour image i with depth image i, as if both cameras had taken the same pictures."""
    i = np.arange(min(count_disparity, count_rgb))
    return i, i
