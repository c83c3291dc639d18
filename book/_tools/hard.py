"""What the filter makes of drives that are not clean, and whether the run says so: the table on the page about trust.

``python book/_tools/hard.py DATA [--seeds 3] [--out FILE]`` runs the refined filter with its defaults over simulated
drives, over ``DATA/corridor20`` and over every folder in ``DATA/hard``. Those recordings are never stored. With
``--without`` it writes another table: what each ingredient of robustness is worth, by leaving it out. ``--figure
FILE`` draws the first and the second look at the hall among people instead.
"""

from __future__ import annotations

import argparse
import copy
import io
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from joblib import Parallel, delayed
from pfslam_book.show.style import COLOURS, INK, STYLE

import pfslam
from pfslam.io.course import load_course
from pfslam.io.files import write_csv, write_text
from pfslam.poses import compose, invert
from pfslam.recording import Recording
from pfslam.refined.health import in_doubt
from pfslam.refined.lines import LineConfig
from pfslam.refined.outliers import OutlierConfig
from pfslam.run import SlamResult, better_look, needs_second_look, run_slam
from pfslam.sensors import LidarModel
from pfslam.settings import changed
from pfslam.simulator import Hazards, simulate
from pfslam.slam import SlamConfig

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
    """Run one drive with the defaults."""
    recording = load()
    return compared(recording, run_slam(recording, rng=np.random.default_rng(seed), keep_particles=False))


def compared(recording: Recording, result: SlamResult) -> Outcome:
    """Compare each estimate of a run with the truth, aligned at the first pose."""
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


def table(found: dict[str, Callable[[], Recording]], seeds: int) -> list[tuple[str, ...]]:
    """Run every drive and sum up its runs."""
    lines = [COLUMNS]
    for name, load in found.items():
        runs = Parallel(n_jobs=-1)(delayed(outcome)(load, seed) for seed in range(seeds))
        lines.append(row(name, runs))
        print(*lines[-1], sep=" | ", flush=True)
    return lines


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
"""The ingredients, by the names that the page about trust explains."""
DRIVES = {
    "hall": "hall",
    "corridor20": "corr.",
    "people20": "peop.",
    "slopes20": "slop.",
    "glass20": "glass",
    "cheap20": "cheap",
    "everything20": "every.",
    "ring95": "ring",
}
"""The drives of that table, with headings short enough for a phone."""


class Bench:
    """One drive and one seed, run without one ingredient after another; the same run is made only once."""

    def __init__(self, load: Callable[[], Recording], seed: int):
        self.recording, self.seed = load(), seed
        self.runs: dict[tuple, tuple[SlamResult, np.random.Generator]] = {}

    def run(self, key: tuple, recording: Recording, config: SlamConfig, rng: np.random.Generator):
        """Run once from where ``rng`` stands; return the result, and the generator as the run left it."""
        if key not in self.runs:
            rng = copy.deepcopy(rng)
            self.runs[key] = (
                run_slam(recording, config, rng=rng, keep_particles=False, second_look=False),
                rng,
            )
        return self.runs[key]

    def error(self, without: Without) -> float:
        """Return the error (m) of the run that stands, by the rules of ``run_slam``."""
        recording, other = self.with_lidar(without.lidar)
        config = changed(replace(SlamConfig.refined(), every=recording.default_every), without.config)
        first, rng = self.run((other, config), recording, config, np.random.default_rng(self.seed))
        if not (without.second_look and needs_second_look(recording, first)):
            return compared(recording, first).ate
        careful = changed(config.robust(recording.range_scatter()), without.careful)
        second, _ = self.run((other, config, careful), recording, careful, rng)
        return compared(recording, better_look(recording, first, second)).ate

    def with_lidar(self, change: Callable[[LidarModel], LidarModel]) -> tuple[Recording, LidarModel | None]:
        """Return the recording with another LiDAR model, and that model if it makes any difference to the scans."""
        lidar, ranges = self.recording.robot.lidar, self.recording.scans().ranges
        other = change(lidar)
        if other.sweep == lidar.sweep and np.array_equal(other.valid(ranges), lidar.valid(ranges)):
            return self.recording, None
        return replace(self.recording, robot=replace(self.recording.robot, lidar=other)), other


def errors_without(load: Callable[[], Recording], seed: int) -> list[float]:
    """List the errors (m) of one drive without each ingredient in turn."""
    bench = Bench(load, seed)
    return [bench.error(without) for without in WITHOUT.values()]


def table_without(found: dict[str, Callable[[], Recording]], seeds: int) -> list[tuple[str, ...]]:
    """Make the table of ingredients: medians over the seeds, in centimetres; empty where nothing changes."""
    runs = Parallel(n_jobs=-1)(
        delayed(errors_without)(found[name], seed) for name in DRIVES for seed in range(seeds)
    )
    columns = []
    for k, heading in enumerate(DRIVES.values()):
        errors = np.array(runs[k * seeds : (k + 1) * seeds])
        same = (errors == errors[:, :1]).all(axis=0)
        same[0] = False
        cells = np.where(same, "", np.char.mod("%.1f", 100 * np.median(errors, axis=0)))
        columns.append([heading, *cells.tolist()])
    lines = list(zip(["without", *WITHOUT], *columns, strict=True))
    for line in lines:
        print(*line, sep=" | ", flush=True)
    return lines


def draw_people(out: Path) -> None:
    """Draw how far the simulated hall's robot was off among people, at the first look and at the second."""
    recording = simulated(HAZARDS["people"])
    with matplotlib.rc_context(STYLE | {"svg.hashsalt": "pfslam"}):
        figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
        for label, line, twice in (("one look", "--", False), ("with a second look", "-", True)):
            run = run_slam(recording, keep_particles=False, second_look=twice)
            error, t = compared(recording, run).error, run.trajectory.t
            t = t[recording.true_path().covers(t)] - t[0]
            axes.plot(
                t[::8], error[::8], line, color=COLOURS["estimate" if twice else "odometry"], label=label
            )
            for doubt in run.distrust:
                axes.axvline(doubt["from"] - run.trajectory.t[0], color=INK, ls=":", label="the run says so")
        axes.set(xlabel="time (s)", ylabel="distance from the truth (m)", ylim=(0, None))
        axes.legend()
        picture = io.StringIO()
        figure.savefig(picture, format="svg", metadata={"Date": None})
    write_text(out, picture.getvalue())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, metavar="DATA")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--without", action="store_true")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--figure", type=Path)
    arguments = parser.parse_args()
    if arguments.figure is not None:
        draw_people(arguments.figure)
        return
    if not (arguments.data / "hard").is_dir():
        print(f"skipped: the drives with real wheels, because there is no folder {arguments.data / 'hard'}")
    found = drives(arguments.data)
    lines = table_without(found, arguments.seeds) if arguments.without else table(found, arguments.seeds)
    if arguments.out is not None:
        write_csv(arguments.out, lines)


if __name__ == "__main__":
    main()
