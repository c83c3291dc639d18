"""Exercises of chapter 13."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

# ---- 1: a counter that wraps


def counter_case(seed) -> tuple:
    """An 8-bit counter that begins somewhere, wraps more than once, and also runs backwards."""
    rng = np.random.default_rng(seed)
    steps = np.concatenate([[0], rng.integers(-90, 121, 24), [-127, 127]])
    return (((rng.integers(0, 256) + np.cumsum(steps)) % 256).astype(np.uint8),)


def increments(readings, before=None):
    steps = np.diff(readings.astype(int), prepend=int(readings[0]) if before is None else before)
    return (steps + 128) % 256 - 128


def plain(readings):
    return np.diff(readings.astype(int), prepend=int(readings[0]))


check_increments = Exercise(
    right=increments,
    cases=[counter_case(seed) for seed in (1, 2, 3)],
    mistakes={
        "At the wrap the counter goes from 255 to 0, and you took it at its word. Differences of an 8-bit counter are "
        "only known modulo 256.": plain,
        "All your increments are positive. Modulo 256, a step of -6 and one of 250 look alike; choose the one that a "
        "wheel can make: between -128 and 127.": lambda readings: plain(readings) % 256,
        "Your first increment is the first reading. The counter did not start at zero when you did: the robot would "
        "jump by all that it drove before.": lambda readings: increments(readings, before=0),
        "One increment for each reading is asked for: before the first nobody counted, so its increment is 0.": (
            lambda readings: increments(readings)[1:]
        ),
        "An 8-bit counter has 256 values: from 255 to 0 is one step.": (
            lambda readings: (plain(readings) + 127) % 255 - 127
        ),
    },
    praise="The wrap is gone, and the stretch in reverse is still in reverse.",
)

# ---- 2: the effective track


def track_case(seed, track, noise) -> tuple:
    """The way of right and left wheels (m) and the gyro's turn (rad) in each of some seconds, with noise."""
    rng = np.random.default_rng(seed)
    turned = np.concatenate([[0.0, 0.0, 0.0], rng.uniform(-1.2, 1.2, 9)])
    apart = track * turned + noise * rng.standard_normal(len(turned))
    middle = rng.uniform(-0.2, 1.1, len(turned))
    return middle + apart / 2, middle - apart / 2, turned


def track(right, left, turned):
    """The slope of the way apart over the angle, of a line through zero."""
    return float((right - left) @ turned / (turned @ turned))


check_track = Exercise(
    right=track,
    cases=[track_case(3, 0.74, 0.004), track_case(4, 0.55, 0.03), track_case(5, 1.31, 0.06)],
    mistakes={
        "In some seconds the robot did not turn at all, and you divided by that. Fit one line through all seconds "
        "instead of a ratio for each.": lambda right, left, turned: np.mean((right - left) / turned),
        "You averaged ratios. A second with hardly any turn counts as much as one with a strong turn, and noise over a "
        "small angle is large: fit one line through all seconds.": (
            lambda right, left, turned: np.mean((right - left)[turned != 0] / turned[turned != 0])
        ),
        "You divided sums. The robot turned in both directions, so sums cancel and noise remains: fit the slope of a "
        "line through all seconds.": lambda right, left, turned: (right - left).sum() / turned.sum(),
        "Your line need not go through zero. A robot that did not turn has wheels that went equally far.": (
            lambda right, left, turned: np.polyfit(turned, right - left, 1)[0]
        ),
        "Upside down: way apart = track * angle, so the track is the slope of the way over the angle.": (
            lambda right, left, turned: 1 / track(right, left, turned)
        ),
    },
    praise="0.74 m, where a ruler says 0.39 m: the wheels skid sideways in every turn.",
)

# ---- 3: what a range says


def classify(r, range_min, range_max):
    if range_min <= r <= range_max:
        return "hit"
    return "free" if r > range_max else "unknown"


check_classify = Exercise(
    right=classify,
    cases=[
        *((r, 0.1, 30.0) for r in (4.2, np.inf, 0.0, 0.05, 29.9, np.nan, 0.1, 30.0)),
        *((r, 0.25, 8.0) for r in (0.2, 3.3, 7.9, 12.0, np.inf)),
    ],
    mistakes={
        "A range below the least, 0.05 m say, is dirt on the window, or the sensor's word for nothing; and NaN says "
        "that the sensor does not know. Neither is free space.": lambda r, a, b: (
            "hit" if a <= r <= b else "free"
        ),
        "This instrument says infinity when nothing came back from within its range: that way is free.": (
            lambda r, a, b: "hit" if a <= r <= b else "unknown"
        ),
        "Infinity is no wall. A wall at the maximum range would draw a ring around the robot.": (
            lambda r, a, b: "hit" if r >= a else "unknown"
        ),
        "NaN is not a long way: the instrument says that it does not know. Comparisons with NaN are all false, so ask "
        "for it first or last.": lambda r, a, b: "free" if np.isnan(r) else classify(r, a, b),
        "At exactly the least and the greatest range the instrument still measures.": (
            lambda r, a, b: "hit" if a < r < b else "free" if r >= b else "unknown"
        ),
    },
    praise="Three cases, not two. Which of them a black cupboard gives is for your sensor's data sheet to say.",
)
