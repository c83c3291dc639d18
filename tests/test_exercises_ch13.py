"""Exercises of chapter 13: right answers in many styles, wrong ones and the words for each."""

import numpy as np
import pytest
from pfslam_book import ch13

# ---- right answers


def in_a_loop(readings):
    steps, last = [], int(readings[0])
    for reading in readings.tolist():
        step = reading - last
        steps.append(step - 256 if step > 127 else step + 256 if step < -128 else step)
        last = reading
    return steps


def signed_bytes(readings):
    return np.diff(readings, prepend=readings[0]).view(np.int8)


def unwrapped(readings):
    angle = np.unwrap(readings * (2 * np.pi / 256))
    return np.diff(angle, prepend=angle[0]) * 256 / (2 * np.pi)


def by_angles(readings):
    steps = np.angle(np.exp(2j * np.pi / 256 * np.diff(readings.astype(float), prepend=float(readings[0]))))
    return np.rint(steps * 256 / (2 * np.pi))


def slope(right, left, turned):
    return (right - left) @ turned / (turned @ turned)


def slope_in_a_loop(right, left, turned):
    top = bottom = 0.0
    for r, side, angle in zip(right, left, turned, strict=True):
        top, bottom = top + (r - side) * angle, bottom + angle * angle
    return top / bottom


def classify(r, low, high):
    return "hit" if low <= r <= high else "free" if r > high else "unknown"


def classify_nan_first(r, low, high):
    if np.isnan(r):
        return "unknown"
    return ("unknown", "hit", "free")[int(r >= low) + int(r > high)]


RIGHT = [
    (ch13.check_increments, in_a_loop),
    (ch13.check_increments, signed_bytes),
    (ch13.check_increments, unwrapped),
    (ch13.check_increments, by_angles),
    (ch13.check_increments, lambda r: tuple(in_a_loop(r))),
    (ch13.check_increments, lambda r: np.float32(in_a_loop(r))),
    (ch13.check_increments, lambda r: np.rint(unwrapped(r)).astype(np.int16)),
    (ch13.check_track, slope),
    (ch13.check_track, slope_in_a_loop),
    (ch13.check_track, lambda r, left, t: np.linalg.lstsq(t[:, None], r - left, rcond=None)[0]),
    (ch13.check_track, lambda r, left, t: np.float32(slope(r, left, t))),
    (ch13.check_track, lambda r, left, t: round(slope(r, left, t), 4)),
    (ch13.check_track, lambda r, left, t: [slope(r, left, t)]),
    (ch13.check_classify, classify),
    (ch13.check_classify, classify_nan_first),
    (ch13.check_classify, lambda *given: str(np.array(classify(*given)))),
    (ch13.check_classify, lambda *given: np.str_(classify(*given))),
    (
        ch13.check_classify,
        lambda r, a, b: {(True, False): "hit", (True, True): "free"}.get((r >= a, r > b), "unknown"),
    ),
    (
        ch13.check_classify,
        lambda r, a, b: next((w for w, x in (("free", r > b), ("hit", r >= a)) if x), "unknown"),
    ),
]


@pytest.mark.parametrize(("check", "answer"), RIGHT)
def test_the_same_in_another_style_is_right_too(check, answer):
    assert check(answer), check(answer)


# ---- wrong answers


def plain(readings):
    return np.diff(readings.astype(int), prepend=int(readings[0]))


def only_forwards(readings):
    steps = plain(readings)
    steps[steps < 0] += 256
    return steps


def reversed_in_place(readings):
    readings[:] = readings[::-1]
    return in_a_loop(readings[::-1])


WRONG = [
    (ch13.check_increments, plain, "at its word"),
    (ch13.check_increments, lambda r: plain(r) % 256, "look alike"),
    (ch13.check_increments, only_forwards, "look alike"),
    (ch13.check_increments, lambda r: np.abs(in_a_loop(r)), "lost the sign"),
    (ch13.check_increments, lambda r: (np.diff(r.astype(int), prepend=0) + 128) % 256 - 128, "start at zero"),
    (ch13.check_increments, lambda r: np.cumsum(in_a_loop(r)), "running totals"),
    (ch13.check_increments, lambda r: np.where(abs(plain(r)) > 127, 0, plain(r)), "throw the wrapped"),
    (ch13.check_increments, lambda r: [*in_a_loop(r)[1:], 0], "too early"),
    (ch13.check_increments, lambda r: np.diff(r.astype(int)), "nobody counted"),
    (ch13.check_increments, reversed_in_place, "changes what it is given"),
    (ch13.check_increments, lambda r: nothing, "NameError"),  # noqa: F821
    (ch13.check_track, lambda r, left, t: np.mean((r - left) / t), "did not turn"),
    (ch13.check_track, lambda r, left, t: slope(left, r, t), "sign"),
    (ch13.check_track, lambda r, left, t: 1 / slope(r, left, t), "Upside down"),
    (ch13.check_track, lambda r, left, t: slope(r, left, t) / 2, "Half"),
    (ch13.check_track, lambda r, left, t: slope(r, left, np.rad2deg(t)), "into degrees"),
    (ch13.check_track, lambda r, left, t: np.rad2deg(slope(r, left, t)), "radians already"),
    (ch13.check_track, lambda r, left, t: (r - left).sum() / t.sum(), "cancel"),
    (ch13.check_track, lambda r, left, t: np.mean((r - left)[t != 0] / t[t != 0]), "averaged ratios"),
    (ch13.check_track, lambda r, left, t: np.polyfit(t, r - left, 1)[0], "through zero"),
    (ch13.check_track, lambda r, left, t: slope(r, -left, t), "added the sides"),
    (ch13.check_track, lambda r, left, t: r - left, "One number"),
    (ch13.check_classify, lambda r, a, b: "hit" if a <= r <= b else "free", "dirt"),
    (ch13.check_classify, lambda r, a, b: "hit" if r >= a else "unknown", "ring"),
    (ch13.check_classify, lambda r, a, b: "hit" if a <= r <= b else "unknown", "that way is free"),
    (ch13.check_classify, lambda r, a, b: "unknown" if r < a else "hit" if r <= b else "free", "NaN"),
    (ch13.check_classify, lambda r, a, b: "hit" if a < r < b else "free" if r >= b else "unknown", "exactly"),
    (ch13.check_classify, lambda r, a, b: classify(r, 0.1, 30.0), "built in"),
    (
        ch13.check_classify,
        lambda r, a, b: "hit" if a <= r <= b else "free" if r == np.inf else "unknown",
        "finite",
    ),
    (ch13.check_classify, lambda r, a, b: 1, "words"),
    (ch13.check_classify, lambda r, a, b: "wall", "words"),
    (ch13.check_classify, lambda r, a, b: None, "returns nothing"),
    (ch13.check_increments, lambda r: plain(r) + 256 * (plain(r) < -128), "255 to 0 only"),
    (ch13.check_increments, lambda r: plain(r) - 256 * (plain(r) > 127), "0 to 255 only"),
    (ch13.check_increments, lambda r: (plain(r) + 127) % 255 - 127, "256 values"),
    (ch13.check_increments, lambda r: np.clip(plain(r), -127, 127), "cut large"),
    (ch13.check_increments, lambda r: plain(r) % 256 - 128, "Add 128 before"),
    (ch13.check_track, lambda r, left, t: np.linalg.norm(r - left) / np.linalg.norm(t), "one length"),
    (ch13.check_track, lambda r, left, t: (r - left).std() / t.std(), "two spreads"),
    (ch13.check_track, lambda r, left, t: 1 / (t @ (r - left) / (r - left).dot(r - left)), "turned the line"),
    (ch13.check_track, lambda r, left, t: np.median((r - left)[t != 0] / t[t != 0]), "median of ratios"),
    (
        ch13.check_classify,
        lambda r, a, b: "unknown" if not np.isfinite(r) else classify(r, a, b),
        "that way is free",
    ),
    (ch13.check_classify, lambda r, a, b: "unknown" if r == b else classify(r, a, b), "greatest range"),
    (ch13.check_classify, lambda r, a, b: "free" if r == 0 else classify(r, a, b), "not for a free way"),
    (ch13.check_classify, lambda r, a, b: "hit" if np.isnan(r) else classify(r, a, b), "NaN is no wall"),
]


@pytest.mark.parametrize(("check", "answer", "words"), WRONG)
def test_a_wrong_answer_is_refused_by_name(check, answer, words):
    verdict = check(answer)
    assert verdict.verdict == "wrong"
    assert words in verdict.message
