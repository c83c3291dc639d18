"""Chapter 09: the floor texture, one improvement after the other, on both drives, from a stored table."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from pfslam.io.files import read_text

TABLE = Path(__file__).parent / "ch09_texture.csv"
COLUMNS = ("drive", "step", "seed", "coverage", "beyond_floor", "position_median_cells", "colour_mean")
FIGURES = COLUMNS[3:]


def read_steps() -> list[dict]:
    """The stored rows, figures as float."""
    rows = list(csv.DictReader(io.StringIO(read_text(TABLE))))
    return [{k: float(v) if k in FIGURES else v for k, v in row.items()} for row in rows]


def steps_lines() -> str:
    """Medians over the seeds: coverage, paint off the floor, shift of the pattern and colour error, for both drives."""
    rows = read_steps()
    head = "covered   off  shift  colour"
    lines = [f"{'':32s}{'hall':31s}ramp", f"{'':32s}{head}   {head}"]
    for name in dict.fromkeys(row["step"] for row in rows):
        cells = []
        for drive in dict.fromkeys(row["drive"] for row in rows):
            covered, off, shift, colour = (np.median(values_of(rows, drive, name, f)) for f in FIGURES)
            cells.append(f"{100 * covered:5.0f} % {100 * off:3.0f} %  {shift:5.2f}  {colour:6.0f}")
        lines.append(f"{name:32s}" + "   ".join(cells))
    return "\n".join(lines)


def values_of(rows: list[dict], drive: str, step: str, figure: str) -> list[float]:
    """One figure over the seeds."""
    return [row[figure] for row in rows if (row["drive"], row["step"]) == (drive, step)]


def largest_spread(figure: str) -> float:
    """How far the seeds of one drive and step lie apart at most."""
    rows = read_steps()
    places = dict.fromkeys((row["drive"], row["step"]) for row in rows)
    return float(max(np.ptp(values_of(rows, *place, figure)) for place in places))
