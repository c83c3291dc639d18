"""What the benchmark measures, one function a section."""

from __future__ import annotations

import cProfile
import pstats
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

import pfslam
from bench.measure import Row, Section, in_fresh_process, interleaved
from pfslam.correlation import map_correlation, score_field
from pfslam.grid import GridSpec
from pfslam.poses import transform_points
from pfslam.recording import Recording
from pfslam.refined.search.lattice import Lattice, Window
from pfslam.refined.search.volume import search
from pfslam.run import slam_steps
from pfslam.sensors import scan_points
from pfslam.slam import PRESETS, SlamConfig

ALWAYS_DRAW = replace(SlamConfig.refined(), every=5, draw_metres=0.0, draw_radians=0.0)
"""Every update does the same work."""
STEPS = {"per-particle": (5,)}
"""The values of ``--every`` to measure, for methods other than (5, 1)."""
PARTS = {
    "predict": "predict_motion",
    "search all perturbations": "search",
    "climb to the best one": "match",
    "reweight": "reweight",
    "estimate": "estimate_pose",
    "polish": "polish",
    "draw the scan": "integrate_scan",
    "renew the field": "renew_field",
    "add the hits' moments": "add",
}
"""The parts of an update and the functions that do them; what one of these calls is counted with the one called."""
WHOLE = "slam_step"
PACKAGE = Path(pfslam.__file__).parent
MEMORY = """
import sys
from pfslam.__main__ import main
from pfslam.study.run import peak_megabytes
main(sys.argv[1:])
print(peak_megabytes())
"""
WINDOW = Window(4, 4)


@dataclass(frozen=True)
class Effort:
    """How long to measure.

    ``seconds`` of the recording are run (None: all), ``rounds`` is how often short jobs are repeated, ``sample`` how
    many poses are scored by the definition, and ``updates`` how many updates are averaged.
    """

    seconds: float | None = None
    rounds: int = 7
    sample: int = 1000
    updates: int = 100
    particles: tuple[int, ...] = (5, 20, 50, 200, 1000, 5000, 20_000)


QUICK = Effort(20.0, 3, 150, 30, (5, 50, 200, 2000))
STILL = 100
"""The first updates, while the robot stands still, are left out where single updates are measured."""


def runs(name: str, recording: Recording, effort: Effort) -> Section:
    """Measure the speed of a run for each method, against the recording's own time."""
    rows = []
    for method, preset in PRESETS.items():
        for every in STEPS.get(method, (5, 1)):
            limit = min(effort.seconds or np.inf, 30.0 if method == "per-particle" else np.inf)
            begin = time.process_time()
            covered = _run_for(recording, replace(preset(), every=every), limit)
            spent = time.process_time() - begin
            note = f"{covered:.0f} s of the drive in {spent:.1f} s"
            rows.append(Row(f"{method}, --every {every}", covered / spent, "x", note=note))
    note = "times faster than the recording, in processor time of one thread; no texture"
    return Section(f"Runs of {name}", note, rows)


def _run_for(recording: Recording, config: SlamConfig, seconds: float) -> float:
    """Run the first ``seconds`` of a recording and return how many seconds of it were covered."""
    stamps: list[float] = []
    for _, info in slam_steps(recording, config, np.random.default_rng(0)):
        stamps.append(info.t)
        if stamps[-1] - stamps[0] >= seconds:
            break
    return stamps[-1] - stamps[0]


def scoring(recording: Recording, effort: Effort) -> Section:
    """Compare the search over all perturbations of 200 particles with the definition, pose by pose."""
    rng, config = np.random.default_rng(0), replace(SlamConfig.report(), every=5)
    state, info = next(islice(slam_steps(recording, config, rng), STILL, None))
    grid, scans = state.grid, recording.scans()
    points = scan_points(scans.ranges[np.searchsorted(scans.t, info.t)], recording.robot.lidar)
    # A beam straight ahead of a node would end on the border of two cells, where round-off decides: move the map.
    step = grid.spec.resolution
    spec = GridSpec(tuple(np.add(grid.spec.origin, [0.3717 * step, 0.4293 * step])), step, grid.spec.shape)
    lattice, field = Lattice(step, config.search.yaw_step), score_field(grid.occupied, "occupied")
    cloud = info.estimate + rng.standard_normal((200, 3)) * [0.02, 0.02, 0.003]

    def by_search() -> list:
        return list(search(field, spec, points, cloud, lattice, WINDOW))

    poses, scores = _sample(by_search(), lattice, effort.sample, rng)
    by_definition = partial(_definition, grid.occupied, spec, points, poses)
    spent = interleaved({"search": by_search, "definition": by_definition}, effort.rounds)
    total = len(cloud) * len(WINDOW.steps())
    scaled = spent["definition"] * total / len(poses)
    rows = [
        Row.of("by the definition", 1e3 * scaled, "ms", f"a sample of {len(poses)} poses, scaled up"),
        Row.of("by the search", 1e3 * spent["search"], "ms"),
        Row.of("times faster", scaled / spent["search"], "x"),
        Row("same integers in the sample", float(scores == by_definition()), "(1 = yes)"),
    ]
    note = f"{total} poses around 200 particles, {len(points)} beams"
    return Section("One scan against the map", note, rows)


def _sample(boxes: list, lattice: Lattice, n: int, rng: np.random.Generator) -> tuple[np.ndarray, list[int]]:
    """Draw ``n`` of the perturbed poses, with the scores that the search gives them."""
    poses, scores = [], []
    for _ in range(n):
        box = boxes[rng.integers(len(boxes))]
        node = box.node_of[rng.integers(len(box.node_of))]
        step = rng.integers(box.scores.shape[1])
        poses.append(lattice.pose(box.nodes[node] + WINDOW.steps()[step]))
        scores.append(int(box.scores[node, step]))
    return np.array(poses), scores


def _definition(occupied: np.ndarray, spec: GridSpec, points: np.ndarray, poses: np.ndarray) -> list[int]:
    return [map_correlation(occupied, spec, transform_points(pose, points)) for pose in poses]


def update(recording: Recording, effort: Effort) -> Section:
    """Measure the parts of one update of the refined filter."""
    parts = update_parts(recording, effort.updates)
    rows = [Row(name, milliseconds, "ms") for name, milliseconds in parts.items()]
    note = f"refined, 200 particles, mean of {effort.updates} updates; Python's profiler adds some of its own time"
    return Section("One update, part by part", note, [*rows, Row("all", sum(parts.values()), "ms")])


def update_parts(recording: Recording, updates: int) -> dict[str, float]:
    """Take the processor time (ms) of each part of one update of the refined filter, by Python's own profiler."""
    steps = _moving(recording, ALWAYS_DRAW)
    profile = cProfile.Profile(time.process_time)
    profile.runcall(lambda: [None for _ in islice(steps, updates)])
    spent = dict.fromkeys([WHOLE, *PARTS.values()], 0.0)
    for (file, _, function), (_, _, _, cumulative, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        if function in spent and Path(file).is_relative_to(PACKAGE):
            spent[function] += 1e3 * cumulative / updates
    spent["match"] -= spent["search"]
    parts = {part: spent[function] for part, function in PARTS.items()}
    return parts | {"the rest": spent[WHOLE] - sum(parts.values())}


def _moving(recording: Recording, config: SlamConfig) -> Iterator:
    """The steps of a run after the first ones, in which the robot stands still."""
    steps = slam_steps(recording, config, np.random.default_rng(0))
    next(islice(steps, STILL - 1, None))
    return steps


def growth(recording: Recording, effort: Effort) -> Section:
    """Measure one update for more and more particles."""
    rows = []
    for n in effort.particles:
        steps = _moving(recording, replace(ALWAYS_DRAW, particles=n))
        begin = time.process_time()
        for _ in islice(steps, effort.updates):
            pass
        rows.append(Row(f"{n} particles", 1e3 * (time.process_time() - begin) / effort.updates, "ms"))
    note = f"refined, mean of {effort.updates} updates, in each of which the scan is drawn"
    return Section("One update for more particles", note, rows)


def memory(kinds: tuple[str, ...]) -> Section:
    """Measure the peak memory of whole runs of hall as the command line does them, with ``kinds`` of options."""
    rows = []
    for kind in kinds:
        with tempfile.TemporaryDirectory() as out:
            peak = in_fresh_process(MEMORY, "run", "hall", kind, "--out", out)
        known = peak != "None"  # not every system tells
        rows.append(Row(f"run hall {kind}", float(peak) if known else None, "MB"))
    return Section("Peak memory of a run", "a fresh process with all its libraries", rows)
