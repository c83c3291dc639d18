"""Checks of the exercises of chapter 12: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.checks import Check, compare

from pfslam.poses import between, compose, wrap_angle


def edge_error(pose_i, pose_j, z):
    """Return what two poses say about a motion less what was measured, in the frame of the first."""
    return _error(pose_i, pose_j, z)


def _error(a, b, z, turn=1.0, wrapped=True, frame=True, minus=True):
    c, s = np.cos(a[2]), turn * np.sin(a[2])
    d = np.subtract(b, a)
    xy = np.array([c * d[0] + s * d[1], c * d[1] - s * d[0]]) if frame else d[:2]
    yaw = d[2] - (z[2] if minus else 0.0)
    return np.append(xy - (z[:2] if minus else 0.0), wrap_angle(yaw) if wrapped else yaw)


def _edge_cases() -> list[tuple]:
    rng = np.random.default_rng(4)
    cases = [(np.array([1.0, 2.0, np.pi / 2]), np.array([1.0, 4.0, np.pi / 2]), np.array([1.9, 0.1, 0.0]))]
    for _ in range(3):
        a, z = rng.normal(0.0, 2.0, 3), rng.normal(0.0, 1.0, 3)
        cases.append((a, compose(a, z) + [0.1, -0.2, 0.05], z))
    a, z = np.array([0.0, 1.0, 3.0]), np.array([1.0, 0.2, 0.4])
    return [*cases, (a, compose(a, z) + [0.1, 0.1, 0.1], z)]


def _by_between(a, b, z):
    return between(z, between(a, b))


EDGE_MISTAKES = [
    (lambda a, b, z: -_error(a, b, z), "The sign: what the poses say, less what was measured."),
    (lambda a, b, z: _error(a, b, z, frame=False), "The difference of the positions is in the world. Turn it into the "
     "frame of pose i, in which z was measured."),
    (lambda a, b, z: _error(a, b, z, turn=-1.0), "You turn by +theta_i. From the world into the frame of pose i it is "
     "the transpose."),
    (lambda a, b, z: _error(a, b, z, wrapped=False), "The heading must be wrapped into (-pi, pi]: see the pose that "
     "looks backwards."),
    (lambda a, b, z: _error(a, b, z, minus=False), "That is the motion that the poses say. The measured one must be "
     "taken away."),
    (lambda a, b, z: _error(b, a, z), "You took pose i seen from pose j. z is pose j seen from pose i."),
    (_by_between, "Close: that is the error in the frame of the measured pose. Here the two are subtracted."),
    (lambda a, b, z: np.array([*_error(a, b, z)[:2], wrap_angle(b[2] - a[2])]), "The measured turn must be taken away "
     "from the heading, too."),
]  # fmt: skip


def check_edge_error(theirs) -> Check:
    """Tell whether ``edge_error(pose_i, pose_j, z)`` is the residual of one edge of the graph."""
    praise = "All that a pose graph minimises is a sum of such errors, each weighed by its information."
    return compare(theirs, edge_error, _edge_cases(), mistakes=EDGE_MISTAKES, praise=praise)


def robust_weight(chi2, k):
    """Return the weight of a squared error under Geman and McClure's kernel of width k."""
    return (k**2 / (k**2 + np.asarray(chi2))) ** 2


def _weight_cases() -> list[tuple]:
    return [
        (np.array([0.0, 1.0, 9.0, 100.0, 1e6]), 3.0),
        (np.array([2.0, 50.0, 7.0]), 10.0),
        (np.array([4.0]), 0.5),
    ]


WEIGHT_MISTAKES = [
    (lambda c, k: k**2 / (k**2 + c), "That fraction must be squared. Unsquared, the cost never levels off."),
    (lambda c, k: k**2 * c / (k**2 + c), "That is the kernel, the cost. The weight is its derivative by chi^2."),
    (lambda c, k: (k / (k + c)) ** 2, "The width enters squared, as chi does."),
    (lambda c, k: (k**2 / (k**2 + c**2)) ** 2, "chi2 is squared already."),
    (lambda c, k: (c / (k**2 + c)) ** 2, "Turned round: this weighs large errors more. k^2 belongs above the line."),
    (lambda c, k: (c < k**2).astype(float), "A hard threshold. The kernel lets go gradually, so that steps can change "
     "their minds."),
    (lambda c, k: np.ones_like(c), "Every weight is 1: that is no kernel at all."),
    (lambda c, k: np.minimum(1.0, k / np.sqrt(np.maximum(c, 1e-12))), "That is Huber's weight, which never quite lets "
     "an error go. Here it falls with the fourth power of chi."),
    (lambda c, k: np.exp(-c / (2 * k**2)), "That is Welsch's kernel, a Gaussian. Take the fraction of the formula."),
]  # fmt: skip


def check_robust_weight(theirs) -> Check:
    """Tell whether ``robust_weight(chi2, k)`` is the weight under Geman and McClure's kernel."""
    praise = "An error of one width keeps a quarter of its weight; one of ten widths a ten-thousandth."
    return compare(theirs, robust_weight, _weight_cases(), mistakes=WEIGHT_MISTAKES, praise=praise)
