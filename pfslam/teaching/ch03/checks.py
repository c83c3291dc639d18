"""Checks of the exercises of chapter 03. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np

from pfslam.poses import average_pose, wrap_angle
from pfslam.teaching.show.checks import Check, attempt, hint, is_unanswered, not_a_number, passed, unanswered

START = np.tile([2.0, -1.0, 0.5], (4000, 1))
V, OMEGA, DT, SIGMA_V, SIGMA_OMEGA = 1.0, 0.2, 0.1, 0.3, 0.5
TOLERANCE = 0.1  # of a standard deviation estimated from 4000 draws, which is good to 1.1 %


def check_heading_spread(spread_of_heading) -> Check:
    """Whether ``spread_of_heading(sigma_omega, rate, seconds)`` is right, in degrees."""
    sigma, rate, seconds = 0.2, 50.0, 8.0
    answer = attempt(spread_of_heading, sigma, rate, seconds)
    verdict = not_a_number(answer, "degrees")
    if verdict is not None:
        return verdict
    tau = 1.0 / rate
    right = sigma * np.sqrt(tau * seconds)
    if np.isclose(answer, np.rad2deg(right)):
        return passed("The spread grows with the root of time, and with the root of the sample interval.")
    wrong = {
        right: "That is in radians; degrees are asked for.",
        np.rad2deg(sigma * seconds): "That is a bias: the same error in every sample. "
        "Independent errors partly cancel; their variances add, not their sizes.",
        np.rad2deg(sigma * np.sqrt(seconds)): "The root of time is right, but where is the sample rate? "
        "Each sample turns the robot by tau times its noise.",
        np.rad2deg(
            sigma * np.sqrt(rate * seconds)
        ): "Each of the rate * seconds samples adds its noise times tau, "
        "the time that it lasts. You left out tau.",
        np.rad2deg(
            np.sqrt(sigma * tau * seconds)
        ): "You took sigma_omega for a variance. It is a standard deviation.",
        np.rad2deg(right**2): "That is the variance. The spread is its root.",
    }
    for value, words in wrong.items():
        if np.isclose(answer, value):
            return hint(words)
    return hint(f"For 0.2 rad/s, 50 Hz and 8 s your function returns {answer:.3f}, expected 4.584 degrees.")


def check_predict(predict) -> Check:
    """Whether ``predict(poses, v, omega, dt, sigma_v, sigma_omega, rng)`` is Eq. 11."""
    poses = START.copy()
    moved = _call(predict, poses)
    if is_unanswered(moved):
        return unanswered()
    if isinstance(moved, Check):
        return moved
    if not isinstance(moved, np.ndarray) or moved.shape != START.shape:
        return hint(f"Poses of shape {START.shape} are asked for; found {np.shape(moved)}.")
    if not np.array_equal(poses, START):
        return hint(
            "Your function changes the poses that it is given. Make new ones: others may need the old."
        )
    if not np.array_equal(moved, _call(predict, START.copy())):
        return hint(
            "Twice the same rng, two results: you draw from np.random. Draw from the rng that is given."
        )
    return _compare(moved)


def _call(predict, poses: np.ndarray):
    return attempt(predict, poses, V, OMEGA, DT, SIGMA_V, SIGMA_OMEGA, np.random.default_rng(0))


def _compare(moved: np.ndarray) -> Check:
    """The statistics of the cloud after one step, against those of Eq. 11."""
    step, heading = moved[:, :2] - START[:, :2], START[0, 2]
    ahead = step @ [np.cos(heading), np.sin(heading)]
    sideways = step @ [-np.sin(heading), np.cos(heading)]
    turned = moved[:, 2] - heading
    if np.ptp(ahead) < 1e-12 and np.ptp(turned) < 1e-12:
        if abs(ahead[0] - DT * V) < 1e-12:
            return hint("All particles moved alike, without any noise: that is dead reckoning.")
        return hint("All particles moved alike: you drew one number for the whole cloud. Draw one for each.")
    if sideways.std() > 0.3 * ahead.std():
        return hint(
            "Particles moved sideways, which wheels cannot. Noise belongs on v and omega, not on the pose."
        )
    if np.abs(sideways).max() > 1e-9:
        return hint("Eq. 5 drives straight along the old heading, then turns. Use motion_model for the step.")
    expected = {
        "along the path": (ahead, DT * SIGMA_V, SIGMA_V),
        "in heading": (turned, DT * SIGMA_OMEGA, SIGMA_OMEGA),
    }
    for where, (values, deviation, sigma) in expected.items():
        found = values.std()
        if abs(found / deviation - 1.0) < TOLERANCE:
            continue
        for power in (0.5, 2.0):
            if abs(found / (DT * sigma**power) - 1.0) < TOLERANCE:
                return hint(f"The spread {where} is that of a sigma taken for a variance, or squared.")
        if abs(found / sigma - 1.0) < TOLERANCE:
            return hint(
                f"The spread {where} is 1/dt times too wide: add the noise to the control, before dt."
            )
        return hint(f"The spread {where} is {found:.4f}, expected about {deviation:.4f}.")
    if abs(ahead.mean() - DT * V) > 0.01 * V or abs(turned.mean() - DT * OMEGA) > 0.01:
        return hint("The middle of the cloud is not where v and omega lead: the noise must be added to them.")
    return passed("Every particle drives by its own noisy control.")


WEST = np.column_stack(
    [[1.0, 2.0, 6.0, 3.0], [0.0, 1.0, 5.0, 2.0], np.deg2rad([175.0, -179.0, -165.0, 178.0])]
)
WEST_WEIGHTS = np.array([0.1, 0.2, 0.5, 0.2])


def check_mean_pose(mean_pose) -> Check:
    """Whether ``mean_pose(poses, weights)`` is the weighted mean, with the heading averaged on the circle."""
    answer = attempt(mean_pose, WEST.copy(), WEST_WEIGHTS.copy())
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    if np.shape(answer) != (3,) or np.asarray(answer).dtype.kind not in "fiu":
        return hint(
            f"One pose is asked for, three numbers; your function returns the shape {np.shape(answer)}."
        )
    answer, expected = np.asarray(answer, dtype=float), average_pose(WEST, WEST_WEIGHTS)
    if np.allclose(answer, WEST[np.argmax(WEST_WEIGHTS)]):
        return hint("That is the heaviest particle, the MAP estimate. Here the mean is asked for.")
    if np.allclose(answer, average_pose(WEST)):
        return hint("All particles count alike in your mean. Weigh them.")
    if not np.allclose(answer[:2], expected[:2]):
        return hint(
            f"x and y should be {np.round(expected[:2], 3).tolist()}: the weights sum to 1, so each is one sum."
        )
    return _heading_verdict(answer[2])


def _heading_verdict(heading: float) -> Check:
    """The verdict on the heading of a mean pose whose x and y are right."""
    theta, right = WEST[:, 2], average_pose(WEST, WEST_WEIGHTS)[2]
    sin, cos = WEST_WEIGHTS @ np.sin(theta), WEST_WEIGHTS @ np.cos(theta)
    if abs(wrap_angle(heading - right)) < 1e-6:
        return passed(f"It faces {np.rad2deg(right) % 360.0:.0f}°, west, and not east.")
    wrong = [
        (float(WEST_WEIGHTS @ theta), "That is the mean of the numbers. +179° and -179° both face west, but their mean "
         "is 0°, east. Average directions, not numbers."),
        (np.arctan(sin / cos), "arctan cannot tell west from east: only the quotient goes in. Use arctan2."),
        (np.arctan2(cos, sin), "arctan2 takes the sine first, then the cosine."),
        (average_pose(WEST)[2], "The heading is averaged without the weights."),
        (np.rad2deg(right), "Headings are in radians."),
        (theta[np.argmax(WEST_WEIGHTS)], "x and y are means, the heading is that of the heaviest particle."),
    ]  # fmt: skip
    for value, words in wrong:
        if abs(heading - value) < 1e-6:
            return hint(words)
    return hint(f"x and y are right. The heading should be {right:.3f} rad, yours is {heading:.3f}.")
