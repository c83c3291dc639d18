"""The tables and pictures on the page about trust, from the studies whose names begin with ``trust``.

``python -m measure.trust``, in ``book/_tools``, draws the two pictures anew.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from pfslam_book.show.logs import FIRST
from pfslam_book.show.pictures import encode, to_rgb
from pfslam_book.show.style import COLOURS, INK, STYLE, metric_axes, sheet
from pfslam_book.show.tables import ERROR, errors_by_label, labels_of, read_table, select, stored_studies
from scipy.stats import chi2

import pfslam
from measure import cases
from measure.elimination import GIVEN
from pfslam.cli.parser import SPOILED
from pfslam.evaluation.trajectory import aligned_at_first, trajectory_error
from pfslam.io.datasets import data_folder
from pfslam.io.files import atomic_write, write_csv, write_text
from pfslam.recording import Recording
from pfslam.refined.health import was_dragged
from pfslam.refined.lines import LineConfig
from pfslam.refined.outliers import NOISY, OutlierConfig
from pfslam.refined.run import RefinedResult, better_look
from pfslam.refined.step import RefinedConfig
from pfslam.run import run_slam
from pfslam.sensors import LidarModel
from pfslam.settings import changed
from pfslam.simulator import Hazards, simulate
from pfslam.slam import SlamConfig
from pfslam.study import Case, Study
from pfslam.study.run import OFF
from pfslam.study.table import Table

BOOK = Path(__file__).resolve().parents[2]
RIGHT = 0.05
"""Largest error (m) of a run that is right."""
ENLARGED = 100
"""So many times larger than in the building are the ellipses of the picture drawn."""
DRIVES = {
    "hall p.": ("hall", "six people"),
    "corr.": GIVEN["corridor"],
    "peop.": GIVEN["people"],
    "slop.": GIVEN["slopes"],
    "glass": GIVEN["glass"],
    "cheap": GIVEN["cheap"],
    "every.": GIVEN["everything"],
    "ring": GIVEN["ring"],
}
"""The drives of the table of ingredients, with headings short enough for a phone."""


class Without(NamedTuple):
    """What leaves one ingredient out: another LiDAR model, other settings of both looks or of the second, one look."""

    lidar: Callable[[LidarModel], LidarModel] = lambda lidar: lidar
    config: Mapping[str, Any] = MappingProxyType({})
    careful: Mapping[str, Any] = MappingProxyType({})
    second_look: bool = True


def believing_range_max(lidar: LidarModel) -> LidarModel:
    """Take a range of exactly ``range_max`` for a wall."""
    return replace(lidar, range_max=float(np.nextafter(np.float32(lidar.range_max), np.float32(np.inf))))


WITHOUT = {
    "(complete)": Without(),
    "range limit": Without(lidar=believing_range_max),
    "lean": Without(config={"tilt": False}),
    "rate": Without(config={"every": 5}),
    "sweep": Without(lidar=partial(replace, sweep=0.0)),
    "second look": Without(second_look=False),
    "waiting": Without(careful={"outliers.gone": 1000}),
    "free space": Without(careful={"outliers.free_scans": 1000}),
    "gate": Without(careful={"outliers.gate": np.inf}),
    "odometry": Without(careful={"lines.independent_beams": 0.0}),
    "lines": Without(
        careful={f"lines.{name}": getattr(LineConfig(), name) for name in ("min_hits", "elongation")}
    ),
    "noise": Without(careful={"outliers.margin": OutlierConfig().margin}),
}
"""The ingredients, by the names that the page explains."""


@lru_cache(maxsize=1)
def recording_of(drive: str) -> Recording:
    """The recording of a drive; each process keeps the last one."""
    dataset, folder = DRIVES[drive]
    if dataset == "hall":
        return replace(simulate("hall", hazards=Hazards(people=6)).recording, camera=None)
    return pfslam.load(dataset, data_folder() / folder)


@lru_cache(maxsize=4)
def one_look(drive: str, seed: int, lidar: LidarModel, config: RefinedConfig) -> RefinedResult:
    """Run once."""
    rng, recording = np.random.default_rng(seed), with_lidar(recording_of(drive), lidar)
    return run_slam(recording, config, rng=rng, keep_particles=False, second_look=False)


def with_lidar(recording: Recording, lidar: LidarModel) -> Recording:
    """The recording with another model of its LiDAR."""
    return replace(recording, robot=replace(recording.robot, lidar=lidar))


def error_without(case: Case) -> dict[str, Any]:
    """Return the error (m) of the run that stands, by the rules of ``run_slam``, without one ingredient."""
    drive, seed, without = case.get("drive"), case.get("seed"), WITHOUT[case.label]
    lidar = without.lidar(recording_of(drive).robot.lidar)
    recording = with_lidar(recording_of(drive), lidar)
    config = changed(replace(SlamConfig.refined(), every=recording.default_every), without.config)
    result, noisy = one_look(drive, seed, lidar, config), recording.range_scatter() > NOISY
    if without.second_look and (noisy or was_dragged(result.infos)):
        careful = changed(config.robust(recording.range_scatter()), without.careful)
        second = one_look(drive, seed, lidar, careful)
        result = second if noisy else better_look(result, second)
    return {ERROR: trajectory_error(result.trajectory, recording.true_path()).ate_rmse_m}


STUDIES = [
    Study(
        "trust_without",
        "What each ingredient of robustness is worth: the error without it.",
        cases("without", drive=DRIVES, seed=range(3), without=WITHOUT),
        run=error_without,
    )
]


def write_tables() -> None:
    """Sum up those of the studies that are stored in the tables that the page shows."""
    tables = {"hard": hard, "without": ingredients, "consistency": consistency, "robots": robots}
    for name, summed_up in tables.items():
        if f"trust_{name}" in stored_studies():
            write_csv(BOOK / "tables" / f"{name}.csv", summed_up())


def hard() -> list[tuple[str, ...]]:
    """One line for each drive: its errors, and how much of the time it was off, doubted, and both."""
    table = read_table("trust_hard")
    lines = [
        (
            "drive",
            "error of each run (m)",
            f"off by more than {OFF} m (% of time)",
            "of that, in doubt (%)",
            "in doubt (% of time)",
        )
    ]
    for label in labels_of(table):
        runs = select(table, label=label)
        off, both, doubted = (runs[name].mean() for name in ("off", "off_and_doubted", "doubted"))
        flagged = f"{100 * both / off:.0f}" if off else "none"
        errors = ", ".join(f"{error:.3f}" for error in runs[ERROR])
        lines.append((label, errors, f"{100 * off:.0f}", flagged, f"{100 * doubted:.0f}"))
    return lines


def ingredients() -> list[tuple[str, ...]]:
    """Medians over the seeds, in centimetres, one column for each drive; empty where nothing changes."""
    table, columns = read_table("trust_without"), []
    for heading in DRIVES:
        errors = np.array([*errors_by_label(select(table, drive=heading)).values()])
        same = (errors == errors[:1]).all(axis=1)
        same[0] = False
        cells = np.where(same, "", np.char.mod("%.1f", 100 * np.median(errors, axis=1)))
        columns.append([heading, *cells.tolist()])
    return list(zip(["without", *WITHOUT], *columns, strict=True))


def consistency() -> list[tuple[str, ...]]:
    """One line for each group of drives: means over its runs, and the least share in the covariance's ellipsoid."""
    table = read_table("trust_consistency")
    lines = [
        (
            "drives",
            "in the cloud's ellipsoid (% of scans)",
            "in the covariance's (% of scans)",
            "in the worst run (%)",
            "NEES of the cloud",
            "NEES of the covariance",
        )
    ]
    for label in labels_of(table):
        runs = select(table, label=label)
        held = runs["covariance_inside_90"]
        shares = (runs["inside_90"].mean(), held.mean(), held.min())
        nees = runs["nees_mean"].mean(), runs["covariance_nees_mean"].mean()
        words = (f"{label} ({len(held)} runs)", *(f"{100 * share:.0f}" for share in shares))
        lines.append((*words, f"{nees[0]:.0f}", f"{nees[1]:.1f}"))
    return lines


def robots() -> list[tuple[str, ...]]:
    """One line for each kind of robot and one for public logs: how many were right or off, and what was said."""
    table = read_table("trust_robots")
    head = (
        "robots",
        "number",
        f"right to {RIGHT} m, nothing said",
        "right, but stopped or in doubt to the end",
        f"off by more than {OFF} m",
        "of these, without a word",
        "of these, off when the whole path is laid on the truth",
    )
    counts = {kind: _counts(select(table, label=kind), RIGHT) for kind in labels_of(table)}
    counts[f"public logs (right: to {OFF} m)"] = _counts(public_logs(), OFF)
    counts["all"] = np.sum([*counts.values()], axis=0)
    return [head, *((kind, *map(str, found)) for kind, found in counts.items())]


def _counts(of: Table, metres: float) -> np.ndarray:
    """Count the runs of a table as the columns of ``robots`` say; to be right they end within so many metres."""
    told = (of["failed"] + of["stopped"] > 0) | (of["doubted"] > 0)
    right, off = of["ate_max_m"] <= metres, ~(of["ate_max_m"] <= OFF)  # one that could not be run is off
    alarmed = (of["to_the_end"] > 0) | (of["stopped"] > 0)
    silent = off & ~told
    some = (right & ~told, right & alarmed, off, silent, silent & ~(of["bent_max_m"] <= OFF))
    return np.array([len(off), *map(np.count_nonzero, some)])


def public_logs() -> Table:
    """Return the runs of the study ``logs`` with the columns of ``trust_robots``; a path is always laid on another."""
    runs = select(read_table("logs"), method=FIRST)
    off = {"ate_max_m": runs["max_m"], "bent_max_m": runs["max_m"]}
    return runs | off | {"stopped": (runs["exit"] == SPOILED).astype(float)}


def ellipses() -> Figure:
    """Draw the 90 % ellipses along the hall, the way out and the way back, and where in them the truth lies."""
    recording = pfslam.load("hall")
    result = run_slam(recording, keep_particles=False)
    estimate, truth = aligned_at_first(result.trajectory, recording.true_path())
    far = int(np.argmax(np.hypot(*estimate[:, :2].T)))
    figure, (left, right) = sheet(4.0, columns=2, sharex=True, sharey=True)
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


def people() -> str:
    """Draw how far the simulated hall's robot was off among people, at the first look and at the second, as SVG."""
    recording = simulate("hall", hazards=Hazards(people=6)).recording
    with matplotlib.rc_context(STYLE | {"svg.hashsalt": "pfslam"}):
        figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
        for label, line, twice in (("one look", "--", False), ("with a second look", "-", True)):
            run = run_slam(recording, keep_particles=False, second_look=twice)
            poses, truth = aligned_at_first(run.trajectory, recording.true_path())
            t = run.trajectory.t[recording.true_path().covers(run.trajectory.t)] - run.trajectory.t[0]
            error = np.hypot(*(poses - truth)[:, :2].T)
            colour = COLOURS["estimate" if twice else "odometry"]
            axes.plot(t[::8], error[::8], line, color=colour, label=label)
            for doubt in run.distrust:
                axes.axvline(doubt["from"] - run.trajectory.t[0], color=INK, ls=":", label="the run says so")
        axes.set(xlabel="time (s)", ylabel="distance from the truth (m)", ylim=(0, None))
        axes.legend()
        picture = io.StringIO()
        figure.savefig(picture, format="svg", metadata={"Date": None})
    return picture.getvalue()


if __name__ == "__main__":
    write_text(BOOK / "_static" / "people.svg", people())
    with atomic_write(BOOK / "_static" / "covariance.webp") as file:
        file.write(encode(to_rgb(ellipses())))
