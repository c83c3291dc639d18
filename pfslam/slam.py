"""The report's filter: one step, what it carries on, what it tells, and its settings.

``slam_step`` is the algorithm of the report, one line for each of its steps, with the numbers of its equations. The
belief is what the next step needs; a ``Step`` is what plots and verdicts need. The accurate filter has a step of its
own, of the same verbs in the same order: ``pfslam.refined.step``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import Annotated, Any, ClassVar

import numpy as np

from pfslam.correlation import Match, Perturbations, best_perturbations
from pfslam.events import ScanEvent, UsedScans
from pfslam.grid import MapConfig, OccupancyGrid
from pfslam.map import Map
from pfslam.methods import preset
from pfslam.particles import (
    MAX_PARTICLES,
    ControlNoise,
    Particles,
    Scheme,
    effective_sample_size,
    predict,
    resample,
    reweight,
)
from pfslam.recording import Recording
from pfslam.run import Once, SlamResult
from pfslam.settings import Range, Settings, plain

MAX_EVERY = 10**6
Every = Annotated[int, Range(1, MAX_EVERY)] | None


def slam_step(
    belief: Belief, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[Belief, Step]:
    """Process one scan: predict, match, reweight, resample, draw. The belief's map is written in place."""
    # Eq. 11: every particle is driven by its own noisy controls, weights unchanged.
    particles = belief.particles
    for v, omega, dt in zip(*event.controls, strict=True):
        particles = predict(particles, v, omega, dt, config.noise, rng)
    # Eq. 6, 8, 9: each moves to its best perturbation. The first scan has no map yet to be compared with.
    points_b = event.points_b[:0] if belief.map.is_empty else event.points_b
    match = best_perturbations(belief.map.grid, points_b, particles, config.search, rng)
    # Eq. 12: weights multiply by the count there, and are normalised.
    particles, log_evidence = reweight(match.particles, match.log_likelihood)
    pose = best_particle(particles)
    # Eq. 13: resample where few particles carry the weight; a scan that says nothing has changed none.
    n_eff = effective_sample_size(particles.weights)
    few = match.beams > 0 and n_eff <= config.resample_below * len(particles)
    step = Step.of(event, match, particles, pose, n_eff, few, log_evidence)
    if few:
        particles = resample(particles, rng, config.resampler)
    # Eq. 14, 15: draw the scan, seen from the best particle.
    belief.map.draw(event, pose)
    return Belief(particles, pose, belief.map), step


@dataclass(frozen=True, eq=False)
class Belief:
    """All that the next step needs: the cloud, its best pose, and the map, which the run owns and writes in place."""

    particles: Particles
    estimate: np.ndarray
    map: Map

    @property
    def grid(self) -> OccupancyGrid:
        """The map's occupancy grid."""
        return self.map.grid


def best_particle(particles: Particles) -> np.ndarray:
    """Return the pose ``(3,)`` of the particle of greatest weight, the first of several."""
    return particles.poses[np.argmax(particles.log_weights)].copy()


@dataclass(frozen=True, eq=False)
class Step:
    """What happened in one step.

    ``particles`` is the cloud that gave the ``estimate (3,)``, before resampling (None where it was not kept);
    ``beams`` how many beams returned, and ``score`` the share of them that the particles found on walls, from 0 to 1.
    ``log_evidence`` says how well the whole cloud fits the scan: what normalising Eq. 12 divides by. ``matched`` is
    False where there was nothing to compare, ``scored`` where no particle found anything.
    """

    t: float
    estimate: np.ndarray
    particles: Particles | None
    effective_sample_size: float
    beams: int
    matched: bool = False
    scored: bool = False
    resampled: bool = False
    drawn: bool = False
    score: float = 0.0
    log_evidence: float = 0.0

    @classmethod
    def of(
        cls,
        event: ScanEvent,
        match: Match,
        particles: Particles,
        pose: np.ndarray,
        n_eff: float,
        resampled: bool,
        log_evidence: float,
    ) -> Step:
        """Describe a step of the report's filter."""
        return cls(
            event.t,
            pose,
            particles,
            n_eff,
            len(event.beams),
            matched=match.beams > 0,
            scored=log_evidence > -np.inf,
            resampled=resampled,
            drawn=len(event.beams) > 0,
            score=float(particles.weights @ match.score),
            log_evidence=log_evidence,
        )


@dataclass(frozen=True)
class SlamConfig(Settings):
    """Collect the settings of the report's filter, in SI units; sigmas are standard deviations.

    >>> from dataclasses import replace
    >>> few = replace(SlamConfig.report(), particles=20)
    >>> few.particles, few.search.cells
    (20, 4)
    """

    result: ClassVar[type[SlamResult]] = SlamResult
    particles: Annotated[int, Range(1, MAX_PARTICLES)] = 200
    every: Every = None
    """Every how-many-th scan is used; None takes the recording's own default."""
    noise: ControlNoise = field(default_factory=ControlNoise)
    """Noise on every control sample (Eq. 11)."""
    search: Perturbations = field(default_factory=Perturbations)
    map: MapConfig = field(default_factory=MapConfig)
    resample_below: Annotated[float, Range(0.0, 1.0)] = 0.1
    """Resample when N_eff is at most this share of N."""
    resampler: Scheme = "systematic"

    @classmethod
    def report(cls, sigma_v: float = sqrt(0.1), sigma_omega: float = sqrt(0.02)) -> SlamConfig:
        """Return the report's filter: 729 perturbations, +-log 4 clamped at twice that, N_eff <= N / 10, best particle.

        The report calls 0.02 a variance and sets it for its first data set; for its second it takes
        ``sigma_omega = sqrt(0.05)``. Both arguments are standard deviations in m/s and rad/s.
        """
        return SlamConfig(noise=ControlNoise(sigma_v, sigma_omega))

    @staticmethod
    def refined() -> Any:
        """Return the settings of the accurate filter, a ``pfslam.refined.step.RefinedConfig``."""
        return preset("refined")

    @staticmethod
    def matching() -> Any:
        """Return those of scan matching without particles, a ``pfslam.refined.step.RefinedConfig``."""
        return preset("matching")

    @staticmethod
    def per_particle() -> Any:
        """Return those of a map for each particle, a ``pfslam.beyond.per_particle.PerParticleConfig``."""
        return preset("per-particle")

    def as_dict(self) -> dict[str, Any]:
        """Return all settings as plain nested dictionaries, for ``summary.json`` and tables."""
        return {name: value for name, value in plain(self).items() if name != "kind"}

    def used_scans(self, recording: Recording) -> UsedScans:
        """Choose the scans of a recording that a run uses."""
        return UsedScans.of(recording, self.every)

    def start(self) -> Belief:
        """Make the belief before the first scan: all particles at the origin, and an empty map."""
        return Belief(Particles.at(np.zeros(3), self.particles), np.zeros(3), Map(self.map))

    def step(self, belief: Belief, event: ScanEvent, rng: np.random.Generator) -> tuple[Belief, Step]:
        """Process one scan: ``slam_step``."""
        return slam_step(belief, event, self, rng)

    def look(self, recording: Recording, once: Once, rng: np.random.Generator) -> Any:
        """Run ``once`` over a whole recording: the report's filter never does it again."""
        return once(self, rng)
