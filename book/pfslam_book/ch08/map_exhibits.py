"""Chapter 08: the exhibits of the map and of the camera, drawn."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from pfslam.errors import DataError
from pfslam.grid import LOG_4
from pfslam.recording import Recording
from pfslam_book.ch08.camera import (
    colour_shift,
    floor_tilt_deg,
    heights,
    look,
    nearest_pairs,
    pair_gap,
    seen_points,
    wall_range_error,
    wall_turn_deg,
)
from pfslam_book.ch08.data_exhibits import pair
from pfslam_book.ch08.exhibit import COLOUR, STATES, Exhibit, by_name, few_ticks, small_map
from pfslam_book.ch08.filter import best_shift, door_map, door_scans, self_match
from pfslam_book.show.faults import disparity_offset_by, pairs_by_number, swapped_centre
from pfslam_book.show.style import COLOURS

COUNTS = 20.0
"""By how many counts the disparities are off."""
SHIFTS = np.arange(-0.1, 0.1001, 0.005)


def map_faults(recording: Recording) -> dict[str, Exhibit]:
    """Return two faults of the map by name, each beside a healthy one."""
    return by_name(door_exhibit(recording), rounding_exhibit(recording))


def door_exhibit(recording: Recording) -> Exhibit:
    """Show a door that opens, and log-odds without a limit."""
    lidar = recording.robot.lidar
    closed, opened = door_scans(recording)
    maps = pair(
        door_map(closed, opened, lidar, 2.0 * LOG_4),
        door_map(closed, opened, lidar, np.inf),
    )

    def symptom(axes: Axes, state: str) -> str:
        small_map(axes, maps[state].grid)
        axes.set(xlim=(-0.5, 4.5), ylim=(-2.5, 2.5))
        closed_still = maps[state].history[maps[state].opened_at + 9] > 0
        return f"ten scans after the door has opened the map shows it {'closed' if closed_still else 'open'}"

    def diagnosis(axes: Axes, state: str) -> str:
        for s in STATES:
            axes.plot(maps[s].history, color=COLOUR[s], linewidth=2.2 if s == state else 0.8)
        axes.axhline(0.0, color=COLOURS["truth"], linewidth=0.8)
        few_ticks(axes, xlabel="scan", ylabel="log-odds of the door")
        history = maps[state].history
        return f"log-odds of the door rise to {history.max():.1f} in 60 scans and then fall to {history.min():.1f}"

    reading = {s: float(maps[s].to_believe) for s in STATES}
    what = "log-odds have no limit"
    return Exhibit("no clamp", what, "scans until the door is open", "", reading, symptom, diagnosis)


def rounding_exhibit(recording: Recording) -> Exhibit:
    """The map takes the floor, the score the nearest integer."""
    lidar, (_, ranges) = recording.robot.lidar, door_scans(recording)
    share = {s: self_match(ranges, lidar, SHIFTS, rounded=s == "broken") for s in STATES}
    best = {s: best_shift(SHIFTS, share[s]) for s in STATES}

    def symptom(axes: Axes, state: str) -> str:
        """Return where a point of a wall lies in its cell, in the map and for the score."""
        half = 0.0 if state == "healthy" else 0.5
        rng = np.random.default_rng(0)
        points = np.column_stack([rng.uniform(1.0, 4.0, 60), rng.uniform(2.0, 3.0, 60)])
        axes.axhspan(2, 3, color=COLOURS["unknown"])
        seen = points + half
        hit = np.floor(seen[:, 1]) == 2
        for some, colour in ((hit, "highlight"), (~hit, "hits")):
            axes.scatter(seen[some, 0], seen[some, 1], s=14, color=COLOURS[colour])
        few_ticks(axes, xlabel="x [cells]", ylabel="y [cells]", xlim=(0.5, 5), ylim=(1, 4.5))
        return f"{100 * hit.mean():.0f} % of the points of a wall fall on the wall's own row of cells"

    def diagnosis(axes: Axes, state: str) -> str:
        for s in STATES:
            axes.plot(100 * SHIFTS, 100 * share[s], color=COLOUR[s], linewidth=2.2 if s == state else 0.8)
        few_ticks(axes, xlabel="moved along x and y [cm]", ylabel="points on own walls [%]")
        return f"a scan fits the walls it has just drawn best when it is moved by {100 * best[state]:.1f} cm"

    reading = {s: 100 * best[s] for s in STATES}
    what = "the map takes the floor of a coordinate, the score the nearest integer"
    return Exhibit("half a cell", what, "best shift of a scan on itself", "cm", reading, symptom, diagnosis)


def camera_faults(recording: Recording) -> dict[str, Exhibit]:
    """Return three faults of the camera by name, each beside the healthy one."""
    return by_name(*model_exhibits(recording), pairing_exhibit(recording))


def model_exhibits(recording: Recording) -> list[Exhibit]:
    """Return two wrong camera models that tilt the floor alike, and what tells them apart."""
    shot, right = look(), recording.robot.camera
    models = {"swapped K": swapped_centre(right), "disparity offset": disparity_offset_by(right, COUNTS)}
    edges = np.arange(0.4, 3.7, 0.2)

    def walls_of(camera) -> np.ndarray:
        points = seen_points(shot, camera, floor=False)
        return points[points[:, 2] > 0.1]

    def exhibit(name: str, what: str, number: str, unit: str, measure: str) -> Exhibit:
        cameras = pair(right, models[name])
        floor = {s: seen_points(shot, camera, floor=True) for s, camera in cameras.items()}
        walls = {s: walls_of(camera) for s, camera in cameras.items()}
        beyond = {s: float(np.median(wall_range_error(shot, points))) for s, points in walls.items()}
        turned = {s: wall_turn_deg(shot, points) for s, points in walls.items()}

        def symptom(axes: Axes, state: str) -> str:
            for s in STATES:
                x, z = heights(floor[s], edges)
                axes.plot(x, 100 * z, color=COLOUR[s], linewidth=2.2 if s == state else 0.8)
            few_ticks(axes, xlabel="ahead [m]", ylabel="height of the floor [cm]")
            return f"the floor ahead seems to rise by {floor_tilt_deg(floor[state]):.1f} degrees"

        def diagnosis(axes: Axes, state: str) -> str:
            axes.plot(*shot.walls_b.T, ".", markersize=3, color=COLOURS["truth"])
            axes.plot(*walls[state][::5, :2].T, ".", markersize=2, color=COLOUR[state])
            axes.set_aspect("equal")
            few_ticks(axes, xlabel="ahead [m]", ylabel="left [m]", xlim=(0, 6.5), ylim=(-2.5, 4))
            return f"""the camera's walls lie {beyond[state]:.2f} m beyond the LiDAR's (median) and fit best
            when turned by {turned[state]:.1f} degrees"""

        reading = {"turned": turned, "beyond": beyond}[measure]
        return Exhibit(name, what, number, unit, reading, symptom, diagnosis)

    off = f"disparities {COUNTS:.0f} counts off"
    return [
        exhibit("swapped K", "principal point in (row, column) order", "walls turned by", "deg", "turned"),
        exhibit("disparity offset", off, "walls beyond the LiDAR's", "m", "beyond"),
    ]


def pairing_exhibit(recording: Recording) -> Exhibit:
    """Show images paired by number and not by time."""
    stream, truth = recording.camera, recording.true_path()
    if stream is None:
        raise DataError(recording.name, "camera", "no images", "a recording with a camera")
    pairs = pair(nearest_pairs(stream), pairs_by_number(len(stream.disparity_t), len(stream.rgb_t)))
    gaps = {s: pair_gap(stream, depth, rgb) for s, (depth, rgb) in pairs.items()}
    shifts = {s: colour_shift(stream, depth, rgb, truth) for s, (depth, rgb) in pairs.items()}

    def symptom(axes: Axes, state: str) -> str:
        rate, shift = shifts[state]
        axes.plot(100 * shift, color=COLOUR[state], linewidth=1.2)
        few_ticks(axes, xlabel="pair", ylabel="colour from so far off [cm]", ylim=(0, None))
        turning, straight = np.median(shift[rate > 0.5]), np.median(shift[rate < 0.1])
        return f"""two metres ahead, colours come from {100 * turning:.0f} cm away while turning (median) and
        {100 * straight:.0f} cm otherwise"""

    def diagnosis(axes: Axes, state: str) -> str:
        for s in STATES:
            axes.plot(gaps[s], color=COLOUR[s], linewidth=2.2 if s == state else 0.8)
        few_ticks(axes, xlabel="pair", ylabel="time between images [s]")
        return f"time between the images of a pair: at most {gaps[state].max():.2f} s"

    reading = {s: float(np.median(gaps[s])) for s in STATES}
    what = "colour image i is taken with depth image i"
    return Exhibit("paired by number", what, "median gap in a pair", "s", reading, symptom, diagnosis)
