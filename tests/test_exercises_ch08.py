"""Exercises of chapter 08: right answers in many styles, and the mistakes that the hints are written for."""

import numpy as np
import pytest
from pfslam_book.ch08.mystery import FAULTS, MysteryRobot, mystery
from pfslam_book.exercises.ch08 import check_diagnosis, check_find_shift, check_looks_broken

import pfslam

SEED = 1  # of the robots in the chapter


@pytest.fixture(scope="module")
def robots():
    return mystery(pfslam.load("hall"), SEED)


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
    assert "returns nothing" in check_looks_broken(lambda resample: None).message
    assert "ZeroDivisionError" in check_looks_broken(lambda resample: 1 / 0).message


def by_loop(resample):
    rng, counts = np.random.default_rng(3), [0] * 5
    for _ in range(400):
        new, new_weights = resample(POSES, WEIGHTS, rng)
        for row in new:
            found = [k for k in range(5) if list(row) == list(POSES[k])]
            if not found:
                return True
            counts[found[0]] += 1
        if max(abs(w - 0.2) for w in new_weights) > 1e-9:
            return True
    return any(abs(c / 400 - 5 * w) > 0.2 for c, w in zip(counts, WEIGHTS, strict=True))


LOOKS_BROKEN = {
    "a loop": by_loop,
    "0 and 1": lambda resample: int(by_loop(resample)),
    "NumPy's truth values": lambda resample: np.bool_(by_loop(resample)),
    "an array": lambda resample: np.array(by_loop(resample)),
    "a float": lambda resample: float(by_loop(resample)),
    "asked twice": lambda resample: by_loop(resample) and by_loop(resample),
}


@pytest.mark.parametrize("name", LOOKS_BROKEN)
def test_looks_broken_accepts_it_in_any_style(name):
    assert check_looks_broken(LOOKS_BROKEN[name])


def grid_search(step, low=-0.3, high=0.3, pick=np.argmin):
    def find_shift(cells):
        shifts = np.arange(low, high + 1e-4, step)
        return shifts[pick([cells(s) for s in shifts])]

    return find_shift


def in_two_passes(cells):
    best = 0.0
    for step in (0.05, 0.005):
        best = min((best + k * step for k in range(-7, 8)), key=cells)
    return best


def with_scipy(cells):
    from scipy.optimize import minimize_scalar

    return minimize_scalar(cells, bounds=(-0.3, 0.3), method="bounded").x


FIND_SHIFT = {
    "solution in 5 ms": grid_search(0.005),
    "a list and min": lambda cells: min([k / 100 for k in range(-30, 31)], key=cells),
    "float32": lambda cells: np.float32(grid_search(0.01)(cells)),
    "an array of one": lambda cells: np.array([grid_search(0.01)(cells)]),
    "two passes": in_two_passes,
    "scipy": with_scipy,
    "a dictionary": lambda cells: min((cells(s / 100), s / 100) for s in range(-30, 31))[1],
}


@pytest.mark.parametrize("name", FIND_SHIFT)
def test_find_shift_accepts_it_in_any_style(name):
    assert check_find_shift(FIND_SHIFT[name])


WRONG_SHIFTS = {
    "other sign": lambda cells: -grid_search(0.001)(cells),
    "most blurred": grid_search(0.01, pick=np.argmax),
    "too coarse": grid_search(0.1),
    "negative shifts": grid_search(0.01, low=0.0),
    "positive shifts": grid_search(0.01, high=0.0),
    "-0.1 to 0.1": grid_search(0.01, low=-0.1, high=0.1),
    "place of the shift": lambda cells: int(np.argmin([cells(s) for s in np.arange(-0.3, 0.3001, 0.01)])),
    "number of cells": lambda cells: min(cells(s) for s in np.arange(-0.3, 0.3001, 0.01)),
    "milliseconds": lambda cells: 1000 * grid_search(0.001)(cells),
    "One number": lambda cells: "late",
    "lost the sign": lambda cells: abs(grid_search(0.001)(cells)),
    "-0.25 to 0.25": grid_search(0.01, low=-0.25, high=0.25),
    "function returns '": lambda cells: str(grid_search(0.01)(cells)),
    "returns -0.25": lambda cells: -0.25,
}


@pytest.mark.parametrize("words", WRONG_SHIFTS)
def test_find_shift_names_the_mistake(words):
    assert words in check_find_shift(WRONG_SHIFTS[words]).message


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
