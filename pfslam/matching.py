"""Moving each particle to the best pose around it: the report's way, and with a motion prior.

The scores come from ``correlation.search``. What a particle makes of them is decided here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.config import SearchConfig
from pfslam.correlation import MAX_FIELD_VALUE, BoxScores, Lattice, Window, search
from pfslam.grid import GridSpec
from pfslam.poses import wrap_angle

CHUNK = 2_000_000
"""Numbers worked on at once, so that twenty thousand particles need no more memory than two hundred."""
NEAREST_TIE = 1e-3
"""Root of twice the cost of a squared step where there is no prior: it settles ties and outvotes no score."""


@dataclass(frozen=True, eq=False)
class Matched:
    """Poses ``(N, 3)`` after the search, ``log_likelihood (N,)`` and mean score per beam ``(N,)`` from 0 to 1."""

    poses: np.ndarray
    log_likelihood: np.ndarray
    score: np.ndarray


def window_for(config: SearchConfig, lattice: Lattice, sigma_xy: float, sigma_yaw: float) -> Window:
    """The window that spans three sigmas of the motion, within the limits of the configuration."""
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
    rng: np.random.Generator,
) -> Matched:
    """Each of ``poses (N, 3)`` moved to the best pose of its window for the end points ``(M, 2)`` (body, m).

    ``sigmas`` are the standard deviations (m, rad) of the motion that led here: they set the window and the prior.
    """
    lattice = Lattice(spec.resolution, config.yaw_step)
    window = window_for(config, lattice, *sigmas)
    full_score = len(points_b) * (MAX_FIELD_VALUE if config.field == "distance" else 1)
    moved, log_likelihood, score = np.array(poses, dtype=float), np.zeros(len(poses)), np.zeros(len(poses))
    for box in search(field, spec, points_b, poses, lattice, window):
        for part in np.array_split(
            np.arange(len(box.members)), -(-len(box.members) * box.scores.shape[1] // CHUNK)
        ):
            who, node = box.members[part], box.node_of[part]
            if config.keep_offset:
                moved[who], best = _jump_with_offset(box, node, poses[who], lattice, window, rng)
                gain = _gain(best / full_score, best, config)
            else:
                moved[who], best, gain = _climb(
                    box, node, poses[who], lattice, window, sigmas, config, full_score
                )
            log_likelihood[who], score[who] = gain, best / full_score
    moved[:, 2] = wrap_angle(moved[:, 2])
    return Matched(moved, log_likelihood, score)


def _gain(mean_score: np.ndarray, total: np.ndarray, config: SearchConfig) -> np.ndarray:
    """Log-likelihood of a score: its logarithm (Eq. 12 with the count as likelihood), or sharpness times its mean."""
    if config.weight == "likelihood":
        return config.sharpness * mean_score
    with np.errstate(divide="ignore"):
        return np.log(total)


def _jump_with_offset(box: BoxScores, node, poses, lattice: Lattice, window: Window, rng):
    """The report's step: to a perturbation of greatest score, ties at random, keeping the offset from the node.

    Where nothing scores, nothing is known, and the particle stays.
    """
    best = box.scores.max(axis=1)
    tied = np.cumsum(box.scores == best[:, None], axis=1, dtype=np.int32)
    rank = np.floor(rng.random(len(node)) * tied[node, -1]).astype(np.int32)
    choice = np.argmax(tied[node] > rank[:, None], axis=1)
    choice[best[node] == 0] = window.centre
    return poses + lattice.pose(window.steps()[choice]), best[node]


def _climb(
    box: BoxScores, node, poses, lattice: Lattice, window: Window, sigmas, config: SearchConfig, full_score
):
    """To the lattice pose that maximises J = score - distance from the predicted pose, then within the step.

    With delta the perturbation and o the particle's offset from its node, the prior's |delta - o|^2 / 2 sigma^2 is
    linear in o apart from a term that is the same for every perturbation.
    """
    scale = config.sharpness / full_score if config.prior or config.weight == "likelihood" else 1.0
    sigma = np.array([sigmas[0], sigmas[0], sigmas[1]]) if config.prior else lattice.steps / NEAREST_TIE
    # Without any noise the prior pins the particle to its prediction, rather than dividing by zero.
    sigma = np.maximum(sigma, 1e-3 * lattice.steps)
    delta = lattice.pose(window.steps()) / sigma
    offset = (poses - lattice.pose(box.nodes[node])) / sigma
    J = (scale * box.scores.astype(float) - 0.5 * np.sum(delta**2, axis=1))[node]
    for axis in range(3):  # not a matrix product: so small a one is not worth a second thread
        J += offset[:, axis, None] * delta[:, axis]
    choice = np.argmax(J, axis=1)
    rows = np.arange(len(choice))
    step = window.steps()[choice].astype(float)
    if config.sub_cell:
        step += _parabola_peak(J, choice, window)
    best = box.scores[node, choice]
    if config.weight == "likelihood":
        gain = J[rows, choice] - 0.5 * np.sum(offset**2, axis=1)
    else:
        gain = _gain(best / full_score, best, config)
    return lattice.pose(box.nodes[node] + step), best, gain


def _parabola_peak(J: np.ndarray, choice: np.ndarray, window: Window) -> np.ndarray:
    """Peak ``(n, 3)`` (x, y, heading), in steps from the best node, of a parabola through it and its neighbours.

    At most half a step each way; none across the border of the window or where J does not curve down.
    """
    rows, index = np.arange(len(choice)), np.array(np.unravel_index(choice, window.shape))
    strides = np.array([window.shape[1] * window.shape[2], window.shape[2], 1])
    peak = np.zeros((len(choice), 3))
    for axis, (stride, size) in enumerate(zip(strides, window.shape, strict=True)):
        if size < 3:
            continue
        inner = (index[axis] > 0) & (index[axis] < size - 1)
        at = np.where(inner, choice, stride)  # any place with two neighbours; not used
        before, here, after = J[rows, at - stride], J[rows, at], J[rows, at + stride]
        curvature = before - 2.0 * here + after
        curved = inner & (curvature < 0)
        peak[curved, 2 - axis] = np.clip(
            (0.5 * (before - after) / np.where(curved, curvature, -1.0))[curved], -0.5, 0.5
        )
    return peak
