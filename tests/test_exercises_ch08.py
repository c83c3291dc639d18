"""Exercises of chapter 08: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
import pytest
from notebook_cells import defined

import pfslam
from pfslam.teaching.ch08.checks import check_diagnosis, check_find_shift, check_looks_broken
from pfslam.teaching.ch08.mystery import FAULTS, MysteryRobot, mystery

SEED = 1  # of the robots in the chapter


def from_notebook(tag, name, **names):
    checks = {
        "check_looks_broken": check_looks_broken,
        "check_find_shift": check_find_shift,
        "check_diagnosis": check_diagnosis,
    }
    return defined("08", tag, **checks, **names)[name]


@pytest.fixture(scope="module")
def robots():
    return mystery(pfslam.load("hall"), SEED)


def test_looks_broken_stub_and_solution():
    assert check_looks_broken(from_notebook("exercise-1", "looks_broken")).verdict == "unanswered"
    assert check_looks_broken(from_notebook("solution-1", "looks_broken_solution"))


POSES = np.column_stack([np.arange(5.0), 10.0 + np.arange(5.0), 0.1 * np.arange(5.0)])
WEIGHTS = np.array([0.4, 0.3, 0.2, 0.1, 0.0])


def offspring_only(resample):
    rng, mean = np.random.default_rng(0), np.zeros(5)
    for _ in range(500):
        new, _ = resample(POSES, WEIGHTS, rng)
        mean += np.bincount(new[:, 0].astype(int), minlength=5) / 500
    return not np.allclose(mean, 5 * WEIGHTS, atol=0.2)


def test_looks_broken_hints():
    def one_call(resample):
        new, _ = resample(POSES, WEIGHTS, np.random.default_rng(0))
        return not np.array_equal(np.bincount(new[:, 0].astype(int), minlength=5), [2, 2, 1, 0, 0])

    def weights_only(resample):
        return not np.allclose(resample(POSES, WEIGHTS, np.random.default_rng(0))[1], 0.2)

    def weights_too(resample):
        return weights_only(resample) or offspring_only(resample)

    assert "average" in check_looks_broken(one_call).message
    assert "without looking at the weights" in check_looks_broken(weights_only).message
    assert "old weights" in check_looks_broken(offspring_only).message
    assert "whole rows" in check_looks_broken(weights_too).message
    assert "accuses" in check_looks_broken(lambda resample: True).message
    assert "True or False" in check_looks_broken(lambda resample: "maybe").message
    assert "ZeroDivisionError" in check_looks_broken(lambda resample: 1 / 0).message


def test_find_shift_stub_and_solution():
    assert check_find_shift(from_notebook("exercise-2", "find_shift")).verdict == "unanswered"
    assert check_find_shift(from_notebook("solution-2", "find_shift_solution"))


def grid_search(step, low=-0.3, pick=np.argmin):
    def find_shift(cells):
        shifts = np.arange(low, 0.3001, step)
        return shifts[pick([cells(s) for s in shifts])]

    return find_shift


def test_find_shift_hints():
    assert "other sign" in check_find_shift(lambda cells: -grid_search(0.01)(cells)).message
    assert "most blurred" in check_find_shift(grid_search(0.01, pick=np.argmax)).message
    assert "too coarse" in check_find_shift(grid_search(0.1)).message
    assert "negative" in check_find_shift(grid_search(0.01, low=0.0)).message
    assert "seconds" in check_find_shift(lambda cells: "late").message
    assert "minimum at" in check_find_shift(lambda cells: -0.25).message


def test_diagnosis_stub_and_solution(robots):
    stub = from_notebook("exercise-3", "diagnosis", robots=robots)
    assert check_diagnosis(stub, robots).verdict == "unanswered"
    assert check_diagnosis(from_notebook("solution-3", "diagnosis_solution", robots=robots), robots)


def robot(fault, **numbers):
    healthy = {"delay [s]": 0.0, "lever [m]": 0.01, "turn ratio": 1.0, "cut scans": 0.0, "metres lost": 0.0}
    return MysteryRobot("A", fault, healthy | {k.replace("_", " "): v for k, v in numbers.items()}, None)


def test_diagnosis_hints_name_the_number_that_rules_an_answer_out():
    late = robot("clock")
    late.numbers["delay [s]"] = 0.14
    assert "lever [m] is 0.01" in check_diagnosis({"A": "lever arm"}, [late]).message
    assert "delay [s]: 0.14" in check_diagnosis({"A": "healthy"}, [late]).message
    assert "delay [s] is 0.00" in check_diagnosis({"A": "clock"}, [robot("healthy")]).message
    turned = robot("track", turn_ratio=1.91)
    assert "compare the instruments" in check_diagnosis({"A": "clock"}, [turned]).message
    closed = robot("renumbered beams", cut_scans=1.0)
    assert "raw scans" in check_diagnosis({"A": "lever arm"}, [closed]).message
    assert "none of" in check_diagnosis({"A": "bad luck"}, [late]).message
    assert "dictionary" in check_diagnosis({"B": "clock"}, [late]).message
    assert "dictionary" in check_diagnosis("clock", [late]).message


def test_each_robot_shows_its_own_fault(robots):
    """The number that the hints point to is the one that stands out."""
    stands_out = {
        "healthy": lambda n: abs(n["delay [s]"]) < 0.03 and abs(n["lever [m]"]) < 0.05,
        "clock": lambda n: abs(n["delay [s]"]) > 0.05,
        "lever arm": lambda n: abs(n["lever [m]"]) > 0.12,
        "track": lambda n: n["turn ratio"] > 1.5,
        "renumbered beams": lambda n: n["cut scans"] > 0.9,
        "lost second": lambda n: n["metres lost"] > 0.4,
    }
    assert set(stands_out) == set(FAULTS)
    assert len({r.fault for r in robots}) == len(robots) == 4
    for r in robots:
        assert stands_out[r.fault](r.numbers), (r.fault, r.numbers)
        raw = [f for f in ("track", "renumbered beams", "lost second") if stands_out[f](r.numbers)]
        assert raw in ([], [r.fault])
