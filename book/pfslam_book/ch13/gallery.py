"""Chapter 13, a gallery of failures: the map that each fault leaves, what tells of it, and what mends it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import pfslam
from pfslam.evaluation.calibration import Calibration, calibrate
from pfslam.evaluation.checkup import Finding, check_up
from pfslam.recording import Recording
from pfslam.refined.health import in_doubt
from pfslam.refined.run import RefinedResult, judged
from pfslam.study.disturbances import first_seconds
from pfslam_book.show.artists import COLOURS, draw_map, sheet, show
from pfslam_book.show.faults import clockwise, heading_from_wheels, scaled_gyro, scaled_ranges, turned_lidar
from pfslam_book.show.tables import Shown

SECONDS = 60.0
QUICK = replace(pfslam.SlamConfig.refined(), particles=20, every=20)
BAR = 5.0
"""Length (m) of the bar in each picture, which shows its scale."""
SCALE_OFF = 0.05
"""A wheel scale farther than this from 1 is no wear of the tyres."""


@dataclass(frozen=True)
class Failure:
    """One fault by name: what does it to a recording, how its map looks, and what mends it."""

    name: str
    harm: Callable[[Recording], Recording]
    looks: str
    mend: str


FAILURES = (
    Failure("nothing wrong", lambda r: r, "a room, a corridor and a second room", "–"),
    Failure(
        "turns by the ruler's track",
        heading_from_wheels,
        "the far room lies over itself, turned, and walls end in the open",
        "take turns from the gyro, or use the effective track",
    ),
    Failure(
        "beams backwards",
        clockwise,
        "shards that fan out from wherever the robot turned",
        "reverse the order of the beams",
    ),
    Failure(
        "gyro and beams mirrored",
        lambda r: clockwise(scaled_gyro(r, -1.0)),
        "sharp and whole, with left and right exchanged",
        "set both signs right; the first turn was to the left",
    ),
    Failure(
        "LiDAR back to front",
        lambda r: turned_lidar(r, np.pi),
        "a trunk of broken walls along the path",
        "add 180° to its mounting",
    ),
    Failure(
        "ranges halved",
        lambda r: scaled_ranges(r, 0.5),
        "sharp and whole, at half the size",
        "read the unit in the data sheet; measure one wall with a tape",
    ),
)


@dataclass(frozen=True)
class Outcome:
    """What became of one fault: the run, the complaints of the check-up, and the calibration after the run."""

    failure: Failure
    result: RefinedResult
    complaints: list[Finding]
    calibration: Calibration

    @property
    def doubted(self) -> float:
        """Share of the run that it calls doubtful itself."""
        times = np.array([info.t for info in self.result.infos])
        return float(in_doubt(self.result.distrust, times).mean())


def gallery(recording: Recording) -> list[Outcome]:
    """Run the filter on the first minute of a drive, once with each fault."""
    minute = replace(first_seconds(recording, SECONDS), camera=None)
    return [_outcome(failure, failure.harm(minute)) for failure in FAILURES]


def _outcome(failure: Failure, harmed: Recording) -> Outcome:
    result = judged(harmed, pfslam.run_slam(harmed, QUICK, second_look=False))
    complaints = [finding for finding in check_up(harmed) if finding.ok is False]
    return Outcome(failure, result, complaints, calibrate(harmed, result))


def gallery_picture(outcomes: list[Outcome]) -> show:
    """Draw the maps in two columns, each with a bar of the same length in metres."""
    figure, grid = sheet(3.9 * (len(outcomes) // 2), len(outcomes) // 2, 2)
    for axes, outcome in zip(np.ravel(grid), outcomes, strict=True):
        draw_map(axes, outcome.result.grid, outcome.failure.name)
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        half, x, y = 0.57 * max(right - left, high - low), (left + right) / 2, (low + high) / 2
        axes.set(xlim=(x - half, x + half), ylim=(y - 1.1 * half, y + 0.9 * half), xticks=[], yticks=[])
        axes.set(xlabel="", ylabel="", facecolor=COLOURS["unknown"])
        end, bottom = x + 0.92 * half, y - half
        axes.plot([end - BAR, end], [bottom, bottom], color="black", linewidth=3.5)
        axes.text(end - BAR, bottom, f"{BAR:.0f} m ", ha="right", va="center")
    looks = "; ".join(f"{outcome.failure.name}: {outcome.failure.looks}" for outcome in outcomes)
    return show(figure, f"Maps of the same minute. {looks}.")


def what_tells(outcome: Outcome) -> str:
    """Name the first that tells of a fault: the check-up, the wheels' scale after the run, or the run's own doubt."""
    if outcome.complaints:
        finding = outcome.complaints[0]
        return f"check-up: {finding.question} {finding.found}"
    scale, error = outcome.calibration.wheel_scale, outcome.calibration.wheel_scale_error
    if abs(scale - 1.0) > max(SCALE_OFF, 3.0 * error):
        return f"after the run: wheel scale {scale:.2f}"
    if outcome.doubted:
        return f"the run: {100 * outcome.doubted:.0f} % of it in doubt"
    return "nothing"


def gallery_table(outcomes: list[Outcome]) -> Shown:
    """List for each fault the first thing that tells of it, and what mends it."""
    rows = [(o.failure.name, what_tells(o), o.failure.mend) for o in outcomes]
    return Shown(("fault", "what tells", "what mends it"), rows, left=(1, 2))
