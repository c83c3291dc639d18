"""Outliers among people and glass: beams left out, a gate for the match, hits that wait.

A map of walls has no place for what moves. If a person walks ahead of the robot, the filter draws a wall there, matches
the next scan to that wall, and the robot seems to stand still. Three measures help, in the spirit of mapping among
people (Haehnel, Triebel, Burgard and Thrun, "Map building with mobile robots in dynamic environments", 2003):

* A beam that ends where the map is known to be free says nothing about the pose, and is left out of the match.
* A match is not believed if it lies far from odometry and leaves many beams unexplained. In tracking this is called a
  validation gate (Bar-Shalom and Fortmann, "Tracking and Data Association", 1988). Wheels that slip pass it, because
  walls explain the scan at its true pose.
* A wall cannot be seen through. If a later beam passes the place of a hit, something has gone, and is probably still
  near. So hits near that place wait until later scans have met them again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Annotated

import cv2
import numpy as np

from pfslam.grid import GridSpec, MapConfig, OccupancyGrid, free_cells
from pfslam.poses import wrap_angle
from pfslam.settings import Range, Settings

NOISY = 0.035
"""Ranges are noisy if they scatter by more than this (m): a wall is then smeared over several cells.

Common scanners are good to 1 or 2 cm.
"""
MOST_UNEXPLAINED = 0.1
"""A match beyond the gate is believed if it leaves at most this share of the beams unexplained."""
WAIT = 5
"""Hits near something that has gone wait for so many drawn scans."""
RADIUS = 0.5
"""Hits wait if they are nearer than this (m) to something that has gone: a person's width."""

THINNED = 0.1
"""Places where something has gone are looked at once in each square of this side (m)."""


@dataclass(frozen=True)
class OutlierConfig(Settings):
    """What a run does about beams and matches that the map contradicts."""

    gate: Annotated[float, Range(0.0, inf)] = 3.0
    """A match that lies so many sigmas of the motion from odometry is rejected if many beams stay unexplained."""
    free_scans: Annotated[int, Range(1, 1000)] = 4
    """A beam is left out of the match if its end cell was seen free so often and lies far from any wall."""
    gone: Annotated[int, Range(1, 1000)] = 2
    """A hit has gone if the scans that saw through it outnumber those that met it again by so many."""
    margin: Annotated[int, Range(0, 100)] = 2
    """A beam that ends at most so many cells from a hit did not see through it: it may have met the same wall."""


def inliers(
    grid: OccupancyGrid, field: np.ndarray, points_w: np.ndarray, free: float, config: OutlierConfig
) -> np.ndarray:
    """Find the end points ``(M, 2)`` that the map does not contradict, ``(M,)`` bool; ``field (H, W)`` is its field.

    The map contradicts an end point in a cell that was seen free ``config.free_scans`` times, with ``free`` log-odds
    each time, and lies out of reach of any wall.
    """
    cells = grid.spec.world_to_cell(points_w)
    inside = grid.spec.contains(cells)
    ix, iy = cells[inside].T
    known = np.ones(len(cells), dtype=bool)
    round_off = 1e-4
    often_free = grid.log_odds[iy, ix] <= -config.free_scans * free + round_off
    known[inside] = ~(often_free & (field[iy, ix] == 0))
    return known


def beyond_gate(departure: np.ndarray, variance: np.ndarray, gate: float) -> bool:
    """Whether a departure ``(3,)`` (m, m, rad) from odometry is more than ``gate`` sigmas long.

    Its squared Mahalanobis length is (dx^2 + dy^2) / variance[0] + dtheta^2 / variance[1].
    """
    dx, dy, turn = departure[0], departure[1], wrap_angle(departure[2])
    return bool((dx**2 + dy**2) * variance[1] + turn**2 * variance[0] > gate**2 * variance[0] * variance[1])


@dataclass(frozen=True, eq=False)
class WaitingScan:
    """The hits ``points_w (M, 2)`` of a drawn scan while later scans confirm or contradict them.

    ``votes (M,)`` counts the scans that met a hit again less those that saw through its place; ``drawn (M,)`` tells
    which hits are in the map already.
    """

    points_w: np.ndarray
    votes: np.ndarray
    drawn: np.ndarray


def settle_hits(
    waiting: tuple[WaitingScan, ...],
    spec: GridSpec,
    points_w: np.ndarray,
    beams: np.ndarray,
    sensor_w: np.ndarray,
    map_config: MapConfig,
    config: OutlierConfig,
) -> tuple[np.ndarray, tuple[WaitingScan, ...]]:
    """Let a new scan vote on the hits that wait; return the hits ``(H, 2)`` to draw now and the scans that wait then.

    Two kinds of hits are drawn now. Of the new scan: those that are not near anything that has gone. Of the scan that
    has waited longest: those that were held back, and that later scans met again at least as often as they saw through
    them.
    """
    verdict, corner = seen_again_or_through(spec, points_w, beams, sensor_w, map_config.rays, config.margin)
    waiting = tuple(replace(scan, votes=scan.votes + _votes(scan, spec, verdict, corner)) for scan in waiting)
    gone = [scan.points_w[scan.votes <= -config.gone] for scan in waiting]
    sound = ~_near(points_w, np.concatenate([np.zeros((0, 2)), *gone]), RADIUS)
    hits = [points_w[sound]]
    waiting = (*waiting, WaitingScan(points_w, np.zeros(len(points_w), dtype=np.int64), sound))
    if len(waiting) > WAIT:
        oldest, waiting = waiting[0], waiting[1:]
        hits.append(oldest.points_w[~oldest.drawn & (oldest.votes >= 0)])
    return np.concatenate(hits), waiting


def seen_again_or_through(
    spec: GridSpec, points_w: np.ndarray, beams: np.ndarray, sensor_w: np.ndarray, rays: str, margin: int
) -> tuple[np.ndarray, np.ndarray]:
    """Say what a scan saw of each cell of its rectangle: 1 a hit, -1 free and no hit near, 0 neither, ``(h, w)`` int8.

    Also return the rectangle's corner ``(2,)`` as (ix, iy). Arguments as in ``grid.free_cells``; a hit is near if it
    is at most ``margin`` cells away along both axes.
    """
    free, rectangle = free_cells(spec, points_w, beams, sensor_w, rays)
    corner = np.array([rectangle[1].start, rectangle[0].start])
    ix, iy = (spec.world_to_cell(points_w) - corner).T
    hit = np.zeros_like(free)
    hit[iy, ix] = 1
    near = cv2.dilate(hit, np.ones((2 * margin + 1, 2 * margin + 1), dtype=np.uint8))
    return hit.astype(np.int8) - (free & (1 - near)).astype(np.int8), corner


def _votes(scan: WaitingScan, spec: GridSpec, verdict: np.ndarray, corner: np.ndarray) -> np.ndarray:
    cells = spec.world_to_cell(scan.points_w) - corner
    inside = ((cells >= 0) & (cells < verdict.shape[::-1])).all(axis=1)
    votes = np.zeros(len(cells), dtype=np.int64)
    ix, iy = cells[inside].T
    votes[inside] = verdict[iy, ix]
    return votes


def _near(points_w: np.ndarray, places: np.ndarray, radius: float) -> np.ndarray:
    """Which points ``(M, 2)`` are less than ``radius`` (m) from any of the places ``(P, 2)``, thinned."""
    near = np.zeros(len(points_w), dtype=bool)
    for place in np.unique(np.rint(places / THINNED), axis=0) * THINNED:
        near |= np.hypot(*(points_w - place).T) < radius
    return near
