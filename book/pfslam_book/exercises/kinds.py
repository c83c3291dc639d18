"""Exercises of chapter 09."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

rngs = [np.random.default_rng(seed) for seed in range(4)]

# ---- 1 and 2: the improved proposal and its normaliser


def proposal(likelihood, prior):
    return likelihood * prior / (likelihood * prior).sum()


check_proposal = Exercise(
    right=proposal,
    cases=[
        (np.array([0.2, 0.9, 0.4, 0.05, 0.0]), np.array([0.1, 0.25, 0.4, 0.2, 0.05])),
        *(
            (rng.uniform(0.01, 1.0, n), rng.dirichlet(np.ones(n)))
            for rng, n in zip(rngs, (4, 9), strict=False)
        ),
    ],
    mistakes={
        "Right products, but they do not sum to 1. Divide by their sum.": lambda li, p: li * p,
        "You divide by the greatest product. Divide by their sum.": lambda li, p: li * p / (li * p).max(),
        "The scan alone: the motion is missing. Multiply the two.": lambda li, p: li / li.sum(),
        "Two sources of evidence about one pose are multiplied, not added.": lambda li, p: (
            (li + p) / (li + p).sum()
        ),
        "That is its mode. A proposal gives every pose its chance.": lambda li, p: np.eye(len(li))[
            np.argmax(li * p)
        ],
    },
    praise="Particles drawn from it go where both the odometry and the scan agree.",
)


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

# ---- 3: private maps that share memory


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
