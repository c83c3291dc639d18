"""Exercises of chapter 07."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

from pfslam.particles import effective_sample_size

# ---- 1: one run of each


def two_settings(seed):
    """Errors of all runs of two settings, not equally many."""
    rng = np.random.default_rng(seed)
    return rng.gamma(4.0, 0.06, 7), rng.gamma(5.0, 0.07, 5)


def wins(better, worse):
    """How many pairs of runs there are in which the worse setting looks better."""
    return float(np.less.outer(worse, better).sum())


def wrong_pairs(better, worse):
    return wins(better, worse) / len(better) / len(worse)


check_wrong_pairs = Exercise(
    right=wrong_pairs,
    cases=[
        (np.array([0.10, 0.21, 0.25, 0.30, 0.62]), np.array([0.15, 0.28, 0.35, 0.41, 0.22])),
        two_settings(1),
        two_settings(2),
    ],
    mistakes={
        "The two settings need not have equally many runs: compare every run of the one with every run of the other, "
        "as worse[:, None] < better[None, :] does.": ValueError,
        "You compare run i with run i only. Two people who run one setting each may meet any run of the one beside "
        "any run of the other: all pairs count.": (
            lambda b, w: np.mean([y < x for x, y in zip(b, w, strict=False)])
        ),
        "You compare every run of the worse with the median of the better. One run of each meets one run of the "
        "other.": lambda b, w: np.mean(w < np.median(b)),
        "You divide by the runs of one setting. There are len(better) * len(worse) pairs.": (
            lambda b, w: wins(b, w) / len(b)
        ),
        "That is the share of pairs that rank them rightly.": lambda b, w: 1 - wrong_pairs(b, w),
    },
    praise="11 of 25 pairs of runs would have told you the opposite.",
)

# ---- 2 and 3: intervals of a median and of a difference

ENDS, DRAWS = [0.025, 0.975], 10_000


def errors(n, seed, least=0.1, spread=0.15):
    """Errors with a long tail, as runs have them, in no order."""
    tail = -np.log1p(-(np.arange(n) + 0.5) / n)
    return np.random.default_rng(seed).permutation(np.round(least + spread * tail, 4))


def medians(values, rng, statistic=np.median):
    """The median of each resample, or another statistic."""
    return statistic(rng.choice(values, (DRAWS, len(values))), axis=1)


def interval(values, rng, statistic=np.median):
    return np.quantile(medians(values, rng, statistic), ENDS)


def bell(values, rng):
    return np.median(values) + np.array([-1.96, 1.96]) * values.std(ddof=1) / np.sqrt(len(values))


def same_ends(found, expected):
    """Whether two ends agree up to what chance moves them, in widths of the interval, and a number before them."""
    off, width = np.abs(np.subtract(found, expected)), np.abs(np.subtract(*expected[-2:]))
    return bool((off[-2:] <= 0.07 * width).all() and (off[:-2] < 5e-4).all())


def ignores_rng(theirs, *case):
    """Words for a function that leaves the rng untouched."""
    before = case[-1].bit_generator.state
    theirs(*case)
    own = case[-1].bit_generator.state == before
    return (
        "Your function never draws from the rng that it is given. Take all chance from there." if own else ""
    )


check_median_interval = Exercise(
    right=interval,
    cases=[(errors(n, n), np.random.default_rng(n)) for n in (17, 27)],  # their ends hardly depend on the rng
    mistakes={
        "The interval has no width. Each sample was the data itself in another order: draw *with* replacement, so "
        "that some runs come twice and others not at all.": (
            lambda values, rng: np.repeat(np.median(values), 2)
        ),
        "That is where single runs lie, not where their median lies. Take medians of resamples first.": (
            lambda values, rng: np.quantile(values, ENDS)
        ),
        "Median plus or minus two standard errors: that is the bell curve's formula for a mean. These errors have a "
        "long tail; let the resamples say it.": bell,
        "Those are means of the resamples. The medians are asked for.": (
            lambda values, rng: interval(values, rng, np.mean)
        ),
        "np.percentile counts to 100: give it 2.5 and 97.5, or take np.quantile.": (
            lambda values, rng: np.percentile(medians(values, rng), ENDS)
        ),
    },
    praise="The median lies between 0.146 and 0.299 m, says the first sample, of 17 runs.",
    same=same_ends,
    besides=ignores_rng,
)


def settings(n, seed, spread):
    """Errors of two settings; by chance alone, bad runs of the one stand beside bad runs of the other."""
    return errors(n, seed), errors(n, seed, 0.12, spread), np.random.default_rng(seed)


def difference(before, after, rng, statistic=np.median):
    """The difference of the medians, and the interval from two independent resamples."""
    apart = -medians(before, rng, statistic) + medians(after, rng, statistic)
    return np.append(statistic(after) - statistic(before), np.quantile(apart, ENDS))


def paired(before, after, rng):
    return np.append(np.median(after - before), interval(after - before, rng))


def ends_apart(before, after, rng):
    apart = interval(after, rng) - interval(before, rng)[::-1]
    return np.append(np.median(after) - np.median(before), apart)


def single_runs(before, after, rng):
    apart = np.quantile(np.subtract.outer(after, before), ENDS)
    return np.append(np.median(after) - np.median(before), apart)


check_difference = Exercise(
    right=difference,
    cases=[settings(39, 7, 0.08), settings(39, 4, 0.23)],
    mistakes={
        "You tie run 3 of the one to run 3 of the other: you take differences run by run, or draw the same rows for "
        "both. They have nothing to do with each other, and in another order your interval changes. Resample each "
        "setting by itself.": paired,
        "You subtract after from before. An improvement should be negative.": (
            lambda before, after, rng: difference(after, before, rng)
        ),
        "That is the difference of the means. The medians were asked for.": (
            lambda before, after, rng: difference(before, after, rng, np.mean)
        ),
        "You subtract the ends of two intervals. Both medians are hardly ever off in the worst way together: subtract "
        "medians draw by draw, and take the ends of these differences.": ends_apart,
        "That is where the difference of two single runs lies, not that of the medians. Take medians of resamples.": (
            single_runs
        ),
    },
    praise="Resampled apart, because nothing ties run 3 of the one to run 3 of the other.",
    same=same_ends,
    besides=ignores_rng,
)

# ---- 4: a data sheet


def sigma_from_sheet(walk, rate):
    return np.deg2rad(walk) / 60.0 * np.sqrt(rate)


check_sigma_from_sheet = Exercise(
    right=sigma_from_sheet,
    cases=[(6.0, 100.0), (0.7, 31.0), (3.2, 214.0)],
    mistakes={
        "An hour has 3600 s, so a *root* hour has 60 root seconds.": (
            lambda walk, rate: sigma_from_sheet(walk, rate) / 60.0
        ),
        "That is the density, in rad per root second. What noise has one sample that lasts tau = 1 / rate?": (
            lambda walk, rate: np.deg2rad(walk) / 60.0
        ),
        "The wrong way round. After time T the heading spreads by sigma * sqrt(tau * T): a shorter tau needs a "
        "*larger* sigma for the same spread.": lambda walk, rate: np.deg2rad(walk) / 60.0 / np.sqrt(rate),
        "Variances scale with the rate, standard deviations with its root.": (
            lambda walk, rate: np.deg2rad(walk) / 60.0 * rate
        ),
        "That is the variance. Fields called sigma take a standard deviation.": (
            lambda walk, rate: sigma_from_sheet(walk, rate) ** 2
        ),
    },
    praise="At a quarter of the rate it is half as large: the same gyro.",
)

# ---- 5: how sharp a likelihood is


def cloud(seed, n, share):
    """Mean scores per beam of n particles: of 590 beams about 500 hit, give or take 9."""
    return 0.85 + 0.015 * np.random.default_rng(seed).standard_normal(n), share


def entropy_size(weights):
    return np.exp(-np.sum(weights * np.log(weights + 1e-300)))


def sharpness(scores, share, size=effective_sample_size):
    """The B at which so large a share of the particles counts, by halving the bracket."""
    low, high = 0.0, 1e5
    for _ in range(60):
        B = (low + high) / 2
        weights = np.exp(B * (scores - scores.max()))
        low, high = (B, high) if size(weights / weights.sum()) > share * len(scores) else (low, B)
    return B


check_sharpness = Exercise(
    right=sharpness,
    cases=[cloud(7, 200, 0.5), cloud(7, 200, 0.2), cloud(8, 90, 0.35)],
    mistakes={
        "At B = 1 nearly all particles count, as with raw counts: mean scores lie between 0 and 1. N_eff falls as B "
        "grows.": lambda scores, share: 1.0,
        "With that B so large a share of the particles does *not* count.": (
            lambda scores, share: sharpness(scores, 1 - share)
        ),
        "At your B the share that counts is the square of what was asked: the sum of squares is 1 / N_eff.": (
            lambda scores, share: sharpness(scores, share**2)
        ),
        "You count by the entropy of the weights. N_eff here is one over the sum of their squares.": (
            lambda scores, share: sharpness(scores, share, entropy_size)
        ),
        "At your B about one particle counts. The share is a part of N, so divide N_eff by N.": (
            lambda scores, share: sharpness(scores, 1.05 / len(scores))
        ),
    },
    praise="The sharper the likelihood, the fewer particles count; you can set how many.",
    same=lambda found, expected: bool(np.abs(found - expected) < 0.015 * np.abs(expected)),
)
