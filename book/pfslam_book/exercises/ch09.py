"""Exercises of chapter 09."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

# ---- 1: the parabola


def sub_cell(left, middle, right):
    return 0.5 * (left - right) / (left - 2 * middle + right)


check_sub_cell = Exercise(
    right=sub_cell,
    cases=[(3.1, 4.7, 4.2), (1.0, 1.9, -0.6), (-7.3, -5.0, -5.9), (0.2, 0.9, 0.81)],
    mistakes={
        "That is the best of the three steps. The top lies between.": (
            lambda *values: float(np.argmax(values) - 1)
        ),
        "That is the centre of mass of the three values. Fit a parabola: its derivative is 0 at the top.": (
            lambda a, b, c: (c - a) / (a + b + c)
        ),
        "That is the height of the top. Its place is asked for.": (
            lambda a, b, c: b - 0.25 * (a - c) * sub_cell(a, b, c)
        ),
        "That is the slope in the middle. Divide it by the curvature.": lambda a, b, c: 0.5 * (c - a),
        "You lost the sign: the top may lie to the left.": lambda *values: abs(sub_cell(*values)),
    },
    praise="A lattice of 5 cm, and a pose between its nodes.",
)

# ---- 2: one step of the alignment to lines


def line_case(seed) -> tuple:
    """Lines in all directions, and points a few centimetres beside them."""
    rng = np.random.default_rng(seed)
    arms, position = rng.uniform(-4.0, 4.0, (23, 2)), rng.uniform(-2.0, 2.0, 2)
    angle = rng.uniform(0.0, np.pi, 23)
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    return arms, position, arms + position + 0.05 * rng.standard_normal((23, 2)), normals


def parts(arms, position, centres, normals):
    """The Jacobian and the residuals."""
    turning = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
    return np.column_stack([normals, turning]), np.sum(normals * (arms + position - centres), axis=1)


def line_step(*case, change=lambda jacobian, case: jacobian):
    """The step of least squares, with the Jacobian as it is or changed."""
    jacobian, residual = parts(*case)
    return -np.linalg.lstsq(change(jacobian, case), residual, rcond=None)[0]


def points_to_points(arms, position, centres, normals):
    """The step that brings each point to the centre of its line."""
    axes = np.repeat(np.eye(2), len(arms), axis=0)
    return line_step(np.tile(arms, (2, 1)), position, np.tile(centres, (2, 1)), axes)


def about_the_origin(arms, position, centres, normals):
    return line_step(arms + position, 0.0, centres, normals)


def gradient(*case):
    jacobian, residual = parts(*case)
    return -jacobian.T @ residual


check_line_step = Exercise(
    right=line_step,
    cases=[line_case(1), line_case(2)],
    mistakes={
        "That is point-to-point: it also pulls points *along* walls. Only the distance along the normal counts.": (
            points_to_points
        ),
        "The sign of the last column: a turn moves an arm (a_x, a_y) along (-a_y, a_x).": (
            lambda *case: line_step(*case, change=lambda jacobian, case: jacobian * [1, 1, -1])
        ),
        "You turn about the origin of the world. The robot turns about itself: use the arms without the position.": (
            about_the_origin
        ),
        "The heading never changes: the Jacobian has a third column.": (
            lambda *case: line_step(*case, change=lambda jacobian, case: jacobian * [1, 1, 0])
        ),
        "That is the gradient. Solve the normal equations with it: J^T J step = -J^T r.": gradient,
    },
    praise="Point-to-line ICP, one iteration. The next cell repeats it.",
)

# ---- 3: the weight of a particle that is drawn from the product

rngs = [np.random.default_rng(seed) for seed in range(3)]


def log_case(rng, least, most, n=7) -> tuple:
    """Logarithms of likelihoods between two limits, and of a prior."""
    return rng.uniform(least, most, n), np.log(rng.dirichlet(np.ones(n)))


def log_weight(log_likelihood, log_prior):
    return float(np.logaddexp.reduce(log_likelihood + log_prior))


check_log_weight = Exercise(
    right=log_weight,
    cases=[  # two of them so unlikely that exp gives 0
        (np.log([0.2, 0.9, 0.4, 0.05]), np.log([0.1, 0.3, 0.4, 0.2])),
        log_case(rngs[0], -40.0, 0.0),
        log_case(rngs[1], -1260.0, -1240.0),
        log_case(rngs[2], -4300.0, -1300.0),
    ],
    mistakes={
        "Right for likely scans. For an unlikely one exp gives 0 for every pose, and log 0 is minus infinity. Subtract "
        "the largest sum before exp, and add it again after log.": lambda li, p: np.log(np.exp(li + p).sum()),
        "You subtracted the largest sum and did not add it again. Particles could no longer be compared.": (
            lambda li, p: log_weight(li, p) - (li + p).max()
        ),
        "That is the best pose alone: the *mode*, which is what this package takes for a weight. The normaliser is a "
        "sum over all poses.": lambda li, p: (li + p).max(),
        "The motion is missing: each pose counts as much as it is likely to be reached.": (
            lambda li, p: log_weight(li, 0.0)
        ),
        "A sum of logarithms is a product of probabilities. The poses exclude each other: probabilities add up.": (
            lambda li, p: (li + p).sum()
        ),
    },
    praise="How well this particle's map had expected the scan, wherever the robot went.",
)

# ---- 4: private maps that share memory


def map_case(ancestors, hits) -> tuple:
    maps = [np.array([0.5, 2.0, 0.0, 1.0, 3.0]) + 10.0 * k for k in range(5)]
    return maps, np.array(ancestors), tuple(hits)


def draw_all(maps, ancestors, hits, skip=lambda hit: hit is None):
    """The new maps; who skips goes on with the array of its ancestor."""
    new = [maps[a] if skip(h) else maps[a].copy() for a, h in zip(ancestors, hits, strict=True)]
    for grid, hit in zip(new, hits, strict=True):
        if not skip(hit):
            grid[hit] += 1
    return new


def one_copy_each(maps, ancestors, hits):
    copies = [grid.copy() for grid in maps]
    for a, hit in zip(ancestors, hits, strict=True):
        if hit is not None:
            copies[a][hit] += 1
    return [copies[a] for a in ancestors]


def wasteful(theirs, maps, ancestors, hits):
    """Words for new arrays where nothing was drawn."""
    new = theirs(maps, ancestors, hits)
    kept = [np.shares_memory(new[k], maps[a]) for k, a in enumerate(ancestors) if hits[k] is None]
    return "" if all(kept) else WASTE


WASTE = (
    "Right numbers, and more memory than needed: particles 2 and 3 drew nothing. They can go on sharing the array of "
    "their ancestor."
)

check_draw_all = Exercise(
    right=draw_all,
    cases=[
        map_case([0, 0, 2, 2, 1], [1, 0, None, None, 3]),
        map_case([4, 1, 1, 3, 1], [None, 4, 2, 0, None]),
    ],
    mistakes={
        "Particles of one ancestor drew into one and the same array: each now sees the other's wall. Copies of a "
        "particle may share a map only until one of them draws.": one_copy_each,
        "A hit in cell 0 was not drawn: `if hit` takes 0 for nothing. Ask whether it `is not None`.": (
            lambda maps, ancestors, hits: draw_all(maps, ancestors, hits, skip=lambda hit: not hit)
        ),
        "Where hits[k] is None, particle k draws nothing. grid[None] is the whole map, and you added 1 to all of it.": (
            lambda maps, ancestors, hits: draw_all(maps, ancestors, hits, skip=lambda hit: False)
        ),
        "Every particle goes on from its own old map. It descends from ancestors[k]: use its map.": (
            lambda maps, ancestors, hits: draw_all(maps, range(5), hits)
        ),
        "You draw the hits of the ancestors, as if the scan came before the resampling. Particle k draws hits[k].": (
            lambda maps, ancestors, hits: draw_all(maps, ancestors, [hits[a] for a in ancestors])
        ),
    },
    praise="Five particles, four arrays: three drew and have their own, two share one.",
    besides=wasteful,
)
