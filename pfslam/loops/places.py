"""Places, and how two of them fit: a correlation search over a wide window, then point-to-line ICP.

The search goes from coarse to fine (Olson, "Real-time correlative scan matching", 2009). The ICP (Censi, "An ICP
variant using a point-to-line metric", 2008) also asks that a point and its partner face the same way, so that
the two sides of a door frame are not taken for each other, nor for the wall beside them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial import cKDTree

from pfslam.correlation import ScoreField, score_field
from pfslam.events import ScanEvent
from pfslam.grid import GridSpec
from pfslam.poses import transform_points
from pfslam.search.lattice import Lattice
from pfslam.search.volume import score_volume

CELL, YAW_STEP, THINNED = 0.1, 0.01, 4
"""Lattice of the fine search (m, rad), the coarse one has twice that; every fourth point is searched with."""
NEIGHBOURS, NEAR, STRAIGHT = 2, 0.25, 9.0
"""A normal comes from so many beams either side, so near (m), in a piece so much longer than thick (both squared)."""
TURN, REACH, RHO = 0.3, 0.3, 0.05
"""A radian between normals counts as so many metres; partners reach so far (m); weights fall to exp(-1/2) at rho."""
BESIDE, PEAK = (-0.45, -0.3, 0.3, 0.45), 1.3
"""A match that knows a direction knows so many times more than so far (m) beside it."""
SIGMA, INDEPENDENT = 0.015, 0.2
"""Noise of a range (m), and the share of the beams that err independently of each other."""


@dataclass(frozen=True, eq=False)
class Place:
    """End points ``(M, 2)`` (m) of one or more scans and the unit normals ``(M, 2)`` there, which face the LiDAR."""

    points: np.ndarray
    normals: np.ndarray

    @classmethod
    def of(cls, event: ScanEvent) -> Place:
        """Keep the end points of a scan that lie on a piece of wall: principal axes of neighbouring beams."""
        points, beams = event.points_b, event.beams
        near = np.arange(len(points))[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
        near = np.clip(near, 0, len(points) - 1)
        used = np.linalg.norm(points[near] - points[:, None], axis=2) < NEAR
        used &= np.abs(beams[near] - beams[:, None]) <= NEIGHBOURS
        share = used / used.sum(axis=1, keepdims=True)
        offset = points[near] - np.einsum("mn,mni->mi", share, points[near])[:, None]
        spread, axes = np.linalg.eigh(np.einsum("mn,mni,mnj->mij", share, offset, offset))
        normals = axes[:, :, 0]
        normals *= -np.sign(np.sum(normals * (points - event.sensor_b), axis=1, keepdims=True))
        on_wall = (used.sum(axis=1) > NEIGHBOURS + 1) & (spread[:, 1] > STRAIGHT * spread[:, 0])
        return cls(points[on_wall], normals[on_wall])

    def seen_from(self, pose: np.ndarray) -> Place:
        """Return the same place in a frame in which its own is at ``pose (3,)``."""
        return Place(transform_points(pose, self.points), transform_points([0.0, 0.0, pose[2]], self.normals))

    @cached_property
    def tree(self) -> cKDTree:
        """For finding a point's partner by where it lies and which way it faces, in metres."""
        return cKDTree(np.hstack([self.points, TURN * self.normals]))


class Fit(NamedTuple):
    """How one place fits another: ``pose (3,)``, ``information (3, 3)``, and the share of its points explained."""

    pose: np.ndarray
    information: np.ndarray
    share: float


def lines(target: Place, source: Place, pose: np.ndarray, rho: float) -> tuple[Fit, np.ndarray]:
    """Compare ``source`` at ``pose (3,)`` with the lines of ``target``; also return the gradient ``(3,)`` of the cost.

    The cost is sum w r^2 / 2 sigma^2 with r = n^T (R q + t - p) and w = exp(-r^2 / 2 rho^2). The information is that of
    the lines alone, sum w J^T J / sigma^2: along a bare corridor there is none.
    """
    moved, factor = source.seen_from(pose), INDEPENDENT / SIGMA**2
    features = np.hstack([moved.points, TURN * moved.normals])
    distance, partner = target.tree.query(features, distance_upper_bound=REACH)
    found = np.isfinite(distance)
    points, partner = moved.points[found], partner[found]
    normal, arm = target.normals[partner], points - pose[:2]
    residual = np.sum(normal * (points - target.points[partner]), axis=1)
    J = np.column_stack([normal, normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]])
    weight = np.exp(-0.5 * (residual / rho) ** 2)
    information, gradient = factor * (J * weight[:, None]).T @ J, factor * J.T @ (weight * residual)
    return Fit(pose, information, float(np.sum(weight)) / len(moved.points)), gradient


def align(
    target: Place, source: Place, start: np.ndarray, sigmas: tuple[float, float], rounds: int = 15
) -> Fit:
    """Fit ``source`` to ``target`` by point-to-line ICP from ``start (3,)``, which is known to ``sigmas`` (m, rad)."""
    pose, prior = start, np.diag(np.array([sigmas[0], sigmas[0], sigmas[1]]) ** -2.0)
    for k in range(rounds):
        fit, gradient = lines(target, source, pose, RHO if k > 2 else 3 * RHO)
        step = np.linalg.solve(fit.information + prior, gradient + prior @ (pose - start))
        pose = pose - step
        if np.max(np.abs(step)) < 1e-4:
            break
    return fit._replace(pose=pose)


def blind(target: Place, source: Place, fit: Fit) -> list[np.ndarray]:
    """List the direction ``(2,)``, if there is one, about which a match says no more than it would a little further on.

    Seen from near, some points of a bare wall seem to face along it, and find partners wherever the place is put. Those
    of a door frame find theirs in one place only.
    """
    known, directions = np.linalg.eigh(fit.information[:2, :2])
    weak = directions[:, 0]
    moved = (fit.pose + offset * np.append(weak, 0.0) for offset in BESIDE)
    beside = max(weak @ lines(target, source, pose, RHO)[0].information[:2, :2] @ weak for pose in moved)
    return [weak] if known[0] <= PEAK * beside else []


def search_window(target: Place, source: Place, pose: np.ndarray, metres: float, radians: float):
    """Find the best pose of ``source`` in a window around ``pose (3,)``, and the best one a metre or so from it.

    Returns two pairs of pose ``(3,)`` and score from 0 to 1. A twin as good as the best says that the place repeats.
    A coarse cell holds the greatest score of the fine ones in it and around it, so that no good pose is missed.
    """
    spec, points = GridSpec.around(target.points, CELL), source.points[::THINNED]
    occupied = np.zeros(spec.shape, dtype=bool)
    occupied[tuple(spec.world_to_cell(target.points).T[::-1])] = True
    fine = score_field(occupied, "distance")
    pooled = ScoreField(cv2.dilate(fine.values, np.ones((5, 5), np.uint8))[::2, ::2], fine.kind)
    coarse, lattice = GridSpec(spec.origin, 2 * CELL, pooled.values.shape), Lattice(2 * CELL, 2 * YAW_STEP)
    half = np.ceil(np.array([metres, metres, radians]) / lattice.steps).astype(int)
    low = lattice.nearest(pose) - half
    volume = score_volume(pooled, coarse, points, lattice, low, low + 2 * half)
    headings, left = volume.argmax(axis=0), volume.max(axis=0)
    peaks, small, (row, column) = [], Lattice(CELL, YAW_STEP), np.indices(left.shape)
    for _ in range(2):
        y, x = np.unravel_index(np.argmax(left), left.shape)
        corner = 2 * (low + [x, y, headings[y, x]]) - 2
        scores = score_volume(fine, spec, points, small, corner, corner + 4)
        k, j, i = np.unravel_index(np.argmax(scores), scores.shape)
        peaks.append((small.pose(corner + [i, j, k]), float(scores[k, j, i]) / (fine.top * len(points))))
        left[np.hypot(row - y, column - x) * 2 * CELL < 1.0] = -1.0
    return peaks
