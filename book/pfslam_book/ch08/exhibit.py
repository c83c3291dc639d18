"""Chapter 08: what all its pictures share: an exhibit is one fault with its symptom, its diagnosis and its number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.grid import OccupancyGrid
from pfslam_book.ch08.data import Turn
from pfslam_book.show.figures import draw_map
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.tables import Shown
from pfslam_book.show.widgets import Explorer, Slider

STATES = ("healthy", "broken")
COLOUR = {"healthy": COLOURS["estimate"], "broken": COLOURS["odometry"]}
OFFSETS = (-0.2, -0.1, -0.05, 0.0, 0.05, 0.1, 0.2)


@dataclass(frozen=True, eq=False)
class Exhibit:
    """One fault: two panels for each state, "healthy" or "broken", and the number that tells the states apart.

    ``what`` says what was done wrong; ``number`` what is measured, and ``unit`` in what; ``reading`` holds the values.
    ``symptom`` and ``diagnosis`` draw a panel and say in words what it shows.
    """

    name: str
    what: str
    number: str
    unit: str
    reading: dict[str, float]
    symptom: Callable[[Axes, str], str]
    diagnosis: Callable[[Axes, str], str]

    @property
    def healthy(self) -> float:
        """Return the number without the fault."""
        return self.reading["healthy"]

    @property
    def broken(self) -> float:
        """Return the number with the fault."""
        return self.reading["broken"]

    def value(self, state: str) -> str:
        """Return the number in words, rounded to what matters; a count has no decimals."""
        return f"{self.number} {round(self.reading[state], 2) + 0.0:g} {self.unit}".strip()


def exhibit_frame(exhibit: Exhibit, state: str) -> tuple[Figure, str]:
    """Draw the symptom on the left and the diagnosis on the right, and gather what both say for the alt text."""
    figure, axes = new_figure(6.2, 3.5, columns=2)
    left, right = exhibit.symptom(axes[0], state), exhibit.diagnosis(axes[1], state)
    for ax, title in zip(axes, ("symptom", "diagnosis"), strict=True):
        ax.set_title(title, fontsize=12)
    value = exhibit.value(state).replace("N_eff / N", "$N_{eff}/N$")
    figure.suptitle(f"{exhibit.name}, {state}: {value}", fontsize=12, color=COLOUR[state])
    done = exhibit.what if state == "broken" else "all is right"
    alt = f"{exhibit.name}, {state} ({done}). Symptom: {left}. Diagnosis: {right}. {exhibit.value(state)}."
    return figure, alt


def by_name(*exhibits: Exhibit) -> dict[str, Exhibit]:
    """Return exhibits under their names."""
    return {exhibit.name: exhibit for exhibit in exhibits}


def faults_explorer(exhibits: dict[str, Exhibit], title: str) -> Explorer:
    """The widget of a family of faults lets the reader choose the fault, and healthy or broken."""
    words: dict[tuple[str, str], str] = {}  # of what has been drawn: not drawn again for its words

    def draw(fault: str, state: str) -> Figure:
        figure, words[fault, state] = exhibit_frame(exhibits[fault], state)
        return figure

    def alt(fault: str, state: str) -> str:
        if (fault, state) not in words:
            draw(fault, state)
        return words[fault, state]

    controls = [
        Slider("fault", list(exhibits), label="Fault"),
        Slider("state", STATES, start=1, label="State"),
    ]
    return Explorer(draw, controls, alt=alt, title=title)


def readings_table(exhibits: dict[str, Exhibit]) -> Shown:
    """One row per fault shows the number that gives it away, healthy and broken."""
    rows = []
    for name, exhibit in exhibits.items():
        values = [round(exhibit.reading[state], 2) + 0.0 for state in STATES]
        counted = max(values) > 1 and all(value == round(value) for value in values)
        good, bad = (f"{value:.{0 if counted else 2}f}" for value in values)
        unit = f" [{exhibit.unit}]" if exhibit.unit else ""
        rows.append((f"{name}: {exhibit.number}{unit}", good, bad))
    return Shown(("fault and its number", *STATES), rows)


def small_map(axes: Axes, grid: OccupancyGrid) -> None:
    """Draw a map in a small panel, with few ticks."""
    draw_map(axes, grid)
    axes.locator_params(nbins=4)


def few_ticks(axes: Axes, **labels) -> None:
    """Set the axes' labels, and few ticks so that a phone can show them."""
    axes.set(**labels)
    axes.locator_params(nbins=4)


# ---- the clock


def clock_explorer(turn: Turn) -> Explorer:
    """Show scans laid out along odometry with a shifted clock: how blurred, and in which scans."""
    curve = {s: turn.cells(s) for s in np.round(np.arange(-4, 5) * 0.05, 2)}
    rate = np.abs(turn.yaw_rate())

    @lru_cache(maxsize=1)
    def laid_out(shift: float) -> tuple[np.ndarray, np.ndarray]:
        return turn.places(shift), turn.lonely(shift)

    def draw(shift: float) -> Figure:
        figure, axes = new_figure(6.2, 3.5, columns=2)
        places, stray = laid_out(shift)
        axes[0].plot(*places.T, "s", markersize=1.0, markeredgewidth=0, color=COLOURS["truth"])
        axes[0].set_aspect("equal")
        axes[0].grid(False)
        limits = {"xlim": (2, 13), "ylim": (13.5, 24.5)}
        few_ticks(axes[0], xlabel="x [m]", ylabel="y [m]", title=f"{len(places)} cells", **limits)
        axes[1].scatter(rate, 100 * stray, s=14, color=COLOURS["hits"])
        few_ticks(axes[1], xlabel="yaw rate [rad/s]", ylabel="stray points [%]", ylim=(0, 100))
        return figure

    def alt(shift: float) -> str:
        places, stray = laid_out(shift)
        least = min(curve, key=lambda s: curve[s])
        return f"""Scan stamps moved by {shift:.2f} s: the walls need {len(places)} cells. Points that hardly
        another scan confirms: {100 * stray[rate > 0.5].mean():.0f} % of a scan while turning faster than 0.5 rad/s,
        {100 * stray[rate < 0.1].mean():.0f} % while driving straight. Fewest cells at {least:.2f} s."""

    live = (-0.25, 0.25, 0.01)
    control = Slider("shift", OFFSETS, start=5, label="Clock offset", unit="s", form=".2f", live=live)
    return Explorer(
        draw, [control], alt=alt, title="A clock that is off blurs only what is seen while turning"
    )
