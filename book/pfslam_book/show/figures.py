"""Maps and paths that more than one chapter needs; the map along a given path comes from the command line's figures.

The artists have their names of before here, for chapters that do not yet draw in their own cells.
"""

from __future__ import annotations

from matplotlib.figure import Figure

from pfslam.cli.figures import map_along as map_along
from pfslam.grid import OccupancyGrid
from pfslam.poses import Trajectory
from pfslam_book.show.artists import draw_cloud as draw_particles  # noqa: F401
from pfslam_book.show.artists import draw_map, draw_scan  # noqa: F401
from pfslam_book.show.artists import draw_path as draw_trajectory
from pfslam_book.show.artists import draw_pose as draw_robot  # noqa: F401
from pfslam_book.show.style import new_figure


def map_figure(grid: OccupancyGrid, title: str, trajectory: Trajectory | None = None) -> Figure:
    """A map, with a path on it if one is given."""
    figure, axes = new_figure(6.8, 6.4)
    draw_map(axes, grid, title)
    if trajectory is not None:
        draw_trajectory(axes, trajectory, "estimate")
        axes.legend()
    return figure
