"""How often, how soon and with how many particles a robot is found: ``python book/_tools/locate.py``.

Writes the three tables of chapter 10: ``locate.csv`` over simulated buildings and starts, ``poor.csv`` with a map that
lacks the furniture, and ``exact.csv``, how far clouds of several sizes are from a histogram filter on a small map.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from pfslam_book.ch10.building import distances, match_along, part, true_map, without_furniture
from pfslam_book.ch10.exact import distance_to_exact
from pfslam_book.ch10.measured import COLUMNS, EXACT, POOR, TABLE

from pfslam.beyond.localization import LocalizationConfig, locate, spread
from pfslam.io.files import write_text
from pfslam.particles import Particles
from pfslam.poses import Trajectory
from pfslam.simulator import simulate

BUILDINGS, STARTS, SECONDS = range(1, 11), (10.0, 45.0, 80.0), 30.0
NUMBERS, SEEDS = (100, 300, 1000, 3000, 10_000, 30_000), range(5)
WHOLE = LocalizationConfig()
VARIANTS = {
    "adaptive, with injection": WHOLE,
    "without injection": replace(WHOLE, inject=False),
    "1,000 particles, no injection": replace(WHOLE, first=1000, particles=1000, inject=False),
    "1,000 particles, with injection": replace(WHOLE, first=1000, particles=1000),
}


def row(
    label: str, building: int, start: float, path: Trajectory, recording, found_at, particles: float
) -> str:
    """Write one run as a line of the table."""
    away = distances(path, recording)
    at = -1 if found_at is None else int(np.searchsorted(path.t, found_at))
    truth = recording.true_path().at(path.t)
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])
    seconds = "" if found_at is None else f"{found_at - path.t[0]:.2f}"
    metres = "" if found_at is None else f"{travelled[at]:.2f}"
    first = "" if found_at is None else f"{away[at]:.2f}"
    cells = (f'"{label}"', building, start, seconds, metres, first, f"{away[-1]:.3f}", f"{particles:.0f}")
    return ",".join(map(str, cells))


def buildings() -> list[str]:
    """Run every variant, and scan matching from a random pose, in every building from every start."""
    rows = []
    for building in BUILDINGS:
        simulation = simulate("hall", building)
        grid = true_map(simulation)
        for start in STARTS:
            recording = part(simulation.recording, start, SECONDS)
            for label, config in VARIANTS.items():
                rng = np.random.default_rng([building, int(start)])
                result = locate(grid, recording, config, rng=rng, keep_particles=False)
                mean = np.mean([info.number for info in result.infos if info.used])
                rows.append(row(label, building, start, result.trajectory, recording, result.found_at, mean))
            guess = spread(grid, 1, np.random.default_rng([building, int(start)]))[0]
            path = match_along(grid, recording, guess)
            rows.append(row("scan matching, random start", building, start, path, recording, None, 1))
            print(*rows[-4:], sep="\n", flush=True)
    return rows


def poor_maps() -> list[str]:
    """Run with and without injection on plans without furniture, from nowhere and from a start that is known."""
    rows = []
    for building in BUILDINGS:
        simulation = simulate("hall", building)
        grid = true_map(without_furniture(simulation.world))
        for start in STARTS:
            recording = part(simulation.recording, start, SECONDS)
            first = recording.true_path().at(recording.scans().t[0])
            for inject in (True, False):
                config = replace(WHOLE, inject=inject)
                for known in (False, True):
                    rng = np.random.default_rng([building, int(start)])
                    poses = first + rng.normal(0.0, [0.05, 0.05, 0.02], (500, 3))
                    cloud = Particles(poses, np.zeros(500)) if known else None
                    rng = rng if known else np.random.default_rng([building, int(start)])
                    result = locate(grid, recording, config, rng=rng, start=cloud, keep_particles=False)
                    end = distances(result.trajectory, recording)[-1]
                    rows.append(f"{building},{start},{int(known)},{int(inject)},{end:.2f}")
    return rows


def main() -> None:
    """Write the tables."""
    write_text(Path(POOR), "\n".join(["building,start_s,known,inject,error_at_end_m", *poor_maps()]) + "\n")
    exact = [f"{n},{seed},{distance_to_exact(n, seed):.4f}" for n in NUMBERS for seed in SEEDS]
    write_text(Path(EXACT), "\n".join(["particles,seed,total_variation", *exact]) + "\n")
    print(*exact, sep="\n", flush=True)
    write_text(Path(TABLE), "\n".join([",".join(COLUMNS), *buildings()]) + "\n")


if __name__ == "__main__":
    main()
