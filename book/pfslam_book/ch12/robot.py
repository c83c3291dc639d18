"""Chapter 12, your own robot: faults of real recordings, the check-up that finds them, a run on whatever is there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import pfslam
from pfslam.evaluation.calibration import Calibration, apply_calibration
from pfslam.evaluation.checkup import Finding, check_up, turned_by_gyro, turned_by_wheels
from pfslam.io.datasets import data_folder
from pfslam.motion import controls
from pfslam.poses import transform_points
from pfslam.recording import Encoders, Recording
from pfslam.run import SlamResult
from pfslam.sensors import scan_points
from pfslam.study.disturbances import first_seconds, missing_beams
from pfslam_book.show.faults import clockwise, late_scans, scaled_gyro, silent_gyro
from pfslam_book.show.figures import draw_trajectory, map_figure
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, INK, metric_axes, new_figure
from pfslam_book.show.tables import Shown
from pfslam_book.show.widgets import Explorer, Slider

HEALTHY = "none"
PLAN = (5.4, 5.2)
"""Size of a plan view (inches): its words can still be read on a phone."""
MARKS = {True: "✓", False: "✗", None: "–"}


def with_counts(recording: Recording, counts: np.ndarray) -> Recording:
    """Give the recording with other wheel counts."""
    encoders, _ = recording.wheels_and_gyro()
    return replace(recording, encoders=Encoders(encoders.t, counts))


def wrapped(counts: np.ndarray, bits: int = 8) -> np.ndarray:
    """Give the increments ``(K, 4)`` that careless differences make of a counter of so many bits, jumps included."""
    readings = np.cumsum(counts, axis=0) % 2**bits
    return np.diff(readings, axis=0, prepend=readings[:1])


FAULTS: dict[str, Callable[[Recording], Recording]] = {
    HEALTHY: lambda r: r,
    "running totals": lambda r: with_counts(r, np.cumsum(r.wheels_and_gyro()[0].counts, axis=0)),
    "8-bit counter": lambda r: with_counts(r, wrapped(r.wheels_and_gyro()[0].counts)),
    "gyro in degrees": lambda r: scaled_gyro(r, float(np.rad2deg(1.0))),
    "gyro flipped": lambda r: scaled_gyro(r, -1.0),
    "beams backwards": clockwise,
    "both mirrored": lambda r: clockwise(scaled_gyro(r, -1.0)),
    "scans 150 ms late": lambda r: late_scans(r, 0.15),
    "gyro silent for 3 s": lambda r: silent_gyro(r, 30.0, 33.0),
    "60 % of beams lost": lambda r: missing_beams(r, 0.6, np.random.default_rng(0)),
}
"""By name: what some loader or some cable does to a recording."""


def check_up_table(recording: Recording) -> Shown:
    """List the check-up of one recording: the question, what was found and what is expected."""
    rows = [(MARKS[f.ok], f.question, f.found, f.expected) for f in check_up(recording)]
    return Shown(("verdict", "question", "found", "expected"), rows, left=(1, 2, 3))


def complaints(recording: Recording) -> list[Finding]:
    """Give the findings that complain."""
    return [finding for finding in check_up(recording) if finding.ok is False]


def faults_table(recording: Recording) -> Shown:
    """List for each fault, done to one minute of a drive, the questions that complain and what they found."""
    short = replace(first_seconds(recording, 60.0), camera=None)
    rows = []
    for fault, harm in FAULTS.items():
        for k, finding in enumerate(complaints(harm(short)) or [None]):
            cells = ("nothing to complain about", "", "") if finding is None else (
                finding.question, finding.found, finding.expected
            )  # fmt: skip
            rows.append((fault if k == 0 else "", *cells))
    return Shown(("fault", "question that complains", "found", "expected"), rows, left=(1, 2, 3))


# ---- measuring the robot


def end_error(recording: Recording) -> float:
    """Give how far from the truth (m) dead reckoning ends."""
    path, truth = pfslam.dead_reckoning(recording), recording.true_path()
    last = min(path.t[-1], truth.t[-1])
    return float(np.hypot(*(path.at(last) - truth.at(last))[:2]))


def calibration_table(drives: dict[str, Recording], found: dict[str, Calibration]) -> Shown:
    """List where dead reckoning of each drive ends: raw, calibrated on itself, calibrated on the other drive."""
    rows = []
    for name, recording in drives.items():
        (other,) = (calibration for drive, calibration in found.items() if drive != name)
        errors = [end_error(r) for r in (
            recording, apply_calibration(recording, found[name]), apply_calibration(recording, other)
        )]  # fmt: skip
        rows.append((name, *(f"{error:.2f}" for error in errors)))
    return Shown(("drive", "raw [m]", "calibrated on itself [m]", "calibrated on the other drive [m]"), rows)


def heading_from_gyro(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Give times ``(T,)`` (s) and the gyro's heading there (rad)."""
    inputs = controls(recording)
    return inputs.t, turned_by_gyro(inputs, inputs.t)


def track_explorer(recording: Recording) -> Explorer:
    """Slide the track until wheels and gyro turn alike."""
    t, gyro = (values[::20] for values in heading_from_gyro(recording))
    since, turned = t - t[0], np.rad2deg(np.ptp(gyro))
    limits = np.rad2deg(gyro.min()) - 0.3 * turned, np.rad2deg(gyro.max()) + turned

    @cache
    def wheels(track: float) -> np.ndarray:
        return turned_by_wheels(recording, t, track)

    def apart(track: float) -> float:
        return float(np.rad2deg(np.sqrt(np.mean((wheels(track) - gyro) ** 2))))

    def draw(track: float) -> Figure:
        figure, axes = new_figure(5.1, 3.6)
        axes.plot(since, np.rad2deg(gyro), color=INK, linewidth=1.2, label="gyro")
        axes.plot(since, np.rad2deg(wheels(track)), color=COLOURS["odometry"], label="wheels")
        axes.set_xlabel("time [s]")
        axes.set_ylabel("heading [deg]")
        axes.set_ylim(*limits)
        axes.set_title(f"apart by {apart(track):.0f} deg (root mean square)")
        axes.legend(loc="upper left")
        return figure

    values = [0.3, recording.robot.encoders.track, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.9, 1.0]
    return Explorer(
        draw,
        [Slider("track", values, 1, "Track", "m", ".3f", live=(0.3, 1.0, 0.01))],
        alt=lambda track: (
            f"Heading over time from the gyro and from the wheels with a track of {track:.2f} m: apart by "
            f"{apart(track):.0f} degrees, root mean square."
        ),
        title="How wide is a robot that skids?",
    )


def strongest_turn(recording: Recording, seconds: float = 2.5) -> tuple[float, float]:
    """Find the stretch (s, s) in which the gyro turned most while the robot hardly drove."""
    inputs = controls(recording)
    t = inputs.t
    turned = np.concatenate([[0.0], np.cumsum(inputs.omega * np.diff(t))])
    driven = np.concatenate([[0.0], np.cumsum(np.abs(inputs.v) * np.diff(t))])
    starts = np.arange(t[0], t[-1] - seconds, 0.1)
    score = np.abs(np.interp(starts + seconds, t, turned) - np.interp(starts, t, turned))
    score -= np.interp(starts + seconds, t, driven) - np.interp(starts, t, driven)
    begin = float(starts[int(np.argmax(score))])
    return begin, begin + seconds


def turn_points(recording: Recording, lever: float, span: tuple[float, float]) -> np.ndarray:
    """Place the end points ``(M, 2)`` of a turn by dead reckoning, as if the LiDAR sat ``lever`` m ahead."""
    lidar = replace(recording.robot.lidar, position_b=(lever, 0.0, recording.robot.lidar.position_b[2]))
    scans, path = recording.scans(), pfslam.dead_reckoning(recording)
    inside = np.flatnonzero((scans.t >= span[0]) & (scans.t <= span[1]))[::6]
    return np.concatenate(
        [transform_points(path.at(scans.t[i]), scan_points(scans.ranges[i], lidar)) for i in inside]
    )


def cells_hit(points: np.ndarray, cell: float = 0.02) -> int:
    """Count the cells that the points fall into: the fewer, the sharper the picture."""
    return len(np.unique(np.floor(points / cell).astype(np.int64), axis=0))


def lever_explorer(recording: Recording) -> Explorer:
    """Slide the LiDAR along the robot until the walls of one turn are sharp."""
    span = strongest_turn(recording)
    here = pfslam.dead_reckoning(recording).at(0.5 * sum(span))[:2]

    @cache
    def points(lever: float) -> np.ndarray:
        return turn_points(recording, lever, span)

    def draw(lever: float) -> Figure:
        figure, axes = new_figure(5.1, 4.8)
        near = points(lever)
        near = near[np.abs(near - here).max(axis=1) < 2.6]
        axes.scatter(*near.T, s=1.5, color=COLOURS["hits"], linewidths=0)
        metric_axes(axes, f"{cells_hit(points(lever))} cells of 2 cm are hit")
        axes.set(xlim=(here[0] - 2.6, here[0] + 2.6), ylim=(here[1] - 2.6, here[1] + 2.6))
        return figure

    values = [-0.3, -0.2, -0.1, 0.0, 0.05, 0.1, 0.13, 0.2, 0.3, 0.4]
    return Explorer(
        draw,
        [Slider("lever", values, 3, "LiDAR ahead of the centre by", "m", ".2f", live=(-0.3, 0.4, 0.01))],
        alt=lambda lever: (
            f"End points of the scans of one turn with the LiDAR {lever:.2f} m ahead of the centre: "
            f"they fall into {cells_hit(points(lever))} cells of 2 cm."
        ),
        title="One turn, and where the LiDAR sits",
    )


def sharpest_lever(recording: Recording) -> float:
    """Find the place of the LiDAR (m ahead of the centre) from which the scans of a turn hit the fewest cells."""
    span, levers = strongest_turn(recording), np.arange(-0.3, 0.401, 0.02)
    return float(levers[np.argmin([cells_hit(turn_points(recording, x, span)) for x in levers])])


def drives() -> dict[str, tuple[str, Path | None]]:
    """List every data set within reach: the built-in ones, then the numbered sets and logs of the data folder."""
    found: dict[str, tuple[str, Path | None]] = {"hall": ("hall", None), "ramp": ("ramp", None)}
    folder = data_folder()
    for place in (folder, folder / "data", *(p for p in sorted(folder.glob("*")) if p.is_dir())):
        for path in sorted(place.glob("[Ee]ncoders*.npz")):
            number = path.stem[len("encoders") :]
            found[f"{place.name} {number}"] = (number, place)
        for path in sorted(place.glob("*.log")):
            found[path.stem] = (str(path), None)
    return found


def run_figure(name: str, recording: Recording, result: SlamResult) -> Picture:
    """Draw map and path of a run on anything."""
    figure = map_figure(result.grid, f"{name}: {len(result.infos)} scans", result.trajectory)
    figure.set_size_inches(*PLAN)
    if recording.truth is not None:
        draw_trajectory(figure.axes[0], recording.truth, "truth")
        figure.axes[0].legend()
    way = np.hypot(*np.diff(result.trajectory.poses[:, :2], axis=0).T).sum()
    return Picture(figure, f"Map and path of {name}: {way:.0f} m driven, {len(result.infos)} scans used.")
