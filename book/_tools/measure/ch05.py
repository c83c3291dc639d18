"""Chapter 05: the reader's filter on the built-in hall, as it is printed and harmed."""

from __future__ import annotations

from typing import Any

from pfslam_book.ch05.your_filter import CHANGES, drive, error, my_filter, step

from measure import cases
from pfslam.io.datasets import load
from pfslam.study import Case, Study

WHOLE = 1e9
"""Seconds that no drive lasts."""
FEW = ["20/20", "20/10", "40/100", "40/60", "80/100"]
"""Every how many-th scan, and how many particles: what exercise 5 asks about."""


def errors(case: Case) -> dict[str, Any]:
    """Run it on the first ``seconds`` of the drive; the whole drive is run with more particles and fewer scans."""
    settings = dict(CHANGES[case.label], seed=case.get("seed"))
    if case.get("seconds") == WHOLE:
        settings |= {"particles": 200, "every": 10, "seconds": WHOLE}
    hall = load("hall")
    return {"ate_rmse_m": error(drive(step, my_filter("none"), hall, **settings), hall).ate_rmse_m}


def few(case: Case) -> dict[str, Any]:
    """Run the printed filter on the first 65 s with few particles, or few scans."""
    every, particles = map(int, case.label.split("/"))
    hall = load("hall")
    driven = drive(step, my_filter("none"), hall, particles, every, seed=case.get("seed"))
    return {"ate_rmse_m": error(driven, hall).ate_rmse_m}


STUDIES = [
    Study(
        "ch05_your_filter",
        "The printed filter on hall, as it is and harmed: on its first 65 s, and on the whole drive.",
        cases("change", change=CHANGES, seconds=[65], seed=range(10))
        + cases("change", change=CHANGES, seconds=[WHOLE], seed=range(5)),
        run=errors,
    ),
    Study(
        "ch05_few_particles",
        "How few particles and scans are enough for the printed filter, on the first 65 s of hall.",
        cases("few", few=FEW, seed=range(5)),
        run=few,
    ),
]
