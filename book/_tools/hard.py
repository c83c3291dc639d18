"""What the filter makes of drives that are not clean, and whether the run says so: the table on the page about trust.

``python book/_tools/hard.py DATA [--seeds 3] [--out FILE]`` runs the refined filter with its defaults over simulated
drives, over ``DATA/corridor20`` and over every folder in ``DATA/hard``. Those recordings are never stored.
"""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

import pfslam
from pfslam.io.course import load_course
from pfslam.io.files import write_text
from pfslam.poses import compose, invert
from pfslam.recording import Recording
from pfslam.runs import run_slam
from pfslam.simulator import Hazards, simulate
from pfslam.trust import in_doubt

HAZARDS = {
    "people": Hazards(people=6),
    "doors": Hazards(doors=4),
    "glass": Hazards(glass=0.1),
    "sweep": Hazards(sweep=0.025),
    "bumps": Hazards(bumps=8),
    "slip": Hazards(slip=3),
    "everything": Hazards(people=6, doors=4, glass=0.1, sweep=0.025, bumps=8, slip=3),
}
"""What is added to the simulated hall, one hazard at a time and all together."""
BAD_METRES = 0.3
"""A position so far from the truth is wrong enough to need a word."""
COLUMNS = (
    "drive",
    "error of each run (m)",
    f"off by more than {BAD_METRES} m (% of time)",
    "of that, in doubt (%)",
    "in doubt (% of time)",
)


class Outcome(NamedTuple):
    """One run: root mean square error (m), and for every scan with a known truth its error (m) and any doubt."""

    ate: float
    error: np.ndarray
    doubted: np.ndarray


def drives(data: Path) -> dict[str, Callable[[], Recording]]:
    """Find the drives by name, each with the call that loads it; clean ones first."""
    folders = [data / "corridor20", *sorted((data / "hard").glob("*"))]
    real = {
        folder.name: partial(load_course, folder.name[-2:], folder) for folder in folders if folder.is_dir()
    }
    clean = {name: partial(pfslam.load, name) for name in ("hall", "ramp")}
    hard = {f"hall, {name}": partial(simulated, hazards) for name, hazards in HAZARDS.items()}
    return clean | real | hard | {"ring": partial(pfslam.load, "ring")}


def simulated(hazards: Hazards) -> Recording:
    """Drive through the hall with these hazards."""
    return simulate("hall", hazards=hazards).recording


def outcome(load: Callable[[], Recording], seed: int) -> Outcome:
    """Run one drive and compare each estimate with the truth, aligned at the first pose."""
    recording = load()
    result = run_slam(recording, rng=np.random.default_rng(seed), keep_particles=False)
    assert recording.truth is not None
    known = recording.truth.covers(result.trajectory.t)
    t, poses = result.trajectory.t[known], result.trajectory.poses[known]
    true_poses = recording.truth.at(t)
    aligned = compose(compose(true_poses[0], invert(poses[0])), poses)
    error = np.hypot(*(aligned - true_poses)[:, :2].T)
    return Outcome(float(np.sqrt(np.mean(error**2))), error, in_doubt(result.distrust, t))


def row(name: str, outcomes: list[Outcome]) -> tuple[str, ...]:
    """Sum up the runs of one drive."""
    bad = np.concatenate([run.error > BAD_METRES for run in outcomes])
    doubted = np.concatenate([run.doubted for run in outcomes])
    flagged = f"{100 * doubted[bad].mean():.0f}" if bad.any() else "none"
    errors = ", ".join(f"{run.ate:.3f}" for run in outcomes)
    return name, errors, f"{100 * bad.mean():.0f}", flagged, f"{100 * doubted.mean():.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, metavar="DATA")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    if not (arguments.data / "hard").is_dir():
        print(f"skipped: the drives with real wheels, because there is no folder {arguments.data / 'hard'}")
    lines = [COLUMNS]
    for name, load in drives(arguments.data).items():
        runs = Parallel(n_jobs=-1)(delayed(outcome)(load, seed) for seed in range(arguments.seeds))
        lines.append(row(name, runs))
        print(*lines[-1], sep=" | ", flush=True)
    if arguments.out is not None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(lines)
        write_text(arguments.out, text.getvalue())


if __name__ == "__main__":
    main()
