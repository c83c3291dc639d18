"""What the accurate filter misses: ingredients left out of it, and ingredients that have left it put back.

Every filter runs over the same drives, on which no setting or threshold was chosen, and over public logs.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from pfslam_book.show.faults import with_fault
from pfslam_book.show.texture_error import parabola_peak

import pfslam
from measure.logs import LOGS, off
from pfslam.evaluation.trajectory import aligned_at_first, relations_error
from pfslam.grid import GridSpec
from pfslam.io.datasets import data_folder
from pfslam.io.files import read_npz, write_npz
from pfslam.io.formats import read_relations
from pfslam.motion import dead_reckoning
from pfslam.particles import ControlNoise
from pfslam.poses import transform_points
from pfslam.recording import Recording
from pfslam.refined.field import TOP
from pfslam.refined.health import in_doubt
from pfslam.refined.lines import LineConfig
from pfslam.refined.matching import Match, match
from pfslam.refined.run import RefinedResult
from pfslam.refined.step import RefinedConfig
from pfslam.run import run_slam
from pfslam.settings import changed
from pfslam.simulator import PRESETS, Hazards, SimulatorConfig, simulate
from pfslam.simulator.cache import _key, cache_folder
from pfslam.study import Case, Study
from pfslam.study.disturbances import first_seconds
from pfslam.study.run import OFF

SEEDS = range(101, 113)
"""Buildings and draws that nobody has looked at."""
SECONDS = 65.0
"""So much of a drive through a hall is run."""
EVERYTHING = Hazards(people=6, doors=4, glass=0.1, sweep=0.025, bumps=8, slip=3)


class Simulated(NamedTuple):
    """What is simulated, with how many buildings."""

    config: SimulatorConfig
    hazards: Hazards = Hazards()
    seconds: float = SECONDS
    seeds: range = SEEDS


SIMULATED = {
    "halls": Simulated(PRESETS["hall"]),
    "ramps": Simulated(PRESETS["ramp"]),
    "people": Simulated(PRESETS["hall"], Hazards(people=6)),
    "glass": Simulated(PRESETS["hall"], Hazards(glass=0.1)),
    "bumps": Simulated(PRESETS["hall"], Hazards(bumps=8)),
    "slip": Simulated(PRESETS["hall"], Hazards(slip=3)),
    "everything": Simulated(PRESETS["hall"], EVERYTHING),
    "rings": Simulated(PRESETS["ring"], seconds=1e9, seeds=range(101, 105)),
    "corridors": Simulated(replace(PRESETS["hall"], layout="corridor"), seconds=1e9, seeds=range(101, 109)),
}
GIVEN = {
    "corridor": (20, "corridor20"),
    "people": (20, "hard/people20"),
    "slopes": (20, "hard/slopes20"),
    "glass": (20, "hard/glass20"),
    "cheap": (20, "hard/cheap20"),
    "everything": (20, "hard/everything20"),
    "ring": (95, "hard/ring95"),
}
EVERY = {"Freiburg 079": 4}
"""Every how-many-th scan of a log is used, where it is not each."""
PUBLIC = ("Freiburg 079", "Freiburg 101", "Seattle", "FHW museum", "Edmonton")
INTEL_SEEDS = range(10)
"""The Intel log is lost or not by chance: so many seeds."""
DRIVES = (
    [(f"{kind} {seed}", 0) for kind, what in SIMULATED.items() for seed in what.seeds]
    + [(f"given {name}", 0) for name in GIVEN]
    + [(f"logs {name}", 0) for name in PUBLIC]
    + [("Intel Intel", seed) for seed in INTEL_SEEDS]
)
"""All drives, each with the seed of the filter; the first word is the group that is summed up."""


def simulated(kind: str, seed: int) -> Recording:
    """Simulate one drive; its scans are kept in the cache, because a study asks for them many times."""
    what = SIMULATED[kind]
    config = replace(what.config, hazards=what.hazards)
    path = cache_folder() / "drives" / f"{kind}-{seed}-{_key(config, seed)}.npz"
    ranges = read_npz(path, ("ranges",))["ranges"] if path.exists() else None
    found = simulate(config, seed, ranges).recording
    if ranges is None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_npz(path, ranges=found.scans().ranges)
    return first_seconds(replace(found, camera=None), what.seconds)


@lru_cache(maxsize=1)
def recording_of(drive: str) -> Recording:
    """The recording of a drive; each process keeps the last one."""
    group, _, name = drive.partition(" ")
    if group in SIMULATED:
        return simulated(group, int(name))
    if group == "given":
        return pfslam.load(GIVEN[name][0], data_folder() / GIVEN[name][1])
    return pfslam.load(data_folder() / ("intel/intel.log" if group == "Intel" else f"logs/{LOGS[name]}"))


# ---- what is changed

Matcher = Callable[..., Match]


def in_binary_cells(scores: np.ndarray, *rest: Any) -> Match:
    """Count end points on occupied cells, without credit for near misses."""
    return match(np.where(scores == TOP, scores, np.float32(0)), *rest)


def weighed_by_count(*arguments: Any) -> Match:
    """Multiply weights by the score itself, as Eq. 12 does by the count."""
    found = match(*arguments)
    with np.errstate(divide="ignore"):
        return replace(found, log_likelihood=np.log(found.score))


def with_sub_cell_step(scores: np.ndarray, spec: GridSpec, points_b: np.ndarray, *rest: Any) -> Match:
    """Go on from the best lattice pose to the top of the parabola through J there and at both neighbours, by axis."""
    poses, sigmas, config = rest
    found = match(scores, spec, points_b, *rest)
    unit = np.array([spec.resolution, spec.resolution, config.yaw_step])
    nodes, widths = np.rint(found.poses / unit) * unit, np.array([sigmas[0], sigmas[0], sigmas[1]])

    def J(nodes: np.ndarray) -> np.ndarray:
        cells = np.array([spec.world_to_cell(transform_points(node, points_b)) for node in nodes])
        inside = spec.contains(cells)
        ix, iy = np.moveaxis(np.where(inside[..., None], cells, 0), -1, 0)
        share = np.where(inside, scores[iy, ix], 0.0).mean(axis=1) / TOP
        return config.sharpness * share - 0.5 * np.sum(((nodes - poses) / widths) ** 2, axis=1)

    here, steps = J(nodes), np.diag(unit)
    peaks = [parabola_peak(J(nodes - step), here, J(nodes + step)) for step in steps]
    return replace(found, poses=nodes + unit * np.clip(np.column_stack(peaks), -0.5, 0.5))


class Change(NamedTuple):
    """What takes an ingredient out or puts one in: settings, those of the second look, another search, one look."""

    config: Mapping[str, Any] = {}
    careful: Mapping[str, Any] = {}
    match: Matcher | None = None
    second_look: bool = True


CHANGES: Mapping[str, Change] = {
    "nothing": Change(),
    "without likelihood field": Change(match=in_binary_cells),
    "without likelihood weights": Change(match=weighed_by_count),
    "without motion prior": Change({"search.prior": False}),
    "without window that follows the motion": Change({"search.cells": (4, 4), "search.yaws": (4, 4)}),
    "without noise that follows the motion": Change({"noise": ControlNoise()}),
    "without weighted mean": Change({"estimate": "best"}),
    "without drawing after motion": Change({"draw_metres": 0.0, "draw_radians": 0.0}),
    "without gentle clearing": Change({"map.free": float(np.log(4.0))}),
    "without lean": Change({"tilt": False}),
    "without alignment to lines": Change({"lines": None}),
    "without second look": Change(second_look=False),
    "without gate": Change(careful={"outliers.gate": np.inf}),
    "without waiting": Change(careful={"outliers.gone": 1000}),
    "without free space": Change(careful={"outliers.free_scans": 1000}),
    "without odometry beside lines": Change(careful={"lines.independent_beams": 0.0}),
    "without stricter lines": Change(careful={"lines.min_hits": 3, "lines.elongation": 2.0}),
    "with higher clamp": Change({"map.clamp": float(5.0 * np.log(4.0))}),
    "with resampling at N/2": Change({"resample_below": 0.5}),
    "with sub-cell step": Change(match=with_sub_cell_step),
    "with odometry beside lines at once": Change({"lines": LineConfig(independent_beams=150.0)}),
}
"""The filters that are compared with the one that is used."""


@dataclass(frozen=True)
class Trial(RefinedConfig):
    """The accurate filter, with settings of its own for the second look."""

    careful: str = "{}"

    def robust(self, scatter: float = 0.0) -> RefinedConfig:
        """Return the settings for a second look, changed."""
        robust = super().robust(scatter)
        return robust if self.lines is None else changed(robust, json.loads(self.careful))


def trial(change: Change, particles: int) -> Trial:
    """Return the filter with one change."""
    whole = {
        f.name: change.config[f.name]
        for f in fields(RefinedConfig)
        if f.name in ("noise", "lines") and f.name in change.config
    }
    rest = {key: value for key, value in change.config.items() if key not in whole}
    return changed(Trial(particles=particles, careful=json.dumps(dict(change.careful)), **whole), rest)


def judged(case: Case) -> dict[str, Any]:
    """Run one filter on one drive; tell the error (m), and what share of the scans is off, and off without a word."""
    drive, every, change = case.get("drive"), case.get("every"), CHANGES[case.get("change")]
    recording, config = recording_of(drive), trial(change, case.get("particles"))
    group, _, name = drive.partition(" ")
    if group == "logs" or recording.default_every == 1:
        every = EVERY.get(name, 1)
    rng = np.random.default_rng(case.get("seed"))
    run = partial(run_slam, recording, replace(config, every=every), rng=rng, keep_particles=False)
    faults = {} if change.match is None else {"refined.map.match": change.match}
    result = with_fault(faults, partial(run, second_look=change.second_look))
    metres = errors(drive, recording, result)
    squares = group not in ("logs", "Intel")
    row = {"error_m": float(np.sqrt(np.mean(metres**2)) if squares else metres.mean())}
    row |= {"max_m": float(metres.max()), "second_look": int(result.second_look)}
    if squares:
        wrong, doubted = metres > OFF, in_doubt(result.distrust, result.trajectory.t)
        row |= {"off": float(wrong.mean()), "silent": float((wrong & ~doubted).mean())}
    return row


def errors(drive: str, recording: Recording, result: RefinedResult) -> np.ndarray:
    """How far (m) a run is from the truth, from a published path, or from known relations."""
    if drive == "Intel Intel":
        known = read_relations(data_folder() / "intel" / "intel.relations").at_stamps(result.trajectory.t)
        return relations_error(result.trajectory, known.t1, known.t2, known.poses)[0]
    if drive.startswith("logs"):
        return off(dead_reckoning(recording), result.trajectory)[0]
    poses, truth = aligned_at_first(result.trajectory, recording.true_path())
    return np.hypot(*(poses - truth)[:, :2].T)


STUDIES = [
    Study(
        "ch09_elimination",
        "The accurate filter without one ingredient, and with one that has left it: 118 runs each, with 50 particles.",
        tuple(
            Case(
                label, (("change", label), ("drive", drive), ("seed", seed), ("every", 10), ("particles", 50))
            )
            for drive, seed in DRIVES
            for label in CHANGES
        ),
        run=judged,
    )
]
