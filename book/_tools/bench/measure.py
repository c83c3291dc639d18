"""A measured figure: how it is taken and how it is printed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pfslam.errors import DataError

THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Variables that the libraries read when they start; everything is measured on one thread."""


@dataclass(frozen=True)
class Row:
    """One figure: the median of several rounds, with the lowest and the highest."""

    what: str
    value: float | None
    unit: str
    low: float | None = None
    high: float | None = None
    note: str = ""

    @classmethod
    def of(cls, what: str, samples, unit: str, note: str = "") -> Row:
        """Summarise several samples of one figure."""
        low, value, high = (float(np.quantile(samples, q)) for q in (0.0, 0.5, 1.0))
        return cls(what, value, unit, low, high, note)

    def __str__(self) -> str:
        value = "not measured" if self.value is None else f"{_number(self.value)} {self.unit}"
        spread = ""
        if self.low is not None and self.high is not None and self.low < self.high:
            spread = f"({_number(self.low)} to {_number(self.high)})"
        note = f"  [{self.note}]" if self.note else ""
        return f"  {self.what:<48} {value:>16} {spread:<20}{note}".rstrip()


@dataclass(frozen=True)
class Section:
    """Figures under one title, with a sentence on how they were measured."""

    title: str
    note: str
    rows: list[Row]

    def __str__(self) -> str:
        return "\n".join([self.title, f"  {self.note}", *map(str, self.rows), ""])


def _number(value: float) -> str:
    """Write a figure with three digits, or all digits before the point."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def interleaved(jobs: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, np.ndarray]:
    """Take the processor seconds ``(rounds,)`` of each job; each round runs each job once.

    Noise then falls on all jobs alike, and processor time depends less on other programs than the clock does. A first
    round warms up the caches and is not counted.
    """
    seconds = {name: np.zeros(rounds) for name in jobs}
    for k in range(-1, rounds):
        for name, job in jobs.items():
            begin = time.process_time()
            job()
            if k >= 0:
                seconds[name][k] = time.process_time() - begin
    return seconds


def in_fresh_process(code: str, *arguments: str) -> str:
    """Run ``code`` in an interpreter of its own and return the last line it prints; ``DataError`` if it fails."""
    environment = os.environ | dict.fromkeys(THREADS, "1")
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode != 0 or not done.stdout.strip():
        last = (done.stderr.strip().splitlines() or ["nothing"])[-1]
        raise DataError("pfslam bench", "fresh process", last, "a run without errors")
    return done.stdout.strip().splitlines()[-1]
