"""How often, how soon and with how many particles a robot is found: ``python book/_tools/locate.py``.

Writes the two tables of chapter 11: ``locate.csv`` over simulated buildings and starts, and ``exact.csv``, how far
clouds of several sizes are from a histogram filter on a small map.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pfslam.io.files import write_text
from pfslam.localization import LocalizationConfig, locate, spread
from pfslam.poses import Trajectory
from pfslam.simulator import simulate
from pfslam.teaching.ch11.building import distances, match_along, part, true_map
from pfslam.teaching.ch11.exact import distance_to_exact
from pfslam.teaching.ch11.measured import COLUMNS, EXACT, TABLE

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


def main() -> None:
    """Write both tables."""
    exact = [f"{n},{seed},{distance_to_exact(n, seed):.4f}" for n in NUMBERS for seed in SEEDS]
    write_text(Path(EXACT), "\n".join(["particles,seed,total_variation", *exact]) + "\n")
    print(*exact, sep="\n", flush=True)
    write_text(Path(TABLE), "\n".join([",".join(COLUMNS), *buildings()]) + "\n")


if __name__ == "__main__":
    main()
