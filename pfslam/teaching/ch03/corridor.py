"""Chapter 03, the Bayes filter on a ring of a few cells: sums instead of integrals, nothing random."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.teaching.show.pictures import steady
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.widgets import Explorer, Slider

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


def bar_row(axes: Axes, values: np.ndarray, colour: str, title: str) -> None:
    """One row of fifteen bars over the corridor, its doors shaded."""
    for door in DOORS:
        axes.axvspan(door - 0.5, door + 0.5, color=COLOURS["unknown"], alpha=0.5, linewidth=0)
    axes.bar(np.arange(CELLS), values, color=COLOURS[colour], width=0.8)
    axes.set(ylim=(0.0, 1.0), yticks=(0.0, 0.5, 1.0), xlim=(-0.6, CELLS - 0.4), xticks=range(0, CELLS, 2))
    axes.set_title(title, loc="left", fontsize=12)


def draw_moment(moments: list[Moment], k: int) -> Figure:
    """Belief before, the likelihood of what is seen, and belief after, one above the other."""
    moment, before = moments[k], moments[max(k - 1, 0)]
    figure, rows = new_figure(5.1, 5.0, rows=3, sharex=True)
    looks = moment.what.startswith("sees")
    sees_door = moment.what == "sees a door"
    bar_row(rows[0], before.belief, "particles", "prior: the belief before")
    nothing = "no look: the robot moves one cell"
    bar_row(
        rows[1],
        door_likelihood(sees_door) if looks else np.zeros(CELLS),
        "highlight",
        f"× likelihood: it {moment.what}" if looks else nothing if k else "it has not looked yet",
    )
    ending = "posterior: their product, made to sum to 1" if looks else "the belief after the move"
    bar_row(rows[2], moment.belief, "estimate", f"= {ending}" if k else "all cells alike")
    for row, at in ((rows[0], before.true_cell), (rows[2], moment.true_cell)):
        row.scatter(at, 0.9, marker="v", s=90, color=COLOURS["truth"], zorder=3)
    rows[2].set_xlabel("cell (grey: doors; triangle: the robot)")
    return figure


def describe_moment(moments: list[Moment], k: int) -> str:
    """The same in words."""
    moment = moments[k]
    best = moment.best_cell
    return f"""After {k} half steps the robot {moment.what}. It is in cell {moment.true_cell}; the most probable
    cell is {best} with {moment.belief[best]:.2f}."""


def corridor_explorer() -> Explorer:
    """Step through the walk: each move blurs the belief, each look multiplies it by a likelihood."""
    moments = corridor_walk()
    return Explorer(
        steady(partial(draw_moment, moments)),
        [Slider("k", range(len(moments)), 1, "Look, move, look, ...", "")],
        alt=partial(describe_moment, moments),
        title="Prior times likelihood is posterior, in a corridor of fifteen cells",
        play="k",
        pause=900,
    )
