"""Exercises of chapter 10."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

# ---- 1: how many particles


def bound(k, epsilon, z, power=3):
    """Fox's bound for k degrees of freedom."""
    return k / (2 * epsilon) * (1 - 2 / (9 * k) + np.sqrt(2 / (9 * k)) * z) ** power


def particles_needed(bins, epsilon, z):
    return bound(bins - 1, epsilon, z)


check_particles_needed = Exercise(
    right=particles_needed,
    cases=[(8, 0.05, 2.326), (120, 0.05, 2.326), (37, 0.02, 1.282), (1000, 0.11, 0.674), (3, 0.4, 1.1)],
    mistakes={
        "You use the number of bins. Shares that sum to 1 leave one fewer to choose: bins - 1 degrees of freedom, "
        "wherever k stands.": bound,
        "The bracket is to be cubed: Wilson and Hilferty found the cube *root* of a chi-square nearly normal.": (
            lambda bins, epsilon, z: bound(bins - 1, epsilon, z, power=1)
        ),
        "That is the mean of the chi-square over 2 epsilon: half of all clouds would be worse than epsilon. The "
        "bracket makes it a quantile.": lambda bins, epsilon, z: (bins - 1) / (2 * epsilon),
        "The term with z is added: to be surer takes more particles, not fewer.": (
            lambda bins, epsilon, z: bound(bins - 1, epsilon, -z)
        ),
        "That is the right number, rounded up. A filter would do so; here return the bound as it is.": (
            lambda *case: np.ceil(particles_needed(*case))
        ),
    },
    praise="Ten thousand for a cloud over the whole building, a few hundred once it is one heap.",
)

# ---- 2: how many to draw anew


def missing(slow, fast):
    return max(0.0, 1 - fast / slow)


def injecting(share):
    """One step, with some share of the averages before it, of the fit, and of the averages after it."""

    def inject(slow, fast, fit, alpha_slow, alpha_fast):
        new = slow + alpha_slow * (fit - slow), fast + alpha_fast * (fit - fast)
        return np.array([*new, share((slow, fast), fit, new)])

    return inject


inject = injecting(lambda old, fit, new: missing(*new))

check_inject = Exercise(
    right=inject,
    cases=[
        (0.9, 0.8, 0.31, 0.01, 0.2),
        (0.62, 0.83, 0.95, 0.05, 0.3),
        (0.7, 0.75, 0.2, 0.02, 0.5),
        (0.9, 0.93, 0.94, 0.01, 0.2),
    ],
    mistakes={
        "Right while scans fit badly. Where they fit better than usual, your share is negative: use max(0, ...).": (
            injecting(lambda old, fit, new: 1 - new[1] / new[0])
        ),
        "The share follows from the averages *after* this scan; you use those before it, so the alarm comes one scan "
        "late.": injecting(lambda old, fit, new: missing(*old)),
        "You compare a single scan with the slow average: one person in front of the scanner would scatter the cloud. "
        "Compare the fast average.": injecting(lambda old, fit, new: missing(new[0], fit)),
        "That is the share to keep. The share to draw anew is what is missing to 1.": (
            injecting(lambda old, fit, new: min(1.0, new[1] / new[0]))
        ),
        "The two rates have changed places: alpha_slow belongs to the slow average.": (
            lambda slow, fast, fit, a, b: inject(slow, fast, fit, b, a)
        ),
    },
    praise="While all is well it is nothing, and a robot carried away is looked for everywhere.",
)
