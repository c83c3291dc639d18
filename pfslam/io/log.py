"""What a loader leaves out of a recording, and what it has to say of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pfslam.errors import DataError

LONG_GAP = 0.5
"""Seconds of silence (five usual intervals at least) that are spoken of."""


@dataclass(eq=False)
class Log:
    """Counts what is left out of the recording at ``path``, by reason, and collects what is to be said."""

    path: Path
    dropped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    def leave_out(self, what: str, number: int | np.ndarray = 1) -> None:
        """Count items that are left out; of an array, those that are true."""
        if count := int(np.sum(number)):
            self.dropped[what] += count

    @contextmanager
    def naming(self, place: str) -> Iterator[None]:
        """Let a ``DataError`` raised inside name this recording, and the place in it before its own field."""
        try:
            yield
        except DataError as error:
            raise DataError(self.path, f"{place}, {error.field}", error.found, error.expected) from None

    def in_order(self, what: str, t: np.ndarray) -> np.ndarray:
        """Find the indices that put stamps ``t (K,)`` in strictly increasing order: of equal ones, the first counts.

        Doubles are counted, and what is out of order or silent for long is spoken of.
        """
        early = np.flatnonzero(np.diff(t) < 0)
        if len(early):
            first = t[early[0] + 1]
            self.notes.append(f"{what} out of order, put in order: {len(early)}, the first at {first:.3f} s")
        order = np.argsort(t, kind="stable")
        new = np.diff(t[order], prepend=-np.inf) > 0
        self.leave_out(f"{what} with the stamp of another", ~new)
        order = order[new]
        gaps = np.diff(t[order])
        if len(gaps) and gaps.max() > max(LONG_GAP, 5.0 * np.median(gaps)):
            longest, since = gaps.max(), t[order][gaps.argmax()]
            self.notes.append(f"no {what} for {longest:.2f} s after {since:.3f} s, the longest gap")
        return order
