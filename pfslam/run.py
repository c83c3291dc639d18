"""A whole run: scan after scan, by any method, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from pfslam.errors import DataError
from pfslam.events import UsedScans
from pfslam.grid import OccupancyGrid
from pfslam.methods import preset
from pfslam.poses import Trajectory
from pfslam.recording import Recording

Once = Callable[[Any, np.random.Generator], Any]
"""Makes one run over a recording, with these settings and these random numbers."""


class Method(Protocol):
    """What a run needs of a method's settings: ``SlamConfig`` has it, and so have the classes that extend that.

    ``result`` is the class of what a run gives back.
    """

    result: ClassVar[type[SlamResult]]

    def used_scans(self, recording: Recording) -> UsedScans:
        """Choose the scans of a recording."""

    def start(self) -> Any:
        """Make the belief before the first scan."""

    def step(self, belief: Any, event: Any, rng: np.random.Generator) -> tuple[Any, Any]:
        """Process one scan: return the next belief, and what happened."""

    def look(self, recording: Recording, once: Once, rng: np.random.Generator) -> Any:
        """Run ``once`` over a whole recording, or a second time where the first shows that it takes more care."""


@dataclass(frozen=True, eq=False)
class SlamResult:
    """A finished run: the estimate as it was at each used scan (never revised), the map, and one step per scan.

    ``infos`` holds a ``Step`` for each scan, ``dropped`` counts what could not be used, by reason, and ``config`` are
    the settings of the run.
    """

    trajectory: Trajectory
    grid: OccupancyGrid
    infos: tuple[Any, ...]
    dropped: dict[str, int]
    config: Any

    @classmethod
    def of(cls, infos: Sequence[Any], grid: OccupancyGrid, dropped: dict[str, int], config: Any) -> Self:
        """Collect the steps of a run."""
        path = Trajectory(np.array([info.t for info in infos]), np.array([info.estimate for info in infos]))
        unused = {reason: count for reason, count in cls.left_unused(infos).items() if count}
        return cls(path, grid, tuple(infos), dropped | unused, config)

    @staticmethod
    def left_unused(infos: Sequence[Any]) -> dict[str, int]:
        """Count the scans of a run that said nothing, by reason."""
        return {
            "scans without any return": sum(not info.drawn for info in infos),
            "scans that scored nothing anywhere": sum(info.matched and not info.scored for info in infos),
        }

    @property
    def updates(self) -> int:
        """Scans that were matched against the map."""
        return sum(info.matched for info in self.infos)

    @property
    def resamplings(self) -> int:
        """Scans after which the particles were resampled."""
        return sum(info.resampled for info in self.infos)


def run_slam(
    recording: Recording,
    config: Method | None = None,
    *,
    rng: np.random.Generator | None = None,
    progress: Callable | None = None,
    keep_particles: bool = True,
    second_look: bool = True,
) -> SlamResult:
    """Estimate the trajectory and the map of a recording.

    ``config=None`` is ``SlamConfig.refined()``; ``rng=None`` is seed 0. ``progress(iterable, total=n)`` may wrap the
    loop, as tqdm does. Without ``keep_particles`` the infos hold no clouds, which saves memory on long runs. A method
    that can do a run again with more care, as the accurate filter does among people, does not without ``second_look``.
    """
    config = preset("refined") if config is None else config
    rng = np.random.default_rng(0) if rng is None else rng
    once = partial(one_run, recording, progress=progress, keep_particles=keep_particles)
    return config.look(recording, once, rng) if second_look else once(config, rng)


def slam_steps(recording: Recording, config: Method, rng: np.random.Generator) -> Iterator[tuple[Any, Any]]:
    """Yield (belief, step) for each used scan of a run: for animations and for long drives.

    All beliefs of a run share its map, which is written in place: who wants to keep one says ``belief.map.copy()``.
    """
    return steps_over(config.used_scans(recording), config, rng)


def steps_over(scans: UsedScans, config: Method, rng: np.random.Generator) -> Iterator[tuple[Any, Any]]:
    """Yield (belief, step) for each of the scans; a ``DataError`` says at which scan it happened."""
    belief = config.start()
    for event in scans.events():
        try:
            belief, step = config.step(belief, event, rng)
        except DataError as error:
            where = f"{scans.recording.name}, scan at {event.t:.3f} s, {error.source}"
            raise DataError(where, error.field, error.found, error.expected) from error
        yield belief, step


def one_run(
    recording: Recording,
    config: Method,
    rng: np.random.Generator,
    progress: Callable | None = None,
    keep_particles: bool = True,
) -> SlamResult:
    """Run a method once over a recording."""
    scans = config.used_scans(recording)
    steps = steps_over(scans, config, rng)
    infos: list[Any] = []
    grid: Any = None
    for belief, info in progress(steps, total=len(scans)) if progress else steps:
        infos.append(info if keep_particles else replace(info, particles=None))
        grid = belief.map.grid
    return config.result.of(infos, grid, scans.dropped, config)
