"""SLAM in fifteen cells, one look: what the laboratory is held to."""

from __future__ import annotations

import numpy as np

CELLS, DOORS = 15, (1, 4, 10)
SEEN_AT_DOOR, SEEN_AT_WALL, PRIOR = 0.95, 0.05, 0.3
"""Chance of seeing a door at one and where there is none; how many cells have a door, as far as one knows before."""
ENTRANCE = 0.98
"""Chance of telling the entrance, cell 0, from every other cell."""
STEP = {0: 0.05, 1: 0.9, 2: 0.05}


def door_after(door: np.ndarray, sees_door: bool) -> tuple[np.ndarray, np.ndarray]:
    """Bayes for one cell: the probability of a door after a look, and the probability of that look."""
    at_door, at_wall = (SEEN_AT_DOOR, SEEN_AT_WALL) if sees_door else (1 - SEEN_AT_DOOR, 1 - SEEN_AT_WALL)
    likelihood = door * at_door + (1 - door) * at_wall
    return door * at_door / likelihood, likelihood


def look(
    cells: np.ndarray,
    weights: np.ndarray,
    maps: np.ndarray,
    sees_door: bool,
    at_entrance: bool,
    own_maps: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Weigh every particle in its own map from its own cell, and draw what was seen.

    Returns the weights ``(N,)`` and the maps ``(N, 15)``; without ``own_maps`` the heaviest draws into all maps.
    """
    each, maps = np.arange(len(cells)), maps.copy()
    after, likelihood = door_after(maps[each, cells], sees_door)
    likelihood = likelihood * np.where((cells == 0) == at_entrance, ENTRANCE, 1 - ENTRANCE)
    after = np.where(cells == 0, 0.0, after)  # the entrance is no door
    weights = weights * likelihood / np.sum(weights * likelihood)
    if own_maps:
        maps[each, cells] = after
    else:
        best = int(np.argmax(weights))
        maps[:, cells[best]] = after[best]
    return weights, maps


def blank_maps(n: int) -> np.ndarray:
    """The maps ``(n, 15)`` of particles that have seen nothing but the entrance."""
    maps = np.full((n, CELLS), PRIOR)
    maps[:, 0] = 0.0
    return maps
