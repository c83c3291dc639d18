"""The occupancy grid: what the scans have said about each cell, as log-odds.

``log_odds[iy, ix]`` has row 0 at y_min. Zero means unknown. One function, ``GridSpec.world_to_cell``, turns metres
into cells; nothing else in the package does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import cv2
import numpy as np

from pfslam.errors import DataError
from pfslam.settings import Range, Settings

LOG_4 = float(np.log(4.0))
CELL_SIZES = Range(0.001, 10.0)
"""Metres: the least and the largest cell of a map."""
MAX_CELLS = 400_000_000
"""Most cells of a map, and of any piece of one that is cut out: a kilometre by a kilometre of 5 cm."""


def check_cells(what: str, shape, why: str) -> None:
    """Raise ``DataError`` for a rectangle ``shape`` (columns, rows) of more than ``MAX_CELLS``, before it takes memory.

    ``what`` names the part of the program that needs the rectangle, and ``why`` ends the sentence "W x H cells ...".
    """
    columns, rows = (int(n) for n in shape)
    if columns * rows > MAX_CELLS:
        raise DataError(
            what,
            "cells",
            f"{columns} x {rows} {why}",
            f"at most {MAX_CELLS} cells: look for a leap in odometry or ranges",
        )


@dataclass(frozen=True)
class GridSpec:
    """Where a grid lies: ``origin (2,)`` is the outer corner (x_min, y_min) of cell [0, 0], m; ``shape`` is (H, W).

    >>> spec = GridSpec((-1.0, -2.0), 0.05, (80, 40))
    >>> spec.world_to_cell([-0.97, -2.0]).tolist()
    [0, 0]
    >>> spec.cell_to_world([0, 0]).round(3).tolist()
    [-0.975, -1.975]
    """

    origin: tuple[float, float]
    resolution: float
    shape: tuple[int, int]

    def __post_init__(self):
        origin = tuple(float(c) for c in self.origin)
        shape = tuple(int(n) for n in self.shape)
        if len(origin) != 2 or not np.isfinite(origin).all():
            raise DataError("GridSpec", "origin", self.origin, "two finite coordinates in metres")
        if not (np.isfinite(self.resolution) and self.resolution > 0):
            raise DataError("GridSpec", "resolution", self.resolution, "a positive size in metres")
        if len(shape) != 2 or min(shape) < 1 or shape[0] * shape[1] > MAX_CELLS:
            raise DataError(
                "GridSpec", "shape", self.shape, f"(H, W), each at least 1, at most {MAX_CELLS} cells"
            )
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "shape", shape)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(x_min, x_max, y_min, y_max) in metres, as ``imshow(..., origin="lower", extent=...)`` takes it."""
        (x, y), (h, w) = self.origin, self.shape
        return x, x + w * self.resolution, y, y + h * self.resolution

    def world_to_cell(self, points_w) -> np.ndarray:
        """Return cells ``(..., 2)`` int (ix, iy) of points ``(..., 2)`` in m: floor((p - origin) / resolution)."""
        return np.floor((np.asarray(points_w) - self.origin) / self.resolution).astype(np.int64)

    def cell_to_world(self, cells) -> np.ndarray:
        """Return the centres ``(..., 2)`` in metres of cells ``(..., 2)`` given as (ix, iy)."""
        return (np.asarray(cells) + 0.5) * self.resolution + self.origin

    def contains(self, cells) -> np.ndarray:
        """Tell which cells ``(..., 2)``, given as (ix, iy), lie inside the grid (bool ``(...)``)."""
        cells = np.asarray(cells)
        ix, iy = cells[..., 0], cells[..., 1]
        return (ix >= 0) & (ix < self.shape[1]) & (iy >= 0) & (iy < self.shape[0])

    def grown(self, left: int, right: int, bottom: int, top: int) -> GridSpec:
        """Return the grid with so many cells more on each side."""
        (x, y), (h, w) = self.origin, self.shape
        origin = (x - left * self.resolution, y - bottom * self.resolution)
        return GridSpec(origin, self.resolution, (h + bottom + top, w + left + right))

    def covering(self, points_w: np.ndarray, margin: float = 5.0) -> GridSpec:
        """Return this grid if it covers the points ``(M, 2)``, else one that is larger by at least ``margin`` (m)."""
        cells = self.world_to_cell(points_w)
        low, high = cells.min(axis=0), cells.max(axis=0)
        width, height = self.shape[::-1]
        pad = int(np.ceil(margin / self.resolution))
        left, bottom = (pad - low[i] if low[i] < 0 else 0 for i in (0, 1))
        right, top = (high[i] - n + 1 + pad if high[i] >= n else 0 for i, n in ((0, width), (1, height)))
        if not (left or right or bottom or top):
            return self
        low_w, high_w = np.min(points_w, axis=0), np.max(points_w, axis=0)
        reach = f"to reach from ({low_w[0]:.0f}, {low_w[1]:.0f}) to ({high_w[0]:.0f}, {high_w[1]:.0f}) m"
        check_cells("map", (left + width + right, bottom + height + top), reach)
        return self.grown(int(left), int(right), int(bottom), int(top))

    @classmethod
    def around(cls, points_w, resolution: float, margin: float = 1.0) -> GridSpec:
        """Make the grid that covers points ``(M, 2)`` with a margin (m); its corner is a multiple of the resolution."""
        points = np.atleast_2d(points_w)
        low = np.floor((points.min(axis=0) - margin) / resolution)
        high = np.ceil((points.max(axis=0) + margin) / resolution)
        check_cells("map", high - low, "to hold all that was seen")
        width, height = (high - low).astype(int)
        return cls(tuple(low * resolution), resolution, (max(height, 1), max(width, 1)))


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A map: ``spec`` and ``log_odds (H, W)`` float32; above 0 occupied, below 0 free, 0 unknown (Eq. 14)."""

    spec: GridSpec
    log_odds: np.ndarray

    @classmethod
    def empty(cls, spec: GridSpec) -> OccupancyGrid:
        return cls(spec, np.zeros(spec.shape, dtype=np.float32))

    @property
    def occupied(self) -> np.ndarray:
        """Cells more likely occupied than free, ``(H, W)`` bool."""
        return self.log_odds > 0

    @property
    def free(self) -> np.ndarray:
        """Cells more likely free than occupied, ``(H, W)`` bool."""
        return self.log_odds < 0

    @property
    def probability(self) -> np.ndarray:
        """Probability that each cell is occupied, ``(H, W)``: gamma of Eq. 14."""
        return probability(self.log_odds)

    def copy(self) -> OccupancyGrid:
        """Return a grid of its own, which later scans do not change."""
        return OccupancyGrid(self.spec, self.log_odds.copy())


class Canvas:
    """Values of a grid that grows: a window into a larger block of zeros, so that growing rarely copies.

    ``values (H, W)`` is the window that belongs to ``spec``; who holds it sees what is written later, until the block
    is replaced by a larger one. A new block is half as long again on the side that was too short, so that all copying
    together stays proportional to the last block; untouched zeros take no memory.
    """

    def __init__(self, spec: GridSpec, dtype, values: np.ndarray | None = None):
        self.spec = spec
        self.block = np.zeros(spec.shape, dtype) if values is None else values
        self.corner = (0, 0)

    @property
    def values(self) -> np.ndarray:
        """The values ``(H, W)`` of the grid's own cells, to be read and written."""
        (row, column), (height, width) = self.corner, self.spec.shape
        return self.block[row : row + height, column : column + width]

    def copy(self) -> Canvas:
        """Return a canvas of its own with the same values."""
        return Canvas(self.spec, self.block.dtype, self.values.copy())

    def cover(self, spec: GridSpec) -> None:
        """Widen the window to a larger grid with the same resolution; new cells are zero."""
        left, below = np.rint(np.subtract(self.spec.origin, spec.origin) / spec.resolution).astype(int)
        row, column = self.corner[0] - int(below), self.corner[1] - int(left)
        rows = _room(row, spec.shape[0], self.block.shape[0])
        columns = _room(column, spec.shape[1], self.block.shape[1])
        if (rows, columns) != ((0, 0), (0, 0)):
            block = np.zeros(
                (self.block.shape[0] + sum(rows), self.block.shape[1] + sum(columns)), self.block.dtype
            )
            old = self.values
            at = self.corner[0] + rows[0], self.corner[1] + columns[0]
            block[at[0] : at[0] + old.shape[0], at[1] : at[1] + old.shape[1]] = old
            self.block = block
        self.spec, self.corner = spec, (row + rows[0], column + columns[0])

    def flat(self, cells: np.ndarray) -> np.ndarray:
        """Return where cells ``(..., 2)``, given as (ix, iy), lie in the flattened block."""
        return (cells[..., 1] + self.corner[0]) * self.block.shape[1] + cells[..., 0] + self.corner[1]


def _room(first: int, count: int, size: int) -> tuple[int, int]:
    """Return how many cells to add before and after ``size`` ones, for a window of ``count`` from ``first`` on."""
    extra = size // 2
    before = extra - first if first < 0 else 0
    after = first + count - size + extra if first + count > size else 0
    return before, after


def probability(log_odds):
    """Probability of log-odds: 1 / (1 + exp(-lambda)). Implements Eq. 14.

    >>> round(float(probability(np.log(4.0))), 2)
    0.8
    """
    return 1.0 / (1.0 + np.exp(-np.asarray(log_odds, dtype=float)))


def log_odds(probability):
    """Log-odds of a probability: log(p / (1 - p)), natural logarithm; log_odds(0.8) = log 4. Inverse of Eq. 14.

    >>> round(float(log_odds(0.8)), 3)
    1.386
    """
    p = np.asarray(probability, dtype=float)
    return np.log(p) - np.log1p(-p)


@dataclass(frozen=True)
class MapConfig(Settings):
    """How a scan is written into the map (Eq. 15). ``hit`` and ``free`` are positive amounts of log-odds."""

    resolution: Annotated[float, CELL_SIZES] = 0.05
    hit: Annotated[float, Range(0.0, 100.0)] = LOG_4
    free: Annotated[float, Range(0.0, 100.0)] = LOG_4
    clamp: Annotated[float, Range(0.0, np.inf)] = 2.0 * LOG_4
    rays: Literal["bresenham", "polygon"] = "polygon"
    """How free cells are found: "bresenham" traces every beam, "polygon" fills the outline of the scan."""

    def __post_init__(self):
        super().__post_init__()
        if 1e6 < self.clamp < np.inf:  # infinite for a map that never saturates; more than 1e6 is a slip
            raise DataError("MapConfig", "clamp", self.clamp, "a number from 0 to 1000000, or inf")


def trace_rays(start: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Find the cells ``(R, 2)`` that rays from cell ``start (2,)`` to cells ``ends (M, 2)`` cross, the ends left out.

    Bresenham's lines in whole numbers, all rays at once; a cell crossed by several rays appears several times.
    """
    steps = np.asarray(ends) - start
    length = np.abs(steps).max(axis=1)
    ray = np.repeat(np.arange(len(steps)), length)
    k = np.arange(len(ray)) - np.repeat(np.cumsum(length) - length, length)
    n = length[ray][:, None]
    # Along the longer axis one cell a step; along the shorter one k d / n, rounded half away from the start.
    magnitude = (2 * k[:, None] * np.abs(steps[ray]) + n) // (2 * n)
    return start + np.sign(steps[ray]) * magnitude


def free_cells(spec: GridSpec, points_w: np.ndarray, beams: np.ndarray, sensor_w: np.ndarray, rays: str):
    """Mask ``(h, w)`` uint8 the cells that a scan saw through, in the rectangle (slices) of the grid that it covers.

    ``points_w (M, 2)`` are the end points in beam order, ``beams (M,)`` their beam numbers, ``sensor_w (2,)`` the
    LiDAR. Where beam numbers jump, beams had no return: they clear nothing, and the outline goes back to the sensor.
    """
    ends, start = spec.world_to_cell(points_w), spec.world_to_cell(sensor_w)
    low, high = np.minimum(ends.min(axis=0), start), np.maximum(ends.max(axis=0), start)
    mask = np.zeros((high - low + 1)[::-1], dtype=np.uint8)
    if rays == "bresenham":
        ix, iy = (trace_rays(start, ends) - low).T
        mask[iy, ix] = 1
    else:
        gaps = np.flatnonzero(np.diff(beams) > 1) + 1
        outline = np.insert(ends, np.concatenate([[0], gaps]), start, axis=0)
        cv2.fillPoly(mask, [(outline - low).astype(np.int32)], 1)
    return mask, np.s_[low[1] : high[1] + 1, low[0] : high[0] + 1]


def integrate_scan(
    grid: OccupancyGrid, points_w: np.ndarray, beams: np.ndarray, sensor_w: np.ndarray, config: MapConfig
) -> tuple[slice, slice]:
    """Write one scan into the map, in place, and return the rectangle of cells that it touched. Implements Eq. 15.

    Arguments as in ``free_cells``; the points must lie inside the grid (see ``GridSpec.covering``). Every cell is
    written once per scan, hit or free, and a hit wins: a wall seen at a grazing angle must not be rubbed out by the
    neighbouring beams of the scan that found it.
    """
    mask, rectangle = free_cells(grid.spec, points_w, beams, sensor_w, config.rays)
    change = mask * np.float32(-config.free)
    ix, iy = grid.spec.world_to_cell(points_w).T
    change[iy - rectangle[0].start, ix - rectangle[1].start] = config.hit
    change += grid.log_odds[rectangle]
    np.clip(change, -config.clamp, config.clamp, out=grid.log_odds[rectangle])
    return rectangle
