"""Chapter 09: what scoring on a lattice costs the report's filter."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pfslam_book.show.faults import with_fault

from measure import cases
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec
from pfslam.io.datasets import load
from pfslam.refined.search.lattice import Lattice
from pfslam.refined.search.matching import Match, match
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam.study import Case, Study
from pfslam.study.disturbances import first_seconds


def exact_match(field, spec, points_b, poses, sigmas, config, rng) -> Match:
    """Every particle scored at its own pose: the map and the scan are shifted so that it comes to lie on a node."""
    lattice, found = Lattice(spec.resolution, config.yaw_step), []
    for pose in poses:
        node = lattice.pose(lattice.nearest(pose[None])[0])
        off = pose - node
        c, s = np.cos(off[2]), np.sin(off[2])
        moved_map = GridSpec(tuple(np.asarray(spec.origin) - off[:2]), spec.resolution, spec.shape)
        turned = points_b @ np.array([[c, -s], [s, c]]).T
        one = match(field, moved_map, turned, node[None], sigmas, config, rng)
        found.append(Match(one.poses + off, one.log_likelihood, one.score))
    return Match(*(np.concatenate(parts) for parts in zip(*(vars(m).values() for m in found), strict=True)))


def scored(case: Case) -> dict[str, Any]:
    """Run the report's filter with 20 particles on the first 45 s of hall, every fifth scan."""
    recording = first_seconds(load("hall"), 45.0)
    config = replace(SlamConfig.report(), particles=20, every=5)
    rng, faults = np.random.default_rng(case.get("seed")), {"map.match": exact_match}
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
