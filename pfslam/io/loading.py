"""What all loaders share: which numbers can be, what is left out, and what there is to say."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import check_rows, check_stamps

STAMP_LIMIT = (1e11, "seconds")  # the year 5138
POSE_LIMIT = (1e8, "m and rad")
GRAVITY_LIMIT = (1e3, "g")
LIMITS = {
    "counts": (1e6, "counts per reading"),
    "angular_velocity": (1e3, "rad/s"),
    "linear_acceleration": GRAVITY_LIMIT,
    "acceleration_g": GRAVITY_LIMIT,
    "pose": POSE_LIMIT,
    "poses": POSE_LIMIT,
}
"""Largest magnitude of each field, by the last part of its name, and its unit; of all others, that of stamps."""
LONGEST_SWEEP = 10.0
"""Seconds that a scanner may take for one scan."""
LONG_GAP = 0.5
"""Seconds of silence (five usual intervals at least) that are spoken of."""


def check_size(path: str | Path, key: str, values: np.ndarray) -> None:
    """Raise ``DataError`` for numbers that no robot can have measured: a damaged file, or another unit."""
    limit, unit = LIMITS.get(key.rpartition(".")[2], STAMP_LIMIT)
    largest = float(values.ravel()[np.argmax(np.abs(values.astype(float)))])
    if abs(largest) > limit:
        raise DataError(path, key, f"{largest:g}", f"{unit}, at most {limit:g}")


def stamps(path: str | Path, values: np.ndarray, key: str) -> np.ndarray:
    """Check stamps and return them ``(K,)`` float64; a matrix of one row or column will do."""
    t = np.asarray(values)
    t = t.ravel() if t.ndim == 2 and 1 in t.shape else t
    check_stamps(t, str(path), key)
    check_size(path, key, t)
    return t.astype(float)


def readings(path: str | Path, values: np.ndarray, key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Check that values are finite numbers of this shape that a robot can have measured, and return them."""
    check_rows(values, str(path), key, shape)
    check_size(path, key, values)
    return values


@dataclass(eq=False)
class Log:
    """Counts what is left out of the recording at ``path``, by reason, and collects what is to be said."""

    path: Path
    dropped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    def said(self) -> dict[str, Any]:
        """Return both as the fields of a recording."""
        return {"dropped": dict(self.dropped), "notes": tuple(self.notes)}

    def leave_out(self, what: str, number: int | np.ndarray = 1) -> None:
        """Count items that are left out; of an array, those that are true."""
        if count := int(np.sum(number)):
            self.dropped[what] += count

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
