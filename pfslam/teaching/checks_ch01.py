"""Checks of the exercises of chapter 01. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np

from pfslam.teaching.checks import Check, attempt, hint, not_a_number, passed

METRES_PER_COUNT = 0.0022
TRUE_BIAS = 0.004  # rad/s, of the made-up gyro


def check_path_length(path_length) -> Check:
    """Whether ``path_length(counts, metres_per_count)`` is right for a drive of a few readings."""
    counts = np.array([[0, 0, 0, 0], [10, 12, 10, 12], [20, 18, 20, 18], [16, 14, 16, 14]])
    expected = 45 * METRES_PER_COUNT
    answer = attempt(path_length, counts, METRES_PER_COUNT)
    verdict = not_a_number(answer, "metres")
    if verdict is not None:
        return verdict
    if np.isclose(answer, expected):
        return passed(f"45 counts on average, {expected:.4f} m.")
    wrong = {
        4 * expected: "Four times too long: you added the wheels. The chassis centre travels their mean.",
        45.0: "That is in counts. Each count is worth metres_per_count metres.",
        15 * METRES_PER_COUNT: "You took counts for a running total, by difference or by the last reading. "
        "Each reading is already the increment since the one before.",
        45 * METRES_PER_COUNT / 4: "That is the mean over the readings. The distance is their sum.",
    }
    for value, words in wrong.items():
        if np.isclose(answer, value):
            return hint(words)
    return hint(
        f"For the counts {counts.tolist()} your function returns {answer:.4f} m, expected {expected:.4f} m."
    )


def bias_recording() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, yaw rate and speed of a made-up drive: 10 s still, 40 s of left turns, 10 s still."""
    t = np.arange(0.0, 60.0, 0.01)
    driving = (t >= 10.0) & (t < 50.0)
    yaw_rate = TRUE_BIAS + 0.02 * np.exp(-t / 0.5) + np.where(driving, 0.3, 0.0)
    return t, yaw_rate, np.where(driving, 1.0, 0.0)


def check_gyro_bias(gyro_bias) -> Check:
    """Whether ``gyro_bias(t, yaw_rate, speed)`` finds the bias of a made-up gyro that warms up and then turns."""
    t, yaw_rate, speed = bias_recording()
    answer = attempt(gyro_bias, t, yaw_rate, speed)
    verdict = not_a_number(answer, "rad/s")
    if verdict is not None:
        return verdict
    warm = t > 2.0
    if abs(answer - TRUE_BIAS) < 0.02 * TRUE_BIAS:
        return passed(f"{answer:.4f} rad/s, from the time when the robot stood still and the gyro was warm.")
    if abs(answer - yaw_rate.mean()) < 1e-4 or abs(answer - yaw_rate[warm].mean()) < 1e-4:
        return hint("You average over the whole drive. Turning is in it too: here 40 s of left turns.")
    if answer > 2 * TRUE_BIAS and answer < 0.03:
        return hint("You trust the first second or so, when the gyro warms up. Use all the time at rest.")
    if abs(answer - yaw_rate[speed == 0].mean()) < 0.02 * TRUE_BIAS:
        return hint(
            "Close: the first seconds, while the gyro warms up, are still in your mean. Leave them out."
        )
    if abs(answer + TRUE_BIAS) < 0.2 * TRUE_BIAS:
        return hint("The sign: the bias is what the gyro shows at rest; it is subtracted later.")
    return hint(
        f"Your function finds {answer:.5f} rad/s. The robot stands still where speed is 0; look there."
    )
