"""A whole run: which kind of filter, scan after scan, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pfslam.beyond.per_particle import Histories, per_particle_step
from pfslam.errors import DataError
from pfslam.events import Drive
from pfslam.grid import OccupancyGrid
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.refined.health import Distrust, distrust, in_doubt, was_dragged
from pfslam.refined.outliers import NOISY
from pfslam.slam import Belief, SlamConfig, Step, slam_step


@dataclass(frozen=True, eq=False)
class SlamResult:
    """A finished run: the estimate as it was at each used scan (never revised), the map, one ``Step`` per scan.

    ``config`` is that of the run that was kept. ``second_look`` tells whether ``run_slam`` itself has made it robust,
    because people, glass or noisy ranges mislead the scans.
    """

    trajectory: Trajectory
    grid: OccupancyGrid
    infos: tuple[Step, ...]
    dropped: dict[str, int]
    config: SlamConfig
    second_look: bool = False

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
        """The covariances ``(K, 3, 3)`` of the trajectory's poses, as in ``Step``; None without lines."""
        found = [info.covariance for info in self.infos if info.covariance is not None]
        return np.array(found) if len(found) == len(self.infos) else None


def used_scans(recording: Recording, config: SlamConfig) -> Drive:
    """Return what a run with this configuration takes from a recording."""
    return Drive.of(recording, config.every, config.tilt, from_odometry=config.predict_before_first_scan)


def slam_steps(
    recording: Recording, config: SlamConfig, rng: np.random.Generator
) -> Iterator[tuple[Belief | Histories, Step]]:
    """Yield (belief, step) for each used scan of a run: for animations and for long drives.

    All beliefs of a run share its map, which is written in place: who wants to keep one says ``belief.map.copy()``.
    """
    return _steps(used_scans(recording, config), config, rng)


def _steps(
    drive: Drive, config: SlamConfig, rng: np.random.Generator
) -> Iterator[tuple[Belief | Histories, Step]]:
    each = config.maps == "per-particle"
    belief: Any = Histories.start(config) if each else Belief.start(config)
    take: Callable = per_particle_step if each else slam_step
    for event in drive.events():
        try:
            belief, step = take(belief, event, config, rng)
        except DataError as error:
            where = f"{drive.recording.name}, scan at {event.t:.3f} s, {error.source}"
            raise DataError(where, error.field, error.found, error.expected) from error
        yield belief, step


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

    A run that its scans have dragged off (``health.was_dragged``) is done again with ``config.robust()``, if that
    differs, and the second run is kept unless more of it is in doubt. It begins with the generator as the first run
    found it, so ``config`` and seed of the result repeat it to the last bit. Where the ranges scatter by more than
    ``NOISY`` a first look may be far off and suspect nothing: the robust run is made at once. Without ``second_look``
    the run is made as ``config`` says, and once.
    """
    config = SlamConfig.refined() if config is None else config
    rng = np.random.default_rng(0) if rng is None else rng
    scatter, again, how = recording.range_scatter(), deepcopy(rng), (progress, keep_particles)
    robust = config.robust(scatter)
    if not second_look or robust == config:
        return _one_run(recording, config, rng, *how)
    if scatter > NOISY:
        return replace(_one_run(recording, robust, rng, *how), second_look=True)
    result = _one_run(recording, config, rng, *how)
    if not was_dragged(result.infos):
        return result
    return better_look(result, replace(_one_run(recording, robust, again, *how), second_look=True))


def better_look(first: SlamResult, second: SlamResult) -> SlamResult:
    """Choose which look to keep: the second, unless more of it is in doubt."""
    return min(second, first, key=scans_in_doubt)


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
    drive = used_scans(recording, config)
    steps = _steps(drive, config, rng)
    infos: list[Step] = []
    for belief, info in progress(steps, total=len(drive)) if progress else steps:
        infos.append(info if keep_particles else replace(info, particles=None))
        grid = belief.grid
    trajectory = Trajectory(np.array([info.t for info in infos]), np.array([info.estimate for info in infos]))
    return SlamResult(trajectory, grid, tuple(infos), drive.dropped | _left_unused(infos), config)


def _left_unused(infos: list[Step]) -> dict[str, int]:
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
