"""Chapter 10: what was measured over buildings and starts, and against the exact filter, from the stored tables.

``book/_tools/locate.py`` made them.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pfslam.io.files import read_text
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.tables import Shown

TABLE = Path(__file__).parent / "locate.csv"
EXACT = Path(__file__).parent / "exact.csv"
POOR = Path(__file__).parent / "poor.csv"
COLUMNS = ("label", "building", "start_s", "seconds_to_find", "metres_to_find", "error_when_found_m", "error_at_end_m",
           "particles")  # fmt: skip
RIGHT = 0.5
"""An estimate no farther than this from the truth (m) is right."""


def runs(label: str | None = None) -> list[dict[str, str]]:
    """Return the runs of a method, or all of them, as the table has them."""
    rows = list(csv.DictReader(io.StringIO(read_text(TABLE))))
    return [row for row in rows if label in (None, row["label"])]


def labels() -> list[str]:
    """Return the methods in the order of the table."""
    return list(dict.fromkeys(row["label"] for row in runs()))


def counts(label: str) -> dict[str, int]:
    """Count the runs of a method: all, those that end right, and those that were sure of a wrong place at first."""
    rows = runs(label)
    return {
        "runs": len(rows),
        "right": sum(float(row["error_at_end_m"]) <= RIGHT for row in rows),
        "wrong_first": sum(float(row["error_when_found_m"] or 0.0) > RIGHT for row in rows),
        "buildings": len({row["building"] for row in rows}),
    }


def values(label: str, column: str) -> np.ndarray:
    """Return one column of a method's runs; those that were never sure are left out."""
    return np.array([float(row[column]) for row in runs(label) if row[column]])


def found_table() -> Shown:
    """Return each method's share of right runs, how soon it was sure, and how many particles it took."""
    rows = []
    for label in labels():
        count, seconds = counts(label), values(label, "seconds_to_find")
        wrong = f"{count['wrong_first']}" if len(seconds) else "-"
        median = f"{np.median(seconds):.1f}" if len(seconds) else "-"
        mean = f"{np.mean(values(label, 'particles')):,.0f}"
        rows.append((label, f"{count['right']} of {count['runs']}", wrong, median, mean))
    return Shown(("method", "right at the end", "sure, but wrong", "sure after [s]", "mean number"), rows)


def right_on_poor_maps(known: bool, inject: bool) -> int:
    """Count the runs, from a start that is known or not, that end right on a plan without the furniture."""
    rows = csv.DictReader(io.StringIO(read_text(POOR)))
    wanted = (str(int(known)), str(int(inject)))
    return sum(float(r["error_at_end_m"]) <= RIGHT for r in rows if (r["known"], r["inject"]) == wanted)


def distances_by_number() -> dict[int, np.ndarray]:
    """Return the total variation between cloud and histogram, an array over the seeds for each number of particles."""
    rows = list(csv.DictReader(io.StringIO(read_text(EXACT))))
    numbers = dict.fromkeys(int(row["particles"]) for row in rows)
    return {
        n: np.array([float(r["total_variation"]) for r in rows if int(r["particles"]) == n]) for n in numbers
    }


def exact_picture() -> Picture:
    """Draw how the distance of the cloud from the exact belief falls with the number of particles."""
    found = distances_by_number()
    medians = {n: float(np.median(d)) for n, d in found.items()}
    words = ", ".join(f"{d:.2f} with {n:,}" for n, d in medians.items())
    alt = f"Total variation between cloud and histogram filter against the number of particles: {words}."
    return Picture(_exact(found, medians), alt)


def _exact(found: dict[int, np.ndarray], medians: dict[int, float]) -> Figure:
    figure, axes = new_figure(5.6, 3.2)
    for n, distances in found.items():
        axes.plot(np.full(len(distances), n), distances, "o", color=COLOURS["particles"], markersize=5)
    axes.plot(list(medians), list(medians.values()), color=COLOURS["estimate"], label="median")
    axes.set(xscale="log", ylim=(0, 1), xlabel="number of particles", ylabel="total variation")
    axes.legend(loc="upper right")
    return figure
