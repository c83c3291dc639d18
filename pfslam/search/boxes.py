"""Which lattice nodes to score together: the estimate of what it costs, and the boxes that follow from it.

There are two ways to score the windows of many nodes. One *volume* over the box that holds them all: every heading
adds up patches as large as the box, so that windows that overlap are scored once; but so are the gaps between them.
Or *each window by itself*, heading by heading: only what is needed is scored, but what windows share is scored again
and patches are small. Both copy patches of the map and add them up, one for each cell that the scan falls into; they
differ in how many patches and how large.
"""

from __future__ import annotations

import numpy as np

PATCH = 400
"""To start on a patch takes as long as to copy and add so many of its cells."""
MAX_SCORES = 20_000_000
"""Scores held at once (80 MB): a box of nodes whose volume or windows would hold more is cut in any case."""
MAX_SIDE = 4096
"""Columns or rows of a box: the map is read in one piece around it, gaps included, so that a wider one is cut too."""


def costs(nodes: np.ndarray, reach: np.ndarray) -> tuple[int, int]:
    """Estimate what ``nodes (U, 3)`` cost as one volume and window by window, in cells copied for each of the scan's.

    ``reach (3,)`` is the half width of a window in columns, rows and headings.
    """
    window = 2 * reach + 1
    box = np.ptp(nodes, axis=0) + window
    return int(box[2] * (PATCH + box[0] * box[1])), int(
        len(nodes) * window[2] * (PATCH + window[0] * window[1])
    )


def volume_is_cheaper(nodes: np.ndarray, reach: np.ndarray) -> bool:
    """Tell whether one volume beats a window for each of ``nodes (U, 3)``."""
    volume, windows = costs(nodes, reach)
    return volume <= windows


def lie_together(nodes: np.ndarray, reach: np.ndarray) -> bool:
    """Tell whether all ``nodes (U, 3)`` lie within one window, so that one volume serves them without any estimate.

    Their windows' scores must also fit into memory.
    """
    window = 2 * reach + 1
    return bool((np.ptp(nodes, axis=0) < window).all()) and len(nodes) * int(np.prod(window)) <= MAX_SCORES


def cheapest_boxes(nodes: np.ndarray, reach: np.ndarray) -> list[np.ndarray]:
    """Divide ``nodes (U, 3)`` into boxes, given as index arrays, each scored in one go.

    ``reach (3,)`` is the half width of a window in columns, rows and headings. A box is cut in two at its longest side
    for as long as the two halves together are estimated to cost less.
    """
    boxes, pending = [], [np.arange(len(nodes))]
    while pending:
        part = pending.pop()
        halves = _cut_in_two(nodes, part, reach)
        if halves and (
            _too_large(nodes[part], reach)
            or sum(min(costs(nodes[half], reach)) for half in halves) < min(costs(nodes[part], reach))
        ):
            pending.extend(halves[::-1])
        else:
            boxes.append(part)
    return boxes


def _too_large(nodes: np.ndarray, reach: np.ndarray) -> bool:
    """Tell whether the scores of ``nodes (U, 3)``, window by window or as a volume, would be more than allowed.

    Or whether they lie so far apart that the piece of the map around them would be large.
    """
    window, box = 2 * reach + 1, np.ptp(nodes, axis=0) + 2 * reach + 1
    volume = int(np.prod(box)) if volume_is_cheaper(nodes, reach) else 0
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
