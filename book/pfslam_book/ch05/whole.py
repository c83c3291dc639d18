"""Chapter 05, the check of the whole filter: it names the part that is wrong, or what the loop leaves out."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from pfslam.io.datasets import load
from pfslam_book.ch05.your_filter import BOOK, CHAPTERS, Filter, Settings, drive, error
from pfslam_book.exercises.ch05 import check_mean_pose, check_resample, check_update
from pfslam_book.show.checks import (
    Check,
    answer_to,
    attempt,
    compare,
    hint,
    passed,
    same_poses,
    unanswered,
)

SECONDS, PARTICLES, GOOD_ENOUGH = 45.0, 40, 0.2
"""The drive of the check, and the error (m, RMS) above which the robot counts as lost."""


def check_filter(step: Callable, f: Filter) -> Check:
    """Whether a filter of the parts ``f`` and the loop ``step`` follows the robot; if not, which part is wrong."""
    answer = attempt(step, *_one_call(Filter(**BOOK)))
    if answer is ...:
        return unanswered()
    for name in CHAPTERS:
        verdict = PROBES[name](getattr(f, name))
        if not verdict:
            words = verdict.message.removeprefix("Not yet. ")
            return hint(f"The part `{name}` of chapter {CHAPTERS[name]} is wrong. {words}")
    return attempt(_whole, step, f)


def _whole(step: Callable, f: Filter) -> Check:
    """The verdict on the loop, one step at a time and then on a drive."""
    verdict = _loop(step, f)
    if not verdict:
        return verdict
    hall = load("hall")
    off = error(drive(step, f, hall, particles=PARTICLES, seconds=SECONDS), hall).ate_rmse_m
    if not off <= GOOD_ENOUGH:
        return hint(f"Every part is right, and yet the robot is off by {off:.2f} m after {SECONDS:.0f} s. Look at the "
                    "order of your loop: predict, weigh, estimate, resample, draw.")  # fmt: skip
    return passed(f"Your own filter, {off:.2f} m (RMS) off on {SECONDS:.0f} s of hall.")


# ---- one probe for each part, on what it meets in a drive


def _cases(make: Callable[[np.random.Generator], tuple]) -> list[tuple]:
    return [make(np.random.default_rng(seed)) for seed in (1, 2)]


def _scan(rng: np.random.Generator) -> tuple:
    ranges = np.where(
        rng.random(50) < 0.2, rng.choice([0.0, np.inf, np.nan, 40.0], 50), rng.uniform(0.5, 20, 50)
    )
    return ranges, rng.uniform(-2.3, 2.3, 50), np.array([0.13, 0.02])


def _move(theirs: Callable) -> Check:
    """Without noise the step of the book; with noise its spread, in speed and turning apart."""
    start = np.tile([2.0, -1.0, 0.4], (4000, 1))
    verdict = compare(
        lambda p, v, w: theirs(p, v, w, 0.1, 0.0, 0.0, np.random.default_rng(0)),
        lambda p, v, w: BOOK["move"](p, v, w, 0.1, 0.0, 0.0, np.random.default_rng(0)),
        [(start[:3], 0.7, -0.4), (start[:3], 1.3, 0.9)],
        same=same_poses,
    )
    if not verdict:
        return verdict
    ways = [f(start, 0.7, -0.4, 0.1, 0.3, 0.5, np.random.default_rng(1)) for f in (theirs, BOOK["move"])]
    found, wanted = (np.cov(np.transpose(np.asarray(poses, dtype=float))) for poses in ways)
    if not np.allclose(found, wanted, atol=0.15 * np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))):
        return hint(
            "Its cloud has not the spread of Eq. 11: two independent noises, one number for each particle."
        )
    return passed()


def _grid_case(rng: np.random.Generator) -> tuple:
    occupied = rng.random((20, 30)) < 0.4
    return rng.uniform(-1.6, 2.6, (60, 2)), occupied, (-1.0, -0.5), 0.1


def _update_case(rng: np.random.Generator) -> tuple:
    hits, free = rng.integers(0, 12, (30, 2)), rng.integers(0, 12, (80, 2))
    return rng.normal(0, 4, (12, 12)).clip(-5, 5), hits, free, 1.4, 0.2, 5.0


PROBES: dict[str, Callable[[Callable], Check]] = {
    "scan_points": lambda theirs: compare(theirs, BOOK["scan_points"], _cases(_scan)),
    "to_world": lambda theirs: compare(
        theirs, BOOK["to_world"], _cases(lambda rng: (rng.uniform(-3, 3, 3), rng.uniform(-9, 9, (20, 2))))
    ),
    "cell_of": lambda theirs: compare(
        theirs, BOOK["cell_of"], _cases(lambda rng: (rng.uniform(-9, 9, (40, 2)), (-2.2, 1.3), 0.07))
    ),
    "update_log_odds": lambda theirs: compare(theirs, BOOK["update_log_odds"], _cases(_update_case)),
    "move": _move,
    "count_on_walls": lambda theirs: compare(theirs, BOOK["count_on_walls"], _cases(_grid_case)),
    "update": check_update,
    "resample": check_resample,
    "mean_pose": check_mean_pose,
}


# ---- the loop

FAR = slice(0, 9), slice(0, 9)
"""Cells of an older part of the map, far from the room of the check."""


def _room(s: Settings) -> tuple[np.ndarray, np.ndarray]:
    """Points (M, 2) of a scan in a room of 9 by 6 m and its map: walls, free cells, and a place far away."""
    t = np.linspace(0.0, 1.0, 200)[:, None]
    corners = np.array([[-3.0, -2.0], [6.0, -2.0], [6.0, 4.0], [-3.0, 4.0], [-3.0, -2.0]]) + 0.013
    points = np.concatenate([a + t * (b - a) for a, b in pairwise(corners)])
    rows, columns = BOOK["cell_of"](points, s.origin, s.resolution).T
    log_odds = np.zeros(s.shape)
    log_odds[rows.min() : rows.max(), columns.min() : columns.max()] = -1.0
    log_odds[rows, columns] = 5.0
    log_odds[FAR] = 3.0
    return points, log_odds


def _one_call(f: Filter, n: int = 40, inputs=(), empty: bool = False, **changes) -> tuple:
    """The arguments of one step in the room, for a cloud that is 10 cm wide and heavier on its right."""
    s = Settings(**changes)
    points, log_odds = _room(s)
    rng = np.random.default_rng(0)
    poses = 0.1 * rng.standard_normal((n, 3)) * [1.0, 1.0, 0.1]
    weights = np.exp(8.0 * poses[:, 0])
    log_odds = np.zeros(s.shape) if empty else log_odds
    return f, s, poses, weights / weights.sum(), log_odds, points, list(inputs), rng


def _counts(call: tuple, walls: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """How many points of the scan each particle of a call has on its walls."""
    _, s, poses, _, log_odds, points, *_ = call
    scans, grid = (
        (BOOK["to_world"](pose, points) for pose in poses),
        (walls(log_odds), s.origin, s.resolution),
    )
    return np.array([BOOK["count_on_walls"](scan, *grid) for scan in scans])


def _loop(step: Callable, f: Filter) -> Check:
    """What the loop leaves out, seen in one step at a time."""
    answer = answer_to(step, _one_call(f), "four things")
    if isinstance(answer, Check):
        return answer
    if not (isinstance(answer, tuple | list) and len(answer) == 4):
        return hint("Return four things: poses, weights, log_odds and the estimate.")
    if np.shape(answer[2]) != Settings().shape or np.shape(answer[3]) != (3,):
        return hint(
            "Return poses, weights, log_odds and the estimate, in this order; the map keeps its shape."
        )
    for problem in (_predicts, _weighs, _resamples, _estimates, _draws, _clears):
        words = problem(step, f)
        if words:
            return hint(words)
    return passed()


def _predicts(step: Callable, f: Filter) -> str:
    inputs = [(1.0, 0.2, 0.1)] * 5
    calls = [_one_call(f, empty=True, inputs=drive, resample_below=0.0) for drive in ((), inputs)]
    still, moved = (np.asarray(step(*arguments)[0], dtype=float)[:, 0].mean() for arguments in calls)
    if abs(moved - still) < 0.1:
        return "The robot drove half a metre and your cloud stayed: predict first, control by control."
    if abs(moved - still - 0.5) > 0.15:
        return "The robot drove half a metre ahead and your cloud another way: use every control of the drive, once."
    return ""


def _weighs(step: Callable, f: Filter) -> str:
    call = _one_call(f, sharpness=0.02, resample_below=0.0)
    old, sharpness = np.log(call[3]), call[1].sharpness
    poses, weights = (np.asarray(part, dtype=float) for part in step(*call)[:2])
    if len(np.unique(poses[:, 0])) < len(poses):
        return "Your cloud is resampled at every scan, even where N_eff is above the threshold: that wears out variety."
    if not np.isclose(weights.sum(), 1.0, atol=1e-3):
        return "Your weights do not sum to 1 after weighing: divide by their sum, as `update` does."
    new, counts = np.log(weights + 1e-300), _counts(call, lambda log_odds: log_odds > 0)
    if np.std(new - old) < 1e-6 or np.std(new) < 1e-6:
        return "The scan leaves all weights equal: score each particle, and multiply its weight by the likelihood."
    if np.std(new - sharpness * counts) < 1e-4:
        return "The old weights are forgotten: multiply them by the likelihood of this scan."
    if np.std(new - old - sharpness * _counts(call, lambda log_odds: log_odds != 0)) < 1e-4:
        return "You count every known cell as a wall. Free cells are negative: walls are where log_odds > 0."
    slope = np.polyfit(counts, new - old, 1)[0]
    if slope < 0:
        return "Particles that fit worse weigh more: is there a sign wrong in your likelihood?"
    if slope < 0.5 * sharpness:
        return "The weights are too flat: the likelihood of a scan is exp(sharpness * count), not the count itself."
    if slope > 1.5 * sharpness:
        return "The weights are too sharp: the likelihood of a scan is exp(sharpness * count). Count every point once."
    return ""


def _resamples(step: Callable, f: Filter) -> str:
    poses, weights = step(*_one_call(f, resample_below=1.0))[:2]
    if len(np.unique(np.asarray(poses)[:, 0])) == len(poses):
        return "Your cloud is never resampled, even where N_eff is below the threshold: weights die out one by one."
    if np.ptp(np.asarray(weights, dtype=float)) > 1e-6:
        return "After resampling the weights are not equal: take the new weights as well as the new poses."
    poses = step(*_one_call(f, sharpness=1e-6, resample_below=0.2))[0]
    if len(np.unique(np.asarray(poses)[:, 0])) < len(poses):
        return "Your cloud is resampled where N_eff is above the threshold. N_eff is 1 over the sum of the *squares*."
    return ""


def _estimates(step: Callable, f: Filter) -> str:
    for resample_below in (0.0, 1.0):
        call = _one_call(f, sharpness=0.001, resample_below=resample_below)
        poses, counts = call[2], _counts(call, lambda log_odds: log_odds > 0)
        weights = BOOK["update"](call[3], np.exp(call[1].sharpness * counts))
        if not same_poses(step(*call)[3], BOOK["mean_pose"](poses, weights)):
            return "The estimate is not the mean of the weighted cloud. Take it after weighing and before resampling."
    return ""


def _draws(step: Callable, f: Filter) -> str:
    call = _one_call(f, sharpness=0.001, resample_below=0.0)
    s, before, points = call[1], call[4].copy(), call[5]
    _, _, log_odds, estimate = step(*call)
    if not np.allclose(np.asarray(log_odds)[FAR], before[FAR], atol=1e-3):
        return "The old map is gone: change it where the scan says something, and keep the rest."
    rows, columns = np.nonzero(np.asarray(log_odds) - before > 0.5 * s.hit)
    if len(rows) == 0:
        words = "The map stays empty or as it was: draw the scan into it from the estimate."
        return (
            words
            if np.array_equal(log_odds, before)
            else "No end point is drawn: it is the hits that raise a cell."
        )
    right = BOOK["cell_of"](BOOK["to_world"](estimate, points), s.origin, s.resolution)
    drawn = set(zip(rows.tolist(), columns.tolist(), strict=True))
    if np.mean([tuple(cell) in drawn for cell in right.tolist()]) < 0.9:
        return "The scan is not drawn where the estimate says: bring its points to the world by the estimate."
    return ""


def _clears(step: Callable, f: Filter) -> str:
    s = Settings()
    log_odds = np.asarray(step(*_one_call(f, empty=True, resample_below=0.0))[2])
    if not np.any(log_odds < 0):
        return "No cell is ever cleared: the cells that beams crossed are free."
    if log_odds.max() > 1.5 * s.hit:
        return "The scan is drawn more than once: a cell with a hit rises by s.hit, once a scan."
    if log_odds.min() < -1.5 * s.free:
        return "Free cells lose too much: s.free, once a scan."
    call = _one_call(f, clamp=5.5, resample_below=0.0)
    if np.asarray(step(*call)[2]).max() > 5.6:
        return "The map grows beyond s.clamp: hand the clamp to update_log_odds."
    return ""
