"""Chapter 08: recordings with a hidden fault, and the numbers by which to name it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.grid import OccupancyGrid
from pfslam.motion import controls
from pfslam.recording import Recording
from pfslam_book.ch08.data import (
    BENDS,
    LAB,
    TURNS,
    corrections,
    drawn_by_odometry,
    ends_cut,
    metres_lost,
    turn_ratio,
)
from pfslam_book.ch08.exhibit import few_ticks, small_map
from pfslam_book.show.faults import (
    glass_pane,
    heading_from_wheels,
    late_scans,
    lidar_at,
    renumbered,
    scans_between,
    silent_gyro,
    skip_gaps,
)
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import new_figure
from pfslam_book.show.tables import Shown

FAULTS = ("healthy", "clock", "lever arm", "track", "renumbered beams", "lost second")
COLUMNS = ("delay [s]", "lever [m]", "turn ratio", "cut scans", "metres lost")


@dataclass(frozen=True, eq=False)
class MysteryRobot:
    """A recording's numbers under the names of ``COLUMNS``, the map that its odometry draws, and its hidden fault."""

    letter: str
    fault: str
    numbers: dict[str, float]
    grid: OccupancyGrid


def with_fault(recording: Recording, fault: str, rng: np.random.Generator) -> Recording:
    """Return the recording with a fault of random size and sign."""
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
        begin = float(rng.uniform(38.5, 41.0))
        return silent_gyro(recording, begin, begin + 1.0)
    return pane  # a healthy robot may meet glass


def measured(letter: str, fault: str, recording: Recording, healthy: Recording) -> MysteryRobot:
    """Return all numbers of one recording that may have a fault."""
    skips = fault == "lost second"
    lost = metres_lost(recording, skip_gaps) if skips else metres_lost(recording)
    inputs = skip_gaps(controls(recording)) if skips else None
    found = corrections(scans_between(recording, *BENDS))
    ratio = turn_ratio(recording, healthy, *LAB)
    values = (found.delay, float(found.lever[0]), ratio, ends_cut(recording), lost)
    numbers = {name: round(value, 2) + 0.0 for name, value in zip(COLUMNS, values, strict=True)}
    return MysteryRobot(letter, fault, numbers, drawn_by_odometry(scans_between(recording, *TURNS), inputs))


def mystery(recording: Recording, seed: int, robots: int = 4) -> list[MysteryRobot]:
    """Return some robots, each with another fault or none; which has which depends on the seed."""
    rng = np.random.default_rng(seed)
    faults = rng.permutation(FAULTS)[:robots]
    return [
        measured(letter, str(fault), with_fault(recording, str(fault), rng), recording)
        for letter, fault in zip("ABCDEF", faults, strict=False)
    ]


def mystery_table(robots: list[MysteryRobot]) -> Shown:
    """Return the numbers of all robots, one row each."""
    rows = ((r.letter, *(f"{r.numbers[name]:.2f}" for name in COLUMNS)) for r in robots)
    return Shown(("robot", *COLUMNS), rows)


def mystery_picture(robots: list[MysteryRobot]) -> Picture:
    """Draw what the odometry of each robot draws."""
    figure, axes = new_figure(6.2, 6.4, rows=2, columns=2)
    for ax, robot in zip(axes.flat, robots, strict=True):
        small_map(ax, robot.grid)
        few_ticks(ax, xlim=(-7, 5), ylim=(-6, 6.5), title=f"robot {robot.letter}")
    cells = [f"{r.letter}: {np.count_nonzero(r.grid.occupied)}" for r in robots]
    return Picture(
        figure, f"Maps drawn along odometry. Wall cells: {', '.join(cells)}. The fewer, the sharper."
    )
