"""Chapter 05, the check of the whole filter: it names the part that is wrong, or what the loop leaves out.

The loop is tried on one scan at a time. A mistake is the right loop with something else in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pfslam.io.datasets import load
from pfslam_book.ch05.your_filter import (
    BOOK,
    CHAPTERS,
    Filter,
    Settings,
    drive,
    error,
    mean_pose,
    resample,
    step,
)
from pfslam_book.exercises import ch00, ch02, ch04, ch05
from pfslam_book.show.checks import Check, attempt, hint, is_unanswered, passed, unanswered
from pfslam_book.show.exercise import Exercise

COMB = Filter(**BOOK | {"resample": lambda p, w, rng: resample(p, w, np.random.default_rng(1))})
ROOM = Settings(resample_below=0.0, origin=(-6.0, -6.0), shape=(280, 320), lidar_xy=(0.6, 0.35), clamp=4.0)
INPUTS = ((1.2, 0.9, 0.1), (0.8, 1.4, 0.2), (1.5, 0.0, 0.1), (1.0, 0.7, 0.15))


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


def spoiled(parts=lambda s: {}, settings=lambda s, weights: {}, inputs=list, log_odds=np.copy) -> Callable:
    """The loop with other parts, settings or inputs, or another map, which make of it what a mistake does."""

    def loop(f, s, poses, weights, walls, points_b, controls, rng):
        f, changed = Filter(**vars(f) | parts(s)), replace(s, **settings(s, weights))
        return step(f, changed, poses, weights, log_odds(walls), points_b, inputs(controls), rng)

    return loop


def stage(seen: Callable, cases: Sequence[tuple], mistakes: dict, **rest) -> Exercise:
    """An exercise on what is seen of a loop."""
    wrong = {words: seen(spoiled(**change)) for words, change in mistakes.items()}
    return Exercise(right=seen(step), cases=cases, mistakes=wrong, **rest)


def summed(inputs) -> list:
    """All inputs as a single one of the same length in time."""
    v, omega, dt = np.reshape(inputs, (-1, 3)).T
    return [(v @ dt / dt.sum(), omega @ dt / dt.sum(), dt.sum())] if len(dt) else []


def seen_predict(theirs):
    """Mean and spread of the cloud after a drive."""

    def cloud_after(sigma_v, sigma_omega, inputs=INPUTS):
        poses = one_scan(theirs, 400, inputs, empty=True, sigma_v=sigma_v, sigma_omega=sigma_omega)[0]
        return np.concatenate([np.mean(poses, axis=0), np.std(poses, axis=0)])

    return cloud_after


predicts = stage(
    seen_predict,
    [(0.0, 0.0), (0.9, 0.0), (0.2, 0.8)],
    same=lambda found, expected: (
        np.allclose(found[:3], expected[:3], atol=0.03)
        and np.allclose(found[3:], expected[3:], atol=0.005, rtol=0.15)
    ),
    mistakes={
        "The robot drove on and your cloud stayed: predict first, input by input.": {"inputs": lambda u: []},
        "You drive one long way by the mean of the inputs. On it the noise does not average out, and a curve is no "
        "chord: move the cloud input by input.": {"inputs": summed},
        "All particles drive alike: give s.sigma_v and s.sigma_omega to `move`, or there is nothing to choose from.": {
            "settings": lambda s, w: {"sigma_v": 0.0, "sigma_omega": 0.0}
        },
        "Only the last input moves your cloud: the poses of one turn of the loop must go into the next.": {
            "inputs": lambda u: u[-1:]
        },
    },
)


def seen_resample(theirs):
    """Whether particles are repeated, and N times the greatest weight."""

    def cloud_after(resample_below):
        poses, weights, *_ = one_scan(theirs, 20, empty=True, resample_below=resample_below)
        return np.array([len(np.unique(poses, axis=0)) < 20, 20 * np.max(weights)], dtype=float)

    return cloud_after


def upside_down(s, weights):
    n_eff = 1 / np.sum(weights**2)
    return {"resample_below": float(n_eff > s.resample_below * len(weights))}


resamples = stage(
    seen_resample,
    [(0.2,), (0.99,)],
    mistakes={
        "Your cloud is never resampled, even where N_eff is below the threshold: particles die out one by one.": {
            "settings": lambda s, w: {"resample_below": 0.0}
        },
        "Your cloud is resampled although N_eff is above the threshold. N_eff is 1 over the sum of the *squares*.": {
            "settings": lambda s, w: {"resample_below": 1.0}
        },
        "You resample where many particles count, and not where few do.": {"settings": upside_down},
        "After resampling the weights are still unequal: take the new weights as well as the new poses.": {
            "parts": lambda s: {"resample": lambda p, w, rng: (COMB.resample(p, w, rng)[0], w)}
        },
    },
)


def seen_weigh(theirs):
    return lambda sharpness: np.asarray(one_scan(theirs, sharpness=sharpness)[1], dtype=float)


weighs = stage(
    seen_weigh,
    [(3.0,), (8.0,)],
    mistakes={
        "The scan leaves the weights as they were: score each particle, and multiply its weight by the likelihood.": {
            "parts": lambda s: {"update": lambda w, likelihood: w}
        },
        "The old weights are forgotten: multiply them by the likelihood of this scan.": {
            "parts": lambda s: {"update": lambda w, likelihood: likelihood / likelihood.sum()}
        },
        "You take the count for the likelihood, and it is too flat: exp(s.sharpness * count / M).": {
            "parts": lambda s: {"count_on_walls": lambda points, *grid: (
                len(points) * np.log(BOOK["count_on_walls"](points, *grid)) / s.sharpness
            )}
        },
        "The sharpness is that of a whole scan, and you give it to every beam: divide the count by the number of "
        "points.": {"settings": lambda s, w: {"sharpness": s.sharpness * len(room()[0])}},
        "You count unknown cells as walls. Walls are where log_odds > 0.": {"log_odds": lambda known: known + 1e-9},
    },
)  # fmt: skip


def seen_estimate(theirs):
    return lambda sharpness, resample_below: np.asarray(
        one_scan(theirs, sharpness=sharpness, resample_below=resample_below)[3], dtype=float
    )


def after_resampling(s):
    return {"mean_pose": lambda p, w: mean_pose(*(COMB.resample(p, w, None) if s.resample_below else (p, w)))}


estimates = stage(
    seen_estimate,
    [(9.0, 0.0), (9.0, 1.0)],
    same=lambda found, expected: np.abs(found - expected).max() < 5e-4,
    mistakes={
        "You take the estimate after resampling, which adds chance to it. Take it before.": {
            "parts": after_resampling
        },
        "You take the estimate before the scan has weighed the particles. Take it after.": {
            "parts": lambda s: {"update": lambda w, likelihood: w}
        },
        "Your estimate is the heaviest particle, and not the mean of the cloud.": {
            "parts": lambda s: {"mean_pose": lambda p, w: p[np.argmax(w)]}
        },
        "Your estimate is the mean of the particles without their weights.": {
            "parts": lambda s: {"mean_pose": lambda p, w: mean_pose(p, np.full(len(w), 1 / len(w)))}
        },
    },
)


def seen_draw(theirs):
    return lambda hit, free: np.asarray(one_scan(theirs, hit=hit, free=free)[2], dtype=float)


draws = stage(
    seen_draw,
    [(1.3, 0.4), (0.9, 0.2)],
    same=lambda found, expected: np.count_nonzero(np.abs(found - expected) > 1e-3) < 100,
    mistakes={
        "The map stays as it was: draw the scan into it from the estimate.": {
            "parts": lambda s: {"update_log_odds": lambda log_odds, *scan: log_odds}
        },
        "No cell is ever cleared: the cells that the beams crossed are free.": {
            "settings": lambda s, w: {"free": 0.0}
        },
        "Your beams begin at the robot's centre. They begin where the LiDAR is: s.lidar_xy, brought to the world.": {
            "settings": lambda s, w: {"lidar_xy": (0.0, 0.0)}
        },
        "The old map is gone: change it where the scan says something, and keep the rest.": {
            "parts": lambda s: {"update_log_odds": lambda m, *scan: BOOK["update_log_odds"](0 * m, *scan)}
        },
        "The scan is drawn as if the robot had never moved: bring its points to the world by the estimate.": {
            "parts": lambda s: {"mean_pose": lambda p, w: np.zeros(3)}
        },
    },
)

LOOP = {
    seen_predict: predicts,
    seen_resample: resamples,
    seen_weigh: weighs,
    seen_estimate: estimates,
    seen_draw: draws,
}
PARTS: dict[str, Callable] = {
    "scan_points": ch00.check_scan_points,
    "to_world": ch00.check_to_world,
    "cell_of": ch02.check_cell_of,
    "crossed_cells": ch02.check_crossed_cells,
    "update_log_odds": ch02.check_update_log_odds,
    "move": lambda move: predicts(seen_predict(spoiled(parts=lambda s: {"move": move}))),
    "count_on_walls": ch04.check_count_on_walls,
    "update": ch05.check_update,
    "resample": ch05.check_resample,
    "mean_pose": ch05.check_mean_pose,
}


def check_filter(theirs: Callable, f: Filter) -> Check:
    """Whether a filter of the parts ``f`` and the loop ``theirs`` follows the robot; if not, what is wrong with it."""
    answer = attempt(one_scan, theirs)
    if is_unanswered(answer):
        return unanswered()
    for name, check in PARTS.items():
        if not (verdict := check(getattr(f, name))):
            words = verdict.message.removeprefix("Not yet. ")
            return hint(f"The part `{name}` of chapter {CHAPTERS[name]} is wrong. {words}")
    if isinstance(answer, Check):
        return answer
    if [np.shape(part) for part in answer] != [np.shape(part) for part in one_scan(step)]:
        return hint("Return four things: poses, weights, log_odds and the estimate, in this order.")
    for seen, check in LOOP.items():
        if not (verdict := check(seen(theirs))):
            return verdict
    hall = load("hall")
    off = error(drive(theirs, f, hall, particles=40, seconds=40.0), hall).ate_rmse_m
    if not off <= 0.1:
        return hint(
            f"Each step of your loop is right by itself, and yet the robot is {off:.2f} m off after 40 s."
        )
    return passed(f"Your own filter, {off:.2f} m (RMS) off on 40 s of hall.")
