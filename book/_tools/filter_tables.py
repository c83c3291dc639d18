"""The two tables that no study can make: exact scoring against the lattice (chapter 09), and the reader's filter (05).

``python book/_tools/filter_tables.py`` makes them anew, which takes about half an hour.
"""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from pfslam_book.ch05.your_filter import CHANGES, FILTER_TABLE, drive, error, my_filter, step
from pfslam_book.ch09.tables import LATTICE_TABLE
from pfslam_book.show.faults import with_fault

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec
from pfslam.io.datasets import load
from pfslam.io.files import write_text
from pfslam.refined.search.lattice import Lattice
from pfslam.refined.search.matching import Match, match
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
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


def lattice_rows(seeds: int = 12) -> Iterator[dict]:
    """The report's filter with 20 particles on the first 45 s of hall, every fifth scan, scored both ways."""
    recording = first_seconds(load("hall"), 45.0)
    config = replace(SlamConfig.report(), particles=20, every=5)
    for seed in range(seeds):
        for label, faults in (("lattice", {}), ("exact", {"map.match": exact_match})):
            rng = np.random.default_rng(seed)
            path = with_fault(faults, partial(run_slam, recording, config, rng=rng)).trajectory
            off = trajectory_error(path, recording.true_path()).ate_rmse_m
            yield {"label": label, "seed": seed, "ate_rmse_m": f"{off:.5f}"}


def filter_rows(seeds: int = 10, whole: int = 5) -> Iterator[dict]:
    """The printed filter on hall, as it is and harmed: on its first 65 s, and (``seconds`` inf) on the whole drive."""
    hall, f = load("hall"), my_filter("none")
    for label, changes in CHANGES.items():
        for seed in range(seeds):
            yield {"label": label, "seconds": 65, "seed": seed, **one_drive(f, hall, seed=seed, **changes)}
    for label, changes in CHANGES.items():
        for seed in range(whole):
            long = {"particles": 200, "every": 10, "seconds": np.inf, "seed": seed}
            yield {"label": label, "seconds": "inf", "seed": seed, **one_drive(f, hall, **long, **changes)}


def one_drive(f, recording, **settings) -> dict:
    return {"ate_rmse_m": f"{error(drive(step, f, recording, **settings), recording).ate_rmse_m:.5f}"}


def write(path, rows: Iterator[dict]) -> None:
    """A table as CSV, each row on the screen as it is made."""
    text, table = io.StringIO(), None
    for row in rows:
        print(row, flush=True)
        if table is None:
            table = csv.DictWriter(text, list(row), lineterminator="\n")
            table.writeheader()
        table.writerow(row)
    write_text(path, text.getvalue())


if __name__ == "__main__":
    if "lattice" in sys.argv[1:] or not sys.argv[1:]:
        write(LATTICE_TABLE, lattice_rows())
    if "filter" in sys.argv[1:] or not sys.argv[1:]:
        write(FILTER_TABLE, filter_rows())
