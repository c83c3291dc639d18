"""How a LiDAR moved between two scans, told by the scans alone.

Many pairs of scans are matched at once: the end points of the second scan are moved onto the walls that the first one
saw, by Gauss-Newton steps on their distances from short lines (Censi, "An ICP variant using a point-to-line metric",
2008). The line that a point belongs to is that of the first scan's beam that points at it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.poses import Trajectory, between, compose, wrap_angle
from pfslam.recording import Recording
from pfslam.sensors import LidarModel, beam_directions

STANDING, NO_TURN = 0.02, 0.02
"""Way (m) and turn (rad) between two scans up to which a robot stands."""
LEAST_PAIRS, MOST_PAIRS = 10, 100
"""Pairs of scans that say something, and those that are matched."""
LATEST = 1.0
"""Largest offset (s) between two clocks that is looked for."""
GAP = 3.0
"""Readings that are so many times farther apart than usual have a gap between them."""
MOST_BEAMS = 120
"""Beams of the second scan that are matched."""
HALF_LINE = np.radians(4.0)
"""A beam's line is fitted to the end points within this angle to its left and right."""
OVERLAP = 0.3
"""Least share of beams that must meet a line of the other scan."""
FAR, FINEST = 0.5, 0.02
"""Distances (m) from its line at which a point may be in a first guess, and at which it is always believed."""
ROUNDS = (0.4, FAR * 0.6 ** np.arange(8)), (1.0, np.array([0.1, 0.1, FINEST, FINEST]))
"""Least time (s) between the scans of a pair, and how far (m) from its line a point counts, iteration by iteration.

First for scans so close that even a guess of no motion leads to the match, then for some that lie farther apart, from
where the first ones are expected to lead.
"""


def pairs_of_scans(recording: Recording, path: Trajectory, apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose first and second scans ``(P,)``, ``apart`` (s) or more, evenly from when the path shows motion."""
    t, gaps = recording.scans().t, np.append(np.diff(path.t), 0.0)
    since = gaps[np.searchsorted(path.t, t, side="right").clip(1) - 1]
    covered = np.flatnonzero(
        path.covers(t - LATEST) & path.covers(t + LATEST) & (since <= GAP * np.median(gaps))
    )
    second = np.searchsorted(t[covered], t[covered] + apart)
    first, second = covered[second < len(covered)], covered[second[second < len(covered)]]
    close = t[second] - t[first] <= GAP * np.median(np.append(t[second] - t[first], apart))
    first, second = first[close], second[close]
    step = np.abs(between(path.at(t[first]), path.at(t[second])))
    moved = np.flatnonzero((step > [STANDING, STANDING, NO_TURN]).any(axis=1))
    moved = moved if len(moved) >= LEAST_PAIRS else np.arange(len(first))
    some = moved[np.unique(np.linspace(0, len(moved) - 1, min(MOST_PAIRS, len(moved))).astype(int))]
    return first[some], second[some]


@dataclass(frozen=True, eq=False)
class Matcher:
    """Pairs of scans: end ``points (P, M, 2)`` of the second ones, and a line near each beam of the first ones.

    A line has a unit ``normal (P, B, 2)`` and a ``distance (P, B)`` (m) from the LiDAR; ``trust (P, B)`` is 0 where
    there is none, and towards 1 the straighter it is, compared with others of its scan.
    """

    lidar: LidarModel
    points: np.ndarray
    normal: np.ndarray
    distance: np.ndarray
    trust: np.ndarray

    @classmethod
    def of(cls, recording: Recording, path: Trajectory, first: np.ndarray, second: np.ndarray) -> Matcher:
        """Take the points, NaN where a beam saw nothing, and fit the lines, all as from the stamps of the scans.

        A line with normal n at distance d meets the beam with direction u at r = d / (n u). So 1 / r = (n / d) u is
        linear in n / d, and noise of the range leaves the direction of the beam alone.
        """
        lidar, ranges = recording.robot.lidar, recording.scans().ranges
        some = np.arange(0, lidar.beams, -(-lidar.beams // MOST_BEAMS))
        after = np.where(lidar.valid(ranges[second]), ranges[second], np.nan)[:, some, None]
        seen = lidar.valid(ranges[first])
        r = _without_strays(ranges[first], seen, all_round(lidar))
        q, (c, s) = np.where(seen, 1.0 / r, 0.0), beam_directions(lidar).T
        moments = np.stack([seen, seen * c * c, seen * c * s, seen * s * s, q * c, q * s, q * q])
        half = max(1, round(HALF_LINE / lidar.increment))
        n, cc, cs, ss, qc, qs, qq = _around(moments, half, all_round(lidar)).sum(axis=-1)
        determinant = cc * ss - cs * cs
        found = seen & (n > 2.5) & (determinant > 1e-9)
        x, y = np.where(found, [ss * qc - cs * qs, cc * qs - cs * qc], 1.0) / np.where(
            found, determinant, 1.0
        )
        left = np.sqrt(np.maximum(qq - x * qc - y * qs, 0.0) / np.maximum(n, 1.0)) * r * r + 1e-3
        typical = np.median(np.where(found, left, left.max()), axis=1, keepdims=True)
        distance = 1.0 / np.hypot(x, y)
        normal = np.stack([x, y], axis=-1) * distance[..., None]
        points = after * beam_directions(lidar)[some]
        if lidar.sweep:
            x, y, turn = np.moveaxis(moved_meanwhile(recording, path, first), -1, 0)
            normal = _rotated(normal, turn)
            distance = distance + (normal * np.stack([x, y], axis=-1)).sum(axis=-1)
            meanwhile = moved_meanwhile(recording, path, second)[:, some]
            points = _rotated(points, meanwhile[..., 2]) + meanwhile[..., :2]
        return cls(lidar, points, normal, distance, found / (1.0 + (left / typical) ** 2))

    def gaps(self, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Measure how far points moved by ``moves (P, 3)`` are from lines ``(P, M)`` (m), with Jacobian and trust."""
        rows, middle = np.arange(len(moves))[:, None], self.lidar.beams // 2
        x, y, turn = moves.T[..., None]
        arm = (self.points[..., 0] + 1j * self.points[..., 1]) * np.exp(1j * turn)
        moved = arm + x + 1j * y
        seen = np.isfinite(moved)
        off = wrap_angle(np.angle(moved) - self.lidar.angles[middle]) / self.lidar.increment
        beam = np.rint(np.where(seen, off, 0.0)).astype(int) + middle
        seen &= all_round(self.lidar) | ((beam >= 0) & (beam < self.lidar.beams))
        beam %= self.lidar.beams
        nx, ny = np.moveaxis(self.normal[rows, beam], -1, 0)
        jacobian = np.stack([nx, ny, ny * arm.real - nx * arm.imag], axis=-1)
        gap = nx * moved.real + ny * moved.imag - self.distance[rows, beam]
        trust = np.where(seen, self.trust[rows, beam], 0.0)
        return np.where(trust > 0.0, gap, 0.0), np.where(trust[..., None] > 0.0, jacobian, 0.0), trust

    def best(self, *starts: np.ndarray) -> np.ndarray:
        """Choose for each pair the move ``(3,)`` that brings its scans closest together, of each of ``(P, 3)``."""
        met = [self.gaps(moves) for moves in starts]
        apart = [
            np.where(trust > 0.0, np.minimum(np.abs(gap), FAR), FAR).mean(axis=1) for gap, _, trust in met
        ]
        return np.array(starts)[np.argmin(apart, axis=0), np.arange(len(starts[0]))]

    def match(self, moves: np.ndarray, reaches: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Improve ``moves (P, 3)``; also return their covariance ``(P, 3, 3)``, and which scans overlap ``(P,)``."""
        for reach in reaches:
            gap, jacobian, trust = self.gaps(moves)
            spread = 4.0 * np.median(np.abs(gap), axis=1, keepdims=True)
            weight = trust / (1.0 + (gap / np.maximum(spread, max(FINEST, reach))) ** 2) ** 2
            weighted = np.swapaxes(jacobian * weight[..., None], 1, 2)
            H = weighted @ jacobian + 1e-6 * np.eye(3)
            moves = moves - np.clip(np.linalg.solve(H, weighted @ gap[..., None])[..., 0], -0.2, 0.2)
        variance = (weight * gap**2).sum(axis=1) / weight.sum(axis=1).clip(1e-9) + 1e-6
        return moves, np.linalg.inv(H) * variance[:, None, None], (trust > 0.0).mean(axis=1) > OVERLAP


def moved_meanwhile(recording: Recording, path: Trajectory, scans: np.ndarray) -> np.ndarray:
    """Return how the LiDAR moved from the stamp of each scan to each of its beams ``(P, B, 3)``, by the odometry."""
    lidar, t = recording.robot.lidar, recording.scans().t[scans]
    sits = np.array([*lidar.position_b[:2], 0.0])
    times = np.clip(t[:, None] + lidar.sweep * np.linspace(-0.5, 0.5, lidar.beams), *path.t[[0, -1]])
    there = compose(path.at(times.ravel()), sits).reshape(*times.shape, 3)
    return between(compose(path.at(t), sits)[:, None], there)


def _rotated(vectors: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Rotate vectors ``(..., 2)`` by angles ``(...)`` (rad)."""
    c, s, (x, y) = np.cos(turn), np.sin(turn), np.moveaxis(vectors, -1, 0)
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def all_round(lidar: LidarModel) -> bool:
    """Tell whether the beams go all around, so that the last one is the first one's neighbour."""
    return lidar.beams * lidar.increment > 2.0 * np.pi - 1.5 * lidar.increment


def _without_strays(ranges: np.ndarray, seen: np.ndarray, wrap: bool) -> np.ndarray:
    """Replace ranges ``(P, B)`` by the median of five neighbours, those that saw nothing by the last one that did."""
    last = np.maximum.accumulate(np.where(seen, np.arange(ranges.shape[1]), 0), axis=1)
    return np.median(_around(np.take_along_axis(np.where(seen, ranges, 1.0), last, axis=1), 2, wrap), axis=-1)


def _around(values: np.ndarray, half: int, wrap: bool) -> np.ndarray:
    """Return each of ``values (..., B)`` with its neighbours ``(..., B, 2 half + 1)``; at an end it stands for them."""
    padding = [(0, 0)] * (values.ndim - 1) + [(half, half)]
    padded = np.pad(values, padding, mode="wrap" if wrap else "edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=-1)
