"""How well a scan fits a map: the definition, and the same integers a thousand times faster.

The definition counts scan end points on occupied cells, pose by pose. The search scores hundreds of perturbed poses
around each of hundreds of particles. All of these poses are nodes of one lattice in (x, y, theta) whose steps in x and
y are one cell: a step along the lattice moves every end point by exactly one cell. So for each heading the end points
are rounded to cells once, equal cells are merged, and the patches of the map that they select are added up. The result
is a volume of scores from which every particle reads its own block.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pfslam.grid import GridSpec

MAX_FIELD_VALUE = 1000
"""Largest value of a score field. Sums over up to 16,777 beams stay below 2^24, where float32 counts exactly."""

FIELD_REACH = 4
"""Cells beyond which an occupied cell has no influence on the distance field (exp(-8) is a third of a step)."""


def map_correlation(occupied: np.ndarray, spec: GridSpec, points_w: np.ndarray) -> int:
    """How many points ``(M, 2)`` (world, m) fall on occupied cells ``(H, W)`` bool. Implements Eq. 6, 8, 9.

    Points outside the grid score nothing. This is the definition; the search below is tested against it.
    """
    cells = spec.world_to_cell(points_w)
    ix, iy = cells[spec.contains(cells)].T
    return int(np.count_nonzero(occupied[iy, ix]))


def score_field(occupied: np.ndarray, kind: str) -> np.ndarray:
    """What one end point scores in each cell, ``(H, W)`` float32 whole numbers.

    "occupied": 1 on occupied cells, 0 elsewhere: the report's count. "distance": 1000 exp(-d^2 / 2) with d
    the distance in cells to the nearest occupied cell, cut off at 4 cells: a near miss scores too, so the best
    pose is not decided by how a wall happens to fall into cells.
    """
    if kind == "occupied":
        return occupied.astype(np.float32)
    if not occupied.any():
        return np.zeros(occupied.shape, dtype=np.float32)
    away = cv2.distanceTransform((~occupied).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.where(away <= FIELD_REACH, np.rint(MAX_FIELD_VALUE * np.exp(-0.5 * away**2)), 0.0).astype(
        np.float32
    )


def updated_field(
    field: np.ndarray, occupied: np.ndarray, rectangle: tuple[slice, slice], kind: str
) -> np.ndarray:
    """The score field after the cells in ``rectangle`` have changed: only its surroundings are computed again."""
    result = field.copy()
    (inner, outer) = (_widened(rectangle, occupied.shape, n * FIELD_REACH) for n in (1, 2))
    fresh = score_field(occupied[outer], kind)
    inside = tuple(slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
    result[inner] = fresh[inside]
    return result


def _widened(rectangle: tuple[slice, slice], shape: tuple[int, int], by: int) -> tuple[slice, slice]:
    return tuple(
        slice(max(r.start - by, 0), min(r.stop + by, n)) for r, n in zip(rectangle, shape, strict=True)
    )


@dataclass(frozen=True)
class Lattice:
    """Poses ``(ix step_xy, iy step_xy, ik step_yaw)``; ``step_xy`` is the map's resolution (m), ``step_yaw`` rad."""

    step_xy: float
    step_yaw: float

    @property
    def steps(self) -> np.ndarray:
        return np.array([self.step_xy, self.step_xy, self.step_yaw])

    def nearest(self, poses: np.ndarray) -> np.ndarray:
        """Nodes ``(N, 3)`` int, columns (ix, iy, ik), nearest to poses ``(N, 3)``."""
        return np.rint(np.asarray(poses) / self.steps).astype(np.int64)

    def pose(self, nodes: np.ndarray) -> np.ndarray:
        """Poses ``(..., 3)`` of nodes; the heading is not wrapped."""
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
    def centre(self) -> int:
        """Flat index of the node itself in its block."""
        return int(np.ravel_multi_index((self.yaws, self.cells, self.cells), self.shape))

    def steps(self) -> np.ndarray:
        """Lattice steps ``(P, 3)``, columns (ix, iy, ik), of all perturbations in the order of a flattened block."""
        return _window_steps(self)


@lru_cache(maxsize=64)
def _window_steps(window: Window) -> np.ndarray:
    k, y, x = np.indices(window.shape).reshape(3, -1)
    steps = np.column_stack([x - window.cells, y - window.cells, k - window.yaws])
    steps.flags.writeable = False
    return steps


@dataclass(frozen=True, eq=False)
class BoxScores:
    """Scores of neighbouring lattice nodes and the particles that lie nearest to them.

    ``nodes (U, 3)``; ``scores (U, P)`` float32 of the window around each; ``members (n,)`` particle numbers;
    ``node_of (n,)`` the row of ``nodes`` to which each member belongs.
    """

    nodes: np.ndarray
    scores: np.ndarray
    members: np.ndarray
    node_of: np.ndarray


def search(
    field: np.ndarray,
    spec: GridSpec,
    points_b: np.ndarray,
    poses: np.ndarray,
    lattice: Lattice,
    window: Window,
) -> Iterator[BoxScores]:
    """The scores of every perturbation of every particle, box by box; each particle appears in exactly one box.

    ``field (H, W)`` float32 holds whole numbers from 0 to ``MAX_FIELD_VALUE`` (occupied as 0 and 1 for the report's
    count); ``points_b (M, 2)`` the end points in the body frame (m); ``poses (N, 3)`` the particles. Particles that
    share a node share its scores. The sums are exact, so their order cannot change them.
    """
    nodes, node_of_particle = np.unique(lattice.nearest(poses), axis=0, return_inverse=True)
    node_of_particle = node_of_particle.reshape(-1)
    reach = np.array([window.cells, window.cells, window.yaws])
    for part in cheapest_boxes(nodes, reach, len(points_b)):
        low, high = nodes[part].min(axis=0) - reach, nodes[part].max(axis=0) + reach
        volume = score_volume(field, spec, points_b, lattice, low, high)
        x, y, k = (nodes[part] - reach - low).T
        blocks = sliding_window_view(volume, window.shape)[k, y, x].reshape(len(part), -1)
        row = np.full(len(nodes), -1)
        row[part] = np.arange(len(part))
        members = np.flatnonzero(row[node_of_particle] >= 0)
        yield BoxScores(nodes[part], blocks, members, row[node_of_particle[members]])


def score_volume(
    field: np.ndarray,
    spec: GridSpec,
    points_b: np.ndarray,
    lattice: Lattice,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Scores of all nodes from ``low (3,)`` to ``high (3,)`` inclusive, as ``(headings, rows, columns)`` float32."""
    nx, ny, nk = high - low + 1
    cells = rotated_cells(points_b, lattice.step_yaw * np.arange(low[2], high[2] + 1), spec) + low[:2]
    (x0, y0), (x1, y1) = cells.min(axis=(0, 1)), cells.max(axis=(0, 1))
    patches = sliding_window_view(_crop(field, x0, y0, x1 + nx, y1 + ny), (ny, nx))
    width = x1 - x0 + 1
    keys, counts, begin = _merged((cells[..., 1] - y0) * width + cells[..., 0] - x0)
    iy, ix = np.divmod(keys, width)
    volume = np.empty((nk, ny * nx), dtype=np.float32)
    for k in range(nk):
        some = slice(begin[k], begin[k + 1])
        volume[k] = counts[some] @ patches[iy[some], ix[some]].reshape(-1, ny * nx)
    return volume.reshape(nk, ny, nx)


def _merged(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The distinct keys of each row of ``(K, M)`` one after the other, how often each occurs, where each row begins."""
    keys = np.sort(keys, axis=1)
    distinct = np.ones(keys.shape, dtype=bool)
    distinct[:, 1:] = keys[:, 1:] != keys[:, :-1]
    at = np.flatnonzero(distinct)
    counts = np.diff(at, append=keys.size).astype(np.float32)
    return keys.ravel()[at], counts, np.searchsorted(at, np.arange(len(keys) + 1) * keys.shape[1])


def rotated_cells(points_b: np.ndarray, yaws: np.ndarray, spec: GridSpec) -> np.ndarray:
    """Cells ``(K, M, 2)`` that points ``(M, 2)`` fall into when the body stands at the world's origin with each yaw."""
    c, s = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    x = c * points_b[:, 0] - s * points_b[:, 1]
    y = s * points_b[:, 0] + c * points_b[:, 1]
    return spec.world_to_cell(np.stack([x, y], axis=-1))


def _crop(field: np.ndarray, x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
    """Rows y0..y1 and columns x0..x1 (exclusive) of the field, zero outside it."""
    crop = np.zeros((y1 - y0, x1 - x0), dtype=np.float32)
    h, w = field.shape
    inside = np.s_[max(y0, 0) : max(min(y1, h), 0), max(x0, 0) : max(min(x1, w), 0)]
    source = field[inside]
    if source.size:
        top, left = max(-y0, 0), max(-x0, 0)
        crop[top : top + source.shape[0], left : left + source.shape[1]] = source
    return crop


# Cost of one heading, and of one node and beam, in nanoseconds. Only their ratio matters.
COST_PER_HEADING = 60_000.0
COST_PER_NODE_AND_BEAM = 1.0
MAX_SCORES = 20_000_000
"""Scores held at once (80 MB): a box of nodes whose volume or blocks would hold more is cut in any case."""


def volume_cost(extent: np.ndarray, beams: int) -> float:
    """Estimated time (ns) of a score volume with ``extent`` (columns, rows, headings)."""
    columns, rows, headings = (int(n) for n in extent)
    return headings * (COST_PER_HEADING + COST_PER_NODE_AND_BEAM * columns * rows * beams)


def cheapest_boxes(nodes: np.ndarray, reach: np.ndarray, beams: int) -> list[np.ndarray]:
    """Index arrays that part ``nodes (U, 3)`` into boxes, each worth one score volume.

    A compact cloud is one box: neighbours share nearly all of it. A wide cloud leaves holes that nobody asks for: a box
    is cut in two at its longest side for as long as the two halves together are estimated to cost less.
    """
    boxes, pending = [], [np.arange(len(nodes))]
    while pending:
        part = pending.pop()
        extent = np.ptp(nodes[part], axis=0)
        axis = int(np.argmax(extent / (2.0 * reach + 1.0)))
        order = part[np.argsort(nodes[part, axis], kind="stable")]
        gaps = np.diff(nodes[order, axis])
        if extent[axis] == 0:
            boxes.append(part)
            continue
        # Cut at the median, moved to the nearest place where the coordinate changes.
        places = np.flatnonzero(gaps)
        cut = int(places[np.argmin(np.abs(places - len(order) / 2))]) + 1
        halves = [np.sort(order[:cut]), np.sort(order[cut:])]
        blocks = len(part) * int(np.prod(2 * reach + 1))
        too_large = max(blocks, int(np.prod(extent + 2 * reach + 1))) > MAX_SCORES
        split_cost = sum(volume_cost(np.ptp(nodes[h], axis=0) + 2 * reach + 1, beams) for h in halves)
        if too_large or split_cost < volume_cost(extent + 2 * reach + 1, beams):
            pending.extend(halves[::-1])
        else:
            boxes.append(part)
    return boxes
