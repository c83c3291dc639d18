"""What the runs over the Intel log gave: a table of errors, and a few paths and maps, stored for the book.

``python book/_tools/intel.py DATA``, where ``DATA/intel.log`` and ``DATA/intel.relations`` are the public log and its
relations. The log itself is never stored.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from pfslam_book.show.intel import COLUMNS, RETURN_SECONDS, RUNS, TABLE

import pfslam
from pfslam.evaluation.trajectory import relations_error
from pfslam.grid import OccupancyGrid
from pfslam.io.files import write_text
from pfslam.io.formats import Relations, read_relations
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.run import run_slam
from pfslam.slam import SlamConfig

SEEDS = range(10)
SHOWN = ("scan matching", "report")
"""The methods whose first map and path are stored."""


def configurations() -> dict[str, tuple[SlamConfig, range]]:
    """The methods, every scan used, and the seeds of each."""
    refined, report = SlamConfig.refined(), SlamConfig.report()
    methods = {
        "scan matching": (SlamConfig.matching(), range(1)),
        "refined, 200 particles": (refined, SEEDS),
        "refined, 50 particles": (replace(refined, particles=50), SEEDS),
        "report": (replace(report, particles=50), SEEDS),
    }
    return {name: (replace(config, every=1), seeds) for name, (config, seeds) in methods.items()}


def runs(recording: Recording) -> Iterator[tuple[str, int, Trajectory, OccupancyGrid | None]]:
    """Method, seed, path and map of every run, dead reckoning first."""
    t, odometry = recording.scans().t, dead_reckoning(recording)
    yield "dead reckoning", 0, Trajectory(t, odometry.at(t)), None
    for name, (config, seeds) in configurations().items():
        for seed in seeds:
            result = run_slam(recording, config, rng=np.random.default_rng(seed), keep_particles=False)
            print(name, seed, flush=True)
            yield name, seed, result.trajectory, result.grid


def errors(path: Trajectory, relations: Relations) -> dict[str, float]:
    """Mean error over all usable relations, and mean and worst over those between visits far apart in time."""
    metres, radians = relations_error(path, relations.t1, relations.t2, relations.poses)
    back = np.abs(relations.t2 - relations.t1) > RETURN_SECONDS
    return {
        "all_m": metres.mean(),
        "all_deg": np.rad2deg(radians.mean()),
        "returns_m": metres[back].mean(),
        "returns_worst_m": metres[back].max(),
        "returns_deg": np.rad2deg(radians[back].mean()),
    }


def made_by(folder: Path, relations: Relations, usable: Relations) -> dict:
    """How the files came about: the command, the log, the relations that the log can be judged by."""
    away = np.abs(usable.t2 - usable.t1)
    step = np.hypot(*usable.poses[:, :2].T)
    return {
        "command": "python book/_tools/intel.py DATA",
        "log": "Intel Research Lab, CARMEN format, raw odometry",
        "log_sha256": hashlib.sha256((folder / "intel.log").read_bytes()).hexdigest(),
        "numpy": np.__version__,
        "relations": len(relations.t1),
        "usable": len(usable.t1),
        "returns": int(np.count_nonzero(away > RETURN_SECONDS)),
        "short": int(np.count_nonzero(away < 10.0)),
        "short_median_m": float(np.median(step[away < 10.0])),
    }


def main(folder: Path) -> None:
    """Run every method over the log, and store the table and what the chapter draws."""
    recording = pfslam.load(folder / "intel.log")
    relations = read_relations(folder / "intel.relations")
    usable = relations.at_stamps(recording.scans().t)
    rows, arrays = [], {"t": recording.scans().t}
    for name, seed, path, grid in runs(recording):
        found = {key: round(float(value), 5) for key, value in errors(path, usable).items()}
        rows.append({"label": name, "seed": seed} | found)
        key = name.replace(" ", "_")
        if seed == 0 and (grid is None or name in SHOWN):
            arrays[f"{key}_path"] = path.poses.astype(np.float32)
        if seed == 0 and grid is not None and name in SHOWN:
            arrays[f"{key}_map"] = np.sign(grid.log_odds).astype(np.int8)
            arrays[f"{key}_corner"] = np.array([*grid.spec.origin, grid.spec.resolution])
    made = json.dumps(made_by(folder, relations, usable), indent=2)
    np.savez_compressed(RUNS, made=np.array(made), **arrays)
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(TABLE, text.getvalue())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
