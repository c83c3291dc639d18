"""A whole run: which kind of SLAM, scan after scan, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from pfslam.config import SlamConfig
from pfslam.errors import DataError
from pfslam.events import scan_events, used_scans
from pfslam.grid import OccupancyGrid
from pfslam.per_particle import Histories, per_particle_step, start_histories
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.slam import SlamState, StepInfo, slam_step, start

STRATEGIES: dict[str, tuple[Callable, Callable]] = {
    "shared": (start, slam_step),
    "per-particle": (start_histories, per_particle_step),
}
"""By ``SlamConfig.maps``: how a run begins, and its step. Scan matching is the shared map with one particle."""


@dataclass(frozen=True, eq=False)
class SlamResult:
    """A finished run: the estimate as it was at each used scan (never revised), the map, one info per step."""

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


def slam_steps(
    recording: Recording, config: SlamConfig, rng: np.random.Generator
) -> Iterator[tuple[SlamState | Histories, StepInfo]]:
    """The run as an iterator over (state, info), one for each used scan: for animations and for long drives."""
    begin, step = STRATEGIES[config.maps]
    state = None
    for event in scan_events(recording, config)[0]:
        try:
            state, info = begin(event, config, rng) if state is None else step(state, event, config, rng)
        except DataError as error:
            where = f"{recording.name}, scan at {event.t:.3f} s, {error.source}"
            raise DataError(where, error.field, error.found, error.expected) from error
        yield state, info


def run_slam(
    recording: Recording,
    config: SlamConfig | None = None,
    *,
    rng: np.random.Generator | None = None,
    progress: Callable | None = None,
    keep_particles: bool = True,
) -> SlamResult:
    """Trajectory and map of a recording.

    ``config=None`` is ``SlamConfig.refined()``; ``rng=None`` is seed 0. ``progress(iterable, total=n)`` may wrap the
    loop, as tqdm does. Without ``keep_particles`` the infos hold no clouds, which saves memory on long runs.
    """
    config = SlamConfig.refined() if config is None else config
    rng = np.random.default_rng(0) if rng is None else rng
    stamps, dropped = used_scans(recording, config)
    steps = slam_steps(recording, config, rng)
    infos: list[StepInfo] = []
    for state, info in progress(steps, total=len(stamps)) if progress else steps:
        infos.append(info if keep_particles else replace(info, particles=None))
        grid: OccupancyGrid = state.grid
    trajectory = Trajectory(np.array([info.t for info in infos]), np.array([info.estimate for info in infos]))
    blind = sum(not (info.matched or info.drawn) for info in infos[1:])
    mute = sum(info.matched and not info.scored for info in infos)
    floor = sum(info.struck_floor for info in infos)
    dropped |= {"beams that struck the floor": floor} if floor else {}
    dropped |= {"scans with too few valid beams": blind} if blind else {}
    dropped |= {"scans that scored nothing anywhere": mute} if mute else {}
    return SlamResult(trajectory, grid, tuple(infos), dropped, config)
