"""What closing loops did: tables, one long drive as a graph with its maps, and a real log, stored for the book.

``python book/_tools/loops.py DATA`` simulates and runs every drive anew, on all cores, and the public Intel log,
``DATA/intel.log`` with ``DATA/intel.relations``, which itself is never stored.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from pfslam_book.ch10.building import driven, two_halves, world_of
from pfslam_book.ch11.drives import FALSE, TABLES
from pfslam_book.show.intel import RETURN_SECONDS

import pfslam
from pfslam.beyond.loops import closing
from pfslam.beyond.loops.graph import Edges, relax
from pfslam.beyond.loops.places import Place, align
from pfslam.evaluation.trajectory import relations_error, trajectory_error
from pfslam.grid import OccupancyGrid
from pfslam.io.files import write_csv
from pfslam.io.formats import read_relations
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, between, compose
from pfslam.recording import Recording
from pfslam.run import SlamResult, run_slam, used_scans
from pfslam.simulator import HALL, simulate
from pfslam.simulator.config import RING
from pfslam.slam import SlamConfig

CHAIN_SIGMAS = 5.0
"""How much less a match to one scan is worth than one to the map."""
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


def row_of(label: str, seed: int, make: Callable[[], Recording]) -> tuple:
    """Run one drive, revise it, and compare both with the truth; keep the first drive with changing wheels."""
    recording = make()
    result = run_slam(recording, SlamConfig.matching(), keep_particles=False)
    begin = time.process_time()
    revision = closing.close_loops(recording, result)
    seconds = time.process_time() - begin
    t, loops, truth = result.trajectory.t, revision.loops, recording.truth
    at = truth.at(np.clip(t, *truth.t[[0, -1]]))
    error = between(between(*(at[revision.keys[n]] for n in (loops.i, loops.j))), loops.pose)
    off = np.hypot(*error[:, :2].T)
    before, after = (trajectory_error(run.trajectory, truth).ate_rmse_m for run in (result, revision))
    if (label, seed) in STORED:
        store(STORED[label, seed], recording, result, revision, at)
    values = (label, seed, float(np.ptp(t)), before, after, revision.candidates, len(loops), revision.across)
    values += (int(np.count_nonzero(off > FALSE)), float(off.max(initial=0.0)), seconds)
    print(*values, flush=True)
    return values


def loops_of(places: list[Place], at: np.ndarray, pairs: list) -> Edges:
    """Those of the pairs that match and support each other."""
    return closing.consistent(closing.matched(places, at, pairs, closing.AROUND, closing.LOOP_FLOOR), at)


def graph_of(recording: Recording, result: SlamResult) -> tuple[np.ndarray, dict[str, Edges]]:
    """The key scans and the edges of a run: the chain, scans matched to near ones, and the loops."""
    keys = closing.key_scans(result)
    events, at = used_scans(recording, result.config).events(), result.trajectory.poses[keys]
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


def intel(data: Path) -> None:
    """A real log from consecutive scans alone, mended in three rounds, each of which searches half as far."""
    log = pfslam.load(data / "intel.log")
    matched_to_map = run_slam(log, replace(SlamConfig.matching(), every=1))
    t, events = matched_to_map.trajectory.t, list(used_scans(log, matched_to_map.config).events())
    everything = [Place.of(event) for event in events]
    poses = consecutive(log, matched_to_map, everything)
    infos = [replace(info, free_direction=None, matched=True) for info in matched_to_map.infos]
    drifted = replace(matched_to_map, trajectory=Trajectory(t, poses), infos=infos)
    keys = closing.key_scans(drifted)
    at, places, chain = poses[keys], [everything[k] for k in keys], closing.chain_edges(drifted, keys)
    chain = replace(chain, information=chain.information / CHAIN_SIGMAS**2)
    paths, counts, path = {"to the map": matched_to_map.trajectory.poses, "before": poses}, {}, at
    for turn, reach in enumerate((8.0, 4.0, 2.0), 1):
        pairs = [
            (i, j, min(r, reach))
            for i, j, r in closing.find_candidates(path)
            if np.hypot(*(path[i] - path[j])[:2]) < reach
        ]
        loops = loops_of(places, path, pairs)
        path, _, weights = relax(chain.joined(loops), at)
        loops = loops.chosen(weights[len(chain) :] > 0.5)
        paths[f"round {turn}"], counts[f"round {turn}"] = closing.carried(poses, keys, path), len(loops)
    relations, rows = read_relations(data / "intel.relations").at_stamps(log.scans().t), []
    far = np.abs(relations.t2 - relations.t1) > RETURN_SECONDS
    for name, path in paths.items():
        off, _ = relations_error(Trajectory(t, path), relations.t1, relations.t2, relations.poses)
        errors = (off[~far].mean(), np.median(off[far]), off[far].mean(), off[far].max())
        rows.append((name, counts.get(name, 0), int(sum(~far)), int(sum(far)), *errors))
    write_table("intel", "path,loops,short,returns,short_m,median_m,returns_m,worst_m", rows)
    arrays = {"ends": np.column_stack([loops.i, loops.j]).astype(np.int16)}
    for name, path in (("before", poses), ("after", paths["round 3"])):
        arrays |= stored_map(name, closing.redrawn(log, drifted, path))
        arrays[f"{name}_path"] = path[keys].astype(np.float32)
    np.savez_compressed(TABLES / "intel.npz", **arrays)


def write_table(name: str, columns: str, rows: list[tuple]) -> None:
    """Write a table, its numbers rounded to five digits after the point."""
    rows = [[round(float(v), 5) if isinstance(v, float) else v for v in row] for row in rows]
    write_csv(TABLES / f"{name}.csv", [columns.split(","), *rows])


def main(data: Path) -> None:
    """Run all drives and the log, and write the tables."""
    intel(data)
    columns = "drive,seed,seconds,before_m,after_m,candidates,accepted,across,far,farthest_m,loops_s"
    write_table("loops", columns, Parallel(-1)(delayed(row_of)(*drive) for drive in drives()))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
