"""Exercises of chapter 07."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

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


# ---- 1: two settings whose runs have nothing in common


def settings(n, seed, spread):
    """Errors of two settings; by chance alone, bad runs of the one stand beside bad runs of the other."""
    return errors(n, seed), errors(n, seed, 0.12, spread), np.random.default_rng(seed)


def difference(before, after, rng, statistic=np.median):
    """The difference of the medians, and the interval from two independent resamples."""
    apart = -medians(before, rng, statistic) + medians(after, rng, statistic)
    return np.append(statistic(after) - statistic(before), np.quantile(apart, ENDS))


def paired(before, after, rng):
    return np.append(np.median(after - before), interval(after - before, rng))


def same_rows(before, after, rng):
    rows = rng.integers(0, len(before), (DRAWS, len(before)))
    apart = np.median(after[rows], axis=1) - np.median(before[rows], axis=1)
    return np.append(np.median(after) - np.median(before), np.quantile(apart, ENDS))


def half_paired(before, after, rng):
    return np.append(np.median(after) - np.median(before), interval(after - before, rng))


check_difference = Exercise(
    right=difference,
    cases=[
        settings(39, 7, 0.08),
        settings(39, 4, 0.23),
        (errors(39, 2), errors(39, 11, 0.12, 0.23), np.random.default_rng(2)),  # no pairs, not even by chance
    ],
    mistakes={
        "You take the differences run by run. Run 3 of the one has nothing to do with run 3 of the other, and in "
        "another order your answer changes: resample each setting by itself, and subtract the medians.": paired,
        "You draw the same rows for both settings, which ties run 3 of the one to run 3 of the other. They have "
        "nothing to do with each other: draw for each setting by itself.": same_rows,
        "Your difference is right. But your interval is that of the differences run by run, which depends on the order "
        "of the runs: resample each setting by itself.": half_paired,
        "You subtract after from before. An improvement should be negative.": (
            lambda before, after, rng: difference(after, before, rng)
        ),
        "That is the difference of the means. The medians were asked for.": (
            lambda before, after, rng: difference(before, after, rng, np.mean)
        ),
    },
    praise="Resampled apart, because nothing ties run 3 of the one to run 3 of the other.",
    same=same_ends,
    besides=ignores_rng,
)

# ---- 2: two settings in the same buildings


def buildings(seed, count=31, runs=2):
    """Errors ``(B, R)`` before and after, in buildings that are hard or easy for both."""
    rng = np.random.default_rng(seed)
    hard = errors(count, seed, spread=0.6)[:, None]
    after = hard - errors(count, seed + 1, 0.0, 0.08)[:, None]
    return *(e + 0.02 * rng.standard_normal((count, runs)) for e in (hard, after)), rng


def by_building(before, after, rng, statistic=np.median):
    change = after.mean(axis=1) - before.mean(axis=1)
    return np.append(statistic(change), interval(change, rng, statistic))


check_by_building = Exercise(
    right=by_building,
    cases=[buildings(5), buildings(9)],
    mistakes={
        "You resample the two settings apart, so the interval holds all that makes buildings differ. Both settings met "
        "the same buildings: take the difference in each building first.": (
            lambda before, after, rng: difference(before.mean(axis=1), after.mean(axis=1), rng)
        ),
        "You count every run as a witness. The runs in one building share its walls: make one number of each "
        "building first.": lambda before, after, rng: paired(before.ravel(), after.ravel(), rng),
        "You subtract after from before. An improvement should be negative.": (
            lambda before, after, rng: by_building(after, before, rng)
        ),
        "That is the mean change. The median was asked for.": (
            lambda before, after, rng: by_building(before, after, rng, np.mean)
        ),
        "Your interval is right. But the difference of two medians compares two buildings that need not be the same: "
        "take the median of the differences, building by building.": (
            lambda before, after, rng: half_paired(before.mean(axis=1), after.mean(axis=1), rng)
        ),
    },
    praise="Each building is one witness, and a pair.",
    same=same_ends,
    besides=ignores_rng,
)

# ---- 3: choose with some seeds, report with others


def choose_and_report(runs, n, statistic=np.median):
    best = np.argmin(statistic(runs[:, :n], axis=1))
    return np.array([best, statistic(runs[best, n:])])


def tried(seed, settings=7, seeds=13):
    return np.round(np.random.default_rng(seed).gamma(2.0, 0.12, (settings, seeds)), 4)


check_choose_and_report = Exercise(
    right=choose_and_report,
    cases=[(tried(3), 5), (tried(7), 6), (tried(1), 4)],
    mistakes={
        "You report the error over the seeds with which you chose. It is small because you chose it: report the "
        "winner's median over the other seeds.": (
            lambda runs, n: [choose_and_report(runs, n)[0], np.median(runs[:, :n], axis=1).min()]
        ),
        "You choose with all seeds, also with those that you report. Choose with the first n only.": (
            lambda runs, n: [
                (best := np.argmin(np.median(runs, axis=1))),
                np.median(runs[best, n:]),
            ]
        ),
        "You report the smallest median over the other seeds, which is choosing a second time. Report the setting "
        "that the first seeds chose.": (
            lambda runs, n: [choose_and_report(runs, n)[0], np.median(runs[:, n:], axis=1).min()]
        ),
        "You compare means. The medians were asked for.": (
            lambda runs, n: choose_and_report(runs, n, np.mean)
        ),
        "You report over all seeds, also over those with which you chose. Leave these out.": (
            lambda runs, n: [(best := int(choose_and_report(runs, n)[0])), np.median(runs[best])]
        ),
    },
    praise="The seeds that chose the winner do not speak for it.",
)
