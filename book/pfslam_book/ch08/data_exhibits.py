"""Chapter 08: the exhibits of the data, drawn."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes

from pfslam.grid import OccupancyGrid
from pfslam.motion import controls
from pfslam.recording import Recording
from pfslam_book.ch08.data import (
    BENDS,
    LAB,
    TURNS,
    Corrections,
    corrections,
    distance_gap,
    drawn_by_odometry,
    ends_cut,
    headings,
    metres_lost,
    turn_ratio,
)
from pfslam_book.ch08.exhibit import COLOUR, Exhibit, by_name, few_ticks, small_map
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
from pfslam_book.show.style import COLOURS

DELAY = 0.15
"""By how much the clock of the scans is off (s)."""
MIRRORED_X = -0.13323
"""Where the program takes the LiDAR to be: behind the centre instead of in front of it (m)."""
PANE = (300, 40)
"""First beam and number of beams of the glass pane."""
GAP = (40.5, 41.5)
"""Begin and end of the IMU's silence (s after the start)."""

Panel = Callable[[Axes, str], str]


def data_faults(recording: Recording) -> dict[str, Exhibit]:
    """Return the five faults of the data by name, each beside the healthy recording."""
    part = scans_between(recording, *BENDS)
    healthy = corrections(part)
    return by_name(
        clock_exhibit(recording, part, healthy),
        lever_exhibit(recording, part, healthy),
        track_exhibit(recording),
        beams_exhibit(recording),
        gap_exhibit(recording),
    )


def pair(healthy, broken) -> dict:
    """Return the two states of an exhibit."""
    return {"healthy": healthy, "broken": broken}


def map_panel(grids: dict[str, OccupancyGrid]) -> Panel:
    """Return the map that odometry draws in each state."""

    def draw(axes: Axes, state: str) -> str:
        small_map(axes, grids[state])
        axes.set(xlim=(-7, 5), ylim=(-6, 6.5))
        cells = {s: np.count_nonzero(grid.occupied) for s, grid in grids.items()}
        return (
            f"the map drawn along odometry has {cells[state]} wall cells, {cells['healthy']} if all is right"
        )

    return draw


def odometry_maps(healthy: Recording, broken: Recording) -> Panel:
    """Return the maps of the last seconds, with the half turn in the dead end."""
    return map_panel(pair(*(drawn_by_odometry(scans_between(r, *TURNS)) for r in (healthy, broken))))


def line_panel(points: dict[str, tuple[np.ndarray, np.ndarray, float]], x: str, y: str, words: str) -> Panel:
    """Return points and a line of given slope through the origin, for each state."""

    def draw(axes: Axes, state: str) -> str:
        across, up, slope = points[state]
        axes.scatter(across, up, s=12, color=COLOUR[state])
        ends = np.array([across.min(), across.max()])
        axes.plot(ends, slope * ends, color=COLOURS["truth"], linewidth=1.0)
        both = np.concatenate([points[s][1] for s in points])
        margin = 0.08 * np.ptp(both)
        few_ticks(axes, xlabel=x, ylabel=y, ylim=(both.min() - margin, both.max() + margin))
        return f"{words} {slope:.2f}"

    return draw


def clock_exhibit(recording: Recording, part: Recording, healthy: Corrections) -> Exhibit:
    """Show scans stamped too late."""
    broken = corrections(late_scans(part, DELAY))

    def points(c: Corrections) -> tuple[np.ndarray, np.ndarray, float]:
        rest = np.rad2deg(c.heading - (c.scale - 1.0) * c.turn)
        return c.rate_change, rest, float(-np.rad2deg(c.delay))

    panel = line_panel(
        pair(points(healthy), points(broken)),
        "change of yaw rate [rad/s]",
        "heading corrected [deg]",
        "correction of the heading against the change of the yaw rate, slope in degrees per rad/s",
    )
    return Exhibit(
        "clock",
        f"scans stamped {DELAY} s late",
        "delay found",
        "s",
        pair(healthy.delay, broken.delay),
        odometry_maps(recording, late_scans(recording, DELAY)),
        panel,
    )


def lever_exhibit(recording: Recording, part: Recording, healthy: Corrections) -> Exhibit:
    """Show the LiDAR taken to be on the wrong side of the robot's centre."""
    y = recording.robot.lidar.position_b[1]
    broken = corrections(lidar_at(part, MIRRORED_X, y))

    def points(c: Corrections) -> tuple[np.ndarray, np.ndarray, float]:
        return np.rad2deg(c.turn), 100 * c.shift[:, 1], float(100 * np.deg2rad(c.lever[0]))

    panel = line_panel(
        pair(points(healthy), points(broken)),
        "turn between scans [deg]",
        "moved sideways [cm]",
        "sideways correction against the turn, slope in cm per degree",
    )
    return Exhibit(
        "lever arm",
        "the program has the LiDAR 0.13 m behind the centre instead of in front of it",
        "lever error found",
        "m",
        pair(float(healthy.lever[0]), float(broken.lever[0])),
        odometry_maps(recording, lidar_at(recording, MIRRORED_X, y)),
        panel,
    )


def track_exhibit(recording: Recording) -> Exhibit:
    """Show heading from the wheels and the measured track."""
    used = pair(recording, heading_from_wheels(recording))
    ratio = {state: turn_ratio(r, recording, *LAB) for state, r in used.items()}
    gyro = np.rad2deg(headings(recording, *LAB))
    points = {s: (gyro, np.rad2deg(headings(r, *LAB)), ratio[s]) for s, r in used.items()}
    panel = line_panel(
        points, "heading by gyro [deg]", "heading in use [deg]", "heading in use over the gyro's"
    )
    symptom = odometry_maps(recording, used["broken"])
    return Exhibit("track", "yaw from wheels and track", "turn in use over gyro", "", ratio, symptom, panel)


def beams_exhibit(recording: Recording) -> Exhibit:
    """Show a glass pane, and a program that drops what is invalid and numbers the rest."""
    glass = glass_pane(recording, *PANE)
    recordings = pair(glass, renumbered(glass))

    def draw(axes: Axes, state: str) -> str:
        ranges = scans_between(recordings[state], *TURNS).scans().ranges[::8]
        missing = ~recording.robot.lidar.valid(ranges)
        axes.imshow(missing, cmap="binary", aspect="auto", interpolation="nearest")
        axes.grid(False)
        few_ticks(axes, xlabel="beam number", ylabel="scan")
        if state == "healthy":
            return f"missing beams stand as a band from beam {PANE[0]}, and here and there"
        return "all missing beams seem to be the last ones"

    reading = {state: ends_cut(r) for state, r in recordings.items()}
    symptom = odometry_maps(*recordings.values())
    what = f"{PANE[1]} beams meet glass; what is invalid is dropped and the rest renumbered"
    return Exhibit("renumbered beams", what, "share of scans cut at the end", "", reading, symptom, draw)


def gap_exhibit(recording: Recording) -> Exhibit:
    """Show one second without gyro."""
    silent = silent_gyro(recording, *GAP)
    inputs = pair(controls(silent), skip_gaps(controls(silent)))
    maps = {state: drawn_by_odometry(scans_between(silent, *TURNS), i) for state, i in inputs.items()}
    reading = pair(metres_lost(silent), metres_lost(silent, skip_gaps))

    def draw(axes: Axes, state: str) -> str:
        for s, line in (("healthy", "-"), ("broken", "--")):
            t, lost = distance_gap(silent, inputs[s])
            some = (t > TURNS[0]) & (t < TURNS[1])
            axes.plot(t[some], lost[some], line, color=COLOUR[s], linewidth=2.5 if s == state else 0.8)
        few_ticks(axes, xlabel="time [s]", ylabel="wheels less path [m]", ylim=(-0.1, 1.0))
        return f"from {GAP[0]} s on the path is {reading[state]:.2f} m shorter than what the wheels turned"

    what = "the IMU is silent for 1 s and the program keeps the old pose"
    return Exhibit("lost second", what, "distance lost", "m", reading, map_panel(maps), draw)
