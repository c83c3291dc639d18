"""Exercises of chapter 10."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

# ---- 1: how many particles

BIN = (0.5, 0.5, np.deg2rad(10.0))


def bound(k, epsilon, z, power=3):
    """Fox's bound for k degrees of freedom."""
    return k / (2 * epsilon) * (1 - 2 / (9 * k) + np.sqrt(2 / (9 * k)) * z) ** power if k else 0.0


def drawn(enough=lambda bins, epsilon, z: bound(bins - 1, epsilon, z), cell=np.floor, at_least=True):
    """Take pose after pose, with some bound for the number of bins, and some way to find a bin."""

    def particles_needed(poses, epsilon, z, least):
        bins = set()
        for n, pose in enumerate(poses, start=1):
            bins.add(tuple(cell(pose / np.array(BIN))))
            if n >= max(enough(len(bins), epsilon, z), least if at_least else 1):
                return n
        return len(poses)

    return particles_needed


particles_needed = drawn()


def bins_of_all(poses, epsilon, z, least):
    bins = len(np.unique(np.floor(poses / np.array(BIN)), axis=0))
    return min(len(poses), max(int(np.ceil(bound(bins - 1, epsilon, z))), least))


def cloud_case(seed, n, sigmas, *rest):
    return (np.random.default_rng(seed).normal(0.0, sigmas, (n, 3)), *rest)


check_particles_needed = Exercise(
    right=particles_needed,
    cases=[
        cloud_case(1, 300, (0.6, 0.5, 0.3), 0.3, 1.282, 20),
        cloud_case(2, 200, (0.1, 0.1, 0.02), 0.4, 0.674, 60),
        cloud_case(3, 400, (0.4, 0.9, 0.2), 0.11, 2.326, 10),
        cloud_case(4, 500, (0.5, 0.3, 0.4), 0.2, 1.645, 30),
        cloud_case(5, 150, (5.0, 5.0, 1.5), 0.05, 2.326, 50),
    ],
    mistakes={
        "Each of your numbers is the bound for the bins of *all* poses, rounded up. You may stop earlier: the number "
        "must be a whole one, at least the bound for the bins that the poses so far lie in.": bins_of_all,
        "You use the number of bins. Shares that sum to 1 leave one fewer to choose: k - 1 degrees of freedom, "
        "wherever k - 1 stands.": drawn(bound),
        "The bracket is to be cubed: Wilson and Hilferty found the cube *root* of a chi-square nearly normal.": (
            drawn(lambda bins, epsilon, z: bound(bins - 1, epsilon, z, power=1))
        ),
        "You stop below `least` where the bound is small. Take the larger of the two.": drawn(at_least=False),
        "int() and trunc() round towards zero, so the bins beside zero are twice as wide. Use np.floor.": (
            drawn(cell=np.trunc)
        ),
    },
    praise="Later poses fill hardly any new bin: the bound stands still, and the number reaches it.",
)

# ---- 2: how many to draw anew


def missing(slow, fast):
    return max(0.0, 1 - fast / slow)


def injecting(share, begin=lambda first: (0.9, first)):
    """All scans, with some share of the averages before each, of its fit, and of the averages after it.

    ``begin`` gives both averages before the first scan, from its fit.
    """

    def inject(fits, alpha_slow, alpha_fast):
        shares, old = [], begin(fits[0])
        for fit in fits:
            new = old[0] + alpha_slow * (fit - old[0]), old[1] + alpha_fast * (fit - old[1])
            shares.append(share(old, fit, new))
            old = new
        return np.array(shares)

    return inject


inject = injecting(lambda old, fit, new: missing(*new))


def fits_case(seed, *levels):
    return np.repeat(levels, 4) + np.random.default_rng(seed).normal(0.0, 0.02, 4 * len(levels))


check_inject = Exercise(
    right=inject,
    cases=[
        (fits_case(1, 0.3, 0.8, 0.95), 0.01, 0.2),
        (fits_case(2, 0.95, 0.3, 0.9), 0.05, 0.3),
        (fits_case(3, 0.93, 0.96, 0.2), 0.02, 0.5),
    ],
    mistakes={
        "Right while scans fit badly. Where they fit better than usual, your share is negative: use max(0, ...).": (
            injecting(lambda old, fit, new: 1 - new[1] / new[0])
        ),
        "The share follows from the averages *after* a scan; you use those before it, so the alarm comes one scan "
        "late.": injecting(lambda old, fit, new: missing(*old)),
        "You compare a single scan with the slow average: one person in front of the scanner would scatter the cloud. "
        "Compare the fast average.": injecting(lambda old, fit, new: missing(new[0], fit)),
        "That is the share to keep. The share to draw anew is what is missing to 1.": (
            injecting(lambda old, fit, new: min(1.0, new[1] / new[0]))
        ),
        "The two rates have changed places: alpha_slow belongs to the slow average.": (
            lambda fits, a, b: inject(fits, b, a)
        ),
        "Your slow average begins at the first fit, so a robot that is lost from the start raises no alarm. It begins "
        "at 0.9, which a right pose reaches.": (
            injecting(lambda old, fit, new: missing(*new), begin=lambda first: (first, first))
        ),
        "Your fast average begins at 0.9. It begins at the first fit, so a first scan that fits badly raises the alarm "
        "at once.": (injecting(lambda old, fit, new: missing(*new), begin=lambda first: (0.9, 0.9))),
    },
    praise="While all is well it is nothing, and a robot carried away is looked for everywhere.",
)
