"""Chapter 08: recordings with a hidden fault, and the numbers by which to name it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pfslam.grid import OccupancyGrid
from pfslam.motion import controls
from pfslam.recording import Recording
from pfslam_book.ch08.data import BENDS, corrections, distance_gap, ends_cut, map_by_odometry, turn_ratio
from pfslam_book.show import faults

HIDDEN = ("healthy", "clock", "lever arm", "track", "renumbered beams", "lost second")
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
        return faults.late_scans(recording, sign * rng.uniform(0.08, 0.2))
    if fault == "lever arm":
        return faults.lidar_at(recording, x + sign * rng.uniform(0.15, 0.3), y)
    if fault == "track":
        return faults.heading_from_wheels(recording)
    pane = faults.glass_pane(recording, int(rng.integers(200, 700)), int(rng.integers(30, 60)))
    if fault == "renumbered beams":
        return faults.renumbered(pane)
    if fault == "lost second":
        begin = float(rng.uniform(38.5, 41.0))
        return faults.silent_gyro(recording, begin, begin + 1.0)
    return pane  # a healthy robot may meet glass


def measured(letter: str, fault: str, recording: Recording, healthy: Recording) -> MysteryRobot:
    """Return all numbers of one recording that may have a fault."""
    inputs = controls(recording)
    inputs = faults.skip_gaps(inputs) if fault == "lost second" else inputs
    lost = distance_gap(recording, inputs)[1][-1]
    found = corrections(faults.scans_between(recording, *BENDS))
    values = (found.delay, found.lever[0], turn_ratio(recording, healthy), ends_cut(recording), lost)
    numbers = {name: round(float(value), 2) + 0.0 for name, value in zip(COLUMNS, values, strict=True)}
    return MysteryRobot(letter, fault, numbers, map_by_odometry(recording, inputs))


@lru_cache(maxsize=2)
def mystery(recording: Recording, seed: int, robots: int = 4) -> list[MysteryRobot]:
    """Return some robots, each with another fault or none; which has which depends on the seed."""
    rng = np.random.default_rng(seed)
    hidden = [str(fault) for fault in rng.permutation(HIDDEN)[:robots]]
    made = [(fault, with_fault(recording, fault, rng)) for fault in hidden]
    return [measured(letter, *one, recording) for letter, one in zip("ABCDEF", made, strict=False)]
