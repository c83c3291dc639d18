"""Chapter 08: recordings with a hidden fault, and the numbers by which to name it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.grid import OccupancyGrid
from pfslam.motion import controls
from pfslam.recording import Recording
from pfslam.teaching.ch08.data import (
    BENDS,
    LAB,
    TURNS,
    corrections,
    cut,
    drawn_by_odometry,
    ends_cut,
    metres_lost,
    turn_ratio,
)
from pfslam.teaching.ch08.exhibit import few_ticks, small_map
from pfslam.teaching.show.faults import (
    glass_pane,
    gyro_gap,
    heading_from_wheels,
    late_scans,
    lidar_at,
    renumbered,
    skip_gaps,
)
from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import new_figure

FAULTS = ("healthy", "clock", "lever arm", "track", "renumbered beams", "lost second")
COLUMNS = ("delay [s]", "lever [m]", "turn ratio", "cut scans", "metres lost")


@dataclass(frozen=True, eq=False)
class Patient:
    """A recording, the numbers of ``COLUMNS`` measured on it, the map that its odometry draws, and its fault."""

    letter: str
    fault: str
    numbers: dict[str, float]
    grid: OccupancyGrid


def fall_ill(recording: Recording, fault: str, rng: np.random.Generator) -> Recording:
    """The recording with a fault of random size and sign."""
    x, y, _ = recording.robot.lidar.position_b
    sign = rng.choice([-1.0, 1.0])
    if fault == "clock":
        return late_scans(recording, sign * rng.uniform(0.08, 0.2))
    if fault == "lever arm":
        return lidar_at(recording, x + sign * rng.uniform(0.15, 0.3), y)
    if fault == "track":
        return heading_from_wheels(recording)
    pane = glass_pane(recording, int(rng.integers(200, 700)), int(rng.integers(30, 60)))
    if fault == "renumbered beams":
        return renumbered(pane)
    if fault == "lost second":
        return gyro_gap(recording, float(rng.uniform(38.5, 41.0)), 1.0)
    return pane  # a healthy robot may meet glass


def examine(letter: str, fault: str, ill: Recording, healthy: Recording) -> Patient:
    """Measure everything on one recording."""
    lost = metres_lost(ill, skip_gaps) if fault == "lost second" else metres_lost(ill)
    inputs = skip_gaps(controls(ill)) if fault == "lost second" else None
    found = corrections(cut(ill, *BENDS))
    values = (found.delay, float(found.lever[0]), turn_ratio(ill, healthy, *LAB), ends_cut(ill), lost)
    numbers = {name: round(value, 2) + 0.0 for name, value in zip(COLUMNS, values, strict=True)}
    return Patient(letter, fault, numbers, drawn_by_odometry(cut(ill, *TURNS), inputs))


def mystery(recording: Recording, seed: int, patients: int = 4) -> list[Patient]:
    """Some patients, each with another fault, or none; which has which depends on the seed."""
    rng = np.random.default_rng(seed)
    faults = rng.permutation(FAULTS)[:patients]
    return [
        examine(letter, str(fault), fall_ill(recording, str(fault), rng), recording)
        for letter, fault in zip("ABCDEF", faults, strict=False)
    ]


def chart(patients: list[Patient]) -> str:
    """The numbers of all patients, one line each."""
    lines = [" " * 8 + "".join(f"{name:>13s}" for name in COLUMNS)]
    for p in patients:
        lines.append(f"{p.letter:8s}" + "".join(f"{p.numbers[name]:13.2f}" for name in COLUMNS))
    return "\n".join(lines)


def ward_picture(patients: list[Patient]) -> Picture:
    """What the odometry of each patient draws."""
    figure, axes = new_figure(6.2, 6.4, rows=2, columns=2)
    for ax, patient in zip(axes.flat, patients, strict=True):
        small_map(ax, patient.grid)
        few_ticks(ax, xlim=(-7, 5), ylim=(-6, 6.5), title=f"patient {patient.letter}")
    cells = [f"{p.letter}: {np.count_nonzero(p.grid.occupied)}" for p in patients]
    return Picture(
        figure, f"Maps drawn along odometry. Wall cells: {', '.join(cells)}. The fewer, the sharper."
    )
