"""Exercises of chapter 02: right answers in many styles, and wrong ones with the words for each."""

import math
from fractions import Fraction
from functools import reduce

import numpy as np
import pytest
from notebook_cells import check_nonsense_is_named
from pfslam_book.ch02 import check_cell_of, check_cell_story, check_meaning, check_update_log_odds

from pfslam.grid import GridSpec

EXERCISES = [
    (check_cell_of, "cell_of"),
    (check_cell_story, "cell_story"),
    (check_update_log_odds, "update_log_odds"),
    (check_meaning, "meaning"),
]
LOG_4 = np.log(4)


@pytest.mark.parametrize(("check", "name"), EXERCISES)
def test_nonsense_is_named_and_never_raises(check, name):
    check_nonsense_is_named(check, -7.0, 2)


# ---- right answers: loops, lists, tuples, float32, four digits, other ways to compute


def cells_in_a_loop(points, origin, resolution):
    found = []
    for x, y in points:
        found.append((math.floor((y - origin[1]) / resolution), math.floor((x - origin[0]) / resolution)))
    return found


def cells_by_division(points, origin, resolution):
    ix, iy = ((points - np.asarray(origin)) // resolution).T
    return np.stack([iy, ix], axis=1)


def cells_by_edges(points, origin, resolution):
    edges = [low + resolution * np.arange(-8, 40) for low in origin]
    ix, iy = (np.searchsorted(e, c, side="right") - 9 for e, c in zip(edges, points.T, strict=True))
    return np.column_stack([iy, ix]).astype(np.int16)


def cells_in_float32(points, origin, resolution):
    cells = (np.float32(points) - np.float32(origin)) / np.float32(resolution)
    return np.floor(cells)[:, [1, 0]]


def cells_by_complex_numbers(points, origin, resolution):
    z = ((points @ [1, 1j]) - complex(*origin)) / resolution
    return [[math.floor(p.imag), math.floor(p.real)] for p in z]


def cells_of_the_package(points, origin, resolution):
    return GridSpec(tuple(origin), resolution, (3, 3)).world_to_cell(points)[:, ::-1]


def story_by_odds(story, clamp):
    odds = 1.0
    for word in story:
        odds *= {"hit": 4, "free": 1 / 4, "none": 1}[word]
        odds = max(min(odds, math.exp(clamp)), math.exp(-clamp))
    return odds / (1 + odds)


def story_by_bayes(story, clamp):
    gamma, most = 0.5, 1 / (1 + np.exp(-clamp))
    for word in story:
        if word != "none":
            p, q = (0.8, 0.2) if word == "hit" else (0.2, 0.8)
            gamma = p * gamma / (p * gamma + q * (1 - gamma))
        gamma = np.clip(gamma, 1 - most, most)
    return [round(float(gamma), 4)]


def story_in_array(story, clamp):
    steps = np.select([np.array(story) == "hit", np.array(story) == "free"], [LOG_4, -LOG_4], 0.0)
    level = np.float32(0)
    for step in steps.astype(np.float32):
        level = np.minimum(np.maximum(level + step, -clamp), clamp)
    return np.float32(1) / (1 + np.exp(-level))


def story_by_reduce(story, clamp):
    steps = map({"hit": LOG_4, "free": -LOG_4, "none": 0.0}.__getitem__, story)
    level = reduce(lambda level, step: sorted((-clamp, level + step, clamp))[1], steps, 0.0)
    return (1 + math.tanh(level / 2)) / 2


def story_in_fractions(story, clamp):
    odds, most = Fraction(1), Fraction(math.exp(clamp))
    for word in story:
        odds = min(max(odds * {"hit": 4, "free": Fraction(1, 4), "none": 1}[word], 1 / most), most)
    return odds / (1 + odds)


def story_by_accumulating(story, clamp):
    steps = [0.0] + [LOG_4 * ((word == "hit") - (word == "free")) for word in story]
    clipped = np.frompyfunc(lambda level, step: np.clip(level + step, -clamp, clamp), 2, 1)
    return np.array([1 / (1 + np.exp(-clipped.accumulate(np.array(steps, dtype=object))[-1]))])


def write_by_sets(log_odds, hits, free, hit_step, free_step, clamp):
    new = [list(row) for row in log_odds]
    struck = {tuple(cell) for cell in hits.tolist()}
    for iy, ix in struck | {tuple(cell) for cell in free.tolist()}:
        change = hit_step if (iy, ix) in struck else -free_step
        new[iy][ix] = min(max(new[iy][ix] + change, -clamp), clamp)
    return new


def write_by_masks(log_odds, hits, free, hit_step, free_step, clamp):
    struck, crossed = np.zeros(log_odds.shape, bool), np.zeros(log_odds.shape, bool)
    struck[tuple(hits.T)], crossed[tuple(free.T)] = True, True
    return np.clip(log_odds + hit_step * struck - free_step * (crossed & ~struck), -clamp, clamp)


def write_by_repeated_index(log_odds, hits, free, hit_step, free_step, clamp):
    change = np.zeros_like(log_odds, dtype=np.float32)
    change[tuple(free.T)] -= free_step  # three times the same cell: subtracted once
    change[tuple(hits.T)] = hit_step
    return np.clip(np.float32(log_odds) + change, -clamp, clamp)


def write_by_flat_index(log_odds, hits, free, hit_step, free_step, clamp):
    columns = log_odds.shape[1]
    struck, crossed = (np.unique(cells @ [columns, 1]) for cells in (hits, free))
    new = log_odds.ravel().copy()
    new[struck] += hit_step
    new[np.setdiff1d(crossed, struck)] -= free_step
    return new.clip(-clamp, clamp).reshape(log_odds.shape)


def write_by_complex_cells(log_odds, hits, free, hit_step, free_step, clamp):
    iy, ix = np.indices(log_odds.shape)
    struck, crossed = (np.isin(iy + 1j * ix, cells @ [1, 1j]) for cells in (hits, free))
    return np.clip(log_odds + np.select([struck, crossed], [hit_step, -free_step]), -clamp, clamp)


def write_in_float32(log_odds, hits, free, hit_step, free_step, clamp):
    return np.float32(write_by_masks(np.float32(log_odds), hits, free, hit_step, free_step, clamp))


def meaning_by_rules(reading, range_min, range_max):
    if range_min <= reading <= range_max:
        return "hit"
    return "free" if reading > range_max else "nothing"


def meaning_by_numpy(reading, range_min, range_max):
    reading = np.float32(reading)
    return str(np.select([reading > range_max, reading >= range_min], ["free", "hit"], "nothing"))


def meaning_by_bisection(reading, range_min, range_max):
    if math.isnan(reading):
        return "nothing"
    return ["nothing", "hit", "free"][(reading >= range_min) + (reading > range_max)]


def meaning_by_match(reading, range_min, range_max):
    match reading:
        case r if r > range_max:
            return "free"
        case r if r >= range_min:
            return "hit"
        case _:
            return "nothing"


def meaning_by_replacing(reading, range_min, range_max):
    reading = float(np.nan_to_num(reading, nan=-1.0, posinf=1e9, neginf=-1.0))
    return "free" if reading > range_max else "hit" if reading >= range_min else "nothing"


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (check_cell_of, cells_in_float32),
        (check_cell_of, cells_by_complex_numbers),
        (check_cell_of, cells_of_the_package),
        (check_cell_story, story_by_reduce),
        (check_cell_story, story_in_fractions),
        (check_cell_story, story_by_accumulating),
        (check_update_log_odds, write_by_flat_index),
        (check_update_log_odds, write_by_complex_cells),
        (check_update_log_odds, write_in_float32),
        (check_meaning, meaning_by_bisection),
        (check_meaning, meaning_by_match),
        (check_meaning, meaning_by_replacing),
        (check_meaning, lambda *a: np.str_(meaning_by_rules(*a))),
        (check_cell_of, cells_in_a_loop),
        (check_cell_of, cells_by_division),
        (check_cell_of, cells_by_edges),
        (check_cell_of, lambda *a: tuple(map(list, cells_in_a_loop(*a)))),
        (check_cell_story, story_by_odds),
        (check_cell_story, story_by_bayes),
        (check_cell_story, story_in_array),
        (check_update_log_odds, write_by_sets),
        (check_update_log_odds, write_by_masks),
        (check_update_log_odds, write_by_repeated_index),
        (check_update_log_odds, lambda *a: np.round(write_by_masks(*a), 4)),
        (check_meaning, meaning_by_rules),
        (check_meaning, meaning_by_numpy),
    ],
)
def test_the_same_in_another_style_is_right_too(check, answer):
    assert check(answer), check(answer)


# ---- wrong answers


def rounded_by(rule, swap=False, subtract=True):
    def cell_of(points, origin, resolution):
        cells = rule((points - (origin if subtract else 0)) / resolution).astype(int)
        return cells if swap else cells[:, ::-1]

    return cell_of


def separately(points, origin, resolution):
    return (np.floor(points / resolution) - np.floor(origin / resolution))[:, ::-1]


def shifted_in_place(points, origin, resolution):
    points -= origin
    return np.floor(points / resolution)[:, ::-1]


def life(change=LOG_4, low=True, high=True, at_end=False, none=0.0, out=None, order=1, start=0.0, free=None):
    """A story told with one mistake."""

    def cell_story(story, clamp):
        level = start
        for word in story[::order]:
            level += {"hit": change, "free": -change if free is None else free, "none": none}[word]
            level = max(level, -clamp) if low and not at_end else level
            level = min(level, clamp) if high and not at_end else level
        if at_end:
            level = min(max(level, -clamp), clamp)
        return out(level) if out else 1 / (1 + np.exp(-level))

    return cell_story


def writer(per_beam=False, free_last=False, both=False, clip=np.clip, in_place=False, raised=1):
    """A way to write a scan with one mistake."""

    def update_log_odds(log_odds, hits, free, hit_step, free_step, clamp):
        grid = log_odds if in_place else log_odds.copy()
        change = np.zeros_like(grid)
        if per_beam:
            np.add.at(change, tuple(free.T), -free_step)
        else:
            change[tuple(free.T)] = -free_step
        if both:
            change[tuple(np.unique(hits, axis=0).T)] += raised * hit_step
        elif per_beam:
            change[tuple(hits.T)] = 0.0
            np.add.at(change, tuple(hits.T), hit_step)
        else:
            change[tuple(hits.T)] = hit_step
        if free_last:
            change[tuple(free.T)] = -free_step
        grid += change
        return clip(grid, -clamp, clamp)

    return update_log_odds


def assigned(log_odds, hits, free, hit_step, free_step, clamp):
    new = log_odds.copy()
    new[tuple(free.T)], new[tuple(hits.T)] = -free_step, hit_step
    return new.clip(-clamp, clamp)


def block(log_odds, hits, free, hit_step, free_step, clamp):
    change = np.zeros_like(log_odds)
    change[np.ix_(*free.T)] = -free_step
    change[np.ix_(*hits.T)] = hit_step
    return np.clip(log_odds + change, -clamp, clamp)


def any_in(log_odds, hits, free, hit_step, free_step, clamp):
    new = log_odds.copy()
    for cell in np.unique(free, axis=0):
        if cell not in hits:
            new[tuple(cell)] -= free_step
    for cell in np.unique(hits, axis=0):
        new[tuple(cell)] += hit_step
    return np.clip(new, -clamp, clamp)


def by(infinite="free", nan="nothing", near="nothing"):
    def meaning(reading, low, high):
        if np.isnan(reading):
            return nan
        if reading < low:
            return near
        return "hit" if reading <= high else infinite

    return meaning


@pytest.mark.parametrize(
    ("check", "wrong", "words"),
    [
        (check_cell_of, rounded_by(np.floor, swap=True), "transposed"),
        (check_cell_of, rounded_by(np.rint), "nearest whole number"),
        (check_cell_of, rounded_by(np.ceil), "round up"),
        (check_cell_of, rounded_by(np.trunc), "towards zero"),
        (check_cell_of, rounded_by(np.floor, subtract=False), "Subtract the origin"),
        (check_cell_of, separately, "separately"),
        (check_cell_of, lambda *a: np.maximum(cells_by_division(*a), 0), "false wall"),
        (check_cell_of, lambda p, o, r: (p - o)[:, ::-1] / r, "Whole numbers"),
        (check_cell_of, lambda p, o, r: cells_by_division(p, o[::-1], r), "changed places"),
        (check_cell_of, lambda p, o, r: cells_by_division(p, o, 1 / r), "divide by it"),
        (check_cell_of, rounded_by(lambda cells: np.ceil(cells) - 1), "lower edge"),
        (check_cell_of, rounded_by(lambda cells: np.floor(cells - 0.5)), "Half a cell off"),
        (check_cell_of, rounded_by(np.trunc, swap=True), "Two things"),
        (check_cell_of, rounded_by(np.rint, swap=True), "Two things"),
        (check_cell_of, lambda p, o, r: np.trunc(p / r)[:, ::-1] - np.trunc(o / r)[::-1], "separately"),
        (check_cell_of, lambda *a: [-1, 1] * cells_by_division(*a), "Upside down"),
        (check_cell_of, shifted_in_place, "changes what it is given"),
        (check_cell_story, life(start=0.5), "log-odds of 0"),
        (check_cell_story, life(change=np.log(0.8), free=np.log(0.2)), "logarithm of the odds"),
        (check_cell_story, life(free=0.0), "changes nothing"),
        (check_cell_story, lambda s, c: life()(s, c * LOG_4), "Do not multiply"),
        (check_cell_story, lambda s, c: life()(" ".join(s).split("none")[-1].split(), c), "unknown again"),
        (check_cell_story, life(at_end=True), "clamp once, at the end"),
        (check_cell_story, life(low=False, high=False), "does nothing here"),
        (check_cell_story, life(low=False), "above only"),
        (check_cell_story, life(high=False), "below only"),
        (check_cell_story, life(order=-1), "backwards"),
        (check_cell_story, life(none=-LOG_4), "not a free scan"),
        (check_cell_story, life(out=lambda level: 1 / (1 + 10.0**-level)), "natural"),
        (check_cell_story, life(out=lambda level: level), "for the probability"),
        (check_cell_story, life(out=np.exp), "Those are the odds"),
        (check_cell_story, life(out=lambda level: 1 / (1 + np.exp(level))), "the cell is free"),
        (check_cell_story, life(change=np.log10(4)), "natural one"),
        (check_cell_story, life(change=1.0), "not 1"),
        (check_update_log_odds, writer(per_beam=True), "independent proofs"),
        (check_update_log_odds, writer(free_last=True), "overwrite"),
        (check_update_log_odds, writer(both=True), "gets both changes"),
        (check_update_log_odds, writer(both=True, raised=2), "raise them by two steps"),
        (check_update_log_odds, writer(clip=lambda v, low, high: v), "thrown away"),
        (check_update_log_odds, writer(clip=lambda v, low, high: np.minimum(v, high)), "above only"),
        (check_update_log_odds, writer(clip=lambda v, low, high: np.maximum(v, low)), "below only"),
        (check_update_log_odds, writer(in_place=True), "changes what it is given"),
        (check_update_log_odds, lambda m, h, f, u, d, c: writer()(m, h, f, u, u, c), "hit_step for the free"),
        (check_update_log_odds, lambda m, h, f, u, d, c: writer()(m, h, f, d, u, c), "have changed places"),
        (check_update_log_odds, lambda m, h, f, u, d, c: writer()(0 * m, h, f, u, d, c), "empty map"),
        (check_update_log_odds, assigned, "You set the cells"),
        (check_update_log_odds, block, "every listed row with every listed column"),
        (check_update_log_odds, any_in, "*any* number"),
        (check_update_log_odds, lambda m, h, f, u, d, c: writer()(m, h, f, u, 0, c), "crossed cells stay"),
        (check_update_log_odds, lambda m, h, f, u, d, c: writer()(m, h[:0], f, u, d, c), "hit cells do not rise"),
        (check_update_log_odds, lambda m, h, f, u, d, c: writer()(m, h, f, d, d, c), "free_step for the hits"),
        (check_update_log_odds, lambda m, h, f, u, d, c: writer()(m, h, f, -u, -d, c), "signs are exchanged"),
        (check_update_log_odds, lambda m, h, f, u, d, c: writer()(m, h, f, LOG_4, LOG_4, c), "whatever the arguments"),
        (check_update_log_odds, lambda m, h, f, u, d, c: writer()(m, h, f, u, d, 2 * LOG_4), "use clamp"),
        (check_update_log_odds, lambda *a: 1 / (1 + np.exp(-writer()(*a))), "probabilities"),
        (check_update_log_odds, lambda m, *a: writer()(m[::-1].copy(), *a)[::-1], "Upside down"),
        (check_update_log_odds, lambda m, h, f, *a: writer()(m, h[:, ::-1], f[:, ::-1], *a), "swapped"),
        (check_meaning, lambda r, low, high: by()(abs(r), low, high), "negative reading"),
        (check_meaning, lambda r, low, high: by()(r, 0.1, 30.0), "limits are fixed"),
        (check_meaning, lambda r, low, high: by()(r, low, 30.0), "limits are fixed"),
        (check_meaning, lambda r, low, high: by()(r, high, low), "changed places"),
        (check_meaning, lambda r, low, high: "free" if r >= high else by()(r, low, high), "exactly range_max"),
        (check_meaning, lambda r, low, high: "nothing" if r <= low else by()(r, low, high), "exactly range_min"),
        (check_meaning, by(infinite="hit"), "ring of false wall"),
        (check_meaning, by(nan="free"), "not a number"),
        (check_meaning, by(nan="hit"), "not a number"),
        (check_meaning, by(near="hit"), "blinded"),
        (check_meaning, by(near="free"), "blinded"),
        (check_meaning, by(infinite="nothing"), "good news"),
        (check_meaning, lambda r, low, high: "free" if np.isinf(r) else by()(r, low, high), "both signs"),
        (check_meaning, lambda *arguments: True, "'hit', 'free' or 'nothing'"),
    ],
)  # fmt: skip
def test_a_wrong_answer_is_named(check, wrong, words):
    verdict = check(wrong)
    assert not verdict
    assert words in verdict.message
