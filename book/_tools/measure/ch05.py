"""Chapter 05: the reader's filter, as it is printed and harmed, in other buildings, and what no filter could know."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from pfslam_book.your_filter import drive, error, my_filter, step

from measure import cases
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import LOG_4
from pfslam.io.datasets import load
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.settings import changed
from pfslam.simulator import simulate
from pfslam.study import Case, Study

WHOLE = 1e9
"""Seconds that no drive lasts."""
CHANGES: dict[str, dict] = {
    "as printed": {},
    "half the noise": {"sigma_v": 0.1, "sigma_omega": 0.05},
    "full clearing": {"free": LOG_4},
    "never resampled": {"resample_below": 0.0},
}
"""Ways to harm the filter on purpose, as settings of `drive`."""
FEW = ["20/20", "20/10", "40/100", "40/60", "80/100"]
"""Every how many-th scan, and how many particles: what exercise 5 asks about."""
SCALE = 1.031
"""What chapter 01 finds: the factor that puts the gyro of hall right."""


def run(case: Case, recording: Recording) -> dict[str, Any]:
    """Run the first ``seconds``; the whole drive is run with more particles and more scans.

    The error of dead reckoning at the same scans stands beside the filter's.
    """
    settings = dict(CHANGES[case.get("change", "as printed")], seed=case.get("seed"))
    if case.get("seconds") == WHOLE:
        settings |= {"particles": 200, "every": 10, "seconds": WHOLE}
    driven = drive(step, my_filter("none"), recording, **settings)
    t = driven.trajectory.t
    reckoned = Trajectory(t, dead_reckoning(recording).at(t))
    return {
        "ate_rmse_m": error(driven, recording).ate_rmse_m,
        "odometry_ate_rmse_m": trajectory_error(reckoned, recording.true_path()).ate_rmse_m,
    }


def errors(case: Case) -> dict[str, Any]:
    """Run it on hall."""
    return {"ate_rmse_m": run(case, load("hall"))["ate_rmse_m"]}


def put_right(case: Case) -> dict[str, Any]:
    """Run it on hall with the scale of the gyro put right."""
    hall = load("hall")
    return run(case, replace(hall, robot=changed(hall.robot, {"imu.gyro_scale": SCALE})))


@lru_cache(maxsize=1)
def building(kind: str, seed: int) -> Recording:
    """A drive through another building; each process keeps the last one."""
    return replace(simulate(kind, seed).recording, camera=None)


def elsewhere(case: Case) -> dict[str, Any]:
    """Run it in another building."""
    return run(case, building(case.label, case.get("building")))


def few(case: Case) -> dict[str, Any]:
    """Run the printed filter on the first 65 s with few particles, or few scans."""
    every, particles = map(int, case.label.split("/"))
    hall = load("hall")
    driven = drive(step, my_filter("none"), hall, particles, every, seed=case.get("seed"))
    return {"ate_rmse_m": error(driven, hall).ate_rmse_m}


# ---- fifteen cells without particles

SLIP, DOORS = (0.05, 0.9, 0.05), (1, 4, 10)
MAPS = np.insert(np.arange(2**14) >> np.arange(14)[:, None] & 1, 0, 0, axis=0)
"""All maps (15, 2^14): 1 where a cell has a door, which the entrance has not."""


def exactly(case: Case) -> dict[str, Any]:
    """Follow the probability of every combination of cell and map through the walk of a seed.

    It is the chapter's ``walk`` with the belief itself in the place of particles: the weight on the true cell in the
    end, and whether all doors are right where a door is taken to be what is likelier than not.
    """
    world, true = np.random.default_rng([case.get("seed"), 0]), 0
    belief = np.zeros(MAPS.shape)
    belief[0] = np.where(MAPS[1:], 0.3, 0.7).prod(axis=0)
    for move in range(45):
        if move > 0:
            true = (true + world.choice(3, p=SLIP)) % 15
            belief = sum(p * np.roll(belief, n, axis=0) for n, p in enumerate(SLIP))
        sees = world.random() < (0.95 if true in DOORS else 0.05)
        entrance = np.where((np.arange(15) == 0) == (true == 0), 0.98, 0.02)
        belief = belief * np.where(sees == MAPS, 0.95, 0.05) * entrance[:, None]
        belief /= belief.sum()
    agreed = np.flatnonzero(MAPS @ belief.sum(axis=0) > 0.5)
    return {"on_true_cell": belief[true].sum(), "map_right": float(tuple(agreed) == DOORS)}


STUDIES = [
    Study(
        "ch05_your_filter",
        "The printed filter on hall, as it is and harmed: on its first 65 s, and on the whole drive.",
        cases("change", change=CHANGES, seconds=[65], seed=range(10))
        + cases("change", change=CHANGES, seconds=[WHOLE], seed=range(5)),
        run=errors,
    ),
    Study(
        "ch05_gyro",
        "The printed filter and half its noise on hall with the scale of the gyro put right.",
        cases("change", change=list(CHANGES)[:2], seconds=[65], seed=range(10))
        + cases("change", change=list(CHANGES)[:2], seconds=[WHOLE], seed=range(5)),
        run=put_right,
    ),
    Study(
        "ch05_buildings",
        "The printed filter in eight other buildings, with level floors and with slopes.",
        cases("kind", kind=["hall", "ramp"], building=range(1, 9), seconds=[65], seed=range(3))
        + cases("kind", kind=["hall", "ramp"], building=range(1, 9), seconds=[WHOLE], seed=[0]),
        run=elsewhere,
    ),
    Study(
        "ch05_few_particles",
        "How few particles and scans are enough for the printed filter, on the first 65 s of hall.",
        cases("few", few=FEW, seed=range(5)),
        run=few,
    ),
    Study(
        "ch05_exactly",
        "A hundred walks through fifteen cells with unknown doors, followed exactly.",
        cases("exactly", seed=range(100)),
        run=exactly,
    ),
]
