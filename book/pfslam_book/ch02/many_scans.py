"""Chapter 02, many scans: walls that wear off, a door that opens, and maps from dead reckoning."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pfslam.grid import LOG_4, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam_book.ch02.one_scan import CELL, Placed, placed
from pfslam_book.show.figures import draw_map, draw_trajectory, map_along
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure


def scans_between(recording: Recording, first: float, last: float, every: int) -> list[Placed]:
    """Return every ``every``-th scan between two times (s after the first scan), drawn from true poses."""
    t, truth = recording.scans().t, recording.true_path()
    low, high = np.searchsorted(t, t[0] + np.array([first, last]))
    return [placed(recording, truth, int(i)) for i in range(low, high, every)]


def spec_of(scans: list[Placed], resolution: float = CELL) -> GridSpec:
    """Return a grid that holds all the scans."""
    ends = [end for s in scans for end in (s.points.min(axis=0), s.points.max(axis=0), s.sensor)]
    return GridSpec.around(np.array(ends), resolution, margin=0.3)


def drawn(scans: list[Placed], config: MapConfig | None = None) -> Iterator[OccupancyGrid]:
    """Return the map after each of the scans."""
    grid = OccupancyGrid.empty(spec_of(scans))
    for scan in scans:
        integrate_scan(grid, scan.points, scan.beams, scan.sensor, config or MapConfig())
        yield grid.copy()


def hit_counts(scans: list[Placed], spec: GridSpec) -> np.ndarray:
    """Return how many of the scans hit each cell ``(H, W)``."""
    count = np.zeros(spec.shape, dtype=int)
    for scan in scans:
        cells = np.unique(spec.world_to_cell(scan.points), axis=0)
        count[cells[:, 1], cells[:, 0]] += 1
    return count


# ---- hit, free and clamp

SEEN = 3  # so many scans must hit a wall cell for it to be well seen
DOOR_CLOSED, DOOR_OPEN = 40, 60  # so many scans see the door closed, and so many see it open after that


def door(
    hit: float, free: float, clamp: float, closed: int = DOOR_CLOSED, opened: int = DOOR_OPEN
) -> np.ndarray:
    """Return log-odds ``(1 + closed + opened,)`` of a door's cell: hit while closed, seen through when open."""
    levels = [0.0]
    for change in [hit] * closed + [-free] * opened:
        levels.append(float(np.clip(levels[-1] + change, -clamp, clamp)))
    return np.array(levels)


def scans_to_believe(hit: float, free: float, clamp: float, closed: int = DOOR_CLOSED) -> int:
    """Return how many scans through the open door it takes until its cell counts as free."""
    level, scans = door(hit, free, clamp, closed, 0)[-1], 0
    while level >= -1e-9:
        level, scans = max(level - free, -clamp), scans + 1
    return scans


@dataclass(frozen=True, eq=False)
class Walls:
    """Scans of a corridor, and which cells at least ``SEEN`` of them hit: its well-seen walls."""

    scans: list[Placed]
    wall: np.ndarray

    def map(self, hit: float, free: float, clamp: float) -> OccupancyGrid:
        """Return the map of the scans; the three numbers in units of log 4."""
        *_, grid = drawn(self.scans, MapConfig(hit=hit * LOG_4, free=free * LOG_4, clamp=clamp * LOG_4))
        return grid

    def worn(self, grid: OccupancyGrid) -> float:
        """Tell which share of the well-seen wall cells is not occupied in the map."""
        return float(np.mean(~grid.occupied[self.wall]))


def walls_of(scans: list[Placed]) -> Walls:
    """Return the scans with their well-seen walls."""
    return Walls(scans, hit_counts(scans, spec_of(scans)) >= SEEN)


def dead_reckoned_maps(recordings: dict[str, Recording], every: int = 20) -> dict[str, tuple]:
    """Return for each recording: its dead reckoning, the map along it, and the map along the truth."""
    result = {}
    for name, recording in recordings.items():
        odometry, truth = dead_reckoning(recording), recording.true_path()
        drawn = map_along(recording, odometry, every=every), map_along(recording, truth, every=every)
        result[name] = (odometry, *drawn)
    return result


def dead_reckoned_picture(drawn: dict[str, tuple[Trajectory, OccupancyGrid, OccupancyGrid]]) -> Picture:
    """Draw figures 5 and 6 of the report above, and below the maps that true poses draw of the same scans."""
    figure, axes = new_figure(5.0, 6.0, 2, len(drawn), sharex=True, sharey=True)
    words = []
    for column, (name, (odometry, wrong, right)) in enumerate(drawn.items()):
        draw_map(axes[0, column], wrong, f"{name},\ndead reckoning")
        draw_trajectory(axes[0, column], odometry, "odometry")
        draw_map(axes[1, column], right, f"{name},\ntrue poses")
        black = [np.count_nonzero(grid.occupied) for grid in (wrong, right)]
        words.append(f"{name}: {black[0]} occupied cells along dead reckoning, {black[1]} along true poses")
    extents = np.array([ax.images[0].get_extent() for ax in axes.ravel()])
    (left, low), (right, high) = extents[:, ::2].min(axis=0), extents[:, 1::2].max(axis=0)
    for ax in axes.ravel():
        ax.set(xlim=(left, right), ylim=(low, high), facecolor=COLOURS["unknown"])
        ax.label_outer()
    return Picture(
        figure, f"Two drives, mapped along dead reckoning (above) and true poses (below). {'; '.join(words)}."
    )
