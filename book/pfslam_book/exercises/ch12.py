"""Exercises of chapter 12."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

from pfslam.poses import between, compose, wrap_angle

# ---- 1: the error of an edge


def edge_case(pose_i, z) -> tuple:
    """A pose, another one near where it was measured from there, and the measurement."""
    return np.array(pose_i), compose(np.array(pose_i), np.array(z)) + [0.1, -0.2, 0.05], np.array(z)


def edge_error(a, b, z, frame=1.0, wrap=lambda turn, measured: wrap_angle(turn - measured)):
    """The error with the difference seen from a heading of ``frame`` times the first one."""
    c, s = np.cos(frame * a[2]), np.sin(frame * a[2])
    dx, dy, turn = np.subtract(b, a)
    return np.array([c * dx + s * dy - z[0], c * dy - s * dx - z[1], wrap(turn, z[2])])


check_edge_error = Exercise(
    right=edge_error,
    cases=[
        (np.array([1.0, 2.0, np.pi / 2]), np.array([1.0, 4.0, np.pi / 2]), np.array([1.9, 0.1, 0.0])),
        edge_case([0.3, -1.7, 0.9], [1.1, -0.4, 0.7]),
        edge_case([-2.6, 1.2, -2.1], [0.8, 0.5, -1.3]),
        (np.array([0.0, 1.0, 3.0]), np.array([-1.0, 1.3, -2.8]), np.array([1.0, 0.2, 0.4])),
        (np.array([0.2, 0.4, 0.0]), np.array([1.1, 0.5, 3.1]), np.array([0.9, 0.2, -3.1])),
    ],
    mistakes={
        "The difference of the positions is in the world. Turn it into the frame of pose i, in which z was measured.": (
            lambda a, b, z: edge_error(a, b, z, frame=0.0)
        ),
        "You turn by +theta_i. From the world into the frame of pose i it is the transpose.": (
            lambda a, b, z: edge_error(a, b, z, frame=-1.0)
        ),
        "The heading must be wrapped into (-pi, pi]: see the pose that looks backwards.": (
            lambda a, b, z: edge_error(a, b, z, wrap=np.subtract)
        ),
        "You wrap the turn and then subtract the measured one, which leads out of (-pi, pi] again: 3.1 - (-3.1) is "
        "6.2. Subtract first, wrap last.": (
            lambda a, b, z: edge_error(a, b, z, wrap=lambda turn, measured: wrap_angle(turn) - measured)
        ),
        "Close: that is the error in the frame of the measured pose. Here the two are subtracted.": (
            lambda a, b, z: between(z, between(a, b))
        ),
    },
    praise="All that a pose graph minimises is a sum of such errors, each weighed by its information.",
)

# ---- 2: the weight under a robust kernel

check_robust_weight = Exercise(
    right=lambda chi2, k: (k**2 / (k**2 + chi2)) ** 2,
    cases=[
        (np.array([0.0, 1.0, 9.0, 100.0, 1e6]), 3.0),
        (np.array([2.0, 50.0, 7.0]), 10.0),
        (np.array([4.0]), 0.5),
    ],
    mistakes={
        "That fraction must be squared. Unsquared, the cost never levels off.": lambda chi2, k: (
            k**2 / (k**2 + chi2)
        ),
        "That is the kernel, the cost. The weight is its derivative by chi^2.": (
            lambda chi2, k: k**2 * chi2 / (k**2 + chi2)
        ),
        "The width enters squared, as chi does.": lambda chi2, k: (k / (k + chi2)) ** 2,
        "chi2 is squared already.": lambda chi2, k: (k**2 / (k**2 + chi2**2)) ** 2,
        "A hard threshold. The kernel lets go little by little, so that a later step may still believe a loop.": (
            lambda chi2, k: (chi2 < k**2).astype(float)
        ),
    },
    praise="An error of one width keeps a quarter of its weight; one of ten widths a ten-thousandth.",
)

# ---- 3: another Jacobian


def landmark_jacobian(pose, landmark, frame=1.0, arm=1.0, world=False, robot=-1.0):
    """Derivatives (2, 5) of R^T (l - p) - z for x, y, theta and the landmark, or with one sign or frame changed."""
    c, s = np.cos(frame * pose[2]), np.sin(frame * pose[2])
    turned, (dx, dy) = np.array([[c, s], [-s, c]]), np.subtract(landmark, pose[:2])
    x, y = (dx, dy) if world else turned @ [dx, dy]
    return np.column_stack([robot * turned, [arm * y, -arm * x], turned])


def landmark_mistake(**change):
    """A Jacobian with one thing wrong."""
    return lambda *case: landmark_jacobian(*case, **change)


check_landmark_jacobian = Exercise(
    right=landmark_jacobian,
    cases=[
        (np.array([0.4, -1.2, 0.7]), np.array([2.1, 0.9])),
        (np.array([-1.3, 0.6, -2.4]), np.array([0.2, -3.1])),
    ],
    mistakes={
        "A turn of the robot moves the landmark, too, as the robot sees it: the third column is not zero.": (
            landmark_mistake(arm=0.0)
        ),
        "The third column has the wrong sign: who turns left sees the landmark move to the right.": (
            landmark_mistake(arm=-1.0)
        ),
        "You turn by +theta. From the world into the robot's frame it is the transpose.": landmark_mistake(
            frame=-1.0
        ),
        "The third column holds the landmark as the robot sees it, (y, -x) in its own frame.": (
            landmark_mistake(world=True)
        ),
        "If the robot moves ahead, the landmark comes nearer: the first two columns have a minus.": (
            landmark_mistake(robot=1.0)
        ),
    },
    praise="With such edges door frames become unknowns beside the poses: that is how landmarks enter a graph.",
)
