"""How well a scan fits a map: the definition of the count, and the best perturbation of every particle by it.

The definition counts scan end points on occupied cells, pose by pose. ``pfslam.search`` gives the same integers for
hundreds of perturbations of hundreds of particles, a thousand times faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pfslam.errors import DataError
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.particles import Particles
from pfslam.poses import wrap_angle
from pfslam.search.lattice import Lattice, Window
from pfslam.search.volume import MAX_SCORES, NodeScores, OccupiedCells, search
from pfslam.settings import Range, Settings


def map_correlation(occupied: np.ndarray, spec: GridSpec, points_w: np.ndarray) -> int:
    """Count the points ``(M, 2)`` (world, m) on occupied cells ``(H, W)`` bool. Implements Eq. 6, 8, 9.

    Points outside the grid score nothing. This is the definition; the fast search is tested against it.

    >>> spec = GridSpec((0.0, 0.0), 1.0, (3, 3))
    >>> occupied = np.eye(3, dtype=bool)
    >>> map_correlation(occupied, spec, np.array([[0.5, 0.5], [1.5, 0.5], [2.5, 2.5], [9.0, 9.0]]))
    2
    """
    cells = spec.world_to_cell(points_w)
    ix, iy = cells[spec.contains(cells)].T
    return int(np.count_nonzero(occupied[iy, ix]))


@dataclass(frozen=True)
class Perturbations(Settings):
    """The poses that are tried around each particle; the step in x and y is one cell of the map."""

    cells: Annotated[int, Range(0, 10_000)] = 4
    """Steps each way in x and y: 4 of 0.05 m."""
    yaws: Annotated[int, Range(0, 10_000)] = 4
    """Steps each way in heading."""
    yaw_step: Annotated[float, Range(1e-5, 1.0)] = 0.005
    """Step of the heading (rad)."""

    def __post_init__(self):
        super().__post_init__()
        check_window(type(self).__name__, self.cells, self.yaws)


def check_window(kind: str, cells: int, yaws: int) -> None:
    """Raise ``DataError`` for a window of more poses than can be scored at once."""
    poses = (2 * cells + 1) ** 2 * (2 * yaws + 1)
    if poses > MAX_SCORES:
        raise DataError(kind, "cells, yaws", f"{poses} poses in a window", f"at most {MAX_SCORES}")


@dataclass(frozen=True, eq=False)
class Match:
    """The particles after the search, the counts ``(N,)`` of end points on walls there, and how many were looked at.

    Counts are whole numbers as float32, in which the search adds them up.
    """

    particles: Particles
    counts: np.ndarray
    beams: int

    @property
    def log_likelihood(self) -> np.ndarray:
        """The logarithms ``(N,)`` of the counts, which Eq. 12 takes for likelihoods; -inf where nothing was met."""
        with np.errstate(divide="ignore"):
            return np.log(self.counts)

    @property
    def score(self) -> np.ndarray:
        """The share ``(N,)`` of end points on walls, from 0 to 1."""
        return self.counts / max(self.beams, 1)


def best_perturbations(
    grid: OccupancyGrid,
    points_b: np.ndarray,
    particles: Particles,
    config: Perturbations,
    rng: np.random.Generator,
) -> Match:
    """Move each particle to the perturbation at which most end points ``(M, 2)`` (body, m) lie on walls.

    The perturbations of a particle are centred on the lattice pose nearest to it and scored there, so that particles
    share scores; the particle takes the step and keeps its offset. Among equals one is drawn; where nothing is met the
    particle stays. With no end points, no particle moves and nothing is drawn from ``rng``.
    """
    poses, counts = particles.poses.copy(), np.zeros(len(particles), dtype=np.float32)
    if len(points_b) == 0:
        return Match(particles, counts, 0)
    lattice = Lattice(grid.spec.resolution, config.yaw_step)
    window = Window(config.cells, config.yaws)
    # One random number for each particle, drawn here: how the search groups particles must not change their numbers.
    tie_breaks = rng.random(len(particles))
    for found in search(OccupiedCells(grid), grid.spec, points_b, particles.poses, lattice, window):
        some = found.members
        step, counts[some] = best_step(found, window, tie_breaks[some])
        poses[some] += lattice.pose(step)
    poses[:, 2] = wrap_angle(poses[:, 2])
    return Match(Particles(poses, particles.log_weights), counts, len(points_b))


def best_step(found: NodeScores, window: Window, tie_breaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the lattice step ``(n, 3)`` of greatest score for each particle of some nodes, and that score ``(n,)``.

    ``tie_breaks (n,)`` from 0 to 1 choose among equals. Where nothing scores, nothing is known: the step is zero.
    """
    best = found.scores.max(axis=1)
    row, tied = np.nonzero(found.scores == best[:, None])
    count = np.bincount(row, minlength=len(best))
    first = np.cumsum(count) - count
    choice = tied[first[found.node_of] + np.floor(tie_breaks * count[found.node_of]).astype(np.int64)]
    choice[best[found.node_of] == 0] = window.centre
    return window.steps()[choice], best[found.node_of]
