"""Exercises of chapter 04: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
import pytest
from notebook_cells import defined

from pfslam.teaching.ch04.checks import check_choose, check_count_on_walls, check_transform_test


def from_notebook(tag, name):
    return defined("04", tag)[name]


def counting(rounding=np.floor, transposed=False, guard="both", move=True):
    """A count of points on walls with one thing wrong."""

    def count(points, occupied, origin, resolution):
        ix, iy = rounding((points - np.array(origin) * move) / resolution).astype(int).T
        if transposed:
            ix, iy = iy, ix
        keep = np.ones(len(ix), dtype=bool)
        if guard in ("both", "upper"):
            keep = (ix < occupied.shape[1]) & (iy < occupied.shape[0])
        if guard == "both":
            keep &= (ix >= 0) & (iy >= 0)
        if guard == "clip":
            ix, iy = np.clip(ix, 0, occupied.shape[1] - 1), np.clip(iy, 0, occupied.shape[0] - 1)
        return occupied[iy[keep], ix[keep]].sum()

    return count


def test_count_stub_and_solution():
    assert check_count_on_walls(from_notebook("exercise-1", "count_on_walls")).verdict == "unanswered"
    assert check_count_on_walls(from_notebook("solution-1", "count_on_walls_solution"))


def test_count_hints():
    assert check_count_on_walls(counting())
    assert "floor, not round" in check_count_on_walls(counting(np.rint)).message
    assert "occupied[iy, ix]" in check_count_on_walls(counting(transposed=True)).message
    assert "subtract it" in check_count_on_walls(counting(move=False)).message
    assert "last column" in check_count_on_walls(counting(guard="upper")).message
    assert "do not clip" in check_count_on_walls(counting(guard="clip")).message
    assert "not stop the robot" in check_count_on_walls(counting(guard="none")).message
    assert "inside the grid" in check_count_on_walls(lambda p, occupied, origin, resolution: 6).message
    assert "ZeroDivisionError" in check_count_on_walls(lambda *arguments: 1 / 0).message


def test_choose_stub_and_solution():
    assert check_choose(from_notebook("exercise-2", "choose")).verdict == "unanswered"
    assert check_choose(from_notebook("solution-2", "choose_solution"))


def test_choose_hints():
    def last(scores, steps):
        return len(scores) - 1 - np.argmax(scores[::-1])

    def random_tie(scores, steps):
        return np.random.default_rng(0).choice(np.flatnonzero(scores == scores.max()))

    assert "first of equals" in check_choose(lambda scores, steps: np.argmax(scores)).message
    assert "last of equals" in check_choose(last).message
    assert "says nothing" in check_choose(random_tie).message
    assert "best score" in check_choose(lambda scores, steps: scores.max()).message
    assert (
        "only settles ties" in check_choose(lambda scores, steps: np.argmin((steps**2).sum(axis=1))).message
    )
    assert "index from 0" in check_choose(lambda scores, steps: steps[np.argmax(scores)]).message


def test_transform_test_stub_and_solution():
    assert check_transform_test(from_notebook("exercise-3", "transform_works")).verdict == "unanswered"
    assert check_transform_test(from_notebook("solution-3", "transform_works_solution"))


def one_point(pose, expected):
    return lambda transform: np.allclose(transform(np.array(pose), np.array([[2.0, 0.0]])), [expected])


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (one_point([0.0, 0.0, 0.0], [2.0, 0.0]), "ignores x and y"),
        (one_point([0.0, 0.0, np.pi / 2], [0.0, 2.0]), "ignores x and y"),
        (one_point([3.0, 1.0, 0.0], [5.0, 1.0]), "wrong way round"),
        (one_point([3.0, 1.0, np.pi / 2], [3.0, -1.0]), "rejects the right"),
        (lambda transform: True, "ignores x and y"),
        (lambda transform: 2.0, "True or False"),
        (lambda transform: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_transform_test_hints(answer, words):
    assert words in check_transform_test(answer).message


def test_turning_and_shifting_apart_misses_the_order():
    turning, shifting = one_point([0, 0, np.pi / 2], [0.0, 2.0]), one_point([3.0, 1.0, 0.0], [5.0, 1.0])
    apart = check_transform_test(lambda transform: turning(transform) and shifting(transform))
    assert "shifts first" in apart.message
