"""Checks of the exercises of chapter 05. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np

from pfslam.teaching.show.checks import Check, attempt, hint, is_unanswered, passed, unanswered

WEIGHTS, COUNTS = np.array([0.5, 0.3, 0.2]), np.array([10.0, 20.0, 40.0])


def check_update(update) -> Check:
    """Whether ``update(weights, counts)`` is Eq. 12, normalised, and survives a scan that scores nothing."""
    answer = attempt(update, WEIGHTS.copy(), COUNTS.copy())
    if is_unanswered(answer):
        return unanswered()
    with np.errstate(all="ignore"):
        empty = attempt(update, WEIGHTS.copy(), np.zeros(3))
    for returned in (answer, empty):
        if isinstance(returned, Check):
            return returned
    answer, empty = np.asarray(answer), np.asarray(empty)
    if answer.shape != (3,) or empty.shape != (3,) or answer.dtype.kind not in "fiu":
        return hint(f"Three weights go in, three must come out; yours have the shape {answer.shape}.")
    product = WEIGHTS * COUNTS
    wrong = [
        (COUNTS / COUNTS.sum(), "The counts replace the weights: all earlier scans are forgotten. Multiply."),
        (product, f"Right products, but they sum to {product.sum():.0f}. Weights must sum to 1 (Eq. 10)."),
        (
            np.array([0.0, 0.0, 1.0]),
            "One particle has it all: you took exp of the count. Eq. 12 multiplies by the count.",
        ),
        ((WEIGHTS + COUNTS) / (WEIGHTS + COUNTS).sum(), "Weights and counts are multiplied, not added."),
    ]
    for value, words in wrong:
        if np.allclose(answer, value, atol=1e-3):
            return hint(words)
    if not np.allclose(answer, product / product.sum()):
        return hint(
            f"For the counts 10, 20, 40 the weights should be {np.round(product / product.sum(), 3).tolist()}."
        )
    if not np.isfinite(empty).all():
        return hint(
            "If no particle scores, you divide 0 by 0 and the filter is dead. Keep the weights as they were."
        )
    if np.allclose(empty, 1 / 3):
        return hint(
            "A scan that scores nothing makes all weights equal: it wiped out what earlier scans said."
        )
    if not np.allclose(empty, WEIGHTS):
        return hint("A scan that scores nothing says nothing: the weights should come back unchanged.")
    return passed("Products, normalised, and an empty scan changes nothing.")


TRIALS = 400
CLOUD = np.column_stack([np.arange(5.0), 10.0 + np.arange(5.0), 0.1 * np.arange(5.0)])
CLOUD_WEIGHTS = np.array([0.4, 0.3, 0.2, 0.1, 0.0])


def check_resample(resample) -> Check:
    """Whether ``resample(poses, weights, rng)`` draws whole poses by weight and makes the weights equal."""
    rng = np.random.default_rng(0)
    offspring = np.zeros(len(CLOUD))
    for _ in range(TRIALS):
        answer = attempt(resample, CLOUD.copy(), CLOUD_WEIGHTS.copy(), rng)
        if is_unanswered(answer):
            return unanswered()
        if isinstance(answer, Check):
            return answer
        problem = _problem(answer)
        if problem:
            return hint(problem)
        offspring += np.bincount(np.asarray(answer[0])[:, 0].astype(int), minlength=len(CLOUD))
    return _offspring_verdict(offspring / TRIALS)


def _problem(answer) -> str:
    """What is wrong with one returned pair, or nothing."""
    if not (isinstance(answer, tuple | list) and len(answer) == 2):
        return "Return two arrays: the new poses (N, 3) and the new weights (N,)."
    poses, weights = np.asarray(answer[0]), np.asarray(answer[1])
    if poses.shape != CLOUD.shape or weights.shape != CLOUD_WEIGHTS.shape:
        return f"The number of particles must stay {len(CLOUD)}; yours have the shapes {poses.shape}, {weights.shape}."
    known = (poses[:, None, :] == CLOUD).all(axis=2).any(axis=1)
    if not known.all():
        if np.isin(poses, CLOUD).all():
            return (
                "The x of one particle came with the heading of another. Use one index array for whole rows."
            )
        return "Some new poses were none of the old ones. Resampling copies; noise is the next prediction's business."
    if not np.allclose(weights, 1 / len(CLOUD)):
        return (
            "The weights are not 1/N afterwards. A heavy particle now has many copies; with its old weight on each "
            "of them it would be counted twice."
        )
    return ""


def _offspring_verdict(mean: np.ndarray) -> Check:
    """The verdict on the mean number of copies of each particle, which should be N w."""
    expected = len(CLOUD) * CLOUD_WEIGHTS
    found = np.round(mean, 1).tolist()
    if np.allclose(mean, expected, atol=0.25):
        return passed(f"On average {found} copies, expected {np.round(expected, 1).tolist()}.")
    if np.allclose(mean, 1.0, atol=0.25):
        return hint(
            f"All particles get about as many copies, {found}: the weights play no part in your draw."
        )
    if mean[0] > 0.99 * len(CLOUD):
        return hint(
            "Only the heaviest particle survives. Then the cloud has one opinion, and N_eff = 1 was no worse."
        )
    return hint(
        f"Particle i should get N w_i copies on average, {np.round(expected, 1).tolist()}; yours get {found}."
    )


MEAN_POSES = np.array(
    [[1.0, 0.0, np.deg2rad(170.0)], [2.0, 1.0, np.deg2rad(-170.0)], [4.0, 0.0, np.deg2rad(-160.0)]]
)
MEAN_WEIGHTS = np.array([0.5, 0.3, 0.2])


def check_mean_pose(mean_pose) -> Check:
    """Whether ``mean_pose(poses, weights)`` weighs, and averages headings on the circle."""
    answer = attempt(mean_pose, MEAN_POSES.copy(), MEAN_WEIGHTS.copy())
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    answer = np.asarray(answer)
    if answer.shape != (3,) or answer.dtype.kind not in "fiu":
        return hint(f"One pose (x, y, heading) is asked for, shape (3,); yours has the shape {answer.shape}.")
    position = MEAN_WEIGHTS @ MEAN_POSES[:, :2]
    sine, cosine = MEAN_WEIGHTS @ np.sin(MEAN_POSES[:, 2]), MEAN_WEIGHTS @ np.cos(MEAN_POSES[:, 2])
    if np.allclose(answer[:2], MEAN_POSES[:, :2].mean(axis=0)):
        return hint("The weights play no part: that is the mean of a cloud in which all weigh the same.")
    if np.allclose(answer, MEAN_POSES[0]):
        return hint(
            "That is the heaviest particle. It changes from scan to scan by chance; the mean uses all of them."
        )
    if np.isclose(answer[2], MEAN_WEIGHTS @ MEAN_POSES[:, 2]):
        return hint(f"All three look towards 180 degrees, your mean towards {np.rad2deg(answer[2]):.0f}. Angles are no "
                    "numbers on a line: average their sines and cosines.")  # fmt: skip
    if np.isclose(answer[2], np.arctan2(cosine, sine)):
        return hint("arctan2 takes the sine first, then the cosine.")
    if not np.allclose(answer[:2], position):
        return hint(
            f"The position should be {np.round(position, 2).tolist()}; yours is {np.round(answer[:2], 2).tolist()}."
        )
    if not np.isclose(np.cos(answer[2] - np.arctan2(sine, cosine)), 1.0):
        return hint(f"The heading should be {np.rad2deg(np.arctan2(sine, cosine)):.0f} degrees; yours is "
                    f"{np.rad2deg(answer[2]):.0f}.")  # fmt: skip
    return passed(f"Towards {np.rad2deg(answer[2]):.0f} degrees, between all three.")
