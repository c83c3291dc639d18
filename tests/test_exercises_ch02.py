"""Exercises of chapter 02: right answers in many styles, and wrong ones with the words for each."""

import math

import numpy as np
import pytest
from notebook_cells import check_nonsense_is_named

from pfslam.teaching.ch02 import check_cell_of, check_cell_story, check_meaning, check_update_log_odds

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


def meaning_by_rules(reading, range_min, range_max):
    if range_min <= reading <= range_max:
        return "hit"
    return "free" if reading > range_max else "nothing"


def meaning_by_numpy(reading, range_min, range_max):
    reading = np.float32(reading)
    return str(np.select([reading > range_max, reading >= range_min], ["free", "hit"], "nothing"))


@pytest.mark.parametrize(
    ("check", "answer"),
    [
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


def life(change=LOG_4, low=True, high=True, at_end=False, none=0.0, out=None, order=1):
    """A story told with one mistake."""

    def cell_story(story, clamp):
        level = 0.0
        for word in story[::order]:
            level += {"hit": change, "free": -change, "none": none}[word]
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
        (check_cell_of, lambda p, o, r: (p - o)[:, ::-1] / r, "returns"),
        (check_cell_of, lambda p, o, r: cells_by_division(p, o[::-1], r), "changed places"),
        (check_cell_of, lambda p, o, r: cells_by_division(p, o, 1 / r), "divide by it"),
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
