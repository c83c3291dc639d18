"""Your localiser, end to end: the page's own finds every robot, others may too, and what is wrong is said in words."""

import functools

import numpy as np
import pytest
from notebook_cells import run, source
from pfslam_book.ch10 import check_localiser, your_localiser
from pfslam_book.ch10.your_localiser import SEARCHES, Run, seconds

from pfslam.beyond.localization import (
    KnownMap,
    LocalizationConfig,
    LocalizationState,
    localization_step,
    spread,
)
from pfslam.particles import Particles
from pfslam.poses import average_pose

pytestmark = pytest.mark.slow

PARTS = ("move", "weigh", "bound", "resample", "alarm", "whole")


def page(grid, events, rng, first=20_000, alarm=True, **parts):
    """The localiser of the chapter, from the very cells that the reader sees, with some of its functions replaced."""
    names: dict = {}
    for tag in ("setup", *(f"localiser-{part}" for part in PARTS)):
        run(source("10", tag), names)
    names |= parts
    start = names["anywhere"](grid, first, rng)
    return names["localise"](grid, events, start, rng, names["Alarm"]() if alarm else None)


def by_package(grid, events, rng):
    """The package's localiser, one scan after the other, as a generator; its weights do not sum to 1."""
    known = KnownMap.of(grid, LocalizationConfig(first=20_000))
    state = LocalizationState(Particles(spread(grid, 20_000, rng), np.zeros(20_000)))
    for event in events:
        state, info = localization_step(state, event, known, rng)
        yield info.t, info.particles.poses, 7 * info.particles.weights


@pytest.fixture
def hall_only(monkeypatch):
    """One building is enough for a wrong answer."""
    cases = your_localiser.buildings()
    monkeypatch.setattr(your_localiser, "buildings", lambda: {"hall": cases["hall"]})


def test_the_page_finds_every_robot_beside_the_book():
    verdict = check_localiser(functools.partial(page, first=100_000))
    assert verdict, verdict
    assert verdict.message.count("the book's") == 2
    assert verdict.message.count("never") <= 1  # not on every processor the same


@pytest.mark.parametrize("way", ["generator", "one pose"])
def test_another_way_to_answer_is_right_too(hall_only, way):
    def one_pose(grid, events, rng):
        return [[s.t, [average_pose(s.poses, s.weights)], [1]] for s in page(grid, events, rng)]

    verdict = check_localiser(by_package if way == "generator" else one_pose)
    assert verdict, verdict


def no_likelihood(poses, *scan):
    return np.zeros(len(poses))


def in_the_world(poses, motion, rng):
    return poses + motion + [0.01, 0.01, 0.005] * rng.standard_normal(poses.shape)


LOST = {
    "draw some anew": {"alarm": False},
    "enough particles": {"first": 20, "alarm": False},
    "the weight was elsewhere": {"log_likelihood": no_likelihood},
    "in the direction that it faces": {"predict": in_the_world, "alarm": False},
}


@pytest.mark.parametrize("words", LOST)
def test_a_robot_that_is_not_found_and_why(hall_only, words):
    verdict = check_localiser(functools.partial(page, **LOST[words]))
    assert verdict.verdict == "wrong"
    assert "never" in verdict.message
    assert words in verdict.message


def every_scan(make):
    """A localiser that makes something of every scan."""
    return lambda grid, events, rng: [make(event) for event in events]


SHAPES = {
    "for each scan that you use": every_scan(lambda event: event.motion),
    "the cloud after weighing": every_scan(lambda event: (event.t, np.zeros(3), 1.0)),
    "not numbers": every_scan(lambda event: (event.t, np.zeros((2, 3)), [np.nan, np.nan])),
    "Add their logarithms": every_scan(lambda event: (event.t, np.zeros((2, 3)), [0.0, 0.0])),
    "take event.t": every_scan(lambda event: (0.1, np.zeros((2, 3)), [0.5, 0.5])),
    "ZeroDivisionError": every_scan(lambda event: 1 / 0),
}


@pytest.mark.parametrize("words", SHAPES)
def test_an_answer_of_another_kind_is_told_what_is_missing(words):
    verdict = check_localiser(SHAPES[words])
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def test_a_stub_is_unanswered():
    assert check_localiser(lambda grid, events, rng: ...).verdict == "unanswered"


def test_a_search_ends_when_the_weight_stays_at_the_robot():
    t = np.arange(0.0, 24.0)
    share = np.where((t >= 6) & (t != 9) & (t < 20), 0.9, 0.1)
    found = seconds(Run(t, share, share > 0, np.ones(24)))
    assert [begin for begin, _ in SEARCHES] == [0.0, 4.0, 14.0]
    assert found == [np.inf, 6.0, np.inf]  # 9 s: lost for a moment; from 20 s on: lost for good
