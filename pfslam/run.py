"""A whole run: which kind of filter, scan after scan, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from pfslam.beyond.per_particle import Histories, per_particle_step
from pfslam.config import NOISY, SlamConfig
from pfslam.errors import DataError
from pfslam.events import Drive, ScanEvent
from pfslam.grid import OccupancyGrid
from pfslam.particles import Particles
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.refined.health import Distrust, distrust, in_doubt, misled
from pfslam.slam import SlamState, StepInfo, slam_step


class State(Protocol):
    """What the states of all filters have in common: particles, and a map."""

    @property
    def particles(self) -> Particles: ...

    @property
    def grid(self) -> OccupancyGrid: ...


class Filter(NamedTuple):
    """A kind of filter: ``start(config)`` gives its first state, ``step`` takes it from one scan to the next."""

    start: Callable[[SlamConfig], Any]
    step: Callable[[Any, ScanEvent, SlamConfig, np.random.Generator], tuple[Any, StepInfo]]


FILTERS = {
    "shared": Filter(SlamState.start, slam_step),
    "per-particle": Filter(Histories.start, per_particle_step),
}
"""By ``SlamConfig.maps``. Scan matching is the shared map with one particle."""


@dataclass(frozen=True, eq=False)
class SlamResult:
    """A finished run: the estimate as it was at each used scan (never revised), the map, one info per step.

    ``config`` is that of the run that stands: the careful one after a second look (see ``run_slam``).
    """

    trajectory: Trajectory
    grid: OccupancyGrid
    infos: tuple[StepInfo, ...]
    dropped: dict[str, int]
    config: SlamConfig

    @property
    def updates(self) -> int:
        """Scans that were matched against the map."""
        return sum(info.matched for info in self.infos)

    @property
    def resamplings(self) -> int:
        return sum(info.resampled for info in self.infos)

    @property
    def distrust(self) -> list[Distrust]:
        """The stretches whose estimate is not to be trusted, each ``{"from", "to", "reason"}``; none on a sound run."""
        return distrust(self.infos)

    @property
    def covariances(self) -> np.ndarray | None:
        """The covariances ``(K, 3, 3)`` of the trajectory's poses, as in ``StepInfo``; None without a polish."""
        found = [info.covariance for info in self.infos if info.covariance is not None]
        return np.array(found) if len(found) == len(self.infos) else None


def slam_steps(
    recording: Recording, config: SlamConfig, rng: np.random.Generator
) -> Iterator[tuple[State, StepInfo]]:
    """Yield (state, info) for each used scan of a run: for animations and for long drives."""
    return _steps(Drive.of(recording, config), config, rng)


def _steps(drive: Drive, config: SlamConfig, rng: np.random.Generator) -> Iterator[tuple[State, StepInfo]]:
    start, step = FILTERS[config.maps]
    state = start(config)
    for event in drive.events():
        try:
            state, info = step(state, event, config, rng)
        except DataError as error:
            where = f"{drive.recording.name}, scan at {event.t:.3f} s, {error.source}"
            raise DataError(where, error.field, error.found, error.expected) from error
        yield state, info


def run_slam(
    recording: Recording,
    config: SlamConfig | None = None,
    *,
    rng: np.random.Generator | None = None,
    progress: Callable | None = None,
    keep_particles: bool = True,
    second_look: bool = True,
) -> SlamResult:
    """Estimate the trajectory and the map of a recording.

    ``config=None`` is ``SlamConfig.refined()``; ``rng=None`` is seed 0. ``progress(iterable, total=n)`` may wrap the
    loop, as tqdm does. Without ``keep_particles`` the infos hold no clouds, which saves memory on long runs.

    A run whose scans have misled it (``trust.misled``), or whose ranges scatter by more than ``NOISY``, is done again
    with ``config.careful()``, if that differs. The second run stands, unless more of it is in doubt and the ranges are
    not noisy; the result's ``config`` tells. Without ``second_look`` the first run stands, whatever happened.
    """
    config = SlamConfig.refined() if config is None else config
    rng = np.random.default_rng(0) if rng is None else rng
    result = _one_run(recording, config, rng, progress, keep_particles)
    careful = config.careful(recording.range_scatter())
    if second_look and careful != config and in_need_of_care(recording, result):
        second = _one_run(recording, careful, rng, progress, keep_particles)
        return that_stands(recording, result, second)
    return result


def in_need_of_care(recording: Recording, result: SlamResult) -> bool:
    """Tell whether a run is to be done again with care: its ranges are noisy, or its scans have misled it."""
    return recording.range_scatter() > NOISY or misled(result.infos)


def that_stands(recording: Recording, first: SlamResult, second: SlamResult) -> SlamResult:
    """Choose the look that stands: the second, unless more of it is in doubt and the ranges are not noisy.

    Among noisy ranges a run without care may be far off and suspect nothing.
    """
    noisy = recording.range_scatter() > NOISY
    return second if noisy else min(second, first, key=scans_in_doubt)


def scans_in_doubt(result: SlamResult) -> int:
    """Count the scans of a run whose estimate is not to be trusted."""
    return int(np.count_nonzero(in_doubt(result.distrust, result.trajectory.t)))


def _one_run(
    recording: Recording,
    config: SlamConfig,
    rng: np.random.Generator,
    progress: Callable | None,
    keep_particles: bool,
) -> SlamResult:
    """Run the filter once over a recording."""
    drive = Drive.of(recording, config)
    steps = _steps(drive, config, rng)
    infos: list[StepInfo] = []
    for state, info in progress(steps, total=len(drive)) if progress else steps:
        infos.append(info if keep_particles else replace(info, particles=None))
        grid: OccupancyGrid = state.grid
    trajectory = Trajectory(np.array([info.t for info in infos]), np.array([info.estimate for info in infos]))
    return SlamResult(trajectory, grid, tuple(infos), drive.dropped | _left_unused(infos), config)


def _left_unused(infos: list[StepInfo]) -> dict[str, int]:
    """Count the beams and scans that could not be used, by reason; a reason that never occurred is left out."""
    counts = {
        "beams that struck the floor": sum(info.struck_floor for info in infos),
        "scans with too few valid beams": sum(
            not (info.matched or info.drawn or info.rejected) for info in infos
        ),
        "scans whose match was not believed": sum(info.rejected for info in infos),
        "scans that scored nothing anywhere": sum(info.matched and not info.scored for info in infos),
    }
    return {reason: count for reason, count in counts.items() if count}
