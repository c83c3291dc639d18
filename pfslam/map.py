"""The map that a run draws into: occupancy grid, score field and wall moments, owned and written together.

A scan is matched against what earlier scans have drawn, and then drawn itself. Both need the grid's cells, the field of
scores that follows from them, and the lines that the hits form, so one object holds all three and keeps them in step.
It is written in place: what a step costs does not grow with the map. Who wants to keep a map says ``copy()``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pfslam.correlation import NEAR, ScoreField, renew_field, score_field
from pfslam.events import ScanEvent
from pfslam.grid import Canvas, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.particles import Particles
from pfslam.poses import between, transform_points
from pfslam.refined.covariance import (
    aligned_covariance,
    predicted_covariance,
    transported,
    with_silent_direction,
)
from pfslam.refined.lines import BEAM_STRIDE, Alignment, HitMoments, LineConfig, align_to_lines
from pfslam.refined.outliers import (
    MOST_UNEXPLAINED,
    OutlierConfig,
    WaitingScan,
    beyond_gate,
    inliers,
    settle_hits,
)
from pfslam.refined.search.matching import Match, SearchConfig, match

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

    ``free_direction (2,)`` is the one along which no line says anything, None where all are constrained. ``score`` is
    the mean score per beam there.
    """

    pose: np.ndarray
    covariance: np.ndarray | None = None
    free_direction: np.ndarray | None = None
    score: float = 0.0


class Map:
    """One map, its settings, and what is needed to match scans against it, align a pose to it and draw into it.

    ``drawn_at (3,)`` is the pose of the last scan drawn, None while the map is empty. ``drawn`` holds the covariance of
    every scan drawn (see ``refined.covariance``), ``waiting`` the last scans whose hits are being confirmed.
    """

    def __init__(
        self,
        spec: GridSpec,
        config: MapConfig,
        kind: str = "occupied",
        lines: LineConfig | None = None,
        outliers: OutlierConfig | None = None,
    ):
        self.config, self.lines, self.outliers = config, lines, outliers
        self._log_odds, self._scores, self.kind = Canvas(spec, np.float32), Canvas(spec, np.float32), kind
        self.moments = HitMoments(spec)
        self.drawn_at: np.ndarray | None = None
        self.drawn: list[np.ndarray] = []
        self.waiting: tuple[WaitingScan, ...] = ()

    @classmethod
    def known(cls, grid: OccupancyGrid, config: MapConfig, kind: str) -> Map:
        """Make a map from a grid that is there already, such as one read from a file."""
        made = cls(grid.spec, config, kind)
        made.grid.log_odds[:] = grid.log_odds
        made.field.values[:] = score_field(grid.occupied, kind).values
        made.drawn_at = np.zeros(3)
        return made

    @property
    def is_empty(self) -> bool:
        """Whether no scan has been drawn yet."""
        return self.drawn_at is None

    @property
    def spec(self) -> GridSpec:
        """Where the map lies."""
        return self._log_odds.spec

    @property
    def grid(self) -> OccupancyGrid:
        """The occupancy grid, which goes on changing as scans are drawn."""
        return OccupancyGrid(self.spec, self._log_odds.values)

    @property
    def field(self) -> ScoreField:
        """The field of scores that belongs to the grid."""
        return ScoreField(self._scores.values, self.kind)

    def copy(self) -> Map:
        """Return a map of its own that holds the same and is not written by this one's run."""
        other = Map.__new__(Map)
        other.__dict__.update(self.__dict__)
        other._log_odds, other._scores = self._log_odds.copy(), self._scores.copy()
        other.moments, other.drawn = self.moments.copy(), list(self.drawn)
        return other

    def inliers(self, event: ScanEvent, pose: np.ndarray, at_least: int) -> ScanEvent:
        """Leave out the beams that contradict the map, seen from ``pose (3,)``, unless few would be left."""
        if self.outliers is None:
            return event
        points_w = transform_points(pose, event.points_b)
        known = inliers(self.grid, self.field, points_w, self.config.free, self.outliers)
        if np.count_nonzero(known) < at_least:
            return event
        return replace(event, points_b=event.points_b[known], beams=event.beams[known])

    def match(self, event: ScanEvent, prior: Prior, search: SearchConfig, rng: np.random.Generator) -> Match:
        """Score a scan at every perturbation of every particle, and move each to its best one (Eq. 6, 8, 9).

        The motion's variance sets how far is searched.
        """
        points = event.points_b[:: search.beam_stride]
        poses, sigmas = prior.particles.poses, np.sqrt(prior.variance)
        return match(self.field, self.spec, points, poses, sigmas, search, rng)

    def align(self, event: ScanEvent, pose: np.ndarray, prior: Prior) -> Fix:
        """Align a pose ``(3,)`` to the lines that the map's hits form, if the map has settings for lines."""
        if self.lines is None:
            return Fix(pose, score=self.score(event, pose))
        points = event.points_b[::BEAM_STRIDE]
        fit = align_to_lines(self.moments, points, pose, prior.pose, self.lines, prior.variance)
        return Fix(fit.pose, self._covariance(fit, prior), fit.free_direction, self.score(event, fit.pose))

    def _covariance(self, found: Alignment, prior: Prior) -> np.ndarray | None:
        predicted = prior.covariance(found.pose)
        if predicted is None or found.fit is None:
            return predicted
        covariance = aligned_covariance(self.drawn, self.moments, found.pose, found.fit, prior.variance)
        if found.free_direction is None:
            return covariance
        return with_silent_direction(covariance, found.free_direction, predicted)

    def within_gate(self, event: ScanEvent, pose: np.ndarray, prior: Prior) -> bool:
        """Whether a matched pose lies within the gate about odometry, or leaves few beams unexplained."""
        if self.outliers is None or not beyond_gate(pose - prior.pose, prior.variance, self.outliers.gate):
            return True
        return self.unexplained(event, pose) <= MOST_UNEXPLAINED

    def unexplained(self, event: ScanEvent, pose: np.ndarray) -> float:
        """Return the share of beams that end in ground the map knows, but farther than ``NEAR`` from its walls."""
        cells = self.spec.world_to_cell(transform_points(pose, event.points_b))
        ix, iy = cells.compress(self.spec.contains(cells), axis=0).T
        known = self.grid.log_odds[iy, ix] != 0.0
        far = self.field.values[iy, ix] < NEAR[self.kind]
        return float(np.count_nonzero(known & far)) / max(int(np.count_nonzero(known)), 1)

    def score(self, event: ScanEvent, pose: np.ndarray) -> float:
        """Return the mean score per beam, from 0 to 1, of a scan seen from ``pose (3,)``; 0 outside the map."""
        cells = self.spec.world_to_cell(transform_points(pose, event.points_b))
        ix, iy = cells.compress(self.spec.contains(cells), axis=0).T
        return float(self.field.values[iy, ix].sum()) / (self.field.top * max(len(cells), 1))

    def on_old_walls(self, event: ScanEvent, pose: np.ndarray) -> float:
        """Return the share of beams that end on walls which scans had hit long before, seen from ``pose (3,)``."""
        points_w = transform_points(pose, event.points_b)
        return self.moments.share_hit_before(len(self.drawn) - OLD, points_w)

    def has_moved(self, pose: np.ndarray, metres: float, radians: float) -> bool:
        """Whether ``pose (3,)`` lies at least so many metres, or radians, from where the last scan was drawn."""
        motion = between(self.drawn_at, pose)
        return bool(np.hypot(*motion[:2]) >= metres or abs(motion[2]) >= radians)

    def draw(self, event: ScanEvent, fix: Fix) -> None:
        """Write the scan into grid, score field and wall moments, from the pose that it was fixed at (Eq. 14, 15)."""
        points_w = transform_points(fix.pose, event.points_b)
        sensor_w = transform_points(fix.pose, event.sensor_b[None])
        self._cover(np.concatenate([points_w, sensor_w]))
        scan, hits = (points_w, event.beams, sensor_w[0]), None
        if self.outliers is not None and not self.is_empty:
            hits, self.waiting = settle_hits(self.waiting, self.spec, *scan, self.config, self.outliers)
        rectangle = integrate_scan(self.grid, *scan, self.config, hits)
        renew_field(self.field, self.grid.log_odds, rectangle)
        if self.lines is not None:
            self.moments.add(points_w if hits is None else hits, len(self.drawn))
        if fix.covariance is not None:
            # At the world's origin it is the error of all that the scan has drawn.
            self.drawn.append(transported(fix.covariance, -fix.pose[:2]))
        self.drawn_at = fix.pose

    def _cover(self, points_w: np.ndarray) -> None:
        """Grow to cover the points ``(M, 2)``, one array after the other: only one has its old block beside it."""
        spec = self.spec.covering(points_w)
        if spec != self.spec:
            for canvas in (self._log_odds, self._scores, self.moments.slots):
                canvas.cover(spec)
