"""The lattice of poses on which scans are scored, and the window of perturbations around one of its nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np


@dataclass(frozen=True)
class Lattice:
    """Poses ``(ix step_xy, iy step_xy, ik step_yaw)``; ``step_xy`` is the map's resolution (m), ``step_yaw`` rad."""

    step_xy: float
    step_yaw: float

    @property
    def steps(self) -> np.ndarray:
        return np.array([self.step_xy, self.step_xy, self.step_yaw])

    def nearest(self, poses: np.ndarray) -> np.ndarray:
        """Find the nodes ``(N, 3)`` int, columns (ix, iy, ik), nearest to poses ``(N, 3)``."""
        return np.rint(np.asarray(poses) / self.steps).astype(np.int64)

    def pose(self, nodes: np.ndarray) -> np.ndarray:
        """Return the poses ``(..., 3)`` of nodes; the heading is not wrapped."""
        return np.asarray(nodes) * self.steps


@dataclass(frozen=True)
class Window:
    """The perturbations around a node: ``cells`` steps each way in x and y, ``yaws`` steps each way in heading."""

    cells: int
    yaws: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """(headings, rows, columns) of a block of scores."""
        return 2 * self.yaws + 1, 2 * self.cells + 1, 2 * self.cells + 1

    @property
    def size(self) -> int:
        """How many perturbations there are."""
        return int(np.prod(self.shape))

    @property
    def reach(self) -> np.ndarray:
        """Half width ``(3,)`` in columns, rows and headings."""
        return np.array([self.cells, self.cells, self.yaws])

    @property
    def centre(self) -> int:
        """Flat index of the node itself in its block."""
        return int(np.ravel_multi_index((self.yaws, self.cells, self.cells), self.shape))

    def steps(self) -> np.ndarray:
        """List the lattice steps ``(P, 3)``, columns (ix, iy, ik), of all perturbations as a flattened block."""
        return _window_steps(self)


@lru_cache(maxsize=64)
def _window_steps(window: Window) -> np.ndarray:
    k, y, x = np.indices(window.shape).reshape(3, -1)
    steps = np.column_stack([x - window.cells, y - window.cells, k - window.yaws])
    steps.flags.writeable = False
    return steps
