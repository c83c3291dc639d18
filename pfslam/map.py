"""The map that a run draws into: an occupancy grid that grows, and is written in place."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pfslam.events import ScanEvent
from pfslam.grid import Canvas, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.poses import transform_points


class Map:
    """One map and its settings, owned by the run that draws into it: what a step costs does not grow with the map.

    Who wants to keep a map says ``copy()``. While ``is_empty``, nothing has been drawn, and the first scan will decide
    where the map lies.
    """

    def __init__(self, config: MapConfig, spec: GridSpec | None = None):
        self.config, self.is_empty = config, True
        self.lay_out(spec or GridSpec((0.0, 0.0), config.resolution, (1, 1)))

    def lay_out(self, spec: GridSpec) -> None:
        """Begin anew, with nothing known of any cell of the grid."""
        self._log_odds = Canvas(spec, np.float32)

    def canvases(self) -> Iterator[Canvas]:
        """Yield the layers of the map, which grow together."""
        yield self._log_odds

    @property
    def spec(self) -> GridSpec:
        """Where the map lies."""
        return self._log_odds.spec

    @property
    def grid(self) -> OccupancyGrid:
        """The occupancy grid, which goes on changing as scans are drawn."""
        return OccupancyGrid(self.spec, self._log_odds.values)

    def copy(self) -> Map:
        """Return a map of its own that holds the same and is not written by this one's run."""
        other = Map(self.config)
        other.is_empty, other._log_odds = self.is_empty, self._log_odds.copy()
        return other

    def draw(self, event: ScanEvent, pose: np.ndarray) -> None:
        """Write a scan into the grid, seen from ``pose (3,)`` (Eq. 14, 15); one without any return says nothing.

        Raises ``DataError``, and draws nothing, where the map would grow too large.
        """
        if len(event.points_b) > 0:
            points_w, sensor_w = self.make_room(event, pose)
            integrate_scan(self.grid, points_w, event.beams, sensor_w, self.config)
            self.is_empty = False

    def make_room(self, event: ScanEvent, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Grow to hold a scan; return its end points ``(M, 2)`` and the LiDAR's place ``(2,)`` in the world (m)."""
        seen = transform_points(pose, np.vstack([event.points_b, event.sensor_b]))
        if self.is_empty:
            around = np.vstack([seen[:-1], pose[:2]])
            self.lay_out(GridSpec.around(around, self.config.resolution, margin=5.0))
        spec = self.spec.covering(seen)
        if spec != self.spec:
            for canvas in self.canvases():  # one after the other: only one has its old block beside it
                canvas.cover(spec)
        return seen[:-1], seen[-1]
