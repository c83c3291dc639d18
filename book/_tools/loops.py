"""What closing loops did on simulated drives: a table, and one long drive before and after, stored for the book.

``python book/_tools/loops.py`` simulates and runs every drive anew; it takes several minutes.
"""

from __future__ import annotations

import csv
import io
import time
from dataclasses import replace

import numpy as np

from pfslam.config import SlamConfig
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.io.files import write_text
from pfslam.loops.closing import chain_edges, close_loops, key_scans
from pfslam.poses import between
from pfslam.recording import Recording
from pfslam.runs import run_slam
from pfslam.simulator import HALL, RING, simulate
from pfslam.teaching.ch12.drives import COLUMNS, FALSE, STORED, TABLE

CHANGES = (1.0, 0.98 / 1.02, 1.01 / 1.02)
"""The wheels of the ring count 2 % too much; in the second third of the drive 2 % too little, then 1 % too much."""


def with_changing_wheels(recording: Recording) -> Recording:
    """The same drive with another wheel scale in each third, as with another floor."""
    encoders = recording.encoders
    third = 3 * np.arange(len(encoders.t)) // len(encoders.t)
    rolled = np.cumsum(encoders.counts * np.array(CHANGES)[third][:, None], axis=0)
    counts = np.diff(np.rint(rolled), axis=0, prepend=0.0).astype(encoders.counts.dtype)
    return replace(recording, encoders=replace(encoders, counts=counts))


def drives():
    """Label, seed and recording of every drive."""
    ring = simulate(RING).recording
    yield "ring", 0, ring
    yield "ring, wheels change", 0, with_changing_wheels(simulate(replace(RING, laps=2)).recording)
    for seed in range(1, 7):
        yield "two corridors and a room", seed, simulate(HALL, seed).recording
    for seed in range(1, 4):
        yield "small ring, two laps", seed, simulate(replace(HALL, layout="loop", laps=2), seed).recording
    for seed in range(1, 4):
        config = replace(HALL, layout="symmetric", laps=2)
        yield "symmetric ring, two laps", seed, simulate(config, seed).recording


def row_of(label: str, seed: int, recording: Recording) -> dict:
    """Run one drive, revise it, and compare both with the truth; keep the drive with changing wheels."""
    begin = time.perf_counter()
    result = run_slam(recording, SlamConfig.matching(), keep_particles=False)
    done = time.perf_counter()
    revision = close_loops(recording, result)
    closed = time.perf_counter()
    t, loops, truth = result.trajectory.t, revision.loops, recording.truth
    at = truth.at(np.clip(t, *truth.t[[0, -1]]))
    error = between(between(*(at[revision.keys[n]] for n in (loops.i, loops.j))), loops.pose)
    chi2 = np.einsum("ei,eij,ej->e", error, loops.information, error)
    before, after = (trajectory_error(run.trajectory, truth).ate_rmse_m for run in (result, revision))
    if label == "ring, wheels change":
        store(result, revision, at)
    values = (label, seed, float(np.ptp(t)), before, after, revision.candidates, len(loops))
    values += (int(np.count_nonzero(chi2 > FALSE**2)), done - begin, closed - done)
    return dict(zip(COLUMNS, values, strict=True))


def store(result, revision, truth: np.ndarray) -> None:
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


def main() -> None:
    """Run all drives, and write the table."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for drive in drives():
        row = row_of(*drive)
        print(row, flush=True)
        writer.writerow({k: round(v, 5) if isinstance(v, float) else v for k, v in row.items()})
    write_text(TABLE, text.getvalue())


if __name__ == "__main__":
    main()
