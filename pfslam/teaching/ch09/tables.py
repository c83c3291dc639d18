"""Chapter 09: the stored studies as tables and as one picture of dots."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.tables import ERROR, errors_by_label, labels_of, read_table, select

NO_POLISH = ", and no polish"
LEAVE_ONE_OUT = {"hall": "ch09_leave_one_out", "ramp": "ch09_leave_one_out_ramp"}
"""The study of each drive."""


def middle(values: np.ndarray) -> float:
    """The median, as Python's float."""
    return float(np.median(values))


def length(metres: float) -> str:
    """A length in the unit that suits it.

    >>> length(0.0072), length(0.043), length(1.2)
    ('7.2 mm', '4.3 cm', '1.20 m')
    """
    if metres < 0.0095:
        return f"{1000 * metres:.1f} mm"
    return f"{100 * metres:.1f} cm" if metres < 0.95 else f"{metres:.2f} m"


def spread_line(values: np.ndarray) -> str:
    """Median and range of some errors, or the one value there is."""
    if len(values) == 1:
        return f"{length(values[0]):>8s}"
    return f"{length(middle(values)):>8s} ({length(values.min())} to {length(values.max())})"


def ladder_lines(studies: Iterable[str] = ("ch09_ladder", "ch09_ladder_ramp")) -> str:
    """One line per rung with the median and the worst run of each study, whose drive heads its column."""
    tables = [read_table(name) for name in studies]
    heads = [str(table["dataset"][0]) for table in tables]
    lines = [f"{'':29s}" + "".join(f"{head:9s} {'worst':9s} " for head in heads).rstrip()]
    errors = [errors_by_label(table) for table in tables]
    for label in errors[0]:
        cells = [length(f(e[label])) for e in errors for f in (middle, np.max)]
        lines.append(f"{label:29s}" + " ".join(f"{cell:9s}" for cell in cells).rstrip())
    return "\n".join(lines)


def left_out(drive: str, *, polish: bool, particles: int = 20) -> dict[str, np.ndarray]:
    """The errors of all runs on ``hall`` or ``ramp`` with one ingredient taken away, by the name of that ingredient."""
    rows = select(read_table(LEAVE_ONE_OUT[drive]), particles=float(particles))
    wanted = [label for label in labels_of(rows) if label.endswith(NO_POLISH) != polish]
    return {label.removesuffix(NO_POLISH): select(rows, label=label)[ERROR] for label in wanted}


def left_out_lines(columns: dict[str, dict[str, np.ndarray]]) -> str:
    """One line per ingredient with the median and the worst run of each column."""
    lines = [f"{'taken away':20s}" + "".join(f"{head:20s}" for head in columns).rstrip()]
    for label in next(iter(columns.values())):
        cells = [
            f"{length(middle(found[label]))} ({length(found[label].max())})" for found in columns.values()
        ]
        lines.append(f"{label:20s}" + "".join(f"{cell:20s}" for cell in cells).rstrip())
    return "\n".join(lines)


TICKS = {
    0.001: "1 mm",
    0.003: "3 mm",
    0.01: "1 cm",
    0.03: "3 cm",
    0.1: "10 cm",
    0.3: "30 cm",
    1.0: "1 m",
    3.0: "3 m",
}


def dots_picture(errors: dict[str, np.ndarray], title: str, height: float | None = None) -> Picture:
    """One dot per run, one row per label, a bar at the median, logarithmic scale."""
    figure, axes = new_figure(6.4, height or 0.8 + 0.36 * len(errors))
    words = []
    for row, (label, values) in enumerate(errors.items()):
        colour = COLOURS[colour_of(label)]
        axes.scatter(values, np.full(len(values), -row), color=colour, s=34, alpha=0.75, linewidths=0)
        axes.plot([middle(values)] * 2, [-row - 0.32, -row + 0.32], color=colour, linewidth=2.5)
        words.append(f"{label} {spread_line(values).strip()}")
    axes.set_yticks(-np.arange(len(errors)), list(errors))
    low, high = (f(np.min(v) if f is min else np.max(v) for v in errors.values()) for f in (min, max))
    ticks = [t for t in TICKS if low / 2.5 < t < 2.5 * high]
    axes.set(xscale="log", xlim=(low / 1.6, high * 1.6), ylim=(-len(errors) + 0.5, 0.5), xlabel=title)
    axes.set_xticks(ticks, [TICKS[t] for t in ticks])
    axes.set_xticks([], minor=True)
    return Picture(figure, f"{title}, one dot per run, bars at the medians. {'; '.join(words)}.")


def colour_of(label: str) -> str:
    """The colour of a method by the name of its row."""
    if label.startswith("dead"):
        return "odometry"
    if ("polish" in label and "no polish" not in label) or label == "refined":
        return "estimate"
    return "hits" if "before" in label or label == "report" else "particles"
