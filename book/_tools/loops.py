"""What closing loops did on simulated drives: tables, and one long drive before and after, stored for the book.

``python book/_tools/loops.py DATA`` simulates and runs every drive anew, on all cores, and then the two recordings
that are never stored, ``DATA/intel/intel.log`` (with ``intel.relations``) and set 95 in ``DATA/hard/ring95``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from pfslam_book.ch10.building import driven, two_halves, world_of
from pfslam_book.ch11.drives import COLUMNS, FALSE, GIVEN, GIVEN_COLUMNS, STORED, TABLE
from pfslam_book.show.intel import RETURN_SECONDS

import pfslam
from pfslam.beyond.loops.closing import Revision, chain_edges, close_loops, key_scans
from pfslam.evaluation.trajectory import relations_error, trajectory_error
from pfslam.io.files import write_csv
from pfslam.io.formats import read_relations
from pfslam.poses import Trajectory, between
from pfslam.recording import Recording
from pfslam.run import SlamResult, run_slam
from pfslam.simulator import HALL, simulate
from pfslam.simulator.config import RING
from pfslam.slam import SlamConfig

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
    lap = [
        (2.5, -0.2),
        (20.0, -0.3),
        (38.5, -0.1),
        (39.2, 2.5),
        (37.5, 5.2),
        (20.0, 5.3),
        (1.5, 5.1),
        (0.8, 2.5),
    ]
    return driven(world_of(np.vstack([corridor, corridor + shift, ends]), np.array(2 * lap)), seed)


def drives() -> Iterator[tuple[str, int, Callable[[], Recording]]]:
    """Label and seed of every drive, and what makes its recording."""

    def simulated(config, seed=None):
        return simulate(config, seed).recording

    yield "ring", 0, partial(simulated, RING)
    for seed in (None, 1):
        ring = partial(simulated, replace(RING, laps=2), seed)
        yield "ring, wheels change", seed or 0, lambda ring=ring: with_changing_wheels(ring())
    for seed in range(1, 21):
        yield "two corridors and a room", seed, partial(simulated, HALL, seed)
    for label, layout in (("small ring, two laps", "loop"), ("symmetric ring, two laps", "symmetric")):
        for seed in range(1, 4):
            yield label, seed, partial(simulated, replace(HALL, layout=layout, laps=2), seed)
    for seed, door in enumerate((False, True)):
        yield "two halves alike", seed, lambda door=door: two_halves(door).recording
    for twin, label in ((False, "corridor, equal doors"), (True, "two corridors alike")):
        for seed, every in enumerate((2.4, 3.0, 4.0), 1):
            yield label, seed, partial(alike, every, twin, seed)


def revised(recording: Recording, config: SlamConfig) -> tuple[SlamResult, Revision, float, float]:
    """Run a drive and revise it, and measure the processor's time (s) for each."""
    begin = time.process_time()
    result = run_slam(recording, config, keep_particles=False)
    done = time.process_time()
    revision = close_loops(recording, result)
    return result, revision, done - begin, time.process_time() - done


def row_of(label: str, seed: int, make: Callable[[], Recording]) -> tuple:
    """Run one drive, revise it, and compare both with the truth; keep the first drive with changing wheels."""
    recording = make()
    result, revision, run_s, loops_s = revised(recording, SlamConfig.matching())
    t, loops, truth = result.trajectory.t, revision.loops, recording.truth
    at = truth.at(np.clip(t, *truth.t[[0, -1]]))
    error = between(between(*(at[revision.keys[n]] for n in (loops.i, loops.j))), loops.pose)
    chi2 = np.einsum("ei,eij,ej->e", error, loops.information, error)
    before, after = (trajectory_error(run.trajectory, truth).ate_rmse_m for run in (result, revision))
    if (label, seed) == ("ring, wheels change", 0):
        store(result, revision, at)
    values = (label, seed, float(np.ptp(t)), before, after, revision.candidates, len(loops))
    values += (int(np.count_nonzero(chi2 > FALSE**2)), run_s, loops_s)
    print(*values, flush=True)
    return values


def store(result: SlamResult, revision: Revision, truth: np.ndarray) -> None:
    """Keep paths, maps and the graph of one drive, small."""
    arrays = {"keys": revision.keys, "scale": revision.scale.astype(np.float32)}
    arrays["wheels"] = chain_edges(result, key_scans(result)).wheels.astype(np.float32)
    arrays["ends"] = np.column_stack([revision.loops.i, revision.loops.j])
    arrays["t"], arrays["truth"] = result.trajectory.t, truth.astype(np.float32)
    for name, run in (("before", result), ("after", revision)):
        arrays[f"{name}_path"] = run.trajectory.poses.astype(np.float32)
        arrays[f"{name}_map"] = np.sign(run.grid.log_odds).astype(np.int8)
        arrays[f"{name}_corner"] = np.array([*run.grid.spec.origin, run.grid.spec.resolution])
    np.savez_compressed(STORED, **arrays)


def given(data: Path) -> Iterator[tuple]:
    """Run the two recordings that are not stored: another ring, and a real building, judged by its relations."""
    ring = pfslam.load("95", data / "hard" / "ring95")
    result, revision, *seconds = revised(ring, SlamConfig.matching())
    errors = (trajectory_error(run.trajectory, ring.truth).ate_rmse_m for run in (result, revision))
    yield "another ring", float(np.ptp(result.trajectory.t)), *errors, len(revision.loops), *seconds
    intel = pfslam.load(data / "intel" / "intel.log")
    relations = read_relations(data / "intel" / "intel.relations").at_stamps(intel.scans().t)
    result, revision, *seconds = revised(intel, replace(SlamConfig.matching(), every=1))
    far = np.abs(relations.t2 - relations.t1) > RETURN_SECONDS

    def off(path: Trajectory) -> np.ndarray:
        return relations_error(path, relations.t1, relations.t2, relations.poses)[0]

    for label, which in (("Intel, all relations", slice(None)), ("Intel, returns", far)):
        errors = (off(run.trajectory)[which].mean() for run in (result, revision))
        yield label, float(np.ptp(result.trajectory.t)), *errors, len(revision.loops), *seconds


def write_table(path: Path, columns: tuple[str, ...], rows: list[tuple]) -> None:
    """Write a table, its numbers rounded to five digits after the point."""
    write_csv(path, [columns, *([round(v, 5) if isinstance(v, float) else v for v in row] for row in rows)])


def main(data: Path) -> None:
    """Run all drives, and write the tables."""
    write_table(GIVEN, GIVEN_COLUMNS, list(given(data)))
    write_table(TABLE, COLUMNS, Parallel(-1)(delayed(row_of)(*drive) for drive in drives()))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
