"""What a measurement is, how it is taken, and how it is printed: medians and ranges, rounds interleaved."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field

import numpy as np


@dataclass(frozen=True)
class Row:
    """One figure: the median of several rounds with the lowest and highest; ``target`` is what it should reach.

    ``best`` says which side of the target is good ("at least", "at most"); ``limit`` is the least that the machine's
    memory or arithmetic would allow, in the same unit.
    """

    what: str
    value: float | None
    unit: str
    low: float | None = None
    high: float | None = None
    target: float | None = None
    best: str = "at least"
    limit: float | None = None
    note: str = ""

    @classmethod
    def of(cls, what: str, samples, unit: str, **more) -> Row:
        """The row of several samples of one figure."""
        low, value, high = (float(np.quantile(samples, q)) for q in (0.0, 0.5, 1.0))
        return cls(what, value, unit, low, high, **more)

    @property
    def met(self) -> bool | None:
        """Whether the median reaches the target; None without one, or where nothing could be measured."""
        if self.target is None or self.value is None:
            return None
        return self.value >= self.target if self.best == "at least" else self.value <= self.target

    def __str__(self) -> str:
        value = "not measured" if self.value is None else f"{number(self.value)} {self.unit}"
        spread = "" if self.low is None else f"({number(self.low)} to {number(self.high)})"
        verdict = {True: "met", False: "MISSED", None: ""}[self.met]
        aim = "" if self.target is None else f"{self.best} {number(self.target)}: {verdict}"
        note = f"  [{self.note}]" if self.note else ""
        return f"  {self.what:<52} {value:>16} {spread:<22} {aim}{note}".rstrip()


@dataclass(frozen=True)
class Section:
    """A numbered group of rows under one title, with a sentence on how it was measured."""

    number: int
    title: str
    rows: list[Row] = field(default_factory=list)
    note: str = ""

    def __str__(self) -> str:
        note = [f"  {self.note}"] if self.note else []
        return "\n".join([f"{self.number}. {self.title}", *note, *map(str, self.rows), ""])

    def as_dict(self) -> dict:
        """For JSON: the fields, and with every row whether its target is met."""
        return asdict(self) | {"rows": [asdict(row) | {"met": row.met} for row in self.rows]}


def number(value: float | None) -> str:
    """A figure with three digits, or all before the point."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def interleaved(
    jobs: Mapping[str, Callable[[], object]], rounds: int, warm_up: bool = True
) -> dict[str, np.ndarray]:
    """Processor seconds ``(rounds,)`` of each job. Every round runs each job once, so that noise falls on all alike.

    Processor time rather than the clock on the wall: what else runs on the machine counts less. A first round warms
    caches up and is not counted; long jobs can do without.
    """
    seconds = {name: np.zeros(rounds) for name in jobs}
    for k in range(-1 if warm_up else 0, rounds):
        for name, job in jobs.items():
            begin = time.process_time()
            job()
            if k >= 0:
                seconds[name][k] = time.process_time() - begin
    return seconds


def slope(x, y) -> float:
    """Exponent p of the power law y = c x^p that fits best: the slope of a straight line through the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])
