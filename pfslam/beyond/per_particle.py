"""A map for every particle: Rao-Blackwellised SLAM.

Given the path of a particle, its map is certain, so each particle carries its own (Grisetti, Stachniss and Burgard,
"Improved techniques for grid mapping with Rao-Blackwellized particle filters", 2007). A particle is then a whole small
SLAM run: one pose, one map drawn from that pose, and a weight that says how well its scans have fitted its own map.
Resampling copies whole histories. Copies share their arrays until they differ: no step changes an array in place, each
makes a new one for the map that it draws into.

Thirty maps fill memory, twice over while a step makes new ones from old. Score field and hit moments are zero in most
cells, so a history at rest keeps only the others, and is laid out in full while it is worked on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pfslam.config import SlamConfig
from pfslam.events import ScanEvent
from pfslam.grid import OccupancyGrid
from pfslam.particles import RESAMPLERS, Particles, effective_sample_size, reweight
from pfslam.slam import SlamState, StepInfo, slam_step


@dataclass(frozen=True, eq=False)
class Sparse:
    """An array kept as its cells that are not zero: ``index (n,)`` into the flat array and their ``values (n,)``."""

    shape: tuple[int, ...]
    index: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, array: np.ndarray) -> Sparse:
        index = np.flatnonzero(array)
        return cls(array.shape, index.astype(np.uint32), array.ravel()[index])

    def full(self) -> np.ndarray:
        array = np.zeros(self.shape, dtype=self.values.dtype)
        array.ravel()[self.index] = self.values
        return array


EMPTY = np.zeros((0, 0))
"""Stands in a state at rest for the arrays that are kept apart."""


@dataclass(frozen=True, eq=False)
class History:
    """One hypothesis at rest: a state of the filter with one particle, its score field and hit slots kept apart."""

    state: SlamState
    field: Sparse
    slots: Sparse

    @classmethod
    def of(cls, state: SlamState) -> History:
        field, moments = replace(state.field, values=EMPTY), replace(state.moments, slots=EMPTY)
        bare = replace(state, field=field, moments=moments)
        return cls(bare, Sparse.of(state.field.values), Sparse.of(state.moments.slots))

    @property
    def estimate(self) -> np.ndarray:
        return self.state.estimate

    @property
    def grid(self) -> OccupancyGrid:
        return self.state.grid

    def opened(self) -> SlamState:
        """Return the state in full, as ``slam_step`` needs it: the same numbers."""
        field = replace(self.state.field, values=self.field.full())
        moments = replace(self.state.moments, slots=self.slots.full())
        return replace(self.state, field=field, moments=moments)

    def after(
        self, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
    ) -> tuple[History, StepInfo]:
        """Take one scan; if nothing was drawn, the history keeps the arrays that it may share with others."""
        state, info = slam_step(self.opened(), event, config, rng)
        if info.drawn:
            return History.of(state), info
        return replace(self, state=replace(state, field=self.state.field, moments=self.state.moments)), info


@dataclass(frozen=True, eq=False)
class Histories:
    """N hypotheses: ``states`` with one particle and one map each, and their normalised ``log_weights (N,)``."""

    states: tuple[History, ...]
    log_weights: np.ndarray

    @classmethod
    def start(cls, config: SlamConfig) -> Histories:
        """Make the hypotheses before the first scan: all alike, sharing one empty map."""
        alike = (History.of(SlamState.start(replace(config, particles=1))),) * config.particles
        return cls(alike, np.full(len(alike), -np.log(len(alike))))

    @property
    def particles(self) -> Particles:
        """The hypotheses' poses and weights."""
        return Particles(np.array([state.estimate for state in self.states]), self.log_weights)

    @property
    def best(self) -> History:
        """The heaviest hypothesis, whose map is the run's map: maps cannot be averaged."""
        return self.states[int(np.argmax(self.log_weights))]

    @property
    def grid(self) -> OccupancyGrid:
        return self.best.grid


def per_particle_step(
    histories: Histories, event: ScanEvent, config: SlamConfig, rng: np.random.Generator
) -> tuple[Histories, StepInfo]:
    """Take one scan for every hypothesis by itself, weigh each by its fit to its own map, and resample histories."""
    # Until there is a map, the hypotheses do not differ, and share what they have.
    if histories.best.state.drawn_at is None:
        state, info = histories.best.after(event, config, rng)
        histories = replace(histories, states=(state,) * len(histories.states))
        return histories, replace(info, particles=histories.particles)
    steps = [state.after(event, config, rng) for state in histories.states]
    states, infos = tuple(state for state, _ in steps), [info for _, info in steps]
    poses = np.array([state.estimate for state in states])
    cloud = Particles(poses, histories.log_weights)
    cloud, evidence = reweight(cloud, np.array([info.log_evidence for info in infos]))
    histories = Histories(states, cloud.log_weights)
    best = infos[int(np.argmax(cloud.log_weights))]
    n_eff = effective_sample_size(cloud.weights)
    info = replace(
        best,
        particles=cloud,
        effective_sample_size=n_eff,
        log_evidence=evidence,
    )
    if n_eff <= config.resample_below * len(states):
        ancestors = RESAMPLERS[config.resampler](cloud.weights, rng)
        even = np.full(len(states), -np.log(len(states)))
        histories = Histories(tuple(states[k] for k in ancestors), even)
        info = replace(info, resampled=True)
    return histories, info
