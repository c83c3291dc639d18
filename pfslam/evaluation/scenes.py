"""How a LiDAR is mounted, told from the drive: two scenes lie on each other only if it sits where it is taken to sit.

A scan and a later one are two views of the same walls. The odometry says how the robot moved in between, and the
mounting how the LiDAR moved with it; so moved, the points of the later scan must fall on those of the earlier one. On a
straight way the direction of the LiDAR shows, and in a turn its place: the farther from the axis, the wider its circle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np

from pfslam.motion import dead_reckoning
from pfslam.poses import between, transform_points
from pfslam.recording import Recording
from pfslam.sensors import scan_points

STRIDE, CORNER = 1.0, 0.6
"""Way (m) and turn (rad) between two scans that are compared; the more, the less of one is seen in the other."""
NEARLY_STRAIGHT, NEARLY_STANDING = 0.2, 0.5
"""Turn (rad) up to which such a way has one direction, and way (m) in such a turn, which odometry must know."""
LEAST_PAIRS, MOST_PAIRS = 10, 40
"""Pairs of scans that say something, and those that are compared."""
SLACK = np.arange(-4, 5) * 0.015
"""By how much (rad) an odometry may be wrong about a turn, without anything being mounted otherwise."""
SEEN, SCENE_CELL = 10.0, 0.05
"""A scene is drawn up to so many metres from the LiDAR, in cells of this size (m)."""
APART = 0.3
"""A point farther (m) than this from the other scene's walls is on none of them: how much farther says nothing."""
TELLING, TELLING_FACTOR = 0.1, 0.04
"""Share of the range of distances by which one answer must be better than what is stated, to be believed.

Of factors, those that are 5 % off had 0.05 and more, sound robots 0.02 at most, but for 0.03 among many people.
"""


def scene_fit(recording: Recording) -> tuple[float, float, float] | None:
    """Fit how far the scene moved on straight ways, by the odometry's measure, and how the LiDAR is turned (deg).

    The points of each scan are moved onto those of another, by the odometry's motion in every direction and then at
    every scale; what puts most of them onto the scene counts. (1, 0) unless another answer is clearly better; None if
    there is too little to compare. A scene that stands still has no direction. The third number is the sway (deg):
    half of the scenes have turned by at least so much more, or less, than is usual for the drive, as they do where a
    LiDAR is loose.
    """
    pairs = [*_scenes(recording, turning=False)]
    if len(pairs) < LEAST_PAIRS:
        return None
    degrees, factors = np.arange(-175.0, 181.0, 5.0), np.arange(101) / 50.0
    turns = np.exp(-1j * np.deg2rad(degrees))
    apart = np.sum([a.apart(b, way * turns) for a, b, way, _ in pairs], axis=0)
    yaw = float(_best(degrees, apart, 0.0, TELLING))
    ahead, unmoved = np.exp(-1j * np.deg2rad(yaw)), np.zeros(1)
    apart = np.sum([a.apart(b, way * ahead * factors) for a, b, way, _ in pairs], axis=0)
    factor = float(_best(factors, apart, 1.0, TELLING_FACTOR))
    if factor <= 0.1:
        return factor, 0.0, 0.0
    moved = [_apart_turned(a, b, way * ahead * factor, turn, unmoved) for a, b, way, turn in pairs]
    turned = np.rad2deg(SLACK[np.argmin(moved, axis=1)[:, 0]])
    sway = float(np.median(np.abs(turned - np.median(turned))))
    return factor, yaw, sway


def place_fit(recording: Recording) -> tuple[float, float] | None:
    """Fit how far (m) ahead and to the left of its stated place the LiDAR sits, by how scenes move in turns.

    A LiDAR that sits at ``d`` from there moves by ``(turn - 1) d`` more than stated. Each pair of scans may turn a
    little more or less than the odometry says. (0, 0) unless another place is clearly better, up to half a metre away;
    None if there is too little to compare.
    """
    pairs = [*_scenes(recording, turning=True)]
    if len(pairs) < LEAST_PAIRS:
        return None
    metres = np.arange(-5, 6) / 10.0
    places = (metres[:, None] + 1j * metres).ravel()
    apart = np.sum([_apart_turned(*pair, places).min(axis=0) for pair in pairs], axis=0)
    place = complex(_best(places, apart, 0.0, TELLING))
    return place.real, place.imag


def _apart_turned(
    scene: Scene, after: np.ndarray, way: complex, turn: complex, places: np.ndarray
) -> np.ndarray:
    """Measure how far (m) points lie from a scene, for further turns ``SLACK`` and places ``(K,)`` of the LiDAR."""
    turned = [transform_points([0.0, 0.0, slack], after) for slack in SLACK]
    ways = [way + (turn * np.exp(1j * slack) - 1.0) * places for slack in SLACK]
    return np.array([scene.apart(*both) for both in zip(turned, ways, strict=True)])


def _best(answers: np.ndarray, apart: np.ndarray, stated: complex, telling: float):
    """Return the answer that brings the scenes together, or the stated one where none is better by a telling share."""
    better = apart[np.argmin(np.abs(answers - stated))] - apart.min()
    return answers[np.argmin(apart)] if better > telling * np.ptp(apart) else stated


def _scenes(recording: Recording, turning: bool) -> Iterator[tuple[Scene, np.ndarray, complex, complex]]:
    """Yield pairs of scans, a stride apart on straight ways or a corner apart in turns.

    Of each: the scene that the first one saw, the points of the second, turned as the first, the LiDAR's way between
    them, and the turn between them, as complex numbers in the axes of the first.
    """
    if recording.lidar is None:
        return
    lidar, scans, odometry = recording.robot.lidar, recording.scans(), dead_reckoning(recording)
    covered = np.flatnonzero(odometry.covers(scans.t))
    poses = odometry.at(scans.t[covered])
    first, second = _pairs(poses, turning)
    motion = between(poses[first], poses[second])
    place = np.array(lidar.position_b[:2])
    for k in np.unique(np.linspace(0, len(first) - 1, MOST_PAIRS).astype(int)) if len(first) else ():
        before, after = (scan_points(scans.ranges[covered[i]], lidar) - place for i in (first[k], second[k]))
        if min(len(before), len(after)) > 0:
            x, y = (transform_points(motion[k], place[None]) - place)[0]
            after = transform_points([0.0, 0.0, motion[k, 2]], after)
            yield Scene.of(before), after, x + 1j * y, np.exp(1j * motion[k, 2])


def _pairs(poses: np.ndarray, turning: bool) -> tuple[np.ndarray, np.ndarray]:
    """Choose the first and the second of pairs of poses ``(K, 3)`` between which a robot drove on, or turned."""

    def measured(motion):
        metres, turn = np.hypot(*motion[:, :2].T), np.abs(motion[:, 2])
        return (turn, metres) if turning else (metres, turn)

    stride, limit = (CORNER, NEARLY_STANDING) if turning else (STRIDE, NEARLY_STRAIGHT)
    gone = np.append(0.0, np.cumsum(measured(between(poses[:-1], poses[1:]))[0]))
    second = np.searchsorted(gone, gone + stride)
    first = np.flatnonzero(second < len(gone))
    second = second[first]
    wanted, other = measured(between(poses[first], poses[second]))
    good = (wanted > 0.5 * stride) & (wanted < 2.0 * stride) & (other < limit)
    return first[good], second[good]


@dataclass(frozen=True, eq=False)
class Scene:
    """How far (m) each cell ``away (H, W)`` is from the nearest point that a scan saw, at most ``APART``.

    ``corner (2,)`` is the cell (ix, iy) of the first, among those of ``SCENE_CELL`` from ``-SEEN`` on. All further
    cells are as far away as those at the edge: on none of the walls, or beyond what is drawn.
    """

    corner: np.ndarray
    away: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray) -> Scene:
        """Draw the points ``(M, 2)`` of a scan."""
        size = int(2 * SEEN / SCENE_CELL)
        near = points[np.abs(points).max(axis=1) < SEEN]
        cells = np.minimum(((near + SEEN) / SCENE_CELL).astype(int), size - 1)
        if not len(cells):
            return cls(np.zeros(2, dtype=int), np.full((1, 1), APART, dtype=np.float32))
        margin = ceil(APART / SCENE_CELL) + 1
        corner = np.maximum(cells.min(axis=0) - margin, 0)
        width, height = np.minimum(cells.max(axis=0) + margin + 1, size) - corner
        empty = np.ones((height, width), dtype=np.uint8)
        ix, iy = (cells - corner).T
        empty[iy, ix] = 0
        away = cv2.distanceTransform(empty, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return cls(corner, np.minimum(SCENE_CELL * away, APART))

    def apart(self, after: np.ndarray, ways: np.ndarray) -> np.ndarray:
        """Measure how far (m) points ``(M, 2)`` are away when moved by each of the ways, complex ``(K,)``."""
        moved = after[:: len(after) // 180 + 1].T[:, None] + np.array([ways.real, ways.imag])[..., None]
        ix, iy = ((moved + SEEN) / SCENE_CELL).astype(int) - self.corner[:, None, None]
        height, width = self.away.shape
        return self.away.take(iy.clip(0, height - 1) * width + ix.clip(0, width - 1)).mean(axis=1)
