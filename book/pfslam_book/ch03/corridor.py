"""Chapter 03, the Bayes filter on a ring of a few cells: sums instead of integrals, nothing random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CELLS = 15
DOORS = (1, 4, 10)
DOOR_SEEN_AT_DOOR, DOOR_SEEN_AT_WALL = 0.8, 0.1
STEP = {0: 0.1, 1: 0.8, 2: 0.1}
"""Told to move one cell, the robot slips and stays, moves one, or overshoots by one, with these probabilities."""
TRUE_START, MOVES = 1, 9


def predict_belief(belief: np.ndarray, step: dict[int, float]) -> np.ndarray:
    """Belief ``(cells,)`` after a move: each cell hands on its probability. The corridor runs round a courtyard."""
    moved = np.zeros_like(belief)
    for cells, probability in step.items():
        moved += probability * np.roll(belief, cells)
    return moved


def update_belief(belief: np.ndarray, likelihood: np.ndarray) -> np.ndarray:
    """Belief ``(cells,)`` times the likelihood of what was seen, brought back to sum 1."""
    product = belief * likelihood
    return product / product.sum()


def door_likelihood(sees_door: bool) -> np.ndarray:
    """Probability ``(cells,)`` of this observation, door or none, from each cell."""
    door = np.full(CELLS, DOOR_SEEN_AT_WALL)
    door[list(DOORS)] = DOOR_SEEN_AT_DOOR
    return door if sees_door else 1.0 - door


@dataclass(frozen=True, eq=False)
class Moment:
    """The belief after one half step of the filter, and where the robot truly is."""

    what: str
    belief: np.ndarray
    true_cell: int

    @property
    def best_cell(self) -> int:
        """The most probable cell: the maximum a posteriori."""
        return int(np.argmax(self.belief))


def corridor_walk() -> list[Moment]:
    """The robot wakes up somewhere, looks, then moves and looks in turn. It is told nothing but door or no door."""
    cell = TRUE_START
    moments = [Moment("wakes up", np.full(CELLS, 1.0 / CELLS), cell)]
    for move in range(MOVES + 1):
        if move:
            cell += 1
            belief = predict_belief(moments[-1].belief, STEP)
            moments.append(Moment("moves one cell", belief, cell))
        sees = cell in DOORS
        belief = update_belief(moments[-1].belief, door_likelihood(sees))
        moments.append(Moment("sees a door" if sees else "sees no door", belief, cell))
    return moments
