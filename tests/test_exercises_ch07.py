"""Exercises of chapter 07: right answers in many styles, wrong ones and the words for each."""

import bisect

import numpy as np
import pytest
from pfslam_book import ch07
from pfslam_book.ch07.statistics import bootstrap_interval, difference_interval

# ---- right answers: loops, lists, sorting, float32, the package, other containers


def pairs_in_a_loop(better, worse):
    return sum(w < b for b in better for w in worse) / (len(better) * len(worse))


def pairs_by_sorting(better, worse):
    ordered = sorted(worse.tolist())
    return [sum(bisect.bisect_left(ordered, b) for b in better.tolist()) / len(better) / len(worse)]


def interval_in_a_loop(values, rng, draws=2000, level=0.95):
    medians = sorted(float(np.median(rng.choice(values, len(values)))) for _ in range(draws))
    cut = (1 - level) / 2
    return medians[int(cut * draws)], medians[int((1 - cut) * draws)]


def interval_by_counts(values, rng):
    ordered = np.sort(values)
    counts = rng.multinomial(len(values), np.full(len(values), 1 / len(values)), size=2000)
    middle = (counts.cumsum(axis=1) > len(values) // 2).argmax(axis=1)
    return list(np.quantile(ordered[middle], [0.025, 0.975]))


def difference_in_a_loop(before, after, rng):
    apart = [
        np.median(rng.choice(after, len(after))) - np.median(rng.choice(before, len(before)))
        for _ in range(2000)
    ]
    return [np.median(after) - np.median(before), *np.percentile(apart, [2.5, 97.5])]


def beta_by_sections(scores, share):
    low, high = 1e-3, 1e4
    while high / low > 1.0001:
        beta = (low * high) ** 0.5
        w = np.exp(beta * (scores - max(scores)))
        low, high = (beta, high) if w.sum() ** 2 / (w @ w) > share * len(scores) else (low, beta)
    return beta


def sheet(walk, rate):
    return walk * np.pi / 180 * (rate / 3600) ** 0.5


RIGHT = [
    (ch07.check_wrong_pairs, pairs_in_a_loop),
    (ch07.check_wrong_pairs, pairs_by_sorting),
    (ch07.check_wrong_pairs, lambda b, w: np.float32(pairs_in_a_loop(b, w))),
    (ch07.check_wrong_pairs, lambda b, w: round(pairs_in_a_loop(b, w), 4)),
    (ch07.check_wrong_pairs, lambda b, w: np.mean([np.mean(w < x) for x in b])),
    (
        ch07.check_wrong_pairs,
        lambda b, w: np.array([np.count_nonzero(np.less.outer(w, b)) / b.size / w.size]),
    ),
    (ch07.check_median_interval, interval_in_a_loop),
    (ch07.check_median_interval, interval_by_counts),
    (ch07.check_median_interval, lambda v, rng: bootstrap_interval(v, rng)),
    (ch07.check_median_interval, lambda v, rng: np.float32(bootstrap_interval(v, rng))),
    (ch07.check_median_interval, lambda v, rng: np.round(bootstrap_interval(v, rng), 4)),
    (ch07.check_median_interval, lambda v, rng: interval_in_a_loop(v, rng, draws=4000)),
    (ch07.check_difference, difference_in_a_loop),
    (ch07.check_difference, lambda b, a, rng: difference_interval(b, a, rng)),
    (ch07.check_difference, lambda b, a, rng: np.float32(difference_interval(b, a, rng))),
    (ch07.check_difference, lambda b, a, rng: tuple(np.round(difference_interval(b, a, rng), 4))),
    (ch07.check_difference, lambda b, a, rng: list(map(float, difference_interval(b, a, rng)))),
    (ch07.check_difference, lambda b, a, rng: np.array(difference_in_a_loop(b, a, rng))[None][0]),
    (ch07.check_sigma_from_sheet, sheet),
    (ch07.check_sigma_from_sheet, lambda w, r: float(f"{sheet(w, r):.4g}")),
    (ch07.check_sigma_from_sheet, lambda w, r: np.float32(sheet(w, r))),
    (ch07.check_sigma_from_sheet, lambda w, r: [sheet(w, r)]),
    (ch07.check_sigma_from_sheet, lambda w, r: np.sqrt(np.deg2rad(w) ** 2 / 3600 * r)),
    (ch07.check_sigma_from_sheet, lambda w, r: np.deg2rad(w) / np.sqrt(3600) / np.sqrt(1 / r)),
    (ch07.check_sharpness, beta_by_sections),
    (ch07.check_sharpness, lambda s, share: np.float32(beta_by_sections(s, share))),
    (ch07.check_sharpness, lambda s, share: np.array([beta_by_sections(s, share)])),
    (ch07.check_sharpness, lambda s, share: round(beta_by_sections(s, share), 1)),
    (ch07.check_sharpness, lambda s, share: beta_by_sections(s.tolist() + np.zeros(len(s)), share)),
    (
        ch07.check_sharpness,
        lambda s, share: min(np.geomspace(1, 1000, 3000), key=lambda b: abs(shared(b, s) - share)),
    ),
]


def shared(beta, scores):
    w = np.exp(beta * (scores - scores.max()))
    return w.sum() ** 2 / (w @ w) / len(w)


@pytest.mark.parametrize(("check", "answer"), RIGHT)
def test_the_same_in_another_style_is_right_too(check, answer):
    assert check(answer), check(answer)


# ---- wrong answers


def bootstrap(statistic=np.median, replace=True, draws=2000, level=0.95):
    """A bootstrap interval with one thing wrong."""

    def interval(values, rng):
        found = [statistic(rng.choice(values, len(values), replace=replace)) for _ in range(draws)]
        return np.quantile(found, [(1 - level) / 2, (1 + level) / 2])

    return interval


def bell(values, rng):
    reach = 1.96 * values.std(ddof=1) / np.sqrt(len(values))
    return np.median(values) - reach, np.median(values) + reach


def medians_of(values, rng):
    return np.median(rng.choice(values, (2000, len(values))), axis=1)


def bell_of_medians(values, rng):
    return np.median(values) + np.array([-1.96, 1.96]) * medians_of(values, rng).std()


def by_bell(before, after, rng):
    reach = 1.96 * np.hypot(*(v.std(ddof=1) / len(v) ** 0.5 for v in (before, after)))
    change = np.median(after) - np.median(before)
    return change, change - reach, change + reach


DRIFT = iter(range(1000))


def paired(before, after, rng):
    change = after - before
    medians = np.median(change[rng.integers(0, len(change), (2000, len(change)))], axis=1)
    return np.median(change), *np.quantile(medians, [0.025, 0.975])


def same_rows(before, after, rng):
    rows = rng.integers(0, len(before), (2000, len(before)))
    apart = np.median(after[rows], axis=1) - np.median(before[rows], axis=1)
    return np.median(after) - np.median(before), *np.quantile(apart, [0.025, 0.975])


def by_ends(before, after, rng):
    (a, b), (c, d) = bootstrap()(before, rng), bootstrap()(after, rng)
    return np.median(after) - np.median(before), c - b, d - a


def sorted_in_place(values, rng):
    values.sort()
    return bootstrap()(values, rng)


WRONG = [
    (ch07.check_wrong_pairs, lambda b, w: 1 - pairs_in_a_loop(b, w), "rightly"),
    (ch07.check_wrong_pairs, lambda b, w: 100 * pairs_in_a_loop(b, w), "per cent"),
    (ch07.check_wrong_pairs, lambda b, w: np.less.outer(w, b).sum(), "not their share"),
    (ch07.check_wrong_pairs, lambda b, w: np.mean([y < x for x, y in zip(b, w, strict=False)]), "run i only"),
    (ch07.check_wrong_pairs, lambda b, w: np.mean(w < b), "equally many runs"),
    (ch07.check_wrong_pairs, lambda b, w: float(np.median(w) < np.median(b)), "medians"),
    (ch07.check_wrong_pairs, lambda b, w: np.mean(w < np.median(b)), "median of the better"),
    (ch07.check_wrong_pairs, lambda b, w: np.less.outer(w, b), "One number"),
    (ch07.check_median_interval, bootstrap(level=0.8), "80%"),
    (ch07.check_median_interval, bootstrap(level=0.9), "90%"),
    (ch07.check_median_interval, bootstrap(level=0.99), "99%"),
    (ch07.check_median_interval, bootstrap(draws=20), "two thousand resamples"),
    (ch07.check_median_interval, bootstrap(replace=False), "*with* replacement"),
    (ch07.check_median_interval, bootstrap(np.mean), "means of the resamples"),
    (ch07.check_median_interval, lambda v, rng: np.quantile(v, [0.025, 0.975]), "single runs"),
    (ch07.check_median_interval, lambda v, rng: (v.min(), v.max()), "range of all runs"),
    (ch07.check_median_interval, bell, "long tail"),
    (ch07.check_median_interval, lambda v, rng: bootstrap()(v, rng)[::-1], "Low comes first"),
    (ch07.check_median_interval, lambda v, rng: np.median(v), "shape"),
    (ch07.check_median_interval, lambda v, rng: (0.1, 0.2 + next(DRIFT)), "np.random"),
    (ch07.check_median_interval, sorted_in_place, "changes what it is given"),
    (ch07.check_difference, paired, "nothing to do with run 3"),
    (ch07.check_difference, same_rows, "the same rows"),
    (ch07.check_difference, lambda b, a, rng: difference_in_a_loop(a, b, rng), "after from before"),
    (ch07.check_difference, lambda b, a, rng: difference_interval(b, a, rng, np.mean), "means"),
    (ch07.check_difference, by_ends, "ends of two intervals"),
    (
        ch07.check_difference,
        lambda b, a, rng: np.array(difference_in_a_loop(b, a, rng))[[0, 2, 1]],
        "Low comes",
    ),
    (
        ch07.check_difference,
        lambda b, a, rng: np.array(difference_in_a_loop(b, a, rng))[[1, 2, 0]],
        "comes first",
    ),
    (ch07.check_difference, lambda b, a, rng: (0.5, 0.1, 0.9), "expected about"),
    (ch07.check_difference, lambda b, a, rng: np.median(a) - np.median(b), "shape"),
    (ch07.check_sigma_from_sheet, lambda w, r: w / 60 * r**0.5, "radians"),
    (ch07.check_sigma_from_sheet, lambda w, r: np.deg2rad(w) / 3600 * r**0.5, "root* hour"),
    (ch07.check_sigma_from_sheet, lambda w, r: np.deg2rad(w) * r**0.5, "still per root hour"),
    (ch07.check_sigma_from_sheet, lambda w, r: np.deg2rad(w) / 60 / r**0.5, "wrong way round"),
    (ch07.check_sigma_from_sheet, lambda w, r: np.deg2rad(w) / 60, "one sample"),
    (ch07.check_sigma_from_sheet, lambda w, r: np.deg2rad(w) / 60 * r, "Variances scale"),
    (ch07.check_sigma_from_sheet, lambda w, r: sheet(w, r) ** 2, "variance"),
    (ch07.check_sigma_from_sheet, lambda w, r: np.deg2rad(w) / 6, "built in"),
    (ch07.check_sharpness, lambda s, share: 1.0, "flat, like raw counts"),
    (ch07.check_sharpness, lambda s, share: 590.0, "one particle"),
    (ch07.check_sharpness, lambda s, share: -54.0, "earns nothing"),
    (
        ch07.check_sharpness,
        lambda s, share: beta_by_sections(s, share if share == 0.5 else 1 - share),
        "does *not*",
    ),
    (ch07.check_sharpness, lambda s, share: beta_by_sections(s, share**2), "square"),
    (ch07.check_sharpness, lambda s, share: 30.0, "falls as B grows"),
    (ch07.check_sharpness, lambda s, share: s, "One number"),
    (ch07.check_sharpness, lambda s, share: np.nan, "finite"),
    (ch07.check_wrong_pairs, lambda b, w: np.less.outer(w, b).sum() / len(b), "runs of one setting"),
    (ch07.check_wrong_pairs, lambda b, w: float(min(w) < min(b)), "best runs"),
    (ch07.check_wrong_pairs, lambda b, w: np.mean(w < np.mean(b)), "mean of the better"),
    (ch07.check_median_interval, lambda v, rng: bootstrap()(v, np.random.default_rng(0)), "of its own"),
    (ch07.check_median_interval, bell_of_medians, "lopsided"),
    (ch07.check_median_interval, lambda v, rng: np.percentile(medians_of(v, rng), [0.025, 0.975]), "to 100"),
    (
        ch07.check_median_interval,
        lambda v, rng: np.quantile(medians_of(v, rng), [0, 1]),
        "smallest and the largest",
    ),
    (
        ch07.check_difference,
        lambda b, a, rng: difference_in_a_loop(b, a, np.random.default_rng(0)),
        "of its own",
    ),
    (ch07.check_difference, by_bell, "bell curve"),
    (
        ch07.check_difference,
        lambda b, a, rng: [
            np.median(a) - np.median(b),
            *np.quantile(np.subtract.outer(a, b), [0.025, 0.975]),
        ],
        "two single runs",
    ),
    (ch07.check_sigma_from_sheet, lambda w, r: np.deg2rad(w) * (r / 60) ** 0.5, "not 60"),
    (ch07.check_sigma_from_sheet, lambda w, r: np.deg2rad(w) / 3600, "*root* hour"),
]


@pytest.mark.parametrize(("check", "answer", "words"), WRONG)
def test_a_wrong_answer_is_refused_by_name(check, answer, words):
    verdict = check(answer)
    assert verdict.verdict == "wrong"
    assert words in verdict.message
