"""What is measured on: recordings, how much effort to spend, and a place in the middle of a drive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pfslam.bench.machine import Machine
from pfslam.config import SlamConfig
from pfslam.events import ScanEvent, scan_events
from pfslam.particles import Particles
from pfslam.recording import Recording
from pfslam.slam import SlamState, slam_step, start


@dataclass(frozen=True)
class Effort:
    """How long to measure: ``rounds`` of everything, ``run_rounds`` of whole runs and the part of a drive they take.

    ``sample`` poses are scored by the definition; ``scans`` lead to the place where single updates are measured.
    """

    rounds: int = 7
    run_rounds: int = 3
    seconds: float | None = None
    sample: int = 1000
    scans: int = 200
    particles: tuple[int, ...] = (5, 20, 50, 200, 1000, 5000, 10_000, 20_000)
    crowd_updates: int = 60
    image_pairs: int = 40
    maps_seconds: float | None = None
    """As ``seconds``, for a map per particle."""


QUICK = Effort(3, 1, 25.0, 150, 80, (5, 50, 200, 2000, 20_000), 15, 20, 14.0)


@dataclass(frozen=True, eq=False)
class Setting:
    """Recordings by name, the first of which serves wherever one is enough, and how much effort to spend."""

    recordings: dict[str, Recording]
    effort: Effort
    machine: Machine

    @property
    def recording(self) -> Recording:
        """The recording for single updates."""
        return next(iter(self.recordings.values()))


@dataclass(frozen=True, eq=False)
class Place:
    """The state of a run after some scans, the next scan, and the configuration."""

    state: SlamState
    event: ScanEvent
    config: SlamConfig

    def update(self, config: SlamConfig | None = None) -> SlamState:
        """The state after one whole update from here."""
        return slam_step(self.state, self.event, config or self.config, np.random.default_rng(0))[0]

    def with_crowd(self, n: int, sigma_xy: float = 0.02, sigma_yaw: float = 0.003, seed: int = 0) -> Place:
        """The same place with ``n`` particles spread around the estimate (m, rad)."""
        spread = np.random.default_rng(seed).standard_normal((n, 3)) * [sigma_xy, sigma_xy, sigma_yaw]
        cloud = Particles(self.state.estimate + spread, np.zeros(n))
        return replace(self, state=replace(self.state, particles=cloud))

    def with_stride(self, stride: int) -> Place:
        """The same place, with every so-many-th beam of the scan."""
        event = self.event
        thin = replace(event, points_b=event.points_b[::stride], beams=event.beams[::stride])
        return replace(self, event=thin)


def drive(recording: Recording, config: SlamConfig, scans: int) -> tuple[Place, Iterator[ScanEvent]]:
    """The place after ``scans`` updates with a few particles, and the events that follow it."""
    events, few = scan_events(recording, config)[0], replace(config, particles=min(config.particles, 20))
    rng = np.random.default_rng(0)
    state = start(next(events), few, rng)[0]
    for _ in range(scans):
        state = slam_step(state, next(events), few, rng)[0]
    place = Place(state, next(events), config)
    return place.with_crowd(config.particles), events
