"""Chapter 07: the stored runs, by setting, by seed and by building."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from pfslam.study.table import Table
from pfslam_book.show.tables import ERROR, read_table, select


@cache
def stored(table: str) -> Table:
    """Read a stored table, once."""
    return read_table(table)


def errors(table: str, column: str = ERROR, **wanted: Any) -> np.ndarray:
    """Return one result of each run of a setting, in the order of the seeds."""
    rows = select(stored(table), **wanted)
    return rows[column][np.argsort(rows["seed"], kind="stable")]


def sweep(table: str, parameter: str, column: str = ERROR) -> dict[float, np.ndarray]:
    """Return for each value of a parameter of the report's filter in the hall one result for each seed."""
    values = np.unique(select(stored(table), label="report")[parameter])
    return {float(v): errors(table, column, label="report", **{parameter: v}) for v in values}


BASE: dict[str, Any] = {"label": "0.14 rad/s", "resample_below": 0.1}
LOUD: dict[str, Any] = {"label": "0.5 rad/s", "resample_below": 0.1}
CHANGES: dict[str, tuple[dict, dict]] = {
    "0.14 rad/s: 0.1 N to 0.9 N": (BASE, BASE | {"resample_below": 0.9}),
    "0.5 rad/s: 0.1 N to 0.9 N": (LOUD, LOUD | {"resample_below": 0.9}),
    "noise 0.14 to 0.5 rad/s": (BASE, LOUD),
    "both noise and threshold": (BASE, LOUD | {"resample_below": 0.9}),
    "100 particles to one": (BASE, {"label": "one particle"}),
    "every 10th to 20th scan": (BASE, {"label": "every 20th scan"}),
    "every 10th to 5th scan": (BASE, {"label": "every 5th scan"}),
    "report to refined": (BASE, {"label": "refined"}),
}
"""By name: the rows of the study over buildings that a change goes from and to."""


def by_building(column: str = ERROR, **wanted: Any) -> np.ndarray:
    """Return one result for each building: the mean over its runs of one setting."""
    rows = select(stored("ch07_buildings"), **wanted)
    buildings = rows["simulator.seed"]
    return np.array([rows[column][buildings == one].mean() for one in np.unique(buildings)])


def in_buildings(column: str = ERROR) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the results before and after each change, building by building."""
    return {name: (by_building(column, **a), by_building(column, **b)) for name, (a, b) in CHANGES.items()}
