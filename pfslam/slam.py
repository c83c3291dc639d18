"""Particle-filter SLAM: the state, one step, and the run.

``slam_step`` is the algorithm of the report, one call per line. State is what the next step needs; info is what the
plots need.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from pfslam.config import ControlNoise, SlamConfig
from pfslam.correlation import score_field, updated_field
from pfslam.errors import DataError
from pfslam.grid import GridSpec, OccupancyGrid, integrate_scan
from pfslam.matching import match
from pfslam.motion import Controls, controls, dead_reckoning
from pfslam.particles import Particles, effective_sample_size, predict, resample, reweight
from pfslam.poses import Trajectory, average_pose, between, compose, transform_points, wrap_angle
from pfslam.recording import Recording
from pfslam.refinement import HitMoments, polish
from pfslam.sensors import scan_points


@dataclass(frozen=True, eq=False)
class ScanEvent:
    """One used scan and the motion that led to it.

    ``points_b (M, 2)`` end points in the body frame (m), ``beams (M,)`` their beam numbers, ``sensor_b (2,)`` the
    LiDAR; ``motion (3,)`` the odometry's pose of the robot seen from its pose at the event before; ``controls`` the
    samples in between as ``(v, omega, dt)``, each ``(n,)``.
    """

    t: float
    points_b: np.ndarray
    beams: np.ndarray
    sensor_b: np.ndarray
    motion: np.ndarray
    controls: tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class SlamState:
    """All that the next step needs. ``variance`` is the motion's (m^2, rad^2) since a scan was last matched."""

    particles: Particles
    estimate: np.ndarray
    grid: OccupancyGrid
    field: np.ndarray
    moments: HitMoments
    drawn_at: np.ndarray
    variance: np.ndarray


@dataclass(frozen=True, eq=False)
class StepInfo:
    """What happened in one step. ``score`` is the mean score per beam at the estimate's particles, from 0 to 1."""

    t: float
    estimate: np.ndarray
    particles: Particles
    effective_sample_size: float
    score: float
    beams: int
    matched: bool
    scored: bool
    resampled: bool
    drawn: bool
    polish_beams: int = 0
    free_direction: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class SlamResult:
    """A finished run: the estimate as it was at each used scan (never revised), the map, one info per step."""

    trajectory: Trajectory
    grid: OccupancyGrid
    infos: tuple[StepInfo, ...]
    dropped: dict[str, int]
    config: SlamConfig

    @property
    def updates(self) -> int:
        """Scans that were matched against the map."""
        return sum(info.matched for info in self.infos)

    @property
    def resamplings(self) -> int:
        return sum(info.resampled for info in self.infos)


def slam_step(
    state: SlamState, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[SlamState, StepInfo]:
    """One scan: predict, score and perturb, reweight, estimate, resample, draw. Implements the loop of section III-A."""
    # Predict: every particle moves by its own noisy motion; so does the odometry's idea of the estimate.
    particles, variance = predict_motion(state.particles, event, config, rng)
    predicted = compose(state.estimate, event.motion)
    variance = state.variance + variance
    if len(event.points_b) < config.min_beams:
        estimate = average_pose(particles.poses, particles.weights) if config.estimate == "mean" else predicted
        info = _info(event, estimate, particles, matched=False)
        return replace(state, particles=particles, estimate=estimate, variance=variance), info
    # Score the scan around every particle and move each to the best pose of its window.
    points = event.points_b[:: config.search.beam_stride]
    matched = match(state.field, state.grid.spec, points, particles.poses, np.sqrt(variance), config.search, rng)
    # Reweight by how well the scan fits.
    particles, evidence = reweight(Particles(matched.poses, particles.log_weights), matched.log_likelihood)
    n_eff = effective_sample_size(particles.weights)
    info = _info(event, state.estimate, particles, matched=True)
    info = replace(
        info, effective_sample_size=n_eff, scored=evidence > -np.inf, score=float(particles.weights @ matched.score)
    )
    # Estimate the pose; align it to the lines of the map; the cloud moves with it.
    estimate = estimate_pose(particles, config)
    if config.polish is not None:
        polished = polish(state.moments, event.points_b[:: config.polish.beam_stride], estimate, predicted, config.polish)
        shift = polished.pose - estimate
        estimate = polished.pose
        particles = Particles(particles.poses + [*shift[:2], wrap_angle(shift[2])], particles.log_weights)
        info = replace(info, polish_beams=polished.beams, free_direction=polished.free_direction)
    info = replace(info, estimate=estimate, particles=particles)
    # Resample if few particles carry the weight.
    if n_eff <= config.resample_below * len(particles):
        particles, info = resample(particles, rng, config.resampler), replace(info, resampled=True)
    state = replace(state, particles=particles, estimate=estimate, variance=np.zeros(2))
    # Draw the scan into the map from the estimate.
    moved = between(state.drawn_at, estimate)
    if np.hypot(*moved[:2]) >= config.draw_metres or abs(moved[2]) >= config.draw_radians:
        state, info = draw(state, event, config), replace(info, drawn=True)
    return state, info


def predict_motion(
    particles: Particles, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[Particles, np.ndarray]:
    """Particles after the motion of one event, and the variance ``(2,)`` (m^2, rad^2) that it added."""
    v, omega, dt = event.controls
    if isinstance(config.noise, ControlNoise):
        for k in range(len(v)):
            particles = predict(particles, v[k], omega[k], dt[k], config.noise, rng)
        spread = np.sum(dt) if config.noise.per_root_second else np.sum(dt**2)
        return particles, np.array([config.noise.sigma_v, config.noise.sigma_omega]) ** 2 * spread
    sigma_xy, sigma_yaw = config.noise.sigmas(float(np.hypot(*event.motion[:2])), abs(float(event.motion[2])))
    noise = rng.standard_normal((len(particles), 3)) * [sigma_xy, sigma_xy, sigma_yaw]
    return Particles(compose(particles.poses, event.motion + noise), particles.log_weights), np.array(
        [sigma_xy**2, sigma_yaw**2]
    )


def estimate_pose(particles: Particles, config: SlamConfig) -> np.ndarray:
    """One pose ``(3,)`` for the whole cloud: the particle of greatest weight, or the weighted mean."""
    if config.estimate == "best":
        return particles.poses[np.argmax(particles.log_weights)].copy()
    return average_pose(particles.poses, particles.weights)


def draw(state: SlamState, event: ScanEvent, config: SlamConfig) -> SlamState:
    """The scan written into map, score field and hit moments from the estimate."""
    points_w, sensor_w = transform_points(state.estimate, event.points_b), transform_points(state.estimate, event.sensor_b[None])
    grid = state.grid.covering(np.concatenate([points_w, sensor_w]))
    grown = grid.spec != state.grid.spec
    grid, rectangle = integrate_scan(grid, points_w, event.beams, sensor_w[0], config.map)
    if grown:
        field = score_field(grid.occupied, config.search.field)
    else:
        field = updated_field(state.field, grid.occupied, rectangle, config.search.field)
    moments = state.moments.covering(grid.spec).add(points_w) if config.polish is not None else state.moments
    return replace(state, grid=grid, field=field, moments=moments, drawn_at=state.estimate)


def start(event: ScanEvent, config: SlamConfig, rng: np.random.Generator) -> tuple[SlamState, StepInfo]:
    """The state after the first scan: there is no map to compare it with, so it is only drawn."""
    particles = Particles.at(np.zeros(3), config.particles)
    if config.predict_before_first_scan:
        particles, _ = predict_motion(particles, event, config, rng)
    estimate = estimate_pose(particles, config)
    around = np.concatenate([transform_points(estimate, event.points_b), estimate[None, :2]])
    grid = OccupancyGrid.empty(GridSpec.around(around, config.map.resolution, margin=5.0))
    field, moments = score_field(grid.occupied, config.search.field), HitMoments.empty(grid.spec)
    state = SlamState(particles, estimate, grid, field, moments, estimate, np.zeros(2))
    drawn = len(event.points_b) > 0
    return draw(state, event, config) if drawn else state, replace(_info(event, estimate, particles, False), drawn=drawn)


def slam_steps(
    recording: Recording, config: SlamConfig, rng: np.random.Generator
) -> Iterator[tuple[SlamState, StepInfo]]:
    """The run as an iterator over (state, info), one for each used scan: for animations and for long drives."""
    state = None
    for event in scan_events(recording, config)[0]:
        state, info = start(event, config, rng) if state is None else slam_step(state, event, config, rng)
        yield state, info


def run_slam(
    recording: Recording,
    config: SlamConfig | None = None,
    *,
    rng: np.random.Generator | None = None,
    progress: Callable | None = None,
    keep_particles: bool = True,
) -> SlamResult:
    """Trajectory and map of a recording.

    ``config=None`` is ``SlamConfig.refined()``; ``rng=None`` is seed 0. ``progress(iterable, total=n)`` may wrap the
    loop, as tqdm does. Without ``keep_particles`` the infos hold no clouds, which saves memory on long runs.
    """
    config = SlamConfig.refined() if config is None else config
    rng = np.random.default_rng(0) if rng is None else rng
    stamps, dropped = used_scans(recording, config)
    steps = slam_steps(recording, config, rng)
    infos, state = [], None
    for state, info in progress(steps, total=len(stamps)) if progress else steps:
        infos.append(info if keep_particles else replace(info, particles=None))
    trajectory = Trajectory([info.t for info in infos], [info.estimate for info in infos])
    blind = sum(not info.matched for info in infos[1:])
    mute = sum(info.matched and not info.scored for info in infos)
    dropped |= {"scans with too few valid beams": blind} if blind else {}
    dropped |= {"scans that scored nothing anywhere": mute} if mute else {}
    return SlamResult(trajectory, state.grid, tuple(infos), dropped, config)


def used_scans(recording: Recording, config: SlamConfig) -> tuple[np.ndarray, dict[str, int]]:
    """Indices of the scans a run will use, and how many were left out because odometry does not cover them."""
    if recording.lidar is None:
        raise DataError(recording.name, "lidar", "no scans", "a recording with LiDAR")
    odometry = dead_reckoning(recording)
    every = config.every if config.every is not None else recording.default_every
    index = np.arange(0, len(recording.lidar.t), every)
    covered = odometry.covers(recording.lidar.t[index])
    if not covered.any():
        raise DataError(recording.name, "lidar time_stamps", "no scan within the odometry's time", "streams that overlap")
    outside = int(np.count_nonzero(~covered))
    return index[covered], {"scans outside the odometry's time": outside} if outside else {}


def scan_events(recording: Recording, config: SlamConfig) -> tuple[Iterator[ScanEvent], dict[str, int]]:
    """The used scans in order, each with the motion since the one before, and what was dropped."""
    index, dropped = used_scans(recording, config)
    odometry = dead_reckoning(recording)
    return _events(recording, odometry, controls(recording), index), dropped


def _events(recording: Recording, odometry: Trajectory, inputs: Controls, index: np.ndarray) -> Iterator[ScanEvent]:
    lidar, sensor_b = recording.robot.lidar, np.array(recording.robot.lidar.position_b[:2])
    previous_t, previous = odometry.t[0], odometry.poses[0]
    for i in index:
        t, ranges = recording.lidar.t[i], recording.lidar.ranges[i]
        pose = odometry.at(t)
        beams = np.flatnonzero(lidar.valid(ranges))
        motion = between(previous, pose)
        yield ScanEvent(t, scan_points(ranges, lidar), beams, sensor_b, motion, inputs.during(previous_t, t))
        previous_t, previous = t, pose


def _info(event: ScanEvent, estimate: np.ndarray, particles: Particles, matched: bool) -> StepInfo:
    n_eff = effective_sample_size(particles.weights)
    return StepInfo(event.t, estimate, particles, n_eff, 0.0, len(event.beams), matched, matched, False, False)
