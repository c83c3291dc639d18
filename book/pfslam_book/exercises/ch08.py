"""Exercises of chapter 08."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pfslam_book.show.checks import Check, hint, is_unanswered, passed, unanswered
from pfslam_book.show.exercise import Exercise

from pfslam.particles import multinomial_resample, stratified_resample, systematic_resample

# ---- 1: a test of a resampler


def right(rows):
    """A resampler that draws the rows by some scheme and gives all of them one weight."""
    return lambda poses, weights, rng: (poses[rows(weights, rng)], np.full(len(poses), 1 / len(poses)))


def keeps_weights(poses, weights, rng):
    rows = systematic_resample(weights, rng)
    return poses[rows], weights[rows] / weights[rows].sum()


def tears_rows(poses, weights, rng):
    rows, others = (rng.permutation(systematic_resample(weights, rng)) for _ in range(2))
    return np.column_stack([poses[rows, :2], poses[others, 2]]), np.full(len(poses), 1 / len(poses))


BROKEN = {
    "that does not look at the weights": right(lambda w, rng: rng.integers(0, len(w), len(w))),
    "that hands the cloud back as it was": right(lambda w, rng: np.arange(len(w))),
    "that copies the heaviest particle N times": right(lambda w, rng: np.full(len(w), np.argmax(w))),
    "that draws well and keeps the old weights": keeps_weights,
    "that draws positions and headings separately, so that rows are torn": tears_rows,
}
SOUND = {
    "that is right, systematic": right(systematic_resample),
    "that is right, stratified": right(stratified_resample),
    "that is right, multinomial": right(multinomial_resample),
}


def resamplers():
    for words, function in (SOUND | BROKEN).items():

        def called(poses, weights, rng, function=function):
            return function(np.asarray(poses, dtype=float), np.asarray(weights, dtype=float), rng)

        called.words = f"= one {words}"  # type: ignore[attr-defined]
        yield called


POSES = np.column_stack([np.arange(5.0), 10.0 + np.arange(5.0), 0.1 * np.arange(5.0)])
WEIGHTS = np.array([0.4, 0.3, 0.2, 0.1, 0.0])


def wrong_offspring(resample, calls=500):
    """Whether the particles have other numbers of children than N w, on average."""
    rng = np.random.default_rng(0)
    first = np.concatenate([resample(POSES, WEIGHTS, rng)[0][:, 0] for _ in range(calls)]).astype(int)
    return not np.allclose(np.bincount(first, minlength=5) / calls, 5 * WEIGHTS, atol=0.2)


def wrong_weights(resample):
    return not np.allclose(resample(POSES, WEIGHTS, np.random.default_rng(0))[1], 0.2)


check_looks_broken = Exercise(
    right=lambda resample: any(words in resample.words for words in BROKEN),
    cases=[(resample,) for resample in resamplers()],
    mistakes={
        "Your test accuses every resampler, the right ones too. One call is chance: average the offspring over "
        "hundreds of calls, and allow for the chance that remains in an average.": lambda resample: True,
        "Your test lets every resampler pass.": lambda resample: False,
        "You look at the weights that come back. Count the offspring of each particle over many calls, too: on "
        "average particle i has N w_i.": wrong_weights,
        "You count the offspring, which is right. Look at the weights that come back, too, and ask of each new row "
        "whether it was a row of the old cloud as a whole.": wrong_offspring,
        "Your test lets one pass that draws positions and headings separately: ask whether each new row was a row of "
        "the old cloud.": lambda resample: wrong_weights(resample) or wrong_offspring(resample),
    },
    praise="Three right resamplers pass, five broken ones are caught.",
)

# ---- 2: a clock offset by sharpness


class Curve:
    """A made-up count of cells over the clock's shift (s), with its least value at ``best``."""

    words = "that count a map's cells"

    def __init__(self, best: float):
        self.best = best

    def __call__(self, shift):
        away = np.abs(np.asarray(shift, dtype=float) - self.best)
        return 4400.0 + 30000.0 * away / (1.0 + 2.0 * away)


def least(low=-0.3, high=0.3, step=0.01, pick=np.argmin):
    """The best shift between two limits, in steps."""
    shifts = np.arange(low, high + 1e-4, step)
    return lambda cells: shifts[pick(cells(shifts))]


check_find_shift = Exercise(
    right=lambda cells: cells.best,
    cases=[(Curve(best),) for best in (-0.137, 0.074, 0.226, -0.274)],
    mistakes={
        "That is by how much the clock is wrong. Asked is the shift that you handed to cells, which puts it right: "
        "the other sign.": lambda cells: -cells.best,
        "You take the largest number of cells, so the most blurred map. Sharp walls need few cells.": (
            least(pick=np.argmax)
        ),
        "The right valley, but your steps of 0.05 s are too coarse: 10 ms at 1 rad/s is half a degree. Search once "
        "more around the best, in steps of 0.01 s.": least(step=0.05),
        "You never try negative shifts. A clock may be late or early.": least(low=0.0),
        "That is the place of the shift in your list. Return the shift itself.": (
            lambda cells: 100 * (least()(cells) + 0.3)
        ),
    },
    praise="Within a hundredth of a second.",
    same=lambda found, expected: bool(np.abs(np.asarray(found, dtype=float) - expected) < 0.0101),
)

# ---- 3: four robots. No function is asked for, and the hint depends on the robot's numbers.

RULED_OUT = {
    "clock": ("delay [s]", "a wrong clock shows as a delay of many hundredths of a second"),
    "lever arm": ("lever [m]", "a wrong lever arm shows as a lever error of decimetres"),
    "track": ("turn ratio", "yaw from the wheels shows as a turn ratio near 1.9"),
    "renumbered beams": ("cut scans", "renumbered scans all miss their last beams, a share near 1"),
    "lost second": ("metres lost", "a lost second shows as metres that the wheels turned and the path lacks"),
}


def check_diagnosis(diagnosis, robots: Sequence) -> Check:
    """Tell whether ``diagnosis`` names the fault of every robot: a dictionary from letter to name."""
    if is_unanswered(diagnosis) or (isinstance(diagnosis, dict) and is_unanswered(list(diagnosis.values()))):
        return unanswered()
    letters = [r.letter for r in robots]
    if not isinstance(diagnosis, dict) or set(diagnosis) != set(letters):
        return hint(f"A dictionary with the letters {', '.join(letters)} is asked for.")
    for robot in robots:
        if diagnosis[robot.letter] not in ("healthy", *RULED_OUT):
            return hint(f"{diagnosis[robot.letter]!r} is none of {', '.join(('healthy', *RULED_OUT))}.")
        if diagnosis[robot.letter] != robot.fault:
            return hint(_objection(robot, diagnosis[robot.letter]))
    return passed("All robots named. Another seed makes other robots.")


def _objection(robot, answer: str) -> str:
    """The number that rules a wrong answer out."""
    if answer == "healthy" or robot.fault in ("track", "renumbered beams"):
        column = RULED_OUT[robot.fault][0]
        upstream = "" if answer == "healthy" else "such a fault bends every fit that comes after it: "
        return f"Robot {robot.letter}: {upstream}look at its {column} first. Here it is {robot.numbers[column]:.2f}."
    column, sign = RULED_OUT[answer]
    return f"Robot {robot.letter} has no {answer} fault: {sign}, and here {column} is {robot.numbers[column]:.2f}."
