"""Chapter 07: the stored runs, by setting, by seed and by building, and what a change of a setting did."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from pfslam.study.table import Table
from pfslam_book.ch07.statistics import (
    Difference,
    difference_interval,
    middle_part,
    paired_interval,
    resampled,
)
from pfslam_book.show.tables import Shown, read_table, select

Groups = dict[float, np.ndarray]
"""Value of a parameter -> one result per seed, in the order of the seeds."""


@dataclass(frozen=True)
class Sweep:
    """One parameter in a stored table: which variant's rows, which column, and how a picture names it."""

    table: str
    label: str
    column: str
    title: str
    ramp: str | None = None
    """The variant that repeats it on ``ramp``, if there is one."""


@dataclass(frozen=True)
class Metric:
    """A column of results: how a picture names it, its unit, and how its numbers are printed."""

    column: str
    title: str
    unit: str
    form: str = ".2f"


SWEEPS = {
    "particles": Sweep("ch07_particles", "report", "particles", "number of particles $N_p$", "report, ramp"),
    "yaw noise": Sweep(
        "ch07_noise", "report", "noise.sigma_omega", r"$\sigma_\omega$ [rad/s]", "report, ramp"
    ),
    "threshold": Sweep(
        "ch07_threshold", "count, 0.14 rad/s", "resample_below", "$N_{th} / N_p$ (yaw noise 0.14 rad/s)"
    ),
    "threshold, more noise": Sweep(
        "ch07_threshold", "count, 0.5 rad/s", "resample_below", "$N_{th} / N_p$ (yaw noise 0.5 rad/s)"
    ),
    "scans used": Sweep("ch07_every", "report", "every", "every k-th scan, k"),
}
METRICS = {
    "position error": Metric("ate_rmse_m", "position error (RMS)", "m", ".3f"),
    "largest error": Metric("ate_max_m", "largest position error", "m"),
    "heading error": Metric("heading_rmse_deg", "heading error (RMS)", "deg"),
    "N_eff": Metric("n_eff_median", "median $N_{eff} / N_p$", ""),
}


@cache
def stored(table: str) -> Table:
    """Read a stored table, once."""
    return read_table(table)


def groups(table: str, label: str, column: str, metric: str = "ate_rmse_m") -> Groups:
    """Group the results of a variant's runs by the values of one column, each sorted by seed, values ascending."""
    rows = select(stored(table), label=label)
    order = np.argsort(rows["seed"], kind="stable")
    values, results = rows[column][order], rows[metric][order]
    return {float(value): results[values == value] for value in np.unique(values)}


def sweep_series(sweep: Sweep, column: str) -> dict[str, Groups]:
    """Give the groups of a sweep by drive, only those that were run."""
    series = {"hall": groups(sweep.table, sweep.label, sweep.column, column)}
    if sweep.ramp is not None:
        series["ramp"] = groups(sweep.table, sweep.ramp, sweep.column, column)
    return series


# ---- one setting changed


@dataclass(frozen=True, eq=False)
class Change:
    """A setting changed: the results of all runs before and after, each in the order of the seeds."""

    before: np.ndarray
    after: np.ndarray

    def difference(self, statistic: Callable = np.median) -> Difference:
        """Give the difference of the medians (or another statistic), from two independent resamples."""
        return difference_interval(self.before, self.after, np.random.default_rng(0), statistic)

    @property
    def same_runs(self) -> int:
        """How many seeds give the same result to the last bit, before and after."""
        return int(np.sum(self.before == self.after)) if len(self.before) == len(self.after) else 0

    def sentence(self, unit: str = "m", statistic: Callable = np.median) -> str:
        """Put difference, interval and verdict into a line."""
        value, low, high = found = self.difference(statistic)
        if np.isnan(low):
            return f"{value:+.3f} {unit} from {len(self.before)} and {len(self.after)} runs: {found.verdict}"
        return f"{value + 0.0:+.3f} {unit} ({low:+.3f} to {high:+.3f}): {found.verdict}"


def threshold_change(label: str, low: float, high: float, metric: str = "ate_rmse_m") -> Change:
    """Give what raising N_th from one share of N_p to another does, for one variant of the threshold study."""
    some = groups("ch07_threshold", label, "resample_below", metric)
    return Change(some[low], some[high])


def threshold_pair(label: str, low: float, high: float) -> dict[str, np.ndarray]:
    """Give the errors of all runs at two thresholds, by their names."""
    change = threshold_change(label, low, high)
    return {f"{low:.1f} N": change.before, f"{high:.1f} N": change.after}


def filter_pair() -> dict[str, np.ndarray]:
    """Give the errors of all runs of the report's filter and of the refined one, each with 500 particles."""
    return {name: groups("ch07_particles", name, "particles")[500.0] for name in ("report", "refined")}


def interaction(quiet: Change, loud: Change) -> Difference:
    """Give by how much a change does more at the loud setting than at the quiet one, with its interval."""
    rng = np.random.default_rng(0)
    parts = loud.after, loud.before, quiet.after, quiet.before
    signs = 1, -1, -1, 1
    value = sum(sign * np.median(part) for sign, part in zip(signs, parts, strict=True))
    draws = np.sum([sign * resampled(part, rng) for sign, part in zip(signs, parts, strict=True)], axis=0)
    return Difference(float(value), *middle_part(draws))


def in_words(found: Difference, form: str = "+.3f") -> tuple[str, str, str]:
    """Give the cells of a table for a difference: value, interval, verdict."""
    interval = "" if np.isnan(found.low) else f"{found.low:{form}} to {found.high:{form}}"
    return f"{found.value + 0.0:{form}}", interval, found.verdict


def changes_table(changes: dict[str, Change]) -> Shown:
    """List changes: runs, medians before and after, their difference, its interval, and the verdict."""
    rows = []
    for name, change in changes.items():
        medians = [f"{np.median(values):.3f}" for values in (change.before, change.after)]
        rows.append((name, str(len(change.before)), *medians, *in_words(change.difference())))
    return Shown(
        ("change", "runs", "before [m]", "after [m]", "difference [m]", "95 % interval", "verdict"), rows
    )


# ---- over buildings

BASE = "0.14 rad/s"
BUILDING_CHANGES = {
    "0.14 rad/s: 0.1 N to 0.9 N": ((BASE, 0.1), (BASE, 0.9)),
    "0.5 rad/s: 0.1 N to 0.9 N": (("0.5 rad/s", 0.1), ("0.5 rad/s", 0.9)),
    "noise 0.14 to 0.5 rad/s": ((BASE, 0.1), ("0.5 rad/s", 0.1)),
    "100 particles to one": ((BASE, 0.1), ("one particle", None)),
    "0.14 at 0.1 N to 0.5 rad/s at 0.9 N": ((BASE, 0.1), ("0.5 rad/s", 0.9)),
    "every 10th scan to every 20th": ((BASE, 0.1), ("every 20th scan", None)),
    "every 10th scan to every 5th": ((BASE, 0.1), ("every 5th scan", None)),
    "report to refined": ((BASE, 0.1), ("refined", None)),
}
"""By name: the variants, and the thresholds, of the study over buildings that a change goes from and to."""


def by_building(label: str, threshold: float | None, metric: str = "ate_rmse_m") -> np.ndarray:
    """Give one result for each building: the mean over its runs of one variant."""
    rows = select(stored("ch07_buildings"), label=label)
    if threshold is not None:
        rows = select(rows, resample_below=threshold)
    buildings = rows["simulator.seed"]
    return np.array([rows[metric][buildings == one].mean() for one in np.unique(buildings)])


def building_change(name: str, metric: str = "ate_rmse_m") -> Change:
    """Give what a change does in each building; pairs are real here, because buildings differ."""
    return Change(*(by_building(*variant, metric) for variant in BUILDING_CHANGES[name]))


def building_table(metrics: tuple[str, ...] = ("position error", "heading error")) -> Shown:
    """List what each change does over the buildings, paired by building."""
    rows = []
    for name in BUILDING_CHANGES:
        cells = [name]
        for metric in metrics:
            change = building_change(name, METRICS[metric].column)
            found = paired_interval(change.before, change.after, np.random.default_rng(0))
            value, interval, verdict = in_words(found, "+.2f")
            better = int(np.sum(change.after < change.before))
            cells += [f"{value} ({interval})", f"{better}", verdict]
        rows.append(cells)
    heads = ["change"]
    for metric in metrics:
        heads += [f"{metric} [{METRICS[metric].unit}]", f"better [of {len(change.before)}]", "verdict"]
    return Shown(heads, rows)
