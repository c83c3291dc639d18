"""Chapter 02, what can go wrong: mirrored scans, a grid that is too small, and beams without a return."""

from __future__ import annotations

from dataclasses import replace
from textwrap import fill

import numpy as np

from pfslam.grid import LOG_4, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.recording import LidarScans, Recording
from pfslam_book.ch02.one_scan import CELL, Placed, draw_log_odds, placed
from pfslam_book.show.figures import draw_robot
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure

# ---- points outside the grid

EDGE_RULES = ("both bounds tested", "clipped to the edge", "upper bound only")


def hits_on_grid(points: np.ndarray, spec: GridSpec, rule: str) -> np.ndarray:
    """Return cells ``(H, W)`` bool that the points ``(M, 2)`` mark, by one of ``EDGE_RULES``."""
    cells = spec.world_to_cell(points)
    top = np.array(spec.shape[::-1]) - 1
    if rule == EDGE_RULES[0]:
        cells = cells[spec.contains(cells)]
    elif rule == EDGE_RULES[1]:
        cells = np.clip(cells, 0, top)
    else:
        cells = cells[(cells <= top).all(axis=1)]
        cells = np.maximum(cells, -top - 1)  # further out Python raises at last
    hit = np.zeros(spec.shape, dtype=bool)
    hit[cells[:, 1], cells[:, 0]] = True
    return hit


def too_small(scan: Placed, lacking: float) -> GridSpec:
    """Return the scan's grid without its left ``lacking`` metres."""
    return scan.spec().grown(-round(lacking / CELL), 0, 0, 0)


def edge_picture(scan: Placed, lacking: float = 3.6) -> Picture:
    """Draw one scan on a grid that is large enough, and by three rules on one that is too small."""
    spec = too_small(scan, lacking)
    right = hits_on_grid(scan.points, spec, EDGE_RULES[0])
    figure, axes = new_figure(5.0, 5.6, 2, 2, sharex=True, sharey=True)
    whole = hits_on_grid(scan.points, scan.spec(), EDGE_RULES[0])
    draw_log_odds(axes[0, 0], whole * 1.0, scan.spec(), clamp=1.0)
    axes[0, 0].axvline(spec.origin[0], color=COLOURS["highlight"], linewidth=2)
    axes[0, 0].set_title("all of the scan")
    words = []
    for ax, rule in zip(axes.ravel()[1:], EDGE_RULES, strict=True):
        hit = hits_on_grid(scan.points, spec, rule)
        draw_log_odds(ax, hit * 1.0, spec, clamp=1.0)
        ax.set_title(rule)
        words.append(f"{rule} {np.count_nonzero(hit & ~right)}")
    left, right_edge, _, top = scan.spec().extent
    for ax in axes.ravel():
        ax.set(xlim=(left, right_edge), ylim=(top - 6.0, top))
        draw_robot(ax, scan.pose, length=0.9)
        ax.label_outer()
    alt = f"""A scan, and the same scan on a grid that lacks {lacking:g} m on the left, by three rules. Cells marked as
    wall where none is: {", ".join(words)}. Clipped points form a false wall along the border; negative indices come in
    again on the far side."""
    return Picture(figure, alt)


# ---- beams without a return

GLASS = slice(560, 760)
"""The beams that a glass wall swallows."""
GLASS_RULES = ("wall at maximum range", "forgotten", "clears nothing")


def behind_glass(recording: Recording, index: int, longest: float = 8.0) -> Recording:
    """Return a recording of one scan, in which some beams met glass, and a LiDAR that reaches ``longest`` m."""
    scans, robot = recording.scans(), recording.robot
    ranges = scans.ranges[index].copy()
    ranges[GLASS] = 60.0
    lidar = replace(robot.lidar, range_max=longest)
    one = LidarScans(scans.t[index : index + 1], ranges[None])
    return replace(recording, lidar=one, robot=replace(robot, lidar=lidar))


def glass_map(recording: Recording, rule: str) -> OccupancyGrid:
    """Return the one scan on an empty map, by one of ``GLASS_RULES``."""
    longest = recording.robot.lidar.range_max
    if rule == GLASS_RULES[0]:
        scans, wall = recording.scans(), np.nextafter(longest, 0.0)  # exactly range_max would be no return
        recording = replace(recording, lidar=LidarScans(scans.t, np.minimum(scans.ranges, wall)))
    scan = placed(recording, recording.true_path(), 0)
    beams = np.arange(len(scan.beams)) if rule == GLASS_RULES[1] else scan.beams
    around = scan.sensor + longest * np.array([[-1.0, -1.0], [1.0, 1.0]])
    empty = OccupancyGrid.empty(GridSpec.around(around, CELL, 0.2))
    integrate_scan(empty, scan.points, beams, scan.sensor, MapConfig(clamp=LOG_4))
    return empty


def glass_picture(recording: Recording, seconds: float = 40.0) -> Picture:
    """Draw a scan in which a pane of glass swallowed some beams, by three rules."""
    index = int(np.searchsorted(recording.scans().t, recording.scans().t[0] + seconds))
    glass, whole = behind_glass(recording, index), placed(recording, recording.true_path(), index)
    pane = whole.points[(whole.beams >= GLASS.start) & (whole.beams < GLASS.stop)]
    right = glass_map(glass, GLASS_RULES[2])
    figure, axes = new_figure(5.0, 3.2, 1, 3, sharex=True, sharey=True)
    words = []
    for ax, rule in zip(axes, GLASS_RULES, strict=True):
        grid = glass_map(glass, rule)
        draw_log_odds(ax, grid.log_odds, grid.spec, clamp=LOG_4)
        ax.scatter(*pane.T, s=5, color=COLOURS["highlight"], linewidths=0)
        draw_robot(ax, whole.pose, length=1.2)
        ax.set_title(fill(rule, 9))
        ax.label_outer()
        pairs = ((grid.occupied, right.occupied), (grid.free, right.free))
        false = [np.count_nonzero(a & ~b) for a, b in pairs]
        words.append(f"{rule}: {false[0]} false wall cells, {false[1]} cells cleared that no beam crossed")
    low, high = whole.points.min(axis=0) - 1.0, whole.points.max(axis=0) + 1.0
    axes[0].set(xlim=(low[0] - 1.0, high[0]), ylim=(low[1] - 1.0, high[1] + 1.0))
    return Picture(figure, f"One scan with a pane of glass in it, marked in orange. {'; '.join(words)}.")
