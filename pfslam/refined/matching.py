"""Moving each particle to the best pose around it: the report's way, and with a motion prior.

The scores come from ``pfslam.search``. The choice among them is made here: the report's step to the greatest count, or
the maximum of the scan's likelihood times the motion model's density (Olson's correlative scan matching).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from pfslam.correlation import Perturbations, best_step, check_window
from pfslam.errors import DataError
from pfslam.grid import GridSpec
from pfslam.poses import wrap_angle
from pfslam.refined.field import ScoreField
from pfslam.search.lattice import Lattice, Window, parabola_peak
from pfslam.search.volume import BoxScores, search
from pfslam.settings import Range, Settings

NEAREST_TIE = 1e-3
"""Root of twice the cost of a squared step where there is no prior: it settles ties and outvotes no score."""


HalfWidth = Annotated[int, Range(0, 10_000)]
HalfWidths = tuple[HalfWidth, HalfWidth]


@dataclass(frozen=True)
class SearchConfig(Settings):
    """Choose how a particle searches for a better pose around itself, and how that pose changes its weight."""

    yaw_step: Annotated[float, Range(1e-5, 1.0)] = 0.01
    """Heading step of the lattice (rad); the step in x and y is one cell."""
    cells: HalfWidths = (4, 10)
    """Least and greatest half width of the window in cells; between them it spans three sigmas of the motion."""
    yaws: HalfWidths = (4, 30)
    """Least and greatest half width in heading steps."""
    beam_stride: Annotated[int, Range(1, 10_000)] = 2
    """Every how-many-th beam is scored."""
    field: Literal["occupied", "distance"] = "distance"
    """"occupied": count of end points on occupied cells. "distance": credit for near misses too."""
    prior: bool = True
    """Whether leaving the predicted pose costs something (the motion model's own density)."""
    sub_cell: bool = True
    """Whether a parabola through the best score and its neighbours refines the pose within a step."""
    keep_offset: bool = False
    """Whether a particle keeps its offset from the lattice node it was scored at (the report), or moves onto it."""
    sharpness: Annotated[float, Range(0.0, 1e6)] = 54.0
    """Log-likelihood of a perfect scan: one score for the whole scan, because its beams are not independent."""
    weight: Literal["count", "likelihood"] = "likelihood"
    """"count": weights multiply by the score (Eq. 12). "likelihood": by exp(sharpness * mean score - prior cost)."""

    def __post_init__(self):
        super().__post_init__()
        for name in ("cells", "yaws"):
            least, greatest = getattr(self, name)
            if least > greatest:
                raise DataError("SearchConfig", name, (least, greatest), "a least and a greatest half width")
        check_window("SearchConfig", self.cells[1], self.yaws[1])

    @classmethod
    def counting(cls, perturbations: Perturbations) -> SearchConfig:
        """Return the report's search in these settings: the greatest count, anywhere in a window of fixed size."""
        cells, yaws = perturbations.cells, perturbations.yaws
        return cls(
            yaw_step=perturbations.yaw_step,
            cells=(cells, cells),
            yaws=(yaws, yaws),
            beam_stride=1,
            field="occupied",
            prior=False,
            sub_cell=False,
            keep_offset=True,
            weight="count",
        )


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
    field: ScoreField,
    spec: GridSpec,
    points_b: np.ndarray,
    poses: np.ndarray,
    sigmas: tuple[float, float],
    config: SearchConfig,
    rng: np.random.Generator,
) -> Match:
    """Move each of ``poses (N, 3)`` to the best pose of its window for the end points ``(M, 2)`` (body, m).

    ``sigmas`` are the standard deviations (m, rad) of the motion that led here: they set the search window, outside
    which no match is accepted, and the prior.
    """
    lattice = Lattice(spec.resolution, config.yaw_step)
    window = window_for(config, lattice, *sigmas)
    full_score = len(points_b) * field.top
    moved, log_likelihood, score = np.array(poses, dtype=float), np.zeros(len(poses)), np.zeros(len(poses))
    # One random number for each particle, drawn here: how the search groups particles must not change their numbers.
    tie_breaks = rng.random(len(poses)) if config.keep_offset else None
    for box in search(field.values, spec, points_b, poses, lattice, window):
        for part in box.in_parts():
            some = part.members
            if tie_breaks is not None:
                step, best = best_step(part, window, tie_breaks[some])
                moved[some] += lattice.pose(step)
                gain = _gain(best / full_score, best, config)
            else:
                moved[some], best, gain = _climb(
                    part, poses[some], lattice, window, sigmas, config, full_score
                )
            log_likelihood[some], score[some] = gain, best / full_score
    moved[:, 2] = wrap_angle(moved[:, 2])
    return Match(moved, log_likelihood, score)


def _gain(mean_score: np.ndarray, total: np.ndarray, config: SearchConfig) -> np.ndarray:
    """Return a score's log-likelihood: its logarithm (Eq. 12, the count as likelihood), or sharpness times its mean."""
    if config.weight == "likelihood":
        return config.sharpness * mean_score
    with np.errstate(divide="ignore"):
        return np.log(total)


def _climb(box: BoxScores, poses, lattice: Lattice, window: Window, sigmas, config: SearchConfig, full_score):
    """Take the refined step: to the lattice pose that maximises J, then to the peak of J within a lattice step.

    J is the score less the prior's cost of leaving the predicted pose. With delta the perturbation and o the particle's
    offset from its node, that cost, |delta - o|^2 / 2 sigma^2, is linear in o apart from a term that is the same for
    every perturbation.
    """
    node = box.node_of
    scale = config.sharpness / full_score if config.prior or config.weight == "likelihood" else 1.0
    sigma = np.array([sigmas[0], sigmas[0], sigmas[1]]) if config.prior else lattice.steps / NEAREST_TIE
    # Without any noise the prior pins the particle to its prediction, rather than dividing by zero.
    sigma = np.maximum(sigma, 1e-3 * lattice.steps)
    delta = (lattice.pose(window.steps()) / sigma).T
    offset = ((poses - lattice.pose(box.nodes[node])) / sigma).T
    at_node = np.multiply(scale, box.scores, dtype=float)
    at_node -= 0.5 * np.sum(delta.T**2, axis=1)

    def objective(steps):
        return _linear(at_node[node, steps], offset, delta[:, steps])

    candidates = _candidates(at_node, delta, 0.5 * lattice.steps / sigma)
    of_candidates = at_node.take(candidates, axis=1).take(node, axis=0)
    J = _linear(of_candidates, offset[:, :, None], delta[:, candidates])
    choice = candidates[np.argmax(J, axis=1)]
    step = window.steps()[choice].astype(float)
    if config.sub_cell:
        step += _peaks(objective, choice, window)
    best = box.scores[node, choice]
    if config.weight == "likelihood":
        gain = objective(choice) - 0.5 * np.sum(offset.T**2, axis=1)
    else:
        gain = _gain(best / full_score, best, config)
    return lattice.pose(box.nodes[node] + step), best, gain


def _linear(at_node: np.ndarray, offset: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """Evaluate J of perturbations ``delta (3, ...)`` for particles at ``offset (3, ...)``, given J at their node."""
    J = at_node + offset[0] * delta[0]
    J += offset[1] * delta[1]
    J += offset[2] * delta[2]
    return J


def _candidates(at_node: np.ndarray, delta: np.ndarray, half_step: np.ndarray) -> np.ndarray:
    """Find the perturbations ``(C,)`` that may be best for some particle, so that only these need be compared.

    A particle lies at most half a step from its node, so its J differs from that at the node by at most ``margin``.
    """
    margin = half_step @ np.abs(delta)
    certain = np.max(at_node - margin, axis=1)  # the best perturbation reaches at least this much
    round_off = 1e-6 * (1.0 + margin)
    # The same as asking each row for at_node + margin + round_off >= certain, in two passes instead of four.
    return np.flatnonzero(np.max(at_node - certain[:, None], axis=0) + margin + round_off >= 0.0)


def _peaks(J: Callable, choice: np.ndarray, window: Window) -> np.ndarray:
    """Find the peak ``(n, 3)``, in steps from the best node, of a parabola through it and its neighbours on each axis.

    ``J`` gives the objective at perturbations ``(..., n)`` of the n particles. Half a step each way at most, because no
    neighbour is better; none across the border of the window or where J does not curve down.
    """
    index, sizes = np.array(np.unravel_index(choice, window.shape)), np.array(window.shape)[:, None]
    strides = np.array([[window.shape[1] * window.shape[2]], [window.shape[2]], [1]])
    inner = (index > 0) & (index < sizes - 1)
    before, after = (np.where(inner, choice + sign * strides, 0) for sign in (-1, 1))
    peak = parabola_peak(J(before), J(choice), J(after))
    return np.where(inner, peak, 0.0)[::-1].T
