"""Checks of the exercises of chapter 08. Each takes the student's answer and says what is wrong in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pfslam_book.ch08.mystery import FAULTS, MysteryRobot
from pfslam_book.show.checks import Check, attempt, compare, hint, is_unanswered, passed, unanswered

from pfslam.particles import multinomial_resample, stratified_resample, systematic_resample

Resampler = Callable[[np.ndarray, np.ndarray, np.random.Generator], tuple[np.ndarray, np.ndarray]]


def _right(draw: Callable) -> Resampler:
    def resample(poses, weights, rng):
        return poses[draw(weights, rng)], np.full(len(poses), 1 / len(poses))

    return resample


def _kept(poses, weights, rng):
    rows = systematic_resample(weights, rng)
    return poses[rows], weights[rows] / weights[rows].sum()


def _torn(poses, weights, rng):
    rows, others = (rng.permutation(systematic_resample(weights, rng)) for _ in range(2))
    return np.column_stack([poses[rows, :2], poses[others, 2]]), np.full(len(poses), 1 / len(poses))


def _deaf(poses, weights, rng):
    return poses[rng.integers(0, len(poses), len(poses))], np.full(len(poses), 1 / len(poses))


def _idle(poses, weights, rng):
    return poses.copy(), np.full(len(poses), 1 / len(poses))


def _best(poses, weights, rng):
    return np.tile(poses[np.argmax(weights)], (len(poses), 1)), np.full(len(poses), 1 / len(poses))


GOOD = {
    "systematic": _right(systematic_resample),
    "stratified": _right(stratified_resample),
    "multinomial": _right(multinomial_resample),
}
BAD: dict[str, tuple[Resampler, str]] = {
    "deaf": (
        _deaf,
        "draws without looking at the weights: count the offspring of each particle over many calls.",
    ),
    "idle": (_idle, "hands the cloud back as it was: count the offspring of each particle over many calls."),
    "best": (_best, "copies the heaviest particle N times: the mean offspring of particle i must be N w_i."),
    "kept": (_kept, "draws well and keeps the old weights: look at the weights that come back, too."),
    "torn": (_torn, "draws positions and headings separately: look whether whole rows were rows before."),
}


def check_looks_broken(looks_broken) -> Check:
    """Tell whether ``looks_broken(resample)`` tells three right resamplers from five broken ones."""
    for name, resample in GOOD.items():
        answer = attempt(looks_broken, resample)
        if answer is None:
            return hint("Your function returns nothing. Is a return missing at its end?")
        if is_unanswered(answer):
            return unanswered()
        if isinstance(answer, Check):
            return answer
        if isinstance(answer, str) or np.ndim(answer) != 0 or answer not in (0, 1):
            return hint(f"Return True or False; your function returns {answer!r}.")
        if answer:
            return hint(
                f"Your test accuses the {name} resampler, which is right. One call is chance: average the offspring "
                "over hundreds of calls, and leave room for what is left of chance."
            )
    for resample, words in BAD.values():
        answer = attempt(looks_broken, resample)
        if isinstance(answer, Check):
            return answer
        if not answer:
            return hint(f"Your test lets one pass that {words}")
    return passed("Three right resamplers pass, five broken ones are caught.")


class Curve:
    """A made-up count of cells over the clock's shift (s), with its least value at ``best``."""

    def __init__(self, best: float):
        self.best = best

    def __call__(self, shift: float | np.ndarray) -> np.ndarray:
        away = np.abs(np.asarray(shift, dtype=float) - self.best)
        return 4400.0 + 30000.0 * away / (1.0 + 2.0 * away)


SHIFTS = np.arange(-0.3, 0.3001, 0.01)
CURVES = [(Curve(best),) for best in (-0.137, 0.063, 0.241, -0.268)]


def _least(shifts, pick=np.argmin):
    def rule(cells):
        return shifts[pick([float(cells(s)) for s in shifts])]

    return rule


SHIFT_MISTAKES = [
    (lambda cells: -cells.best, "That is by how much the clock is wrong. Asked is the shift that you handed to cells, "
     "which puts it right: the other sign."),
    (_least(SHIFTS, np.argmax), "You take the largest number of cells, so the most blurred map. Sharp walls need few "
     "cells."),
    (lambda cells: float(np.argmin([cells(s) for s in SHIFTS])), "That is the place of the shift in your list. Return "
     "the shift itself."),
    (lambda cells: float(min(cells(s) for s in SHIFTS)), "That is the number of cells. Return the shift that needs so "
     "few."),
    (_least(np.arange(0.0, 0.3001, 0.01)), "You never try negative shifts. A clock may be late or early."),
    (_least(np.arange(-0.3, 0.0001, 0.01)), "You never try positive shifts. A clock may be late or early."),
    (_least(np.arange(-0.1, 0.1001, 0.01)), "You look from -0.1 to 0.1 s only. The best shift may be as far as 0.3 s."),
    (_least(np.arange(-0.2, 0.2001, 0.01)), "You look from -0.2 to 0.2 s only. The best shift may be as far as 0.3 s."),
    (_least(np.arange(-0.25, 0.2501, 0.01)), "You look from -0.25 to 0.25 s only. The best shift may be as far as 0.3 "
     "s."),
    (lambda cells: abs(cells.best), "You lost the sign. A clock may be late or early."),
    (lambda cells: -1000 * cells.best, "That is in milliseconds, and by how much the clock is wrong: the other sign."),
    (_least(np.arange(-0.3, 0.3001, 0.1)), "The right valley, but your steps are too coarse: 10 ms at 1 rad/s is half "
     "a degree."),
    (_least(np.arange(-0.3, 0.3001, 0.03)), "The right valley, but your steps are too coarse: 10 ms at 1 rad/s is half "
     "a degree."),
    (_least(np.arange(-0.3, 0.3001, 0.05)), "The right valley, but your steps are too coarse: 10 ms at 1 rad/s is half "
     "a degree."),
]  # fmt: skip


def check_find_shift(find_shift) -> Check:
    """Tell whether ``find_shift(cells)`` finds the shift of the stamps (s) that needs the fewest cells."""
    return compare(
        find_shift,
        lambda cells: cells.best,
        CURVES,
        mistakes=SHIFT_MISTAKES,
        praise="Within a hundredth of a second.",
        same=lambda found, expected: bool(np.abs(np.asarray(found, dtype=float) - expected) < 0.0101),
    )


RULED_OUT = {
    "clock": ("delay [s]", "a wrong clock shows as a delay of many hundredths of a second"),
    "lever arm": ("lever [m]", "a wrong lever arm shows as a lever error of decimetres"),
    "track": ("turn ratio", "yaw from the wheels shows as a turn ratio near 1.9"),
    "renumbered beams": ("cut scans", "renumbered scans all miss their last beams, a share near 1"),
    "lost second": ("metres lost", "a lost second shows as metres that the wheels turned and the path lacks"),
}


def check_diagnosis(diagnosis, robots: list[MysteryRobot]) -> Check:
    """Tell whether ``diagnosis`` names the fault of every robot: a dictionary from letter to name."""
    if is_unanswered(diagnosis) or (isinstance(diagnosis, dict) and is_unanswered(list(diagnosis.values()))):
        return unanswered()
    letters = [r.letter for r in robots]
    if not isinstance(diagnosis, dict) or set(diagnosis) != set(letters):
        return hint(f"A dictionary with the letters {', '.join(letters)} is asked for.")
    for robot in robots:
        answer = diagnosis[robot.letter]
        if answer not in FAULTS:
            return hint(f"{answer!r} is none of {', '.join(FAULTS)}.")
        if answer != robot.fault:
            return hint(_objection(robot, answer))
    return passed("All robots named. Another seed makes other robots.")


def _objection(robot: MysteryRobot, answer: str) -> str:
    """Return the number that rules a wrong answer out."""
    if answer == "healthy":
        column, sign = RULED_OUT[robot.fault]
        return f"Robot {robot.letter} is not healthy. Look at its {column}: {robot.numbers[column]:.2f}."
    letter, (column, sign) = robot.letter, RULED_OUT[answer]
    if robot.fault == "track":
        ratio = robot.numbers["turn ratio"]
        return (
            f"Robot {letter}: its headings are wrong by themselves, so no fit to the filter's corrections can be "
            f"trusted. First compare the instruments with each other: turn ratio {ratio:.2f}."
        )
    found = f"{robot.numbers[column]:.2f}"
    if robot.fault == "renumbered beams":
        return (
            f"Robot {letter}: bearings that are wrong bend every fit ({column} {found}). Look at the raw scans "
            f"before any fit: cut scans {robot.numbers['cut scans']:.2f}."
        )
    return f"Robot {letter} has no {answer} fault: {sign}, and here {column} is {found}."
