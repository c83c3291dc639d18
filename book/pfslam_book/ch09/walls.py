"""Chapter 09: what a distance field cannot see. Two places that score alike, and the beams that tell them apart."""

from __future__ import annotations

import numpy as np

from pfslam.correlation import score_field
from pfslam.grid import GridSpec, trace_rays
from pfslam_book.show.tables import Shown

SPEC = GridSpec((-4.0, -3.0), 0.05, (120, 160))
WALLS_Y = (-1.0, 2.0)
INNER_Y = 1.0
"""Two long walls; the second place has one more, half way to the left wall."""
TOLERANCE = 2
"""A beam may cross this many occupied cells next to its end: walls are thick and ranges noisy."""


def room(inner_wall: bool) -> np.ndarray:
    """Return occupied cells ``(H, W)`` of one of the two places."""
    occupied = np.zeros(SPEC.shape, dtype=bool)
    for y in (*WALLS_Y, *((INNER_Y,) if inner_wall else ())):
        occupied[SPEC.world_to_cell([0.0, y])[1]] = True
    return occupied


def scan_without_inner_wall() -> np.ndarray:
    """Return end points ``(M, 2)`` (m) of a scan from the origin of the place without the inner wall."""
    angles = np.deg2rad(np.arange(-135.0, 135.0, 1.0))
    up = np.abs(np.sin(angles)) > 1e-6
    y = np.where(angles > 0, WALLS_Y[1], WALLS_Y[0])[up] + 0.02
    points = np.column_stack([y / np.tan(angles[up]), y])
    return points[np.abs(points[:, 0]) < 3.5]


def field_score(occupied: np.ndarray, points: np.ndarray) -> float:
    """Return the mean score per beam, from 0 to 1, in the distance field."""
    ix, iy = SPEC.world_to_cell(points).T
    field = score_field(occupied, "distance")
    return float(np.mean(field.values[iy, ix]) / field.top)


def blocked(occupied: np.ndarray, cells: np.ndarray) -> bool:
    """Tell whether a beam along ``cells (M, 2)`` (ix, iy), robot first, end point last, meets a wall before its end."""
    on_the_way = cells[: -1 - TOLERANCE]
    return bool(occupied[on_the_way[:, 1], on_the_way[:, 0]].any())


def blocked_share(occupied: np.ndarray, points: np.ndarray) -> float:
    """Return the share of the beams from the origin that had to pass through a wall."""
    start = SPEC.world_to_cell([0.0, 0.0])
    ends = SPEC.world_to_cell(points)
    return float(np.mean([blocked(occupied, line(start, end)) for end in ends]))


def line(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return cells ``(M, 2)`` of the beam from cell start to cell end, the end included."""
    return np.vstack([trace_rays(start, end[None]), end])


def walls_table() -> Shown:
    """Return score and share of blocked beams of one scan in the two places."""
    points, rows = scan_without_inner_wall(), []
    for name, inner in (("room", False), ("room with a wall through it", True)):
        place = room(inner)
        blocked_beams = f"{100 * blocked_share(place, points):.0f}"
        rows.append((name, f"{field_score(place, points):.2f}", blocked_beams))
    return Shown(("place", "score", "beams through walls [%]"), rows)
