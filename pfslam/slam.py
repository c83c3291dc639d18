"""Particle-filter SLAM: the settings, the belief, and one step of the filter.

``slam_step`` is the algorithm of the report, one line for each of its steps, with the numbers of its equations. The
belief is what the next step needs; a ``Step`` is what plots and verdicts need.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import inf, sqrt
from typing import Annotated, Literal

import numpy as np

from pfslam.errors import DataError
from pfslam.events import ScanEvent
from pfslam.grid import LOG_4, GridSpec, MapConfig
from pfslam.map import Fix, Map, Prior
from pfslam.particles import (
    MAX_PARTICLES,
    ControlNoise,
    MotionNoise,
    Particles,
    Scheme,
    effective_sample_size,
    resample,
    reweight,
)
from pfslam.poses import average_pose, compose, transform_points
from pfslam.refined.covariance import predicted_covariance
from pfslam.refined.filling import filled
from pfslam.refined.lines import LineConfig
from pfslam.refined.outliers import NOISY, OutlierConfig
from pfslam.refined.search.matching import Match, SearchConfig
from pfslam.settings import Range, Settings, plain

MAX_EVERY = 10**6


def slam_step(
    belief: Belief, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[Belief, Step]:
    """Process one scan: predict, match, reweight, align, resample, draw. The belief's map is written in place."""
    if belief.map.is_empty:
        return begin(belief, event, config, rng)
    # Eq. 11: every particle moves by its own noisy motion, weights unchanged.
    prior = belief.predict(event, config, rng)
    if len(event.points_b) < config.min_beams:
        return belief.coast(event, prior)
    # A coarse scanner sees dots: the wall between two of them is filled in.
    event = filled(event, config.beam_spacing)
    # Eq. 6, 8, 9: the scan is scored at every perturbation of every particle, which moves to its best one.
    scan = belief.map.inliers(event, prior.pose, config.min_beams)
    match = belief.map.match(scan, prior, config.search, rng)
    # Eq. 12: weights multiply by the likelihood there, and are normalised.
    particles = Particles(match.poses, prior.particles.log_weights)
    particles, log_evidence = reweight(particles, match.log_likelihood)
    # One pose for the whole cloud, aligned to the map's lines; the cloud moves with it.
    pose = estimate_pose(particles, config.estimate)
    fix = belief.map.align(scan, pose, prior)
    if not belief.map.within_gate(event, fix.pose, prior):
        return belief.coast(event, prior, rejected=True)
    particles = particles.shifted(fix.pose - pose)
    # Eq. 13: resample where few particles carry the weight.
    n_eff = effective_sample_size(particles.weights)
    step = Step.matched_scan(event, prior, match, particles, n_eff, log_evidence, fix, belief.map)
    if n_eff <= config.resample_below * len(particles):
        particles, step = resample(particles, rng, config.resampler), replace(step, resampled=True)
    # Eq. 14, 15: draw the scan, if the robot has moved since the last one drawn.
    if belief.map.has_moved(fix.pose, config.draw_metres, config.draw_radians):
        belief.map.draw(event, fix)
        step = replace(step, drawn=True)
    # The scan has fixed the pose, so the uncertainty of the motion starts again from zero.
    corrected = prior.corrected_by(fix.pose)
    return Belief(particles, fix.pose, belief.map, np.zeros(2), fix.covariance, corrected), step


@dataclass(frozen=True, eq=False)
class Belief:
    """All that the next step needs: the cloud, one pose for it, and the map, which the run owns and writes in place.

    ``estimate (3,)`` is the pose; ``variance (2,)`` that of the motion (m^2, rad^2) since a scan was last matched.
    ``covariance (3, 3)`` is that of the estimate without this ``variance``; it needs lines, and is None without.
    ``corrected (2,)`` is how far (m) scans have moved the estimate from its odometry, over about the last metre.
    """

    particles: Particles
    estimate: np.ndarray
    map: Map
    variance: np.ndarray
    covariance: np.ndarray | None = None
    corrected: np.ndarray = field(default_factory=lambda: np.zeros(2))

    @classmethod
    def start(cls, config: SlamConfig) -> Belief:
        """Make the belief before the first scan: all particles at the origin, and an empty map."""
        return cls.without_map(Particles.at(np.zeros(3), config.particles), np.zeros(3), np.zeros(2), config)

    @classmethod
    def without_map(
        cls, particles: Particles, estimate: np.ndarray, points_w: np.ndarray, config: SlamConfig
    ) -> Belief:
        """Make a belief with an empty map around the estimate and the points ``(M, 2)`` that will be drawn into it."""
        spec = GridSpec.around(np.vstack([points_w, estimate[:2]]), config.map.resolution, margin=5.0)
        empty = Map(spec, config.map, config.search.field, config.lines, config.outliers)
        covariance = None if config.lines is None else np.zeros((3, 3))
        return cls(particles, estimate, empty, np.zeros(2), covariance)

    @property
    def grid(self):
        """The map's occupancy grid."""
        return self.map.grid

    def predict(self, event: ScanEvent, config: SlamConfig, rng: np.random.Generator) -> Prior:
        """Move the cloud and the estimate by the motion of an event."""
        particles, variance = config.noise.predict(self.particles, event, rng)
        pose = compose(self.estimate, event.motion)
        variance = self.variance + variance
        return Prior(particles, pose, variance, self.estimate, self.covariance, self.corrected)

    def coast(self, event: ScanEvent, prior: Prior, rejected: bool = False) -> tuple[Belief, Step]:
        """Go on by odometry alone, where a scan has too few beams or its match is rejected."""
        inherited = self.covariance
        if inherited is not None:
            inherited = predicted_covariance(inherited, self.estimate, prior.pose, np.zeros(2))
        step = Step.coasted(
            event, prior.pose, prior.particles, prior.covariance(prior.pose), rejected=rejected
        )
        corrected = prior.corrected_by(prior.pose)
        return Belief(prior.particles, prior.pose, self.map, prior.variance, inherited, corrected), step


def begin(
    belief: Belief, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[Belief, Step]:
    """Process a scan while there is no map: draw it where the robot is taken to be, unless it has too few beams.

    The map begins at that pose, so no particle can be wrong about its place in it: all stand at the odometry's pose.
    The report's filter predicts its first scan like any other and draws it from its best particle.
    """
    seen = len(event.points_b) >= config.min_beams
    event = filled(event, config.beam_spacing)
    if seen and config.predict_before_first_scan:
        particles, _ = config.noise.predict(belief.particles, event, rng)
        pose = estimate_pose(particles, config.estimate)
    else:
        pose = compose(belief.estimate, event.motion)
        particles = Particles.at(pose, len(belief.particles))
    belief = Belief.without_map(particles, pose, transform_points(pose, event.points_b), config)
    if seen:
        belief.map.draw(event, Fix(pose, belief.covariance))
    return belief, Step.coasted(event, pose, particles, belief.covariance, drawn=seen)


def estimate_pose(particles: Particles, estimate: str) -> np.ndarray:
    """Choose one pose ``(3,)`` for the whole cloud: the particle of greatest weight ("best"), or the weighted mean."""
    if estimate == "best":
        return particles.poses[np.argmax(particles.log_weights)].copy()
    return average_pose(particles.poses, particles.weights)


@dataclass(frozen=True, eq=False)
class Step:
    """What happened in one step.

    ``particles`` is the cloud that gave the estimate, before resampling (None where it was not kept); ``score`` the
    mean score per beam, from 0 to 1, that the particles reached: it falls when the robot is lost. ``matched`` is False
    for the first scan, for scans with too few beams, and for those whose match lay beyond the gate, which are
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
    aligned_score: float = 0.0
    """The same at the estimate: where odometry is far off, lines lead it to where no particle has searched."""
    log_evidence: float = 0.0
    """How well the whole cloud fits the scan, as a logarithm: what normalising Eq. 12 divides by."""
    free_direction: np.ndarray | None = None
    departure: np.ndarray = field(default_factory=lambda: np.zeros(2))
    """How far ``(2,)`` the scan moved the estimate from where odometry had put it (m, world axes)."""
    unexplained: float = 0.0
    """Share of the beams that end in ground seen before, but more than two cells from any wall of the map."""
    old_walls: float = 0.0
    """By how much the share of beams on walls drawn long before is larger at the estimate than where odometry led.

    "Where odometry led": the estimate without what scans have corrected over about the last metre.
    """
    covariance: np.ndarray | None = None
    """Covariance ``(3, 3)`` of the estimate (m^2, m rad, rad^2; world axes), relative to the first scan drawn.

    It comes from the map's lines, not from the cloud (see ``pfslam.refined.covariance``); None without lines.
    """

    @classmethod
    def coasted(cls, event: ScanEvent, pose, particles: Particles, covariance, **what) -> Step:
        """Describe a step whose scan was not matched."""
        n_eff, beams = effective_sample_size(particles.weights), len(event.beams)
        return cls(event.t, pose, particles, n_eff, beams, event.struck_floor, covariance=covariance, **what)

    @classmethod
    def matched_scan(
        cls, event: ScanEvent, prior: Prior, match: Match, particles, n_eff, log_evidence, fix: Fix, map: Map
    ) -> Step:
        """Describe a step whose scan was matched, with the map as it was then."""
        uncorrected = fix.pose - np.append(prior.corrected_by(fix.pose), 0.0)
        return cls(
            event.t,
            fix.pose,
            particles,
            n_eff,
            len(event.beams),
            event.struck_floor,
            covariance=fix.covariance,
            matched=True,
            scored=log_evidence > -np.inf,
            score=float(particles.weights @ match.score),
            aligned_score=fix.score,
            log_evidence=log_evidence,
            free_direction=fix.free_direction,
            departure=fix.pose[:2] - prior.pose[:2],
            unexplained=map.unexplained(event, fix.pose),
            old_walls=map.on_old_walls(event, fix.pose) - map.on_old_walls(event, uncorrected),
        )


@dataclass(frozen=True)
class SlamConfig(Settings):
    """Collect all settings of one run of the filter, in SI units; sigmas are standard deviations.

    >>> from dataclasses import replace
    >>> few = replace(SlamConfig.refined(), particles=20)
    >>> few.particles, few.estimate
    (20, 'mean')
    """

    maps: Literal["shared", "per-particle"] = "shared"
    """"shared": one map, drawn from the estimate. "per-particle": a map for each particle (Rao-Blackwellised)."""
    particles: Annotated[int, Range(1, MAX_PARTICLES)] = 200
    every: Annotated[int, Range(1, MAX_EVERY)] | None = None
    """Every how-many-th scan is used; None takes the recording's own default."""
    noise: ControlNoise | MotionNoise = field(default_factory=MotionNoise)
    """White noise on every control sample (Eq. 11), or noise on the motion between two scans."""
    predict_before_first_scan: bool = False
    search: SearchConfig = field(default_factory=SearchConfig)
    map: MapConfig = field(default_factory=MapConfig)
    lines: LineConfig | None = None
    """Alignment of the estimate to the map's lines; ``None`` leaves it out."""
    outliers: OutlierConfig | None = None
    """How to live with people and glass; ``None`` takes everything that a beam meets for a wall."""
    tilt: bool = False
    """Whether the body's lean is taken into account; if not, every floor is taken to be flat."""
    estimate: Literal["best", "mean"] = "best"
    """"best": the particle of greatest weight. "mean": the weighted mean of all."""
    resample_below: Annotated[float, Range(0.0, 1.0)] = 0.1
    """Resample when N_eff is at most this share of N."""
    resampler: Scheme = "systematic"
    draw_metres: Annotated[float, Range(0.0, inf)] = 0.0
    draw_radians: Annotated[float, Range(0.0, inf)] = 0.0
    """The scan is drawn into the map after moving or turning by at least so much since the last one; inf: never."""
    beam_spacing: Annotated[float, Range(0.0, inf)] = 0.0
    """Where neighbouring beams are more than this (rad) apart, the wall between them is filled in; 0: nowhere."""
    min_beams: Annotated[int, Range(1, 10**6)] = 10
    """Scans with fewer valid beams are predicted through, not matched, and counted."""

    def __post_init__(self):
        super().__post_init__()
        noise = self.noise
        if self.particles > 1 and isinstance(noise, MotionNoise) and not noise.sampled:
            expected = "1 with matching, whose noise is not sampled: it has one pose"
            raise DataError("SlamConfig", "particles", self.particles, expected)

    @classmethod
    def report(cls, sigma_v: float = sqrt(0.1), sigma_omega: float = sqrt(0.02)) -> SlamConfig:
        """Return the report's filter: 729 perturbations, +-log 4 clamped at twice that, N_eff <= N / 10, best particle.

        The report calls 0.02 a variance and sets it for its first data set; for its second it takes
        ``sigma_omega = sqrt(0.05)``. Both arguments are standard deviations in m/s and rad/s.
        """
        return cls(noise=ControlNoise(sigma_v, sigma_omega), predict_before_first_scan=True)

    @classmethod
    def refined(cls) -> SlamConfig:
        """Return the accurate filter: gentle clearing, likelihood field, motion prior, sub-cell step, weighted mean."""
        return cls(
            search=SearchConfig(
                yaw_step=0.01,
                cells=(4, 10),
                yaws=(4, 30),
                beam_stride=2,
                field="distance",
                prior=True,
                sub_cell=True,
                keep_offset=False,
                weight="likelihood",
            ),
            map=MapConfig(free=0.1 * LOG_4, clamp=5.0 * LOG_4),
            lines=LineConfig(),
            tilt=True,
            estimate="mean",
            resample_below=0.5,
            draw_metres=0.05,
            draw_radians=0.025,
            beam_spacing=0.02,
        )

    @classmethod
    def per_particle(cls) -> SlamConfig:
        """Return the refined filter with a map for each of thirty particles, drawn from that particle's own path."""
        return replace(cls.refined(), maps="per-particle", particles=30, draw_metres=0.2, draw_radians=0.1)

    @classmethod
    def matching(cls) -> SlamConfig:
        """Return scan matching without particles: one pose, predicted by odometry, then matched and aligned."""
        return replace(cls.refined(), particles=1, noise=MotionNoise(sampled=False))

    def robust(self, scatter: float = 0.0) -> SlamConfig:
        """Return the settings for a second look, where scans mislead: slower, made for people, glass and noisy ranges.

        With ``scatter`` (m), the standard deviation of the ranges, a beam must end farther behind a hit to have seen
        through it: four of them, which is three of the difference between two ranges. Above ``NOISY`` a line needs more
        hits: a few that scatter look like a line that is none. A setting that is not at its default was asked for, and
        stays. Methods without lines, or with a map for each particle, come back as they are.
        """
        if self.lines is None or self.maps == "per-particle":
            return self
        asked = {k: v for k, v in vars(self.lines).items() if v != getattr(LineConfig, k)}
        min_hits = 8 if scatter > NOISY else LineConfig.min_hits
        lines = replace(LineConfig(min_hits=min_hits, elongation=1.3, independent_beams=150.0), **asked)
        # The cap is the field's own: the few beams of a very coarse scanner scatter by metres.
        margin = min(max(OutlierConfig.margin, round(4.0 * scatter / self.map.resolution)), 100)
        outliers = self.outliers or OutlierConfig(margin=margin)
        return replace(self, lines=lines, outliers=outliers)

    def as_dict(self) -> dict:
        """Return all settings as plain nested dictionaries, for ``summary.json`` and tables."""
        return {name: value for name, value in plain(self).items() if name != "kind"}


PRESETS: dict[str, Callable[[], SlamConfig]] = {
    "report": SlamConfig.report,
    "refined": SlamConfig.refined,
    "per-particle": SlamConfig.per_particle,
    "matching": SlamConfig.matching,
}
"""The methods by name, as the command line and studies know them."""
