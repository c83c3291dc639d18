"""What numbers of a recording can be: whatever lies beyond is damage, or another unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pfslam.errors import DataError
from pfslam.recording import check_stamps

STAMP_LIMIT = (1e11, "seconds")  # the year 5138
POSE_LIMIT = (1e8, "m and rad")
GRAVITY_LIMIT = (1e3, "g")
LIMITS = {
    "time_stamps": STAMP_LIMIT,
    "disparity_time_stamps": STAMP_LIMIT,
    "rgb_time_stamps": STAMP_LIMIT,
    "t": STAMP_LIMIT,
    "disparity_t": STAMP_LIMIT,
    "rgb_t": STAMP_LIMIT,
    "counts": (1e6, "counts per reading"),
    "angular_velocity": (1e3, "rad/s"),
    "linear_acceleration": GRAVITY_LIMIT,
    "acceleration_g": GRAVITY_LIMIT,
    "pose": POSE_LIMIT,
    "poses": POSE_LIMIT,
}
"""Largest magnitude of each field, by the last part of its name, and its unit. Generous on purpose."""
LONGEST_SWEEP = 10.0
"""Seconds that a scanner may take for one scan."""


def check_size(path: str | Path, key: str, values: np.ndarray) -> None:
    """Raise ``DataError`` for numbers that no robot can have measured: a damaged file, or another unit."""
    limit, unit = LIMITS[key.rpartition(".")[2]]
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
