"""Correlative scan matching: the scores of the definition for all perturbations of all particles at once.

The search scores hundreds of perturbed poses around each of hundreds of particles (Olson, "Real-time correlative scan
matching", 2009). All of these poses are nodes of one lattice in (x, y, theta) whose steps in x and y are one cell: a
step along the lattice moves every end point by exactly one cell. So for each heading the end points are rounded to
cells once, equal cells are merged, and the patches of the map that they select are added up. The result is a volume of
scores from which every particle reads its own block. Of a wide cloud most of one volume would never be read: so its
nodes are divided into tiles of a few windows, each with a volume of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pfslam.grid import GridSpec, OccupancyGrid, check_cells
from pfslam.search.lattice import Lattice, Window

MAX_SCORES = 20_000_000
"""Scores held at once (80 MB): of one window, or of the volume of a tile."""
TILE = 3
"""Windows along each side of a tile: with 1 the search of a wide cloud took three times as long, with 4 no less."""
CACHE = 2**17
"""Numbers (float32) gathered at once: half a megabyte stays in the processor's cache until they are added up."""
CHUNK = 2**19
"""Scores looked at together, so that twenty thousand particles need no more memory than seven hundred."""
TOGETHER = 8
"""Neighbouring headings that are scored at once: most of their cells are the same, and fetched once."""


class OccupiedCells:
    """What an end point scores in each cell by Eq. 9: 1 where the cell is occupied, else 0.

    Only the piece of the map that a search looks at is computed.
    """

    def __init__(self, grid: OccupancyGrid):
        self.log_odds, self.shape = grid.log_odds, grid.spec.shape

    def __getitem__(self, piece) -> np.ndarray:
        return self.log_odds[piece] > 0


@dataclass(frozen=True, eq=False)
class NodeScores:
    """Scores of a handful of lattice nodes and the particles that lie nearest to them.

    ``nodes (U, 3)``; ``scores (U, P)`` float32 of the window around each; ``members (n,)`` particle numbers;
    ``node_of (n,)`` the row of ``nodes`` to which each member belongs.
    """

    nodes: np.ndarray
    scores: np.ndarray
    members: np.ndarray
    node_of: np.ndarray


def search(
    credit: np.ndarray | OccupiedCells,
    spec: GridSpec,
    points_b: np.ndarray,
    poses: np.ndarray,
    lattice: Lattice,
    window: Window,
) -> Iterator[NodeScores]:
    """Yield the scores of every perturbation of every particle, some nodes at a time; each particle comes once.

    ``credit (H, W)`` is what an end point scores in each cell. ``points_b (M, 2)`` are the end points in the body frame
    (m), ``poses (N, 3)`` the particles. Particles that share a node share its scores, and nodes of one tile share a
    volume. The sums are exact, so their order cannot change them.
    """
    nearest = lattice.nearest(poses)
    check_cells("particles", np.ptp(nearest[:, :2], axis=0) + 1, "from one end of the cloud to the other")
    nodes, node_of_particle = np.unique(nearest, axis=0, return_inverse=True)
    few_enough = (TILE + 1) ** 3 * window.size <= MAX_SCORES
    side = TILE * np.array(window.shape[::-1]) if few_enough else 1
    tiles, tile_of_node = np.unique((nodes - nodes.min(axis=0)) // side, axis=0, return_inverse=True)
    at_once = max(CHUNK // window.size, 1)
    for k in range(len(tiles)):
        part = np.flatnonzero(tile_of_node == k)
        low, high = nodes[part].min(axis=0) - window.reach, nodes[part].max(axis=0) + window.reach
        volume = score_volume(credit, spec, points_b, lattice, low, high)
        blocks = sliding_window_view(volume, window.shape)
        for few in np.array_split(part, -(-len(part) // at_once)):
            x, y, yaw = (nodes[few] - window.reach - low).T
            row = np.full(len(nodes), -1)
            row[few] = np.arange(len(few))
            members = np.flatnonzero(row[node_of_particle] >= 0)
            scores = blocks[yaw, y, x].reshape(len(few), -1)
            yield NodeScores(nodes[few], scores, members, row[node_of_particle[members]])


def score_volume(
    credit: np.ndarray | OccupiedCells,
    spec: GridSpec,
    points_b: np.ndarray,
    lattice: Lattice,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Score all nodes from ``low (3,)`` to ``high (3,)`` inclusive, as ``(headings, rows, columns)`` float32."""
    nx, ny, nk = high - low + 1
    cells = rotated_cells(points_b, lattice.step_yaw * np.arange(low[2], high[2] + 1), spec) + low[:2]
    (x0, y0), (x1, y1) = cells.min(axis=(0, 1)), cells.max(axis=(0, 1))
    # One patch for each cell into which the scan may fall: what this cell adds to the nodes of one heading.
    patches = sliding_window_view(_crop(credit, x0, y0, x1 + nx, y1 + ny), (ny, nx))
    cells = (cells[..., 1] - y0) * patches.shape[1] + cells[..., 0] - x0
    step = max(CACHE // (ny * nx), 1)
    volume = np.zeros((nk, ny * nx), dtype=np.float32)
    for k in range(0, nk, TOGETHER):
        counts, iy, ix = counted(cells[k : k + TOGETHER], patches.shape[:2])
        for some in (slice(i, i + step) for i in range(0, len(ix), step)):
            volume[k : k + TOGETHER] += counts[:, some] @ patches[iy[some], ix[some]].reshape(-1, ny * nx)
    return volume.reshape(nk, ny, nx)


def counted(cells: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Count how often each row of ``cells (K, M)``, flat indices, has each of the cells that occur in any of them.

    Returns ``(counts, iy, ix)``: counts ``(K, C)`` float32, and where in an array of that shape the C cells lie.
    """
    occurs = np.zeros(shape[0] * shape[1], dtype=bool)
    occurs[cells] = True
    distinct = np.flatnonzero(occurs)
    number = np.empty(len(occurs), dtype=np.int64)
    number[distinct] = np.arange(len(distinct))
    rows = np.arange(len(cells))[:, None] * len(distinct)
    counts = np.bincount((rows + number[cells]).ravel(), minlength=len(cells) * len(distinct))
    return counts.reshape(len(cells), -1).astype(np.float32), *np.divmod(distinct, shape[1])


def rotated_cells(points_b: np.ndarray, yaws: np.ndarray, spec: GridSpec) -> np.ndarray:
    """Return the cells ``(K, M, 2)`` that points ``(M, 2)`` fall into from the world's origin with each yaw."""
    c, s = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    points_w = np.empty((2, len(yaws), len(points_b)))  # all x, then all y: faster to look through
    points_w[0] = c * points_b[:, 0] - s * points_b[:, 1]
    points_w[1] = s * points_b[:, 0] + c * points_b[:, 1]
    return spec.world_to_cell(np.moveaxis(points_w, 0, -1))


def _crop(credit: np.ndarray | OccupiedCells, x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
    """Copy rows y0..y1 and columns x0..x1 (exclusive) of the cells' credit, zero outside the grid."""
    check_cells("scan matching", (x1 - x0, y1 - y0), "to hold one scan")
    crop = np.zeros((y1 - y0, x1 - x0), dtype=np.float32)
    h, w = credit.shape
    source = credit[max(y0, 0) : max(min(y1, h), 0), max(x0, 0) : max(min(x1, w), 0)]
    if source.size:
        top, left = max(-y0, 0), max(-x0, 0)
        crop[top : top + source.shape[0], left : left + source.shape[1]] = source
    return crop
