"""The field of scores that a map gives: what an end point scores in each cell, renewed as the map is drawn.

The accurate filter looks its scores up here. The report's own count needs no field.
"""

from __future__ import annotations

import cv2
import numpy as np

FIELD_REACH = 4
"""Cells beyond which an occupied cell has no influence on the likelihood field.

At that distance the credit is 1000 exp(-8) = 0.3, which rounds to 0.
"""
CREDIT = np.rint(1000.0 * np.exp(-0.5 * np.arange(FIELD_REACH**2 + 1)))
"""The score of an end point at squared distance 0, 1, 2, ... (cells) from the nearest occupied cell.

Sums over up to 16,777 beams stay below 2^24, where float32 counts exactly.
"""
TOP = int(CREDIT[0])
"""The score of an end point that falls on an occupied cell."""
NEAR = float(CREDIT[4])
"""The least score of an end point that a wall explains: up to two cells away."""


def score_field(occupied: np.ndarray) -> np.ndarray:
    """Return what one end point scores in each cell, ``(H, W)`` float32, for occupied cells ``(H, W)`` bool.

    1000 exp(-d^2 / 2) with d the distance in cells to the nearest occupied cell, in whole numbers, cut off at 4 cells.
    This is the likelihood field of Thrun, Burgard and Fox ("Probabilistic Robotics", 6.4): a near miss scores too, so
    the best pose is not decided by how a wall happens to fall into cells.
    """
    if not occupied.any():
        return np.zeros(occupied.shape, dtype=np.float32)
    credit = np.zeros(256, dtype=np.float32)
    credit[: len(CREDIT)] = CREDIT
    return cv2.LUT(squared_distance(occupied, FIELD_REACH), credit)


def squared_distance(occupied: np.ndarray, reach: int) -> np.ndarray:
    """Square the distance (cells) to the nearest occupied cell, ``(H, W)`` uint8; above ``reach**2`` if it is farther.

    d^2 = dx^2 + dy^2 is separable: the nearest along each row first, then along the columns of the result.

    >>> squared_distance(np.array([[True, False, False], [False, False, False]]), reach=2)
    array([[0, 1, 4],
           [1, 2, 5]], dtype=uint8)
    """
    height, width = occupied.shape
    # All rows in one line, with gaps between them that are too wide to see across.
    squared = np.full((height, width + reach), reach**2 + 1, dtype=np.uint8)
    squared[:, :width][occupied] = 0
    lines = squared.reshape(-1)
    for stride in (1, width + reach):
        before = lines.copy()
        for k in range(1, reach + 1):
            farther, by = before + k**2, k * stride
            np.minimum(lines[by:], farther[:-by], out=lines[by:])
            np.minimum(lines[:-by], farther[by:], out=lines[:-by])
    return squared[:, :width]


def renew_field(field: np.ndarray, log_odds: np.ndarray, rectangle: tuple[slice, slice]) -> None:
    """Renew a field ``(H, W)``, in place, after the cells in ``rectangle`` of the map's ``log_odds`` have changed.

    Only around them is it computed again, so the cost does not depend on the size of the map.
    """
    (inner, outer) = (_widened(rectangle, log_odds.shape, n * FIELD_REACH) for n in (1, 2))
    inside = tuple(slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
    field[inner] = score_field(log_odds[outer] > 0)[inside]


def _widened(rectangle: tuple[slice, slice], shape: tuple[int, int], by: int) -> tuple[slice, slice]:
    rows, columns = (
        slice(max(r.start - by, 0), min(r.stop + by, n)) for r, n in zip(rectangle, shape, strict=True)
    )
    return rows, columns
