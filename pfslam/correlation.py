"""Correlative scan matching: the definition of a score, and the same integers a thousand times faster.

The definition counts scan end points on occupied cells, pose by pose. The search scores hundreds of perturbed poses
around each of hundreds of particles (Olson, "Real-time correlative scan matching", 2009). All of these poses are nodes
of one lattice in (x, y, theta) whose steps in x and y are one cell: a step along the lattice moves every end point by
exactly one cell. So for each heading the end points are rounded to cells once, equal cells are merged, and the patches
of the map that they select are added up. The result is a volume of scores from which every particle reads its own
block. Where a cloud is so wide that most of the volume would never be read, each particle's window is added up by
itself; ``boxes`` decides which is cheaper.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import isqrt

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pfslam.grid import GridSpec, check_cells
from pfslam.search.boxes import cheapest_boxes, lie_together, volume_is_cheaper
from pfslam.search.lattice import Lattice, Window, distinct_nodes

FIELD_REACH = 4
"""Cells beyond which an occupied cell has no influence on the likelihood field (exp(-8) is a third of a step)."""

CREDIT = {
    "occupied": np.array([1.0]),
    "distance": np.rint(1000.0 * np.exp(-0.5 * np.arange(FIELD_REACH**2 + 1))),
}
"""By kind of field: the score of an end point at squared distance 0, 1, 2, ... (cells) from the nearest occupied cell.

Sums over up to 16,777 beams stay below 2^24, where float32 counts exactly.
"""

CACHE = 2**17
"""Numbers (float32) gathered at once: half a megabyte stays in the processor's cache until they are added up."""


def map_correlation(occupied: np.ndarray, spec: GridSpec, points_w: np.ndarray) -> int:
    """How many points ``(M, 2)`` (world, m) fall on occupied cells ``(H, W)`` bool. Implements Eq. 6, 8, 9.

    Points outside the grid score nothing. This is the definition; the search below is tested against it.

    >>> spec = GridSpec((0.0, 0.0), 1.0, (3, 3))
    >>> occupied = np.eye(3, dtype=bool)
    >>> map_correlation(occupied, spec, np.array([[0.5, 0.5], [1.5, 0.5], [2.5, 2.5], [9.0, 9.0]]))
    2
    """
    cells = spec.world_to_cell(points_w)
    ix, iy = cells[spec.contains(cells)].T
    return int(np.count_nonzero(occupied[iy, ix]))


@dataclass(frozen=True, eq=False)
class ScoreField:
    """What one end point scores in each cell: ``values (H, W)`` float32, whole numbers from 0 to ``top``."""

    values: np.ndarray
    kind: str

    @property
    def top(self) -> int:
        """The score of an end point that falls on an occupied cell."""
        return int(CREDIT[self.kind][0])


def score_field(occupied: np.ndarray, kind: str) -> ScoreField:
    """The field of scores for occupied cells ``(H, W)`` bool.

    "occupied": 1 on occupied cells, 0 elsewhere: the report's count. "distance": 1000 exp(-d^2 / 2) with d the distance
    in cells to the nearest occupied cell, cut off at 4 cells. This is the likelihood field of Thrun, Burgard and Fox
    ("Probabilistic Robotics", 6.4): a near miss scores too, so the best pose is not decided by how a wall happens to
    fall into cells.
    """
    if not occupied.any():
        return ScoreField(np.zeros(occupied.shape, dtype=np.float32), kind)
    credit = np.zeros(256, dtype=np.float32)
    credit[: len(CREDIT[kind])] = CREDIT[kind]
    return ScoreField(cv2.LUT(squared_distance(occupied, _reach(kind)), credit), kind)


def squared_distance(occupied: np.ndarray, reach: int) -> np.ndarray:
    """Squared distance ``(H, W)`` uint8 in cells to the nearest occupied cell; above ``reach**2`` where there is none.

    d^2 = dx^2 + dy^2 is separable: the nearest along each row first, then along the columns of the result.

    >>> squared_distance(np.array([[True, False, False], [False, False, False]]), reach=2)
    array([[0, 1, 4],
           [1, 2, 5]], dtype=uint8)
    """
    squared = np.where(occupied, 0, reach**2 + 1).astype(np.uint8)
    for lines in (squared, squared.T):
        before = lines.copy()
        for k in range(1, reach + 1):
            np.minimum(lines[k:], before[:-k] + k**2, out=lines[k:])
            np.minimum(lines[:-k], before[k:] + k**2, out=lines[:-k])
    return squared


def updated_field(field: ScoreField, occupied: np.ndarray, rectangle: tuple[slice, slice]) -> ScoreField:
    """The score field after the cells in ``rectangle`` have changed: only its surroundings are computed again."""
    values, reach = field.values.copy(), _reach(field.kind)
    (inner, outer) = (_widened(rectangle, occupied.shape, n * reach) for n in (1, 2))
    fresh = score_field(occupied[outer], field.kind).values
    inside = tuple(slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
    values[inner] = fresh[inside]
    return ScoreField(values, field.kind)


def _reach(kind: str) -> int:
    """How many cells away from an occupied cell an end point may lie and still score."""
    return isqrt(len(CREDIT[kind]) - 1)


def _widened(rectangle: tuple[slice, slice], shape: tuple[int, int], by: int) -> tuple[slice, slice]:
    rows, columns = (
        slice(max(r.start - by, 0), min(r.stop + by, n)) for r, n in zip(rectangle, shape, strict=True)
    )
    return rows, columns


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
    field: ScoreField,
    spec: GridSpec,
    points_b: np.ndarray,
    poses: np.ndarray,
    lattice: Lattice,
    window: Window,
) -> Iterator[BoxScores]:
    """The scores of every perturbation of every particle, box by box; each particle appears in exactly one box.

    ``points_b (M, 2)`` are the end points in the body frame (m), ``poses (N, 3)`` the particles. Particles that share a
    node share its scores. The sums are exact, so their order cannot change them.
    """
    nearest = lattice.nearest(poses)
    check_cells("particles", np.ptp(nearest[:, :2], axis=0) + 1, "from one end of the cloud to the other")
    nodes, node_of_particle = distinct_nodes(nearest)
    if lie_together(nodes, window.reach):
        boxes = [(np.arange(len(nodes)), volume_blocks)]
    else:
        cells = distinct_cells(points_b, lattice.step_yaw * nodes[len(nodes) // 2, 2], spec)
        boxes = [
            (part, volume_blocks if volume_is_cheaper(nodes[part], window.reach, cells) else window_scores)
            for part in cheapest_boxes(nodes, window.reach, cells)
        ]
    for part, scored in boxes:
        row = np.full(len(nodes), -1)
        row[part] = np.arange(len(part))
        members = np.flatnonzero(row[node_of_particle] >= 0)
        blocks = scored(field, spec, points_b, lattice, nodes[part], window)
        yield BoxScores(nodes[part], blocks, members, row[node_of_particle[members]])


def distinct_cells(points_b: np.ndarray, yaw: float, spec: GridSpec) -> int:
    """How many different cells the points ``(M, 2)`` fall into when the body is turned by ``yaw`` (rad)."""
    return len(np.unique(rotated_cells(points_b, np.array([yaw]), spec)[0], axis=0))


def volume_blocks(
    field: ScoreField,
    spec: GridSpec,
    points_b: np.ndarray,
    lattice: Lattice,
    nodes: np.ndarray,
    window: Window,
) -> np.ndarray:
    """Scores ``(U, P)`` float32 of the window around each of ``nodes (U, 3)``, read from one volume around them all."""
    low, high = nodes.min(axis=0) - window.reach, nodes.max(axis=0) + window.reach
    volume = score_volume(field, spec, points_b, lattice, low, high)
    x, y, k = (nodes - window.reach - low).T
    return sliding_window_view(volume, window.shape)[k, y, x].reshape(len(nodes), -1)


def score_volume(
    field: ScoreField,
    spec: GridSpec,
    points_b: np.ndarray,
    lattice: Lattice,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Scores of all nodes from ``low (3,)`` to ``high (3,)`` inclusive, as ``(headings, rows, columns)`` float32."""
    nx, ny, nk = high - low + 1
    patches, scans = patches_and_scans(field, spec, points_b, lattice, low, high, (ny, nx))
    volume = np.zeros((nk, ny * nx), dtype=np.float32)
    for scores, (counts, iy, ix) in zip(volume, scans, strict=True):
        for some in chunks(len(counts), ny * nx):
            scores += counts[some] @ patches[iy[some], ix[some]].reshape(-1, ny * nx)
    return volume.reshape(nk, ny, nx)


def window_scores(
    field: ScoreField,
    spec: GridSpec,
    points_b: np.ndarray,
    lattice: Lattice,
    nodes: np.ndarray,
    window: Window,
) -> np.ndarray:
    """Scores ``(U, P)`` float32 of the window around each of ``nodes (U, 3)``, all windows of a heading together."""
    headings, side, _ = window.shape
    low, high = nodes.min(axis=0) - window.reach, nodes.max(axis=0) + window.reach
    patches, scans = patches_and_scans(field, spec, points_b, lattice, low, high, (side, side))
    scores = np.zeros((len(nodes), headings, side * side), dtype=np.float32)
    x, y, first = (nodes - window.reach - low).T
    for k, (counts, iy, ix) in enumerate(scans):
        here = np.flatnonzero((first <= k) & (k < first + headings))
        for some in chunks(len(here), len(counts) * side * side):
            who = here[some]
            found = patches[y[who, None] + iy, x[who, None] + ix].reshape(len(who), len(counts), -1)
            scores[who, k - first[who]] = counts @ found
    return scores.reshape(len(nodes), -1)


def chunks(n: int, size: int) -> Iterator[slice]:
    """Slices that cut ``n`` things of ``size`` numbers each into pieces that fit into the processor's cache."""
    step = max(CACHE // size, 1)
    return (slice(i, i + step) for i in range(0, n, step))


def patches_and_scans(field: ScoreField, spec, points_b, lattice: Lattice, low, high, shape: tuple[int, int]):
    """All patches of ``shape`` of the map near a scan, and which of them each heading from ``low`` to ``high`` adds up.

    Returns ``(patches, scans)``: ``patches[iy, ix]`` is the patch that one cell of the scan selects for the node
    ``low``; ``scans`` holds for each heading the distinct cells as ``(counts, iy, ix)``, each ``(C,)``.
    """
    cells = rotated_cells(points_b, lattice.step_yaw * np.arange(low[2], high[2] + 1), spec) + low[:2]
    (x0, y0), (x1, y1) = cells.min(axis=(0, 1)), cells.max(axis=(0, 1))
    nx, ny, _ = high - low + 1
    patches = sliding_window_view(_crop(field.values, x0, y0, x1 + nx, y1 + ny), shape)
    width = x1 - x0 + 1
    keys, counts, begin = _merged((cells[..., 1] - y0) * width + cells[..., 0] - x0)
    iy, ix = np.divmod(keys, width)
    pieces = [slice(*ends) for ends in pairwise(begin)]
    return patches, [(counts[some], iy[some], ix[some]) for some in pieces]


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
    return spec.world_to_cell(
        np.moveaxis(np.stack([x, y]), 0, -1)
    )  # all x, then all y: faster to look through


def _crop(values: np.ndarray, x0: int, y0: int, x1: int, y1: int) -> np.ndarray:
    """Rows y0..y1 and columns x0..x1 (exclusive) of a field's values, zero outside it."""
    check_cells("scan matching", (x1 - x0, y1 - y0), "to hold one scan")
    crop = np.zeros((y1 - y0, x1 - x0), dtype=np.float32)
    h, w = values.shape
    inside = np.s_[max(y0, 0) : max(min(y1, h), 0), max(x0, 0) : max(min(x1, w), 0)]
    source = values[inside]
    if source.size:
        top, left = max(-y0, 0), max(-x0, 0)
        crop[top : top + source.shape[0], left : left + source.shape[1]] = source
    return crop
