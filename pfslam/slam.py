"""Particle-filter SLAM: the state, one step, and the run.

``slam_step`` is the algorithm of the report, one call per line. State is what the next step needs; info is what the
plots need.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pfslam.config import ControlNoise, SlamConfig
from pfslam.correlation import score_field, updated_field
from pfslam.events import ScanEvent
from pfslam.grid import GridSpec, OccupancyGrid, integrate_scan
from pfslam.matching import Matched, match
from pfslam.particles import Particles, effective_sample_size, predict, resample, reweight
from pfslam.poses import average_pose, between, compose, transform_points, wrap_angle
from pfslam.refinement import HitMoments, polish


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
    """What happened in one step.

    ``particles`` is the cloud that gave the estimate, before resampling (None where it was not kept); ``score`` the
    mean score per beam, from 0 to 1, that the particles reached: it falls when the robot is lost. ``matched`` is False
    for the first scan and for scans with too few beams; ``scored`` is False where no particle found anything.
    """

    t: float
    estimate: np.ndarray
    particles: Particles | None
    effective_sample_size: float
    beams: int
    struck_floor: int
    matched: bool = False
    scored: bool = False
    resampled: bool = False
    drawn: bool = False
    score: float = 0.0
    log_evidence: float = 0.0
    """How well the whole cloud fits the scan, as a logarithm: what normalising Eq. 12 divides by."""
    polish_beams: int = 0
    free_direction: np.ndarray | None = None


def slam_step(
    state: SlamState, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[SlamState, StepInfo]:
    """One scan: predict, score and perturb, reweight, estimate, resample, draw: the loop of the report."""
    # Predict: every particle moves by its own noisy motion; odometry alone moves the last estimate.
    particles, variance = predict_motion(state.particles, event, config, rng)
    predicted, variance = compose(state.estimate, event.motion), state.variance + variance
    if len(event.points_b) < config.min_beams:
        state = replace(state, particles=particles, estimate=predicted, variance=variance)
        return state, _info(event, predicted, particles)
    # Score the scan around every particle; each moves to the best pose of its window.
    matched = match_scan(state, event, particles, variance, config, rng)
    # Reweight by how well the scan fits there.
    particles, evidence = reweight(Particles(matched.poses, particles.log_weights), matched.log_likelihood)
    # Estimate one pose; align it to the lines of the map, and the cloud with it.
    estimate, particles, aligned = align(
        state, event, estimate_pose(particles, config), particles, predicted, config
    )
    info = _info(event, estimate, particles, matched=True, scored=evidence > -np.inf)
    info = replace(info, score=float(particles.weights @ matched.score), log_evidence=evidence, **aligned)
    # Resample if few particles carry the weight.
    if info.effective_sample_size <= config.resample_below * len(particles):
        particles, info = resample(particles, rng, config.resampler), replace(info, resampled=True)
    state = replace(state, particles=particles, estimate=estimate, variance=np.zeros(2))
    # Draw the scan into the map from the estimate, if the robot has moved since the last one drawn.
    if has_moved(between(state.drawn_at, estimate), config):
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
    sigmas = np.array([sigma_xy, sigma_xy, sigma_yaw])
    noise = sigmas * rng.standard_normal((len(particles), 3)) if config.noise.sampled else np.zeros(3)
    moved = Particles(compose(particles.poses, event.motion + noise), particles.log_weights)
    return moved, np.array([sigma_xy, sigma_yaw]) ** 2


def match_scan(
    state: SlamState,
    event: ScanEvent,
    particles: Particles,
    variance: np.ndarray,
    config: SlamConfig,
    rng: np.random.Generator,
) -> Matched:
    """The particles moved to their best poses for a thinned scan; the window follows from the motion's uncertainty."""
    points = event.points_b[:: config.search.beam_stride]
    return match(state.field, state.grid.spec, points, particles.poses, np.sqrt(variance), config.search, rng)


def estimate_pose(particles: Particles, config: SlamConfig) -> np.ndarray:
    """One pose ``(3,)`` for the whole cloud: the particle of greatest weight, or the weighted mean."""
    if config.estimate == "best":
        return particles.poses[np.argmax(particles.log_weights)].copy()
    return average_pose(particles.poses, particles.weights)


def align(
    state: SlamState,
    event: ScanEvent,
    estimate: np.ndarray,
    particles: Particles,
    predicted: np.ndarray,
    config: SlamConfig,
) -> tuple[np.ndarray, Particles, dict]:
    """The estimate after the line polish, the cloud shifted by the same correction, and what the info should say."""
    if config.polish is None:
        return estimate, particles, {}
    points = event.points_b[:: config.polish.beam_stride]
    polished = polish(state.moments, points, estimate, predicted, config.polish)
    moved = particles.poses + (polished.pose - estimate)
    moved[:, 2] = wrap_angle(moved[:, 2])
    particles = Particles(moved, particles.log_weights)
    return (
        polished.pose,
        particles,
        {"polish_beams": polished.beams, "free_direction": polished.free_direction},
    )


def has_moved(motion: np.ndarray, config: SlamConfig) -> bool:
    """Whether a motion ``(3,)`` is large enough for the next scan to be drawn."""
    return bool(np.hypot(*motion[:2]) >= config.draw_metres or abs(motion[2]) >= config.draw_radians)


def draw(state: SlamState, event: ScanEvent, config: SlamConfig) -> SlamState:
    """The scan written into map, score field and hit moments from the estimate."""
    points_w = transform_points(state.estimate, event.points_b)
    sensor_w = transform_points(state.estimate, event.sensor_b[None])
    grid = state.grid.covering(np.concatenate([points_w, sensor_w]))
    grown = grid.spec != state.grid.spec
    grid, rectangle = integrate_scan(grid, points_w, event.beams, sensor_w[0], config.map)
    if grown:
        field = score_field(grid.occupied, config.search.field)
    else:
        field = updated_field(state.field, grid.occupied, rectangle, config.search.field)
    moments = state.moments
    if config.polish is not None:
        moments = moments.covering(grid.spec).add(points_w)
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
    info = _info(event, estimate, particles)
    return (draw(state, event, config), replace(info, drawn=True)) if len(event.points_b) else (state, info)


def _info(event: ScanEvent, estimate: np.ndarray, particles: Particles, **what) -> StepInfo:
    n_eff = effective_sample_size(particles.weights)
    return StepInfo(event.t, estimate, particles, n_eff, len(event.beams), event.struck_floor, **what)
