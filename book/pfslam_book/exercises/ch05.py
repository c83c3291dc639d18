"""Checks of the exercises of chapter 05: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.checks import Check, answer_to, attempt, compare, hint, passed, same_poses

from pfslam.poses import average_pose, wrap_angle

# ---- 1: Eq. 12


def updated(weights, counts):
    """Eq. 12, normalised; a scan that scores nothing leaves the weights as they were."""
    joint = np.asarray(weights) * counts
    return joint / joint.sum() if joint.sum() > 0 else np.asarray(weights)


def _scans() -> list[tuple]:
    """Weights and counts: generic, one zero among the counts, nothing but zeros, and two random ones."""
    weights = np.array([0.45, 0.3, 0.15, 0.1])
    cases = [(weights, np.array([c, 20.0, 45.0, 13.0])) for c in (10.0, 0.0)] + [(weights, np.zeros(4))]
    rng = np.random.default_rng(1)
    return cases + [(rng.dirichlet(np.ones(n)), rng.integers(1, 900, n).astype(float)) for n in (6, 30)]


def _safe(rule, empty=lambda w: w):
    """An update by another rule, with ``empty`` for a scan that scores nothing."""

    def wrong(w, c):
        joint = rule(w, c)
        return joint / joint.sum() if c.any() else empty(w)

    return wrong


UPDATE_MISTAKES = [
    (ZeroDivisionError, "If no particle scores, you divide 0 by 0 and the filter is dead. Keep the weights."),
    (lambda w, c: w * c / (w * c).sum(), "If no particle scores, you divide 0 by 0 and the filter is dead. Keep the "
     "weights as they were."),
    (_safe(lambda w, c: w * c, lambda w: np.full(len(w), 1 / len(w))), "A scan that scores nothing makes all weights "
     "equal: it wiped out what earlier scans said."),
    (_safe(lambda w, c: w * c, np.zeros_like), "A scan that scores nothing says nothing: the weights should come back "
     "unchanged, not as zeros."),
    (_safe(lambda w, c: np.where(c > 0, w * c, w)), "One particle scored nothing, and yours keeps its weight. Only a "
     "scan in which *nobody* scores says nothing."),
    (_safe(lambda w, c: c), "The counts replace the weights: all earlier scans are forgotten. Multiply."),
    (lambda w, c: c / c.sum(), "The counts replace the weights: all earlier scans are forgotten. Multiply."),
    (lambda w, c: w * c, "Right products, but they do not sum to 1. Divide by their sum (Eq. 10)."),
    (lambda w, c: w * c if c.any() else w, "Right products, but they do not sum to 1. Divide by their sum."),
    (lambda w, c: w * c / c.sum() if c.any() else w, "You divide by the sum of the counts. Divide by the sum of the "
     "products: the weights must sum to 1."),
    (lambda w, c: w * c / (w * c).max() if c.any() else w, "You divide by the greatest product. Divide by their "
     "sum."),
    (_safe(lambda w, c: w + c), "Weights and counts are multiplied, not added."),
    (_safe(lambda w, c: w * np.exp(c - c.max())), "One particle has it all: you took exp of the count. Eq. 12 "
     "multiplies by the count itself."),
    (lambda w, c: np.exp(c - c.max()) / np.exp(c - c.max()).sum(), "One particle has it all: you took exp of the "
     "count. Eq. 12 multiplies the old weights by the count itself."),
    (_safe(lambda w, c: w * c**2), "You multiply by the square of the count."),
    (_safe(lambda w, c: w**2 * c), "The old weight enters as its square."),
    (_safe(lambda w, c: np.eye(len(w))[np.argmax(w * c)]), "The best particle gets everything. Each keeps its share."),
    (lambda w, c: w * c / (w * c).sum() if c.all() else w, "One particle scored nothing, and yours leaves all weights "
     "as they were. Only a scan in which *nobody* scores says nothing."),
    (lambda w, c: w * c / np.linalg.norm(w * c) if c.any() else w, "You divide by the length of the vector. Divide by "
     "the sum: the weights must sum to 1."),
    (lambda w, c: w * c / (w * c).mean() if c.any() else w, "You divide by the mean of the products, not by the sum."),
    (lambda w, c: (w + c / c.sum()) / 2 if c.any() else w, "Weights and counts are multiplied, not averaged."),
    (lambda w, c: w, "Your weights come back unchanged whatever the scan says."),
]  # fmt: skip


def check_update(update) -> Check:
    """Whether ``update(weights, counts)`` is Eq. 12, normalised, and survives a scan that scores nothing."""
    praise = "Products, normalised, and an empty scan changes nothing."
    with np.errstate(all="ignore"):
        return compare(update, updated, _scans(), mistakes=UPDATE_MISTAKES, praise=praise)


# ---- 2: resampling

TRIALS = 400
CLOUD = np.column_stack([np.arange(5.0), 10.0 + np.arange(5.0), 0.1 * np.arange(5.0)])
CLOUD_WEIGHTS = np.array([0.1, 0.42, 0.3, 0.18, 0.0])


def check_resample(resample) -> Check:
    """Whether ``resample(poses, weights, rng)`` draws whole poses by weight and makes the weights equal."""
    rng = np.random.default_rng(0)
    offspring, verdict = [], _own_randomness(resample)
    if verdict is not None:
        return verdict
    for _ in range(TRIALS):
        poses, weights = CLOUD.copy(), CLOUD_WEIGHTS.copy()
        answer = answer_to(lambda p, w: resample(p, w, rng), (poses, weights), "a pair")
        if isinstance(answer, Check):
            return answer
        problem = _problem(answer)
        if problem:
            return hint(problem)
        offspring.append(
            np.bincount(np.rint(np.asarray(answer[0], dtype=float)[:, 0]).astype(int), minlength=5)
        )
    return _offspring_verdict(np.array(offspring))


def _own_randomness(resample) -> Check | None:
    """A hint if the draws do not come from the ``rng`` that is given: alike rngs must give alike clouds."""
    clouds: list[list[np.ndarray]] = [[], []]
    for some in clouds:
        rng = np.random.default_rng(5)
        for _ in range(8):
            answer = attempt(resample, CLOUD.copy(), CLOUD_WEIGHTS.copy(), rng)
            if isinstance(answer, Check) or _problem(answer):
                return None  # the check itself finds the words for it
            some.append(np.asarray(answer[0], dtype=float))
    if np.array_equal(clouds[0], clouds[1]):
        return None
    return hint("Twice the same rng, two results: draw from the rng that is given, not from np.random.")


def _problem(answer) -> str:
    """What is wrong with one returned pair, or nothing."""
    if not (isinstance(answer, tuple | list | np.ndarray) and len(answer) == 2):
        return "Return two arrays: the new poses (N, 3) and the new weights (N,)."
    try:
        poses, weights = (np.asarray(part, dtype=float) for part in answer)
    except (TypeError, ValueError):
        return "Return two arrays of numbers: the new poses (N, 3) and the new weights (N,)."
    if (weights.shape, poses.shape) == (CLOUD.shape, CLOUD_WEIGHTS.shape):
        return "Return the poses first and the weights second."
    if poses.shape == weights.shape == CLOUD_WEIGHTS.shape:
        return "Those are the indices of the ancestors. Return their poses (N, 3): poses[ancestors]."
    if poses.shape != CLOUD.shape or weights.shape != CLOUD_WEIGHTS.shape:
        return f"The number of particles must stay {len(CLOUD)}; yours have the shapes {poses.shape}, {weights.shape}."
    apart = np.abs(poses[:, None, :] - CLOUD) < 1e-5
    if not apart.all(axis=2).any(axis=1).all():
        if apart.any(axis=1).all():
            return (
                "The x of one particle came with the heading of another. Use one index array for whole rows."
            )
        return "Some new poses were none of the old ones. Resampling copies; noise is the next prediction's business."
    if not np.allclose(weights, 1 / len(CLOUD), atol=1e-4):
        if np.allclose(weights, 1.0):
            return "The weights are all 1 afterwards; they must sum to 1: make each 1/N."
        return (
            "The weights are not 1/N afterwards. A heavy particle now has many copies; with its old weight on each "
            "of them it would be counted twice."
        )
    return ""


def _offspring_verdict(offspring: np.ndarray) -> Check:
    """The verdict on the copies of each particle ``(trials, N)``, whose mean should be N w."""
    n, mean = len(CLOUD), offspring.mean(axis=0)
    expected, squared = n * CLOUD_WEIGHTS, n * CLOUD_WEIGHTS**2 / np.sum(CLOUD_WEIGHTS**2)
    found, wanted = np.round(mean, 2).tolist(), np.round(expected, 2).tolist()
    if (offspring.max(axis=1) == n).all() and len(np.unique(offspring.argmax(axis=1))) > 1:
        return hint("Each call copies a single particle N times: you drew once for all. Draw N times.")
    if np.allclose(mean, expected, atol=0.23):
        return passed(f"On average {found} copies, expected {wanted}.")
    if mean[np.argmax(CLOUD_WEIGHTS)] > 0.99 * n:
        return hint(
            "Only the heaviest particle survives: that is a cloud with one opinion. Draw by weight instead."
        )
    if np.allclose(mean, 1.0, atol=0.23):
        return hint("All particles get about as many copies: the weights play no part in your draw.")
    if np.ptp(offspring, axis=0).max() == 0:
        return hint(
            "Every call gives the same copies. Draw from the rng, or light particles never have a chance."
        )
    if any(np.allclose(mean, np.roll(expected, by), atol=0.23) for by in (1, -1)):
        return hint("Each particle gets the copies of its neighbour: an index is off by one.")
    if np.allclose(mean, expected[::-1], atol=0.23) or np.allclose(mean, np.sort(expected), atol=0.23):
        return hint(
            "The copies go to the wrong particles: the order of weights and poses must stay the same."
        )
    if np.allclose(mean, squared, atol=0.23):
        return hint("Your copies go with the square of the weight: are the weights used twice?")
    return hint(f"Particle i should get N w_i copies on average, {wanted}; yours get {found}.")


# ---- 3: one pose for the cloud


def _west(rng: np.random.Generator, n: int, middle: float) -> tuple:
    """A cloud that looks roughly towards ``middle`` rad, heavy particles on one side of it."""
    turns = rng.uniform(-0.2, 0.2, n)
    weights = rng.dirichlet(np.ones(n)) * (1.0 + 3.0 * (turns > 0))
    poses = np.column_stack([rng.uniform(-4, 7, (n, 2)), wrap_angle(middle + turns)])
    return poses, weights / weights.sum()


MEANS = [
    (np.column_stack([[1.0, 2.0, 6.0, 3.0], [0.0, 1.0, 5.0, 2.5], np.deg2rad([171.0, -178.0, -165.0, 178.0])]),
     np.array([0.1, 0.2, 0.45, 0.25])),
    *(_west(np.random.default_rng(seed), n, middle) for seed, n, middle in ((1, 7, 3.1), (2, 40, -3.05), (3, 5, 0.02))),
]  # fmt: skip


def _direction(theta, weights):
    return np.arctan2(weights @ np.sin(theta), weights @ np.cos(theta))


def _with_heading(heading, position=lambda p, w: w @ p[:, :2]):
    """A mean pose with another rule for the heading, or for x and y."""
    return lambda p, w: np.array([*position(p, w), heading(p[:, 2], w)])


MEAN_MISTAKES = [
    (lambda p, w: w @ p, "That is the mean of the numbers. Headings of +179° and -179° both face west, but their "
     "mean is 0°, east. Average directions: their sines and cosines."),
    (lambda p, w: p[np.argmax(w)], "That is the heaviest particle, the MAP estimate. Here the mean is asked for."),
    (lambda p, w: average_pose(p), "The weights play no part in your mean: all particles count alike."),
    (lambda p, w: p.mean(axis=0), "The weights play no part, and headings are averaged as numbers."),
    (lambda p, w: average_pose(p, w) * len(p), "That is N times the mean: the weights already sum to 1."),
    (_with_heading(lambda t, w: np.arctan((w @ np.sin(t)) / (w @ np.cos(t)))), "arctan cannot tell west from east: "
     "only the quotient goes in. Use arctan2."),
    (_with_heading(lambda t, w: np.arctan2(w @ np.cos(t), w @ np.sin(t))), "arctan2 takes the sine first, then the "
     "cosine."),
    (_with_heading(lambda t, w: _direction(t, np.ones(len(t)))), "x and y are right; the heading is averaged "
     "without the weights."),
    (_with_heading(_direction, lambda p, w: p[:, :2].mean(axis=0)), "The heading is right; x and y are averaged "
     "without the weights."),
    (_with_heading(lambda t, w: np.rad2deg(_direction(t, w))), "Headings are in radians."),
    (_with_heading(lambda t, w: _direction(np.deg2rad(t), w)), "Headings are in radians already: no deg2rad before sin "
     "and cos."),
    (_with_heading(lambda t, w: np.arccos(w @ np.cos(t))), "arccos knows the cosine alone and loses left and right. "
     "Use arctan2 of both sums."),
    (_with_heading(lambda t, w: np.arcsin(w @ np.sin(t))), "arcsin knows the sine alone and loses ahead and behind. "
     "Use arctan2 of both sums."),
    (_with_heading(_direction, lambda p, w: (w @ p[:, :2])[::-1]), "x and y have changed places."),
    (_with_heading(_direction, lambda p, w: p[:, :2].sum(axis=0)), "x and y are plain sums. Multiply by the weights."),
    (_with_heading(lambda t, w: -_direction(t, w)), "The heading has the wrong sign."),
    (_with_heading(lambda t, w: _direction(t, w) + np.pi), "The heading looks back: it is half a turn off."),
    (_with_heading(lambda t, w: t[0]), "x and y are means, the heading is that of the first particle."),
    (_with_heading(lambda t, w: t[-1]), "x and y are means, the heading is that of the last particle."),
    (lambda p, w: average_pose(p, w**2), "Your weights enter as their squares."),
    (lambda p, w: np.median(p, axis=0), "That is the median, and it knows no weights. The mean is asked for."),
    (_with_heading(lambda t, w: t[np.argmax(w)]), "x and y are means, the heading is that of the heaviest particle."),
    (_with_heading(lambda t, w: w @ np.abs(t)), "You drop the sign of the headings. Average sines and cosines."),
    (_with_heading(lambda t, w: w @ (t % (2 * np.pi))), "Modulo 2 pi moves the jump from west to east, and "
     "particles on both sides of it still have a mean between them. Average sines and cosines."),
]  # fmt: skip


def check_mean_pose(mean_pose) -> Check:
    """Whether ``mean_pose(poses, weights)`` is the weighted mean, with the heading averaged on the circle."""
    praise = "On both sides of west it still faces west."
    return compare(mean_pose, average_pose, MEANS, mistakes=MEAN_MISTAKES, praise=praise, same=same_poses)
