"""What our runs over public logs of twelve buildings gave, stored, so that they are seen on every machine.

The study ``logs`` made the table from the logs, which are not part of the book, and ``measure.logs`` the maps.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.study.table import Table
from pfslam_book.show.artists import draw_map, draw_path, sheet
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import INK
from pfslam_book.show.tables import Shown, labels_of, read_table, select

KEPT = Path(__file__).parent / "logs.npz"
"""The maps and paths of the runs that were not stopped."""
FIRST, MATCHING = "refined", "scan matching"
"""The method that the command takes by default, and the one without chance in it."""
SPARSE = "a scan a metre"
TRIALS = ONE_LOOK, LOOPS, BELIEVED, DOUBTING = "one look", "loops", "odometry believed", "odometry doubted"
"""What was changed to find out what a run suffers from, each a change of scan matching."""
SCALE = 20.0
"""Length (m) of the bar in each map."""


@cache
def _stored() -> dict[str, np.ndarray]:
    with np.load(KEPT, allow_pickle=False) as file:
        return dict(file)


def logs_runs(method: str = FIRST, stopped: bool = False) -> Table:
    """Return the rows of one method: of the runs that came to an end, or of those that were not begun."""
    table = select(read_table("logs"), method=method)
    return {name: values[np.isnan(table["mean_m"]) == stopped] for name, values in table.items()}


def logs_table() -> Shown:
    """Return how far each run is from the published path (m), and what it said."""
    first, second = logs_runs(), logs_runs(MATCHING)
    rows = []
    for k, building in enumerate(labels_of(first)):
        lengths = first["mean_m"][k], first["max_m"][k], second["mean_m"][k], second["max_m"][k]
        doubted = f"{100 * first['doubted'][k]:.0f}"
        way, scans = f"{first['metres'][k]:.0f}", f"{first['kept'][k]:.0f}"
        rows.append(
            (building, way, scans, *(f"{m:.2f}" for m in lengths), doubted, f"{first['exit'][k]:.0f}")
        )
    head = ("building", "way [m]", "scans", "mean [m]", "largest [m]", "matching, mean [m]", "largest [m]")
    return Shown((*head, "in doubt [%]", "exit"), rows)


def _mean_and_largest(runs: Table, building: str) -> str:
    """Return the mean and the largest distance (m) of one run, in words."""
    run = select(runs, label=building)
    return f"{run['mean_m'][0]:.2f}, {run['max_m'][0]:.2f}"


def trials_table() -> Shown:
    """Return the mean and the largest distance (m) of scan matching, and of each change of it."""
    runs = {method: logs_runs(method) for method in (MATCHING, *TRIALS)}
    buildings = labels_of(runs[ONE_LOOK])
    rows = [(name, *(_mean_and_largest(of, name) for of in runs.values())) for name in buildings]
    return Shown(("building", *(f"{method} [m]" for method in runs)), rows)


def stopped_table() -> Shown:
    """Return the logs at which the check-up stopped the run, and what is left of their scans."""
    runs = logs_runs(stopped=True)
    counts = (runs[name].astype(int).astype(str) for name in ("scans", "kept", "exit"))
    return Shown(("building", "scans", "kept", "exit"), zip(runs["label"], *counts, strict=True))


def logs_picture() -> Picture:
    """Draw the map of each run, with its path and the published one laid on it."""
    runs = logs_runs()
    buildings = labels_of(runs)
    figure, axes = sheet(2.9 * -(-len(buildings) // 2), -(-len(buildings) // 2), 2)
    for ax in axes.flat[len(buildings) :]:
        ax.axis("off")
    for ax, building, metres in zip(axes.flat, buildings, runs["mean_m"], strict=False):
        _draw(ax, building, f"{building}, {metres:.2f} m")
    handles, words = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, words, loc="outside lower center", ncols=2)
    told = ", ".join(f"{name} {metres:.2f} m" for name, metres in zip(buildings, runs["mean_m"], strict=True))
    return Picture(
        figure,
        f"""The maps of {len(buildings)} buildings, each with the path of our run and the published
    one laid on it. Mean distance between the two: {told}.""",
    )


def _draw(ax: Axes, building: str, title: str) -> None:
    """Draw one map without axes, and a bar for its scale."""
    signs, corner, published, path = (
        _stored()[f"{building}, {name}"] for name in ("map", "corner", "published", "path")
    )
    x, y, size = corner.tolist()
    draw_map(ax, OccupancyGrid(GridSpec((x, y), size, signs.shape), signs.astype(float)), title)
    draw_path(ax, corner[:2] + published / 100, "odometry", "published path")
    draw_path(ax, corner[:2] + path / 100, "estimate", "our run")
    ax.plot([x, x + SCALE], [y - 0.03 * size * signs.shape[0]] * 2, color=INK, linewidth=3.0)
    ax.axis("off")
