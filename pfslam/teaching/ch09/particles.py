"""Chapter 09: error against the number of particles, situation by situation, from the stored study."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from pfslam.study.table import Table
from pfslam.teaching.ch09.tables import length, middle
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.tables import ERROR, labels_of, read_table, select

NUMBERS = (1, 5, 50)
SIDES = {"no polish": "particles", "polish": "estimate"}
"""The two halves of each picture and their colours."""


def load_particles() -> Table:
    """The stored study."""
    return read_table("ch09_particles")


def situations(table: Table) -> list[str]:
    """The situations, without the rows of scan matching."""
    return [label for label in labels_of(table) if not label.startswith("matching")]


def polished(table: Table) -> np.ndarray:
    """Which rows ran with the polish."""
    return np.array([str(value) not in ("0.0", "false") for value in table["polish"]])


def errors_of(table: Table, situation: str, side: str, particles: int) -> np.ndarray:
    """Errors (m) over the seeds of one situation with so many particles."""
    rows = select(table, label=situation, particles=float(particles))
    return rows[ERROR][polished(rows) == (side == "polish")]


def particles_lines(table: Table) -> str:
    """Median error with 1, 5 and 50 particles in each situation, without the polish and with it."""
    lines = [
        f"{'':16s} {'no polish':29s} polish",
        f"{'particles':16s} " + ("{:<9d} " * 6).format(*NUMBERS * 2).rstrip(),
    ]
    for situation in situations(table):
        cells = [length(middle(errors_of(table, situation, side, n))) for side in SIDES for n in NUMBERS]
        lines.append(f"{situation:16s} " + " ".join(f"{cell:9s}" for cell in cells).rstrip())
    return "\n".join(lines)


def matching_lines(table: Table) -> str:
    """The same for one pose without noise, where odometry has to carry it."""
    lines = []
    for label in (label for label in labels_of(table) if label.startswith("matching")):
        rows = select(table, label=label)
        with_polish = polished(rows)
        without, with_it = (length(middle(rows[ERROR][with_polish == side])) for side in (False, True))
        lines.append(f"{label}: {without} without the polish, {with_it} with it")
    return "\n".join(lines)


def particles_frame(table: Table) -> Callable[..., Figure]:
    """The drawing function of the explorer: one dot per run against the number of particles."""

    def draw(situation: str) -> Figure:
        figure, axes = new_figure(6.2, 3.8)
        for shift, (side, colour) in zip((0.92, 1.09), SIDES.items(), strict=True):
            found = {n: errors_of(table, situation, side, n) for n in NUMBERS}
            for n, errors in found.items():
                axes.scatter(
                    np.full(len(errors), n * shift),
                    errors,
                    s=40,
                    color=COLOURS[colour],
                    linewidths=0,
                    alpha=0.8,
                )
            medians = [middle(errors) for errors in found.values()]
            axes.plot(np.array(NUMBERS) * shift, medians, color=COLOURS[colour], label=side)
        axes.set(
            xscale="log",
            yscale="log",
            ylim=(0.001, 30),
            xlabel="number of particles",
            ylabel="position error (RMS)",
            title=situation,
        )
        axes.set_xticks(NUMBERS, [str(n) for n in NUMBERS])
        axes.set_xticks([], minor=True)
        axes.set_yticks([0.001, 0.01, 0.1, 1, 10], ["1 mm", "1 cm", "10 cm", "1 m", "10 m"])
        # Few of the small ticks: each takes its time.
        axes.set_yticks(np.outer([0.001, 0.01, 0.1, 1], [2, 5]).ravel(), minor=True)
        axes.legend(loc="upper right")
        return figure

    return draw


def particles_alt(table: Table) -> Callable[..., str]:
    """The words for one situation."""

    def alt(situation: str) -> str:
        words = []
        for side in SIDES:
            cells = [f"{length(middle(errors_of(table, situation, side, n)))} with {n}" for n in NUMBERS]
            words.append(f"{side}: {', '.join(cells)}")
        return f"{situation}: median error (root mean square) by number of particles. {'; '.join(words)}."

    return alt
