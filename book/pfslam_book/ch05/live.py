"""Chapter 05: in the page a map for each particle, and a robot to drive and its filter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pfslam_book.show.lab import Laboratory, show_lab

TITLE = "Drive: the robot, its particles and the map that they make"
ALT = """Plan of a small building. Black walls and white floor have been drawn as far as the robot has seen; what it
has not seen is grey. The robot stands in a room on the upper right. Thin green beams run
from it to the walls and end in purple points that lie on the black cells. Two hundred blue dots, the
particles, fill the circle that stands for the robot."""

MAPS_ALT = """A corridor of fifteen cells with doors at 1, 4 and 10; the robot is in cell 3, early in its second
round. Below, the map on which forty particles agree, and the cells in which they believe they are: most of the
weight is in cell 3, some in 14. Then forty rows, one for each particle: its own map with the doors that it has
drawn, and a dot in its cell. Three groups of rows differ in where they have the third door. Lines at the left
lead from each row to the particle that was copied."""


def maps_lab() -> Laboratory:
    """Make the laboratory of fifteen cells: the doors are unknown, and each particle draws a map of its own."""
    return show_lab("maps", "SLAM in fifteen cells: the doors are unknown", MAPS_ALT)


def drive_lab(
    update: Callable | None = None,
    resample: Callable | None = None,
    *,
    rng: np.random.Generator | None = None,
) -> Laboratory:
    """Make the laboratory in which the reader drives; in JupyterLab the exercises' functions may replace ours.

    ``update(weights, likelihood)`` and ``resample(poses, weights, rng)`` are those of the exercises of this chapter.
    ``rng=None`` is seed 0.
    """
    dice = np.random.default_rng(0) if rng is None else rng
    parts: dict[str, Callable] = {}
    if update is not None:
        parts["update"] = update
    if resample is not None:
        parts["resample"] = lambda poses, weights: resample(poses.reshape(-1, 3), weights, dice)
    return show_lab("drive", TITLE, ALT, parts=parts)
