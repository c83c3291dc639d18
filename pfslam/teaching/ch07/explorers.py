"""Chapter 07, the widgets: how sure so many seeds make us, and every sweep under every metric."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.teaching.ch07.statistics import bootstrap_interval, experiment, wrong_winner
from pfslam.teaching.ch07.sweeps import METRICS, SWEEPS, describe, sweep_frame, sweep_series
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.widgets import Explorer, Slider

SEEDS = (1, 2, 3, 5, 8, 12, 20)
Pair = dict[str, np.ndarray]
"""Two settings, name -> error of each run, the one with the smaller median first."""


def in_order(settings: Pair) -> Pair:
    """The same two settings, the better one first."""
    return dict(sorted(settings.items(), key=lambda item: float(np.median(item[1]))))


def drawn(settings: Pair, seeds: int) -> Pair:
    """One experiment with so many seeds of each setting: always the same one for the same number."""
    rng = np.random.default_rng(seeds)
    return {name: experiment(runs, seeds, rng) for name, runs in settings.items()}


def how_often_wrong(settings: Pair, seeds: int) -> float:
    """How often so many seeds of each crown the wrong setting."""
    better, worse = in_order(settings).values()
    return wrong_winner(better, worse, seeds, np.random.default_rng(0))


def seeds_frame(pairs: dict[str, Pair]) -> Callable[..., Figure]:
    """The drawing function: one experiment above, how often such experiments are wrong below."""

    @cache
    def mistakes(pair: str) -> list[float]:
        return [100 * how_often_wrong(pairs[pair], n) for n in SEEDS]

    def draw(pair: str, seeds: int) -> Figure:
        settings = in_order(pairs[pair])
        figure, (above, below) = new_figure(6.2, 4.6, rows=2, height_ratios=[1, 1])
        _draw_experiment(above, settings, drawn(settings, seeds))
        _draw_mistakes(below, mistakes(pair), seeds)
        return figure

    return draw


def _draw_experiment(axes: Axes, settings: Pair, some: Pair) -> None:
    for row, (name, runs) in enumerate(settings.items()):
        all_rows = -row + np.linspace(-0.25, 0.25, len(runs))
        axes.scatter(runs, all_rows, s=18, color=COLOURS["unknown"], linewidths=0)
        axes.scatter(some[name], np.full(len(some[name]), -row), s=44, color=COLOURS["particles"], zorder=3)
        middle = np.median(some[name])
        axes.plot(
            [middle] * 2, [-row - 0.35, -row + 0.35], color=COLOURS["estimate"], linewidth=2.4, zorder=5
        )
        if len(some[name]) > 1:
            ends = bootstrap_interval(some[name], np.random.default_rng(0))
            axes.plot(ends, [-row, -row], color=COLOURS["estimate"], linewidth=5, alpha=0.6, zorder=4)
    axes.set_yticks(-np.arange(len(settings)), list(settings))
    axes.set(xlabel="position error (RMS) [m]", ylim=(-1.6, 0.6))
    axes.set_xlim(left=0)


def _draw_mistakes(axes: Axes, shares: list[float], seeds: int) -> None:
    axes.plot(SEEDS, shares, color=COLOURS["hits"], marker="o", markersize=4)
    axes.axvline(seeds, color=COLOURS["truth"], linestyle=":")
    axes.set(xlabel="seeds for each setting", ylabel="wrong winner [%]", ylim=(0, 60), xscale="log")
    axes.set_xticks(SEEDS, [str(n) for n in SEEDS])
    axes.minorticks_off()


def seeds_alt(pairs: dict[str, Pair]) -> Callable[..., str]:
    """The words for a frame of the seeds explorer."""

    def alt(pair: str, seeds: int) -> str:
        settings = in_order(pairs[pair])
        words = []
        for name, runs in drawn(settings, seeds).items():
            low, high = bootstrap_interval(runs, np.random.default_rng(0))
            interval = f", interval {low:.2f} to {high:.2f}" if seeds > 1 else ", no interval from one run"
            words.append(f"{name}: median {np.median(runs):.2f} m{interval}")
        share = how_often_wrong(settings, seeds)
        count = f"{seeds} seeds" if seeds > 1 else "1 seed"
        return f"{count} of each. {'; '.join(words)}. Such experiments crown the wrong one in {share:.0%}."

    return alt


def seeds_explorer(pairs: dict[str, Pair]) -> Explorer:
    """Choose two settings and a number of seeds: what one experiment says, and how often it is wrong."""
    sliders = [
        Slider("pair", list(pairs), 0, "Compare"),
        Slider("seeds", SEEDS, 0, "Seeds"),
    ]
    return Explorer(
        seeds_frame(pairs),
        sliders,
        alt=seeds_alt(pairs),
        title="How many seeds are enough?",
        play="seeds",
        pause=900,
    )


def sweep_alt(parameter: str, metric: str) -> str:
    """The words for a frame of the sweep explorer."""
    sweep, what = SWEEPS[parameter], METRICS[metric]
    series = sweep_series(sweep, what.column)
    words = "; ".join(f"{name}: {describe(some, what)}" for name, some in series.items())
    return f"{what.title} against {parameter}, median and range over the seeds. {words}."


def sweep_explorer() -> Explorer:
    """Choose a parameter and a metric: one dot per run, from the stored tables."""
    sliders = [
        Slider("parameter", list(SWEEPS), 0, "Parameter"),
        Slider("metric", list(METRICS), 0, "Metric"),
    ]
    return Explorer(sweep_frame, sliders, alt=sweep_alt, title="Every run of the report's filter")
