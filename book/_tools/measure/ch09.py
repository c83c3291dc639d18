"""Chapter 09: what scoring on a lattice costs the report's filter."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pfslam_book.show.faults import with_fault

from measure import cases
from pfslam.correlation import Match, best_perturbations
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.io.datasets import load
from pfslam.particles import Particles
from pfslam.run import run_slam
from pfslam.search.lattice import Lattice
from pfslam.slam import SlamConfig
from pfslam.study import Case, Study
from pfslam.study.disturbances import first_seconds


def exactly(grid, points_b, particles, config, rng) -> Match:
    """Every particle scored at its own pose: the map and the scan are shifted so that it comes to lie on a node."""
    lattice, poses, counts = Lattice(grid.spec.resolution, config.yaw_step), [], []
    for pose in particles.poses:
        node = lattice.pose(lattice.nearest(pose[None])[0])
        off = pose - node
        c, s = np.cos(off[2]), np.sin(off[2])
        moved = GridSpec(tuple(np.asarray(grid.spec.origin) - off[:2]), grid.spec.resolution, grid.spec.shape)
        turned = points_b @ np.array([[c, -s], [s, c]]).T
        one = best_perturbations(
            OccupancyGrid(moved, grid.log_odds), turned, Particles.at(node, 1), config, rng
        )
        poses.append(one.particles.poses[0] + off)
        counts.append(one.counts[0])
    return Match(Particles(np.array(poses), particles.log_weights), np.array(counts), len(points_b))


def scored(case: Case) -> dict[str, Any]:
    """Run the report's filter with 20 particles on the first 45 s of hall, every fifth scan."""
    recording = first_seconds(load("hall"), 45.0)
    config = replace(SlamConfig.report(), particles=20, every=5)
    rng, faults = np.random.default_rng(case.get("seed")), {"slam.best_perturbations": exactly}
    faults = faults if case.label == "exact" else {}
    path = with_fault(faults, partial(run_slam, recording, config, rng=rng)).trajectory
    return {"ate_rmse_m": trajectory_error(path, recording.true_path()).ate_rmse_m}


STUDIES = [
    Study(
        "ch09_lattice",
        "The report's filter, scored at the nearest nodes of a lattice and exactly at its particles.",
        cases("scoring", scoring=["lattice", "exact"], seed=range(12)),
        run=scored,
    )
]
