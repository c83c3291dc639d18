"""Exercises of chapter 03."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pfslam_book.show.checks import Check, hint, in_full
from pfslam_book.show.exercise import Exercise

from pfslam.motion import motion_model
from pfslam.poses import wrap_angle

rngs = [np.random.default_rng(seed) for seed in range(4)]

# ---- 1: the Bayes filter on a ring of cells

CELLS = 15
STEP = {0: 0.1, 1: 0.8, 2: 0.1}
"""Told to move one cell, the robot slips and stays, moves one, or overshoots by one, with these probabilities."""


def predict_belief(belief, step):
    """Belief ``(cells,)`` after a move: each cell hands on its probability. The corridor runs round a courtyard."""
    return sum(probability * np.roll(belief, cells) for cells, probability in step.items())


def update_belief(belief, likelihood):
    """Belief ``(cells,)`` times the likelihood of what was seen, brought back to sum 1."""
    product = belief * likelihood
    return product / product.sum()


def track(move=predict_belief, look=update_belief, first=False):
    """A filter with its own way to move and to look, and with a move before the first look if asked for."""

    def rule(belief, looks, step):
        for k, seen in enumerate(looks):
            belief = move(belief, step) if k or first else belief
            belief = look(belief, seen)
        return belief

    return rule


def walk_case(rng, moves) -> tuple:
    """A belief, likelihoods ``(moves + 1, cells)`` and a step that overshoots more often than it slips."""
    return (
        rng.dirichlet(np.ones(CELLS)),
        rng.uniform(0.1, 0.9, (moves + 1, CELLS)),
        {0: 0.15, 1: 0.6, 2: 0.25},
    )


check_track = Exercise(
    right=track(),
    cases=[walk_case(rng, moves) for rng, moves in zip(rngs, (1, 3, 6), strict=False)],
    mistakes={
        "Right products, but they do not sum to 1. Divide by their sum at each look.": (
            track(look=lambda belief, seen: belief * seen)
        ),
        "You move before the first look. The robot looks first, then moves and looks in turn.": track(
            first=True
        ),
        "Your robot moves the wrong way: what is in cell i comes to cell i + 1.": (
            track(move=lambda belief, step: predict_belief(belief, {-cells: p for cells, p in step.items()}))
        ),
        "Your robot always moves by one cell. Sometimes it slips or overshoots: add up all the steps, each times its "
        "probability.": track(move=lambda belief, step: np.roll(belief, 1)),
        "The look replaces the belief. Multiply them: what was known before still counts.": (
            track(look=lambda belief, seen: seen / seen.sum())
        ),
    },
    praise="Predict and update in turn: a whole Bayes filter.",
)

# ---- 2: Eq. 11, on a cloud so large that chance hardly shows

START = np.repeat([[2.0, -1.0, 0.5], [-3.0, 0.7, 2.6]], 4000, axis=0)
NEAR = 0.1
"""How far the pictures of two equal clouds of this size may differ: at least four times what chance does."""


def body(moved) -> np.ndarray:
    """How far each particle went ahead and to its left (m), and how far it turned (rad): ``(3, n)``."""
    x, y, turned = (np.asarray(moved, dtype=float) - START).T
    c, s = np.cos(START[:, 2]), np.sin(START[:, 2])
    return np.round([x * c + y * s, y * c - x * s, wrap_angle(turned)], 9)


def portrait(motion, beside) -> np.ndarray:
    """Middle, spread and shape of a cloud, measured in the spread of the one beside it, and what its noises share."""
    size = np.maximum(beside.std(axis=1), 1e-9)[:, None]
    ahead, _, turned = (motion - beside.mean(axis=1)[:, None]) / size
    with np.errstate(invalid="ignore"):  # a cloud without noise has no correlation
        shared = np.corrcoef([ahead[::2], ahead[1::2], turned[::2], turned[1::2]])
        both = np.corrcoef(ahead, turned)[0, 1]
    of_each = [(z.mean(), z.std(), np.median(np.abs(z))) for z in (ahead, turned)]
    return np.array([*np.ravel(of_each), both, shared[0, 1], shared[2, 3]])


def same_cloud(found, expected) -> bool:
    """Whether two clouds from ``START`` are alike, but for chance."""
    a, b = body(found), body(expected)
    sideways = np.abs(a[1] - b[1]).max()
    return bool(sideways < 1e-4 and np.allclose(portrait(a, b), portrait(b, b), atol=NEAR, equal_nan=True))


def driven(sigmas=lambda v, omega, a, b: (a, b)):
    """A way to move particles with noise of its own size."""

    def rule(poses, v, omega, dt, sigma_v, sigma_omega, seed):
        rng, n = np.random.default_rng(seed), len(poses)
        a, b = sigmas(v, omega, sigma_v, sigma_omega)
        return motion_model(poses, v + a * rng.standard_normal(n), omega + b * rng.standard_normal(n), dt)

    return rule


moved = Exercise(
    right=driven(),
    cases=[
        (START, 0.7, -0.4, 0.13, 0.3, 0.5, 1),
        (START, 0.0, 0.3, 0.21, 0.4, 0.2, 2),
        (START, -0.5, 0.0, 0.1, 0.2, 0.35, 3),
    ],
    same=same_cloud,
    mistakes={
        "Your noise has the size of sigma squared. A sigma is a standard deviation already, which is what rng.normal "
        "asks for.": driven(lambda v, omega, a, b: (a**2, b**2)),
        "You take the root of sigma, as if it were a variance. It is a standard deviation already.": (
            driven(lambda v, omega, a, b: (a**0.5, b**0.5))
        ),
        "The noise on v is missing: all particles drive equally far. v and omega have noise each.": (
            driven(lambda v, omega, a, b: (0.0, b))
        ),
        "Where the robot stands, your noise is gone. Eq. 11 adds the same noise at any speed, also at 0.": (
            driven(lambda v, omega, a, b: (a * (v != 0), b * (v != 0)))
        ),
        "Your noise is a share of the control. Eq. 11 adds noise of the same size at any speed.": (
            driven(lambda v, omega, a, b: (a * abs(v), b * abs(omega)))
        ),
    },
    praise="Every particle drives by its own noisy control.",
)


def in_words(found, case) -> str:
    """What is most wrong with a cloud, beside what was expected."""
    if np.abs(np.asarray(found)[:, :2]).max() < 1.0:
        return "You return the steps alone. Add them to the old poses."
    found, expected = body(found), body(moved.right(*case))
    controls = "For v = {1:g}, omega = {2:g}, dt = {3:g}".format(*case)
    if (far := np.abs(found[1]).max()) > 1e-4:
        return (
            f"Some particles moved sideways, by up to {far:.3f} m. Eq. 5 drives each of them straight along its own "
            "old heading: use motion_model. Noise on v and omega keeps to that; noise on the pose does not."
        )
    if np.ptp(found[0]) < 1e-9 and np.ptp(found[2]) < 1e-9:
        return f"{controls} all particles move alike. Each needs numbers of its own, one for v and one for omega."
    for k, where, unit in ((0, "along the path", "m"), (2, "in heading", "rad")):
        for name, number in (("mean", np.mean), ("spread", np.std)):
            a, b = number(found[k]), number(expected[k])
            if not abs(a - b) < NEAR * expected[k].std():
                return (
                    f"{controls} the {name} of your cloud {where} is {a:.4f} {unit}; expected about {b:.4f}."
                )
    both, ahead, turned = portrait(found, expected)[-3:]
    if abs(both) > NEAR:
        return "A particle that drives too far also turns too much: you drew one number for both. Draw two."
    if max(ahead, turned) > NEAR:
        return "Several particles share one draw. Each needs numbers of its own."
    return "The noise has the right size and the wrong shape. Eq. 11 asks for Gaussian noise, without limits."


def check_predict(theirs: Callable) -> Check:
    """Whether ``predict(poses, v, omega, dt, sigma_v, sigma_omega, rng)`` is Eq. 11."""

    def cloud(*case):
        return in_full(theirs(*case[:-1], np.random.default_rng(case[-1])))

    verdict = moved(cloud)
    if verdict:
        poses, *controls, _ = moved.cases[0]
        once, again, other = (np.asarray(cloud(poses, *controls, seed)) for seed in (5, 5, 6))
        if not np.array_equal(once, again):
            return hint(
                "Twice the same rng, two results: draw from the rng that is given, not from np.random."
            )
        if np.array_equal(once, other):
            return hint(
                "Two rngs, one result: draw from the rng that is given, not from one with a seed of your own."
            )
    elif verdict.message.startswith("Not yet. For"):
        clouds = [(cloud(*case), case) for case in moved.cases]
        return hint(
            next(in_words(*pair) for pair in clouds if not same_cloud(pair[0], moved.right(*pair[1])))
        )
    return verdict


# ---- 3: how wide the headings are

check_heading_spread = Exercise(
    right=lambda sigma, rate, t: np.rad2deg(sigma * np.sqrt(t / rate)),
    cases=[(0.2, 50.0, 8.0), (0.13, 33.0, 61.0), (0.04, 12.0, 150.0), (0.3, 110.0, 20.0)],
    same=lambda found, expected: bool(np.isclose(found, expected, rtol=0.1)),  # simulated answers count, too
    mistakes={
        "That is a bias: the same error in every sample. Independent errors partly cancel; their variances add, not "
        "their sizes.": lambda sigma, rate, t: np.rad2deg(sigma * t),
        "The root of time is right, but where is the sample rate? Each sample turns the robot by tau times its "
        "noise.": lambda sigma, rate, t: np.rad2deg(sigma * np.sqrt(t)),
        "Each of the rate * seconds samples adds its noise times tau, the time that it lasts. You left out tau.": (
            lambda sigma, rate, t: np.rad2deg(sigma * np.sqrt(rate * t))
        ),
        "You took sigma_omega for a variance. It is a standard deviation.": (
            lambda sigma, rate, t: np.rad2deg(np.sqrt(sigma * t / rate))
        ),
        "That is the variance. The spread is its root.": lambda sigma, rate, t: np.rad2deg(
            sigma**2 * t / rate
        ),
    },
    praise="The spread grows with the root of time, and with the root of the sample interval.",
)
