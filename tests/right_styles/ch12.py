"""Right answers to the exercises of chapter 12, in the ways that people write them: each must pass its check."""

import numpy as np


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


def slope(right, left, turned):
    return (right - left) @ turned / (turned @ turned)


def slope_in_a_loop(right, left, turned):
    top = bottom = 0.0
    for r, side, angle in zip(right, left, turned, strict=True):
        top, bottom = top + (r - side) * angle, bottom + angle * angle
    return top / bottom


def classify(r, low, high):
    return "hit" if low <= r <= high else "free" if r > high else "unknown"


STYLES = {
    "check_increments": [
        in_a_loop,
        signed_bytes,
        unwrapped,
        lambda r: tuple(in_a_loop(r)),
        lambda r: np.float32(in_a_loop(r)),
    ],
    "check_track": [
        slope,
        slope_in_a_loop,
        lambda r, left, t: np.linalg.lstsq(t[:, None], r - left, rcond=None)[0],
        lambda r, left, t: np.float32(slope(r, left, t)),
        lambda r, left, t: round(slope(r, left, t), 4),
        lambda r, left, t: [slope(r, left, t)],
    ],
    "check_classify": [
        classify,
        lambda *given: np.str_(classify(*given)),
    ],
}
