"""Checks of the exercises of chapter 11: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.checks import Check, compare

# ---- 1: how many particles


def particles_needed(bins, epsilon, z):
    """Return Fox's bound on the number of particles for a cloud over so many bins."""
    k = bins - 1
    a = 2 / (9 * k)
    return k / (2 * epsilon) * (1 - a + np.sqrt(a) * z) ** 3


BOUND_CASES = [(8, 0.05, 2.326), (120, 0.05, 2.326), (37, 0.02, 1.282), (1000, 0.11, 0.674)]


def _bound(k, epsilon, z, a=None, power=3):
    a = 2 / (9 * k) if a is None else a
    return k / (2 * epsilon) * (1 - a + np.sqrt(a) * z) ** power


BOUND_MISTAKES = [
    (lambda b, e, z: _bound(b, e, z), "You use the number of bins. Shares that sum to 1 leave one fewer to choose: "
     "bins - 1 degrees of freedom, wherever k stands."),
    (lambda b, e, z: _bound(b - 1, e, z, a=2 / (9 * b)), "Under the 9 stands k, the degrees of freedom: bins "
     "- 1, as in "
     "front."),
    (lambda b, e, z: b / (b - 1) * _bound(b - 1, e, z), "In front stands k, the degrees of freedom: bins - 1, as under "
     "the 9."),
    (lambda b, e, z: _bound(b - 1, e, z, power=1), "The bracket is to be cubed: Wilson and Hilferty found "
     "that the cube "
     "*root* of a chi-square is nearly normal."),
    (lambda b, e, z: _bound(b - 1, e, z, power=2), "The bracket is to be cubed, not squared."),
    (lambda b, e, z: (b - 1) / (2 * e), "That is the mean of the chi-square over 2 epsilon: half of all "
     "clouds would be "
     "worse than epsilon. The bracket makes it a quantile."),
    (lambda b, e, z: 2 * _bound(b - 1, e, z), "Twice too many: the divisor is 2 epsilon."),
    (lambda b, e, z: 2 * e * _bound(b - 1, e, z), "That is the quantile itself. Divide it by 2 epsilon."),
    (lambda b, e, z: (b - 1) / (2 * e) * (1 + 2 / (9 * (b - 1)) + np.sqrt(2 / (9 * (b - 1))) * z) ** 3, "The first "
     "2 / (9 k) is subtracted."),
    (lambda b, e, z: (b - 1) / (2 * e) * (1 - 2 / (9 * (b - 1)) - np.sqrt(2 / (9 * (b - 1))) * z) ** 3, "The "
     "term with z "
     "is added: to be surer takes more particles, not fewer."),
    (lambda b, e, z: (b - 1) / (2 * e) * (1 - 2 / (9 * (b - 1)) + 2 / (9 * (b - 1)) * z) ** 3, "z is multiplied by the "
     "*root* of 2 / (9 k), its standard deviation."),
    (lambda b, e, z: (b - 1) / 2 * e * (1 - 2 / (9 * (b - 1)) + np.sqrt(2 / (9 * (b - 1))) * z) ** 3, "k / 2 * epsilon "
     "multiplies by epsilon. Write k / (2 * epsilon)."),
    (lambda b, e, z: (b - 1) / (2 * e) * (1 - 2 / 9 * (b - 1) + np.sqrt(2 / 9 * (b - 1)) * z) ** 3, "2 / 9 * "
     "k multiplies "
     "by k. Write 2 / (9 * k)."),
    (lambda b, e, z: _bound(b - 1, z, e), "epsilon and z have changed places."),
]  # fmt: skip


def check_particles_needed(theirs) -> Check:
    """Tell whether ``particles_needed(bins, epsilon, z)`` is the KLD bound."""
    praise = "Ten thousand for a cloud over the whole building, a few hundred once it is one heap."
    with np.errstate(all="ignore"):
        return compare(theirs, particles_needed, BOUND_CASES, mistakes=BOUND_MISTAKES, praise=praise)


# ---- 2: how many to draw anew


def inject(slow, fast, fit, alpha_slow, alpha_fast):
    """Return both averages after a scan, and the share of particles to draw anew."""
    slow = slow + alpha_slow * (fit - slow)
    fast = fast + alpha_fast * (fit - fast)
    return np.array([slow, fast, max(0.0, 1 - fast / slow)])


INJECT_CASES = [
    (0.9, 0.8, 0.31, 0.01, 0.2),
    (0.62, 0.83, 0.95, 0.05, 0.3),
    (0.7, 0.75, 0.2, 0.02, 0.5),
    (0.9, 0.93, 0.94, 0.01, 0.2),
]


def _share(slow, fast):
    return max(0.0, 1 - fast / slow)


def _after(slow, fast, fit, a, b):
    return slow + a * (fit - slow), fast + b * (fit - fast)


def _with(share):
    def wrong(slow, fast, fit, a, b):
        new = _after(slow, fast, fit, a, b)
        return np.array([*new, share(slow, fast, fit, *new)])

    return wrong


INJECT_MISTAKES = [
    (_with(lambda s, f, z, s1, f1: 1 - f1 / s1), "Right while scans fit badly. Where they fit better than usual, your "
     "share is negative: use max(0, ...)."),
    (_with(lambda s, f, z, s1, f1: _share(s, f)), "The share follows from the averages *after* this scan; you "
     "use those "
     "before it, so the alarm comes one scan late."),
    (_with(lambda s, f, z, s1, f1: _share(f1, s1)), "You inject where scans fit better than usual. It is 1 - "
     "fast / slow."),
    (_with(lambda s, f, z, s1, f1: f1 / s1), "That is the share to keep. The share to draw anew is what is "
     "missing to 1."),
    (_with(lambda s, f, z, s1, f1: min(1.0, f1 / s1)), "That is the share to keep. The share to draw anew is what is "
     "missing to 1."),
    (_with(lambda s, f, z, s1, f1: _share(s1, z)), "You compare a single scan with the slow average: one "
     "person in front "
     "of the scanner would scatter the cloud. Compare the fast average."),
    (_with(lambda s, f, z, s1, f1: max(0.0, s1 - f1)), "A difference depends on how well scans fit in this "
     "building at all. "
     "The share is relative: 1 - fast / slow."),
    (lambda s, f, z, a, b: np.array([*_after(s, f, z, b, a), _share(*_after(s, f, z, b, a))]), "The two rates "
     "have changed "
     "places: alpha_slow belongs to the slow average."),
    (lambda s, f, z, a, b: np.array([*_after(s, f, z, 1 - a, 1 - b), _share(*_after(s, f, z, 1 - a, 1 - b))]), "Your "
     "averages keep a share alpha of the past. They take a share alpha of the *new* value: old + alpha (fit - old)."),
    (lambda s, f, z, a, b: np.array([s + a * z, f + b * z, _share(s + a * z, f + b * z)]), "Your averages grow without "
     "end. The step goes towards fit: alpha (fit - old)."),
    (lambda s, f, z, a, b: np.array([z, z, 0.0]), "Both averages have forgotten their past: old + alpha (fit - old)."),
    (lambda s, f, z, a, b: np.array([s, f, _share(s, f)]), "The averages have not taken in this scan: old + alpha "
     "(fit - old)."),
    (lambda s, f, z, a, b: np.array([a * z, b * z, _share(a * z, b * z)]), "Where is the old average? It is "
     "old + alpha "
     "(fit - old)."),
]  # fmt: skip


def check_inject(theirs) -> Check:
    """Tell whether ``inject(slow, fast, fit, alpha_slow, alpha_fast)`` returns both averages and the share."""
    praise = "While all is well it is nothing, and a robot carried away is looked for everywhere."
    return compare(theirs, inject, INJECT_CASES, mistakes=INJECT_MISTAKES, praise=praise)
