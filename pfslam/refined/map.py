"""The map of the accurate filter: an occupancy grid with a score field and wall moments, written together.

A scan is matched against what earlier scans have drawn, and then drawn itself. Both need the grid's cells, the field of
scores that follows from them, and the lines that the hits form, so one object holds all three and keeps them in step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np

from pfslam.correlation import Perturbations, best_perturbations
from pfslam.events import ScanEvent
from pfslam.grid import Canvas, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.map import Map
from pfslam.particles import Particles
from pfslam.poses import between, transform_points
from pfslam.refined.covariance import (
    aligned_covariance,
    predicted_covariance,
    transported,
    with_silent_direction,
)
from pfslam.refined.field import FIELD_REACH, NEAR, TOP, renew_field, score_field
from pfslam.refined.lines import BEAM_STRIDE, Alignment, HitMoments, LineConfig, align_to_lines
from pfslam.refined.matching import Match, SearchConfig, match
from pfslam.refined.outliers import (
    MOST_UNEXPLAINED,
    OutlierConfig,
    WaitingScan,
    beyond_gate,
    inliers,
    settle_hits,
)

E = TypeVar("E", bound=ScanEvent)
OLD = 20
"""A wall is an old one once so many scans have been drawn since the first that hit it: after a metre of way."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What odometry says before the scan is looked at.

    ``particles`` after their motion and ``pose (3,)`` of the estimate after it; ``variance (2,)`` of the motion (m^2,
    rad^2) since a scan was last matched. ``start (3,)`` and ``start_covariance`` are the estimate before the motion,
    ``corrected (2,)`` how far (m) scans had moved it lately.
    """

    particles: Particles
    pose: np.ndarray
    variance: np.ndarray
    start: np.ndarray
    start_covariance: np.ndarray | None
    corrected: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def covariance(self, pose: np.ndarray) -> np.ndarray | None:
        """Return the covariance ``(3, 3)`` of a pose that the motion alone led to; None where none is kept."""
        if self.start_covariance is None:
            return None
        return predicted_covariance(self.start_covariance, self.start, pose, self.variance)

    def corrected_by(self, pose: np.ndarray) -> np.ndarray:
        """Return how far ``(2,)`` (m) scans have moved the estimate lately, if ``pose (3,)`` is the next.

        A metre of way leaves a third of what came before it.
        """
        left = np.exp(-np.hypot(*(pose[:2] - self.start[:2])))
        return left * self.corrected + (pose[:2] - self.pose[:2])


@dataclass(frozen=True, eq=False)
class Fix:
    """One pose for the whole cloud: ``pose (3,)``, ``covariance (3, 3)`` or None, and the silent direction.

    Along ``silent_direction (2,)`` no line says anything; None where all directions are constrained. ``score`` is the
    mean score per beam there. ``aligned`` is False where too few beams lay on lines, or none were looked for.
    """

    pose: np.ndarray
    covariance: np.ndarray | None = None
    silent_direction: np.ndarray | None = None
    score: float = 0.0
    aligned: bool = False


class RefinedMap(Map):
    """One map, its settings, and what is needed to match scans against it, align a pose to it and draw into it.

    ``drawn_at (3,)`` is the pose of the last scan drawn, None while the map is empty. ``drawn`` holds the covariance of
    every scan drawn (see ``refined.covariance``), ``waiting`` the last scans whose hits are being confirmed.
    """

    def __init__(
        self,
        config: MapConfig,
        spec: GridSpec | None = None,
        lines: LineConfig | None = None,
        outliers: OutlierConfig | None = None,
    ):
        self.lines, self.outliers = lines, outliers
        self.drawn_at: np.ndarray | None = None
        self.drawn: list[np.ndarray] = []
        self.waiting: tuple[WaitingScan, ...] = ()
        self.undo: Callable[[], None] | None = None
        super().__init__(config, spec)

    @classmethod
    def known(cls, grid: OccupancyGrid, config: MapConfig) -> RefinedMap:
        """Make a map from a grid that is there already, such as one read from a file."""
        made = cls(config, grid.spec)
        made.grid.log_odds[:], made.field[:] = grid.log_odds, score_field(grid.occupied)
        made.drawn_at, made.is_empty = np.zeros(3), False
        return made

    def lay_out(self, spec: GridSpec) -> None:
        """Begin anew, with nothing known of any cell of the grid."""
        super().lay_out(spec)
        self._scores, self.moments = Canvas(spec, np.float32), HitMoments(spec)

    def canvases(self) -> Iterator[Canvas]:
        """Yield the layers of the map, which grow together."""
        yield from super().canvases()
        yield self._scores
        yield self.moments.slots

    @property
    def field(self) -> np.ndarray:
        """The likelihood field ``(H, W)`` that belongs to the grid."""
        return self._scores.values

    def copy(self) -> RefinedMap:
        """Return a map of its own that holds the same and is not written by this one's run."""
        other = RefinedMap.__new__(RefinedMap)
        other.__dict__.update(self.__dict__)
        other._log_odds, other._scores = self._log_odds.copy(), self._scores.copy()
        other.moments, other.drawn, other.undo = self.moments.copy(), list(self.drawn), None
        return other

    def inliers(self, event: E, pose: np.ndarray, at_least: int) -> E:
        """Leave out the beams that contradict the map, seen from ``pose (3,)``, unless few would be left."""
        if self.outliers is None:
            return event
        points_w = transform_points(pose, event.points_b)
        known = inliers(self.grid, self.field, points_w, self.config.free, self.outliers)
        if np.count_nonzero(known) < at_least:
            return event
        return replace(event, points_b=event.points_b[known], beams=event.beams[known])

    def match(
        self, event: ScanEvent, prior: Prior, search: SearchConfig | Perturbations, rng: np.random.Generator
    ) -> Match:
        """Score a scan at every perturbation of every particle, and move each to its best one (Eq. 6, 8, 9).

        The motion's variance sets how far is searched, but for the report's search (``Perturbations``), which draws
        among equals.
        """
        if isinstance(search, Perturbations):
            found = best_perturbations(self.grid, event.points_b, prior.particles, search, rng)
            return Match(found.particles.poses, found.log_likelihood, found.score)
        points, sigmas = event.points_b[:: search.beam_stride], np.sqrt(prior.variance)
        return match(self.field, self.spec, points, prior.particles.poses, sigmas, search)

    def align(self, event: ScanEvent, pose: np.ndarray, prior: Prior) -> Fix:
        """Align a pose ``(3,)`` to the lines that the map's hits form, if the map has settings for lines."""
        if self.lines is None:
            return Fix(pose, score=self.score(event, pose))
        points = event.points_b[::BEAM_STRIDE]
        fit = align_to_lines(self.moments, points, pose, prior.pose, self.lines, prior.variance)
        score, covariance = self.score(event, fit.pose), self._covariance(fit, prior)
        return Fix(fit.pose, covariance, fit.silent_direction, score, fit.fit is not None)

    def _covariance(self, found: Alignment, prior: Prior) -> np.ndarray | None:
        predicted = prior.covariance(found.pose)
        if predicted is None or found.fit is None:
            return predicted
        covariance = aligned_covariance(self.drawn, self.moments, found.pose, found.fit, prior.variance)
        if found.silent_direction is None:
            return covariance
        return with_silent_direction(covariance, found.silent_direction, predicted)

    def within_gate(self, event: ScanEvent, pose: np.ndarray, prior: Prior) -> bool:
        """Whether a matched pose lies within the gate about odometry, or leaves few beams unexplained."""
        if self.outliers is None or not beyond_gate(pose - prior.pose, prior.variance, self.outliers.gate):
            return True
        return self.unexplained(event, pose) <= MOST_UNEXPLAINED

    def unexplained(self, event: ScanEvent, pose: np.ndarray) -> float:
        """Return the share of beams that end in ground the map knows, but more than two cells from its walls."""
        cells = self.spec.world_to_cell(transform_points(pose, event.points_b))
        ix, iy = cells.compress(self.spec.contains(cells), axis=0).T
        known = self.grid.log_odds[iy, ix] != 0.0
        far = self.field[iy, ix] < NEAR
        return float(np.count_nonzero(known & far)) / max(int(np.count_nonzero(known)), 1)

    def score(self, event: ScanEvent, pose: np.ndarray) -> float:
        """Return the mean score per beam, from 0 to 1, of a scan seen from ``pose (3,)``; 0 outside the map."""
        cells = self.spec.world_to_cell(transform_points(pose, event.points_b))
        ix, iy = cells.compress(self.spec.contains(cells), axis=0).T
        return float(self.field[iy, ix].sum()) / (TOP * max(len(cells), 1))

    def on_old_walls(self, event: ScanEvent, pose: np.ndarray) -> float:
        """Return the share of beams that end on walls which scans had hit long before, seen from ``pose (3,)``."""
        points_w = transform_points(pose, event.points_b)
        return self.moments.share_hit_before(len(self.drawn) - OLD, points_w)

    def has_moved(self, pose: np.ndarray, metres: float, radians: float) -> bool:
        """Whether ``pose (3,)`` lies at least so many metres, or radians, from where the last scan was drawn."""
        motion = between(self.drawn_at, pose)
        return bool(np.hypot(*motion[:2]) >= metres or abs(motion[2]) >= radians)

    def draw(self, event: ScanEvent, pose: np.ndarray, covariance: np.ndarray | None = None) -> None:
        """Write a scan into grid, score field and wall moments, seen from ``pose (3,)`` (Eq. 14, 15).

        ``covariance (3, 3)`` is the pose's, None where none is kept. After an exception of any kind nothing is drawn.
        Afterwards ``undo()`` takes the scan back.
        """
        undo: Callable[[], None] = partial(self.shrink_to, self.spec)
        former = self.undo
        try:
            points_w, sensor_w = self.make_room(event, pose)
            scan, hits, waiting = (points_w, event.beams, sensor_w), None, self.waiting
            if self.outliers is not None and not self.is_empty:
                hits, waiting = settle_hits(self.waiting, self.spec, *scan, self.config, self.outliers)
            ends = points_w if hits is None else hits
            self.undo = undo = self._taking_back(np.vstack([points_w, sensor_w, ends]), ends, undo)
            if hits is None:
                rectangle = integrate_scan(self.grid, *scan, self.config)
            else:
                rectangle = integrate_hits(self.grid, *scan, hits, self.config)
            renew_field(self.field, self.grid.log_odds, rectangle)
            if self.lines is not None:
                self.moments.add(ends, len(self.drawn))
            if covariance is not None:
                # At the world's origin it is the error of all that the scan has drawn.
                self.drawn.append(transported(covariance, -pose[:2]))
            self.waiting, self.drawn_at, self.is_empty = waiting, pose, False
        except BaseException:
            undo()
            self.undo = former
            raise

    def shrink_to(self, spec: GridSpec) -> None:
        """Go back to a former grid, which holds all that is drawn."""
        if self.is_empty:
            self.lay_out(spec)
        else:
            for canvas in self.canvases():
                canvas.cover(spec)

    def _taking_back(
        self, points_w: np.ndarray, hits: np.ndarray, shrink: Callable[[], None]
    ) -> Callable[[], None]:
        """Return what puts the map back as it is now, and then shrinks it, once a scan is drawn.

        ``points_w (M, 2)`` are all that it touches, ``hits (H, 2)`` those of them that become walls.
        """
        cells = self.spec.world_to_cell(points_w)
        (left, below), (right, above) = cells.min(axis=0) - FIELD_REACH, cells.max(axis=0) + FIELD_REACH + 1
        part = np.s_[max(below, 0) : above, max(left, 0) : right]
        values = [canvas.values[part].copy() for canvas in self.canvases()]
        moments, drawn = self.moments.kept(hits), len(self.drawn)
        state = self.waiting, self.drawn_at, self.is_empty

        def undo() -> None:
            for canvas, before in zip(self.canvases(), values, strict=True):
                canvas.values[part] = before
            self.moments.put_back(*moments)
            del self.drawn[drawn:]
            self.waiting, self.drawn_at, self.is_empty = state
            shrink()

        return undo


def integrate_hits(
    grid: OccupancyGrid,
    points_w: np.ndarray,
    beams: np.ndarray,
    sensor_w: np.ndarray,
    hits: np.ndarray,
    config: MapConfig,
) -> tuple[slice, slice]:
    """Write a scan into the map as ``grid.integrate_scan`` does, but with ``hits (H, 2)`` in place of its end points.

    What the scan saw through is free, its own end points stay as they were.
    """
    rows, columns = integrate_scan(grid, points_w, beams, sensor_w, replace(config, hit=0.0))
    if len(hits) == 0:
        return rows, columns
    ix, iy = grid.spec.world_to_cell(hits).T
    grid.log_odds[iy, ix] = np.minimum(grid.log_odds[iy, ix] + np.float32(config.hit), config.clamp)
    return (
        slice(min(rows.start, iy.min()), max(rows.stop, iy.max() + 1)),
        slice(min(columns.start, ix.min()), max(columns.stop, ix.max() + 1)),
    )
