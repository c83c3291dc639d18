"""How often, how soon and with how many particles a robot is found: ``python book/_tools/locate.py``.

Writes the three tables of chapter 10: ``locate.csv`` over simulated buildings and starts, ``poor.csv`` with a map that
lacks the furniture, and ``twins.csv``, how twenty clouds share their weight between two places that look alike.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pfslam_book.ch10.building import (
    TABLES,
    distances,
    match_along,
    part,
    shares,
    true_map,
    two_halves,
    without_furniture,
)

from pfslam.beyond.localization import LocalizationConfig, locate, spread
from pfslam.io.files import write_text
from pfslam.particles import Particles
from pfslam.poses import Trajectory
from pfslam.simulator import simulate

BUILDINGS, STARTS, SECONDS = range(1, 11), (10.0, 45.0, 80.0), 30.0
SEEDS, HEAPS = range(20), (500, 5000)
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


def twins() -> list[str]:
    """Search the building of two halves with its door and without, and let two even heaps drift in it."""
    rows = []
    for label, config in (("door", WHOLE), ("no door", WHOLE), *((f"drift {n}", heaps(n)) for n in HEAPS)):
        place = two_halves(door=label == "door")
        first = place.recording.true_path().poses[0]
        for seed in SEEDS:
            rng = np.random.default_rng(seed)
            n, start = config.least, None
            if "drift" in label:
                sides = np.where(np.arange(n)[:, None] % 2, first, place.twin(first))
                start = Particles(sides + rng.normal(0.0, [0.05, 0.05, 0.02], (n, 3)), np.zeros(n))
            result = locate(place.grid, place.recording, config, rng=rng, start=start)
            t = result.trajectory.t - result.trajectory.t[0]
            infos = result.infos[int(np.argmin(np.abs(t - 10.0)))], result.infos[-1]
            early, end = (shares(place, i.t, i.particles.poses, i.particles.weights) for i in infos)
            sure = int(np.argmax(result.located))
            right = distances(result.trajectory, place.recording)[sure] <= 0.5
            found = f"{t[sure]:.2f},{int(right)}" if result.located.any() else ","
            rows.append(f"{label},{seed},{early[0] / sum(early):.3f},{end[0] / sum(end):.3f},{found}")
            print(rows[-1], flush=True)
    return rows


def heaps(n: int) -> LocalizationConfig:
    """Hold the number of particles at ``n`` and draw none anew: what is left is chance."""
    return replace(WHOLE, particles=n, least=n, inject=False)


def main() -> None:
    """Write the tables."""
    head = "cloud,seed,share_10s,share_end,sure_after_s,sure_right"
    write_text(TABLES / "twins.csv", "\n".join([head, *twins()]) + "\n")
    head = "building,start_s,known,inject,error_at_end_m"
    write_text(TABLES / "poor.csv", "\n".join([head, *poor_maps()]) + "\n")
    head = "label,building,start_s,seconds_to_find,metres_to_find,error_when_found_m,error_at_end_m,particles"
    write_text(TABLES / "locate.csv", "\n".join([head, *buildings()]) + "\n")


if __name__ == "__main__":
    main()
