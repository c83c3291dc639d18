"""Correlative scan matching: the scores of the definition for all perturbations of all particles at once.

The search scores hundreds of perturbed poses around each of hundreds of particles (Olson, "Real-time correlative scan
matching", 2009). All of these poses are nodes of one lattice in (x, y, theta) whose steps in x and y are one cell: a
step along the lattice moves every end point by exactly one cell. So for each heading the end points are rounded to
cells once, equal cells are merged, and the patches of the map that they select are added up. The result is a volume of
scores from which every particle reads its own block. Where a cloud is so wide that most of the volume would never be
read, each particle's window is added up by itself; ``boxes`` decides which is cheaper.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pfslam.grid import GridSpec, OccupancyGrid, check_cells
from pfslam.search.boxes import cheapest_boxes, lie_together, volume_is_cheaper
from pfslam.search.lattice import Lattice, Window, distinct_nodes

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
class BoxScores:
    """Scores of neighbouring lattice nodes and the particles that lie nearest to them.

    ``nodes (U, 3)``; ``scores (U, P)`` float32 of the window around each; ``members (n,)`` particle numbers;
    ``node_of (n,)`` the row of ``nodes`` to which each member belongs.
    """

    nodes: np.ndarray
    scores: np.ndarray
    members: np.ndarray
    node_of: np.ndarray

    def in_parts(self) -> Iterator[BoxScores]:
        """Yield the box's particles, those of one node together, a handful of nodes at a time."""
        parts = min(-(-len(self.members) * self.scores.shape[1] // CHUNK), len(self.members))
        if parts == 1:
            yield self
            return
        order = np.argsort(self.node_of, kind="stable")
        for some in np.array_split(order, parts):
            used = np.unique(self.node_of[some])
            few = slice(used[0], used[-1] + 1)
            yield BoxScores(
                self.nodes[few], self.scores[few], self.members[some], self.node_of[some] - used[0]
            )


def search(
    credit: np.ndarray | OccupiedCells,
    spec: GridSpec,
    points_b: np.ndarray,
    poses: np.ndarray,
    lattice: Lattice,
    window: Window,
) -> Iterator[BoxScores]:
    """Yield the scores of every perturbation of every particle, box by box; each particle is in exactly one box.

    ``credit (H, W)`` is what an end point scores in each cell. ``points_b (M, 2)`` are the end points in the body frame
    (m), ``poses (N, 3)`` the particles. Particles that share a node share its scores. The sums are exact, so their
    order cannot change them.
    """
    nearest = lattice.nearest(poses)
    check_cells("particles", np.ptp(nearest[:, :2], axis=0) + 1, "from one end of the cloud to the other")
    nodes, node_of_particle = distinct_nodes(nearest)
    if lie_together(nodes, window.reach):
        boxes = [(np.arange(len(nodes)), volume_blocks)]
    else:
        boxes = [
            (part, volume_blocks if volume_is_cheaper(nodes[part], window.reach) else window_scores)
            for part in cheapest_boxes(nodes, window.reach)
        ]
    for part, scored in boxes:
        row = np.full(len(nodes), -1)
        row[part] = np.arange(len(part))
        members = np.flatnonzero(row[node_of_particle] >= 0)
        blocks = scored(credit, spec, points_b, lattice, nodes[part], window)
        yield BoxScores(nodes[part], blocks, members, row[node_of_particle[members]])


def volume_blocks(
    credit: np.ndarray | OccupiedCells,
    spec: GridSpec,
    points_b: np.ndarray,
    lattice: Lattice,
    nodes: np.ndarray,
    window: Window,
) -> np.ndarray:
    """Score the window around each of ``nodes (U, 3)``, ``(U, P)`` float32, from one volume around them all."""
    low, high = nodes.min(axis=0) - window.reach, nodes.max(axis=0) + window.reach
    volume = score_volume(credit, spec, points_b, lattice, low, high)
    x, y, k = (nodes - window.reach - low).T
    return sliding_window_view(volume, window.shape)[k, y, x].reshape(len(nodes), -1)


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
    patches, cells = patches_and_cells(credit, spec, points_b, lattice, low, high, (ny, nx))
    volume = np.zeros((nk, ny * nx), dtype=np.float32)
    for k in range(0, nk, TOGETHER):
        counts, iy, ix = counted(cells[k : k + TOGETHER], patches.shape[:2])
        for some in chunks(len(ix), ny * nx):
            volume[k : k + TOGETHER] += counts[:, some] @ patches[iy[some], ix[some]].reshape(-1, ny * nx)
    return volume.reshape(nk, ny, nx)


def window_scores(
    credit: np.ndarray | OccupiedCells,
    spec: GridSpec,
    points_b: np.ndarray,
    lattice: Lattice,
    nodes: np.ndarray,
    window: Window,
) -> np.ndarray:
    """Score the window around each of ``nodes (U, 3)``, ``(U, P)`` float32, all windows of a heading together."""
    headings, side, _ = window.shape
    low, high = nodes.min(axis=0) - window.reach, nodes.max(axis=0) + window.reach
    patches, cells = patches_and_cells(credit, spec, points_b, lattice, low, high, (side, side))
    scores = np.zeros((len(nodes), headings, side * side), dtype=np.float32)
    x, y, first = (nodes - window.reach - low).T
    for k, one_heading in enumerate(cells):
        distinct, counts = np.unique(one_heading, return_counts=True)
        iy, ix = np.divmod(distinct, patches.shape[1])
        here = np.flatnonzero((first <= k) & (k < first + headings))
        for some in chunks(len(here), len(ix) * side * side):
            who = here[some]
            found = patches[y[who, None] + iy, x[who, None] + ix].reshape(len(who), len(ix), -1)
            scores[who, k - first[who]] = counts.astype(np.float32) @ found
    return scores.reshape(len(nodes), -1)


def chunks(n: int, size: int) -> Iterator[slice]:
    """Cut ``n`` things of ``size`` numbers each into slices that fit into the processor's cache."""
    step = max(CACHE // size, 1)
    return (slice(i, i + step) for i in range(0, n, step))


def patches_and_cells(credit, spec, points_b, lattice: Lattice, low, high, shape: tuple[int, int]):
    """Collect all patches of ``shape`` near a scan, and the cells that it falls into at each heading.

    Returns ``(patches, cells)``: ``patches[iy, ix]`` is the patch that one cell of the scan selects for the node
    ``low``; ``cells (K, M)``, for the headings from ``low`` to ``high``, are flat indices into its first two axes.
    """
    cells = rotated_cells(points_b, lattice.step_yaw * np.arange(low[2], high[2] + 1), spec) + low[:2]
    (x0, y0), (x1, y1) = cells.min(axis=(0, 1)), cells.max(axis=(0, 1))
    nx, ny, _ = high - low + 1
    patches = sliding_window_view(_crop(credit, x0, y0, x1 + nx, y1 + ny), shape)
    return patches, (cells[..., 1] - y0) * patches.shape[1] + cells[..., 0] - x0


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
