"""The public Intel log under several methods, judged by its relations; a few paths and maps are kept for the book.

The log itself is never stored. It is ``intel/intel.log`` in ``$PFSLAM_DATA``, with ``intel.relations`` beside it.
``python -m measure.intel``, in ``book/_tools``, keeps the paths and maps.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from pfslam_book.show.intel import KEPT, RETURN_SECONDS, kept_file

import pfslam
from measure import cases
from pfslam.evaluation.trajectory import relations_error
from pfslam.grid import OccupancyGrid
from pfslam.io.datasets import data_folder
from pfslam.io.formats import Relations, read_relations
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam.study import Case, Study

METHODS = {
    "scan matching": SlamConfig.matching(),
    "refined, 200 particles": SlamConfig.refined(),
    "refined, 50 particles": replace(SlamConfig.refined(), particles=50),
    "report": replace(SlamConfig.report(), particles=50),
}
ODOMETRY = "dead reckoning"
SHORT = 10.0
"""A relation is short if its two poses are less than so many seconds apart."""


def intel_log() -> tuple[Recording, Relations]:
    """The log, and the relations by which it can be judged."""
    folder = data_folder() / "intel"
    log = pfslam.load(folder / "intel.log")
    return log, read_relations(folder / "intel.relations").at_stamps(log.scans().t)


def run(method: str, seed: int, log: Recording) -> tuple[Trajectory, OccupancyGrid | None]:
    """Run one method with every scan; return its path, and its map if it has any."""
    if method == ODOMETRY:
        t = log.scans().t
        return Trajectory(t, dead_reckoning(log).at(t)), None
    config, rng = replace(METHODS[method], every=1), np.random.default_rng(seed)
    result = run_slam(log, config, rng=rng, keep_particles=False)
    return result.trajectory, result.grid


def errors(case: Case) -> dict[str, Any]:
    """Mean error over all usable relations, and mean and worst over those between visits far apart in time."""
    log, relations = intel_log()
    path, _ = run(case.label, case.get("seed"), log)
    metres, radians = relations_error(path, relations.t1, relations.t2, relations.poses)
    away, step = np.abs(relations.t2 - relations.t1), np.hypot(*relations.poses[:, :2].T)
    back = away > RETURN_SECONDS
    return {
        "relations": len(read_relations(data_folder() / "intel" / "intel.relations").t1),
        "usable": len(away),
        "returns": int(np.count_nonzero(back)),
        "short": int(np.count_nonzero(away < SHORT)),
        "short_median_m": np.median(step[away < SHORT]),
        "all_m": metres.mean(),
        "all_deg": np.rad2deg(radians.mean()),
        "returns_m": metres[back].mean(),
        "returns_worst_m": metres[back].max(),
        "returns_deg": np.rad2deg(radians[back].mean()),
    }


STUDIES = [
    Study(
        "intel",
        "The Intel log, raw odometry and every scan: four filters, judged by its relations.",
        cases("method", method=[ODOMETRY, "scan matching"], seed=[0])
        + cases("method", method=list(METHODS)[1:], seed=range(10)),
        run=errors,
    )
]


def keep(method: str, log: Recording) -> None:
    """Store the path and the map of the first run of a method."""
    (path, grid), arrays = run(method, 0, log), {}
    if grid is not None:
        corner = np.array([*grid.spec.origin, grid.spec.resolution])
        arrays = {"map": np.sign(grid.log_odds).astype(np.int8), "corner": corner}
    np.savez_compressed(kept_file(method), t=path.t, path=path.poses.astype(np.float32), **arrays)


if __name__ == "__main__":
    for shown in KEPT:
        keep(shown, intel_log()[0])
