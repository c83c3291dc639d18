"""How often cloud and covariance hold the truth on clean drives: the second table on the page about trust.

``python book/_tools/consistency.py DATA [--out FILE] [--jobs N]`` runs the refined filter with its defaults over
simulated drives, and over the drives with real wheels in ``DATA`` that are clean or nearly so. Those recordings are
never stored. ``--picture FILE`` draws the ellipses along the drive through the hall, without the other runs.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from pfslam_book.show.pictures import encode, to_rgb
from pfslam_book.show.style import COLOURS, metric_axes, new_figure
from scipy.stats import chi2

import pfslam
from pfslam.evaluation.cloud import (
    CloudConsistency,
    cloud_consistency,
    covariance_consistency,
)
from pfslam.evaluation.trajectory import aligned_at_first
from pfslam.io.course import load_course
from pfslam.io.files import atomic_write, write_csv
from pfslam.recording import Recording
from pfslam.run import run_slam
from pfslam.simulator import simulate

SEEDS = range(3)
REAL = ("corridor20", "hard/slopes20", "hard/cheap20")
"""Real wheels and gyro: undisturbed, over sills that tilt the robot, and with a scanner of 360 beams."""
ENLARGED = 100
"""So many times larger than in the building are the ellipses of the picture drawn."""
COLUMNS = (
    "drives",
    "in the cloud's ellipsoid (% of scans)",
    "in the covariance's (% of scans)",
    "in the worst run (%)",
    "NEES of the cloud",
    "NEES of the covariance",
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
    """Sum up the runs of one row: means over all runs, and the least share in the covariance's ellipsoid."""
    cloud, covariance = ([run[k].inside[0.9] for run in runs] for k in range(2))
    nees = [np.mean([run[k].nees.mean() for run in runs]) for k in range(2)]
    shares = (np.mean(cloud), np.mean(covariance), min(covariance))
    return (
        f"{name} ({len(runs)} runs)",
        *(f"{100 * share:.0f}" for share in shares),
        f"{nees[0]:.0f}",
        f"{nees[1]:.1f}",
    )


def picture() -> Figure:
    """Draw the 90 % ellipses along the hall, the way out and the way back, and where in them the truth lies."""
    recording = pfslam.load("hall")
    result = run_slam(recording, keep_particles=False)
    estimate, truth = aligned_at_first(result.trajectory, recording.true_path())
    far = int(np.argmax(np.hypot(*estimate[:, :2].T)))
    figure, (left, right) = new_figure(8.4, 4.0, columns=2, sharex=True, sharey=True)
    for axes, title, scans in (
        (left, "until the farthest place", range(0, far + 1, 30)),
        (right, "from there to the end", range(far, len(estimate), 30)),
    ):
        axes.plot(*estimate[:, :2].T, color=COLOURS["estimate"], linewidth=0.8, alpha=0.5)
        for k in scans:
            _ellipse(axes, estimate[k], truth[k], result.infos[k].covariance)
        metric_axes(axes, title)
    return figure


def _ellipse(axes: Axes, pose: np.ndarray, true_pose: np.ndarray, covariance: np.ndarray) -> None:
    """Draw the ellipse of the position and the truth's place in it, both enlarged."""
    variance, direction = np.linalg.eigh(covariance[:2, :2])
    size = 2 * ENLARGED * np.sqrt(chi2.ppf(0.9, 2) * np.maximum(variance, 0.0))
    angle = np.rad2deg(np.arctan2(direction[1, 1], direction[0, 1]))
    colour = COLOURS["estimate"]
    axes.add_patch(Ellipse(tuple(pose[:2]), size[1], size[0], angle=angle, fill=False, edgecolor=colour))
    shown = pose[:2] + ENLARGED * (true_pose - pose)[:2]
    axes.plot(*shown, ".", color=COLOURS["truth"], markersize=4)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, metavar="DATA")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--jobs", type=int, default=-1)
    arguments = parser.parse_args()
    if arguments.picture is not None:
        with atomic_write(arguments.picture) as file:
            file.write(encode(to_rgb(picture())))
        return
    if not (arguments.data / REAL[0]).is_dir():
        print(f"skipped: the drives with real wheels, because there is no folder {arguments.data / REAL[0]}")
    lines = [COLUMNS]
    for name, runs in groups(arguments.data).items():
        lines.append(row(name, Parallel(n_jobs=arguments.jobs)(delayed(outcome)(*run) for run in runs)))
        print(*lines[-1], sep=" | ", flush=True)
    if arguments.out is not None:
        write_csv(arguments.out, lines)


if __name__ == "__main__":
    main()
