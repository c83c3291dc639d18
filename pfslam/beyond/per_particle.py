"""A map for every particle: the Rao-Blackwellised particle filter GMapping.

Given the path of a particle, its map is certain, so each particle carries its own (Grisetti, Stachniss and Burgard,
"Improved techniques for grid mapping with Rao-Blackwellized particle filters", 2007). A particle is then a hypothesis:
a pose, a map drawn from the poses before it, and a weight that says how well its scans have fitted its own map.

Hypotheses with one map are a family, and are processed together: one search, one alignment. Where walls fix the pose in
every direction they are then at one pose, and go on as one hypothesis with the sum of their weights. Where walls leave
a direction open, each draws its own pose along it, and gets a map of its own when the next scan is drawn. So the cost
follows the number of hypotheses that differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, Any

import numpy as np

from pfslam.events import ScanEvent
from pfslam.particles import MAX_PARTICLES, RESAMPLERS, Particles, effective_sample_size, reweight
from pfslam.poses import average_pose, compose, wrap_angle
from pfslam.refined.events import RefinedEvent
from pfslam.refined.filling import filled
from pfslam.refined.lines import MAX_STEP
from pfslam.refined.map import Prior, RefinedMap
from pfslam.refined.noise import predicted
from pfslam.refined.step import RefinedBelief, RefinedConfig, RefinedStep, refined_step
from pfslam.settings import Range

Count = Annotated[int, Range(1, MAX_PARTICLES)]
Distance = Annotated[float, Range(0.0, inf)]


@dataclass(frozen=True)
class PerParticleConfig(RefinedConfig):
    """The settings of the accurate filter with a map for each particle, drawn from that particle's own path."""

    particles: Count = 30
    resample_below: Annotated[float, Range(0.0, 1.0)] = 0.5
    draw_metres: Distance = 0.2
    draw_radians: Distance = 0.1

    def start(self) -> Histories:  # type: ignore[override]
        """Make the hypotheses before the first scan: one family with an empty map."""
        family = Family.start(self)
        return Histories((family,), family)

    def step(self, belief: Any, event: Any, rng: np.random.Generator) -> tuple[Any, RefinedStep]:
        """Process one scan: ``per_particle_step``."""
        return per_particle_step(belief, event, self, rng)

    def robust(self, scatter: float = 0.0) -> PerParticleConfig:
        """Return the same settings: a second look is made for one map."""
        return self


@dataclass(frozen=True, eq=False)
class Family(RefinedBelief):
    """Hypotheses that share a map: ``particles`` are their poses, and their weights among one another.

    ``log_weight`` is that of them all. The estimate is their mean, noise and all: along a direction in which walls say
    nothing, a family of one stays where its own noise has led it.
    """

    log_weight: float = 0.0

    def predict(self, event: ScanEvent, config: RefinedConfig, rng: np.random.Generator) -> Prior:
        """Move every hypothesis by the motion of an event. With lines its noise waits for the scan: see ``spread``."""
        prior = super().predict(event, config, rng)
        particles = prior.particles
        if config.lines is not None:
            particles = Particles(compose(self.particles.poses, event.motion), self.particles.log_weights)
        pose = average_pose(particles.poses, particles.weights)
        return replace(prior, particles=particles, pose=pose)

    def each(self) -> list[Family]:
        """Return every hypothesis as a family of one."""
        return [
            replace(self, particles=Particles.at(pose, 1), estimate=pose, log_weight=self.log_weight + weight)
            for pose, weight in zip(self.particles.poses, self.particles.log_weights, strict=True)
        ]

    def spread(self, step: RefinedStep, noise: np.ndarray) -> Family | None:
        """Draw a pose for every hypothesis about the aligned one, given the motion's ``noise (N, 3)``.

        This is the improved proposal: a normal distribution that lines and odometry give together. Lines are sharp, so
        it has a width along the silent direction only, and there it is the motion's. A scan that was not matched
        leaves all of the noise.

        None if some were matched farther from the estimate than one step of the alignment leads: what is best for the
        family need not be best for each.
        """
        off, open_to_noise = self.particles.poses - self.estimate, np.zeros((3, 3))
        off[:, 2] = wrap_angle(off[:, 2])
        if not step.matched:
            open_to_noise = np.eye(3)
        elif step.silent_direction is not None:
            open_to_noise[:2, :2] = np.outer(step.silent_direction, step.silent_direction)
        if (np.abs(off - off @ open_to_noise) > MAX_STEP).any():
            return None
        poses = self.estimate + (off + noise) @ open_to_noise
        poses[:, 2] = wrap_angle(poses[:, 2])
        # At one pose they are one hypothesis: how its weight is shared out does not matter.
        log_weights = self.particles.log_weights if open_to_noise.any() else np.zeros(len(poses))
        particles = Particles(poses, log_weights)
        return replace(self, particles=particles, estimate=average_pose(poses, particles.weights))

    def drawing(self, event: RefinedEvent) -> Family:
        """Return the family with a scan drawn into a copy of the map, which others may share."""
        drawn = self.map.copy()
        drawn.draw(event, self.estimate, self.covariance)
        return replace(self, map=drawn)


@dataclass(frozen=True, eq=False)
class Histories:
    """All hypotheses, in families; ``best`` is the heaviest family before they were resampled.

    Its map is the run's map, because maps cannot be averaged.
    """

    families: tuple[Family, ...]
    best: Family

    @property
    def particles(self) -> Particles:
        """The hypotheses' poses and weights, family by family."""
        return Particles(
            np.vstack([family.particles.poses for family in self.families]),
            np.concatenate([family.log_weight + family.particles.log_weights for family in self.families]),
        )

    @property
    def map(self) -> RefinedMap:
        """The map of the heaviest family."""
        return self.best.map


def per_particle_step(
    histories: Histories, event: RefinedEvent, config: PerParticleConfig, rng: np.random.Generator
) -> tuple[Histories, RefinedStep]:
    """Take one scan for every family by itself, weigh each by its fit to its own map, and resample hypotheses."""
    if histories.best.map.is_empty:
        first: tuple[Any, RefinedStep] = refined_step(histories.best, event, config, rng)
        return Histories(first[:1], first[0]), first[1]
    taken = [pair for family in histories.families for pair in family_step(family, event, config, rng)]
    families, steps = [family for family, _ in taken], [step for _, step in taken]
    # GMapping's weights: each family's is multiplied by the mean likelihood of its samples.
    tops = Particles(np.array([f.estimate for f in families]), np.array([f.log_weight for f in families]))
    tops, evidence = reweight(tops, np.array([step.log_evidence for step in steps]))
    heaviest, drawn = int(np.argmax(tops.log_weights)), filled(event, config.beam_spacing)
    families = [
        replace(family.drawing(drawn) if step.drawn else family, log_weight=log_weight)
        for family, step, log_weight in zip(families, steps, tops.log_weights, strict=True)
    ]
    histories = Histories(tuple(families), families[heaviest])
    cloud = histories.particles
    n_eff = effective_sample_size(cloud.weights)
    step = replace(steps[heaviest], particles=cloud, effective_sample_size=n_eff, log_evidence=evidence)
    if n_eff <= config.resample_below * len(cloud):
        ancestors = RESAMPLERS[config.resampler](cloud.weights, rng)
        return replace(histories, families=survivors(families, ancestors)), replace(step, resampled=True)
    return histories, step


def family_step(
    family: Family, event: RefinedEvent, config: PerParticleConfig, rng: np.random.Generator
) -> list[tuple[Family, RefinedStep]]:
    """Take one scan for the hypotheses of one map, and leave the map as it is.

    If the scan is to be drawn, every pose gets a family of its own: their maps will differ.
    """
    undrawn = replace(config, draw_metres=inf, draw_radians=inf, resample_below=0.0)
    after: Any
    after, step = refined_step(family, event, undrawn, rng)
    if config.lines is not None and (step.aligned or not step.matched):
        noisy, _ = predicted(family.particles, event, config.noise, rng)
        spread = after.spread(step, noisy.poses - compose(family.particles.poses, event.motion))
        if spread is None:
            return [pair for one in family.each() for pair in family_step(one, event, config, rng)]
        after = spread
    draws = step.matched and after.map.has_moved(after.estimate, config.draw_metres, config.draw_radians)
    one_pose = (after.particles.poses == after.particles.poses[0]).all()
    odometry = compose(family.estimate, event.motion)
    return [
        (one, replace(step, estimate=one.estimate, departure=(one.estimate - odometry)[:2], drawn=draws))
        for one in (after.each() if draws and not one_pose else [after])
    ]


def survivors(families: Sequence[Family], ancestors: np.ndarray) -> tuple[Family, ...]:
    """Return the families of the hypotheses with numbers ``ancestors (N,)``, counted family by family."""
    ends = np.cumsum([len(family.particles) for family in families])
    owner, after = np.searchsorted(ends, ancestors, side="right"), []
    for k in np.unique(owner):
        own = ancestors[owner == k] - ends[k] + len(families[k].particles)
        particles = Particles(families[k].particles.poses[own], np.zeros(len(own)))
        estimate = average_pose(particles.poses, particles.weights)
        log_weight = float(np.log(len(own) / len(ancestors)))
        after.append(replace(families[k], particles=particles, estimate=estimate, log_weight=log_weight))
    return tuple(after)
