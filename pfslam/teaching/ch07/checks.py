"""Checks of the exercises of chapter 07. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np

from pfslam.particles import effective_sample_size
from pfslam.teaching.ch07.statistics import bootstrap_interval
from pfslam.teaching.show.checks import Check, attempt, hint, is_unanswered, not_a_number, passed, unanswered

BETTER, WORSE = np.array([0.10, 0.20, 0.25, 0.30, 0.60]), np.array([0.15, 0.28, 0.35, 0.40, 0.22])


def check_wrong_pairs(wrong_pairs) -> Check:
    """Whether ``wrong_pairs(better, worse)`` is the share of all pairs of runs that rank the two settings wrongly."""
    answer = attempt(wrong_pairs, BETTER.copy(), WORSE.copy())
    verdict = not_a_number(answer, "pairs per pair, from 0 to 1")
    if verdict is not None:
        return verdict
    wrong = np.less.outer(WORSE, BETTER)
    right = float(wrong.mean())
    if np.isclose(answer, right):
        return passed(f"{wrong.sum()} of {wrong.size} pairs of runs would have told you the opposite.")
    mistakes = {
        float(
            np.mean(WORSE < BETTER)
        ): "You compare run i with run i only. Whoever runs each setting once may draw "
        "any run of the one beside any run of the other: all 25 pairs count.",
        1 - right: "That is the share of pairs that rank them rightly.",
        100 * right: "That is in per cent; a share from 0 to 1 is asked for.",
        float(wrong.sum()): "That is how many pairs, not their share.",
        float(
            np.median(WORSE) < np.median(BETTER)
        ): "You compare the medians. The question is what one run of each would have said.",
        float(
            np.mean(WORSE) < np.mean(BETTER)
        ): "You compare the means. The question is what one run of each would have said.",
    }
    for value, words in mistakes.items():
        if np.isclose(answer, value):
            return hint(words)
    return hint(f"Your function returns {answer:.3f}; by counting the pairs it should be {right:.2f}.")


ERRORS = np.round(0.1 + 0.15 * -np.log1p(-(np.arange(21) + 0.5) / 21), 4)
"""Twenty-one errors with a long tail, as runs have them: median 0.204 m, mean 0.248 m."""


def check_median_interval(median_interval) -> Check:
    """Whether ``median_interval(values, rng)`` is a 95 % bootstrap interval ``(low, high)`` of the median."""
    answers = [attempt(median_interval, ERRORS.copy(), np.random.default_rng(1)) for _ in range(2)]
    problem = _no_interval(answers[0])
    if problem is not None:
        return problem
    low, high = (float(end) for end in answers[0])
    if answers[0] is not answers[1] and not np.allclose(answers[0], answers[1]):
        return hint(
            "Twice the same rng, two intervals: you draw from np.random. Draw from the rng that is given."
        )
    known = _mistakes()
    for name, (ends, words) in known.items():
        if np.allclose([low, high], ends, atol=1e-9 if name == "exact" else 0.012):
            return hint(words)
    right = bootstrap_interval(ERRORS, np.random.default_rng(0))
    if np.allclose([low, high], right, atol=0.03):
        return passed(f"The median lies between {low:.3f} and {high:.3f} m, says this sample of 21 runs.")
    return hint(
        f"Your interval is {low:.3f} to {high:.3f}; about {right[0]:.3f} to {right[1]:.3f} was expected."
    )


def _no_interval(answer) -> Check | None:
    """The verdict on an answer that is not two numbers in order."""
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    if np.shape(answer) != (2,) or np.asarray(answer).dtype.kind not in "fiu":
        return hint(f"Return two numbers, low and high; yours have the shape {np.shape(answer)}.")
    low, high = answer
    if low == high:
        return hint(
            "The interval has no width. Each sample was the data itself in another order: draw *with* replacement, "
            "so that some runs come twice and others not at all."
        )
    return hint("Low comes first, then high.") if low > high else None


def _mistakes() -> dict[str, tuple[tuple[float, ...], str]]:
    """Intervals that common mistakes give, and their names."""
    middle, error = float(np.median(ERRORS)), float(ERRORS.std(ddof=1) / np.sqrt(len(ERRORS)))
    of_mean = bootstrap_interval(ERRORS, np.random.default_rng(0), np.mean)
    return {
        "range": (
            tuple(np.quantile(ERRORS, [0.025, 0.975])),
            "That is where single runs lie, not where their median lies. Take medians of resamples first.",
        ),
        "mean": (
            of_mean,
            "That is the interval of the mean. One bad run pulls a mean; the median was asked.",
        ),
        "bell": (
            (middle - 1.96 * error, middle + 1.96 * error),
            "Median plus or minus two standard errors: that is the bell curve's formula for a mean. These errors have "
            "a long tail; let the resamples say it.",
        ),
    }


def check_sigma_from_sheet(sigma_from_sheet) -> Check:
    """Whether ``sigma_from_sheet(walk, rate)`` turns deg / sqrt(hour) into rad/s per sample."""
    walk, rate = 6.0, 100.0
    answer = attempt(sigma_from_sheet, walk, rate)
    verdict = not_a_number(answer, "rad/s")
    if verdict is not None:
        return verdict
    density = np.deg2rad(walk) / 60.0
    right = density * np.sqrt(rate)
    if np.isclose(answer, right):
        other = attempt(sigma_from_sheet, walk, 25.0)
        if np.isclose(other, density * 5.0):
            return passed(f"{right:.4f} rad/s at 100 Hz, and half of it at 25 Hz: the same gyro.")
        return hint("Right at 100 Hz, wrong at 25 Hz: the rate must not be built in.")
    mistakes = {
        walk / 60.0 * np.sqrt(rate): "That is in degrees per second. The motion model counts in radians.",
        np.deg2rad(walk)
        / 3600.0
        * np.sqrt(rate): "An hour has 3600 s, so a *root* hour has 60 root seconds.",
        np.deg2rad(walk) * np.sqrt(rate): "That is still per root hour. A root hour has 60 root seconds.",
        density: "That is the density, in rad per root second. What noise has one sample that lasts tau = 1 / rate?",
        density
        / np.sqrt(rate): "The wrong way round. After time T the heading spreads by sigma * sqrt(tau * T): a "
        "shorter tau needs a *larger* sigma for the same spread.",
        density * rate: "Variances scale with the rate, standard deviations with its root.",
        right**2: "That is the variance. Fields called sigma take a standard deviation.",
    }
    for value, words in mistakes.items():
        if np.isclose(answer, value):
            return hint(words)
    return hint(f"For 6 deg per root hour at 100 Hz it should be {right:.4f} rad/s; yours is {answer:.4g}.")


SCORES = 0.85 + 0.015 * np.random.default_rng(7).standard_normal(200)
"""Mean scores per beam of 200 particles: about 500 hits of 590, give or take 9."""


def check_sharpness(sharpness) -> Check:
    """Whether ``sharpness(scores, share)`` gives the beta at which N_eff of exp(beta score) is that share of N."""
    for share in (0.5, 0.2):
        answer = attempt(sharpness, SCORES.copy(), share)
        verdict = not_a_number(answer, "1 (beta has no unit)")
        if verdict is not None:
            return verdict
        found = share_at(float(answer))
        if abs(found - share) < 0.01:
            continue
        return hint(_off(float(answer), found, share))
    return passed("The sharper the likelihood, the fewer particles count; you can set how many.")


def share_at(beta: float, scores: np.ndarray = SCORES) -> float:
    """N_eff / N of weights proportional to exp(beta * score)."""
    joint = np.exp(beta * (scores - scores.max()))
    return effective_sample_size(joint / joint.sum()) / len(scores)


def _off(beta: float, found: float, share: float) -> str:
    """What is wrong with a beta that gives another share than asked."""
    if beta <= 0:
        return "With beta at zero or below, a good score earns nothing. Search among positive numbers."
    if abs(found * len(SCORES) - share) < 0.5 or found < 0.01:
        return (
            "N_eff is about one particle. The share is a part of N: at 0.5 a hundred of 200 particles should count. "
            "(Or do you multiply by the number of beams? Then beta = 1 is already softmax of the count.)"
        )
    if found > 0.98:
        return f"At your beta = {beta:.3g} N_eff is {found:.2f} N: the weights are flat, like raw counts."
    if abs(found - (1 - share)) < 0.02:
        return f"At your beta N_eff is {found:.2f} N: that is the share that does *not* count."
    return f"At your beta = {beta:.3g} N_eff is {found:.2f} N, asked was {share:.2f} N. N_eff falls as beta grows."
