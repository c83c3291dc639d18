"""Chapter 09: the stored studies as tables and as one picture of dots."""

from __future__ import annotations

from itertools import pairwise
from math import comb
from typing import Any

import numpy as np

from pfslam.study import read_study
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.tables import (
    ERROR,
    Shown,
    errors_by_label,
    labels_of,
    number_of_buildings,
    read_table,
    select,
    study_file,
)

LADDER, HARD_LADDER = "ch09_ladder", "ch09_hard_ladder"
LEFT_OUT = {"hall": "ch09_leave_one_out", "ramp": "ch09_leave_one_out", "hard": "ch09_hard_leave_one_out"}
BARE = "dead reckoning"
KNOWN_AS = {
    "+ gentle clearing": "inverse sensor model",
    "+ higher clamp": "clamping",
    "+ likelihood field": "likelihood field",
    "+ likelihood weights": "tempered likelihood",
    "+ resampling at N/2": "adaptive resampling",
    "+ weighted mean": "posterior mean",
    "+ pose on the lattice": "",
    "+ motion prior": "maximum a posteriori",
    "+ sub-cell step": "parabolic peak",
    "+ noise of the motion": "odometry motion model",
    "+ exact start": "",
    "+ coarser headings": "",
    "+ wider in x, y": "correlative matching",
    "+ wider in heading": "correlative matching",
    "+ every second beam": "thinning",
    "+ draw after motion": "keyframes",
    "+ tilt": "attitude compensation",
    "+ polish": "point-to-line ICP, NDT",
}
"""What the literature calls each change."""


def cm(metres: float | np.ndarray, digits: int = 1) -> str:
    """Return the median of some errors in centimetres.

    >>> cm(0.0123), cm(np.array([0.1, 0.2, 0.4]))
    ('1.2', '20.0')
    """
    return f"{100 * float(np.median(metres)):.{digits}f}"


def medians_cm(errors: dict[str, np.ndarray]) -> dict[str, float]:
    """Return the median of each set of errors in centimetres."""
    return {label: 100 * float(np.median(values)) for label, values in errors.items()}


# ---- the ladder


def ladder() -> dict[str, np.ndarray]:
    """Return the error (m) in every building for each rung, in the same order of buildings."""
    return errors_by_label(read_table(LADDER))


def changes_table() -> Shown:
    """Return each change of the ladder with the fields that it sets and its name in the literature."""
    fields = changed_fields(LADDER)
    rows = [(label, field, KNOWN_AS.get(label, "")) for label, field in fields.items()]
    return Shown(("change", "in the configuration", "known as"), rows, left=(1, 2))


def ladder_table() -> Shown:
    """Return the error after each change, and in how many buildings the change helped."""
    rows, before = [], None
    for label, found in ladder().items():
        helped = _better(found, before) if before is not None and label.startswith("+") else ""
        rows.append((label, cm(found), cm(found.max()), helped))
        before = found
    return Shown(("change", "median [cm]", "worst [cm]", f"better [of {number_of_buildings(LADDER)}]"), rows)


def _better(found: np.ndarray, before: np.ndarray) -> str:
    if np.array_equal(found, before):
        return "the same runs"
    same = np.count_nonzero(found == before)
    return f"{np.count_nonzero(found < before)}" + (f", {same} the same" if same else "")


def hard_ladder() -> dict[str, np.ndarray]:
    """Return the error (m) in the buildings with people, doors, glass, sweep, bumps and slip, rung by rung."""
    return errors_by_label(read_table(HARD_LADDER))


def steps(errors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return what each rung adds to the error (m) of the one before it, in each building."""
    rungs = list(errors)
    return {rung: errors[rung] - errors[before] for before, rung in pairwise(rungs) if rung.startswith("+")}


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """Return two of the values between which the median lies in at least 95 % of all samples of so many.

    It lies outside the k-th smallest and the k-th largest with the probability that fewer than k of n coins fall on
    one side, twice. There must be six values or more.

    >>> median_interval(np.arange(10.0))
    (1.0, 8.0)
    """
    n = len(values)
    outside = 2 * np.cumsum([comb(n, i) for i in range(n)]) / 2.0**n
    cut = int(np.count_nonzero(outside <= 0.05)) - 1
    ordered = np.sort(values)
    return float(ordered[cut]), float(ordered[n - 1 - cut])


def decided(differences: dict[str, np.ndarray]) -> list[str]:
    """List the rungs whose interval does not contain zero."""
    return [rung for rung, values in differences.items() if np.prod(median_interval(values)) > 0]


def hard_ladder_table() -> Shown:
    """Return what the rungs that matter on hard drives do there, and in the same buildings without hazards."""
    hard, seeds = steps(hard_ladder()), np.unique(read_table(HARD_LADDER)["simulator.seed"])
    clean = steps(errors_by_label(select(read_table(LADDER), **{"simulator.seed": seeds})))
    rows = []
    for rung in decided(hard):
        low, high = median_interval(hard[rung])
        medians = (f"{100 * np.median(found[rung]):+.1f}" for found in (clean, hard))
        better = f"{np.count_nonzero(hard[rung] < 0)}"
        rows.append((rung, *medians, f"{100 * low:+.1f} to {100 * high:+.1f}", better))
    head = ("change", "clean [cm]", "hard [cm]", "95 % interval", f"better [of {len(seeds)}]")
    return Shown(head, rows)


def changed_fields(study: str) -> dict[str, str]:
    """Return the settings that each variant of a study adds to the one before it, as one would write them."""
    first: dict[str, dict[str, Any]] = {}
    for case in read_study(study_file(study)).cases:
        first.setdefault(case.label, dict(case.settings))
    found, before = {}, None
    for label, settings in first.items():
        if label.startswith("+") and before is not None:
            new = {k: v for k, v in settings.items() if before.get(k) != v}
            found[label] = ", ".join(f"{key.split('.')[-1]} {_value(value)}" for key, value in new.items())
        before = settings
    return found


def _value(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return " to ".join(map(_value, value))
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:.3g}"
    return "on" if str(value).endswith("Config") else str(value)


def prior_table() -> Shown:
    """Return the errors with the prior and without the sub-cell step, for more and fewer scans of one drive."""
    table = read_table("ch09_prior")
    rows = []
    for every in np.unique(table["every"]):
        found = select(table, every=every)[ERROR]
        rows.append((f"every {every:.0f}th scan", cm(found), cm(found.max())))
    return Shown(("prior, no sub-cell step", "median [cm]", "worst [cm]"), rows)


# ---- take one away

NO_POLISH = ", and no polish"


def left_out(polish: bool, drive: str = "hall") -> dict[str, np.ndarray]:
    """Return the errors (m) in all buildings with one ingredient taken away, under the name of that ingredient.

    The drives are those of "hall", of "ramp", which has slopes, or "hard" ones, where the world moves.
    """
    found = errors_by_label(read_table(LEFT_OUT[drive]))
    own = {label: e for label, e in found.items() if label.startswith("ramp, ") == (drive == "ramp")}
    own = {label.removeprefix("ramp, "): e for label, e in own.items()}
    return {k.removesuffix(NO_POLISH): e for k, e in own.items() if k.endswith(NO_POLISH) != polish}


def missed(errors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return by how much (m) the error in each building is greater without an ingredient than with all of them."""
    return {label: e - errors["nothing"] for label, e in errors.items() if label != "nothing"}


def left_out_table() -> Shown:
    """Return the errors without each change, without the polish and with it, and where the change is missed."""
    rows, count = [], number_of_buildings("ch09_leave_one_out")
    for drive, note in (("hall", ""), ("ramp", ", on slopes")):
        bare, full = left_out(False, drive), left_out(True, drive)
        for label in bare:
            row = [label + note]
            for errors in (bare, full):
                missed = np.count_nonzero(errors[label] > errors["nothing"])
                said = "" if label == "nothing" else f"{missed}"
                row += [cm(errors[label], 2), cm(errors[label].max(), 2), said]
            rows.append(row)
    worse = f"worse [of {count}]"
    head = (
        "taken away",
        "no polish: median [cm]",
        "worst [cm]",
        worse,
        "polish: median [cm]",
        "worst [cm]",
        worse,
    )
    return Shown(head, rows)


def hard_left_out_table() -> Shown:
    """Return the changes that are missed where the world moves, or better left out, all without the polish."""
    errors, rows = left_out(False, "hard"), []
    missing = missed(errors)
    for label in decided(missing):
        low, high = median_interval(missing[label])
        apart = f"{100 * np.median(missing[label]):+.2f}"
        worse = f"{np.count_nonzero(missing[label] > 0)}"
        rows.append((label, cm(errors[label]), apart, f"{100 * low:+.2f} to {100 * high:+.2f}", worse))
    worse = f"worse [of {len(errors['nothing'])}]"
    return Shown(("taken away", "median [cm]", "difference [cm]", "95 % interval", worse), rows)


# ---- other studies


def spread_table(study: str) -> Shown:
    """Return median, best and worst error of each method of a study, in centimetres."""
    rows = (
        (label, str(len(e)), cm(e), cm(e.min()), cm(e.max()))
        for label, e in errors_by_label(read_table(study)).items()
    )
    return Shown(("error [cm]", "runs", "median", "best", "worst"), list(rows))


def map_agreement_table(rungs: tuple[str, ...] = ("report", "+ gentle clearing", "+ polish")) -> Shown:
    """Return the overlap of the occupied cells with the true walls for some rungs, as medians over the buildings."""
    table = read_table(LADDER)
    rows = [
        (label, f"{np.median(select(table, label=label)['map_iou_occupied']):.2f}")
        for label in labels_of(table)
        if label in rungs
    ]
    return Shown(("filter", "overlap with the true walls"), rows)


TICKS = {0.001: "0.1", 0.003: "0.3", 0.01: "1", 0.03: "3", 0.1: "10", 0.3: "30", 1.0: "100", 3.0: "300"}


def dots_picture(errors: dict[str, np.ndarray], title: str) -> Picture:
    """Draw one dot per run, one row per label, a bar at the median, logarithmic scale."""
    figure, axes = new_figure(6.4, 0.8 + 0.34 * len(errors))
    words = []
    for row, (label, values) in enumerate(errors.items()):
        colour = COLOURS[colour_of(label)]
        middle = float(np.median(values))
        axes.scatter(values, np.full(len(values), -row), color=colour, s=34, alpha=0.7, linewidths=0)
        axes.plot([middle] * 2, [-row - 0.32, -row + 0.32], color=colour, linewidth=2.5)
        words.append(f"{label} {cm(values)} ({cm(values.min())} to {cm(values.max())})")
    axes.set_yticks(-np.arange(len(errors)), list(errors))
    low, high = min(np.min(v) for v in errors.values()), max(np.max(v) for v in errors.values())
    ticks = [t for t in TICKS if low / 2.5 < t < 2.5 * high]
    axes.set(xscale="log", xlim=(low / 1.6, high * 1.6), ylim=(-len(errors) + 0.5, 0.5))
    axes.set(xlabel=f"{title} [cm]")
    axes.set_xticks(ticks, [TICKS[t] for t in ticks])
    axes.set_xticks([], minor=True)
    return Picture(figure, f"{title} in cm, one dot per run, bars at the medians. {'; '.join(words)}.")


def colour_of(label: str) -> str:
    """Return the colour of a method by the name of its row."""
    if label == BARE:
        return "odometry"
    if label in ("report", "refined"):
        return label if label in COLOURS else {"report": "hits", "refined": "estimate"}[label]
    return "estimate" if label == "+ polish" else "particles"


def ladder_picture() -> Picture:
    """Draw the error in every building, rung by rung."""
    return dots_picture(ladder(), "position error (RMS)")


def buildings() -> dict[str, np.ndarray]:
    """Return the errors (m) of three methods in twenty buildings."""
    return errors_by_label(read_table("ch09_buildings"))


def buildings_picture() -> Picture:
    """Draw the error of three methods in twenty buildings."""
    return dots_picture(buildings(), "position error (RMS)")
