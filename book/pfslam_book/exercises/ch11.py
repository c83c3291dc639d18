"""Exercises of chapter 11, and the two functions of its filter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pfslam_book.show.checks import Check, is_unanswered, same_numbers
from pfslam_book.show.exercise import Exercise
from pfslam_book.show.keep import giving

from pfslam.poses import wrap_angle

# ---- 1: a step


def predict(x, P, d, turn, Q, at=None, *, column=1.0, transpose=False, noise=1.0, cross=True, first=0.0):
    """Move the robot, the first three numbers of ``x (n,)``, by a way ``d`` (m) and a ``turn`` (rad) of covariance Q.

    Derivatives are taken at ``x``, or ``at`` another state; the rest are the mistakes of the exercise.
    """
    theta = (x if at is None else at)[2] + first * turn
    c, s = np.cos(theta), np.sin(theta)
    F, G = np.eye(len(x)), np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
    F[:2, 2] = -column * d * s, column * d * c
    F = F.T if transpose else F
    new = F @ P @ F.T
    if not cross:
        new[:3, 3:], new[3:, :3] = P[:3, 3:], P[3:, :3]
    new[:3, :3] += noise * G @ Q @ G.T
    way = x[2] + first * turn
    moved = np.concatenate([x[:3] + [d * np.cos(way), d * np.sin(way), turn], x[3:]])
    moved[2] = wrap_angle(moved[2])
    return moved, new


# ---- 2: a look at a post


def update(x, P, z, i, R, at=None, *, wrap=wrap_angle, sign=1.0, noise=1.0, post=1.0, heading=1.0):
    """Correct mean and covariance by range and bearing ``z`` of the post at ``x[i : i + 2]``.

    Derivatives are taken at ``x``, or ``at`` another state; the rest are the mistakes of the exercise.
    """
    dx, dy = x[i : i + 2] - x[:2]
    e = sign * (z - np.array([np.hypot(dx, dy), np.arctan2(dy, dx) - heading * x[2]]))
    e[1] = wrap(e[1])
    if at is not None:
        dx, dy = at[i : i + 2] - at[:2]
    r, H = np.hypot(dx, dy), np.zeros((2, len(x)))
    toward, across = np.array([dx, dy]) / r, np.array([-dy, dx]) / r**2
    H[:, :2], H[:, i : i + 2], H[1, 2] = [-toward, -across], [post * toward, post * across], -heading
    PHt = P @ H.T
    K = PHt @ np.linalg.inv(H @ PHt + noise * R)
    x = x + K @ e
    x[2] = wrap_angle(x[2])
    return x, P - K @ PHt.T


def stacked(function: Callable) -> Callable:
    """The same function with mean and covariance in one array ``(1 + n, n)``."""

    def one(*case):
        answer = function(*case)
        return ... if is_unanswered(answer) else np.vstack([np.asarray(part, dtype=float) for part in answer])

    return one


def same_belief(found, expected) -> bool:
    """Whether two beliefs agree, the heading on the circle."""
    found, expected = np.array(found, dtype=float), np.asarray(expected)
    if found.shape != expected.shape:
        return False
    found[0, 2] = expected[0, 2] + wrap_angle(found[0, 2] - expected[0, 2])
    return same_numbers(found, expected)


def belief(seed: int, heading: float) -> tuple:
    """Give a mean of one robot and two posts, and a full covariance."""
    rng = np.random.default_rng(seed)
    A = 0.4 * rng.standard_normal((7, 7))
    return np.array([1.2, -0.7, heading, 3.1, 1.4, -2.3, 0.6]), A @ A.T + 0.05 * np.eye(7)


def step_mistake(**change) -> Callable:
    """A step with one thing wrong."""
    return stacked(lambda *case: predict(*case, **change))


def look_mistake(**change) -> Callable:
    """A look with one thing wrong."""
    return stacked(lambda *case: update(*case, **change))


predicted = Exercise(
    right=stacked(predict),
    cases=[
        (*belief(1, 0.7), 0.9, 0.4, np.diag([0.04, 0.02])),
        (*belief(2, -2.1), 0.3, -0.8, np.array([[0.03, 0.01], [0.01, 0.05]])),
    ],
    mistakes={
        "The noise of this step is missing: add G Q G^T to the robot's own block.": step_mistake(noise=0.0),
        "F stands on the wrong side: the new covariance is F P F^T, and you have F^T P F.": step_mistake(
            transpose=True
        ),
        "The third column of F has the wrong sign: who looks along x and turns left ends farther to the left.": (
            step_mistake(column=-1.0)
        ),
        "You move the robot's own block only. What ties it to the posts, P[:3, 3:], is multiplied by F, too.": (
            step_mistake(cross=False)
        ),
        "The heading is turned first. Eq. 5 drives along the old heading, and F and G are taken there.": (
            step_mistake(first=1.0)
        ),
    },
    praise="The step changed the robot's block and its covariances with the posts, and left the posts alone.",
    same=same_belief,
)
looked = Exercise(
    right=stacked(update),
    cases=[
        (*belief(3, 0.7), np.array([2.9, 0.3]), 3, np.diag([0.01, 0.002])),
        (*belief(4, -2.5), np.array([3.5, -1.1]), 5, np.diag([0.03, 0.004])),
        (*belief(5, 2.9), np.array([2.5, -2.4]), 3, np.array([[0.02, 0.001], [0.001, 0.003]])),
    ],
    mistakes={
        "The innovation of the bearing must be wrapped into (-pi, pi]: 3.1 and -3.1 are neighbours.": look_mistake(
            wrap=lambda angle: angle
        ),
        "The innovation has the wrong sign: measured less expected.": look_mistake(sign=-1.0),
        "S lacks R. So the sight counts as free of error, and the gain is too large.": look_mistake(
            noise=0.0
        ),
        "H has no entries for the post. So the map is frozen in it, and all of the error is put on the robot.": (
            look_mistake(post=0.0)
        ),
        "A bearing is measured from the robot's heading. Subtract it, and H has a -1 there.": look_mistake(
            heading=0.0
        ),
    },
    praise="One look at one post has moved all numbers that are correlated with it.",
    same=same_belief,
)


def check_predict(theirs: Callable) -> Check:
    """Whether ``predict(x, P, d, turn, Q)`` gives mean and covariance after a step."""
    return predicted(stacked(theirs))


def check_update(theirs: Callable) -> Check:
    """Whether ``update(x, P, z, i, R)`` gives mean and covariance after a look."""
    return looked(stacked(theirs))


def yours(own_predict: Callable, own_update: Callable) -> tuple[Callable, Callable]:
    """Return the reader's two functions, and the printed solution in the place of one that does not pass its check."""
    chosen = []
    for name, check, own, printed in (
        ("predict", check_predict, own_predict, predict),
        ("update", check_update, own_update, update),
    ):
        right = bool(check(own))
        print(f"{name}: {'yours' if right else 'the printed solution'}")
        chosen.append(giving(own, float, float) if right else printed)
    return chosen[0], chosen[1]


# ---- 3: which post was it?


def which_post(
    z, expected, S, gate, wrap=wrap_angle, size=lambda e, S: e @ np.linalg.solve(S, e), open_gate=False
):
    """The number of the post that explains a sight best, or -1."""
    apart = []
    for h, cov in zip(np.asarray(expected), np.asarray(S), strict=True):
        e = np.array([z[0] - h[0], wrap(z[1] - h[1])])
        apart.append(size(e, cov))
    best = int(np.argmin(apart))
    return best if open_gate or apart[best] <= gate else -1


THREE = np.array([[3.0, 0.4], [3.5, 0.9], [2.0, -3.0]])
WIDE = np.array([[[0.01, 0.0], [0.0, 0.001]], [[0.4, 0.25], [0.25, 0.2]], [[0.02, 0.01], [0.01, 0.09]]])

check_which_post = Exercise(
    right=which_post,
    cases=[
        (np.array([3.05, 0.6]), THREE, WIDE, 9.21),
        (np.array([2.02, 3.05]), THREE, WIDE, 9.21),
        (np.array([2.9, -1.9]), THREE, WIDE, 9.21),
        (np.array([3.02, 0.41]), THREE[:2], WIDE[:2], 9.21),
        (np.array([4.5, 0.3]), THREE, WIDE, 9.21),
    ],
    mistakes={
        "You compare metres and radians as they are. Divide by what is expected of each: e^T S^-1 e.": (
            lambda z, expected, S, gate: which_post(z, expected, S, gate, size=lambda e, S: np.sqrt(e @ e))
        ),
        "The difference of the bearings must be wrapped into (-pi, pi].": (
            lambda z, expected, S, gate: which_post(z, expected, S, gate, wrap=lambda angle: angle)
        ),
        "If no post is below the gate, the answer is -1: it may be a post that the map does not hold yet.": (
            lambda z, expected, S, gate: which_post(z, expected, S, gate, open_gate=True)
        ),
        "S has entries beside its diagonal, and you leave them out.": (
            lambda z, expected, S, gate: which_post(
                z, expected, S, gate, size=lambda e, S: e**2 @ (1 / np.diag(S))
            )
        ),
    },
    praise="You chose the nearest post, measured by S. If none is near enough, no post is safer than a wrong one.",
)
