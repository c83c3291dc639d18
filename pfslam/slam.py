"""Particle-filter SLAM: the state, and one step of the filter.

``slam_step`` is the algorithm of the report, one call for each of its steps. State is what the next step needs; info is
what the plots need.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pfslam.config import ControlNoise, SlamConfig
from pfslam.correlation import NEAR, ScoreField, score_field, updated_field
from pfslam.events import ScanEvent
from pfslam.grid import GridSpec, OccupancyGrid, integrate_scan
from pfslam.particles import Particles, effective_sample_size, predict, resample, reweight
from pfslam.poses import average_pose, between, compose, transform_points, wrap_angle
from pfslam.refined.covariance import (
    NOTHING_DRAWN,
    polished_covariance,
    predicted_covariance,
    with_drawn,
    with_silent_direction,
)
from pfslam.refined.lines import HitMoments, Polished, polish
from pfslam.refined.outliers import WaitingScan, beyond_gate, familiar, settle_hits
from pfslam.refined.search.matching import Matched, match


@dataclass(frozen=True, eq=False)
class SlamState:
    """All that the next step needs.

    ``drawn_at`` is the pose ``(3,)`` of the last scan drawn, None while there is no map yet; ``variance (2,)`` that of
    the motion (m^2, rad^2) since a scan was last matched; ``waiting`` the last scans whose hits are being judged.
    ``drawn (D, 3, 3)`` holds the covariances of all scans in the map (see ``uncertainty.with_drawn``). ``covariance
    (3, 3)`` is that of the estimate without this ``variance``; it needs the polish, and is None without.
    """

    particles: Particles
    estimate: np.ndarray
    grid: OccupancyGrid
    field: ScoreField
    moments: HitMoments
    drawn_at: np.ndarray | None
    variance: np.ndarray
    drawn: np.ndarray
    waiting: tuple[WaitingScan, ...] = ()
    covariance: np.ndarray | None = None

    @classmethod
    def start(cls, config: SlamConfig) -> SlamState:
        """Make the state before the first scan: all particles at the origin, and an empty map."""
        return cls.without_map(Particles.at(np.zeros(3), config.particles), np.zeros(3), np.zeros(2), config)

    @classmethod
    def without_map(
        cls, particles: Particles, estimate: np.ndarray, points_w: np.ndarray, config: SlamConfig
    ) -> SlamState:
        """Make a state with an empty map around the estimate and the points ``(M, 2)`` that will be drawn into it."""
        around = np.vstack([points_w, estimate[:2]])
        grid = OccupancyGrid.empty(GridSpec.around(around, config.map.resolution, margin=5.0))
        field, moments = score_field(grid.occupied, config.search.field), HitMoments.empty(grid.spec)
        covariance = None if config.polish is None else np.zeros((3, 3))
        unknown = (None, np.zeros(2), NOTHING_DRAWN)
        return cls(particles, estimate, grid, field, moments, *unknown, covariance=covariance)


@dataclass(frozen=True, eq=False)
class StepInfo:
    """What happened in one step.

    ``particles`` is the cloud that gave the estimate, before resampling (None where it was not kept); ``score`` the
    mean score per beam, from 0 to 1, that the particles reached: it falls when the robot is lost. ``matched`` is False
    for the first scan, for scans with too few beams, and for those whose match was not believed, which are
    ``rejected``; ``scored`` is False where no particle found anything.
    """

    t: float
    estimate: np.ndarray
    particles: Particles | None
    effective_sample_size: float
    beams: int
    struck_floor: int
    matched: bool = False
    rejected: bool = False
    scored: bool = False
    resampled: bool = False
    drawn: bool = False
    score: float = 0.0
    log_evidence: float = 0.0
    """How well the whole cloud fits the scan, as a logarithm: what normalising Eq. 12 divides by."""
    polish_beams: int = 0
    free_direction: np.ndarray | None = None
    departure: np.ndarray = field(default_factory=lambda: np.zeros(2))
    """How far ``(2,)`` the scan moved the estimate from where odometry had put it (m, world axes)."""
    unexplained: float = 0.0
    """Share of the beams that end in ground seen before, but more than two cells from any wall of the map."""
    covariance: np.ndarray | None = None
    """Covariance ``(3, 3)`` of the estimate (m^2, m rad, rad^2; world axes), relative to the first scan drawn.

    It comes from the polish and the map, not from the cloud (see ``pfslam.refined.covariance``); None without a polish.
    """


class Parts(NamedTuple):
    """The parts of a step that can be exchanged one by one, to compare methods or to see what a faulty one does.

    ``match`` has the arguments of ``matching.match``, ``resample`` those of ``particles.resample``.
    """

    match: Callable[..., Matched] = match
    resample: Callable[[Particles, np.random.Generator, str], Particles] = resample


PARTS = Parts()
"""The filter's own parts."""


def slam_step(
    state: SlamState,
    event: ScanEvent,
    config: SlamConfig,
    rng: np.random.Generator,
    parts: Parts = PARTS,
) -> tuple[SlamState, StepInfo]:
    """Process one scan: predict, score and perturb, reweight, estimate, resample, draw: the loop of the report."""
    # Without a map there is nothing to match: the first scan is only drawn.
    if state.drawn_at is None:
        return begin_map(state, event, config, rng)
    # Predict: every particle moves by its own noisy motion.
    moved, variance = predict_motion(state.particles, event, config, rng)
    predicted, variance = compose(state.estimate, event.motion), state.variance + variance
    if len(event.points_b) < config.min_beams:
        return predicted_only(state, event, moved, predicted, variance)
    # Score the scan around every particle; each moves to its best pose.
    known = known_part(state, event, predicted, config)
    matched = match_scan(state, known, moved, variance, config, rng, parts)
    # Reweight by how well the scan fits there.
    particles = Particles(matched.poses, moved.log_weights)
    particles, evidence = reweight(particles, matched.log_likelihood)
    # Estimate one pose; align it to the map's lines, and the cloud with it.
    estimate = estimate_pose(particles, config)
    aligned = align(state, known, estimate, predicted, config, variance)
    if not believable(state, event, predicted, aligned.pose, variance, config):
        return predicted_only(state, event, moved, predicted, variance, rejected=True)
    particles = shifted(particles, estimate, aligned.pose)
    info = describe(state, event, predicted, aligned, particles, matched, evidence, variance)
    # Resample if few particles carry the weight.
    if info.effective_sample_size <= config.resample_below * len(particles):
        particles = parts.resample(particles, rng, config.resampler)
        info = replace(info, resampled=True)
    # The scan has fixed the pose, so the uncertainty of the motion starts again from zero.
    state = replace(state, particles=particles, estimate=aligned.pose, variance=np.zeros(2))
    state = replace(state, covariance=info.covariance)
    # Draw the scan into the map, if the robot has moved since the last one.
    if has_moved(state, config):
        state, info = draw(state, event, config), replace(info, drawn=True)
    return state, info


def begin_map(
    state: SlamState, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[SlamState, StepInfo]:
    """Process a scan while there is no map: draw it where the robot is taken to be, unless it has too few beams.

    The map begins at that pose, so no particle can be wrong about its place in it: all stand at the odometry's pose.
    The report's filter predicts its first scan like any other and draws it from its best particle.
    """
    seen = len(event.points_b) >= config.min_beams
    if seen and config.predict_before_first_scan:
        particles, _ = predict_motion(state.particles, event, config, rng)
        pose = estimate_pose(particles, config)
    else:
        pose = compose(state.estimate, event.motion)
        particles = Particles.at(pose, len(state.particles))
    state = SlamState.without_map(particles, pose, transform_points(pose, event.points_b), config)
    info = _info(event, pose, particles, drawn=seen, covariance=state.covariance)
    return (draw(state, event, config) if seen else state), info


def predicted_only(
    state: SlamState,
    event: ScanEvent,
    particles: Particles,
    predicted: np.ndarray,
    variance: np.ndarray,
    rejected: bool = False,
) -> tuple[SlamState, StepInfo]:
    """Process a scan with too few beams, or one not believed: odometry alone moves the cloud and the estimate."""
    covariance, inherited = None, state.covariance
    if inherited is not None:
        covariance = predicted_covariance(inherited, state.estimate, predicted, variance)
        inherited = predicted_covariance(inherited, state.estimate, predicted, np.zeros(2))
    state = replace(state, particles=particles, estimate=predicted, variance=variance, covariance=inherited)
    return state, _info(event, predicted, particles, rejected=rejected, covariance=covariance)


def known_part(state: SlamState, event: ScanEvent, predicted: np.ndarray, config: SlamConfig) -> ScanEvent:
    """Leave out the beams that contradict the map at the predicted pose, if the configuration takes such care."""
    if config.care is None:
        return event
    points_w = transform_points(predicted, event.points_b)
    known = familiar(state.grid, state.field, points_w, config.map.free, config.care)
    if np.count_nonzero(known) < config.min_beams:
        return event
    return replace(event, points_b=event.points_b[known], beams=event.beams[known])


def believable(
    state: SlamState,
    event: ScanEvent,
    predicted: np.ndarray,
    pose: np.ndarray,
    variance: np.ndarray,
    config: SlamConfig,
) -> bool:
    """Tell whether a match lies within the gate about odometry, or has few unexplained beams; always without care."""
    if config.care is None or not beyond_gate(pose - predicted, variance, config.care.gate):
        return True
    return unexplained(state, event, pose) <= config.care.unexplained


def predict_motion(
    particles: Particles, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[Particles, np.ndarray]:
    """Move the particles by the motion of one event; also return the variance ``(2,)`` (m^2, rad^2) that it added."""
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
    parts: Parts = PARTS,
) -> Matched:
    """Move the particles to their best poses for a thinned scan; the motion's variance sets the window."""
    points = event.points_b[:: config.search.beam_stride]
    spec, sigmas = state.grid.spec, np.sqrt(variance)
    return parts.match(state.field, spec, points, particles.poses, sigmas, config.search, rng)


def estimate_pose(particles: Particles, config: SlamConfig) -> np.ndarray:
    """Choose one pose ``(3,)`` for the whole cloud: the particle of greatest weight, or the weighted mean."""
    if config.estimate == "best":
        return particles.poses[np.argmax(particles.log_weights)].copy()
    return average_pose(particles.poses, particles.weights)


def align(
    state: SlamState,
    event: ScanEvent,
    estimate: np.ndarray,
    predicted: np.ndarray,
    config: SlamConfig,
    variance: np.ndarray | None = None,
) -> Polished:
    """Polish the estimate on the map's lines, or return it as it was if the configuration has no polish."""
    if config.polish is None:
        return Polished(estimate, 0, None)
    points = event.points_b[:: config.polish.beam_stride]
    return polish(state.moments, points, estimate, predicted, config.polish, variance)


def shifted(particles: Particles, before: np.ndarray, after: np.ndarray) -> Particles:
    """Move the cloud by the same correction that took the estimate from one pose to another."""
    poses = particles.poses + (after - before)
    poses[:, 2] = wrap_angle(poses[:, 2])
    return Particles(poses, particles.log_weights)


def has_moved(state: SlamState, config: SlamConfig) -> bool:
    """Tell whether the estimate has moved or turned far enough for the next scan to be drawn."""
    motion = between(state.drawn_at, state.estimate)
    return bool(np.hypot(*motion[:2]) >= config.draw_metres or abs(motion[2]) >= config.draw_radians)


def draw(state: SlamState, event: ScanEvent, config: SlamConfig) -> SlamState:
    """Write the scan into map, score field and hit moments from the estimate."""
    points_w = transform_points(state.estimate, event.points_b)
    sensor_w = transform_points(state.estimate, event.sensor_b[None])
    grid = state.grid.covering(np.concatenate([points_w, sensor_w]))
    grown = grid.spec != state.grid.spec
    hits, waiting = None, state.waiting
    if config.care is not None and state.drawn_at is not None:
        scan = points_w, event.beams, sensor_w[0]
        hits, waiting = settle_hits(waiting, grid.spec, *scan, config.map, config.care)
    grid, rectangle = integrate_scan(grid, points_w, event.beams, sensor_w[0], config.map, hits)
    if grown:
        field = score_field(grid.occupied, config.search.field)
    else:
        field = updated_field(state.field, grid.occupied, rectangle)
    moments = state.moments
    if config.polish is not None:
        moments = moments.covering(grid.spec).add(points_w if hits is None else hits, len(state.drawn))
    drawn, at = state.drawn, state.estimate
    if state.covariance is not None:
        drawn = with_drawn(drawn, at, state.covariance)
    return replace(state, grid=grid, field=field, moments=moments, drawn_at=at, waiting=waiting, drawn=drawn)


def describe(
    state: SlamState,
    event: ScanEvent,
    predicted: np.ndarray,
    aligned: Polished,
    particles: Particles,
    matched: Matched,
    evidence: float,
    variance: np.ndarray,
) -> StepInfo:
    """Gather the facts about a step whose scan was matched."""
    return _info(
        event,
        aligned.pose,
        particles,
        matched=True,
        scored=evidence > -np.inf,
        score=float(particles.weights @ matched.score),
        log_evidence=evidence,
        polish_beams=aligned.beams,
        free_direction=aligned.free_direction,
        departure=aligned.pose[:2] - predicted[:2],
        unexplained=unexplained(state, event, aligned.pose),
        covariance=aligned_covariance(state, aligned, variance),
    )


def aligned_covariance(state: SlamState, aligned: Polished, variance: np.ndarray) -> np.ndarray | None:
    """Return the covariance ``(3, 3)`` of a polished pose; ``variance (2,)`` is the motion's since the last match."""
    if state.covariance is None:
        return None
    fit, silent = aligned.fit, aligned.free_direction
    if fit is None:
        return predicted_covariance(state.covariance, state.estimate, aligned.pose, variance)
    found = polished_covariance(state.drawn, state.moments, aligned.pose, fit, variance)
    if silent is None:
        return found
    predicted = predicted_covariance(state.covariance, state.estimate, aligned.pose, variance)
    return with_silent_direction(found, silent, predicted)


def unexplained(state: SlamState, event: ScanEvent, pose: np.ndarray) -> float:
    """Return the share of beams that end in ground the map knows, farther than the field's ``NEAR`` from its walls."""
    cells = state.grid.spec.world_to_cell(transform_points(pose, event.points_b))
    ix, iy = cells.compress(state.grid.spec.contains(cells), axis=0).T
    known = state.grid.log_odds[iy, ix] != 0.0
    far = state.field.values[iy, ix] < NEAR[state.field.kind]
    return float(np.count_nonzero(known & far)) / max(int(np.count_nonzero(known)), 1)


def _info(event: ScanEvent, estimate: np.ndarray, particles: Particles, **what) -> StepInfo:
    n_eff = effective_sample_size(particles.weights)
    return StepInfo(event.t, estimate, particles, n_eff, len(event.beams), event.struck_floor, **what)
