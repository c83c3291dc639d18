"""Chapter 07: two settings compared seed by seed, and the pictures of what a change does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.teaching.ch07.statistics import difference_interval, verdict
from pfslam.teaching.ch07.sweeps import groups
from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import COLOURS, new_figure


@dataclass(frozen=True, eq=False)
class Change:
    """A setting changed, everything else and the seeds kept: what it did to one metric, seed by seed."""

    before: np.ndarray
    after: np.ndarray

    @property
    def by_seed(self) -> np.ndarray:
        return self.after - self.before

    def summary(self) -> tuple[float, float, float]:
        """Median change and its 95 % interval."""
        return difference_interval(self.before, self.after, np.random.default_rng(0))

    def sentence(self, unit: str = "m") -> str:
        """Median, interval and verdict, in a line."""
        middle, low, high = self.summary()
        shown = [f"{round(value, 3) + 0.0:+.3f}" for value in (middle, low, high)]  # never -0.000
        return f"{shown[0]} {unit} ({shown[1]} to {shown[2]}): {verdict(low, high)}"


def changes_picture(changes: dict[str, Change], what: str = "change of the position error [m]") -> Picture:
    """One row per change: a dot for each seed, the median and its interval; left of zero is better."""
    figure, axes = new_figure(6.2, 0.9 + 0.42 * len(changes))
    words = []
    for row, (name, change) in enumerate(changes.items()):
        middle, low, high = change.summary()
        y = np.full(len(change.by_seed), -row) + np.linspace(-0.22, 0.22, len(change.by_seed))
        axes.scatter(change.by_seed, y, s=14, color=COLOURS["particles"], linewidths=0, alpha=0.8)
        axes.plot([low, high], [-row, -row], color=COLOURS["estimate"], linewidth=4, solid_capstyle="butt")
        axes.plot([middle, middle], [-row - 0.3, -row + 0.3], color=COLOURS["estimate"], linewidth=2.4)
        words.append(f"{name}: {change.sentence()}")
    axes.axvline(0.0, color=COLOURS["truth"], linestyle=":")
    axes.set_yticks(-np.arange(len(changes)), list(changes))
    axes.set(xlabel=what, ylim=(-len(changes) + 0.4, 0.6))
    axes.locator_params(axis="x", nbins=6)
    return Picture(figure, f"Change of the error, seed by seed; left of zero is better. {'; '.join(words)}.")


def threshold_change(label: str, low: float, high: float, metric: str = "ate_rmse_m") -> Change:
    """What raising N_th from one share of N_p to another does, for one variant of the threshold study."""
    some = groups("ch07_threshold", label, "resample_below", metric)
    return Change(some[low], some[high])


def threshold_pair(label: str, low: float, high: float) -> dict[str, np.ndarray]:
    """Errors of all runs at two thresholds, by their names."""
    change = threshold_change(label, low, high)
    return {f"{low:.1f} N": change.before, f"{high:.1f} N": change.after}


def filter_pair() -> dict[str, np.ndarray]:
    """Errors of all runs of the report's filter and of the refined one, each with 500 particles."""
    return {name: groups("ch07_particles", name, "particles")[500.0] for name in ("report", "refined")}


def students_picture(change: Change, names: tuple[str, str], seeds: int = 6) -> Picture:
    """The first few seeds as so many people who each ran both settings once."""
    figure, axes = new_figure(6.2, 3.4)
    before, after = change.before[:seeds], change.after[:seeds]
    x = np.arange(seeds)
    for k in x:
        colour = COLOURS["free" if after[k] < before[k] else "hits"]
        axes.annotate(
            "",
            xy=(k, after[k]),
            xytext=(k, before[k]),
            arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 2.2, "mutation_scale": 15},
        )
    axes.scatter(x, before, s=50, color=COLOURS["unknown"], zorder=3, label=names[0])
    axes.scatter(x, after, s=50, color=COLOURS["estimate"], zorder=3, label=names[1])
    axes.set_xticks(x, [f"no. {k + 1}" for k in x])
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
