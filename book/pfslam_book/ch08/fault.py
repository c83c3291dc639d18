"""Chapter 08: what a fault is: a row of the table, with its number and its picture for a healthy and a broken robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.grid import OccupancyGrid
from pfslam.poses import Trajectory
from pfslam_book.show.artists import COLOURS, draw_map, draw_path, sheet
from pfslam_book.show.widgets import Explorer, Slider

Pair = tuple[Any, Any]
STATES = ("healthy", "broken")
COLOUR = {"healthy": COLOURS["estimate"], "broken": COLOURS["odometry"]}


@dataclass(frozen=True, eq=False)
class Panel:
    """What one half of a picture shows, as data. ``curve`` is drawn beside that of the other state.

    ``dots``, ``dark`` (black dots), ``curve`` and ``shade`` (from 0 up) are pairs (x, y); ``slope`` is that of a line
    through the origin, ``level`` the height of a horizontal one.
    """

    x: str = "x [m]"
    y: str = "y [m]"
    grid: OccupancyGrid | None = None
    paths: dict[str, Trajectory] = field(default_factory=dict)
    curve: Pair | None = None
    shade: Pair | None = None
    dots: Pair | None = None
    dark: Pair | None = None
    slope: float | None = None
    level: float | None = None
    limits: dict[str, tuple] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """Return what the panel shows, for the alt text."""
        if self.grid is not None:
            return f"a map with {np.count_nonzero(self.grid.occupied)} wall cells"
        if self.curve is None:
            return f"dots, {self.y} against {self.x}"
        y = np.asarray(self.curve[1])
        return f"a curve, {self.y} against {self.x}: from {y.min():.2f} to {y.max():.2f}, at last {y[-1]:.2f}"

    def draw(self, axes: Axes, state: str, other: Panel) -> None:
        """Draw the panel of one state on axes that fit the other one, too."""
        if self.grid is not None:
            draw_map(axes, self.grid)
        for kind, path in self.paths.items():
            draw_path(axes, path, kind)
        if self.shade is not None:
            axes.fill_between(*self.shade, color=COLOURS["particles"], alpha=0.4, linewidth=0)
        if self.curve is not None and other.curve is not None:
            rest = next(s for s in STATES if s != state)
            axes.plot(*other.curve, color=COLOUR[rest], linewidth=0.9)
            axes.plot(*self.curve, color=COLOUR[state], linewidth=2.4)
        if self.dark is not None:
            axes.plot(*self.dark, ".", markersize=3, color=COLOURS["truth"])
        if self.dots is not None:
            axes.plot(*self.dots, ".", markersize=5, color=COLOUR[state])
        if self.slope is not None:
            ends = np.array(axes.get_xlim())
            axes.plot(ends, self.slope * ends, color=COLOURS["truth"], linewidth=1.0)
        if self.level is not None:
            axes.axhline(self.level, color=COLOURS["truth"], linestyle=":")
        axes.set(xlabel=self.x, ylabel=self.y, **self.limits)
        axes.locator_params(nbins=4)


@dataclass(frozen=True, eq=False)
class Seen:
    """What was measured on a robot, and what it looks like: the symptom on the left, the diagnosis on the right."""

    value: float
    symptom: Panel
    diagnosis: Panel


@dataclass(frozen=True, eq=False)
class Fault:
    """One row of the table: what is wrong, what one sees, the number that tells, what helps; ``look`` measures it."""

    family: str
    name: str
    what: str
    sign: str
    number: str
    unit: str
    remedy: str
    look: Callable[[bool], Seen]

    @cached_property
    def seen(self) -> dict[str, Seen]:
        """Return what was measured in each state."""
        return {state: self.look(state == "broken") for state in STATES}

    @property
    def healthy(self) -> float:
        """Return the number without the fault."""
        return self.seen["healthy"].value

    @property
    def broken(self) -> float:
        """Return the number with the fault."""
        return self.seen["broken"].value

    def value(self, state: str) -> str:
        """Return the number in words, rounded to what matters; a count has no decimals."""
        return f"{round(self.seen[state].value, 2) + 0.0:g} {self.unit}".strip()

    def frame(self, state: str) -> Figure:
        """Draw the symptom on the left and the diagnosis on the right."""
        figure, axes = sheet(3.5, 1, 2)
        here, other = self.seen[state], self.seen[next(s for s in STATES if s != state)]
        here.symptom.draw(axes[0], state, other.symptom)
        here.diagnosis.draw(axes[1], state, other.diagnosis)
        figure.suptitle(f"{self.number}: {self.value(state)}", color=COLOUR[state])
        return figure

    def alt(self, state: str) -> str:
        """Return what the frame shows."""
        here, done = self.seen[state], self.what if state == "broken" else "all is right"
        return f"""{self.name}, {state} ({done}). Symptom: {here.symptom.words}. Diagnosis: {here.diagnosis.words}.
        {self.number} {self.value(state)}."""


def explorer(faults: dict[str, Fault], family: str) -> Explorer:
    """Choose a fault of a family, and healthy or broken."""
    names = [name for name, fault in faults.items() if fault.family == family]
    controls = [Slider("fault", names, label="Fault"), Slider("state", STATES, start=1, label="Robot")]
    return Explorer(
        lambda fault, state: faults[fault].frame(state),
        controls,
        alt=lambda fault, state: faults[fault].alt(state),
        title=f"Faults of the {family}, each healthy and broken",
    )
