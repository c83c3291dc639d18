"""A map for every particle: Rao-Blackwellised SLAM.

Given the path of a particle, its map is certain, so each particle carries its own (Grisetti, Stachniss and Burgard,
"Improved techniques for grid mapping with Rao-Blackwellized particle filters", 2007). A particle is then a whole small
SLAM run: one pose, one map drawn from that pose, and a weight that says how well its scans have fitted its own map.
Resampling copies whole histories: the first heir of a particle keeps its map, every other one gets a copy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pfslam.events import ScanEvent
from pfslam.grid import OccupancyGrid
from pfslam.particles import RESAMPLERS, Particles, effective_sample_size, reweight
from pfslam.slam import Belief, SlamConfig, Step, slam_step


@dataclass(frozen=True, eq=False)
class Histories:
    """N hypotheses: ``beliefs`` with one particle and one map each, and their normalised ``log_weights (N,)``."""

    beliefs: tuple[Belief, ...]
    log_weights: np.ndarray

    @classmethod
    def start(cls, config: SlamConfig) -> Histories:
        """Make the hypotheses before the first scan: all alike, sharing one empty map."""
        alike = (Belief.start(replace(config, particles=1)),) * config.particles
        return cls(alike, np.full(len(alike), -np.log(len(alike))))

    @property
    def particles(self) -> Particles:
        """The hypotheses' poses and weights."""
        return Particles(np.array([belief.estimate for belief in self.beliefs]), self.log_weights)

    @property
    def best(self) -> Belief:
        """The heaviest hypothesis, whose map is the run's map: maps cannot be averaged."""
        return self.beliefs[int(np.argmax(self.log_weights))]

    @property
    def grid(self) -> OccupancyGrid:
        """The map of the heaviest hypothesis."""
        return self.best.grid


def per_particle_step(
    histories: Histories, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[Histories, Step]:
    """Take one scan for every hypothesis by itself, weigh each by its fit to its own map, and resample histories."""
    # Until there is a map, the hypotheses do not differ: one step serves all, and each gets a copy of the map.
    if histories.best.map.is_empty:
        belief, step = slam_step(histories.best, event, config, rng)
        everyone = np.zeros(len(histories.beliefs), dtype=int)
        histories = Histories(heirs([belief], everyone), histories.log_weights)
        return histories, replace(step, particles=histories.particles)
    taken = [slam_step(belief, event, config, rng) for belief in histories.beliefs]
    beliefs, steps = [belief for belief, _ in taken], [step for _, step in taken]
    cloud = Particles(np.array([belief.estimate for belief in beliefs]), histories.log_weights)
    cloud, evidence = reweight(cloud, np.array([step.log_evidence for step in steps]))
    n_eff = effective_sample_size(cloud.weights)
    best = steps[int(np.argmax(cloud.log_weights))]
    step = replace(best, particles=cloud, effective_sample_size=n_eff, log_evidence=evidence)
    if n_eff > config.resample_below * len(beliefs):
        return Histories(tuple(beliefs), cloud.log_weights), step
    ancestors = RESAMPLERS[config.resampler](cloud.weights, rng)
    even = np.full(len(beliefs), -np.log(len(beliefs)))
    return Histories(heirs(beliefs, ancestors), even), replace(step, resampled=True)


def heirs(beliefs: list[Belief], ancestors: np.ndarray) -> tuple[Belief, ...]:
    """Return the beliefs with numbers ``ancestors (N,)``; no two of them share a map."""
    first = set(np.unique(ancestors, return_index=True)[1].tolist())
    chosen = [beliefs[k] for k in ancestors]
    return tuple(b if k in first else replace(b, map=b.map.copy()) for k, b in enumerate(chosen))
