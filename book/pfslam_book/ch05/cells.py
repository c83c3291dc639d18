"""Chapter 05, SLAM in fifteen cells: the doors are unknown, and every particle draws a map of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.particles import effective_sample_size, systematic_resample

CELLS, DOORS = 15, (1, 4, 10)
SEEN_AT_DOOR, SEEN_AT_WALL, PRIOR = 0.95, 0.05, 0.3
"""Chance of seeing a door at one and where there is none; how many cells have a door, as far as one knows before."""
ENTRANCE = 0.98
"""Chance of telling the entrance, cell 0, from every other cell."""
STEP = {0: 0.05, 1: 0.9, 2: 0.05}
MOVES, PARTICLES = 44, 200


def door_after(door: np.ndarray, sees_door: bool) -> tuple[np.ndarray, np.ndarray]:
    """Bayes for one cell: the probability of a door after a look, and the probability of that look."""
    at_door, at_wall = (SEEN_AT_DOOR, SEEN_AT_WALL) if sees_door else (1 - SEEN_AT_DOOR, 1 - SEEN_AT_WALL)
    likelihood = door * at_door + (1 - door) * at_wall
    return door * at_door / likelihood, likelihood


@dataclass(frozen=True, eq=False)
class Cloud:
    """The end of a walk: ``cells (N,)``, ``weights (N,)``, ``maps (N, 15)`` of door probabilities."""

    cells: np.ndarray
    weights: np.ndarray
    maps: np.ndarray
    true_cell: int

    @property
    def right(self) -> float:
        """How much weight lies on the true cell."""
        return float(self.weights[self.cells == self.true_cell].sum())


def look(
    cells: np.ndarray,
    weights: np.ndarray,
    maps: np.ndarray,
    sees_door: bool,
    at_entrance: bool,
    own_maps: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Weigh every particle in its own map from its own cell, and draw what was seen.

    Returns the weights ``(N,)`` and the maps ``(N, 15)``.
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


def slam_walk(own_maps: bool = True, seed: int = 0) -> Cloud:
    """Walk three times round the courtyard: predict, look, weigh, draw, resample when N_eff falls below N / 2.

    With ``own_maps`` each particle draws its own map from its own path. Without, all share the map that the heaviest
    particle draws.
    """
    world, rng = (np.random.default_rng([seed, k]) for k in (0, 1))  # the same walk for both
    n, true_cell = PARTICLES, 0
    cells, weights, maps = np.zeros(n, dtype=int), np.full(n, 1 / n), blank_maps(n)
    for move in range(MOVES + 1):
        if effective_sample_size(weights) < n / 2:
            chosen = systematic_resample(weights, rng)
            cells, weights, maps = cells[chosen], np.full(n, 1 / n), maps[chosen]
        if move:
            true_cell = (true_cell + world.choice(list(STEP), p=list(STEP.values()))) % CELLS
            cells = (cells + rng.choice(list(STEP), size=n, p=list(STEP.values()))) % CELLS
        sees = bool(world.random() < (SEEN_AT_DOOR if true_cell in DOORS else SEEN_AT_WALL))
        weights, maps = look(cells, weights, maps, sees, true_cell == 0, own_maps)
    return Cloud(cells, weights, maps, true_cell)


def success(own_maps: bool, runs: int = 100) -> dict[str, float]:
    """Over many walks: mean weight on the true cell at the end, and the share of runs with all fifteen cells right."""
    at_end = [slam_walk(own_maps, seed) for seed in range(runs)]
    doors = np.isin(np.arange(CELLS), DOORS)
    maps = [np.array_equal(moment.weights @ moment.maps > 0.5, doors) for moment in at_end]
    return {"place": float(np.mean([moment.right for moment in at_end])), "map": float(np.mean(maps))}
