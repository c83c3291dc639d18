"""Chapter 09: the stored studies as tables, one change at a time, paired by building."""

from __future__ import annotations

from itertools import pairwise
from math import comb
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from pfslam.study import read_study
from pfslam.study.run import OFF
from pfslam_book.show.tables import ERROR, Shown, errors_by_label, labels_of, read_table, select, study_file

PARTED = Path(__file__).with_name("parted.npz")
LADDER, HARD_LADDER = "ch09_ladder", "ch09_hard_ladder"
KNOWN_AS = {
    "+ gentle clearing": "inverse sensor model",
    "+ weighted mean": "posterior mean",
    "+ likelihood and prior": "correlative scan matching",
    "+ noise of the motion": "odometry motion model",
    "+ draw after motion": "keyframes",
    "+ tilt": "attitude compensation",
    "+ alignment": "point-to-line ICP, NDT",
}
"""What the literature calls each change."""


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """Return two of the values ``(n,)``; in at least 95 % of all samples of this size the true median is between them.

    They are the k-th smallest and the k-th largest. Each value lies above or below the true median as a fair coin
    falls. So the median is outside with twice the probability that fewer than k of n coins show heads, and k is the
    largest for which this is at most 5 %. There must be six values or more.

    >>> median_interval(np.arange(10.0))
    (1.0, 8.0)
    """
    n = len(values)
    outside = 2 * np.cumsum([comb(n, i) for i in range(n)]) / 2.0**n
    cut = int(np.count_nonzero(outside <= 0.05)) - 1
    ordered = np.sort(values)
    return float(ordered[cut]), float(ordered[n - 1 - cut])


def paired(before: np.ndarray, after: np.ndarray) -> tuple[str, ...]:
    """Return as text the median change (cm) of paired errors (m), its 95 % interval, and in how many pairs they fall.

    >>> paired(np.full(6, 0.2), np.array([0.1, 0.1, 0.2, 0.1, 0.1, 0.3]))
    ('-10.0', '-10.0 to +10.0', '4')
    """
    change = 100 * (after - before)
    low, high = median_interval(change)
    if not change.any():
        return "", "the same runs", ""
    return f"{np.median(change):+.1f}", f"{low:+.1f} to {high:+.1f}", f"{np.count_nonzero(change < 0)}"


def is_decided(before: np.ndarray, after: np.ndarray) -> bool:
    """Tell whether the interval of the median change leaves out zero."""
    low, high = median_interval(after - before)
    return low > 0 or high < 0


def cm(metres: np.ndarray) -> str:
    """Return the median of some errors in centimetres."""
    return f"{100 * np.median(metres):.1f}"


def lattice_medians() -> dict[str, float]:
    """Return the median error (m) of the report's filter, scored on the lattice and exactly.

    ``low`` and ``high`` are the ends of the 95 % bootstrap interval (chapter 07) of exact less lattice.
    """
    errors, rng = errors_by_label(read_table("ch09_lattice")), np.random.default_rng(0)
    medians = {n: np.median(rng.choice(some, (2000, len(some))), axis=1) for n, some in errors.items()}
    low, high = np.quantile(medians["exact"] - medians["lattice"], [0.025, 0.975])
    found = {label: float(np.median(some)) for label, some in errors.items()}
    return {**found, "low": float(low), "high": float(high)}


# ---- the ladder


def ladder(study: str = LADDER) -> dict[str, np.ndarray]:
    """Return the error (m) in every building for each rung, in the same order of buildings."""
    return errors_by_label(read_table(study))


def rungs(errors: dict[str, np.ndarray]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return, for each change of a ladder, the errors (m) before and after it."""
    return {name: (errors[before], errors[name]) for before, name in pairwise(errors) if name.startswith("+")}


def changes_table() -> Shown:
    """Return each change of the ladder: what it sets, and what the literature calls it."""
    rows = [(name, what, KNOWN_AS.get(name, "")) for name, what in changed_fields(LADDER).items()]
    return Shown(("change", "in the configuration", "known as"), rows, left=(1, 2))


def ladder_table() -> Shown:
    """Return the table of the ladder: the error after each change, and how it differs from the row before."""
    errors = ladder()
    rows: list[tuple[str, ...]] = [
        (name, cm(errors[name]), "", "", "") for name in ("dead reckoning", "report")
    ]
    rows += [(name, cm(after), *paired(before, after)) for name, (before, after) in rungs(errors).items()]
    head = ("change", "error [cm]", "change [cm]", "95 % interval", f"better [of {len(errors['report'])}]")
    return Shown(head, rows)


def changed_fields(study: str) -> dict[str, str]:
    """Return, as text, the settings in which each variant of a study differs from the one before it."""
    first: dict[str, dict[str, Any]] = {}
    for case in read_study(study_file(study)).cases:
        first.setdefault(case.label, dict(case.settings))
    found = {}
    for before, label in pairwise(first):
        new = {k: v for k, v in first[label].items() if first[before].get(k) != v}
        if label.startswith("+"):
            found[label] = ", ".join(f"{key.split('.')[-1]} {_value(value)}" for key, value in new.items())
    return found


def _value(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return " to ".join(map(_value, value))
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:.3g}"
    return str(value)


# ---- what the finished filter would miss


def elimination() -> dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """Return, for each change of the finished filter, its errors (m) before and after by group of drives."""
    table = read_table("ch09_elimination")
    group = np.array([drive.partition(" ")[0] for drive in table["drive"]])
    found: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]] = {}
    for label in labels_of(table)[1:]:
        for name in dict.fromkeys(group.tolist()):
            before, after = (
                table["error_m"][(group == name) & (table["label"] == one)] for one in ("nothing", label)
            )
            found.setdefault(label, {})[name] = before, after
    return found


def missed_by(pairs: dict[str, tuple[np.ndarray, np.ndarray]]) -> str:
    """Name the groups of six drives or more in which a change is decided, with the median change (cm)."""
    words = []
    for group, (before, after) in pairs.items():
        if len(before) >= 6 and is_decided(before, after):
            worse = np.count_nonzero(after > before)
            words.append(f"{group} {100 * np.median(after - before):+.2f} ({worse} of {len(before)})")
    return "; ".join(words)


def lost(change: str, *groups: str) -> int:
    """Count the runs with a change that are off by more than ``OFF`` at some time, in the named groups or in all."""
    run = select(read_table("ch09_elimination"), label=change)
    group = np.array([drive.partition(" ")[0] for drive in run["drive"]])
    return int(np.count_nonzero((run["max_m"] > OFF) & (np.isin(group, groups) | (not groups))))


def elimination_table() -> Shown:
    """Return for each change which drives it makes worse, how many runs it loses, and how many of these say nothing."""
    table, changes = read_table("ch09_elimination"), elimination()
    rows: list[tuple[str, ...]] = []
    for label in labels_of(table):
        run = select(table, label=label)
        silent = np.count_nonzero((run["off"] > 0.0) & (run["silent"] == run["off"]))
        counts = lost(label), lost(label, "Intel"), silent
        rows.append((label, missed_by(changes.get(label, {})), *map(str, counts)))
    head = (
        "change",
        "error, median change [cm] (worse)",
        f"lost [of {len(select(table, label='nothing')['label'])}]",
        "Intel [of 10]",
        "unnoticed",
    )
    return Shown(head, rows, left=(1,))


# ---- kinds, and where the world moves


def on_floors(place: str, percent: int, column: str = "return_m") -> dict[str, np.ndarray]:
    """Return how far off (m) each method is in six buildings of a place, where floors are so many percent off."""
    return errors_by_label(select(read_table("ch09_private"), place=place, percent=percent), column)


def nearer(method: str, place: str, percent: int, column: str = "return_m") -> int:
    """Count in how many of six buildings a method is nearer the truth than the shared map, on floors of one kind."""
    errors = on_floors(place, percent, column)
    return int((errors[method] < errors["shared map, 30"]).sum())


def parted() -> SimpleNamespace:
    """Return one stored drive along a corridor: every hypothesis of private maps, a shared map's path, and the scans.

    The arrays are those of ``measure.ch09.parted``; ``points`` has one array ``(M, 2)`` for each scan.
    """
    with np.load(PARTED, allow_pickle=False) as file:
        of = dict(file)
    points = np.split(of.pop("points"), np.cumsum(of.pop("counts"))[:-1])
    return SimpleNamespace(**of, points=points)


def kinds(study: str, alignment: bool) -> dict[str, np.ndarray]:
    """Return the errors (m) of scan matching, of a shared map, and of a map for each particle."""
    suffix = "" if alignment else ", and no alignment"
    names = ("scan matching", "shared map", "a map for each particle")
    return {name: errors_by_label(read_table(study))[name + suffix] for name in names}


def situation(name: str, particles: int, alignment: bool) -> np.ndarray:
    """Return the errors (m) in every building of a situation for a number of particles; 0 means scan matching."""
    label = {"label": name} if particles else {"label": f"{name}, scan matching"}
    table = select(read_table("ch09_hard_particles"), particles=float(max(particles, 1)), **label)
    aligned = np.array([str(value) not in ("0.0", "false", "False") for value in table["lines"]])
    return table[ERROR][aligned == alignment]


def hard_comparisons() -> dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]:
    """Return every comparison made among hazards: (hazards, change) -> errors (m) before and after."""
    found = {("everything", name): pair for name, pair in rungs(ladder(HARD_LADDER)).items()}
    _, shared, private = kinds("ch09_hard_kinds", False).values()
    found["everything", "a map for each particle, no alignment"] = shared, private
    for where in ("the world moves", "wheels slip", "people walk"):
        for alignment in (False, True):
            pair = situation(where, 1, alignment), situation(where, 50, alignment)
            name = "1 to 50 particles" + ("" if alignment else ", no alignment")
            found[where.replace("the world moves", "everything"), name] = pair
    return found


def hard_table() -> Shown:
    """Return the table of comparisons among hazards; of the ladder's changes only those that are decided."""
    rows = []
    for (where, name), (before, after) in hard_comparisons().items():
        if not name.startswith("+") or is_decided(before, after):
            rows.append((where, name, cm(before), cm(after), *paired(before, after)))
    head = (
        "hazards",
        "change",
        "before [cm]",
        "after [cm]",
        "change [cm]",
        "95 % interval",
        "better [of 10]",
    )
    return Shown(head, rows, left=(1,))
