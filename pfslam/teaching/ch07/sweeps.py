"""Chapter 07: the stored sweeps, read for drawing, and the pictures of many runs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.teaching.ch07.statistics import bootstrap_interval
from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.tables import read_table, select

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
def stored(table: str) -> dict[str, np.ndarray]:
    """The stored table, read once."""
    return read_table(table)


def groups(table: str, label: str, column: str, metric: str = "ate_rmse_m") -> Groups:
    """Results of a variant's runs by the value of one column, each sorted by seed, values ascending."""
    rows = select(stored(table), label=label)
    order = np.argsort(rows["seed"], kind="stable")
    values, results = rows[column][order], rows[metric][order]
    return {float(value): results[values == value] for value in np.unique(values)}


def sweep_groups(sweep: Sweep, metric: str, dataset: str = "hall") -> Groups:
    """The same for a sweep, on one of the two drives; nothing if it was not run there."""
    label = sweep.label if dataset == "hall" else sweep.ramp
    return {} if label is None else groups(sweep.table, label, sweep.column, metric)


# ---- strips: one dot per run


def draw_strips(axes: Axes, series: dict[str, Groups], form: str = ".3g") -> None:
    """One column of dots per value and series, with the median and its 95 % interval."""
    values = sorted({value for some in series.values() for value in some})
    looks = (("particles", "estimate", "o"), ("hits", "hits", "^"))
    width = 0.8 / len(series)
    for (name, some), (dots, line, marker) in zip(series.items(), looks, strict=False):
        for value, runs in some.items():
            here = [other for other in series if value in series[other]]
            x = values.index(value) + (here.index(name) - (len(here) - 1) / 2) * width
            _draw_strip(axes, x, runs, width, COLOURS[dots], COLOURS[line], marker, name)
    axes.set_xticks(range(len(values)), [format(value, form) for value in values])
    axes.set_xlim(-0.6, len(values) - 0.4)
    axes.grid(axis="x", visible=False)
    if len(series) > 1:
        handles, names = axes.get_legend_handles_labels()
        first = dict(zip(reversed(names), reversed(handles), strict=True))  # one entry for each name
        shown = [first[name] for name in series]
        axes.legend(shown, list(series), loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _draw_strip(axes: Axes, x: float, runs: np.ndarray, width: float, dots, line, marker, name) -> None:
    spread = np.linspace(-0.3, 0.3, len(runs)) * width if len(runs) > 1 else np.zeros(1)
    low, high = bootstrap_interval(runs, np.random.default_rng(0))
    axes.scatter(x + spread, runs, s=22, color=dots, marker=marker, alpha=0.8, linewidths=0, zorder=2)
    axes.plot([x, x], [low, high], color=line, linewidth=4, zorder=3, solid_capstyle="butt", label=name)
    axes.plot(x + np.array([-0.4, 0.4]) * width, [np.median(runs)] * 2, color=line, linewidth=2.4, zorder=4)


def strips_picture(
    series: dict[str, Groups],
    title: str,
    metric: str = "position error",
    *,
    log: bool = False,
    form: str = ".3g",
) -> Picture:
    """Distributions over seeds for each value of one parameter, of one or two filters or drives."""
    what = METRICS[metric]
    figure, axes = new_figure(6.2, 3.8)
    draw_strips(axes, series, form)
    if log:
        axes.set_yscale("log")
        axes.set_yticks([0.01, 0.1, 1.0], ["1 cm", "10 cm", "1 m"])
        axes.set_ylim(0.003, 2.5)
    else:
        axes.set_ylim(bottom=0)
    axes.set(xlabel=title, ylabel=f"{what.title} [{what.unit}]" if what.unit else what.title)
    words = "; ".join(f"{name}: {describe(some, what, form)}" for name, some in series.items())
    return Picture(figure, f"One dot per run, with the median and its 95 % interval. {words}.")


def describe(some: Groups, what: Metric, form: str = ".3g") -> str:
    """Median and range of every group, in words."""
    return ", ".join(
        f"{format(value, form)}: {np.median(runs):{what.form}} {what.unit}".strip()
        + f" ({runs.min():{what.form}} to {runs.max():{what.form}})"
        for value, runs in some.items()
    )


# ---- the frames of the sweep explorer


def sweep_frame(parameter: str, metric: str) -> Figure:
    """The frame of the sweep explorer: one parameter, one metric, both drives where both were run."""
    sweep, what = SWEEPS[parameter], METRICS[metric]
    figure, axes = new_figure(6.2, 3.8)
    draw_strips(axes, sweep_series(sweep, what.column), ".3g")
    axes.set_ylim(bottom=0)
    axes.set(xlabel=sweep.title, ylabel=f"{what.title} [{what.unit}]" if what.unit else what.title)
    return figure


def sweep_series(sweep: Sweep, column: str) -> dict[str, Groups]:
    """The groups of a sweep by drive, only those that were run."""
    series = {dataset: sweep_groups(sweep, column, dataset) for dataset in ("hall", "ramp")}
    return {dataset: some for dataset, some in series.items() if some}
