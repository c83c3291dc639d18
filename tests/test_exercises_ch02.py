"""Exercises of chapter 02: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
import pytest
from notebook_cells import check_nonsense_is_named, check_stub_and_solution

from pfslam.teaching.ch02.checks import (
    check_cell_of,
    check_cell_story,
    check_meaning,
    check_write_scan,
)

EXERCISES = [
    (check_cell_of, "cell_of"),
    (check_cell_story, "cell_story"),
    (check_write_scan, "write_scan"),
    (check_meaning, "meaning"),
]
CHECKS = {check.__name__: check for check, _ in EXERCISES}
LOG_4 = np.log(4)


@pytest.mark.parametrize(("check", "name"), EXERCISES)
def test_stub_and_solution(check, name):
    check_stub_and_solution("02", 1 + EXERCISES.index((check, name)), name, check, CHECKS)


@pytest.mark.parametrize(("check", "name"), EXERCISES)
def test_nonsense_is_named_and_never_raises(check, name):
    check_nonsense_is_named(check, -7.0, 2)


def rounded_by(rule, swap=False, subtract=True):
    def cell_of(x, y, origin, resolution):
        low = origin if subtract else (0.0, 0.0)
        ix, iy = rule((x - low[0]) / resolution), rule((y - low[1]) / resolution)
        return (int(ix), int(iy)) if swap else (int(iy), int(ix))

    return cell_of


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (rounded_by(np.floor, swap=True), "transposed"),
        (rounded_by(np.rint), "disagree"),
        (rounded_by(lambda value: np.ceil(value) - 1), "a cell early"),
        (rounded_by(np.trunc), "towards zero"),
        (rounded_by(np.floor, subtract=False), "Subtract the origin"),
    ],
)
def test_cell_hints(wrong, words):
    assert words in check_cell_of(wrong).message


def life(change=LOG_4, clamp_at_end=False, none=0.0, out=lambda level: 1 / (1 + np.exp(-level))):
    def cell_story(story, clamp):
        level = 0.0
        for word in story:
            level += {"hit": change, "free": -change, "none": none}[word]
            level = level if clamp_at_end else min(max(level, -clamp), clamp)
        return out(min(max(level, -clamp), clamp))

    return cell_story


def test_story_hints():
    assert "too late" in check_cell_story(life(clamp_at_end=True)).message
    assert "not a free scan" in check_cell_story(life(none=-LOG_4)).message.replace("\n", " ")
    assert "natural" in check_cell_story(life(out=lambda level: 1 / (1 + 10.0**-level))).message
    assert "for the probability" in check_cell_story(life(out=lambda level: level)).message
    assert "odds are what" in check_cell_story(lambda story, clamp: 0.5 * 0.8**3 * 0.2).message


def writer(per_beam=False, free_last=False, both=False, clip=True, in_place=False):
    """A solution with one mistake."""

    def write_scan(log_odds, hits, free, step, clamp):
        grid = log_odds if in_place else log_odds.copy()
        change = np.zeros_like(grid)
        if per_beam:
            np.add.at(change, tuple(free.T), -step)
        else:
            change[tuple(free.T)] = -step
        if both:
            change[tuple(np.unique(hits, axis=0).T)] += step
        else:
            change[tuple(hits.T)] = step
        if per_beam and not both:
            change[tuple(hits.T)] = 0.0
            np.add.at(change, tuple(hits.T), step)
        if free_last:
            change[tuple(free.T)] = -step
        grid += change
        if clip:
            np.clip(grid, -clamp, clamp, out=grid)
        return grid

    return write_scan


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        ({"per_beam": True}, "independent proofs"),
        ({"free_last": True}, "overwrite"),
        ({"both": True}, "stays unknown"),
        ({"clip": False}, "thrown away"),
        ({"in_place": True}, "copy"),
    ],
)
def test_write_scan_hints(mistake, words):
    assert check_write_scan(writer())
    assert words in check_write_scan(writer(**mistake)).message


def test_a_repeated_index_is_added_once():
    def quietly_right(log_odds, hits, free, step, clamp):
        change = np.zeros_like(log_odds)
        change[tuple(free.T)] -= step  # three times the same cell: subtracted once
        change[tuple(hits.T)] = step
        return np.clip(log_odds + change, -clamp, clamp)

    assert check_write_scan(quietly_right)


def test_meaning_hints():
    def by(infinite="free", nan="nothing", near="nothing"):
        def meaning(reading, low, high):
            if np.isnan(reading):
                return nan
            if reading < low:
                return near
            return "hit" if reading <= high else infinite

        return meaning

    assert "ring of false wall" in check_meaning(by(infinite="hit")).message
    assert "not a number" in check_meaning(by(nan="free")).message
    assert "blinded" in check_meaning(by(near="hit")).message
    assert "good news" in check_meaning(by(infinite="nothing")).message
    assert "'hit', 'free' or 'nothing'" in check_meaning(lambda *arguments: True).message
