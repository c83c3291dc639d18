"""Checks of the exercises of chapter 07: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

import copy
from collections.abc import Callable
from math import comb

import numpy as np
from pfslam_book.show.checks import Check, answer_to, compare, hint, is_number, passed

from pfslam.particles import effective_sample_size

# ---- 1: one run of each


def _two_settings(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors of all runs of two settings, not equally many."""
    rng = np.random.default_rng(seed)
    return rng.gamma(4.0, 0.06, 7), rng.gamma(5.0, 0.07, 5)


SETTINGS = [
    (np.array([0.10, 0.21, 0.25, 0.30, 0.62]), np.array([0.15, 0.28, 0.35, 0.41, 0.22])),
    *(_two_settings(seed) for seed in (1, 2)),
    (
        np.array([0.5, 0.2, 0.7, 0.6]),
        np.array([2.0, 0.3, 0.45, 0.4, 0.48]),
    ),  # medians, means and bests disagree
]


def wrong_pairs(better: np.ndarray, worse: np.ndarray) -> float:
    """Give the share of all pairs of runs in which the worse setting looks better."""
    return float(np.less.outer(worse, better).mean())


def _same_numbers_only(better, worse):
    n = min(len(better), len(worse))
    return float(np.mean(np.asarray(worse)[:n] < np.asarray(better)[:n]))


PAIR_MISTAKES = [
    (lambda b, w: 1 - wrong_pairs(b, w), "That is the share of pairs that rank them rightly."),
    (lambda b, w: 100 * wrong_pairs(b, w), "That is in per cent; a share from 0 to 1 is asked for."),
    (lambda b, w: float(np.less.outer(w, b).sum()), "That is how many pairs, not their share."),
    (_same_numbers_only, "You compare run i with run i only. Two people who run one setting each may meet any run of "
     "the one beside any run of the other: all pairs count."),
    (lambda b, w: float(np.median(w) < np.median(b)), "You compare the medians. The question is what one run of each "
     "would have said."),
    (lambda b, w: float(np.mean(w) < np.mean(b)), "You compare the means. The question is what one run of each would "
     "have said."),
    (lambda b, w: float(np.mean(w < np.median(b))), "You compare every run of the worse with the median of the better. "
     "One run of each meets one run of the other."),
    (lambda b, w: float(np.less.outer(w, b).sum()) / len(b), "You divide by the runs of one setting. There are "
     "len(better) * len(worse) pairs."),
    (lambda b, w: float(np.less.outer(w, b).sum()) / len(w), "You divide by the runs of one setting. There are "
     "len(better) * len(worse) pairs."),
    (lambda b, w: _same_numbers_only(np.sort(b), np.sort(w)), "You sort both and compare rank by rank. Any run of the "
     "one may meet any run of the other: all pairs count."),
    (lambda b, w: float(w.min() < b.min()), "You compare the best runs. The question is what one run of each would "
     "have said."),
    (lambda b, w: float(np.mean(w < np.mean(b))), "You compare every run of the worse with the mean of the better. One "
     "run of each meets one run of the other."),
    (lambda b, w: float(np.mean(w < b.min())), "You count the worse runs that beat *all* of the better. One run of "
     "each meets one run of the other."),
    (ValueError, "The two settings need not have equally many runs: compare every run of the one with every run of the "
     "other, as worse[:, None] < better[None, :] does."),
]  # fmt: skip


def check_wrong_pairs(theirs: Callable) -> Check:
    """Check that ``wrong_pairs(better, worse)`` is the share of all pairs of runs that rank the settings wrongly."""
    share = wrong_pairs(*SETTINGS[0])
    praise = f"{share * 25:.0f} of 25 pairs of runs would have told you the opposite."
    return compare(theirs, wrong_pairs, SETTINGS, mistakes=PAIR_MISTAKES, praise=praise)


# ---- 2: the interval of a median

LEVEL = 0.95
SEEDS = range(5)


def _told(function: Callable, drew: list[bool]) -> Callable:
    """The same function of data and an rng; ``drew`` notes whether it took its random numbers from that rng."""

    def watched(*arguments):
        before = copy.deepcopy(arguments[-1].bit_generator.state)
        answer = function(*arguments)
        drew.append(arguments[-1].bit_generator.state != before)
        return answer

    return watched


OWN_RNG = "Your function draws from an rng of its own. Draw from the one that is given."


def _errors(n: int, seed: int) -> np.ndarray:
    """Errors with a long tail, as runs have them, in no order."""
    values = 0.1 + 0.15 * -np.log1p(-(np.arange(n) + 0.5) / n)
    return np.random.default_rng(seed).permutation(np.round(values, 4))


SAMPLES = [_errors(17, 1), _errors(27, 2)]
"""So many that 80, 90, 95 and 99 % end at different runs, and that 2000 resamples find the ends again and again."""


def exact_ends(values: np.ndarray, level: float) -> np.ndarray:
    """Give the ends of the bootstrap interval of the median of an odd number of runs, by counting."""
    n, ordered = len(values), np.sort(values)
    below = [sum(comb(n, j) * k**j * (n - k) ** (n - j) for j in range((n + 1) // 2, n + 1)) / n**n
             for k in range(n + 1)]  # fmt: skip
    k = int(np.searchsorted(below, (1 - level) / 2))
    return ordered[[k - 1, n - k]]


def check_median_interval(median_interval: Callable) -> Check:
    """Check that ``median_interval(values, rng)`` is a 95 % bootstrap interval ``(low, high)`` of the median."""
    found: list = []
    drew: list[bool] = []
    for values in SAMPLES:
        answers = [
            answer_to(
                _told(median_interval, drew), (values, np.random.default_rng(seed)), exact_ends(values, LEVEL)
            )
            for seed in (*SEEDS, 0)
        ]
        for answer in answers:
            if isinstance(answer, Check):
                return answer
        if not np.allclose(answers[0], answers[-1]):
            return hint(
                "Twice the same rng, two intervals: you draw from np.random. Draw from the rng that is given."
            )
        found.append(np.array(answers[:-1], dtype=float))
    words = _about_intervals(found)
    if words:
        return hint(words)
    if not all(drew):
        return hint(OWN_RNG)
    low, high = exact_ends(SAMPLES[0], LEVEL)
    return passed(
        f"The median lies between {low:.3f} and {high:.3f} m, says the first sample, of {len(SAMPLES[0])} runs."
    )


def _about_intervals(found: list[np.ndarray]) -> str:
    """Say what is wrong with intervals ``(seeds, 2)`` for each of the samples, or nothing."""
    if all(np.array_equal(ends[:, 0], ends[:, 1]) for ends in found):
        return (
            "The interval has no width. Each sample was the data itself in another order: draw *with* replacement, so "
            "that some runs come twice and others not at all."
        )
    if any((ends[:, 0] > ends[:, 1]).any() for ends in found):
        return "Low comes first, then high."
    if all(_mostly(ends, exact_ends(values, LEVEL)) for ends, values in zip(found, SAMPLES, strict=True)):
        return ""
    for ends_of, words in _interval_mistakes():
        if all(_mostly(ends, ends_of(values)) for ends, values in zip(found, SAMPLES, strict=True)):
            return words
    for rule, words in DRAWN_MISTAKES:
        if all(np.abs(ends.mean(axis=0) - _on_average(rule, values)).max() < 0.006
               for ends, values in zip(found, SAMPLES, strict=True)):  # fmt: skip
            return words
    level = _other_level(found)
    if level is not None:
        return (
            f"That is an interval of about {level:.0%}. For 95 % leave out 2.5 % of the medians at each end."
        )
    if max(np.ptp(ends, axis=0).max() for ends in found) > 0.02:
        words = "Its ends are rare events: use two thousand resamples."
        return f"Your interval changes a lot from one rng to the next. {words}"
    wrong = next(k for k in range(len(SAMPLES)) if not _mostly(found[k], exact_ends(SAMPLES[k], LEVEL)))
    (low, high), (right_low, right_high) = found[wrong][0], exact_ends(SAMPLES[wrong], LEVEL)
    return (
        f"For {len(SAMPLES[wrong])} runs your interval is {low:.5f} to {high:.5f}; expected about {right_low:.5f} to "
        f"{right_high:.5f}."
    )


def _medians(values, rng, size=None, statistic=np.median) -> np.ndarray:
    return statistic(rng.choice(values, (2000, size or len(values))), axis=1)


DRAWN_MISTAKES = [
    (lambda v, rng: np.percentile(_medians(v, rng), [0.025, 0.975]), "np.percentile counts to 100: give it 2.5 and "
     "97.5, or take np.quantile."),
    (lambda v, rng: np.quantile(_medians(v, rng, statistic=np.mean), [0.025, 0.975]), "Those are means of the "
     "resamples. The medians are asked for."),
    (lambda v, rng: np.median(v) + np.array([-1.96, 1.96]) * _medians(v, rng).std(), "You take 1.96 standard "
     "deviations of the medians to each side, as for a bell curve. Their distribution is lopsided: take its "
     "quantiles."),
    (lambda v, rng: np.quantile(_medians(v, rng, len(v) // 2), [0.025, 0.975]), "Your resamples are smaller than the "
     "data. Draw as many runs as there are: fewer runs make a less certain median."),
    (lambda v, rng: 2 * np.median(v) - np.quantile(_medians(v, rng), [0.975, 0.025]), "Your interval is mirrored about "
     "the median. The quantiles of the resampled medians are asked for as they are."),
    (lambda v, rng: np.quantile(_medians(v, rng), [0.05, 1.0]), "You leave out 5 % at one end. Leave out 2.5 % at "
     "each."),
    (lambda v, rng: np.quantile(_medians(v, rng), [0.0, 1.0]), "Those are the smallest and the largest of all medians. "
     "For 95 % leave out 2.5 % at each end."),
    (lambda v, rng: np.quantile(np.median(rng.choice(v, (2000, len(v))), axis=0), [0.025, 0.975]), "You take medians "
     "across the resamples. Take the median of each: axis=1."),
    (lambda v, rng: np.quantile(_medians(v, rng, 2000)[: len(v)], [0.025, 0.975]), "Much too narrow. Draw two thousand "
     "resamples of n runs each, not n of two thousand, and take the median of each: axis=1."),
]  # fmt: skip


def _on_average(rule: Callable, values: np.ndarray) -> np.ndarray:
    return np.mean([rule(values, np.random.default_rng(seed)) for seed in SEEDS], axis=0)


def _mostly(found: np.ndarray, ends: np.ndarray, off: float = 5e-4) -> bool:
    """Whether four of five intervals end there: a rare draw may move an end by one run."""
    return int(np.isclose(found, ends, rtol=0, atol=off).all(axis=1).sum()) >= len(found) - 1


def _other_level(found: list[np.ndarray]) -> float | None:
    """The level of an interval that is a bootstrap interval of the median, but not one of 95 %."""
    ranks = []
    for ends, values in zip(found, SAMPLES, strict=True):
        n, ordered = len(values), np.sort(values)
        low, high = (int(np.argmin(np.abs(ordered - end))) + 1 for end in np.median(ends, axis=0))
        off = np.abs(np.median(ends, axis=0) - ordered[[low - 1, high - 1]]).max()
        if off > 5e-4 or abs(low + high - n - 1) > 1 or high - low > 0.7 * n:
            return None
        ranks.append(low)
    steps = {level: int(np.searchsorted(np.sort(SAMPLES[1]), exact_ends(SAMPLES[1], level)[0])) + 1
             for level in (0.5, 0.8, 0.9, 0.95, 0.99)}  # fmt: skip
    nearest = min(steps, key=lambda level: abs(steps[level] - ranks[1]))
    return None if nearest == LEVEL else nearest


def _interval_mistakes() -> list[tuple[Callable, str]]:
    """Rules for the ends of an interval that are not this one, and their words."""
    return [
        (
            lambda values: np.quantile(values, [0.025, 0.975]),
            "That is where single runs lie, not where their median lies. Take medians of resamples first.",
        ),
        (
            _bell,
            "Median plus or minus two standard errors: that is the bell curve's formula for a mean. These errors have "
            "a long tail; let the resamples say it.",
        ),
        (
            lambda values: [values.min(), values.max()],
            "That is the range of all runs. The median is known better than that.",
        ),
    ]


def _bell(values: np.ndarray) -> list[float]:
    reach = 1.96 * values.std(ddof=1) / np.sqrt(len(values))
    return [np.median(values) - reach, np.median(values) + reach]


# ---- 3: the interval of a difference


def _experiment(seed: int, n: int, m: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors of two settings whose runs have nothing to do with one another, each list sorted by chance alone."""
    rng = np.random.default_rng(seed)
    return np.round(0.1 + rng.gamma(2.0, 0.08, n), 4), np.round(0.12 + rng.gamma(2.0, 0.05, m), 4)


EXPERIMENTS = [_experiment(5, 15, 15), _experiment(6, 21, 21)]


def difference_ends(before, after, rng, draws: int = 2000, statistic: Callable = np.median) -> np.ndarray:
    """Give the difference of the medians and the ends of its 95 % interval, from two independent resamples."""
    a, b = (statistic(rng.choice(v, (draws, len(v))), axis=1) for v in (before, after))
    return np.array([statistic(after) - statistic(before), *np.quantile(b - a, [0.025, 0.975])])


def _paired(before, after, rng, draws: int = 2000) -> np.ndarray:
    change = after - before
    medians = np.median(rng.choice(change, (draws, len(change))), axis=1)
    return np.array([np.median(change), *np.quantile(medians, [0.025, 0.975])])


def _same_rows(before, after, rng, draws: int = 2000) -> np.ndarray:
    rows = rng.integers(0, len(before), (draws, len(before)))
    apart = np.median(after[rows], axis=1) - np.median(before[rows], axis=1)
    return np.array([np.median(after) - np.median(before), *np.quantile(apart, [0.025, 0.975])])


def _ends_apart(before, after, rng) -> np.ndarray:
    a, b = (
        np.quantile(np.median(rng.choice(v, (2000, len(v))), axis=1), [0.025, 0.975]) for v in (before, after)
    )
    return np.array([np.median(after) - np.median(before), b[0] - a[1], b[1] - a[0]])


def _error(values) -> float:
    return values.std(ddof=1) / np.sqrt(len(values))


def _on_both_sides(before, after, rng, cut: float) -> np.ndarray:
    a, b = (np.median(rng.choice(v, (2000, len(v))), axis=1) for v in (before, after))
    return np.array([np.median(after) - np.median(before), *np.quantile(b - a, [cut, 1 - cut])])


DIFFERENCE_MISTAKES = [
    (_paired, "You take differences run by run and then their median. Run 3 of the one has nothing to do with run 3 of "
     "the other; in another order the answer changes. Resample each setting by itself."),
    (_same_rows, "You draw the same rows for both settings, which pairs run i with run i. Draw twice."),
    (lambda b, a, rng: difference_ends(a, b, rng), "You subtract after from before. An "
     "improvement should be negative."),
    (lambda b, a, rng: difference_ends(b, a, rng, statistic=np.mean), "That is the difference of the means. "
     "The medians were asked for."),
    (_ends_apart, "You subtract the ends of two intervals. Both medians are hardly ever off in the worst way together: "
     "subtract medians draw by draw, and take the ends of these differences."),
    (lambda b, a, rng: _on_both_sides(b, a, rng, 0.05), "That is an interval of 90 %. For 95 % leave out 2.5 % at each "
     "end."),
    (lambda b, a, rng: _on_both_sides(b, a, rng, 0.005), "That is an interval of 99 %. For 95 % leave out 2.5 % at "
     "each end."),
    (lambda b, a, rng: difference_ends(b, a, rng) - np.array([0, 1, 1]) * (np.median(a) - np.median(b)), "Your ends "
     "are counted from the difference. The interval *contains* it: do not subtract it."),
    (lambda b, a, rng: np.append(np.median(a) - np.median(b), np.quantile(np.subtract.outer(a, b), [0.025, 0.975])),
     "That is where the difference of two single runs lies, not that of the medians. Take medians of resamples."),
    (lambda b, a, rng: difference_ends(b, a, rng) / np.median(b), "That is relative to the setting before. The "
     "difference is asked for in metres."),
    (lambda b, a, rng: _paired(np.sort(b), np.sort(a), rng), "You sort both and pair rank by rank. No run belongs to "
     "another: resample each setting by itself."),
    (lambda b, a, rng: np.repeat(np.median(a) - np.median(b), 3), "The interval has no width: draw *with* "
     "replacement."),
    (lambda b, a, rng: np.median(a) - np.median(b) + np.array([0, -1.96, 1.96]) * np.hypot(_error(a), _error(b)), "You "
     "take 1.96 standard errors to each side: the bell curve's formula for means. Let the resamples say it."),
    (lambda b, a, rng: difference_ends(b, a, rng)[[0, 2, 1]], "Low comes before high."),
    (lambda b, a, rng: difference_ends(b, a, rng)[[1, 2, 0]], "The difference comes first, then low and high."),
]  # fmt: skip


def check_difference(difference: Callable) -> Check:
    """Check that ``difference(before, after, rng)`` returns (difference of medians, low, high)."""
    found: list = []
    right: list = []
    drew: list[bool] = []
    for before, after in EXPERIMENTS:
        expected = np.mean(
            [difference_ends(before, after, np.random.default_rng(s)) for s in range(20)], axis=0
        )
        answers = [
            answer_to(_told(difference, drew), (before, after, np.random.default_rng(s)), expected)
            for s in (*SEEDS, 0)
        ]
        for answer in answers:
            if isinstance(answer, Check):
                return answer
        if not np.allclose(answers[0], answers[-1]):
            return hint("Twice the same rng, two intervals: draw from the rng that is given.")
        found.append(np.mean(answers[:-1], axis=0))
        right.append(expected)
    near = all(_near(a, b) for a, b in zip(found, right, strict=True))
    if near and any(drew):
        return passed("Resampled apart, because nothing ties run 3 of the one to run 3 of the other.")
    gap, words = _nearest_mistake(found, right)
    if near or (not any(drew) and gap > 1e-9 and _apart(found, right) < 0.03):
        return hint(OWN_RNG)
    if words:
        return hint(words)
    k = next(k for k in range(len(found)) if not _near(found[k], right[k]))
    shown = (", ".join(f"{x:+.4f}" for x in numbers) for numbers in (found[k], right[k]))
    return hint("For one pair of settings your numbers are {}; expected about {}.".format(*shown))


def _apart(found: list[np.ndarray], others: list[np.ndarray]) -> float:
    """How far numbers lie from others, at most."""
    return float(np.abs(np.subtract(found, others)).max())


def _nearest_mistake(found: list[np.ndarray], right: list[np.ndarray]) -> tuple[float, str]:
    """The distance and the words of the mistake whose numbers lie nearest, unless the right ones lie nearer."""
    nearest, words = min(0.012, _apart(found, right)), ""
    for wrong, about in DIFFERENCE_MISTAKES:
        others = [
            np.mean([wrong(*case, np.random.default_rng(s)) for s in SEEDS], axis=0) for case in EXPERIMENTS
        ]
        if _apart(found, others) < nearest:
            nearest, words = _apart(found, others), about
    return nearest, words


def _near(found: np.ndarray, right: np.ndarray) -> bool:
    """The value to four digits, the ends to what chance moves them."""
    return bool(abs(found[0] - right[0]) < 5e-4 and np.abs(found[1:] - right[1:]).max() < 0.006)


# ---- 4: a data sheet

SHEETS = [
    (6.0, 100.0),
    (0.7, 31.0),
    *[tuple(row) for row in np.random.default_rng(3).uniform((0.1, 10.0), (9.0, 400.0), (2, 2)).tolist()],
]


def sigma_from_sheet(walk: float, rate: float) -> float:
    """Give the standard deviation per sample (rad/s) of a gyro with an angle random walk in deg / sqrt(hour)."""
    return np.deg2rad(walk) / 60.0 * np.sqrt(rate)


SHEET_MISTAKES = [
    (lambda w, r: w / 60.0 * np.sqrt(r), "That is in degrees per second. The motion model counts in radians."),
    (lambda w, r: np.deg2rad(w) / 3600.0 * np.sqrt(r), "An hour has 3600 s, so a *root* hour has 60 root seconds."),
    (lambda w, r: np.deg2rad(w) * np.sqrt(r), "That is still per root hour. A root hour has 60 root seconds."),
    (lambda w, r: np.deg2rad(w) / 60.0, "That is the density, in rad per root second. What noise has one sample that "
     "lasts tau = 1 / rate?"),
    (lambda w, r: np.deg2rad(w) / 60.0 / np.sqrt(r), "The wrong way round. After time T the heading spreads by sigma * "
     "sqrt(tau * T): a shorter tau needs a *larger* sigma for the same spread."),
    (lambda w, r: np.deg2rad(w) / 60.0 * r, "Variances scale with the rate, standard deviations with its root."),
    (lambda w, r: sigma_from_sheet(w, r) ** 2, "That is the variance. Fields called sigma take a standard deviation."),
    (lambda w, r: w / 60.0 / np.sqrt(r), "That is in degrees, and the wrong way round: a shorter tau needs a *larger* "
     "sigma for the same spread."),
    (lambda w, r: np.deg2rad(w) / np.sqrt(60.0) * np.sqrt(r), "An hour has 3600 s, not 60: a root hour has 60 root "
     "seconds."),
    (lambda w, r: np.deg2rad(w) * 60.0 * np.sqrt(r), "Divide by the 60 root seconds of a root hour. In one second the "
     "heading spreads less than in an hour."),
    (lambda w, r: np.deg2rad(w) / 3600.0, "That takes the walk for a drift in degrees per hour. It is per *root* hour, "
     "and the rate counts."),
    (lambda w, r: np.sqrt(np.deg2rad(w)) / 60.0 * np.sqrt(r), "The walk is a standard deviation already. Take no root "
     "of it."),
    (lambda w, r: np.deg2rad(w) / 60.0 * 10.0, "You built in 100 Hz. The rate is an argument."),
    (lambda w, r: sigma_from_sheet(np.rad2deg(np.rad2deg(w)), r), "You turned degrees into degrees once more: radians "
     "are degrees times pi / 180."),
]  # fmt: skip


def check_sigma_from_sheet(theirs: Callable) -> Check:
    """Check that ``sigma_from_sheet(walk, rate)`` turns deg / sqrt(hour) into rad/s per sample."""
    praise = "At a quarter of the rate it is half as large: the same gyro."
    return compare(theirs, sigma_from_sheet, SHEETS, mistakes=SHEET_MISTAKES, praise=praise)


# ---- 5: how sharp a likelihood is


def _scores(seed: int, n: int) -> np.ndarray:
    """Mean scores per beam of ``n`` particles: of 590 beams about 500 hit, give or take 9."""
    return 0.85 + 0.015 * np.random.default_rng(seed).standard_normal(n)


CLOUDS = [(_scores(7, 200), 0.5), (_scores(7, 200), 0.2), (_scores(8, 90), 0.35)]


def share_at(B: float, scores: np.ndarray) -> float:
    """Give N_eff / N of weights proportional to exp(B * score)."""
    joint = np.exp(B * (scores - scores.max()))
    return effective_sample_size(joint / joint.sum()) / len(scores)


def _entropy_share(B: float, scores: np.ndarray) -> float:
    joint = np.exp(B * (scores - scores.max()))
    weights = joint / joint.sum()
    return float(np.exp(-np.sum(weights * np.log(weights + 1e-300)))) / len(scores)


def check_sharpness(sharpness: Callable) -> Check:
    """Check that ``sharpness(scores, share)`` gives the B at which N_eff of exp(B score) is that share of N."""
    for scores, share in CLOUDS:
        B = answer_to(sharpness, (scores, share), 0.0)
        if isinstance(B, Check):
            return B
        if not is_number(B):
            return hint(f"A finite number is asked for; your function returns {B}.")
        found = share_at(float(B), scores)
        if abs(found - share) > 0.01:
            return hint(_off(float(B), found, share, scores))
    return passed("The sharper the likelihood, the fewer particles count; you can set how many.")


def _off(B: float, found: float, share: float, scores: np.ndarray) -> str:
    """Say what is wrong with a B that gives another share than asked."""
    if B <= 0:
        return "With B at zero or below, a good score earns nothing. Search among positive numbers."
    n = len(scores)
    if found * n < 2.5:
        return (
            f"N_eff is about one particle. The share is a part of N: at {share:g} so many of {n} particles should "
            "count. (Or do you multiply by the number of beams? Then B = 1 is already softmax of the count.)"
        )
    if found > 0.98:
        return f"At your B = {B:.3g} N_eff is {found:.2f} N: the weights are flat, like raw counts."
    if abs(found - (1 - share)) < 0.02 < abs(2 * share - 1):
        return f"At your B N_eff is {found:.2f} N: that is the share that does *not* count."
    if abs(_entropy_share(B, scores) - share) < 0.01:
        return "You count by the entropy of the weights. N_eff here is one over the sum of their squares."
    if abs(found - share**2) < 0.02:
        return f"At your B N_eff is {found:.2f} N, the square of what was asked: the sum of squares is 1 / N_eff."
    return f"At your B = {B:.3g} N_eff is {found:.3f} N, asked was {share:.2f} N. N_eff falls as B grows."
