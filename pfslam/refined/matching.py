"""Moving each particle to the best pose around it: the likelihood of the scan times the density of the motion.

The scores come from ``pfslam.search``. The choice among them is made here, as in Olson's correlative scan matching
("Real-time correlative scan matching", 2009). The report's own search is ``correlation.best_perturbations``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pfslam.correlation import check_window
from pfslam.errors import DataError
from pfslam.grid import GridSpec
from pfslam.poses import wrap_angle
from pfslam.refined.field import TOP
from pfslam.search.lattice import Lattice, Window
from pfslam.search.volume import search
from pfslam.settings import Range, Settings

NEAREST_TIE = 1e-3
"""Root of twice the cost of a squared step where there is no prior: it settles ties and outvotes no score."""


HalfWidth = Annotated[int, Range(0, 10_000)]
HalfWidths = tuple[HalfWidth, HalfWidth]


@dataclass(frozen=True)
class SearchConfig(Settings):
    """Choose how a particle searches for a better pose around itself."""

    yaw_step: Annotated[float, Range(1e-5, 1.0)] = 0.01
    """Heading step of the lattice (rad); the step in x and y is one cell."""
    cells: HalfWidths = (4, 10)
    """Least and greatest half width of the window in cells; between them it spans three sigmas of the motion."""
    yaws: HalfWidths = (4, 30)
    """Least and greatest half width in heading steps."""
    beam_stride: Annotated[int, Range(1, 10_000)] = 2
    """Every how-many-th beam is scored."""
    prior: bool = True
    """Whether leaving the predicted pose costs something (the motion model's own density)."""
    sharpness: Annotated[float, Range(0.0, 1e6)] = 54.0
    """Log-likelihood of a perfect scan: one score for the whole scan, because its beams are not independent."""

    def __post_init__(self):
        super().__post_init__()
        for name in ("cells", "yaws"):
            least, greatest = getattr(self, name)
            if least > greatest:
                raise DataError("SearchConfig", name, (least, greatest), "a least and a greatest half width")
        check_window("SearchConfig", self.cells[1], self.yaws[1])


@dataclass(frozen=True, eq=False)
class Match:
    """Poses ``(N, 3)`` after the search, ``log_likelihood (N,)`` and mean score per beam ``(N,)`` from 0 to 1."""

    poses: np.ndarray
    log_likelihood: np.ndarray
    score: np.ndarray


def window_for(config: SearchConfig, lattice: Lattice, sigma_xy: float, sigma_yaw: float) -> Window:
    """Choose the window that spans three sigmas of the motion, within the limits of the configuration."""
    cells = int(np.clip(np.ceil(3.0 * sigma_xy / lattice.step_xy), *config.cells))
    yaws = int(np.clip(np.ceil(3.0 * sigma_yaw / lattice.step_yaw), *config.yaws))
    return Window(cells, yaws)


def match(
    field: np.ndarray,
    spec: GridSpec,
    points_b: np.ndarray,
    poses: np.ndarray,
    sigmas: tuple[float, float],
    config: SearchConfig,
) -> Match:
    """Move each of ``poses (N, 3)`` by the lattice step that maximises J for the end points ``(M, 2)`` (body, m).

    J = B S - (delta_x^2 + delta_y^2) / 2 sigma_xy^2 - delta_theta^2 / 2 sigma_theta^2, with the mean score S of
    ``field (H, W)`` at the lattice pose nearest to the particle, moved by delta: the logarithm of likelihood times
    prior, which is also the particle's ``log_likelihood``. Of equals the nearest wins. ``sigmas`` are the standard
    deviations (m, rad) of the motion that led here: they set the prior, and the window outside which no match is
    accepted.
    """
    lattice = Lattice(spec.resolution, config.yaw_step)
    window = window_for(config, lattice, *sigmas)
    steps = lattice.pose(window.steps())
    cost = 0.5 * np.sum((steps / _widths(sigmas, lattice, config.prior)) ** 2, axis=1)
    moved, log_likelihood, score = np.array(poses, dtype=float), np.zeros(len(poses)), np.zeros(len(poses))
    for found in search(field, spec, points_b, poses, lattice, window):
        share = found.scores / np.float32(len(points_b) * TOP)
        J = config.sharpness * share - cost
        best, rows = np.argmax(J, axis=1), np.arange(len(J))
        some, node = found.members, found.node_of
        moved[some] += steps[best[node]]
        log_likelihood[some], score[some] = J[rows, best][node], share[rows, best][node]
    moved[:, 2] = wrap_angle(moved[:, 2])
    return Match(moved, log_likelihood, score)


def _widths(sigmas: tuple[float, float], lattice: Lattice, prior: bool) -> np.ndarray:
    """Return the widths ``(3,)`` (m, m, rad) of the prior; without any noise it pins a particle to its prediction."""
    if not prior:
        return lattice.steps / NEAREST_TIE
    return np.maximum([sigmas[0], sigmas[0], sigmas[1]], 1e-3 * lattice.steps)
