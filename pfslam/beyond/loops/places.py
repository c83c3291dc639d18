"""Places, and how two of them fit: a correlation search over a wide window, then point-to-line ICP.

The search is Olson's ("Real-time correlative scan matching", 2009). The ICP (Censi, "An ICP variant using a
point-to-line metric", 2008) also asks that a point and its partner face the same way, so that the two sides of a door
frame are not taken for each other, nor for the wall beside them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pfslam.events import ScanEvent
from pfslam.grid import GridSpec
from pfslam.poses import transform_points
from pfslam.refined.field import TOP, score_field
from pfslam.search.lattice import Lattice
from pfslam.search.volume import score_volume

CELL, YAW_STEP, THINNED = 0.1, 0.02, 4
"""Lattice of the search (m, rad); every fourth point is searched with."""
NEIGHBOURS, NEAR, STRAIGHT = 5, 0.25, 9.0
"""A normal comes from this many neighbours, this near (m), in a piece this many times longer than thick (squared)."""
TURN, REACH, RHO = 0.3, 0.3, 0.05
"""Metres that a radian between normals counts as; reach of partners (m); weights fall to exp(-1/2) at rho (m)."""
DAMPING = np.diag([25.0, 25.0, 400.0])
"""Information (1/m^2, 1/m^2, 1/rad^2) that a step of the ICP pretends to have."""
SIGMA, INDEPENDENT = 0.015, 0.2
"""Noise of a range (m), and the share of the beams that err independently of each other."""


@dataclass(frozen=True, eq=False)
class Place:
    """End points ``(M, 2)`` (m) of one or more scans and the unit normals ``(M, 2)`` there, which face the LiDAR."""

    points: np.ndarray
    normals: np.ndarray

    @classmethod
    def of(cls, event: ScanEvent) -> Place:
        """Keep the end points of a scan that lie on a piece of wall: principal axes of the nearest points."""
        points = event.points_b
        distance, near = cKDTree(points).query(points, k=NEIGHBOURS)
        offset = points[np.minimum(near, len(points) - 1)]
        offset = offset - offset.mean(axis=1, keepdims=True)
        spread, axes = np.linalg.eigh(np.swapaxes(offset, 1, 2) @ offset)
        normals = axes[:, :, 0]
        normals *= -np.sign(np.sum(normals * (points - event.sensor_b), axis=1, keepdims=True))
        on_wall = (distance[:, -1] < NEAR) & (spread[:, 1] > STRAIGHT * spread[:, 0])
        return cls(points[on_wall], normals[on_wall])

    def seen_from(self, pose: np.ndarray) -> Place:
        """Return the same place in a frame in which its own is at ``pose (3,)``."""
        return Place(transform_points(pose, self.points), transform_points([0.0, 0.0, pose[2]], self.normals))

    @cached_property
    def tree(self) -> cKDTree:
        """For finding a point's partner by where it lies and which way it faces, in metres."""
        return cKDTree(np.hstack([self.points, TURN * self.normals]))


def compare(target: Place, source: Place, pose: np.ndarray, rho: float = RHO) -> tuple:
    """Compare ``source`` at ``pose (3,)`` with the lines of ``target``.

    The cost is sum w r^2 / 2 sigma^2 with r = n^T (R q + t - p) and w = exp(-r^2 / 2 rho^2). Returns its gradient
    ``(3,)``, its information ``(3, 3)``, sum w J^T J / sigma^2, and the share of the points that the lines explain,
    sum w / M. Along a bare corridor exact normals leave no information. Those of scans have noise, which feigns
    some: on the bare side of the simulated ring it says 2 to 3 cm of matches that wheels 6 % off put 8 to 27 cm off.
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
    gradient, information = factor * J.T @ (weight * residual), factor * (J * weight[:, None]).T @ J
    return gradient, information, np.sum(weight) / len(moved.points)


def align(target: Place, source: Place, pose: np.ndarray) -> np.ndarray:
    """Move ``source`` from ``pose (3,)`` to where it fits the lines of ``target``: point-to-line ICP.

    A step d solves (A + D) d = -g, with A the information, g the gradient and a small D, which keeps the pose where it
    is along a direction about which no line says anything (Levenberg and Marquardt's damping).
    """
    for rho in 3 * [3 * RHO] + 12 * [RHO]:
        gradient, information, _ = compare(target, source, pose, rho)
        step = np.linalg.solve(information + DAMPING, -gradient)
        pose = pose + step
        if np.max(np.abs(step)) < 1e-4:
            break
    return pose


def search_window(target: Place, source: Place, pose: np.ndarray, metres: float, radians: float):
    """Find the best pose of ``source`` in a window around ``pose (3,)``, and the best one a metre or more from it.

    Returns two pairs of pose ``(3,)`` and score from 0 to 1. A twin as good as the best says that the place repeats.
    """
    spec, lattice = GridSpec.around(target.points, CELL), Lattice(CELL, YAW_STEP)
    points = source.points[::THINNED]
    occupied = np.zeros(spec.shape, dtype=bool)
    occupied[tuple(spec.world_to_cell(target.points).T[::-1])] = True
    field = score_field(occupied)
    half = np.ceil(np.array([metres, metres, radians]) / lattice.steps).astype(int)
    low = lattice.nearest(pose) - half
    volume = score_volume(field, spec, points, lattice, low, low + 2 * half)
    headings, left = volume.argmax(axis=0), volume.max(axis=0) / (TOP * len(points))
    peaks, (row, column) = [], np.indices(left.shape)
    for _ in range(2):
        y, x = np.unravel_index(np.argmax(left), left.shape)
        peaks.append((lattice.pose(low + [x, y, headings[y, x]]), float(left[y, x])))
        left[np.hypot(row - y, column - x) * CELL < 1.0] = -1.0
    return peaks
