"""Checks of the exercises of chapter 10. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np

from pfslam.teaching.show.checks import Check, attempt, hint, is_unanswered, not_a_number, passed, unanswered

TRUE_STEPS = np.array([0, 9, 18, 22, 22, 22, 15, 4, 0, -6, -12, -6, 0, 20, 22, 22, 22, 22, 18, 9])
FIRST_READING = 200


def check_increments(function) -> Check:
    """Increments ``(K,)`` of an 8-bit counter from its readings ``(K,)``."""
    readings = (FIRST_READING + np.cumsum(TRUE_STEPS)) % 256
    answer = attempt(function, readings.astype(np.uint8))
    if isinstance(answer, Check):
        return answer
    if is_unanswered(answer):
        return unanswered()
    answer = np.asarray(answer)
    if answer.shape != readings.shape:
        return hint(f"One increment per reading is asked for, shape {readings.shape}; yours is {answer.shape}. "
                    "Before the first reading nobody counted: its increment is 0.")  # fmt: skip
    if answer[0] != 0:
        return hint(f"The first increment is {answer[0]}. The counter did not start at zero when you did: the robot "
                    "would jump by all that it drove before.")  # fmt: skip
    answer = answer.astype(np.int64)
    if np.array_equal(answer, TRUE_STEPS):
        return passed("The wrap is gone, and the stretch in reverse is still in reverse.")
    if (answer < -128).any():
        return hint(f"One increment is {answer.min()}: the counter went from 255 to 0 and you took it at its word. "
                    "Differences of an 8-bit counter are only known modulo 256.")  # fmt: skip
    if (answer > 128).any():
        return hint(f"One increment is {answer.max()}. Modulo 256, a step of -6 and one of 250 look alike; choose the "
                    "one that a wheel can make: between -128 and 127.")  # fmt: skip
    at = int(np.argmax(answer != TRUE_STEPS))
    return hint(f"Increment {at} should be {TRUE_STEPS[at]}; yours is {answer[at]}.")


def check_track(function) -> Check:
    """Effective track (m) from the ways of right and left wheels and the gyro's turn in each second."""
    rng = np.random.default_rng(3)
    turned = np.array([0.0, 0.0, 0.9, -0.7, 0.0, 1.2, -1.1, 0.3, 0.0, 0.6])
    apart = 0.74 * turned + 0.004 * rng.standard_normal(len(turned))
    middle = np.full(len(turned), 0.8)
    answer = attempt(function, middle + apart / 2, middle - apart / 2, turned)
    if isinstance(answer, float) and not np.isfinite(answer):
        return hint("In some seconds the robot did not turn at all, and you divided by that. Fit one line "
                    "through all seconds instead of a ratio for each.")  # fmt: skip
    verdict = not_a_number(answer, "metres")
    if verdict is not None:
        return verdict
    best = float(apart @ turned / (turned @ turned))
    if np.isclose(answer, best, atol=0.004):
        return passed(
            f"{best:.2f} m, where a ruler says 0.39 m: the wheels skid sideways through every turn."
        )
    if np.isclose(answer, -best, atol=0.004):
        return hint("The sign is wrong: in a left turn, which is positive, the right wheels go further.")
    if np.isclose(answer, 1 / best, atol=0.02):
        return hint(
            "Upside down: way apart = track * angle, so the track is the slope of the way over the angle."
        )
    if np.isclose(answer, best / 2, atol=0.004):
        return hint("Half of it: the two sides are one track apart, not each a track from the middle.")
    return hint(f"The robot turned in both directions, so sums of the ways cancel. Yours is {answer:.3f} m; the slope "
                f"of the line through zero is {best:.3f} m.")  # fmt: skip


BEAMS = {4.2: "hit", np.inf: "free", 0.0: "unknown", 0.05: "unknown", 29.9: "hit", np.nan: "unknown"}


def check_classify(function) -> Check:
    """ "hit", "free" or "unknown" for one range of a LiDAR that is good from 0.1 to 30 m."""
    answers = [attempt(function, r, 0.1, 30.0) for r in BEAMS]
    for answer in answers:
        if isinstance(answer, Check):
            return answer
    if is_unanswered(answers):
        return unanswered()
    for (r, right), answer in zip(BEAMS.items(), answers, strict=True):
        if answer not in ("hit", "free", "unknown"):
            return hint(
                f"For {r} your function returns {answer!r}; one of the words hit, free, unknown is asked for."
            )
        if answer != right:
            return hint(_why_not(r, answer))
    return passed(
        "Three cases, not two. Which of them a black cupboard gives is for your sensor's data sheet to say."
    )


def _why_not(r: float, answer: str) -> str:
    if np.isnan(r):
        return "NaN is not a long way: the instrument says that it does not know. Comparisons with NaN are all false."
    if np.isinf(r) and answer == "hit":
        return "A wall at the maximum range would draw a ring around the robot."
    if np.isinf(r):
        return "This instrument says infinity when nothing came back from within its range: that way is free."
    if r < 0.1:
        return (f"{r} m is below what the instrument can measure: dirt on its window, or its word for nothing. "
                "It is neither a wall nor free space.")  # fmt: skip
    return f"{r} m lies between 0.1 and 30 m: that is a measurement, and its end point is a hit."
