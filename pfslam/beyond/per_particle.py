"""A map for every particle: Rao-Blackwellised SLAM.

Given the path of a particle, its map is certain, so each particle carries its own (Grisetti, Stachniss and Burgard,
"Improved techniques for grid mapping with Rao-Blackwellized particle filters", 2007). A particle is then a whole small
SLAM run: one pose, one map drawn from that pose, and a weight that says how well its scans have fitted its own map.
Resampling copies whole histories: the first heir of a particle keeps its map, every other one gets a copy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from math import inf
from typing import Annotated, Any

import numpy as np

from pfslam.events import ScanEvent
from pfslam.grid import OccupancyGrid
from pfslam.particles import MAX_PARTICLES, RESAMPLERS, Particles, effective_sample_size, reweight
from pfslam.poses import compose
from pfslam.refined.events import RefinedEvent
from pfslam.refined.filling import filled
from pfslam.refined.map import Prior, RefinedMap
from pfslam.refined.step import RefinedBelief, RefinedConfig, RefinedStep, refined_step
from pfslam.settings import Range

Count = Annotated[int, Range(1, MAX_PARTICLES)]
Distance = Annotated[float, Range(0.0, inf)]


@dataclass(frozen=True)
class PerParticleConfig(RefinedConfig):
    """The settings of the accurate filter with a map for each particle, drawn from that particle's own path."""

    particles: Count = 30
    draw_metres: Distance = 0.2
    draw_radians: Distance = 0.1

    def start(self) -> Histories:  # type: ignore[override]
        """Make the hypotheses before the first scan."""
        return Histories.start(self)

    def step(self, belief: Any, event: Any, rng: np.random.Generator) -> tuple[Any, RefinedStep]:
        """Process one scan: ``per_particle_step``."""
        return per_particle_step(belief, event, self, rng)

    def robust(self, scatter: float = 0.0) -> PerParticleConfig:
        """Return the same settings: a second look is made for one map."""
        return self


@dataclass(frozen=True, eq=False)
class Hypothesis(RefinedBelief):
    """One particle with its own map. What odometry says of it is its own prediction, noise and all.

    Along a direction in which walls say nothing, and where there are no scans, the hypotheses therefore differ.
    """

    def predict(self, event: ScanEvent, config: RefinedConfig, rng: np.random.Generator) -> Prior:
        """Move the particle by the motion of an event, with noise of its own."""
        prior = super().predict(event, config, rng)
        return replace(prior, pose=prior.particles.poses[0])


@dataclass(frozen=True, eq=False)
class Histories:
    """N hypotheses, their normalised ``log_weights (N,)``, and the heaviest of them before they were resampled.

    The map of ``best`` is the run's map, because maps cannot be averaged.
    """

    beliefs: tuple[RefinedBelief, ...]
    log_weights: np.ndarray
    best: RefinedBelief

    @classmethod
    def start(cls, config: PerParticleConfig) -> Histories:
        """Make the hypotheses before the first scan: all alike, sharing one empty map."""
        one = Hypothesis.start(replace(config, particles=1))
        return cls((one,) * config.particles, np.full(config.particles, -np.log(config.particles)), one)

    @property
    def particles(self) -> Particles:
        """The hypotheses' poses and weights."""
        return Particles(np.array([belief.estimate for belief in self.beliefs]), self.log_weights)

    @property
    def map(self) -> RefinedMap:
        """The map of the heaviest hypothesis."""
        return self.best.map

    @property
    def grid(self) -> OccupancyGrid:
        """The occupancy grid of that map."""
        return self.map.grid


def per_particle_step(
    histories: Histories, event: RefinedEvent, config: PerParticleConfig, rng: np.random.Generator
) -> tuple[Histories, RefinedStep]:
    """Take one scan for every hypothesis by itself, weigh each by its fit to its own map, and resample histories."""
    # Until there is a map, the hypotheses do not differ: one step serves all, and each gets a copy of the map.
    if histories.best.map.is_empty:
        belief, step = refined_step(histories.best, event, config, rng)
        everyone = np.zeros(len(histories.beliefs), dtype=int)
        histories = Histories(offspring([belief], everyone), histories.log_weights, belief)
        return histories, replace(step, particles=histories.particles)
    undrawn = replace(config, particles=1, draw_metres=inf, draw_radians=inf)
    taken = [refined_step(belief, event, undrawn, rng) for belief in histories.beliefs]
    beliefs, steps = [belief for belief, _ in taken], [step for _, step in taken]
    cloud = Particles(np.array([belief.estimate for belief in beliefs]), histories.log_weights)
    cloud, evidence = reweight(cloud, np.array([step.log_evidence for step in steps]))
    n_eff, heaviest = effective_sample_size(cloud.weights), int(np.argmax(cloud.log_weights))
    odometry = compose(histories.beliefs[heaviest].estimate, event.motion)
    few, ancestors, log_weights = n_eff <= config.resample_below * len(beliefs), None, cloud.log_weights
    if few:
        ancestors = RESAMPLERS[config.resampler](cloud.weights, rng)
        log_weights = np.full(len(beliefs), -np.log(len(beliefs)))
    # Maps are written when all else is done, so that an error leaves every one as it was.
    drawn = draw_each(beliefs, steps, event, config)
    step = replace(
        steps[heaviest],
        particles=cloud,
        effective_sample_size=n_eff,
        log_evidence=evidence,
        departure=cloud.poses[heaviest, :2] - odometry[:2],
        resampled=few,
        drawn=drawn[heaviest],
    )
    after = tuple(beliefs) if ancestors is None else offspring(beliefs, ancestors)
    return Histories(after, log_weights, beliefs[heaviest]), step


def draw_each(
    beliefs: Sequence[RefinedBelief],
    steps: Sequence[RefinedStep],
    event: RefinedEvent,
    config: PerParticleConfig,
) -> list[bool]:
    """Draw a scan into the map of every hypothesis that has moved enough, or into none; return who has drawn."""
    event = filled(event, config.beam_spacing)
    moved = [
        step.matched and belief.map.has_moved(belief.estimate, config.draw_metres, config.draw_radians)
        for belief, step in zip(beliefs, steps, strict=True)
    ]
    for belief in compress(beliefs, moved):
        belief.map.check_room(event, belief.estimate)
    for belief in compress(beliefs, moved):
        belief.map.draw(event, belief.estimate, belief.covariance)
    return moved


def offspring(beliefs: Sequence[RefinedBelief], ancestors: np.ndarray) -> tuple[RefinedBelief, ...]:
    """Return the beliefs with numbers ``ancestors (N,)``; no two of them share a map."""
    first = set(np.unique(ancestors, return_index=True)[1].tolist())
    chosen = [beliefs[k] for k in ancestors]
    return tuple(b if k in first else replace(b, map=b.map.copy()) for k, b in enumerate(chosen))
