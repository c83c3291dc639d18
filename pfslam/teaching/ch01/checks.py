"""Checks of the exercises of chapter 01. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np

from pfslam.motion import Controls, integrate
from pfslam.teaching.show.checks import Check, attempt, hint, is_unanswered, not_a_number, passed, unanswered

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


def wheel_recording() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps and counts of 200 readings with a jittering clock, and the stamps of 40 scans among them."""
    rng = np.random.default_rng(0)
    t = 0.025 * np.arange(200) + rng.uniform(-0.008, 0.008, 200)
    counts = np.floor(10.0 + 4.0 * np.sin(t))[:, None] + rng.integers(0, 2, (200, 4))
    return t, counts, 0.5 + 0.11 * np.arange(40)


def check_distance_between(distance_between) -> Check:
    """Whether ``distance_between(t, counts, metres_per_count, t_scans)`` gives the metres between K scans."""
    t, counts, scans = wheel_recording()
    answer = attempt(distance_between, t.copy(), counts.copy(), METRES_PER_COUNT, scans.copy())
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    each = counts.mean(axis=1) * METRES_PER_COUNT
    total = np.interp(scans, t, np.cumsum(each))
    answer, expected = np.asarray(answer), np.diff(total)
    if answer.dtype.kind not in "fiu" or answer.shape not in ((39,), (40,)):
        return hint(f"39 distances lie between 40 scans; your function returns the shape {answer.shape}.")
    if answer.shape == (40,) and np.allclose(np.diff(answer), expected):
        return hint(
            "That is the way since the start, at each scan. Asked is the way from one scan to the next."
        )
    if answer.shape == (39,) and np.allclose(answer, expected):
        return passed(f"{expected.sum():.2f} m in all, and the same for every other choice of scans.")
    return _pairing_hint(answer, t, each, scans, expected)


def _pairing_hint(answer, t, each, scans, expected) -> Check:
    """What is wrong with distances ``answer`` between scans, if each reading is worth ``each`` metres."""
    after = np.searchsorted(t, scans)
    near = after - (scans - t[after - 1] < t[after] - scans)
    sums, at_scans = np.cumsum(each), np.interp(scans, t, each)
    wrong = [
        ((each[near], at_scans), "You took one reading for each scan. Four or five readings lie between two scans, and "
         "the others are lost. Add up first, then look."),
        ((np.diff(each[near]), np.diff(at_scans)), "You took differences of single readings. They are increments "
         "already: sum them first."),
        ((np.diff(sums[near]), np.diff(sums[after]), np.diff(sums[after - 1])), "Nearly: the sum is read off at a "
         "reading, not at the scan, so a part of a reading goes to the wrong side. Interpolate the sum."),
        ((4 * expected,), "Four times too long: you added the wheels. The chassis centre travels their mean."),
        ((expected / METRES_PER_COUNT,), "That is in counts. Each count is worth metres_per_count metres."),
    ]  # fmt: skip
    for values, words in wrong:
        for value in values:
            if any(
                np.shape(v) == answer.shape and np.allclose(answer, v) for v in (value, value[1:], value[:-1])
            ):
                return hint(words)
    return hint(f"In all your distances make {answer.sum():.3f} m, expected {expected.sum():.3f} m.")


BEND = (np.array([1.0, 2.0, 0.5]), 1.2, 0.8, 1.0)
"""Pose, speed, yaw rate and duration of one long step."""


def check_arc(arc_step) -> Check:
    """Whether ``arc_step(pose, v, omega, dt)`` drives an exact arc: left, right and straight on."""
    pose, v, omega, dt = BEND
    answers = []
    with np.errstate(all="ignore"):
        for rate in (omega, -omega, 0.0):
            answers.append(attempt(arc_step, pose.copy(), v, rate, dt))
    if is_unanswered(answers[0]):
        return unanswered()
    if isinstance(answers[0], Check):
        return answers[0]
    if np.shape(answers[0]) != (3,):
        return hint(f"A pose has three numbers; your function returns the shape {np.shape(answers[0])}.")
    for answer, rate in zip(answers[:2], (omega, -omega), strict=True):
        if isinstance(answer, Check) or not np.allclose(answer, _many_steps(pose, v, rate, dt), atol=1e-3):
            return _bend_hint(answers[0])
    straight = answers[2]
    if isinstance(straight, Check) or not np.isfinite(straight).all():
        return hint("Right in bends. But straight on, with omega = 0, you divide by zero.")
    if not np.allclose(straight, pose + [dt * v * np.cos(pose[2]), dt * v * np.sin(pose[2]), 0.0]):
        return hint("Right in bends. Straight on, with omega = 0, the robot should come v * dt further.")
    return passed("One long arc ends where ten thousand small steps end, and straight on works too.")


def _many_steps(pose, v: float, omega: float, dt: float, n: int = 10_000) -> np.ndarray:
    """The end of the bend in ``n`` small steps of Eq. 5: the oracle."""
    small = Controls(np.linspace(0.0, dt, n + 1), np.full(n, v), np.full(n, omega))
    return integrate(small, start=pose).poses[-1]


def _bend_hint(answer) -> Check:
    """What is wrong with the end of the left bend."""
    (x, y, theta), v, omega, dt = BEND
    half, end = 0.5 * omega * dt, _many_steps(*BEND)

    def ends_at(way: float, direction: float) -> bool:
        return np.allclose(answer[:2], [x + way * np.cos(direction), y + way * np.sin(direction)], atol=1e-3)

    chord = v * dt * np.sin(half) / half
    if ends_at(v * dt, theta):
        return hint("That is the straight step of Eq. 5: it drives on, then turns.")
    if ends_at(v * dt * np.sinc(half), theta + half):
        return hint("Too short: NumPy's sinc(x) is sin(pi x) / (pi x). Divide its argument by pi.")
    if ends_at(v * dt, theta + half):
        return hint(
            "The direction is right, the length is not: v * dt is the way along the arc, its chord is shorter."
        )
    if ends_at(chord, theta) or ends_at(chord, theta + 2 * half):
        return hint(
            "The chord is right, its direction is not: it points half way between old and new heading."
        )
    if not np.isclose(answer[2], end[2]):
        return hint(f"The heading should be {end[2]:.3f} after the bend; yours is {answer[2]:.3f}.")
    return hint(f"After one left bend the robot should be at {np.round(end, 3).tolist()}; yours is at "
                f"{np.round(answer, 3).tolist()}.")  # fmt: skip
