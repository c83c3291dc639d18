"""A whole run of the accurate filter, with a second look if scans have misled the first."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pfslam.poses import compose
from pfslam.recording import Recording
from pfslam.refined.health import Distrust, distrust, in_doubt, was_dragged
from pfslam.refined.outliers import NOISY
from pfslam.refined.record import RefinedStep
from pfslam.run import Once, SlamResult


@dataclass(frozen=True, eq=False)
class RefinedResult(SlamResult):
    """A finished run of the accurate filter.

    ``config`` holds the settings of the run that was kept. ``second_look`` is true if the run took robust settings by
    itself; it is false if they were asked for.
    """

    second_look: bool = False

    @staticmethod
    def left_unused(infos: Sequence[RefinedStep]) -> dict[str, int]:
        """Count the beams and scans that could not be used, by reason."""
        used = [info.matched or info.drawn or info.rejected for info in infos]
        return {
            "beams that struck the floor": sum(info.struck_floor for info in infos),
            "scans with too few valid beams": used.count(False),
            "scans whose match was not believed": sum(info.rejected for info in infos),
            "scans that scored nothing anywhere": sum(info.matched and not info.scored for info in infos),
        }

    @property
    def distrust(self) -> list[Distrust]:
        """The stretches whose estimate is not to be trusted, each ``{"from", "to", "reason"}``; empty if sound."""
        return distrust(self.infos)

    @property
    def covariances(self) -> np.ndarray | None:
        """The covariances ``(K, 3, 3)`` of the trajectory's poses, as in ``RefinedStep``; None without lines."""
        found = [info.covariance for info in self.infos if info.covariance is not None]
        return np.array(found) if len(found) == len(self.infos) else None


def refined_run(recording: Recording, config: Any, once: Once, rng: np.random.Generator) -> RefinedResult:
    """Run over a recording, and if scans misled the run, do it again with more care.

    If the scans have dragged the run off (``health.was_dragged``), it is done again with ``config.robust()``, unless
    that is the same. ``better_look`` chooses which run is kept. The second run begins with the generator in the state
    in which the first found it, so ``config`` and seed of the result repeat it to the last bit.

    If the ranges scatter by more than ``NOISY``, a first run may be far off and suspect nothing. Then the robust run is
    made at once.
    """
    scatter, again = recording.range_scatter(), deepcopy(rng)
    robust = config.robust(scatter)
    if robust == config:
        return once(config, rng)
    if scatter > NOISY:
        return replace(once(robust, rng), second_look=True)
    result = once(config, rng)
    if not was_dragged(result.infos):
        return result
    return better_look(result, replace(once(robust, again), second_look=True))


def judged(recording: Recording, result: SlamResult) -> RefinedResult:
    """Return a result with what the verdicts of ``health`` need, made from a run of any filter.

    The steps of the report's filter do not say how far scans moved the estimate; this is computed from the odometry.
    What needs lines or the age of walls is left out.
    """
    if isinstance(result, RefinedResult):
        return result
    motion = result.config.used_scans(recording).motion
    poses = np.vstack([np.zeros(3), result.trajectory.poses])
    departure = result.trajectory.poses[:, :2] - compose(poses[:-1], motion)[:, :2]
    infos = tuple(
        RefinedStep(**vars(info), aligned_score=info.score, departure=moved)
        for info, moved in zip(result.infos, departure, strict=True)
    )
    return RefinedResult(result.trajectory, result.grid, infos, result.dropped, result.config)


def better_look(first: RefinedResult, second: RefinedResult) -> RefinedResult:
    """Choose which look to keep: the second, if nothing of it is in doubt, or if it is no worse by two measures.

    The first measure is the number of scans in doubt. The second is how well the scans fit the run's own map: if both
    looks are in doubt, the map that fits worse is probably torn.
    """
    doubted = scans_in_doubt(second)
    worse = doubted > scans_in_doubt(first) or mean_score(second) < mean_score(first)
    return first if doubted and worse else second


def scans_in_doubt(result: RefinedResult) -> int:
    """Count the scans of a run whose estimate is not to be trusted."""
    return int(np.count_nonzero(in_doubt(result.distrust, result.trajectory.t)))


def mean_score(result: RefinedResult) -> float:
    """Average over the matched scans how well their beams fitted the map at the pose that was kept."""
    return float(np.mean([info.aligned_score for info in result.infos if info.matched] or [0.0]))
