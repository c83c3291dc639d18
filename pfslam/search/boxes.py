"""Which lattice nodes to score together: the estimate of what it costs, and the boxes that follow from it.

There are two ways to score the windows of many nodes. One *volume* over the box that holds them all: every heading
adds up patches as large as the box, so that windows that overlap are scored once; but so are the gaps between them.
Or *each window by itself*, heading by heading: only what is needed is scored, but what windows share is scored again
and patches are small. Both copy patches of the map and add them up; they differ in how many patches and how large. So
three numbers, measured once, say which is cheaper, and whether cutting a box in two would pay.
"""

from __future__ import annotations

import numpy as np

COST_PER_HEADING = 20_000.0
"""Time (ns) to turn a scan of a thousand beams to one heading, round it to cells and merge equal ones."""
COST_PER_PATCH = 70.0
"""Time (ns) to start on one patch of the map, whatever its size."""
COST_PER_NODE = 0.17
"""Time (ns) to copy one cell of a patch and add it. Only the ratios of the three decide."""
MAX_SCORES = 20_000_000
"""Scores held at once (80 MB): a box of nodes whose volume or windows would hold more is cut in any case."""
MAX_SIDE = 4096
"""Columns or rows of a box: the map is read in one piece around it, gaps included, so that a wider one is cut too."""


def volume_cost(extent: np.ndarray, cells: int) -> float:
    """Estimate the time (ns) of one volume of ``extent`` (columns, rows, headings) for a scan of so many cells."""
    columns, rows, headings = (int(n) for n in extent)
    return headings * (COST_PER_HEADING + cells * (COST_PER_PATCH + COST_PER_NODE * columns * rows))


def windows_cost(nodes: int, headings: int, reach: np.ndarray, cells: int) -> float:
    """Estimate the time (ns) of the windows of so many nodes, each by itself, that use so many headings in all."""
    columns, rows, per_node = (2 * int(r) + 1 for r in reach)
    one_heading = cells * (COST_PER_PATCH + COST_PER_NODE * columns * rows)
    return headings * COST_PER_HEADING + nodes * per_node * one_heading


def volume_is_cheaper(nodes: np.ndarray, reach: np.ndarray, cells: int) -> bool:
    """Tell whether one volume beats a window for each of ``nodes (U, 3)``."""
    extent = np.ptp(nodes, axis=0) + 2 * reach + 1
    return volume_cost(extent, cells) <= windows_cost(len(nodes), extent[2], reach, cells)


def box_cost(nodes: np.ndarray, reach: np.ndarray, cells: int) -> float:
    """Estimate the time (ns) of scoring ``nodes (U, 3)`` together, by the cheaper of the two ways."""
    extent = np.ptp(nodes, axis=0) + 2 * reach + 1
    return min(volume_cost(extent, cells), windows_cost(len(nodes), extent[2], reach, cells))


def lie_together(nodes: np.ndarray, reach: np.ndarray) -> bool:
    """Tell whether all ``nodes (U, 3)`` lie within one window, so that one volume serves them without any estimate.

    Their windows' scores must also fit into memory.
    """
    window = 2 * reach + 1
    return bool((np.ptp(nodes, axis=0) < window).all()) and len(nodes) * int(np.prod(window)) <= MAX_SCORES


def cheapest_boxes(nodes: np.ndarray, reach: np.ndarray, cells: int) -> list[np.ndarray]:
    """Divide ``nodes (U, 3)`` into boxes, given as index arrays, each scored in one go.

    ``reach (3,)`` is the half width of a window in columns, rows and headings; ``cells`` the number of different
    cells that a scan falls into. A box is cut in two at its longest side for as long as the two halves together are
    estimated to cost less.
    """
    boxes, pending = [], [np.arange(len(nodes))]
    while pending:
        part = pending.pop()
        halves = _cut_in_two(nodes, part, reach)
        if halves and (
            _too_large(nodes[part], reach, cells)
            or sum(box_cost(nodes[h], reach, cells) for h in halves) < box_cost(nodes[part], reach, cells)
        ):
            pending.extend(halves[::-1])
        else:
            boxes.append(part)
    return boxes


def _too_large(nodes: np.ndarray, reach: np.ndarray, cells: int) -> bool:
    """Tell whether the scores of ``nodes (U, 3)``, window by window or as a volume, would be more than allowed.

    Or whether they lie so far apart that the piece of the map around them would be large.
    """
    window, box = 2 * reach + 1, np.ptp(nodes, axis=0) + 2 * reach + 1
    volume = int(np.prod(box)) if volume_is_cheaper(nodes, reach, cells) else 0
    return max(len(nodes) * int(np.prod(window)), volume) > MAX_SCORES or max(box[:2]) > MAX_SIDE


def _cut_in_two(nodes: np.ndarray, part: np.ndarray, reach: np.ndarray) -> list[np.ndarray]:
    """Cut ``part`` across its longest side; return nothing if all nodes are one.

    At the widest gap if windows on its two sides have nothing in common (headings on both sides of pi, two rooms), else
    at the median, moved to where the coordinate changes.
    """
    extent = np.ptp(nodes[part], axis=0)
    axis = int(np.argmax(extent / (2.0 * reach + 1.0)))
    if extent[axis] == 0:
        return []
    order = part[np.argsort(nodes[part, axis], kind="stable")]
    gaps = np.diff(nodes[order, axis])
    if gaps.max() > 2 * reach[axis]:
        cut = int(np.argmax(gaps)) + 1
    else:
        places = np.flatnonzero(gaps)
        cut = int(places[np.argmin(np.abs(places - len(order) / 2))]) + 1
    return [np.sort(order[:cut]), np.sort(order[cut:])]
