"""Chapter 05, SLAM in fifteen cells: the doors are unknown, and every particle draws a map of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from matplotlib.figure import Figure

from pfslam.particles import effective_sample_size, systematic_resample
from pfslam.teaching.show.pictures import steady
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.widgets import Explorer, Slider

CELLS, DOORS = 15, (1, 4, 10)
SEEN_AT_DOOR, SEEN_AT_WALL, PRIOR = 0.95, 0.05, 0.3
"""Chance of seeing a door at one and where there is none; how many cells have a door, as far as one knows before."""
ENTRANCE = 0.98
"""Chance of telling the entrance, cell 0, from every other cell."""
STEP = {0: 0.05, 1: 0.9, 2: 0.05}
MOVES, PARTICLES, SHOWN = 44, 200, 16


def door_after(door: np.ndarray, sees_door: bool) -> tuple[np.ndarray, np.ndarray]:
    """Bayes for one cell: the probability of a door after a look, and the probability of that look."""
    at_door, at_wall = (SEEN_AT_DOOR, SEEN_AT_WALL) if sees_door else (1 - SEEN_AT_DOOR, 1 - SEEN_AT_WALL)
    likelihood = door * at_door + (1 - door) * at_wall
    return door * at_door / likelihood, likelihood


@dataclass(frozen=True, eq=False)
class Cloud:
    """One moment: ``cells (N,)``, ``weights (N,)`` before resampling, ``maps (N, 15)`` of door probabilities."""

    cells: np.ndarray
    weights: np.ndarray
    maps: np.ndarray
    true_cell: int
    sees_door: bool

    @property
    def right(self) -> float:
        """How much weight lies on the true cell."""
        return float(self.weights[self.cells == self.true_cell].sum())


@lru_cache(maxsize=8)
def slam_walk(own_maps: bool = True, seed: int = 0) -> tuple[Cloud, ...]:
    """Three times round the courtyard from cell 0: predict, look, weigh, draw, resample when N_eff falls below N / 2.

    With ``own_maps`` each particle draws its own map from its own path. Without, all share the map that the heaviest
    particle draws.
    """
    world, rng = (np.random.default_rng([seed, k]) for k in (0, 1))  # the same walk for both
    n, true_cell = PARTICLES, 0
    cells, weights, maps = np.zeros(n, dtype=int), np.full(n, 1 / n), np.full((n, CELLS), PRIOR)
    maps[:, 0] = 0.0
    moments = []
    for move in range(MOVES + 1):
        if move:
            true_cell = (true_cell + world.choice(list(STEP), p=list(STEP.values()))) % CELLS
            cells = (cells + rng.choice(list(STEP), size=n, p=list(STEP.values()))) % CELLS
        chance = SEEN_AT_DOOR if true_cell in DOORS else SEEN_AT_WALL
        sees = bool(world.random() < chance)
        each = np.arange(n)
        after, likelihood = door_after(maps[each, cells], sees)
        likelihood = likelihood * np.where((cells == 0) == (true_cell == 0), ENTRANCE, 1 - ENTRANCE)
        after = np.where(cells == 0, 0.0, after)  # the entrance is no door
        weights = weights * likelihood / np.sum(weights * likelihood)
        maps = maps.copy()
        if own_maps:
            maps[each, cells] = after
        else:
            best = int(np.argmax(weights))
            maps[:, cells[best]] = after[best]
        moments.append(Cloud(cells, weights, maps, true_cell, sees))
        if effective_sample_size(weights) < n / 2:
            chosen = systematic_resample(weights, rng)
            cells, weights, maps = cells[chosen], np.full(n, 1 / n), maps[chosen]
    return tuple(moments)


def draw_cloud(maps: str, k: int) -> Figure:
    """The maps of some particles, one row each, with the particle's cell as a dot; all weights below."""
    moment = slam_walk(maps == "its own")[k]
    order = np.argsort(-moment.weights, kind="stable")[:: PARTICLES // SHOWN][:SHOWN]
    figure, (above, below) = new_figure(5.1, 5.6, rows=2, height_ratios=[3, 1], sharex=True)
    above.imshow(moment.maps[order], vmin=0, vmax=1, cmap="Greys", aspect="auto", interpolation="nearest")
    size = np.clip(25.0 * PARTICLES * moment.weights[order], 4.0, 150.0)
    above.scatter(moment.cells[order], np.arange(SHOWN), s=size, color=COLOURS["particles"], zorder=3)
    above.set(yticks=(), ylabel="particles, heaviest on top", xticks=range(0, CELLS, 2))
    above.grid(False)
    for door in DOORS:
        above.annotate(
            "▾", (door, -0.6), ha="center", va="bottom", color=COLOURS["truth"], annotation_clip=False
        )
    what = "sees a door" if moment.sees_door else "sees no door"
    what = what if moment.true_cell else "is at the entrance"
    above.set_title(f"move {k}: the robot {what}", pad=14)
    below.bar(np.arange(CELLS), np.bincount(moment.cells, moment.weights, CELLS), color=COLOURS["estimate"])
    below.scatter(moment.true_cell, 0.92, marker="v", s=80, color=COLOURS["truth"], zorder=3)
    below.set(ylim=(0, 1), yticks=(0, 0.5, 1), ylabel="belief", xlabel="cell (triangle: the robot)")
    return figure


def describe_cloud(maps: str, k: int) -> str:
    """The same in words."""
    moment = slam_walk(maps == "its own")[k]
    kinds = len(np.unique(np.round(moment.maps, 3), axis=0))
    n_eff = effective_sample_size(moment.weights)
    return f"""Maps: {maps}. After {k} moves the robot is in cell {moment.true_cell}. {moment.right:.2f} of the weight
    is there; N_eff is {n_eff:.0f} of {PARTICLES}; there are {kinds} different maps."""


def slam_explorer() -> Explorer:
    """The three rounds, with a map for each particle and with one map for all."""
    return Explorer(
        steady(draw_cloud),
        [
            Slider("maps", ("its own", "one for all"), 0, "Each particle's map"),
            Slider("k", tuple(range(0, MOVES + 1, 2)), 0, "Moves"),
        ],
        alt=describe_cloud,
        title="SLAM in fifteen cells: the doors are unknown",
        play="k",
        pause=700,
    )


def success(own_maps: bool, runs: int = 100) -> dict[str, float]:
    """Over many walks: mean weight on the true cell at the end, and the share of runs with all fifteen cells right."""
    at_end = [slam_walk.__wrapped__(own_maps, seed)[-1] for seed in range(runs)]
    doors = np.isin(np.arange(CELLS), DOORS)
    maps = [np.array_equal(moment.weights @ moment.maps > 0.5, doors) for moment in at_end]
    return {"place": float(np.mean([moment.right for moment in at_end])), "map": float(np.mean(maps))}
