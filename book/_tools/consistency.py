"""How often cloud and covariance hold the truth on clean drives: the second table on the page about trust.

``python book/_tools/consistency.py DATA [--out FILE] [--jobs N]`` runs the refined filter with its defaults over
simulated drives, and over the drives with real wheels in ``DATA`` that are clean or nearly so. Those recordings are
never stored.
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
from pfslam.evaluation.cloud import CloudConsistency, cloud_consistency, covariance_consistency
from pfslam.io.course import load_course
from pfslam.io.files import write_text
from pfslam.recording import Recording
from pfslam.runs import run_slam
from pfslam.simulator import simulate

SEEDS = range(3)
REAL = ("corridor20", "hard/slopes20", "hard/cheap20")
"""Real wheels and gyro: undisturbed, over sills that tilt the robot, and with a scanner of 360 beams."""
COLUMNS = (
    "drives",
    "runs",
    "cloud: holds the truth (% of scans)",
    "covariance: holds the truth (% of scans)",
    "in the worst run (%)",
    "cloud: NEES",
    "covariance: NEES",
    "claimed (cm)",
    "true error (cm)",
)


class Outcome(NamedTuple):
    """One run, judged by its clouds and by its covariances."""

    cloud: CloudConsistency
    covariance: CloudConsistency


def groups(data: Path) -> dict[str, list[tuple[Callable[[], Recording], int]]]:
    """List the runs of each row of the table, as calls that load the drive, and seeds of the filter."""
    built_in = {
        name: [(partial(pfslam.load, name), seed) for seed in SEEDS] for name in ("hall", "ramp", "ring")
    }
    halls = [(partial(simulated, "hall", building), 0) for building in range(1, 21)]
    ramps = [(partial(simulated, "ramp", building), 0) for building in range(1, 6)]
    real = {
        folder.name: [(partial(load_course, folder.name[-2:], folder), seed) for seed in SEEDS]
        for folder in (data / name for name in REAL)
        if folder.is_dir()
    }
    return built_in | {"twenty other halls": halls, "five other ramps": ramps} | real


def simulated(name: str, building: int) -> Recording:
    """Drive through a building of another seed."""
    return simulate(name, building).recording


def outcome(load: Callable[[], Recording], seed: int) -> Outcome:
    """Run one drive and judge every scan's cloud and covariance; NEES and shares are in three dimensions."""
    recording = load()
    infos, truth = run_slam(recording, rng=np.random.default_rng(seed)).infos, recording.true_path()
    return Outcome(cloud_consistency(infos, truth), covariance_consistency(infos, truth))


def row(name: str, runs: list[Outcome]) -> tuple[str, ...]:
    """Sum up the runs of one row: means over all runs, root mean squares of the position's claimed and true error."""
    inside = np.array([run.covariance.inside[0.9] for run in runs])
    claimed, actual = (
        100 * np.sqrt(np.mean([getattr(run.covariance, name) ** 2 for run in runs]))
        for name in ("claimed_m", "actual_m")
    )
    return (
        name,
        str(len(runs)),
        f"{100 * np.mean([run.cloud.inside[0.9] for run in runs]):.0f}",
        f"{100 * inside.mean():.0f}",
        f"{100 * inside.min():.0f}",
        f"{np.mean([run.cloud.nees.mean() for run in runs]):.1f}",
        f"{np.mean([run.covariance.nees.mean() for run in runs]):.1f}",
        f"{claimed:.1f}",
        f"{actual:.1f}",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, metavar="DATA")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--jobs", type=int, default=-1)
    arguments = parser.parse_args()
    if not (arguments.data / REAL[0]).is_dir():
        print(f"skipped: the drives with real wheels, because there is no folder {arguments.data / REAL[0]}")
    lines = [COLUMNS]
    for name, runs in groups(arguments.data).items():
        lines.append(row(name, Parallel(n_jobs=arguments.jobs)(delayed(outcome)(*run) for run in runs)))
        print(*lines[-1], sep=" | ", flush=True)
    if arguments.out is not None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(lines)
        write_text(arguments.out, text.getvalue())


if __name__ == "__main__":
    main()
