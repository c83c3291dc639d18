"""Chapter 02, what can go wrong: mirrored scans, a grid that is too small, and beams without a return."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pfslam.grid import LOG_4, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.poses import transform_points
from pfslam.recording import LidarScans, Recording
from pfslam.sensors import scan_points
from pfslam.teaching.ch02.many_scans import drawn
from pfslam.teaching.ch02.one_scan import CELL, Placed, draw_log_odds, placed
from pfslam.teaching.show.figures import draw_map
from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import new_figure

MIRROR = np.array([1.0, -1.0, -1.0])
FLIPS = {"right": (1, 1), "scan flipped": (-1, 1), "scan and gyro flipped": (-1, -1)}


def flipped_scans(
    recording: Recording, scan_sign: int, gyro_sign: int, last: float, every: int
) -> list[Placed]:
    """Scans of the first ``last`` seconds with beams counted the other way round, or all turns too, or neither."""
    scans, lidar, truth = recording.scans(), recording.robot.lidar, recording.true_path()
    result = []
    for i in range(0, int(np.searchsorted(scans.t, scans.t[0] + last)), every):
        pose = truth.at(scans.t[i]) * (MIRROR if gyro_sign < 0 else 1.0)
        points_b = scan_points(scans.ranges[i], lidar) * [1.0, scan_sign]
        sensor = transform_points(pose, np.array([lidar.position_b[:2]]))[0]
        beams = np.flatnonzero(lidar.valid(scans.ranges[i]))
        result.append(Placed(transform_points(pose, points_b), beams, sensor, pose))
    return result


def flips_picture(recording: Recording, last: float = 45.0, every: int = 25) -> Picture:
    """Three maps of the same scans: right, beams counted clockwise, and beams and turns both reversed."""
    figure, axes = new_figure(6.2, 3.4, 1, 3)
    words = []
    for ax, (name, signs) in zip(axes, FLIPS.items(), strict=True):
        *_, grid = drawn(flipped_scans(recording, *signs, last=last, every=every))
        draw_map(ax, grid)
        ax.set_title(name.replace(" and ", " and\n"), fontsize=12)
        ax.set(xticks=(), yticks=(), xlabel="", ylabel="")
        words.append(f"{name} {np.count_nonzero(grid.occupied)}")
    alt = f"""Three maps of the same scans. With the scan flipped the corridors smear; with scan and gyro flipped the
    map is sharp, and a mirror image. Occupied cells: {", ".join(words)}."""
    return Picture(figure, alt)


# ---- points outside the grid

EDGE_RULES = ("both bounds tested", "clipped to the edge", "upper bound only")


def hits_on_grid(points: np.ndarray, spec: GridSpec, rule: str) -> np.ndarray:
    """Cells ``(H, W)`` bool that the points ``(M, 2)`` mark, by one of ``EDGE_RULES``."""
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
    """The scan's grid without its left ``lacking`` metres."""
    return scan.spec().grown(-round(lacking / CELL), 0, 0, 0)


def edge_picture(scan: Placed, lacking: float = 3.6) -> Picture:
    """One scan on a grid that is too small, by three rules."""
    spec = too_small(scan, lacking)
    right = hits_on_grid(scan.points, spec, EDGE_RULES[0])
    figure, axes = new_figure(6.2, 3.5, 1, 3, sharey=True)
    words = []
    for ax, rule in zip(axes, EDGE_RULES, strict=True):
        hit = hits_on_grid(scan.points, spec, rule)
        draw_log_odds(ax, hit * 1.0, spec, clamp=1.0)
        left, right_edge, _, top = spec.extent
        ax.set(xlim=(left - 0.3, right_edge + 0.3), ylim=(top - 6.0, top))
        ax.set_title(rule.replace(" to ", "\nto ").replace(" bound", "\nbound"), fontsize=12)
        words.append(f"{rule} {np.count_nonzero(hit & ~right)}")
    for ax in axes[1:]:
        ax.set_ylabel("")
    alt = f"""A scan on a grid that lacks {lacking:g} m on the left. Cells marked as wall where none is:
    {", ".join(words)}. Clipped points form a false wall along the border; negative indices come in again on the far
    side."""
    return Picture(figure, alt)


# ---- beams without a return

GLASS = slice(560, 760)
"""The beams that a glass wall swallows."""
GLASS_RULES = ("wall at maximum range", "forgotten", "clears nothing")


def behind_glass(recording: Recording, index: int, longest: float = 8.0) -> Recording:
    """A recording of one scan, in which some beams met glass, and a LiDAR that reaches ``longest`` m."""
    scans, robot = recording.scans(), recording.robot
    ranges = scans.ranges[index].copy()
    ranges[GLASS] = 60.0
    lidar = replace(robot.lidar, range_max=longest)
    one = LidarScans(scans.t[index : index + 1], ranges[None])
    return replace(recording, lidar=one, robot=replace(robot, lidar=lidar))


def glass_map(recording: Recording, rule: str) -> OccupancyGrid:
    """The one scan on an empty map, by one of ``GLASS_RULES``."""
    longest = recording.robot.lidar.range_max
    if rule == GLASS_RULES[0]:
        scans = recording.scans()
        recording = replace(recording, lidar=LidarScans(scans.t, np.minimum(scans.ranges, longest)))
    scan = placed(recording, recording.true_path(), 0)
    beams = np.arange(len(scan.beams)) if rule == GLASS_RULES[1] else scan.beams
    around = scan.sensor + longest * np.array([[-1.0, -1.0], [1.0, 1.0]])
    empty = OccupancyGrid.empty(GridSpec.around(around, CELL, 0.2))
    return integrate_scan(empty, scan.points, beams, scan.sensor, MapConfig(clamp=LOG_4))[0]


def glass_picture(recording: Recording) -> Picture:
    """A scan with a gap, by three rules."""
    right = glass_map(recording, GLASS_RULES[2])
    figure, axes = new_figure(6.2, 3.4, 1, 3)
    words = []
    for ax, rule in zip(axes, GLASS_RULES, strict=True):
        grid = glass_map(recording, rule)
        draw_map(ax, grid)
        ax.set_title(rule.replace(" at ", "\nat "), fontsize=12)
        ax.set(xticks=(), yticks=(), xlabel="", ylabel="")
        false = [
            np.count_nonzero(a & ~b) for a, b in ((grid.occupied, right.occupied), (grid.free, right.free))
        ]
        words.append(f"{rule}: {false[0]} false wall cells, {false[1]} cells cleared that no beam crossed")
    return Picture(figure, f"One scan with a pane of glass in it. {'; '.join(words)}.")
