"""Exercises of chapter 10: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
import pytest
from notebook_cells import defined

from pfslam.teaching.ch10.checks import check_classify, check_increments, check_track

CHECKS = {"check_increments": check_increments, "check_track": check_track, "check_classify": check_classify}
EXERCISES = [
    ("1", "increments", check_increments),
    ("2", "track", check_track),
    ("3", "classify", check_classify),
]


@pytest.mark.parametrize(("number", "name", "check"), EXERCISES, ids=[e[1] for e in EXERCISES])
def test_stub_and_solution(number, name, check):
    assert check(defined("10", f"exercise-{number}", **CHECKS)[name]).verdict == "unanswered"
    assert check(defined("10", f"solution-{number}", **CHECKS)[f"{name}_solution"])


def test_increments_hints():
    def plain(readings):
        return np.diff(readings.astype(int), prepend=int(readings[0]))

    def modulo(readings):
        return plain(readings) % 256

    def from_zero(readings):
        return (np.diff(readings.astype(int), prepend=0) + 128) % 256 - 128

    assert "at its word" in check_increments(plain).message
    assert "look alike" in check_increments(modulo).message
    assert "did not start at zero" in check_increments(from_zero).message
    assert "nobody counted" in check_increments(lambda readings: np.diff(readings.astype(int))).message
    assert "NameError" in check_increments(lambda readings: nothing).message  # noqa: F821


def test_track_hints():
    def slope(apart, turned):
        return apart @ turned / (turned @ turned)

    with np.errstate(divide="ignore", invalid="ignore"):
        assert "did not turn" in check_track(lambda r, left, t: np.mean((r - left) / t)).message
    assert "sign" in check_track(lambda r, left, t: slope(left - r, t)).message
    assert "Upside down" in check_track(lambda r, left, t: 1 / slope(r - left, t)).message
    assert "Half" in check_track(lambda r, left, t: slope(r - left, t) / 2).message
    assert "cancel" in check_track(lambda r, left, t: (r - left).sum() / t.sum()).message
    assert "One number" in check_track(lambda r, left, t: r - left).message


def test_classify_hints():
    def simple(r, low, high):
        return "hit" if low <= r <= high else "free"

    def ring(r, low, high):
        return "hit" if r >= low else "unknown"

    def deaf(r, low, high):
        return "hit" if low <= r <= high else "unknown"

    assert "dirt" in check_classify(simple).message
    assert "ring" in check_classify(ring).message
    assert "that way is free" in check_classify(deaf).message
    assert (
        "NaN" in check_classify(lambda r, a, b: "unknown" if r < a else "hit" if r <= b else "free").message
    )
    assert "words" in check_classify(lambda r, a, b: 1).message
    assert "end point" in check_classify(lambda r, a, b: "free").message
