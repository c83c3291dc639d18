"""Right answers to the exercises of chapter 07, in the ways that people write them: each must pass its check."""

import bisect

import numpy as np
from pfslam_book.ch07.statistics import bootstrap_interval, difference_interval


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


def sheet(walk, rate):
    return walk * np.pi / 180 * (rate / 3600) ** 0.5


def sharpness_by_sections(scores, share):
    low, high = 1e-3, 1e4
    while high / low > 1.0001:
        B = (low * high) ** 0.5
        w = np.exp(B * (scores - max(scores)))
        low, high = (B, high) if w.sum() ** 2 / (w @ w) > share * len(scores) else (low, B)
    return B


def sharpness_on_a_grid(scores, share):
    def apart(B):
        w = np.exp(B * (scores - scores.max()))
        return abs(w.sum() ** 2 / (w @ w) / len(w) - share)

    return min(np.geomspace(1, 1000, 3000), key=apart)


STYLES = {
    "check_wrong_pairs": [
        pairs_in_a_loop,
        pairs_by_sorting,
        lambda b, w: np.float32(pairs_in_a_loop(b, w)),
        lambda b, w: round(pairs_in_a_loop(b, w), 4),
        lambda b, w: np.mean([np.mean(w < x) for x in b]),
        lambda b, w: np.array([np.count_nonzero(np.less.outer(w, b)) / b.size / w.size]),
    ],
    "check_median_interval": [
        interval_in_a_loop,
        interval_by_counts,
        bootstrap_interval,
        lambda v, rng: np.float32(bootstrap_interval(v, rng)),
        lambda v, rng: np.round(bootstrap_interval(v, rng), 4),
        lambda v, rng: interval_in_a_loop(v, rng, draws=4000),
    ],
    "check_difference": [
        difference_in_a_loop,
        difference_interval,
        lambda b, a, rng: np.float32(difference_interval(b, a, rng)),
        lambda b, a, rng: tuple(np.round(difference_interval(b, a, rng), 4)),
    ],
    "check_sigma_from_sheet": [
        sheet,
        lambda w, r: float(f"{sheet(w, r):.4g}"),
        lambda w, r: np.float32(sheet(w, r)),
        lambda w, r: [sheet(w, r)],
        lambda w, r: np.sqrt(np.deg2rad(w) ** 2 / 3600 * r),
        lambda w, r: np.deg2rad(w) / np.sqrt(3600) / np.sqrt(1 / r),
    ],
    "check_sharpness": [
        sharpness_by_sections,
        sharpness_on_a_grid,
        lambda s, share: np.float32(sharpness_by_sections(s, share)),
        lambda s, share: np.array([sharpness_by_sections(s, share)]),
        lambda s, share: round(sharpness_by_sections(s, share), 1),
    ],
}
