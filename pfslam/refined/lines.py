"""Alignment to lines: one pose fitted to the walls that the map's own hits form.

A grid remembers that a cell was hit, not where in the cell. A wall nearly parallel to the grid falls into one row of
cells and its small tilt is lost: the heading is pulled parallel to the grid. So every cell also keeps the moments of
its hits, from which follow the mean and covariance of a normal distribution, as in the normal distributions transform,
NDT (Biber and Strasser, "The normal distributions transform", 2003). The hits of three by three cells give a short
piece of wall as a line, sharper than any cell, and the scan is fitted to these lines by weighted Gauss-Newton steps:
point-to-line ICP (Censi, "An ICP variant using a point-to-line metric", 2008) with the map's lines as reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np

from pfslam.grid import Canvas, GridSpec
from pfslam.poses import transform_points, wrap_angle
from pfslam.settings import Range, Settings

MAX_STEP = np.array([0.1, 0.1, 0.05])
"""Largest correction in one iteration (m, m, rad): the alignment is a local step."""
ITERATIONS = 6
"""It has settled after two to five."""
REACH = 1
"""A beam sees the hits up to so many cells away: 1 gives 3 x 3 cells, 0.15 m of wall."""
BEAM_STRIDE = 2
"""Every second beam is aligned: neighbours lie on the same piece of wall."""
THICKNESS = 0.02
"""Floor under the short variance of a line (cells squared): ranges to a few millimetres would divide by zero."""
RHO = 0.05
"""Distance (m) from its line at which a beam's weight has fallen to exp(-1/2)."""
DEGENERATE_BELOW = 0.01
"""Least share of normals along a direction for the map to have a say in it; below, odometry decides."""
LINE_SIGMA = 0.02
"""Standard deviation (m) of one beam's distance from its line, when lines are weighed against odometry."""


@dataclass(frozen=True)
class LineConfig(Settings):
    """What counts as a line, and how lines are weighed against odometry."""

    min_hits: Annotated[int, Range(1, 10_000)] = 3
    """A neighbourhood with fewer hits is no line."""
    elongation: Annotated[float, Range(0.0, 1e6)] = 2.0
    """Nor is one whose long variance is less than so many short ones (plus ``THICKNESS``)."""
    independent_beams: Annotated[float, Range(0.0, 1e6)] = 0.0
    """As so many independent beams do the lines count against odometry; 0: odometry has no say where lines have one."""


class HitMoments:
    """Per cell: number, sums and sums of squares of its hits; written in place by the map that owns them.

    Few cells are ever hit, so the moments stand in a table: ``slots`` says in which row of ``sums (R, 6)`` (n, x, y,
    xx, xy, yy) a cell's are; row 0 is that of all cells without hits, and stays zero. Coordinates are in cells,
    relative to the cell's own centre, so that nothing is lost far from the origin. ``first (R,)`` is the number of the
    scan that hit the cell first, -1 where there are no hits.
    """

    def __init__(self, spec: GridSpec):
        self.slots = Canvas(spec, np.int32)
        self.used = 1
        self._sums, self._first = np.zeros((64, 6)), np.full(64, -1)

    @property
    def spec(self) -> GridSpec:
        """The grid whose cells these are."""
        return self.slots.spec

    @property
    def sums(self) -> np.ndarray:
        """The table of moments ``(R, 6)``."""
        return self._sums[: self.used]

    @property
    def first(self) -> np.ndarray:
        """The scan ``(R,)`` that hit each row's cell first."""
        return self._first[: self.used]

    def copy(self) -> HitMoments:
        """Return moments of their own with the same values."""
        other = HitMoments.__new__(HitMoments)
        other.slots, other.used = self.slots.copy(), self.used
        other._sums, other._first = self._sums.copy(), self._first.copy()
        return other

    def add(self, points_w: np.ndarray, scan: int = 0) -> None:
        """Add the hits ``(M, 2)`` (world, m) of the scan with this number, all of which must lie inside the grid."""
        cells = self.spec.world_to_cell(points_w)
        x, y = ((points_w - self.spec.cell_to_world(cells)) / self.spec.resolution).T
        flat, slots = self.slots.flat(cells), self.slots.block.reshape(-1)
        new = np.unique(flat[slots.take(flat) == 0])
        slots.put(new, self.used + np.arange(len(new)))
        self._make_room(self.used + len(new))
        self._first[self.used : self.used + len(new)] = scan
        self.used += len(new)
        rows = slots.take(flat)
        for column, values in zip(self._sums.T, (np.ones_like(x), x, y, x * x, x * y, y * y), strict=True):
            np.add.at(column, rows, values)

    def kept(self, points_w: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
        """Return what ``put_back`` needs after hits ``(M, 2)`` inside the grid are added."""
        flat = self.slots.flat(self.spec.world_to_cell(points_w))
        rows = self.slots.block.reshape(-1).take(flat)
        return self.used, rows, self._sums.take(rows, axis=0)

    def put_back(self, used: int, rows: np.ndarray, sums: np.ndarray) -> None:
        """Take back hits that were added since ``kept``; their cells' slots are put back by the map."""
        self._sums[used:], self._first[used:], self.used = 0.0, -1, used
        self._sums[rows] = sums

    def _make_room(self, rows: int) -> None:
        """Double the table until it has so many rows."""
        while rows > len(self._sums):
            self._sums = np.vstack([self._sums, np.zeros_like(self._sums)])
            self._first = np.append(self._first, np.full(len(self._first), -1))

    def first_scan(self, points_w: np.ndarray) -> np.ndarray:
        """Look up the scan ``(M,)`` that first hit the cell of each point inside the grid, -1 where none did."""
        flat = self.slots.flat(self.spec.world_to_cell(points_w))
        return self._first[self.slots.block.reshape(-1).take(flat)]

    def share_hit_before(self, scan: int, points_w: np.ndarray) -> float:
        """Return the share of the points ``(M, 2)`` in cells that were hit before the scan with this number."""
        inside = self.spec.contains(self.spec.world_to_cell(points_w))
        first = self.first_scan(points_w.compress(inside, axis=0))
        return float(np.count_nonzero((first >= 0) & (first < scan))) / max(len(points_w), 1)

    def around(self, cells: np.ndarray) -> np.ndarray:
        """Sum the moments ``(M, 6)`` of up to 3 x 3 cells about ``cells (M, 2)``, relative to the middle one's centre.

        Cells at the border, where neighbours are missing, have none.
        """
        height, width = self.spec.shape
        ix, iy = cells.T
        inside = (ix >= REACH) & (ix < width - REACH) & (iy >= REACH) & (iy < height - REACH)
        dx, dy, moved = _neighbourhood(REACH)
        # By flat index and `take`: the same numbers, three times as fast as indices for every axis.
        offsets = dy * self.slots.block.shape[1] + dx
        rows = self.slots.block.reshape(-1).take(self.slots.flat(cells)[:, None] + offsets, mode="clip")
        rows[~inside] = 0
        return self._sums.take(rows, axis=0).reshape(len(cells), len(moved)) @ moved


@lru_cache(maxsize=4)
def _neighbourhood(reach: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return offsets of the neighbours, and the matrix that sums their moments about the middle cell's centre."""
    dy, dx = (d.ravel() - reach for d in np.indices((2 * reach + 1, 2 * reach + 1)))
    return dx, dy, np.vstack([_moved(int(x), int(y)) for x, y in zip(dx, dy, strict=True)])


def _moved(dx: int, dy: int) -> np.ndarray:
    """Return the matrix ``(6, 6)`` that takes moments about a cell (dx, dy) away to the middle cell's centre."""
    moved = np.eye(6)
    moved[0] = [1, dx, dy, dx * dx, dx * dy, dy * dy]
    moved[1, 3:5] = 2 * dx, dy
    moved[2, 4:6] = dx, 2 * dy
    return moved


@dataclass(frozen=True, eq=False)
class Lines:
    """For each end point: whether there is a line near it, its centre ``(M, 2)`` (m) and unit normal ``(M, 2)``.

    ``trust (M,)`` from 0 to 1 says how straight the piece of wall is, compared with the others that this scan sees.
    """

    found: np.ndarray
    centre: np.ndarray
    normal: np.ndarray
    trust: np.ndarray


def nearby_lines(moments: HitMoments, points_w: np.ndarray, config: LineConfig) -> Lines:
    """Fit a line to the wall near each of the points ``(M, 2)``: principal axes of the hits in 3 x 3 cells."""
    cells = moments.spec.world_to_cell(points_w)
    n, x, y, xx, xy, yy = np.ascontiguousarray(moments.around(cells).T)
    enough = n >= config.min_hits
    n = np.where(enough, n, 1.0)
    x, y = x / n, y / n
    vxx, vxy, vyy = xx / n - x**2, xy / n - x * y, yy / n - y**2
    # Eigenvalues of a symmetric 2 x 2 matrix: half trace plus and minus a radius; the
    # long axis lies at `angle`.
    half_trace, radius = 0.5 * (vxx + vyy), np.hypot(0.5 * (vxx - vyy), vxy)
    angle = 0.5 * np.arctan2(2.0 * vxy, vxx - vyy)
    narrow = np.maximum(half_trace - radius, 0.0)
    elongation = (half_trace + radius) / (narrow + THICKNESS)
    found = enough & (elongation > config.elongation)
    # Rough or half-seen pieces show other faces as the robot moves on, and pull the pose
    # along: trust straight ones. What counts as straight depends on the LiDAR's noise, so
    # the scan's own median sets the scale.
    typical = _median(elongation[found]) if found.any() else 1.0
    trust = (elongation / (elongation + typical)) ** 2
    middle = np.column_stack([x, y]) * moments.spec.resolution
    normal = np.column_stack([-np.sin(angle), np.cos(angle)])
    return Lines(found, moments.spec.cell_to_world(cells) + middle, normal, trust)


def _median(values: np.ndarray) -> float:
    """Return what ``np.median`` does, in a quarter of its time for a few hundred numbers."""
    ordered, n = np.sort(values), len(values)
    return float(0.5 * (ordered[(n - 1) // 2] + ordered[n // 2]))


class LineFit(NamedTuple):
    """The beams on lines: distances ``(B,)`` (m), Jacobian ``(B, 3)``, weights ``(B,)``, end points ``(B, 2)`` (m)."""

    residual: np.ndarray
    jacobian: np.ndarray
    weight: np.ndarray
    points_w: np.ndarray


@dataclass(frozen=True, eq=False)
class Alignment:
    """An aligned pose ``(3,)``, and the direction ``(2,)`` that no line constrains, if there is one.

    ``fit`` is the last iteration's; None if there were too few beams on lines.
    """

    pose: np.ndarray
    silent_direction: np.ndarray | None
    fit: LineFit | None = None


def align_to_lines(
    moments: HitMoments,
    points_b: np.ndarray,
    pose: np.ndarray,
    odometry_pose: np.ndarray,
    config: LineConfig,
    variance: np.ndarray | None = None,
) -> Alignment:
    """Move ``pose (3,)`` so that the end points ``(M, 2)`` (body, m) lie on the lines of the map.

    Along a direction in which no line constrains it (the length of a bare corridor) the position is taken from
    ``odometry_pose (3,)``. Without at least three beams on lines the pose comes back as it was.

    With ``config.independent_beams`` odometry is weighed against the lines in every direction: the result maximises
    their likelihood times the normal density about ``odometry_pose`` with ``variance (2,)`` (m^2, rad^2) of the motion.
    """
    pose = np.array(pose, dtype=float)
    for _ in range(ITERATIONS):
        fit = line_residuals(moments, points_b, pose, config)
        residual, jacobian, weight, _ = fit
        # Lines many rho away leave weights that are zero in a computer too.
        if len(residual) < 3 or not weight.any():
            return Alignment(pose, None)
        if variance is None or not config.independent_beams:
            step = damped_step(residual, jacobian, weight)
        else:
            step = step_with_prior(residual, jacobian, weight, pose - odometry_pose, variance, config)
        pose += step
        if np.max(np.abs(step) / MAX_STEP) < 1e-3:
            break
    pose[2] = wrap_angle(pose[2])
    normal = jacobian[:, :2]
    information = (normal * weight[:, None]).T @ normal / np.sum(weight)
    share, directions = np.linalg.eigh(information)
    if share[0] >= DEGENERATE_BELOW:
        return Alignment(pose, None, fit)
    silent = directions[:, 0]
    if variance is None or not config.independent_beams:
        pose[:2] += silent * (silent @ (odometry_pose[:2] - pose[:2]))
    return Alignment(pose, silent, fit)


def line_residuals(
    moments: HitMoments, points_b: np.ndarray, pose: np.ndarray, config: LineConfig
) -> LineFit:
    """Measure the beams' distances (m) from their lines, with the Jacobian for x, y, theta, and weigh them."""
    arm = transform_points([0.0, 0.0, pose[2]], points_b)
    points_w = arm + pose[:2]
    lines = nearby_lines(moments, points_w, config)
    # By number and `take`: a mask over rows takes ten times as long.
    found = np.flatnonzero(lines.found)
    on_line = points_w.take(found, axis=0)
    (ax, ay), (nx, ny) = arm.take(found, axis=0).T, lines.normal.take(found, axis=0).T
    dx, dy = (on_line - lines.centre.take(found, axis=0)).T
    residual = nx * dx + ny * dy
    jacobian = np.column_stack([nx, ny, ny * ax - nx * ay])
    weight = lines.trust.take(found) * np.exp(-0.5 * (residual / RHO) ** 2)
    return LineFit(residual, jacobian, weight, on_line)


def step_with_prior(
    residual: np.ndarray,
    jacobian: np.ndarray,
    weight: np.ndarray,
    departure: np.ndarray,
    variance: np.ndarray,
    config: LineConfig,
) -> np.ndarray:
    """Correct a pose ``(3,)`` by one step towards the maximum of the lines' likelihood times odometry's density.

    Minimises k / s^2 sum w (r + J x)^2 + (d + x)^2 / variance over the step x, where d ``(3,)`` is the departure from
    odometry so far and s is ``LINE_SIGMA``: one iteration of an iterated Kalman update (Bell and Cathey, "The iterated
    Kalman filter update as a Gauss-Newton method", 1993). Beams on one wall share its errors, so together they count
    for ``independent_beams`` at most: k = min(1, independent_beams / sum w).
    """
    k = min(1.0, config.independent_beams / float(np.sum(weight))) / LINE_SIGMA**2
    # Without any noise the prior pins the pose to odometry, rather than dividing by zero.
    prior = 1.0 / np.maximum(variance[[0, 0, 1]], 1e-12)
    departure = np.array([departure[0], departure[1], wrap_angle(departure[2])])
    H = k * (jacobian.T @ (weight[:, None] * jacobian)) + np.diag(prior)
    step = -np.linalg.solve(H, k * (jacobian.T @ (weight * residual)) + prior * departure)
    return step * min(1.0, float(np.min(MAX_STEP / np.maximum(np.abs(step), 1e-12))))


def damped_step(residual: np.ndarray, jacobian: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Correct a pose ``(3,)`` by one damped step of weighted least squares, at most ``MAX_STEP`` long."""
    H = jacobian.T @ (weight[:, None] * jacobian)
    diagonal = H.reshape(-1)[::4]
    diagonal += 1e-3 * diagonal
    diagonal += 1e-9
    step = -np.linalg.solve(H, jacobian.T @ (weight * residual))
    return step * min(1.0, float(np.min(MAX_STEP / np.maximum(np.abs(step), 1e-12))))
