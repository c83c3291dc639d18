"""Chapter 09: error against the number of particles, situation by situation, over buildings, from the stored study."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.tables import ERROR, Shown, labels_of, read_table, select
from pfslam_book.show.widgets import Explorer, Slider

STUDIES = "ch09_particles", "ch09_hard_particles"
NUMBERS = (1, 5, 50)
MATCHING = ", scan matching"
LOST = 0.3
"""A run with a greater error (m) counts as lost."""
SIDES = {"no polish": "particles", "polish": "estimate"}


def situations() -> list[str]:
    """Return the situations of the studies."""
    found = [label for study in STUDIES for label in labels_of(read_table(study))]
    return [label for label in found if not label.endswith(MATCHING)]


def situation_errors(situation: str, particles: int | str, polish: bool = True) -> np.ndarray:
    """Return the errors (m) in every building with so many particles, or with "scan matching"."""
    table = next(t for t in map(read_table, STUDIES) if situation in labels_of(t))
    if particles == "scan matching":
        rows = select(table, label=situation + MATCHING)
    else:
        rows = select(table, label=situation, particles=float(particles))
    polished = np.array([str(value) not in ("0.0", "false", "False") for value in rows["lines"]])
    return rows[ERROR][polished == polish]


def particles_help(situation: str, polish: bool) -> str:
    """Return in how many buildings 50 particles have a smaller error than one, in words."""
    many, one = (situation_errors(situation, n, polish) for n in (50, 1))
    return f"{np.count_nonzero(many < one)} of {len(one)}"


def lost_while_blind(particles: int | str) -> str:
    """Return how many runs of all blind drives end with a greater error than ``LOST``, in words."""
    found = [situation_errors(name, particles) for name in situations() if name.startswith("blind")]
    errors = np.concatenate(found)
    return f"{np.count_nonzero(errors > LOST)} of {len(errors)}"


def particles_table() -> Shown:
    """Return the median error (cm) and the number of lost runs with one noiseless pose and 1, 5 and 50 particles."""
    rows = []
    for situation in situations():
        for polish in (False, True):
            found = [situation_errors(situation, n, polish) for n in ("scan matching", *NUMBERS)]
            if len(found[1]):
                name = situation if polish else f"{situation}, no polish"
                cells = [f"{100 * np.median(e):.1f} ({np.count_nonzero(e > LOST)})" for e in found]
                rows.append((name, str(len(found[1])), *cells))
    head = ("median [cm] (runs lost)", "buildings", "scan matching", *(f"N = {n}" for n in NUMBERS))
    return Shown(head, rows)


def particles_explorer() -> Explorer:
    """Return the widget that shows every run of a situation against the number of particles."""
    names = Slider("situation", situations(), 0, "Situation")
    title = "Error against the number of particles, one dot per building"
    return Explorer(_frame, [names], title=title, alt=_alt)


def _frame(situation: str) -> Figure:
    figure, axes = new_figure(6.2, 3.8)
    for shift, (side, colour) in zip((0.92, 1.09), SIDES.items(), strict=True):
        found = [situation_errors(situation, n, side == "polish") for n in NUMBERS]
        if not len(found[0]):
            continue
        for n, errors in zip(NUMBERS, found, strict=True):
            places = np.full(len(errors), n * shift)
            axes.scatter(places, 100 * errors, s=40, color=COLOURS[colour], linewidths=0, alpha=0.8)
        medians = [100 * np.median(errors) for errors in found]
        axes.plot(np.array(NUMBERS) * shift, medians, color=COLOURS[colour], label=side)
    axes.set(xscale="log", yscale="log", xlim=(0.8, 65), ylim=(0.1, 3000), xlabel="number of particles")
    axes.set(ylabel="position error (RMS) [cm]", title=situation)
    axes.set_xticks(NUMBERS, [str(n) for n in NUMBERS])
    axes.set_xticks([], minor=True)
    axes.set_yticks([0.1, 1, 10, 100, 1000], ["0.1", "1", "10", "100", "1000"])
    axes.set_yticks([], minor=True)
    axes.legend(loc="upper right")
    return figure


def _alt(situation: str) -> str:
    words = []
    for side in SIDES:
        found = {n: situation_errors(situation, n, side == "polish") for n in NUMBERS}
        if len(found[1]):
            cells = [f"{100 * np.median(e):.1f} with {n}" for n, e in found.items()]
            words.append(f"{side}: {', '.join(cells)}")
    return f"{situation}: median error (root mean square) in cm by number of particles. {'; '.join(words)}."
