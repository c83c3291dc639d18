"""The occupancy grid: what the scans have said about each cell, as log-odds.

``log_odds[iy, ix]`` has row 0 at y_min. Zero means unknown. One function, ``GridSpec.world_to_cell``, turns metres
into cells; nothing else in the package does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pfslam.errors import DataError

LOG_4 = float(np.log(4.0))
MAX_CELLS = 400_000_000


@dataclass(frozen=True)
class GridSpec:
    """Where a grid lies: ``origin (2,)`` is the outer corner (x_min, y_min) of cell [0, 0], m; ``shape`` is (H, W)."""

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
            raise DataError("GridSpec", "shape", self.shape, f"(H, W), each at least 1, at most {MAX_CELLS} cells")
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "shape", shape)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(x_min, x_max, y_min, y_max) in metres, as ``imshow(..., origin="lower", extent=...)`` takes it."""
        (x, y), (h, w) = self.origin, self.shape
        return x, x + w * self.resolution, y, y + h * self.resolution

    def world_to_cell(self, points_w) -> np.ndarray:
        """Cells ``(..., 2)`` int, columns (ix, iy), of points ``(..., 2)`` in metres: floor((p - origin) / resolution)."""
        return np.floor((np.asarray(points_w) - self.origin) / self.resolution).astype(np.int64)

    def cell_to_world(self, cells) -> np.ndarray:
        """Centres ``(..., 2)`` in metres of cells ``(..., 2)`` given as (ix, iy)."""
        return (np.asarray(cells) + 0.5) * self.resolution + self.origin

    def contains(self, cells) -> np.ndarray:
        """Which cells ``(..., 2)``, given as (ix, iy), lie inside the grid (bool ``(...)``)."""
        cells = np.asarray(cells)
        return (cells >= 0).all(axis=-1) & (cells[..., 0] < self.shape[1]) & (cells[..., 1] < self.shape[0])

    @classmethod
    def around(cls, points_w, resolution: float, margin: float = 1.0) -> GridSpec:
        """The grid that covers points ``(M, 2)`` with a margin (m); its corner lies on a multiple of the resolution."""
        points = np.atleast_2d(points_w)
        low = np.floor((points.min(axis=0) - margin) / resolution)
        high = np.ceil((points.max(axis=0) + margin) / resolution)
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
