"""Exercises of chapter 05: three parts of the filter; the loop that joins them is checked in ``ch05.whole``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pfslam_book.show.checks import Check, attempt, hint, is_unanswered, same_poses, unanswered
from pfslam_book.show.exercise import Exercise

from pfslam.particles import systematic_resample
from pfslam.poses import average_pose, wrap_angle

rngs = [np.random.default_rng(seed) for seed in range(6)]

# ---- 1: Eq. 12


def weights_case(likelihood, weights=(0.45, 0.3, 0.15, 0.1)) -> tuple:
    return np.array(weights), np.array(likelihood, dtype=float)


def product(empty, silent=lambda w, c: not (w * c).any()):
    """Products over their sum, and what becomes of the weights where the scan is taken to say nothing."""
    return lambda w, c: empty(w) if silent(w, c) else w * c / (w * c).sum()


check_update = Exercise(
    right=product(lambda w: w),
    cases=[
        weights_case([10, 20, 45, 13]),
        weights_case([0, 2, 5, 3]),
        weights_case([0, 0, 0, 0]),
        weights_case([0, 0, 7, 2], (0.6, 0.4, 0, 0)),  # what fits has no weight
        (rngs[0].dirichlet(np.ones(30)), rngs[0].integers(1, 900, 30).astype(float)),
    ],
    mistakes={
        "If no particle fits you divide 0 by 0, and the filter is dead. Keep the weights as they were.": (
            lambda w, c: w * c / (w * c).sum()
        ),
        "In one scan only particles of weight 0 fit: the likelihood is not all 0, but every product is. Test the sum "
        "by which you divide.": product(lambda w: w, silent=lambda w, c: c.sum() == 0),
        "A scan that says nothing makes all weights equal: it wiped out what earlier scans said.": (
            product(lambda w: np.full(len(w), 1 / len(w)), silent=lambda w, c: c.sum() == 0),
            product(lambda w: np.full(len(w), 1 / len(w))),
        ),
        "The likelihood replaces the weights, and all earlier scans are forgotten. Multiply.": (
            lambda w, c: c / c.sum(),
            lambda w, c: c / c.sum() if c.any() else w,
            lambda w, c: c / c.sum() if c.any() else np.full(len(w), 1 / len(w)),
        ),
        "Right products, but they do not sum to 1. Divide by their sum (Eq. 10).": (
            lambda w, c: w * c,
            lambda w, c: w * c if (w * c).any() else w,
        ),
    },
    praise="Products, normalised, and a scan that says nothing changes nothing.",
)

# ---- 2: resampling, on a cloud so large that chance hardly shows

PLACES = np.column_stack([np.arange(5.0), 10.0 + np.arange(5.0), 0.1 * np.arange(5.0)])
SHARES = np.array([0.1, 0.42, 0.3, 0.18, 0.0])


def crowd(rng, n: int) -> tuple:
    """Particles at five places, which together have the weights ``SHARES``, and a seed."""
    at = np.tile(np.arange(5), n)
    weights = SHARES[at] * rng.uniform(0.5, 1.5, 5 * n)
    return PLACES[at], weights / weights.sum(), int(rng.integers(99))


def summary(poses, weights) -> np.ndarray:
    """The share of particles at each place, those torn between two and those elsewhere, and N times two weights."""
    apart = np.abs(np.asarray(poses, dtype=float)[:, None] - PLACES) < 2e-3
    whole, torn = apart.all(axis=2), apart.any(axis=1).all(axis=1)
    torn_only, elsewhere = torn & ~whole.any(axis=1), ~torn
    low, high = np.quantile(len(poses) * np.asarray(weights, dtype=float), [0.1, 0.9])
    return np.array([*whole.mean(axis=0), torn_only.mean(), elsewhere.mean(), low, high])


def drawn(pick, weigh=lambda w, chosen: np.full(len(w), 1 / len(w)), change=lambda p, rng: p):
    """A resampler with its own way to pick ancestors, its own new weights, and a change to the copies."""

    def rule(poses, weights, seed):
        rng = np.random.default_rng(seed)
        chosen = pick(weights, rng)
        return summary(change(poses[chosen], rng), weigh(weights, chosen))

    return rule


def by_weight(w, rng):
    return rng.choice(len(w), len(w), p=w)


def torn(poses, weights, seed):
    """Positions and headings by two draws."""
    rng = np.random.default_rng(seed)
    first, second = by_weight(weights, rng), by_weight(weights, rng)
    return summary(
        np.column_stack([poses[first, :2], poses[second, 2]]), np.full(len(weights), 1 / len(weights))
    )


resampled = Exercise(
    right=drawn(systematic_resample),
    cases=[crowd(rng, n) for rng, n in zip(rngs[1:3], (800, 600), strict=True)],
    same=lambda found, expected: np.allclose(found, expected, atol=0.05),
    mistakes={
        "The weights play no part in your draw, and all particles live on alike.": drawn(
            lambda w, rng: np.arange(len(w))
        ),
        "The old weights are still there. A heavy particle now has many copies; with its old weight on each of them "
        "it is counted twice. Make each weight 1/N.": drawn(by_weight, lambda w, chosen: w[chosen]),
        "The position of one particle came with the heading of another. Use one array of indices for whole rows.": torn,
        "Only the heaviest particle survives: that is a cloud with one opinion. Draw by weight instead.": (
            drawn(lambda w, rng: np.full(len(w), np.argmax(w)))
        ),
        "Some new poses were none of the old ones. Resampling copies; noise is the next prediction's business.": (
            drawn(by_weight, change=lambda p, rng: p + 0.1 * rng.standard_normal(p.shape))
        ),
    },
    praise="A particle of weight w gets N w copies, and all weigh the same.",
)


def check_fair(theirs: Callable) -> Check:
    """Whether ``resample(poses, weights, rng)`` draws whole poses by weight and makes the weights equal."""
    poses, weights, _ = resampled.cases[0]
    calls = [attempt(theirs, poses.copy(), weights.copy(), np.random.default_rng(s)) for s in (5, 5, 6)]
    if isinstance(calls[0], Check) or is_unanswered(calls[0]):
        return calls[0] if isinstance(calls[0], Check) else unanswered()
    shapes = [np.shape(part) for part in calls[0]] if isinstance(calls[0], tuple | list) else []
    if shapes != [poses.shape, weights.shape]:
        return hint("Return two things: the new poses (N, 3), as many as before, and the new weights (N,).")
    a, b, c = (np.asarray(new, dtype=float) for new, _ in calls)
    if not np.array_equal(a, b):
        return hint("Twice the same rng, two results: draw from the rng that is given, not from np.random.")
    if np.array_equal(a, c) and len(np.unique(a, axis=0)) > 1 and not np.array_equal(a, poses):
        return hint(
            "Every call gives the same copies. Draw from the rng, or light particles never have a chance."
        )
    verdict = resampled(lambda p, w, seed: summary(*theirs(p, w, np.random.default_rng(seed))))
    if verdict.message.startswith("Not yet. For"):
        found = summary(*calls[0])[:5].round(2)
        if np.allclose(found, SHARES, atol=0.05):
            return hint("The copies are right, and the new weights are not: make each of them 1/N.")
        return hint(f"Five groups of particles have the weights {SHARES.tolist()}; in your new cloud they make up "
                    f"{found.tolist()}.")  # fmt: skip
    return verdict


def scatter_of_copies(theirs: Callable) -> float:
    """By how much the number of copies of a particle scatters that should get two and a half, in 300 draws of ten."""
    poses, weights = np.tile(np.arange(10.0)[:, None], 3), np.where(np.arange(10) == 5, 0.25, 0.75 / 9)
    draws = [theirs(poses.copy(), weights.copy(), np.random.default_rng(seed))[0] for seed in range(300)]
    return float(np.std([np.sum(np.asarray(new)[:, 0] == 5.0) for new in draws]))


def check_resample(theirs: Callable) -> Check:
    """Whether ``resample(poses, weights, rng)`` is fair, and leaves less to chance than independent draws."""
    verdict = check_fair(theirs)
    if verdict and (scatter := scatter_of_copies(theirs)) >= 1.0:
        return hint(f"Your draw is fair on average, and a filter runs with it. But a particle that should get two "
                    f"and a half copies gets two and a half ± {scatter:.1f}. Independent draws scatter so, a comb by "
                    "half: share one random number, or give each of N equal parts one of its own.")  # fmt: skip
    return verdict


# ---- 3: one pose for the cloud


def cloud_case(rng, n: int, middle: float) -> tuple:
    """A cloud that looks roughly towards ``middle`` rad, heavy particles on one side of it."""
    turns = rng.uniform(-0.2, 0.2, n)
    weights = rng.dirichlet(np.ones(n)) * (1.0 + 3.0 * (turns > 0))
    poses = np.column_stack([rng.uniform(-4, 7, (n, 2)), wrap_angle(middle + turns)])
    return poses, weights / weights.sum()


def with_heading(heading: Callable) -> Callable:
    """A mean pose with another rule for the heading."""
    return lambda p, w: np.array([*(w @ p[:, :2]), heading(np.sin(p[:, 2]), np.cos(p[:, 2]), w)])


check_mean_pose = Exercise(
    right=average_pose,
    cases=[
        cloud_case(rng, n, at)
        for rng, n, at in zip(rngs[2:], (7, 40, 5, 9), (3.1, -3.05, 0.02, -1.9), strict=True)
    ],
    same=same_poses,
    mistakes={
        "That is the mean of the numbers. Headings of +179° and -179° both face west, but their mean is 0°, east. "
        "Average directions: their sines and cosines.": lambda p, w: w @ p,
        "That is the heaviest particle. Here the mean is asked for.": lambda p, w: p[np.argmax(w)],
        "The weights play no part in your mean: all particles count alike.": (lambda p, w: average_pose(p)),
        "arctan cannot tell west from east: only the quotient goes in. Use arctan2.": (
            with_heading(lambda s, c, w: np.arctan((w @ s) / (w @ c)))
        ),
        "arctan2 takes the sine first, then the cosine.": with_heading(
            lambda s, c, w: np.arctan2(w @ c, w @ s)
        ),
    },
    praise="On both sides of west it still faces west.",
)
