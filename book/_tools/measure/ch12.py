"""Chapter 12: what closing loops did on simulated drives, and on the public Intel log.

``python -m measure.ch12``, in ``book/_tools``, keeps two drives with their graphs and maps, and the log's paths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from pfslam_book.ch10.building import driven, two_halves, world_of
from pfslam_book.ch12.drives import FALSE, TABLES
from pfslam_book.show.intel import RETURN_SECONDS

from measure import cases
from measure.intel import intel_log
from pfslam.beyond.loops import closing
from pfslam.beyond.loops.graph import Edges, relax
from pfslam.beyond.loops.places import Place, align
from pfslam.evaluation.trajectory import relations_error, trajectory_error
from pfslam.grid import OccupancyGrid
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, between, compose
from pfslam.recording import Recording
from pfslam.run import SlamResult, run_slam
from pfslam.simulator import HALL, simulate
from pfslam.simulator.config import RING
from pfslam.slam import SlamConfig
from pfslam.study import Case, Study

CHAIN_SIGMAS = 5.0
"""How much less a match to one scan is worth than one to the map."""
ROUNDS = ("round 1", "round 2", "round 3")
STORED = {("ring, wheels change", 0): "ring", ("long corridor, wheels change", 1): "corridor"}
"""The drives whose graphs and maps are kept."""
CHANGES = (1.0, 0.98 / 1.02, 1.01 / 1.02)
"""The wheels of the ring count 2 % too much; in the second third of the drive 2 % too little, then 1 % too much."""


def with_changing_wheels(recording: Recording) -> Recording:
    """The same drive with another wheel scale in each third, as with another floor."""
    encoders = recording.encoders
    third = 3 * np.arange(len(encoders.t)) // len(encoders.t)
    rolled = np.cumsum(encoders.counts * np.array(CHANGES)[third][:, None], axis=0)
    counts = np.diff(np.rint(rolled), axis=0, prepend=0.0).astype(encoders.counts.dtype)
    return replace(recording, encoders=replace(encoders, counts=counts))


def alike(every: float, twin: bool, seed: int) -> Recording:
    """A corridor of 40 m with a shallow door every so many metres on both sides, driven there and back, twice.

    With a ``twin``, the same corridor again 5 m beside it, joined at both ends: the drive is two laps round both.
    """
    shift = np.array([0.0, 5.0, 0.0, 5.0])
    doors = [(x, -1.15, x + 0.9, 1.15) for x in np.arange(2.5, 37.0, every)]
    corridor = np.array([(0.0, -1.0, 40.0, 1.0), *doors])
    if not twin:
        lap = [(2.0, -0.2), (20.0, -0.3), (38.0, -0.2), (38.4, 0.2), (20.0, 0.3), (1.6, 0.2)]
        return driven(world_of(corridor, np.array(2 * lap)), seed)
    ends = [(0.0, -1.0, 2.0, 6.0), (38.0, -1.0, 40.0, 6.0)]
    x, y = (2.5, 20.0, 38.5, 39.2, 37.5, 20.0, 1.5, 0.8), (-0.2, -0.3, -0.1, 2.5, 5.2, 5.3, 5.1, 2.5)
    return driven(
        world_of(np.vstack([corridor, corridor + shift, ends]), np.column_stack([2 * x, 2 * y])), seed
    )


def slipping(recording: Recording, seed: int) -> Recording:
    """The same drive, but six times for a little more than a second the wheels lock, or spin at twice their speed."""
    rng, encoders = np.random.default_rng(seed), recording.encoders
    t, counts = encoders.t - encoders.t[0], encoders.counts.astype(float)
    for begin in np.linspace(15.0, t[-1] - 15.0, 6) + rng.uniform(-5.0, 5.0, 6):
        counts[(t >= begin) & (t < begin + 1.2)] *= rng.choice([0.0, 2.0])
    return replace(recording, encoders=replace(encoders, counts=counts.astype(encoders.counts.dtype)))


def long_corridor(seed: int) -> Recording:
    """A bare corridor of 70 m, there and back, twice; four shallow doors near its ends."""
    doors = [(x, -1.15, x + 0.9, 1.15) for x in (3.0, 7.5, 62.0)]
    lap = [(2.0, -0.2), (35.0, -0.3), (68.0, -0.2), (68.4, 0.2), (35.0, 0.3), (1.6, 0.2)]
    return driven(world_of(np.array([(0.0, -1.0, 70.0, 1.0), *doors]), np.array(2 * lap)), seed)


def drives() -> Iterator[tuple[str, int, Callable[[], Recording]]]:
    """Label and seed of every drive, and what makes its recording."""

    def simulated(config, seed=None):
        return simulate(config, seed).recording

    yield "ring", 0, partial(simulated, RING)
    for laps, label in ((2, "ring, wheels change"), (1, "one lap, wheels change")):
        for seed in range(6):
            ring = partial(simulated, replace(RING, laps=laps), seed or None)
            yield label, seed, lambda ring=ring: with_changing_wheels(ring())
    for percent in (4, 6):
        counted = RING.slip.true_metres_per_count * 1.02 / (1.0 + percent / 100.0)
        ring = replace(RING, slip=replace(RING.slip, true_metres_per_count=counted))
        for seed in (1, 2):
            yield f"one lap, wheels {percent} %", seed, partial(simulated, ring, seed)
    for seed in range(1, 21):
        yield "two corridors and a room", seed, partial(simulated, HALL, seed)
    for label, layout in (("small ring, two laps", "loop"), ("symmetric ring, two laps", "symmetric")):
        for seed in range(1, 4):
            yield label, seed, partial(simulated, replace(HALL, layout=layout, laps=2), seed)
    for seed, door in enumerate((False, True)):
        yield "two halves alike", seed, lambda door=door: two_halves(door).recording
    for seed, every in enumerate((2.4, 3.0, 4.0), 1):
        for label, make in (
            ("corridor, equal doors", partial(alike, every, False, seed)),
            ("two corridors alike", partial(alike, every, True, seed)),
            ("long corridor", partial(long_corridor, seed)),
        ):
            if label != "long corridor":
                yield label, seed, make
            yield label + ", wheels change", seed, lambda make=make: with_changing_wheels(make())
            yield label + ", wheels slip", seed, lambda make=make, seed=seed: slipping(make(), seed)


def revised(drive: tuple[str, int]) -> tuple[Recording, SlamResult, closing.Revision, np.ndarray]:
    """Run one drive and revise it; return both with the true poses."""
    recording = {(label, seed): make for label, seed, make in drives()}[drive]()
    result = run_slam(recording, SlamConfig.matching(), keep_particles=False)
    t, truth = result.trajectory.t, recording.true_path()
    return recording, result, closing.close_loops(recording, result), truth.at(np.clip(t, *truth.t[[0, -1]]))


def loops_of_drive(case: Case) -> dict[str, Any]:
    """Compare a drive before and after its revision with the truth, and each of its loops."""
    recording, result, revision, at = revised((case.label, case.get("seed")))
    t, loops, truth = result.trajectory.t, revision.loops, recording.true_path()
    error = between(between(*(at[revision.keys[n]] for n in (loops.i, loops.j))), loops.pose)
    off = np.hypot(*error[:, :2].T)
    return {
        "seconds": float(np.ptp(t)),
        "before_m": trajectory_error(result.trajectory, truth).ate_rmse_m,
        "after_m": trajectory_error(revision.trajectory, truth).ate_rmse_m,
        "candidates": revision.candidates,
        "accepted": len(loops),
        "across": revision.across,
        "far": int(np.count_nonzero(off > FALSE)),
        "farthest_m": float(off.max(initial=0.0)),
    }


def loops_of(places: list[Place], at: np.ndarray, pairs: list) -> Edges:
    """Those of the pairs that match and support each other."""
    return closing.consistent(closing.matched(places, at, pairs, closing.AROUND, closing.LOOP_FLOOR), at)


def graph_of(recording: Recording, result: SlamResult) -> tuple[np.ndarray, dict[str, Edges]]:
    """The key scans and the edges of a run: the chain, scans matched to near ones, and the loops."""
    keys = closing.key_scans(result)
    events, at = result.config.used_scans(recording).events(), result.trajectory.poses[keys]
    places = [Place.of(event) for k, event in enumerate(events) if k in keys]
    chain = closing.chain_edges(result, keys)
    loops = loops_of(places, at, closing.find_candidates(at))
    near = closing.matched(places, at, closing.neighbours(chain), 0, closing.NEIGHBOUR_FLOOR)
    return keys, {"chain": chain, "near": near, "loops": closing.confirming(loops, at)}


def store(
    name: str, recording: Recording, result: SlamResult, revision: closing.Revision, truth: np.ndarray
) -> None:
    """Keep one drive small: its graph, its key poses before, after and true, and its maps."""
    keys, edges = graph_of(recording, result)
    arrays = {"scale": revision.scale.astype(np.float32), "t": result.trajectory.t[keys]}
    for kind, some in edges.items():
        for part in fields(Edges):
            values = getattr(some, part.name)
            arrays[f"{kind}_{part.name}"] = values.astype(np.float32 if values.dtype == float else np.int16)
    for when, run in (("before", result), ("after", revision)):
        arrays |= stored_map(when, run.grid)
    paths = {"before": result.trajectory.poses, "after": revision.trajectory.poses, "truth": truth}
    arrays |= {f"{when}_path": poses[keys].astype(np.float32) for when, poses in paths.items()}
    np.savez_compressed(TABLES / f"{name}.npz", **arrays)


def stored_map(name: str, grid: OccupancyGrid) -> dict[str, np.ndarray]:
    """The signs of a map's cells, and where it lies."""
    corner = np.array([*grid.spec.origin, grid.spec.resolution])
    return {f"{name}_map": np.sign(grid.log_odds).astype(np.int8), f"{name}_corner": corner}


def consecutive(recording: Recording, result: SlamResult, places: list[Place]) -> np.ndarray:
    """The path when each scan is matched to the one before it and to nothing else."""
    t, poses = result.trajectory.t, [result.trajectory.poses[0]]
    odometry = dead_reckoning(recording).at(t)
    for k in range(1, len(t)):
        guess = between(odometry[k - 1], odometry[k])
        poses.append(compose(poses[-1], align(places[k - 1], places[k], guess)))
    return np.array(poses)


@lru_cache(maxsize=1)
def intel_paths() -> tuple[dict[str, Trajectory], dict[str, int], dict[str, np.ndarray]]:
    """The log's path from consecutive scans alone, mended in three rounds, each of which searches half as far.

    Returns the paths by name, how many loops were left after each round, and the first and the last path as arrays
    with their maps.
    """
    log, _ = intel_log()
    matched_to_map = run_slam(log, replace(SlamConfig.matching(), every=1))
    t, events = matched_to_map.trajectory.t, list(matched_to_map.config.used_scans(log).events())
    everything = [Place.of(event) for event in events]
    poses = consecutive(log, matched_to_map, everything)
    infos = [replace(info, silent_direction=None, matched=True) for info in matched_to_map.infos]
    drifted = replace(matched_to_map, trajectory=Trajectory(t, poses), infos=infos)
    keys = closing.key_scans(drifted)
    at, places, chain = poses[keys], [everything[k] for k in keys], closing.chain_edges(drifted, keys)
    chain = replace(chain, information=chain.information / CHAIN_SIGMAS**2)
    paths, counts, path = {"to the map": matched_to_map.trajectory.poses, "before": poses}, {}, at
    for name, reach in zip(ROUNDS, (8.0, 4.0, 2.0), strict=True):
        pairs = [
            (i, j, min(r, reach))
            for i, j, r in closing.find_candidates(path)
            if np.hypot(*(path[i] - path[j])[:2]) < reach
        ]
        loops = loops_of(places, path, pairs)
        path, _, weights = relax(chain.joined(loops), at)
        loops = loops.chosen(weights[len(chain) :] > 0.5)
        paths[name], counts[name] = closing.carried(poses, keys, path), len(loops)
    arrays = {"ends": np.column_stack([loops.i, loops.j]).astype(np.int16)}
    for name, path in (("before", poses), ("after", paths[ROUNDS[-1]])):
        arrays |= stored_map(name, closing.redrawn(log, drifted, path))
        arrays[f"{name}_path"] = path[keys].astype(np.float32)
    return {name: Trajectory(t, path) for name, path in paths.items()}, counts, arrays


def intel_errors(case: Case) -> dict[str, Any]:
    """Judge one path of the log by its relations: short ones, and those between visits far apart in time."""
    paths, loops, _ = intel_paths()
    _, relations = intel_log()
    off, _ = relations_error(paths[case.label], relations.t1, relations.t2, relations.poses)
    far = np.abs(relations.t2 - relations.t1) > RETURN_SECONDS
    counts = {"loops": loops.get(case.label, 0), "short": int(sum(~far)), "returns": int(sum(far))}
    errors = {"short_m": off[~far].mean(), "median_m": np.median(off[far])}
    return counts | errors | {"returns_m": off[far].mean(), "worst_m": off[far].max()}


STUDIES = [
    Study(
        "ch12_loops",
        "What closing loops did on simulated drives, each loop judged by the truth.",
        tuple(Case(label, (("drive", label), ("seed", seed))) for label, seed, _ in drives()),
        run=loops_of_drive,
    ),
    Study(
        "ch12_intel",
        "A real log, mended by its loops, judged by its relations.",
        cases("path", path=["to the map", "before", *ROUNDS]),
        run=intel_errors,
    ),
]


if __name__ == "__main__":
    for drive, name in STORED.items():
        store(name, *revised(drive))
    np.savez_compressed(TABLES / "intel.npz", **intel_paths()[2])
