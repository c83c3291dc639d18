"""Chapter 05, the check of the whole filter: it drives any loop, scores it, and says what it does otherwise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np

from pfslam.io.datasets import load
from pfslam.recording import Recording
from pfslam.simulator import simulate
from pfslam_book.exercises import ch00, ch01, ch02, ch04, ch05
from pfslam_book.show.checks import Check, attempt, hint, is_unanswered, passed, unanswered
from pfslam_book.your_filter import (
    BOOK,
    CHAPTERS,
    Filter,
    Settings,
    drive,
    error,
    resample,
    step,
)

COMB = Filter(**BOOK | {"resample": lambda p, w, rng: resample(p, w, np.random.default_rng(1))})
ROOM = Settings(resample_below=0.0, origin=(-6.0, -6.0), shape=(280, 320), lidar_xy=(0.6, 0.35), clamp=4.0)
INPUTS = ((1.2, 0.9, 0.1), (0.8, 1.4, 0.2), (1.5, 0.0, 0.1), (1.0, 0.7, 0.15))


GOOD = 0.1
"""A filter that works stays below this error (m, RMS), on the drives of the check."""


def room() -> tuple[np.ndarray, np.ndarray]:
    """Points (M, 2) of a scan in a room of 9 by 6 m, and its map: walls, free cells within, unknown ones around."""
    t = np.linspace(0.0, 1.0, 60)[:, None]
    corners = np.array([[-3.0, -2.0], [6.0, -2.0], [6.0, 4.0], [-3.0, 4.0], [-3.0, -2.0]]) + 0.013
    points, log_odds = np.concatenate([a + t * (b - a) for a, b in pairwise(corners)]), np.zeros(ROOM.shape)
    rows, columns = BOOK["cell_of"](points, ROOM.origin, ROOM.resolution).T
    log_odds[81:200, 61:240] = -1.0
    log_odds[rows, columns] = 2.0
    return points, log_odds


def one_scan(theirs: Callable, n: int = 12, inputs=(), empty: bool = False, **changes):
    """What a loop returns for one scan in the room, from a cloud with unequal weights."""
    rng, (points, log_odds) = np.random.default_rng(3), room()
    poses = rng.normal(0.0, [0.04, 0.04, 0.01], (n, 3))
    weights, s = rng.dirichlet(np.full(n, 2.0)), replace(ROOM, **changes)
    return theirs(COMB, s, poses, weights, 0 * log_odds if empty else log_odds, points, list(inputs), rng)


def cloud_after(loop: Callable, **noise) -> np.ndarray:
    """Mean and spread of the cloud after a drive."""
    poses = one_scan(loop, 400, INPUTS, empty=True, **noise)[0]
    return np.concatenate([np.mean(poses, axis=0), np.std(poses, axis=0)])


def resampled(loop: Callable, below: float) -> np.ndarray:
    """Whether particles are repeated, and N times the greatest weight."""
    poses, weights, *_ = one_scan(loop, 20, empty=True, resample_below=below)
    return np.array([len(np.unique(poses, axis=0)) < 20, 20 * np.max(weights)], dtype=float)


def weighed(loop: Callable, sharpness: float) -> np.ndarray:
    """The weights after a scan. If a loop resamples here, the check of resampling finds it."""
    weights = np.asarray(one_scan(loop, sharpness=sharpness)[1], dtype=float)
    return weights if np.ptp(weights) > 1e-12 else weighed(step, sharpness)


def output(number: int) -> Callable:
    """One of the four things that a loop returns, as numbers."""
    return lambda loop, **changes: np.asarray(one_scan(loop, **changes)[number], dtype=float)


def on_the_far_side(loop: Callable, **corner) -> np.ndarray:
    """Whether a loop draws right of the room when the map ends before the wall on its left."""
    answer = attempt(lambda: one_scan(loop, empty=True, **corner))
    drawn = np.asarray(answer[2]) if isinstance(answer, tuple | list) else np.zeros(ROOM.shape)
    return drawn[:, 160:].any(keepdims=True).astype(float)


STEPS: tuple[tuple[str, Callable, list[dict], dict], ...] = (
    ("**Predict**: there, every particle drives by each input, one after the other, with noise of its own.",
     cloud_after, [{"sigma_v": 0.0, "sigma_omega": 0.0}, {"sigma_v": 0.9, "sigma_omega": 0.0},
     {"sigma_v": 0.2, "sigma_omega": 0.8}], {"atol": 0.03}),
    ("**Weigh**: there, the new weight is the old one times exp(s.sharpness * share), where share is a particle's "
     "count on walls over the number of points, and walls are where log_odds > 0.", weighed,
     [{"sharpness": 3.0}, {"sharpness": 8.0}], {"rtol": 5e-4}),
    ("**Resample**: there, new poses and new weights come if 1 over the sum of the squared weights is at most "
     "s.resample_below times their number, and only then.", resampled, [{"below": 0.2}, {"below": 0.99}], {}),
    ("**Estimate**: there, it is the weighted mean of the cloud, after the scan has weighed it and before resampling.",
     output(3), [{"sharpness": 9.0, "resample_below": below} for below in (0.0, 1.0)], {"atol": 5e-4}),
    ("**Draw**: there, the beams of the estimate change the old map, in cells of s.resolution. They begin at the LiDAR "
     "(s.lidar_xy), and clear the cells on their way.", output(2),
     [{"hit": 1.3, "free": 0.4}, {"hit": 0.9, "free": 0.2, "resolution": 0.08}], {"cells": 100}),
    ("**Draw**: there, the loop stops when a scan leaves the map. Yours puts what lies left of the map on its right "
     "side, because NumPy takes column -3 for the third from the end.", on_the_far_side,
     [{"origin": (-1.0, -6.0)}], {}),
)  # fmt: skip
"""What the printed loop does, what shows it, the settings under which it is tried, and how near is near enough."""


def alike(found: np.ndarray, expected: np.ndarray, rtol=0.0, atol=1e-6, cells=0) -> bool:
    """Whether two answers agree; of a map, so many ``cells`` may differ."""
    return bool(np.sum(~np.isclose(found, expected, rtol=rtol, atol=1e-3 if cells else atol)) <= cells)


def differences(theirs: Callable) -> list[str]:
    """What a loop seems to do otherwise than the printed one, step by step, in words. None of it need be wrong."""

    def same(seen, near, changes) -> bool:
        return attempt(lambda: alike(seen(theirs, **changes), seen(step, **changes), **near)) is True

    return [words for words, seen, settings, near in STEPS if not all(same(seen, near, s) for s in settings)]


def drives_like_the_books(move: Callable) -> Check:
    """Whether a part ``move`` predicts as it should."""
    other = differences(lambda f, *rest: step(Filter(**vars(f) | {"move": move}), *rest))
    return hint("It does not predict as Eq. 11 does.") if other else passed()


PARTS: dict[str, Callable] = {
    "scan_points": ch00.check_scan_points,
    "to_world": ch00.check_to_world,
    "inputs_between": ch01.check_inputs_between,
    "cell_of": ch02.check_cell_of,
    "crossed_cells": ch02.check_crossed_cells,
    "update_log_odds": ch02.check_update_log_odds,
    "move": drives_like_the_books,
    "count_on_walls": ch04.check_count_on_walls,
    "update": ch05.check_update,
    "resample": ch05.check_fair,
    "mean_pose": ch05.check_mean_pose,
}


@cache
def buildings() -> dict[str, Recording]:
    """The drives of the check: the built-in one, and one in another building of the same kind."""
    return {"hall": load("hall"), "another building": simulate("hall", seed=1).recording}


def scores(theirs: Callable, f: Filter) -> dict[str, float]:
    """The worst error (m, RMS) of a filter over three seeds, on the first 40 s of each drive.

    With every fourth beam and cells of 10 cm the same loops pass as with all beams and 5 cm, in half the time.
    """
    coarse = {"resolution": 0.1, "shape": (600, 600)}

    def loop(f, s, poses, weights, log_odds, points_b, *rest):
        return theirs(f, s, poses, weights, log_odds, points_b[::4], *rest)

    def off(recording: Recording, seed: int) -> float:
        return error(drive(loop, f, recording, 40, seconds=40.0, seed=seed, **coarse), recording).ate_rmse_m

    return {name: float(np.max([off(r, seed) for seed in range(3)])) for name, r in buildings().items()}


def is_whole(answer) -> bool:
    """Whether a loop returns poses (n, 3), weights (n,), a map of the old size and a pose."""
    shapes = [np.shape(part) for part in answer] if isinstance(answer, tuple | list) else []
    return len(shapes) == 4 and shapes == [(*shapes[1], 3), shapes[1], ROOM.shape, (3,)]


def check_filter(theirs: Callable, f: Filter) -> Check:
    """Whether a filter of the parts ``f`` and the loop ``theirs`` follows the robot, whatever way it goes about it."""
    answer = attempt(one_scan, theirs)
    if is_unanswered(answer):
        return unanswered()
    for name, check in PARTS.items():
        # the book's own are right
        if (part := getattr(f, name)) is not BOOK[name] and not (verdict := check(part)):
            words = verdict.message.removeprefix("Not yet. ")
            return hint(f"The part `{name}` of chapter {CHAPTERS[name]} is wrong. {words}")
    if isinstance(answer, Check):
        return answer
    if not is_whole(answer):
        return hint("Return four things: poses, weights, log_odds and the estimate, in this order.")
    found, other = attempt(scores, theirs, f), " ".join(differences(theirs))
    other = f" It seems to differ from the printed loop. {other}" if other else ""
    if isinstance(found, Check):
        return replace(found, message=found.message + other)
    score = " and ".join(f"{off:.2f} m in {name}" for name, off in found.items())
    score += " (RMS over 40 s, the worst of three seeds)."
    if all(off <= GOOD for off in found.values()):
        return passed(f"Your own filter follows the robot: {score}{other}")
    return hint(f"Your filter loses the robot: {score} One that works stays below {GOOD:.2f} m.{other}")
