"""A long drive: what grows and what does not. ``python -m pfslam.bench.endurance --laps 36 --out table.csv``.

The built-in building is driven lap after lap. Scans are cast into a file chunk by chunk and read through a memory map.
One row of the table is the state of the run after one more minute of the drive.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from pfslam.bench.processes import peak_megabytes
from pfslam.config import SlamConfig
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.io.files import write_text
from pfslam.poses import Trajectory
from pfslam.runs import slam_steps
from pfslam.simulator import HALL, Simulation, SimulatorConfig
from pfslam.simulator.streams import simulate_to_file

NUMBER = 60


@dataclass(frozen=True)
class Milestone:
    """The run after ``minutes`` of the drive.

    ``scans`` recorded, ``updates`` made, ``seconds`` of work so far; ``private_mb`` is the process's own memory
    without pages of files, ``peak_mb`` the largest so far with them; ``map_cells`` of the grid, ``hit_cells`` of
    them with hits.
    Errors of the estimate so far: root mean square and largest (m), heading (deg).
    """

    minutes: float
    scans: int
    updates: int
    seconds: float
    private_mb: float
    peak_mb: float
    map_cells: int
    hit_cells: int
    ate_rmse_m: float
    ate_max_m: float
    heading_rmse_deg: float


def long_drive(laps: int) -> SimulatorConfig:
    """The built-in building driven ``laps`` times over; 36 laps are an hour."""
    return replace(HALL, name=f"hall{laps}", number=NUMBER, laps=laps, path_length=laps * HALL.path_length)


def private_megabytes() -> float:
    """Memory (MB) of this process that is no page of a file; NaN where the system does not tell."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return float("nan")
    return sum(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) / 1e3


def milestones(simulation: Simulation, config: SlamConfig, every: float = 60.0) -> Iterator[Milestone]:
    """Run the filter with seed 0 and report after each ``every`` seconds of the drive, and at its end."""
    recording, begun = simulation.recording, time.perf_counter()
    scans, stamps, poses = recording.scans(), [], []
    due = scans.t[0] + every
    for state, info in slam_steps(recording, config, np.random.default_rng(0)):
        stamps.append(info.t)
        poses.append(info.estimate)
        if info.t >= due:
            yield _milestone(recording, state, stamps, poses, time.perf_counter() - begun)
            due += every
    yield _milestone(recording, state, stamps, poses, time.perf_counter() - begun)


def _milestone(recording, state, stamps, poses, seconds: float) -> Milestone:
    t = recording.scans().t
    error = trajectory_error(Trajectory(np.array(stamps), np.array(poses)), recording.truth)
    return Milestone(
        minutes=(stamps[-1] - t[0]) / 60.0,
        scans=int(np.searchsorted(t, stamps[-1], side="right")),
        updates=len(stamps) - 1,
        seconds=seconds,
        private_mb=private_megabytes(),
        peak_mb=peak_megabytes(),
        map_cells=state.grid.log_odds.size,
        hit_cells=len(state.moments.sums) - 1,
        ate_rmse_m=error.ate_rmse_m,
        ate_max_m=error.ate_max_m,
        heading_rmse_deg=error.heading_rmse_deg,
    )


def table(rows: list[Milestone]) -> str:
    """Milestones as CSV with a header; six significant digits."""
    names = [f.name for f in fields(Milestone)]
    lines = [",".join(f"{value:.6g}" for value in asdict(row).values()) for row in rows]
    return "\n".join([",".join(names), *lines]) + "\n"


def main() -> int:
    """Drive, map, and write the table anew after every minute of the drive."""
    parser = argparse.ArgumentParser(description="A long drive in bounded memory.")
    parser.add_argument("--laps", type=int, default=36)
    parser.add_argument("--particles", type=int, default=200)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    config = replace(SlamConfig.refined(), particles=arguments.particles)
    rows: list[Milestone] = []
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        simulation = simulate_to_file(long_drive(arguments.laps), Path(folder) / "scans.npz")
        print(f"cast {len(simulation.recording.scans().t)} scans in {time.perf_counter() - begun:.0f} s")
        for row in milestones(simulation, config):
            rows.append(row)
            print(row, flush=True)
            if arguments.out is not None:
                write_text(arguments.out, table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
