"""Chapter 07: pictures of many runs, and the two that a reader can change."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam_book.ch07.runs import METRICS, SWEEPS, Change, Groups, Metric, sweep_series
from pfslam_book.ch07.statistics import FEWEST, bootstrap_interval, experiment, wrong_winner
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.widgets import Explorer, Slider

SEEDS = (1, 2, 3, 4, 5, 7, 9, 12, 15, 20)
Pair = dict[str, np.ndarray]
"""Two settings, name -> error of each run, the one with the smaller median first."""
LOOKS = {
    "report": (COLOURS["report"], "o"),
    "refined": (COLOURS["refined"], "^"),
    "hall": (COLOURS["report"], "o"),
    "ramp": ("#b08968", "s"),
}
"""Colour and marker of a series; the two drives are both runs of the report's filter."""


def students_picture(change: Change, names: tuple[str, str], seeds: int = 6) -> Picture:
    """Draw the first few seeds as so many people who each ran both settings once."""
    figure, axes = new_figure(5.4, 3.4)
    before, after = change.before[:seeds], change.after[:seeds]
    x = np.arange(seeds)
    for k in x:
        look = {"arrowstyle": "-|>", "color": COLOURS["truth"], "linewidth": 1.6, "mutation_scale": 14}
        axes.annotate("", xy=(k, after[k]), xytext=(k, before[k]), arrowprops=look)
    axes.scatter(
        x, before, s=60, color=COLOURS["unknown"], edgecolors=COLOURS["truth"], zorder=3, label=names[0]
    )
    axes.scatter(x, after, s=60, color=COLOURS["report"], zorder=3, label=names[1])
    axes.set_xticks(x, [f"{k + 1}" for k in x])
    axes.set(xlabel="student", ylabel="position error (RMS) [m]", xlim=(-0.5, seeds - 0.5))
    axes.set_ylim(0, 1.35 * max(before.max(), after.max()))
    axes.legend(loc="upper right", ncols=2)
    words = "; ".join(f"no. {k + 1}: {before[k]:.2f} to {after[k]:.2f} m" for k in x)
    better = int(np.sum(after < before))
    return Picture(
        figure,
        f"Error of one run with {names[0]} and of one with {names[1]}, for {seeds} students. {words}. "
        f"{better} of {seeds} see an improvement.",
    )


# ---- strips: one dot per run


def draw_strips(axes: Axes, series: dict[str, Groups], form: str = ".3g") -> None:
    """Draw one column of dots per value and series, with the median, and its interval where the runs allow one."""
    values = sorted({value for some in series.values() for value in some})
    width = 0.8 / len(series)
    for name, some in series.items():
        for value, runs in some.items():
            here = [other for other in series if value in series[other]]
            x = values.index(value) + (here.index(name) - (len(here) - 1) / 2) * width
            _draw_strip(axes, x, runs, width, *LOOKS[name], name)
    axes.set_xticks(range(len(values)), [format(value, form) for value in values])
    axes.set_xlim(-0.6, len(values) - 0.4)
    axes.grid(axis="x", visible=False)
    if len(series) > 1:
        handles, names = axes.get_legend_handles_labels()
        first = dict(zip(reversed(names), reversed(handles), strict=True))  # one entry for each name
        shown = [first[name] for name in series]
        axes.legend(shown, list(series), loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def _draw_strip(axes: Axes, x: float, runs: np.ndarray, width: float, colour, marker, name) -> None:
    spread = np.linspace(-0.3, 0.3, len(runs)) * width if len(runs) > 1 else np.zeros(1)
    axes.scatter(
        x + spread, runs, s=22, color=colour, marker=marker, alpha=0.55, linewidths=0, zorder=2, label=name
    )
    axes.plot(x + np.array([-0.4, 0.4]) * width, [np.median(runs)] * 2, color=colour, linewidth=2.4, zorder=4)
    if len(runs) >= FEWEST:
        ends = bootstrap_interval(runs, np.random.default_rng(0))
        axes.plot([x, x], ends, color=colour, linewidth=4, zorder=3, solid_capstyle="butt")


def strips_picture(
    series: dict[str, Groups],
    title: str,
    metric: str = "position error",
    *,
    log: bool = False,
    form: str = ".3g",
) -> Picture:
    """Draw the runs for each value of one parameter, of one or two filters or drives."""
    what = METRICS[metric]
    figure, axes = new_figure(5.4, 3.8)
    draw_strips(axes, series, form)
    if log:
        axes.set_yscale("log")
        axes.set_yticks([0.01, 0.1, 1.0], ["1 cm", "10 cm", "1 m"])
        axes.set_ylim(0.003, 2.5)
    else:
        axes.set_ylim(bottom=0)
    axes.set(xlabel=title, ylabel=f"{what.title} [{what.unit}]" if what.unit else what.title)
    words = "; ".join(f"{name}: {describe(some, what, form)}" for name, some in series.items())
    return Picture(figure, f"One dot per run, and the median; {_bars(series)} {words}.")


def _bars(series: dict[str, Groups]) -> str:
    """Say where a strip has an interval."""
    enough = {len(runs) >= FEWEST for some in series.values() for runs in some.values()}
    if enough == {True}:
        return "a bar is its 95 % interval."
    return (
        f"a bar is its 95 % interval, where there are {FEWEST} runs or more."
        if True in enough
        else "no intervals."
    )


def describe(some: Groups, what: Metric, form: str = ".3g") -> str:
    """Put median and range of every group into words."""
    return ", ".join(
        f"{format(value, form)}: {np.median(runs):{what.form}} {what.unit}".strip()
        + f" ({runs.min():{what.form}} to {runs.max():{what.form}})"
        for value, runs in some.items()
    )


def changes_picture(changes: dict[str, Change]) -> Picture:
    """Draw one row per change: the difference of the medians and its interval; left of zero is better."""
    figure, axes = new_figure(5.4, 1.0 + 0.42 * len(changes))
    words = []
    for row, (name, change) in enumerate(changes.items()):
        value, low, high = change.difference()
        axes.plot([low, high], [-row, -row], color=COLOURS["report"], linewidth=4, solid_capstyle="butt")
        axes.plot(value, -row, "o", color=COLOURS["report"], markersize=9)
        words.append(f"{name}: {change.sentence()}")
    axes.axvline(0.0, color=COLOURS["truth"], linestyle=":")
    axes.set_yticks(-np.arange(len(changes)), list(changes))
    axes.set(xlabel="difference of the medians [m]", ylim=(-len(changes) + 0.4, 0.6))
    axes.locator_params(axis="x", nbins=5)
    return Picture(
        figure,
        f"Difference of the median errors with its 95 % interval; left of zero is better. {'; '.join(words)}.",
    )


# ---- how many seeds


def in_order(settings: Pair) -> Pair:
    """Give the same two settings, the better one first."""
    return dict(sorted(settings.items(), key=lambda item: float(np.median(item[1]))))


def drawn(settings: Pair, seeds: int) -> Pair:
    """Draw one experiment with so many seeds of each setting: always the same one for the same number."""
    rng = np.random.default_rng(seeds)
    return {name: experiment(runs, seeds, rng) for name, runs in settings.items()}


def how_often_wrong(settings: Pair, seeds: int, statistic: Callable = np.median) -> float:
    """Give how often so many seeds of each crown the wrong setting."""
    better, worse = in_order(settings).values()
    return wrong_winner(better, worse, seeds, np.random.default_rng(0), statistic)


def seeds_frame(pairs: dict[str, Pair]) -> Callable[..., Figure]:
    """Give the drawing function: one experiment above, how often such experiments are wrong below."""

    @cache
    def mistakes(pair: str, statistic: Callable) -> list[float]:
        return [100 * how_often_wrong(pairs[pair], n, statistic) for n in SEEDS]

    def draw(pair: str, seeds: int) -> Figure:
        settings = in_order(pairs[pair])
        figure, (above, below) = new_figure(5.1, 5.0, rows=2, height_ratios=[1, 1.2])
        _draw_experiment(above, settings, drawn(settings, seeds))
        _draw_mistakes(below, mistakes(pair, np.median), mistakes(pair, np.mean), seeds)
        return figure

    return draw


def _draw_experiment(axes: Axes, settings: Pair, some: Pair) -> None:
    for row, (name, runs) in enumerate(settings.items()):
        all_rows = -row + np.linspace(-0.25, 0.25, len(runs))
        axes.scatter(runs, all_rows, s=18, color=COLOURS["unknown"], linewidths=0)
        axes.scatter(some[name], np.full(len(some[name]), -row), s=44, color=COLOURS["highlight"], zorder=3)
        axes.plot([np.median(some[name])] * 2, [-row - 0.35, -row + 0.35], color=COLOURS["truth"], zorder=5)
        if len(some[name]) >= FEWEST:
            ends = bootstrap_interval(some[name], np.random.default_rng(0))
            axes.plot(ends, [-row, -row], color=COLOURS["truth"], linewidth=4, alpha=0.6, zorder=4)
    axes.set_yticks(-np.arange(len(settings)), list(settings))
    axes.set(xlabel="position error (RMS) [m]", ylim=(-1.6, 0.6), xlim=(0, 0.68))


def _draw_mistakes(axes: Axes, by_median: list[float], by_mean: list[float], seeds: int) -> None:
    axes.plot(SEEDS, by_median, color=COLOURS["truth"], marker="o", markersize=5, label="comparing medians")
    axes.plot(
        SEEDS,
        by_mean,
        color=COLOURS["truth"],
        linestyle="--",
        marker="s",
        markersize=4,
        label="comparing means",
    )
    axes.axvline(seeds, color=COLOURS["highlight"], linewidth=3, alpha=0.6)
    axes.set(xlabel="seeds for each setting", ylabel="wrong winner [%]", ylim=(0, 60), xlim=(0.4, 20.6))
    axes.set_xticks([1, 2, 3, 5, 9, 12, 15, 20])
    axes.legend(loc="upper right")


def seeds_alt(pairs: dict[str, Pair]) -> Callable[..., str]:
    """Give the words for a frame of the seeds explorer."""

    def alt(pair: str, seeds: int) -> str:
        settings = in_order(pairs[pair])
        words = []
        for name, runs in drawn(settings, seeds).items():
            low, high = bootstrap_interval(runs, np.random.default_rng(0))
            interval = (
                f", interval {low:.2f} to {high:.2f}" if seeds >= FEWEST else ", too few for an interval"
            )
            words.append(f"{name}: median {np.median(runs):.2f} m{interval}")
        medians, means = (how_often_wrong(settings, seeds, statistic) for statistic in (np.median, np.mean))
        count = f"{seeds} seeds" if seeds > 1 else "1 seed"
        return (
            f"{count} of each. {'; '.join(words)}. Such experiments crown the wrong one in {medians:.0%} by their "
            f"medians, in {means:.0%} by their means."
        )

    return alt


def seeds_explorer(pairs: dict[str, Pair]) -> Explorer:
    """Choose two settings and a number of seeds: what one experiment says, and how often it is wrong."""
    controls = [Slider("pair", list(pairs), 0, "Compare"), Slider("seeds", SEEDS, 0, "Seeds")]
    return Explorer(
        seeds_frame(pairs),
        controls,
        alt=seeds_alt(pairs),
        title="How many seeds are enough?",
        play="seeds",
        pause=900,
    )


# ---- every sweep under every metric


def sweep_frame(parameter: str, metric: str) -> Figure:
    """Draw one parameter and one metric, on both drives where both were run."""
    sweep, what = SWEEPS[parameter], METRICS[metric]
    figure, axes = new_figure(5.1, 3.8)
    draw_strips(axes, sweep_series(sweep, what.column), ".3g")
    axes.set_ylim(bottom=0)
    axes.set(xlabel=sweep.title, ylabel=f"{what.title} [{what.unit}]" if what.unit else what.title)
    return figure


def sweep_alt(parameter: str, metric: str) -> str:
    """Put a frame of the sweep explorer into words."""
    sweep, what = SWEEPS[parameter], METRICS[metric]
    series = sweep_series(sweep, what.column)
    words = "; ".join(f"{name}: {describe(some, what)}" for name, some in series.items())
    return f"{what.title} against {parameter}, median and range over the seeds. {words}."


def sweep_explorer() -> Explorer:
    """Choose a parameter and a metric: one dot per run, from the stored tables."""
    controls = [
        Slider("parameter", list(SWEEPS), 0, "Parameter"),
        Slider("metric", list(METRICS), 0, "Metric"),
    ]
    return Explorer(sweep_frame, controls, alt=sweep_alt, title="Every run of the report's filter")
