"""Checks of the exercises of chapter 13: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pfslam_book.show.checks import Check, compare

# ---- 1: a counter that wraps

STEPS = np.array([0, 9, 18, 22, 22, 22, 15, 4, 0, -6, -12, -6, 0, 20, 22, 22, 22, 22, 18, 9])
"""A drive with a stretch in reverse: increments between two readings."""


def _readings(seed: int) -> tuple[np.ndarray]:
    """An 8-bit counter that begins somewhere and wraps more than once."""
    rng = np.random.default_rng(seed)
    steps = np.concatenate([[0], rng.integers(-90, 121, 24), [-127, 127]])
    return (((rng.integers(0, 256) + np.cumsum(steps)) % 256).astype(np.uint8),)


COUNTERS = [(((200 + np.cumsum(STEPS)) % 256).astype(np.uint8),), _readings(1), _readings(2)]


def increments(readings: np.ndarray) -> np.ndarray:
    """Give the increments ``(K,)`` of an 8-bit counter; the first is 0."""
    steps = np.diff(readings.astype(int), prepend=int(readings[0]))
    return (steps + 128) % 256 - 128


def _plain(readings: np.ndarray) -> np.ndarray:
    return np.diff(readings.astype(int), prepend=int(readings[0]))


def _wrapped(steps: np.ndarray, limit: int, size: int) -> np.ndarray:
    return np.where(steps < -limit, steps + size, np.where(steps > limit, steps - size, steps))


COUNTER_MISTAKES = [
    (_plain, "At the wrap the counter goes from 255 to 0, and you took it at its word. Differences of an 8-bit counter "
     "are only known modulo 256."),
    (lambda r: _plain(r) % 256, "All your increments are positive. Modulo 256, a step of -6 and one of 250 look alike; "
     "choose the one that a wheel can make: between -128 and 127."),
    (lambda r: np.abs(increments(r)), "You lost the sign: in reverse the increments are negative."),
    (lambda r: (np.diff(r.astype(int), prepend=0) + 128) % 256 - 128, "Your first increment is the first reading. The "
     "counter did not start at zero when you did: the robot would jump by all that it drove before."),
    (lambda r: np.where(_plain(r) < -128, _plain(r) + 256, _plain(r)), "You mend the wrap from 255 to 0 only. In "
     "reverse the counter goes from 0 to 255."),
    (lambda r: np.where(_plain(r) > 127, _plain(r) - 256, _plain(r)), "You mend the wrap from 0 to 255 only. Forwards "
     "the counter goes from 255 to 0."),
    (lambda r: (_plain(r) + 127) % 255 - 127, "An 8-bit counter has 256 values: from 255 to 0 is one step."),
    (lambda r: _wrapped(_plain(r), 127, 255), "An 8-bit counter has 256 values: from 255 to 0 is one step."),
    (lambda r: _wrapped(_plain(r), 100, 256), "Steps of up to 127 are real. You take some of them for a wrap."),
    (lambda r: _wrapped(_plain(r), 200, 256), "A wheel may make steps of up to 127, so a difference of 129 is a wrap "
     "already. Your limit is too high."),
    (lambda r: np.clip(_plain(r), -127, 127), "You cut large differences off. They are wraps: add or subtract 256."),
    (lambda r: _plain(r) % 256 - 128, "Add 128 before you take the remainder; else every step comes out 128 too "
     "small."),
    (lambda r: np.append(np.nan, increments(r)[1:]), "Before the first reading nobody counted: its increment is 0."),
    (lambda r: np.cumsum(increments(r)) + int(r[0]), "Those are running totals. The increments between them are asked "
     "for."),
    (lambda r: (r.astype(int) - int(r[0]) + 128) % 256 - 128, "You take every reading against the first. Take it "
     "against the one before."),
    (lambda r: np.cumsum(increments(r)), "Those are running totals. The increments between them are asked for."),
    (lambda r: np.where(_plain(r) < 0, _plain(r) + 256, _plain(r)), "You take every backward step for a wrap. A wheel "
     "also turns backwards."),
    (lambda r: np.where(np.abs(_plain(r)) > 127, 0, _plain(r)), "You throw the wrapped steps away. Their way is lost; "
     "add or subtract 256 instead."),
    (lambda r: np.roll(increments(r), -1), "Your increments stand one reading too early. The first is 0, because "
     "before the first reading nobody counted."),
    (lambda r: np.diff(r, prepend=r[0]), "In bytes, 3 - 9 is 250. Make whole numbers of the readings before you "
     "subtract."),
]  # fmt: skip


def check_increments(theirs: Callable) -> Check:
    """Check that ``increments(readings)`` gives the increments ``(K,)`` of an 8-bit counter."""
    praise = "The wrap is gone, and the stretch in reverse is still in reverse."
    verdict = compare(theirs, increments, COUNTERS, mistakes=COUNTER_MISTAKES, praise=praise)
    if "asked for; yours has the shape" in verdict.message:
        return Check(
            "wrong", f"{verdict.message} Before the first reading nobody counted: its increment is 0."
        )
    return verdict


# ---- 2: the effective track


def _seconds(seed: int, track: float, noise: float = 0.004) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The way of right and left wheels (m) and the gyro's turn (rad) in each of some seconds, with noise."""
    rng = np.random.default_rng(seed)
    turned = np.concatenate([[0.0, 0.0, 0.0], rng.uniform(-1.2, 1.2, 9)])
    apart = track * turned + noise * rng.standard_normal(len(turned))
    middle = rng.uniform(-0.2, 1.1, len(turned))
    return middle + apart / 2, middle - apart / 2, turned


DRIVES = [_seconds(3, 0.74), _seconds(4, 0.55, 0.03), _seconds(5, 1.31, 0.06)]


def effective(right: np.ndarray, left: np.ndarray, turned: np.ndarray) -> float:
    """Give the slope of the way apart over the angle, the line through zero."""
    return float((right - left) @ turned / (turned @ turned))


def _ratios(right, left, turned):
    moved = turned != 0
    return float(np.mean((right - left)[moved] / turned[moved]))


TRACK_MISTAKES = [
    (lambda r, left, t: -effective(r, left, t), "The sign is wrong: in a left turn, which is positive, the right "
     "wheels go further."),
    (lambda r, left, t: 1 / effective(r, left, t), "Upside down: way apart = track * angle, so the track is the slope "
     "of the way over the angle."),
    (lambda r, left, t: t @ t / ((r - left) @ t), "Upside down: way apart = track * angle, so the track is the slope "
     "of the way over the angle."),
    (lambda r, left, t: effective(r, left, t) / 2, "Half of it: the two sides are one track apart, not each a track "
     "from the middle."),
    (lambda r, left, t: np.rad2deg(effective(r, left, t)), "The angles are in radians already."),
    (lambda r, left, t: effective(r, left, np.rad2deg(t)), "You turned the angles into degrees. Arc is radius times "
     "angle in radians."),
    (lambda r, left, t: (r - left).sum() / t.sum(), "You divided sums. The robot turned in both directions, so sums "
     "cancel and noise remains: fit the slope of a line through all seconds."),
    (_ratios, "You averaged ratios. A second with hardly any turn counts as much as one with a strong turn, and noise "
     "over a small angle is large: fit one line through all seconds."),
    (lambda r, left, t: np.linalg.norm(r - left) / np.linalg.norm(t), "You divide one length by another, which makes "
     "noise count as turning. Fit the slope of a line through all seconds."),
    (lambda r, left, t: (r - left).std() / t.std(), "You divide two spreads, which makes noise count as turning. Fit "
     "the slope of a line through all seconds."),
    (lambda r, left, t: np.abs(r - left).sum() / np.abs(t).sum(), "Sums without signs make noise count as turning. Fit "
     "the slope of a line through all seconds."),
    (lambda r, left, t: (r - left) @ (r - left) / ((r - left) @ t), "You fitted the angle to the way and turned the "
     "line round. The noise is in the way: fit the way to the angle."),
    (lambda r, left, t: np.median((r - left)[t != 0] / t[t != 0]), "A median of ratios forgets how strong each turn "
     "was: fit one line through all seconds."),
    (lambda r, left, t: (r - left)[np.argmax(np.abs(t))] / t[np.argmax(np.abs(t))], "You used one second. Fit one line "
     "through all of them."),
    (lambda r, left, t: (r - left) @ t / t.sum(), "Divide by the sum of the *squared* angles."),
    (lambda r, left, t: np.polyfit(t, r - left, 1)[0], "Your line need not go through zero. A robot that did not turn "
     "has wheels that went equally far."),
    (lambda r, left, t: effective(r, 0 * left, t), "You left out one side. The difference of the two sides counts."),
    (lambda r, left, t: effective(r, -left, t), "You added the sides. Their difference turns the robot."),
]  # fmt: skip


def check_track(theirs: Callable) -> Check:
    """Check that ``track(right, left, turned)`` is the effective track (m)."""
    if _divides_by_zero(theirs):
        return Check("wrong", "Not yet. In some seconds the robot did not turn at all, and you divided by that. Fit "
                     "one line through all seconds instead of a ratio for each.")  # fmt: skip
    praise = (
        f"{effective(*DRIVES[0]):.2f} m, where a ruler says 0.39 m: the wheels skid sideways in every turn."
    )
    return compare(theirs, effective, DRIVES, mistakes=TRACK_MISTAKES, praise=praise)


def _divides_by_zero(theirs: Callable) -> bool:
    """Whether the answer to the first drive is not finite."""
    try:
        with np.errstate(all="ignore"):
            return not np.isfinite(float(np.squeeze(theirs(*(part.copy() for part in DRIVES[0])))))
    except Exception:
        return False  # compare says what it is


# ---- 3: what a range says

BEAMS = [(r, 0.1, 30.0) for r in (4.2, np.inf, 0.0, 0.05, 29.9, np.nan, 0.1, 30.0)]
BEAMS += [(r, 0.25, 8.0) for r in (0.2, 3.3, 7.9, 12.0, np.inf)]


def classified(r: float, range_min: float, range_max: float) -> str:
    """Give "hit", "free" or "unknown" for one range."""
    if range_min <= r <= range_max:
        return "hit"
    return "free" if r > range_max else "unknown"


def _in_words(theirs: Callable) -> bool:
    """Whether every answer is one of the three words."""
    return all(str(theirs(*beam)) in ("hit", "free", "unknown") for beam in BEAMS)


RANGE_MISTAKES = [
    (lambda r, a, b: "hit" if a <= r <= b else "free", "A range below the least, 0.05 m say, is dirt on the window, or "
     "the sensor's word for nothing; and NaN says that the sensor does not know. Neither is free space."),
    (lambda r, a, b: "hit" if a <= r <= b else "unknown", "This instrument says infinity when nothing came back from "
     "within its range: that way is free."),
    (lambda r, a, b: "hit" if r >= a else "unknown", "Infinity is no wall. A wall at the maximum range would draw a "
     "ring around the robot."),
    (lambda r, a, b: "unknown" if r < a else "hit" if r <= b else "free", "NaN is not a long way: the instrument says "
     "that it does not know. Comparisons with NaN are all false, so ask for it first or last."),
    (lambda r, a, b: "free" if r < a else "hit" if r <= b else "free", "A range below the least is neither a wall nor "
     "free space: the sensor cannot measure there."),
    (lambda r, a, b: "hit" if r <= b else "free" if r > b else "unknown", "A range below the least, 0.05 m say, is "
     "dirt on the window, or the sensor's word for nothing: unknown."),
    (lambda r, a, b: "unknown" if r == 0 or r != r else "hit" if r <= b else "free", "Not only 0: any range below the "
     "least says nothing."),
    (lambda r, a, b: "unknown" if not np.isfinite(r) else classified(r, a, b), "This instrument says infinity when "
     "nothing came back from within its range: that way is free."),
    (lambda r, a, b: "free" if r == 0 else classified(r, a, b), "0 is this instrument's word for not knowing, not for "
     "a free way."),
    (lambda r, a, b: "hit" if r != r else classified(r, a, b), "NaN is no wall: the instrument says that it does not "
     "know."),
    (lambda r, a, b: "free" if r >= b else classified(r, a, b), "At exactly the greatest range the instrument still "
     "measures."),
    (lambda r, a, b: "unknown" if r == b else classified(r, a, b), "At exactly the greatest range the instrument still "
     "measures."),
    (lambda r, a, b: "unknown" if r == a else classified(r, a, b), "At exactly the least range the instrument still "
     "measures."),
    (lambda r, a, b: "hit" if a < r < b else "free" if r >= b else "unknown", "At exactly the least and the greatest "
     "range the instrument still measures."),
    (lambda r, a, b: "hit" if 0.1 <= r <= 30.0 else "free" if r > 30.0 else "unknown", "You built in 0.1 and 30 m. "
     "Another LiDAR has other limits: use the arguments."),
    (lambda r, a, b: "hit" if a <= r <= b else "free" if r == np.inf else "unknown", "A finite range beyond the "
     "greatest is no measurement either, but the way up to it is free."),
    (lambda r, a, b: "free", "Between its limits the instrument measures, and the end of the beam is a hit."),
]  # fmt: skip


def check_classify(theirs: Callable) -> Check:
    """Check that ``classify(r, range_min, range_max)`` tells the three cases apart."""
    praise = (
        "Three cases, not two. Which of them a black cupboard gives is for your sensor's data sheet to say."
    )
    verdict = compare(theirs, classified, BEAMS, mistakes=RANGE_MISTAKES, praise=praise)
    if verdict.verdict == "wrong" and "expected" in verdict.message and not _in_words(theirs):
        return Check("wrong", f"{verdict.message} One of the words hit, free, unknown is asked for.")
    return verdict
