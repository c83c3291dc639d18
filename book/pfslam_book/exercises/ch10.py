"""Checks of the exercises of chapter 10: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pfslam_book.show.checks import Check, answer_to, compare, hint, passed

# ---- 1 and 2: the improved proposal and its normaliser


def proposal(likelihood, prior):
    """Return the improved proposal over some poses."""
    product = np.asarray(likelihood) * np.asarray(prior)
    return product / product.sum()


def log_weight(log_likelihood, log_prior):
    """Return the logarithm of the normaliser of the improved proposal."""
    joint = np.asarray(log_likelihood) + np.asarray(log_prior)
    return float(joint.max() + np.log(np.exp(joint - joint.max()).sum()))


def _proposal_cases() -> list[tuple]:
    rng = np.random.default_rng(0)
    cases = [(np.array([0.2, 0.9, 0.4, 0.05, 0.0]), np.array([0.1, 0.25, 0.4, 0.2, 0.05]))]
    return cases + [(rng.uniform(0.01, 1.0, n), rng.dirichlet(np.ones(n))) for n in (4, 9)]


PROPOSAL_MISTAKES = [
    (lambda li, p: li * p, "Right products, but they do not sum to 1. Divide by their sum."),
    (lambda li, p: li / li.sum(), "The scan alone: the motion is missing. Multiply the two."),
    (lambda li, p: p, "That is the motion alone, the proposal of a plain particle filter."),
    (lambda li, p: (li + p) / (li + p).sum(), "Two sources of evidence about one pose are multiplied, not added."),
    (lambda li, p: li * p / (li * p).max(), "You divide by the greatest product. Divide by their sum."),
    (lambda li, p: li * p / li.sum(), "You divide by the sum of the likelihoods. Divide by the sum of the products."),
    (lambda li, p: li * p / np.linalg.norm(li * p), "You divide by the root of the sum of squares. Probabilities sum "
     "to 1 as they are."),
    (lambda li, p: li * p / len(li), "You divide by the number of poses. Divide by the sum of the products."),
    (lambda li, p: li * p / (li * p).mean(), "You divide by the mean. Divide by the sum of the products."),
    (lambda li, p: np.exp(li * p) / np.exp(li * p).sum(), "No exp is needed: these are probabilities, not logarithms."),
    (lambda li, p: np.exp(li + p) / np.exp(li + p).sum(), "exp of a sum is for logarithms. These are probabilities: "
     "multiply them."),
    (lambda li, p: np.sqrt(li * p) / np.sqrt(li * p).sum(), "You take the root of the products. Bayes' rule takes them "
     "as they are."),
    (lambda li, p: (li / p) / (li / p).sum(), "Likelihood over prior turns the motion round. Multiply the two."),
    (lambda li, p: (li / li.sum() + p / p.sum()) / 2, "The mean of two distributions lets either one decide. "
     "Multiply."),
    (lambda li, p: np.cumsum(li * p) / (li * p).sum(), "Those are sums of probabilities, as a draw would use them. "
     "Return the probabilities."),
    (lambda li, p: np.sort(li * p / (li * p).sum()), "Right numbers, sorted. Entry i belongs to pose i."),
    (lambda li, p: np.eye(len(li))[np.argmax(li * p)], "That is its mode. A proposal gives every pose its chance."),
]  # fmt: skip


def check_proposal(theirs) -> Check:
    """Tell whether ``proposal(likelihood, prior)`` is the normalised product of the two."""
    praise = "Particles drawn from it go where both the odometry and the scan agree."
    return compare(theirs, proposal, _proposal_cases(), mistakes=PROPOSAL_MISTAKES, praise=praise)


def _log_cases() -> list[tuple]:
    """Return logarithms: moderate, random, and two scans so unlikely that their likelihood is 0 in a computer."""
    rng = np.random.default_rng(1)
    cases = [(np.log([0.2, 0.9, 0.4, 0.05]), np.log([0.1, 0.3, 0.4, 0.2]))]
    cases += [(rng.uniform(-40.0, 0.0, 7), np.log(rng.dirichlet(np.ones(7))))]
    cases += [(rng.uniform(-1260.0, -1240.0, 6), np.log(rng.dirichlet(np.ones(6))))]
    return [
        *cases,
        (np.linspace(-1300.0, -4300.0, 7), np.log(rng.dirichlet(np.ones(7)))),
    ]  # poses in walls, too


def _joint(li, p):
    return np.asarray(li) + np.asarray(p)


def _shifted(sums, shift):
    return shift + np.log(np.exp(sums - shift).sum())


def _naive(li, p):
    return float(np.log(np.exp(_joint(li, p)).sum()))


LOG_MISTAKES = [
    (_naive, "Right for likely scans. For an unlikely one exp gives 0 for every pose, and log 0 is minus infinity. "
     "Subtract the largest sum before exp, and add it again after log."),
    (lambda li, p: float(_joint(li, p).max()), "That is the best pose alone: the *mode*, which is what this package "
     "takes for a weight. The normaliser is a sum over all poses."),
    (lambda li, p: log_weight(li, np.zeros(len(p))), "The motion is missing: each pose counts as much as it is likely "
     "to be reached."),
    (lambda li, p: log_weight(li, np.zeros(len(p))) - np.log(len(p)), "You take all poses for equally likely. The "
     "motion says how likely each is."),
    (lambda li, p: log_weight(li, p) - np.log(len(p)), "That is the mean over the poses. The prior already sums to 1: "
     "add up."),
    (lambda li, p: float(np.exp(log_weight(li, p))), "That is the weight itself. Return its logarithm."),
    (lambda li, p: float(_joint(li, p).sum()), "A sum of logarithms is a product of probabilities. The poses exclude "
     "each other: their probabilities add up."),
    (lambda li, p: float(_shifted(_joint(li, p), _joint(li, p).min())), "What you subtract is not the largest sum, and "
     "exp of the largest grows beyond all numbers. Subtract the largest."),
    (lambda li, p: log_weight(li, p) / np.log(2), "That is to the base 2. np.log is the natural logarithm."),
    (lambda li, p: log_weight(li, p) / np.log(10), "That is to the base 10. np.log is the natural logarithm."),
    (lambda li, p: float(np.max(li)), "That is the greatest likelihood. The motion is missing, and the other poses."),
    (lambda li, p: float(np.exp(p) @ li), "You average logarithms. Average the likelihoods themselves, then take log."),
    (lambda li, p: float(np.logaddexp(li, p).sum()), "You add likelihood and prior of each pose. They are multiplied: "
     "add their *logarithms*, then sum over the poses."),
    (lambda li, p: log_weight(li, p) - 2 * _joint(li, p).max(), "You subtracted the largest sum once more instead of "
     "adding it again."),
    (lambda li, p: float(_joint(li, p).mean()), "The mean of logarithms is not the logarithm of a sum."),
    (lambda li, p: float(np.log(np.exp(_joint(li, p) - _joint(li, p).max()).sum())), "You subtracted the largest sum "
     "and did not add it again. Particles could no longer be compared."),
]  # fmt: skip


def check_log_weight(theirs) -> Check:
    """Tell whether ``log_weight(log_likelihood, log_prior)`` is the normaliser, for scans of any likelihood."""
    praise = "How well this particle's map had expected the scan, wherever the robot went."
    with np.errstate(all="ignore"):
        return compare(theirs, log_weight, _log_cases(), mistakes=LOG_MISTAKES, praise=praise)


# ---- 3: private maps that share memory

ANCESTORS = np.array([0, 0, 2, 2, 1])
HITS: list[int | None] = [1, 0, None, None, 3]


def check_draw_all(theirs) -> Check:
    """Tell whether ``draw_all(maps, ancestors, hits)`` gives each particle its own map and copies no more."""
    maps = [np.array([0.5, 2.0, 0.0, 1.0, 3.0]) + 10.0 * k for k in range(5)]
    before = [m.copy() for m in maps]
    held: list = []

    def run(ancestors, hits):
        held[:] = [theirs(maps, ancestors, hits)]
        return held[0]

    answer = answer_to(run, (ANCESTORS.copy(), list(HITS)), "maps")
    if isinstance(answer, Check):
        return answer
    if not isinstance(answer, Sequence | np.ndarray) or len(answer) != len(HITS):
        return hint(f"Return a list with one map for each of the {len(HITS)} particles.")
    if any(np.shape(m) != (5,) for m in answer):
        return hint("Return a list of maps, each with as many cells as before.")
    return _judged(answer, maps, before)


def _expected(before: list[np.ndarray], draw, ancestors=ANCESTORS, hits=HITS) -> list[np.ndarray]:
    new = [before[a].copy() for a in ancestors]
    for m, h in zip(new, hits, strict=True):
        if h is not None:
            draw(m, h)
    return new


def _add(m, h):
    m[h] += 1.0


def _subtract(m, h):
    m[h] -= 1.0


def _set(m, h):
    m[h] = 1.0


def _unless_zero(m, h):
    if h:
        m[h] += 1.0


SHARED = (
    "Particles 0 and 1 drew into one and the same array: each now sees the other's wall. Copies of a particle may "
    "share a map only until one of them draws."
)
DRAW_MISTAKES: list[tuple[dict[str, Any], str]] = [
    ({"draw": lambda m, h: None}, "Nobody has drawn anything: the hits are missing."),
    ({"draw": _add, "hits": [HITS[a] for a in ANCESTORS]}, "You draw the hits of the ancestors, as if the scan came "
     "before the resampling. Particle k draws hits[k]."),
    ({"draw": _add, "hits": [h or 0 for h in HITS]}, "Where hits[k] is None, particle k draws nothing; you added 1 to "
     "cell 0."),
    ({"draw": _add, "hits": [-1 if h is None else h for h in HITS]}, "Where hits[k] is None, particle k draws nothing; "
     "you added 1 to the last cell."),
    ({"draw": _subtract}, "You subtract 1 where a beam hit. A hit is evidence for a wall: add."),
    ({"draw": _unless_zero}, "A hit in cell 0 was not drawn: `if hit` takes 0 for nothing. Ask whether it `is not "
     "None`."),
    ({"draw": _set}, "You set the cell to 1. Add 1 to what it had: it keeps its earlier evidence."),
    ({"draw": _add, "ancestors": range(5)}, "Every particle goes on from its own old map. It descends from "
     "ancestors[k]: use its map."),
]  # fmt: skip


def _judged(answer, maps: list[np.ndarray], before: list[np.ndarray]) -> Check:
    """Return the verdict on a list of maps of the right size."""

    def are(expected) -> bool:
        return all(np.allclose(m, e) for m, e in zip(answer, expected, strict=True))

    for mistake, words in DRAW_MISTAKES:
        if are(_expected(before, **mistake)):
            return hint(words)
    if answer[0] is answer[1] or np.array_equal(answer[0], answer[1]):
        return hint(SHARED)
    if not are(_expected(before, _add)):
        return hint(
            "Particle k starts from the map of ancestors[k] and adds 1 at hits[k]; some map is not that."
        )
    if any(not np.array_equal(m, b) for m, b in zip(maps, before, strict=True)):
        return hint(
            "Your new maps are right, but a map of the step before has changed. It may be somebody else's."
        )
    if not (np.shares_memory(answer[2], maps[2]) and np.shares_memory(answer[3], maps[2])):
        return hint(
            "Right numbers, and more memory than needed: particles 2 and 3 drew nothing. They can go on sharing the "
            "array of their ancestor."
        )
    return passed("Five particles, four arrays: three drew and have their own, two share one.")
