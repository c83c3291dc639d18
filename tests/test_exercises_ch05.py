"""Exercises of chapter 05: right answers in many styles, wrong ones and the words for each; and its tables."""

import random
from bisect import bisect
from collections import deque
from fractions import Fraction
from itertools import accumulate

import numpy as np
import pytest
from pfslam_book import ch05
from pfslam_book.ch05 import cells
from pfslam_book.ch05.measurements import LATTICE_TABLE, stored_errors
from pfslam_book.ch05.slow_motion import one_update
from pfslam_book.ch05.weights import copies_table
from pfslam_book.ch05.window import moved_to_best, window_scores
from pfslam_book.show.tables import errors_by_label, read_table

from pfslam.particles import RESAMPLERS
from pfslam.poses import average_pose, wrap_angle

# ---- right answers: loops, lists, float32, four digits, other containers, complex numbers


def update_in_a_loop(weights, counts):
    products = [w * c for w, c in zip(weights.tolist(), counts.tolist(), strict=True)]
    return [p / sum(products) for p in products] if any(products) else weights.tolist()


def update_by_logarithms(weights, counts):
    if not counts.any():
        return weights
    with np.errstate(divide="ignore"):
        logs = np.log(weights) + np.log(counts)
    return np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()


def update_in_fractions(weights, counts):
    products = [Fraction(float(w)) * Fraction(float(c)) for w, c in zip(weights, counts, strict=True)]
    return deque(float(p / sum(products)) for p in products) if any(products) else deque(weights.tolist())


def update_complex(weights, counts):
    products = weights * (counts + 0j)
    return (products / products.sum()).real if weights @ counts else weights


def resampling(pick, weights_after=None, change=None):
    """A resampler with its own way to pick ancestors, and perhaps something wrong with what it returns."""

    def resample(poses, weights, rng):
        ancestors = pick(weights, rng)
        poses = poses[ancestors] if change is None else change(poses[ancestors], rng)
        return poses, np.full(len(poses), 1 / len(poses)) if weights_after is None else weights_after(
            weights, ancestors
        )

    return resample


def by_weight(weights, rng):
    return rng.choice(len(weights), len(weights), p=weights)


def low_variance(poses, weights, rng):
    """The loop of the textbooks, with lists."""
    n, kept, i, total = len(weights), [], 0, weights[0]
    start = rng.random() / n
    for m in range(n):
        while start + m / n > total:
            i += 1
            total += weights[i]
        kept.append(tuple(poses[i]))
    return kept, (1 / n,) * n


def resampling_wheel(poses, weights, rng):
    n, beta, kept = len(weights), 0.0, []
    index = int(rng.random() * n)
    for _ in range(n):
        beta += rng.random() * 2 * weights.max()
        while beta > weights[index]:
            beta -= weights[index]
            index = (index + 1) % n
        kept.append(index)
    return [np.float32(poses[kept]), [1 / n] * n]


def by_multinomial(poses, weights, rng):
    return np.repeat(poses, rng.multinomial(5, weights), axis=0), deque([0.2] * 5)


def by_the_standard_library(poses, weights, rng):
    own = random.Random(int(rng.integers(2**31)))
    return own.choices(poses.tolist(), weights.tolist(), k=5), [0.2] * 5


def by_bisection(poses, weights, rng):
    ends = list(accumulate(weights.tolist()))
    return tuple(tuple(poses[min(bisect(ends, rng.random()), 4)]) for _ in range(5)), (0.2,) * 5


def resampled_complex(poses, weights, rng):
    chosen = rng.choice(5, 5, p=weights)
    places = (poses[:, 0] + 1j * poses[:, 1])[chosen]
    return np.column_stack([places.real, places.imag, poses[chosen, 2]]), np.full(5, 0.2, dtype=np.float32)


def mean_by_rotations(poses, weights):
    turns = [np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) for t in poses[:, 2]]
    mean = sum(w * turn for w, turn in zip(weights, turns, strict=True))
    return deque([*np.average(poses[:, :2], axis=0, weights=weights), np.arctan2(mean[1, 0], mean[0, 0])])


def mean_by_halving(poses, weights):
    """Two particles at a time melt into one of both weights, on the circle."""
    x, y, theta, total = *poses[0], weights[0]
    for (px, py, angle), w in zip(poses[1:], weights[1:], strict=True):
        share = w / (total + w)
        x, y, total = x + share * (px - x), y + share * (py - y), total + w
        theta += share * wrap_angle(angle - theta)
    return np.float32(x), np.float32(y), np.float32(theta)


def mean_complex(poses, weights):
    z = weights @ (poses[:, 0] + 1j * poses[:, 1])
    return z.real, z.imag, np.angle(weights @ np.exp(1j * poses[:, 2]))


def mean_of_wrapped_differences(poses, weights):
    first = poses[0, 2]
    heading = first + weights @ wrap_angle(poses[:, 2] - first)
    return [*(weights @ poses[:, :2]), heading]


def mean_in_a_loop(poses, weights):
    x = y = s = c = 0.0
    for (px, py, theta), w in zip(poses, weights, strict=True):
        x, y, s, c = x + w * px, y + w * py, s + w * np.sin(theta), c + w * np.cos(theta)
    return np.float32([x, y, np.arctan2(s, c) % (2 * np.pi)])


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch05.check_update, update_in_a_loop),
        (ch05.check_update, update_by_logarithms),
        (ch05.check_update, lambda w, c: tuple(np.round(update_by_logarithms(w, c), 5))),
        (ch05.check_update, lambda w, c: np.float32(update_by_logarithms(w, c))),
        (ch05.check_update, update_in_fractions),
        (ch05.check_update, update_complex),
        (ch05.check_update, lambda w, c: np.multiply(w, c) / np.dot(w, c) if np.dot(w, c) else w.copy()),
        (ch05.check_resample, resampling(by_weight)),
        (ch05.check_resample, by_multinomial),
        (ch05.check_resample, by_the_standard_library),
        (ch05.check_resample, by_bisection),
        (ch05.check_resample, resampled_complex),
        *((ch05.check_resample, resampling(scheme)) for scheme in RESAMPLERS.values()),
        (ch05.check_resample, low_variance),
        (ch05.check_resample, resampling_wheel),
        (ch05.check_mean_pose, mean_complex),
        (ch05.check_mean_pose, mean_by_rotations),
        (ch05.check_mean_pose, mean_by_halving),
        (ch05.check_mean_pose, mean_of_wrapped_differences),
        (ch05.check_mean_pose, mean_in_a_loop),
        (ch05.check_mean_pose, lambda poses, weights: np.round(average_pose(poses, weights), 4)),
    ],
)
def test_the_same_in_another_style_is_right_too(check, answer):
    assert check(answer), check(answer)


# ---- wrong answers


def normalised(rule, empty=None):
    def update(weights, counts):
        joint = rule(weights, counts)
        return joint / joint.sum() if counts.any() else (weights if empty is None else empty)

    return update


def in_place(weights, counts):
    weights *= counts
    return weights / weights.sum()


WRONG_UPDATES = [
    (lambda w, c: w * c / (w * c).sum(), "0 by 0"),
    (
        lambda w, c: [a * b / sum((w * c).tolist()) for a, b in zip(w.tolist(), c.tolist(), strict=True)],
        "0 by 0",
    ),
    (normalised(lambda w, c: w * c, np.full(4, 0.25)), "wiped out"),
    (normalised(lambda w, c: w * c, np.zeros(4)), "not as zeros"),
    (normalised(lambda w, c: np.where(c == 0, w, w * c)), "keeps its weight"),
    (normalised(lambda w, c: c), "forgotten"),
    (lambda w, c: w * c, "do not sum to 1"),
    (normalised(lambda w, c: w + c), "not added"),
    (normalised(lambda w, c: np.exp(c - c.max())), "exp of the count"),
    (normalised(lambda w, c: w * np.exp(c - c.max())), "exp of the count"),
    (normalised(lambda w, c: w * c**2), "square of the count"),
    (lambda w, c: w * c / c.sum() if c.any() else w, "sum of the products"),
    (normalised(lambda w, c: w**2 * c), "old weight enters as its square"),
    (normalised(lambda w, c: np.eye(len(w))[np.argmax(w * c)]), "best particle gets everything"),
    (lambda w, c: w * c / (w * c).sum() if c.all() else w, "leaves all weights as they were"),
    (lambda w, c: w * c / np.linalg.norm(w * c) if c.any() else w, "length of the vector"),
    (lambda w, c: w * c / (w * c).max() if c.any() else w, "greatest product"),
    (lambda w, c: w * c / (w * c).mean() if c.any() else w, "mean of the products"),
    (lambda w, c: (w + c / c.sum()) / 2 if c.any() else w, "not averaged"),
    (lambda w, c: w, "come back unchanged"),
    (lambda w, c: int(np.argmax(w * c)), "shape"),
    (lambda w, c: 1.0, "shape"),
    (lambda w, c: nothing, "NameError"),  # noqa: F821
    (in_place, "changes what it is given"),
]


def torn(poses, weights, rng):
    first, second = by_weight(weights, rng), by_weight(weights, rng)
    return np.column_stack([poses[first, :2], poses[second, 2]]), np.full(len(poses), 1 / len(poses))


def with_jitter(poses, rng):
    return poses + 0.01 * rng.standard_normal(poses.shape)


def into_the_old(poses, weights, rng):
    poses[:] = poses[by_weight(weights, rng)]
    return poses, np.full(len(poses), 1 / len(poses))


WRONG_RESAMPLERS = [
    (resampling(by_weight, weights_after=lambda w, a: w[a]), "counted twice"),
    (resampling(by_weight, weights_after=lambda w, a: np.ones(len(w))), "make each 1/N"),
    (torn, "one index array"),
    (resampling(by_weight, change=with_jitter), "next prediction"),
    (resampling(lambda w, rng: rng.integers(0, 5, 5)), "play no part"),
    (resampling(lambda w, rng: np.full(5, np.argmax(w))), "Only the heaviest"),
    (resampling(lambda w, rng: by_weight(w**2 / (w**2).sum(), rng)), "square of the weight"),
    (resampling(lambda w, rng: by_weight(w, np.random.default_rng(3))), "same copies"),
    (resampling(lambda w, rng: np.arange(5)), "play no part"),
    (resampling(lambda w, rng: by_weight(w, rng)[:4]), "must stay 5"),
    (into_the_old, "changes what it is given"),
    (lambda poses, weights, rng: poses, "two arrays"),
    (lambda poses, weights, rng: (by_weight(weights, rng), np.full(5, 0.2)), "indices of the ancestors"),
    (lambda poses, weights, rng: (np.full(5, 0.2), poses[by_weight(weights, rng)]), "poses first"),
    (resampling(lambda w, rng: np.random.choice(5, 5, p=w)), "Twice the same rng"),  # noqa: NPY002
    (resampling(lambda w, rng: np.full(5, rng.choice(5, p=w))), "drew once for all"),
    (resampling(lambda w, rng: np.minimum(by_weight(w, rng) + 1, 4)), "off by one"),
    (resampling(lambda w, rng: by_weight(w, rng) - 1), "off by one"),
    (resampling(lambda w, rng: by_weight(np.sort(w), rng)), "order of weights and poses"),
    (resampling(lambda w, rng: np.searchsorted(np.cumsum(w), (np.arange(5) + 0.5) / 5)), "same copies"),
    (resampling(lambda w, rng: by_weight((1 - w) / 4, rng)), "N w_i copies on average"),
    (resampling(by_weight, change=lambda poses, rng: poses.mean(axis=0) + 0 * poses), "none of the old ones"),
    (resampling(by_weight, weights_after=lambda w, a: np.zeros(len(w))), "not 1/N"),
]


def with_heading(heading, weighted=True):
    def mean_pose(poses, w):
        position = w @ poses[:, :2] if weighted else poses[:, :2].mean(axis=0)
        return np.array([*position, heading(np.sin(poses[:, 2]), np.cos(poses[:, 2]), w)])

    return mean_pose


def in_degrees(poses, w):
    theta = np.deg2rad(poses[:, 2])
    return [*(w @ poses[:, :2]), np.arctan2(w @ np.sin(theta), w @ np.cos(theta))]


def shifted_in_place(poses, w):
    poses[:, 2] %= 2 * np.pi
    return average_pose(poses, w)


WRONG_MEANS = [
    (lambda poses, w: w @ poses, "mean of the numbers"),
    (lambda poses, w: poses[np.argmax(w)], "heaviest particle"),
    (lambda poses, w: average_pose(poses), "weights play no part"),
    (lambda poses, w: poses.mean(axis=0), "weights play no part"),
    (with_heading(lambda sin, cos, w: np.arctan((w @ sin) / (w @ cos))), "Use arctan2"),
    (with_heading(lambda sin, cos, w: np.arctan2(w @ cos, w @ sin)), "sine first"),
    (with_heading(lambda sin, cos, w: np.arctan2(sin.mean(), cos.mean())), "without the weights"),
    (
        with_heading(lambda sin, cos, w: np.arctan2(w @ sin, w @ cos), weighted=False),
        "x and y are averaged without",
    ),
    (with_heading(lambda sin, cos, w: np.rad2deg(np.arctan2(w @ sin, w @ cos))), "in radians"),
    (with_heading(lambda sin, cos, w: w @ (np.arctan2(sin, cos) % (2 * np.pi))), "Modulo 2 pi"),
    (lambda poses, w: -average_pose(poses, w), "sign"),
    (lambda poses, w: w @ poses[:, :2], "shape"),
    (with_heading(lambda sin, cos, w: np.arccos(w @ cos)), "arccos"),
    (with_heading(lambda sin, cos, w: np.arcsin(w @ sin)), "arcsin"),
    (with_heading(lambda sin, cos, w: w @ sin), "arcsin"),
    (with_heading(lambda sin, cos, w: -np.arctan2(w @ sin, w @ cos)), "wrong sign"),
    (with_heading(lambda sin, cos, w: np.arctan2(-(w @ sin), -(w @ cos))), "looks back"),
    (with_heading(lambda sin, cos, w: np.arctan2(sin[0], cos[0])), "first particle"),
    (lambda poses, w: average_pose(poses, w)[[1, 0, 2]], "changed places"),
    (lambda poses, w: average_pose(poses, w**2), "as their squares"),
    (lambda poses, w: average_pose(poses, w) * len(poses), "N times the mean"),
    (lambda poses, w: np.median(poses, axis=0), "median"),
    (lambda poses, w: int(np.argmax(w)), "shape"),
    (lambda poses, w: [*(w @ poses[:, :2]), poses[np.argmax(w), 2]], "heaviest particle"),
    (lambda poses, w: average_pose(np.deg2rad(poses), w), "returns"),
    (in_degrees, "no deg2rad"),
    (shifted_in_place, "changes what it is given"),
]


@pytest.mark.parametrize(
    ("check", "answer", "words"),
    [(ch05.check_update, *pair) for pair in WRONG_UPDATES]
    + [(ch05.check_resample, *pair) for pair in WRONG_RESAMPLERS]
    + [(ch05.check_mean_pose, *pair) for pair in WRONG_MEANS],
)
def test_a_wrong_answer_is_refused_by_name(check, answer, words):
    verdict = check(answer)
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def test_every_scheme_makes_n_w_copies_on_average():
    table = copies_table()
    assert all(mean == pytest.approx(3.0, abs=0.12) for mean, _ in table.values())
    assert table["systematic"][1] < 0.05 < table["multinomial"][1]


def test_the_reports_settings_and_exact_scoring_as_the_chapter_says():
    errors = errors_by_label(read_table("ch05_report"))
    assert np.median(errors["report"]) > 0.4 > 0.02 > errors["refined"].max()
    scoring = stored_errors(LATTICE_TABLE)
    assert np.median(scoring["exact"]) < np.median(scoring["lattice"])
    assert np.ptp(scoring["exact"]) < np.ptp(scoring["lattice"])


def test_the_reports_cloud_is_small_and_wrong_and_the_refined_one_as_wide_as_its_error():
    study = read_table("ch05_report")
    inside, claimed, actual = (
        errors_by_label(study, column) for column in ("inside_90", "cloud_claimed_m", "cloud_actual_m")
    )
    assert inside["report"].max() < 0.1 < 0.5 < inside["refined"].min() < 0.9
    assert claimed["report"].max() < 0.1 * actual["report"].min()
    assert np.all(claimed["refined"] > actual["refined"])


def test_in_fifteen_cells_maps_of_their_own_come_out_right_and_a_shared_one_does_not():
    own, shared = (cells.success(own_maps, runs=40) for own_maps in (True, False))
    assert own["map"] > 0.3 > 0.1 > shared["map"]
    assert own["place"] > shared["place"]


def test_one_update_is_what_its_pictures_say():
    u = one_update()
    assert u.weights.sum() == pytest.approx(1.0)
    good, middling, bad = u.counts[u.chosen]
    assert good == u.counts.max() > middling > bad == u.counts.min()
    copies, share = np.bincount(u.ancestors, minlength=len(u.weights)), len(u.weights) * u.weights
    assert (np.abs(copies - share) < 1).all()


def test_the_window_moves_a_particle_to_where_it_scores_more():
    stand, best, moved = moved_to_best()
    assert (best >= stand).all()
    assert window_scores(0)[4, 4, 4] == stand[0]
    assert np.abs(moved - one_update().predicted).max() <= 0.2 + 1e-12
