"""The accurate filter: one step, of the report's verbs in the report's order, with more in between.

Compare ``pfslam.slam.slam_step``. Added are the alignment of the estimate to the lines of the map, a gate for matches
that are not to be believed, coasting through scans that say nothing, and a covariance of the estimate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np

from pfslam.correlation import Perturbations
from pfslam.errors import DataError
from pfslam.events import ScanEvent
from pfslam.grid import LOG_4, MapConfig
from pfslam.particles import ControlNoise, Particles, effective_sample_size, resample, reweight
from pfslam.poses import average_pose, compose
from pfslam.recording import Recording
from pfslam.refined.covariance import predicted_covariance
from pfslam.refined.events import LevelledScans, RefinedEvent
from pfslam.refined.filling import filled
from pfslam.refined.lines import LineConfig
from pfslam.refined.map import Prior, RefinedMap
from pfslam.refined.matching import SearchConfig
from pfslam.refined.noise import MotionNoise, predicted, shifted
from pfslam.refined.outliers import NOISY, OutlierConfig
from pfslam.refined.record import RefinedStep
from pfslam.refined.run import RefinedResult, refined_run
from pfslam.run import Once, SlamResult
from pfslam.settings import Range, changed
from pfslam.slam import Belief, SlamConfig, best_particle


def refined_step(
    belief: RefinedBelief, event: RefinedEvent, config: RefinedConfig, rng: np.random.Generator
) -> tuple[RefinedBelief, RefinedStep]:
    """Process one scan: predict, match, reweight, align, resample, draw. The belief's map is written in place."""
    if belief.map.is_empty:
        return begin(belief, event, config, rng)
    # Eq. 11: every particle moves by its own noisy motion, weights unchanged.
    prior = belief.predict(event, config, rng)
    if len(event.points_b) < config.min_beams:
        return belief.coast(event, prior, config.estimate)
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
    particles = particles if fix.pose is pose else shifted(particles, fix.pose - pose)
    # Eq. 13: resample where few particles carry the weight.
    n_eff = effective_sample_size(particles.weights)
    step = RefinedStep.matched_scan(event, prior, match, particles, n_eff, log_evidence, fix, belief.map)
    if n_eff <= config.resample_below * len(particles):
        particles, step = resample(particles, rng, config.resampler), replace(step, resampled=True)
    # Eq. 14, 15: draw the scan, if the robot has moved since the last one drawn.
    if belief.map.has_moved(fix.pose, config.draw_metres, config.draw_radians):
        belief.map.draw(event, fix.pose, fix.covariance)
        step = replace(step, drawn=True)
    # The scan has fixed the pose, so the uncertainty of the motion starts again from zero.
    fixed = {"particles": particles, "variance": np.zeros(2), "covariance": fix.covariance}
    return belief.after(prior, fix.pose, **fixed), step


@dataclass(frozen=True, eq=False)
class RefinedBelief(Belief):
    """All that the next step needs: the report's belief, and how sure it is.

    ``variance (2,)`` is that of the motion (m^2, rad^2) since a scan was last matched. ``covariance (3, 3)`` is that of
    the estimate without this ``variance``; it needs lines, and is None without. ``corrected (2,)`` is how far (m) scans
    have moved the estimate from its odometry, over about the last metre.
    """

    map: RefinedMap
    variance: np.ndarray = field(default_factory=lambda: np.zeros(2))
    covariance: np.ndarray | None = None
    corrected: np.ndarray = field(default_factory=lambda: np.zeros(2))

    @classmethod
    def start(cls, config: RefinedConfig) -> Self:
        """Make the belief before the first scan: all particles at the origin, and an empty map."""
        empty = RefinedMap(config.map, None, config.lines, config.outliers)
        covariance = None if config.lines is None else np.zeros((3, 3))
        particles = Particles.at(np.zeros(3), config.particles)
        return cls(particles, np.zeros(3), empty, covariance=covariance)

    def predict(self, event: ScanEvent, config: RefinedConfig, rng: np.random.Generator) -> Prior:
        """Move the cloud and the estimate by the motion of an event."""
        particles, variance = predicted(self.particles, event, config.noise, rng)
        pose = compose(self.estimate, event.motion)
        variance = self.variance + variance
        return Prior(particles, pose, variance, self.estimate, self.covariance, self.corrected)

    def coast(
        self, event: RefinedEvent, prior: Prior, estimate: str = "mean", rejected: bool = False
    ) -> tuple[RefinedBelief, RefinedStep]:
        """Go on by odometry alone, where a scan has too few beams or its match is rejected.

        The mean of the cloud is then where odometry led; the "best" particle keeps the noise of its own.
        """
        pose = best_particle(prior.particles) if estimate == "best" else prior.pose
        inherited = self.covariance
        if inherited is not None:
            inherited = predicted_covariance(inherited, self.estimate, pose, np.zeros(2))
        step = RefinedStep.coasted(event, pose, prior.particles, prior.covariance(pose), rejected=rejected)
        state = {"particles": prior.particles, "variance": prior.variance, "covariance": inherited}
        return self.after(prior, pose, **state), step

    def after(self, prior: Prior, pose: np.ndarray, **state: Any) -> Self:
        """Return the belief after a scan that left the estimate at ``pose (3,)``, with what else has changed."""
        return replace(self, estimate=pose, corrected=prior.corrected_by(pose), **state)


def begin(
    belief: RefinedBelief, event: RefinedEvent, config: RefinedConfig, rng: np.random.Generator
) -> tuple[RefinedBelief, RefinedStep]:
    """Process a scan while there is no map: draw it where the robot is taken to be, unless it has too few beams.

    The map begins at that pose, so no particle can be wrong about its place in it: all stand at the odometry's pose.
    With ``predict_before_first_scan`` the first scan is predicted like any other, as in the report.
    """
    seen = len(event.points_b) >= config.min_beams
    event = filled(event, config.beam_spacing)
    if config.predict_before_first_scan:
        particles, _ = predicted(belief.particles, event, config.noise, rng)
        pose = estimate_pose(particles, config.estimate)
    else:
        pose = compose(belief.estimate, event.motion)
        particles = Particles.at(pose, len(belief.particles))
    if seen:
        belief.map.draw(event, pose, belief.covariance)
    step = RefinedStep.coasted(event, pose, particles, belief.covariance, drawn=seen)
    return replace(belief, particles=particles, estimate=pose), step


def estimate_pose(particles: Particles, estimate: str) -> np.ndarray:
    """Choose one pose ``(3,)`` for the whole cloud: the particle of greatest weight ("best"), or the weighted mean."""
    if estimate == "best":
        return best_particle(particles)
    return average_pose(particles.poses, particles.weights)


@dataclass(frozen=True)
class RefinedConfig(SlamConfig):
    """Collect all settings of the accurate filter, in SI units; sigmas are standard deviations.

    The defaults are the method "refined". Other settings switch single ingredients off, down to the report's filter,
    which ``RefinedConfig.of(SlamConfig.report())`` is: the same numbers with more that can be changed.

    >>> from dataclasses import replace
    >>> few = replace(RefinedConfig(), particles=20)
    >>> few.particles, few.estimate
    (20, 'mean')
    """

    result: ClassVar[type[SlamResult]] = RefinedResult
    noise: ControlNoise | MotionNoise = field(default_factory=MotionNoise)  # type: ignore[assignment]
    """White noise on every control sample (Eq. 11), or noise on the motion between two scans."""
    search: SearchConfig | Perturbations = field(default_factory=SearchConfig)  # type: ignore[assignment]
    """The search for the mode of likelihood times prior, or the report's for the greatest count."""
    map: MapConfig = field(default_factory=lambda: MapConfig(free=0.1 * LOG_4))
    lines: LineConfig | None = field(default_factory=LineConfig)
    """Alignment of the estimate to the map's lines; ``None`` leaves it out."""
    outliers: OutlierConfig | None = None
    """How to live with people and glass; ``None`` takes everything that a beam meets for a wall."""
    tilt: bool = True
    """Whether the body's lean is taken into account; if not, every floor is taken to be flat."""
    estimate: Literal["best", "mean"] = "mean"
    """"best": the particle of greatest weight. "mean": the weighted mean of all."""
    draw_metres: Annotated[float, Range(0.0, inf)] = 0.05
    draw_radians: Annotated[float, Range(0.0, inf)] = 0.025
    """The scan is drawn into the map after moving or turning by at least so much since the last one; inf: never."""
    beam_spacing: Annotated[float, Range(0.0, inf)] = 0.02
    """Where neighbouring beams are more than this (rad) apart, the wall between them is filled in; 0: nowhere."""
    min_beams: Annotated[int, Range(1, 10**6)] = 10
    """Scans with fewer valid beams are predicted through, not matched, and counted."""
    predict_before_first_scan: bool = False
    """Whether the run begins at the odometry's first stamp, as the report's does, and not at the first scan."""

    def __post_init__(self):
        super().__post_init__()
        noise = self.noise
        if self.particles > 1 and isinstance(noise, MotionNoise) and not noise.sampled:
            expected = "1 with matching, whose noise is not sampled: it has one pose"
            raise DataError(type(self).__name__, "particles", self.particles, expected)

    @classmethod
    def of(cls, config: SlamConfig) -> RefinedConfig:
        """Return settings of the accurate filter with which it is the report's, to the last bit.

        This holds where scans need no levelling: neither a sweep nor jumps of the odometry concern the report.
        """
        if isinstance(config, RefinedConfig):
            return config
        return RefinedConfig(
            **vars(config),
            lines=None,
            tilt=False,
            estimate="best",
            draw_metres=0.0,
            draw_radians=0.0,
            beam_spacing=0.0,
            min_beams=1,
            predict_before_first_scan=True,
        )

    @staticmethod
    def matching() -> RefinedConfig:
        """Return scan matching without particles: one pose, predicted by odometry, then matched and aligned."""
        return RefinedConfig(particles=1, noise=MotionNoise(sampled=False))

    def robust(self, scatter: float = 0.0) -> RefinedConfig:
        """Return the settings for a second look, where scans mislead: slower, made for people, glass and noisy ranges.

        With ``scatter`` (m), the standard deviation of the ranges, a beam must end farther behind a hit to have seen
        through it: four of them, which is three of the difference between two ranges. Above ``NOISY`` a line needs more
        hits: a few that scatter look like a line that is none. A setting that is not at its default was asked for, and
        stays. Methods without lines come back as they are.
        """
        if self.lines is None:
            return self
        asked = {k: v for k, v in vars(self.lines).items() if v != getattr(LineConfig, k)}
        min_hits = 8 if scatter > NOISY else LineConfig.min_hits
        lines = replace(LineConfig(min_hits=min_hits, elongation=1.3, independent_beams=150.0), **asked)
        # The cap is the field's own: the few beams of a very coarse scanner scatter by metres.
        margin = min(max(OutlierConfig.margin, round(4.0 * scatter / self.map.resolution)), 100)
        return replace(self, lines=lines, outliers=self.outliers or OutlierConfig(margin=margin))

    def used_scans(self, recording: Recording) -> LevelledScans:
        """Choose the scans of a recording that a run uses, and make them level."""
        return LevelledScans.of(recording, self.every, self.tilt, self.predict_before_first_scan)

    def start(self) -> RefinedBelief:
        """Make the belief before the first scan."""
        return RefinedBelief.start(self)

    def step(self, belief: Any, event: Any, rng: np.random.Generator) -> tuple[RefinedBelief, RefinedStep]:
        """Process one scan: ``refined_step``."""
        return refined_step(belief, event, self, rng)

    def look(self, recording: Recording, once: Once, rng: np.random.Generator) -> RefinedResult:
        """Run over a whole recording, with a second look where scans have misled the first: ``refined_run``."""
        return refined_run(recording, self, once, rng)


def with_changes(config: SlamConfig, changes: Mapping[str, Any], source: object, prefix: str = "") -> Any:
    """Return settings with some values replaced, as ``settings.changed`` does.

    Where the report's settings do not have what is asked for, they become those of the accurate filter, which have.
    """
    if type(config) is SlamConfig:
        try:
            return changed(config, changes, source, prefix)
        except DataError:
            config = RefinedConfig.of(config)
    return changed(config, changes, source, prefix)
