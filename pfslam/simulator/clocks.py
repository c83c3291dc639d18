"""Clocks of the instruments: readings at a regular pace, stamped by a busy computer.

Times are in seconds from the first encoder stamp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

START_OF_TIME = 1_700_000_000.0  # unix time of the first encoder stamp of every simulated drive (s)


@dataclass(frozen=True)
class Clock:
    """How the stamps of one instrument are spaced, in seconds.

    ``period`` is the usual interval; a share ``long_share`` of the intervals lasts ``long_period`` instead. Stamps
    scatter by ``jitter``, a share ``late_share`` is late by up to ``late``, and no two are closer than ``least_gap``.
    """

    period: float
    jitter: float
    late_share: float
    late: float
    least_gap: float
    long_period: float = 0.0
    long_share: float = 0.0


ENCODER_CLOCK = Clock(0.02494, 0.0023, 0.007, 0.024, 0.0032)
IMU_CLOCK = Clock(0.01002, 0.0009, 0.008, 0.018, 0.0001)
LIDAR_CLOCK = Clock(0.02390, 0.0004, 0.030, 0.014, 0.0010, 0.02690, 0.34)
CAMERA_CLOCK = Clock(0.03317, 0.0005, 0.0, 0.0, 0.0270)
LOSS = 0.11  # how often the camera loses images, per image kept
LOST = (5, 1, 18)  # images lost in a row: usually, at least, and at most


def ticks_and_stamps(
    clock: Clock, start: float, stop: float, rng: np.random.Generator, jitter: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Draw when readings are taken and how they are stamped, both ``(K,)`` s within [start, stop].

    The readings are evenly spaced and the stamps scatter around them; with ``jitter`` = 0 both are the same.
    """
    count = int((stop - start) / min(clock.period, clock.long_period or clock.period)) + 2
    long = (rng.random(count) < clock.long_share) & (jitter > 0)
    tremble = jitter * clock.jitter * rng.standard_normal(count)
    late = (rng.random(count) < clock.late_share) * rng.uniform(0.0, clock.late, count) * jitter
    ticks = start + np.concatenate([[0.0], np.cumsum(np.where(long, clock.long_period, clock.period))[:-1]])
    stamps = ticks + np.clip(tremble, -4.0 * clock.jitter, 4.0 * clock.jitter) + late
    floor = clock.least_gap * np.arange(count)
    stamps[0] = start
    # Stamps never overtake one another: one that would come too early waits until the least gap has passed.
    stamps = np.maximum.accumulate(np.maximum(stamps, start) - floor) + floor
    kept = np.maximum(stamps, ticks) <= stop
    return ticks[kept], stamps[kept]


def camera_stamps(start: float, stop: float, rng: np.random.Generator, jitter: float = 1.0) -> np.ndarray:
    """Draw the stamps ``(K,)`` of one stream of the camera: 30 Hz, with images lost a few at a time."""
    stamps = ticks_and_stamps(CAMERA_CLOCK, start, stop, rng, jitter)[1]
    if jitter == 0:
        return stamps
    usual, least, most = LOST
    kept = np.ones(len(stamps), dtype=bool)
    k = 1
    while k < len(stamps) - 1:
        if rng.random() < LOSS:
            lost = usual if rng.random() < 0.95 else int(rng.integers(least, most))
            kept[k : min(k + lost, len(stamps) - 1)] = False
            k += lost
        k += 1
    return stamps[kept]


def unix(t: np.ndarray, quantised: bool = True) -> np.ndarray:
    """Convert times ``(K,)`` to Unix stamps (s), rounded to the microsecond."""
    t = START_OF_TIME + np.asarray(t)
    return np.round(t * 1e6) / 1e6 if quantised else t
