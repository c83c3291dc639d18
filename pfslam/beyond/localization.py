"""Where in a known map? Monte Carlo localization: the map is given, and the pose is searched in all of it.

The particles begin everywhere. Those that a scan contradicts die out, and their number follows the room that the cloud
takes (Fox, KLD sampling). Where scans fit worse than they used to, some particles are drawn anew from the whole map:
that finds a robot which was carried away (augmented MCL, "Probabilistic Robotics", 8.3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Annotated

import cv2
import numpy as np

from pfslam.errors import DataError
from pfslam.events import ScanEvent
from pfslam.grid import OccupancyGrid
from pfslam.particles import (
    MAX_PARTICLES,
    Particles,
    effective_sample_size,
    reweight,
    systematic_resample,
)
from pfslam.poses import Trajectory, average_pose, compose, transform_points, wrap_angle
from pfslam.recording import Recording
from pfslam.refined.events import LevelledScans
from pfslam.refined.noise import MotionNoise, predicted
from pfslam.settings import Range, Settings
from pfslam.slam import MAX_EVERY

EPSILON, DELTA = 0.05, 0.01
"""Largest Kullback-Leibler distance from the cloud to what it stands for, and the probability of exceeding it."""
BIN = (0.5, 0.5, np.deg2rad(10.0))
"""Size (m, m, rad) of the bins that the cloud's extent is counted in: Fox's own."""
BEAMS = 60
"""About how many beams of a scan are scored: more say little that is new."""
SLOW, FAST, EXPECTED = 0.01, 0.2, 0.9
"""Rates of the two averages of the fit, and the fit of a right pose.

The slow average starts at that, so that particles keep coming until one explains the scan.
"""
RESAMPLE_BELOW = 0.5
"""Resample when N_eff is at most this share of N, or when particles are to be injected."""
STEP_METRES, STEP_RADIANS = 0.1, 0.1
"""A scan is used after moving or turning by at least this much: scans from one place say the same."""
NEAR_METRES, NEAR_RADIANS = 1.0, 0.5
"""A particle counts for the estimate if it lies no farther from it than this."""
EXPLAINED_METRES, EXPLAINED_SHARE = 0.1, 0.9
"""A beam is explained if a wall is so near its end (m), and a place is believed if that share is, along the path.

In three halls that had changed (people, other doors, glass, a map good to 4 cm) 91 to 92 % were, but only 88 to 91 %
in the last ten seconds alone. In wrong buildings the cloud often agrees on one place, too. There 54 to 83 % were, and
90 % in one of long corridors, where the cloud parted again.
"""
AT_ONCE = 10_000
"""Particles that are scored together; more would only take memory."""
Count = Annotated[int, Range(1, MAX_PARTICLES)]


@dataclass(frozen=True)
class LocalizationConfig(Settings):
    """The settings of a search for the pose in a known map."""

    first: Annotated[int, Range(1, 10 * MAX_PARTICLES)] = 100_000
    """Particles for the first scan, spread over the map: every place that may be right needs a few from the start."""
    particles: Count = 10_000
    """The most there will be afterwards."""
    least: Count = 500
    """The fewest particles that adaptive resampling leaves."""
    sigma: Annotated[float, Range(1e-3, 1e3)] = 0.2
    """Distance (m) from a wall at which an end point's likelihood has fallen to exp(-1/2)."""
    random: Annotated[float, Range(1e-6, 1.0)] = 0.1
    """Likelihood of an end point that no wall explains; 1 on a wall."""
    effective_beams: Annotated[float, Range(1e-3, 1e4)] = 5.0
    """How many independent beams a scan is worth: neighbours see the same wall, so their errors are shared."""
    inject: bool = True
    """Whether some particles are drawn anew from the whole map where scans fit worse than they should."""
    found: Annotated[float, Range(0.0, 1.0)] = 0.95
    """The pose counts as found when this share of the weight lies near the estimate."""
    noise: MotionNoise = field(default_factory=MotionNoise)
    every: Annotated[int, Range(1, MAX_EVERY)] | None = None
    """Every how-many-th scan is looked at; None takes the recording's own default."""

    def __post_init__(self):
        super().__post_init__()
        if self.least > self.particles:
            expected = f"at most particles, {self.particles}"
            raise DataError("LocalizationConfig", "least", self.least, expected)


def kld_bound(bins, epsilon: float = EPSILON, delta: float = DELTA):
    """Return how many particles a cloud over ``bins`` bins needs, by Fox's bound ("Adapting the sample size", 2003).

    That many draws keep the Kullback-Leibler distance to the true distribution below ``epsilon`` with probability
    1 - ``delta``: the chi-square quantile with bins - 1 degrees of freedom, divided by 2 epsilon, with that quantile
    by Wilson and Hilferty's cube. ``bins`` is a number or an array; one bin needs one particle.

    >>> round(float(kld_bound(100, epsilon=0.05, delta=0.01)))
    1347
    """
    k = np.maximum(np.asarray(bins, dtype=float) - 1.0, 1.0)
    z, a = NormalDist().inv_cdf(1.0 - delta), 2.0 / (9.0 * k)
    return np.where(np.asarray(bins) > 1, k / (2.0 * epsilon) * (1.0 - a + np.sqrt(a) * z) ** 3, 1.0)[()]


def spread(grid: OccupancyGrid, n: int, rng: np.random.Generator) -> np.ndarray:
    """Draw ``n`` poses ``(n, 3)`` evenly over the free cells of a map and over all headings."""
    free = np.flatnonzero(grid.free)
    if len(free) == 0:
        raise DataError("map", "free cells", "none", "a map that says where the robot can be")
    iy, ix = np.divmod(rng.choice(free, n), grid.spec.shape[1])
    corner = np.column_stack([ix, iy]) * grid.spec.resolution + grid.spec.origin
    position = corner + rng.uniform(0.0, grid.spec.resolution, (n, 2))
    return np.column_stack([position, rng.uniform(-np.pi, np.pi, n)])


def likelihood_field(grid: OccupancyGrid, config: LocalizationConfig) -> np.ndarray:
    """Compute the log-likelihood ``(H, W)`` float32 of an end point in each cell, from its distance to a wall.

    log(random + (1 - random) exp(-d^2 / 2 sigma^2)): the likelihood field of ``correlation``, as wide as a robot needs
    that does not know where it is, and with a floor, so that no single beam can rule a pose out.
    """
    if not grid.occupied.any():
        raise DataError("map", "occupied cells", "none", "a map with walls, or no scan says anything")
    away = cv2.distanceTransform((~grid.occupied).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # Squared distances are whole numbers (cells squared): rounded to them, every run has the same field.
    scale = grid.spec.resolution / config.sigma
    reach = int(np.ceil(6.0 / scale))
    squared = np.rint(np.square(np.minimum(away, reach))).astype(np.int32)
    near = np.exp(-0.5 * np.arange(reach**2 + 1) * scale**2)
    return np.log(config.random + (1.0 - config.random) * near).astype(np.float32)[squared]


@dataclass(frozen=True, eq=False)
class KnownMap:
    """A map, and what is computed from it once: ``field (H, W)`` float32 (see ``likelihood_field``)."""

    grid: OccupancyGrid
    field: np.ndarray
    config: LocalizationConfig

    @classmethod
    def of(cls, grid: OccupancyGrid, config: LocalizationConfig) -> KnownMap:
        """Prepare a map for the settings of a search."""
        return cls(grid, likelihood_field(grid, config), config)

    def log_likelihood(self, poses: np.ndarray, points_b: np.ndarray) -> np.ndarray:
        """Compute the log-likelihood ``(N,)`` of a scan with end points ``(M, 2)`` from each of the poses ``(N, 3)``.

        The mean over about ``BEAMS`` end points times ``effective_beams``. End points outside the map are unexplained,
        and so are all of them for a robot that would stand on a cell which is not free.
        """
        points = points_b[:: max(len(points_b) // BEAMS, 1)]
        parts = np.array_split(poses, -(-len(poses) // AT_ONCE))
        mean = np.concatenate([self._fits(transform_points(part, points)).mean(axis=1) for part in parts])
        stands = self._at(poses[:, :2], self.grid.free, outside=False)
        return self.config.effective_beams * np.where(stands, mean, np.log(self.config.random))

    def explained(self, pose: np.ndarray, points_b: np.ndarray) -> float:
        """Return the share of a scan's end points ``(M, 2)`` that lie near a wall of the map, from a pose ``(3,)``."""
        near = np.exp(-0.5 * (EXPLAINED_METRES / self.config.sigma) ** 2)
        least = np.log(self.config.random + (1.0 - self.config.random) * near)
        return float((self._fits(transform_points(pose, points_b)) >= least - 1e-6).mean())

    def _fits(self, points_w: np.ndarray) -> np.ndarray:
        """Look up the field at points ``(..., 2)``; outside the map nothing explains them."""
        return self._at(points_w, self.field, outside=np.log(self.config.random))

    def _at(self, points_w: np.ndarray, layer: np.ndarray, outside) -> np.ndarray:
        cells = self.grid.spec.world_to_cell(points_w)
        inside = self.grid.spec.contains(cells)
        values = np.full(inside.shape, outside)
        values[inside] = layer[tuple(cells[inside].T[::-1])]
        return values


@dataclass(frozen=True, eq=False)
class LocalizationState:
    """What the next step needs: the particles, the two averages of the fit, and the motion ``(3,)`` since a scan."""

    particles: Particles
    slow: float | None = None
    fast: float | None = None
    pending: np.ndarray | None = None
    """All three are None before the first scan, which is used wherever the robot stands."""


@dataclass(frozen=True, eq=False)
class LocalizationInfo:
    """What happened at one scan.

    ``estimate (3,)`` is the mean of the particles around the densest place of the cloud, ``share`` their part of the
    weight; ``particles`` the cloud before resampling, None where it was not kept. ``fit`` is the mean likelihood of a
    beam, from ``random`` to 1, and ``injected`` the share of particles that were drawn anew from the whole map.
    ``explained`` is the share of the beams that end near a wall of the map, seen from the estimate.
    """

    t: float
    estimate: np.ndarray
    share: float
    particles: Particles | None
    number: int
    used: bool = True
    fit: float = 0.0
    injected: float = 0.0
    explained: float = 0.0


def localization_step(
    state: LocalizationState, event: ScanEvent, known: KnownMap, rng: np.random.Generator
) -> tuple[LocalizationState, LocalizationInfo]:
    """Process one scan: predict, reweight, estimate, and resample as many particles as the cloud's extent asks for."""
    config, before, pending = known.config, state.particles, state.pending
    motion = event.motion if pending is None else compose(pending, event.motion)
    moved = np.hypot(*motion[:2]) >= STEP_METRES or abs(motion[2]) >= STEP_RADIANS
    if len(event.points_b) == 0 or not (moved or pending is None):
        ahead = Particles(compose(before.poses, motion), before.log_weights)
        info = LocalizationInfo(event.t, *densest(ahead), ahead, len(ahead), used=False)
        return replace(state, pending=motion), info
    particles, _ = predicted(before, replace(event, motion=motion), config.noise, rng)
    particles, evidence = reweight(particles, known.log_likelihood(particles.poses, event.points_b))
    fit = float(np.exp(evidence / config.effective_beams))
    slow = EXPECTED if state.slow is None else state.slow + SLOW * (fit - state.slow)
    fast = fit if state.fast is None else state.fast + FAST * (fit - state.fast)
    share = injected_share(slow, fast) if config.inject else 0.0
    pose, near = densest(particles)
    explained = known.explained(pose, event.points_b)
    info = LocalizationInfo(event.t, pose, near, particles, len(particles), True, fit, share, explained)
    if share or effective_sample_size(particles.weights) <= RESAMPLE_BELOW * len(particles):
        particles = resample_adaptively(particles, share, known.grid, config, rng)
    return LocalizationState(particles, slow, fast, np.zeros(3)), info


def injected_share(slow: float, fast: float) -> float:
    """Return the share of particles to draw anew: 1 - fast / slow, and none while scans fit as well as ever.

    >>> injected_share(slow=0.8, fast=0.4), injected_share(slow=0.8, fast=0.9)
    (0.5, 0.0)
    """
    return max(0.0, 1.0 - fast / slow) if slow > 0.0 else 0.0


def resample_adaptively(
    particles: Particles, share: float, grid: OccupancyGrid, config: LocalizationConfig, rng
) -> Particles:
    """Resample as many particles as Fox's bound asks for; a ``share`` of them is spread over the whole map."""
    n = enough(rng.permutation(_drawn(particles, share, config.particles, grid, rng)), config.least)
    return Particles(_drawn(particles, share, n, grid, rng), np.zeros(n))


def enough(poses: np.ndarray, least: int) -> int:
    """Count how many of the poses ``(N, 3)``, taken in order, meet Fox's bound for the bins that they lie in."""
    first = np.unique(_bins(poses), return_index=True)[1]
    occupied = np.cumsum(np.bincount(first, minlength=len(poses)))
    reached = np.arange(1, len(poses) + 1) >= np.maximum(kld_bound(occupied), least)
    return int(np.argmax(reached)) + 1 if reached.any() else len(poses)


def _drawn(particles: Particles, share: float, n: int, grid: OccupancyGrid, rng) -> np.ndarray:
    """Draw ``n`` poses: a share from the whole map, the others by weight, systematically."""
    fresh = int(rng.binomial(n, share))
    kept = systematic_resample(particles.weights, rng, n - fresh)
    return np.concatenate([particles.poses[kept], spread(grid, fresh, rng)])


def _bins(poses: np.ndarray) -> np.ndarray:
    """Number the bins ``(N,)`` that poses ``(N, 3)`` lie in."""
    cells = np.floor(poses / BIN).astype(np.int64)
    cells -= cells.min(axis=0)
    return np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))


def densest(particles: Particles) -> tuple[np.ndarray, float]:
    """Find the pose ``(3,)`` around which the cloud is densest, and the share of the weight that lies near it."""
    _, place = np.unique(_bins(particles.poses), return_inverse=True)
    weights = particles.weights
    heaviest = place == np.argmax(np.bincount(place, weights))
    centre = average_pose(particles.poses[heaviest], weights[heaviest])
    for _ in range(2):  # the heaviest bin may hold only one side of its cluster
        offset = particles.poses - centre
        near = np.hypot(*offset[:, :2].T) <= NEAR_METRES
        near &= np.abs(wrap_angle(offset[:, 2])) <= NEAR_RADIANS
        centre = average_pose(particles.poses[near], weights[near]) if near.any() else centre
    return centre, float(weights[near].sum())


@dataclass(frozen=True, eq=False)
class LocalizationResult:
    """A finished search: the estimate as it was at each scan (never revised), and one info per scan."""

    trajectory: Trajectory
    infos: tuple[LocalizationInfo, ...]
    config: LocalizationConfig
    dropped: dict[str, int]

    @property
    def located(self) -> np.ndarray:
        """At which scans ``(K,)`` the pose counts as found: enough of the weight lies near the estimate."""
        return np.array([info.share >= self.config.found for info in self.infos])

    @property
    def explained(self) -> float:
        """The share of the beams that the map has explained since the pose was found; 0 if it never was."""
        since = np.inf if self.found_at is None else self.found_at
        return float(np.mean([info.explained for info in self.infos if info.used and info.t >= since] or 0.0))

    @property
    def found(self) -> bool:
        """Whether the cloud agrees on one place in the end, and the map explains most of what was seen on the way."""
        return bool(self.located[-1] and self.explained >= EXPLAINED_SHARE)

    @property
    def found_at(self) -> float | None:
        """The time (s, data's clock) at which the pose first counts as found; None if it never does."""
        return float(self.trajectory.t[np.argmax(self.located)]) if self.located.any() else None


def locate(
    grid: OccupancyGrid,
    recording: Recording,
    config: LocalizationConfig | None = None,
    *,
    rng: np.random.Generator | None = None,
    start: Particles | None = None,
    progress: Callable | None = None,
    keep_particles: bool = True,
) -> LocalizationResult:
    """Find a robot in a known map, from nothing but what it measures as it drives.

    ``rng=None`` is seed 0. ``start`` takes the place of particles spread over the whole map. Poses are in the map's
    frame. Without ``keep_particles`` the infos hold no clouds; ``progress`` may wrap the loop, as tqdm does.
    """
    config = LocalizationConfig() if config is None else config
    rng = np.random.default_rng(0) if rng is None else rng
    scans = LevelledScans.of(recording, config.every)
    known = KnownMap.of(grid, config)
    start = start or Particles(spread(grid, config.first, rng), np.zeros(config.first))
    state, infos = LocalizationState(start), []
    for event in progress(scans.events(), total=len(scans)) if progress else scans.events():
        state, info = localization_step(state, event, known, rng)
        infos.append(info if keep_particles else replace(info, particles=None))
    t, poses = zip(*((info.t, info.estimate) for info in infos), strict=True)
    return LocalizationResult(Trajectory(np.array(t), np.array(poses)), tuple(infos), config, scans.dropped)
