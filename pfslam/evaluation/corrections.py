"""What scans and odometry say with confidence that is stated wrongly, so that a run can put it right.

Beams that see the robot itself are looked for first, because they seem to say that it stands. Clock, direction and
scale are those of ``mounting``. They count as wrong by the rules of ``checkup``, and are corrected if these then
find them right. Otherwise what is left over is added to the correction, and another fit looks again. Where ranges are
noisy or stamps irregular, the first fit may be off by more than its errors say.
"""

from __future__ import annotations

from collections.abc import Collection
from operator import add, mul
from typing import Any

import numpy as np

from pfslam.evaluation.checkup import (
    Finding,
    check_up,
    clock_tolerance,
    same_direction,
    same_turns,
    same_ways,
)
from pfslam.evaluation.mounting import Mounting, fit_mounting
from pfslam.evaluation.scenes import LEAST_PAIRS
from pfslam.io.headings import LEAST_TURN
from pfslam.io.selection import select
from pfslam.motion import dead_reckoning
from pfslam.recording import Recording
from pfslam.refined.outliers import NOISY

NEUTRAL: dict[str, Any] = {"masks": [], "delay": 0.0, "yaw": 0.0, "scale": 1.0}
"""What can be put right, by the names that ``select`` has for it, and the values that change nothing."""
TOGETHER = {"delay": add, "yaw": lambda a, b: (a + b + 180.0) % 360.0 - 180.0, "scale": mul}
"""Two corrections of the same thing as one."""
TRIES = 4
"""How often a correction is improved until the fit finds it right. Of 155 simulated robots and 17 logs none took more
than three. What is not right then stays as stated."""


def find_corrections(
    recording: Recording, known: Collection[str] = (), whole: Recording | None = None
) -> tuple[dict[str, Any], list[str], list[Finding]]:
    """Find what to put right but for what is ``known``, a line on each for the user, and the check-up after it.

    The first are arguments of ``select``; none of them is ``NEUTRAL``. ``whole`` is the recording of which this is a
    part.
    """
    sectors = [] if "masks" in known else self_seen(recording)
    masks: dict[str, Any] = {"masks": sectors} if sectors else {}
    masked = select(recording, **masks)
    mounting = fit_mounting(masked)
    answers = numbers(masked, mounting)
    wrong = {name: value for name, (ok, value) in answers.items() if ok is False and name not in known}
    for _ in range(TRIES if wrong else 0):
        corrected = select(masked, **wrong)
        after = fit_mounting(corrected)
        rest = numbers(corrected, after)
        if all(rest[name][0] for name in wrong):
            return masks | wrong, _told(masks | wrong), check_up(corrected, after, whole)
        clear = {n: answer for n, answer in rest.items() if answer[0] is not None and n not in known}
        more = {n: value for n, (ok, value) in clear.items() if n in wrong or not ok}
        wrong |= {n: round(TOGETHER[n](wrong.get(n, NEUTRAL[n]), v), 4) for n, v in more.items()}
    return masks, _told(masks), check_up(masked, mounting, whole)


def self_seen(recording: Recording) -> list[list[float]]:
    """Find sectors (degrees in the LiDAR's frame) of beams that see the robot itself: they read the same everywhere.

    One scan is taken for each direction that the robot had, in steps of a tenth of a radian, so that no corridor counts
    for more than its direction. A beam sees the robot if four fifths of its ranges scatter no more than those of a
    scanner, and if they are shorter than most. Nothing is found before the robot has turned, nor where most beams read
    the same: then it is the scans that never change.
    """
    if recording.lidar is None:
        return []
    path, lidar, t = dead_reckoning(recording), recording.robot.lidar, recording.lidar.t
    driven = np.flatnonzero(path.covers(t))
    headings = np.floor(path.at(t[driven])[:, 2] * LEAST_PAIRS / LEAST_TURN)
    ranges = recording.lidar.ranges[driven[np.unique(headings, return_index=True)[1]]]
    valid = lidar.valid(ranges)
    if len(ranges) < LEAST_PAIRS or not (often := valid.sum(axis=0) >= LEAST_PAIRS).any():
        return []
    low, middle, high = np.full((3, lidar.beams), np.inf)
    seen = np.where(valid, ranges, np.nan)
    low[often], middle[often], high[often] = np.nanquantile(seen[:, often], [0.1, 0.5, 0.9], axis=0)
    with np.errstate(invalid="ignore"):
        scatter = (high - low) / 2.563  # of a normal distribution, four fifths lie within so many deviations
    constant = scatter <= max(NOISY, recording.range_scatter())
    own = constant & (middle < np.nanmedian(seen))
    return _sectors(np.degrees(lidar.angles), own) if own.any() and 2 * constant.sum() < lidar.beams else []


def _sectors(angles: np.ndarray, own: np.ndarray) -> list[list[float]]:
    """Return the sectors of neighbouring beams of a mask ``(beams,)``, to a tenth of a degree, the last beam's too."""
    first = int(np.argmin(own))
    own, angles = np.roll(own, -first), np.roll(angles, -first)
    begin, end = np.flatnonzero(np.diff(own, append=False)).reshape(-1, 2).T
    low, high = np.floor(10.0 * angles[begin + 1]) / 10.0, np.ceil(10.0 * angles[end]) / 10.0
    ends = (np.column_stack([low, high]) + 180.0) % 360.0 - 180.0
    return ends.round(1).tolist()


def numbers(recording: Recording, mounting: Mounting) -> dict[str, tuple[bool | None, Any]]:
    """Return whether clock, direction and scale are as stated, and by how much they are off, as ``select`` takes it.

    None is known where scans turn otherwise than the odometry, or never move: no correction of these would help.
    """
    late = mounting.late.within(0.0, clock_tolerance(recording))
    answers = {
        "delay": (late, round(float(mounting.late.value), 3)),
        "yaw": (same_direction(mounting), round(float(np.degrees(mounting.yaw.value)), 2)),
        "scale": (same_ways(mounting), round(float(mounting.ways.value), 4)),
    }
    beyond = same_turns(mounting) is False or mounting.ways.within(0.0, 0.03)
    return {name: (None if beyond else ok, value) for name, (ok, value) in answers.items()}


def _told(found: dict[str, Any]) -> list[str]:
    """Say in a line each what is put right, and how to refuse it."""
    own = "deg see the robot itself: left out; --no-mask uses all beams"
    lines = [f"beams from {low:g} to {high:g} {own}" for low, high in found.get("masks", ())]
    if late := found.get("delay"):
        word = "late" if late > 0.0 else "early"
        lines.append(f"scans are {abs(late):.3f} s {word}: shifted; --scan-delay 0 keeps them")
    if yaw := found.get("yaw"):
        side = "left" if yaw > 0.0 else "right"
        turned = f"the LiDAR looks {abs(yaw):.1f} deg to the {side} of what is stated"
        lines.append(f"{turned}: turned; --lidar-yaw 0 keeps its direction")
    if scale := found.get("scale"):
        longer = f"the robot drives {scale:.4g} times as far as its odometry says"
        lines.append(f"{longer}: ways scaled; --odometry-scale 1 keeps them")
    return lines
