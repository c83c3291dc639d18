"""What our runs over the public Intel log gave, stored, so that a real building is seen on every machine.

The study ``intel`` made them from the log, which is not part of the book.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.poses import Trajectory
from pfslam_book.show.artists import draw_map, draw_path
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import sheet
from pfslam_book.show.tables import Shown, errors_by_label, read_table

KEPT = ("dead reckoning", "scan matching", "report")
"""The methods whose first path and map are stored."""
FACTS = ("relations", "usable", "returns", "short", "short_median_m")
"""Columns that tell what the log can be judged by; they are the same in every row."""
RETURN_SECONDS = 60.0
"""A relation between poses further apart in time than this joins two visits to one place."""
SLIP = 0.1
"""A run whose returns are off by more than this in the mean (m) has slipped somewhere."""


def kept_file(method: str) -> Path:
    """Where the first run of a method is stored."""
    return Path(__file__).parent / f"intel_{method.replace(' ', '_')}.npz"


@cache
def _stored(method: str) -> dict[str, np.ndarray]:
    with np.load(kept_file(method), allow_pickle=False) as file:
        return dict(file)


def intel_facts() -> dict[str, float]:
    """Return how many relations the log has, how many can be used here, and how many of these join separate visits."""
    first = {name: float(values[0]) for name, values in read_table("intel").items() if name in FACTS}
    return {name: int(value) if value.is_integer() else value for name, value in first.items()}


def intel_errors(column: str = "returns_m") -> dict[str, np.ndarray]:
    """Return one figure of every run (m), an array over the seeds for each method."""
    return errors_by_label(read_table("intel"), column)


def intel_slips() -> dict[str, str]:
    """Return how many runs of each method slip, in words."""
    found = intel_errors("returns_m")
    return {label: f"{np.count_nonzero(errors > SLIP)} of {len(errors)}" for label, errors in found.items()}


def intel_table() -> Shown:
    """Return each method's errors over the returns and over all usable relations, as medians over the seeds."""
    columns = ("returns_m", "returns_worst_m", "returns_deg", "all_m")
    errors, rows = {column: intel_errors(column) for column in columns}, []
    slips = intel_slips()
    for label, found in errors["returns_m"].items():
        middle, worst, degrees, everything = (np.median(errors[column][label]) for column in columns)
        lengths = (f"{100 * value:.1f}" for value in (middle, worst))
        rows.append(
            (label, str(len(found)), *lengths, f"{degrees:.2f}", f"{100 * everything:.1f}", slips[label])
        )
    head = (
        "filter",
        "runs",
        "returns [cm]",
        "worst return [cm]",
        "returns [deg]",
        "all usable [cm]",
        "runs that slip",
    )
    return Shown(head, rows)


def intel_path(method: str) -> Trajectory:
    """Return the stored path of one method, with its first seed."""
    return Trajectory(_stored(method)["t"], _stored(method)["path"].astype(float))


def intel_map(method: str) -> OccupancyGrid:
    """Return the stored map of one method, with its first seed: the signs of its log-odds."""
    signs, (x, y, resolution) = _stored(method)["map"], _stored(method)["corner"]
    return OccupancyGrid(GridSpec((float(x), float(y)), float(resolution), signs.shape), signs.astype(float))


def intel_picture() -> Picture:
    """Draw the real building as the report's filter and as scan matching map it."""
    figure, axes = sheet(4.4, columns=2)
    for ax, method in zip(axes, ("report", "scan matching"), strict=True):
        draw_map(ax, intel_map(method), method)
        draw_path(ax, intel_path(method), "estimate", "path")
    walked = float(np.hypot(*np.diff(intel_path("scan matching").poses[:, :2], axis=0).T).sum())
    alt = f"""Intel Research Lab, {walked:.0f} m driven. Left, the map of the report's filter: a smear that has left
    the building. Right, the map of one matched and aligned pose: corridors round a block of offices, each wall drawn
    once."""
    return Picture(figure, alt)
