"""Chapter 04: the laboratory of a scan on a map, places along a drive, and how sharp a likelihood is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pfslam.events import scan_event
from pfslam.grid import MapConfig, OccupancyGrid
from pfslam.map import Map
from pfslam.particles import effective_sample_size
from pfslam.recording import Recording
from pfslam_book.exercises.ch04 import check_choose, check_count_on_walls, check_transform_test
from pfslam_book.show.drives import Place, place_at
from pfslam_book.show.keep import keep
from pfslam_book.show.lab import Laboratory, show_lab
from pfslam_book.show.source import show_source

__all__ = ["check_choose", "check_count_on_walls", "check_transform_test", "keep", "on_walls", "place_at"]
__all__ += ["places", "sharpness_picture", "show_source", "slide_lab"]

# ---- the laboratory

ALT = """A piece of the map with its walls, and the points of a scan beside them, since the guessed pose is wrong.
In the lower right corner, the scores of all shifts
of the scan at this heading as a small square map, with a cross at the guess."""


def slide_lab() -> Laboratory:
    """The laboratory in which the reader fits a scan to the map of a small building, wherever it was taken."""
    return show_lab("slide", "Slide the scan over the map", ALT)


# ---- what exercise 1 asks for, point by point


def on_walls(grid: OccupancyGrid, points: np.ndarray) -> np.ndarray:
    """For each point ``(M, 2)`` (m, world): whether it lies in an occupied cell. Outside the map none does."""
    cells = grid.spec.world_to_cell(points)
    inside = grid.spec.contains(cells)
    ix, iy = cells[inside].T
    result = np.zeros(len(points), dtype=bool)
    result[inside] = grid.occupied[iy, ix]
    return result


# ---- places along a drive


def places(recording: Recording, every: int = 20, after: float = 10.0) -> Iterator[Place]:
    """Yield every ``every``-th scan from ``after`` seconds on, with its true pose and the map of those before it.

    The maps are drawn from true poses, so what goes wrong is the fault of the score.
    """
    scans, truth, map = recording.scans(), recording.true_path(), Map(MapConfig())
    for t, ranges in zip(scans.t[::every], scans.ranges[::every], strict=True):
        event, pose = scan_event(t, ranges, recording.robot.lidar, np.zeros(3), ()), truth.at(t)
        if t - scans.t[0] > after:
            yield Place(map.copy().grid, event.points_b, pose)
        map.draw(event, pose)


# ---- how sharp a likelihood is


def sharpened(shares: np.ndarray, sharpness: float) -> np.ndarray:
    """Weights ``(n,)`` proportional to exp(sharpness share); the best is 1 before they are normalised."""
    weights = np.exp(sharpness * (shares - shares.max()))
    return weights / weights.sum()


def describe_weights(shares: np.ndarray, sharpness: float) -> str:
    """Say in words how the weights are shared."""
    weights = sharpened(shares, sharpness)
    return f"""Weights exp({sharpness:g} times share) of {len(weights)} particles: the effective number is
    {effective_sample_size(weights):.1f}, the heaviest particle has {weights.max():.3f} of all weight."""


def sharpness_options(cloud: np.ndarray, shares: np.ndarray) -> dict:
    """What the script needs: the particles around their mean (cm), and the shares."""
    around = 100.0 * (cloud[:, :2] - cloud[:, :2].mean(axis=0))
    return {"cloud": np.round(around, 2).ravel().tolist(), "shares": np.asarray(shares).tolist()}


def sharpness_picture(cloud: np.ndarray, shares: np.ndarray) -> Laboratory:
    """One slider: what a perfect scan is worth, for particles ``cloud (n, 3)`` and their ``shares (n,)``."""
    title, alt = "How sharp should the likelihood be?", describe_weights(shares, 54.0)
    return show_lab("sharpness", title, alt, **sharpness_options(cloud, shares))
