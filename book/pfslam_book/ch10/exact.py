"""Chapter 10: the exact answer on a map so small that every pose can be tried: a histogram filter beside the cloud."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from pfslam.beyond.localization import (
    KnownMap,
    LocalizationConfig,
    LocalizationState,
    localization_step,
    spread,
)
from pfslam.events import ScanEvent
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.particles import MotionNoise, Particles
from pfslam.poses import between, compose, wrap_angle

ROOM, PILLAR = (-1.5, -1.0, 1.5, 1.0), (0.6, 0.3, 1.1, 0.7)
PATH = np.array([[-1.0, -0.5, 0.0], [-0.6, -0.5, 0.0], [-0.2, -0.5, 0.2], [0.2, -0.4, 0.4]])
PLACE, HEADINGS = 0.2, 24
SIGMA_XY, SIGMA_YAW = 0.15, 0.2
CONFIG = LocalizationConfig(
    sigma=0.3,
    effective_beams=4.0,
    inject=False,
    noise=MotionNoise(SIGMA_XY, 0.0, SIGMA_YAW, 0.0, 0.0),
)
EDGES = (np.linspace(-1.5, 1.5, 6), np.linspace(-1.0, 1.0, 6), np.linspace(-np.pi, np.pi, 9))


@cache
def small_map() -> KnownMap:
    """Draw a room of 3 m by 2 m with a pillar."""
    spec = GridSpec((-1.6, -1.1), 0.05, (44, 64))
    ix, iy = np.meshgrid(np.arange(64), np.arange(44))
    x, y = np.moveaxis(spec.cell_to_world(np.stack([ix, iy], axis=-1)), -1, 0)

    def inside(box, margin):
        x0, y0, x1, y1 = box
        return (x > x0 - margin) & (x < x1 + margin) & (y > y0 - margin) & (y < y1 + margin)

    free = inside(ROOM, 0.0) & ~inside(PILLAR, 0.0)
    walls = (inside(ROOM, 0.05) & ~inside(ROOM, 0.0)) | inside(PILLAR, 0.0)
    cells = np.where(walls, 1.0, np.where(free, -1.0, 0.0)).astype(np.float32)
    return KnownMap.of(OccupancyGrid(spec, cells), CONFIG)


def scan_from(known: KnownMap, pose: np.ndarray, beams: int = 60) -> np.ndarray:
    """Walk along each beam in steps of 1 cm until it meets a wall: end points ``(M, 2)`` in the robot's frame."""
    angles = np.linspace(-2.35, 2.35, beams)
    steps = np.arange(0.0, 4.0, 0.01)
    way = np.stack([np.cos(pose[2] + angles), np.sin(pose[2] + angles)], axis=-1)
    cells = known.grid.spec.world_to_cell(pose[:2] + steps[:, None, None] * way)
    cells = np.clip(cells, 0, np.array(known.grid.spec.shape[::-1]) - 1)
    r = steps[np.argmax(known.grid.occupied[cells[..., 1], cells[..., 0]], axis=0)]
    return np.column_stack([r * np.cos(angles), r * np.sin(angles)])


@dataclass(frozen=True, eq=False)
class Histogram:
    """Every pose of a lattice, ``nodes (K, 3)``, and how probable each is, ``belief (K,)``."""

    nodes: np.ndarray
    belief: np.ndarray

    @classmethod
    def even(cls, known: KnownMap) -> Histogram:
        """Make every pose on a free cell equally probable."""
        x, y = np.arange(-1.4, 1.5, PLACE), np.arange(-0.9, 1.0, PLACE)
        theta = -np.pi + 2.0 * np.pi / HEADINGS * (np.arange(HEADINGS) + 0.5)
        nodes = np.stack(np.meshgrid(x, y, theta, indexing="ij"), axis=-1).reshape(-1, 3)
        ix, iy = known.grid.spec.world_to_cell(nodes[:, :2]).T
        free = known.grid.free[iy, ix].astype(float)
        return cls(nodes, free / free.sum())

    def moved(self, motion: np.ndarray) -> Histogram:
        """Add up, for each pose, the ways that lead to it, each as probable as the motion's noise says."""
        expected = compose(self.nodes, motion).astype(np.float32)
        nodes = self.nodes.astype(np.float32)
        away = np.square((expected[:, None, :2] - nodes[None, :, :2]) / SIGMA_XY).sum(axis=-1)
        away += np.square(wrap_angle(expected[:, None, 2] - nodes[None, :, 2]) / SIGMA_YAW)
        belief = self.belief @ np.exp(-0.5 * away)
        return Histogram(self.nodes, belief / belief.sum())

    def seen(self, known: KnownMap, points_b: np.ndarray) -> Histogram:
        """Multiply each pose's probability by the likelihood of the scan."""
        belief = self.belief * np.exp(known.log_likelihood(self.nodes, points_b))
        return Histogram(self.nodes, belief / belief.sum())


def coarse(poses: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Add up weights in 5 by 5 places and 8 headings."""
    return np.histogramdd(poses, EDGES, weights=weights)[0]


@cache
def exact_beliefs() -> tuple[Histogram, ...]:
    """Compute the histogram filter's belief after each of the four scans."""
    known, beliefs = small_map(), []
    belief = Histogram.even(known)
    for pose, motion in zip(PATH, _motions(), strict=True):
        belief = belief.moved(motion).seen(known, scan_from(known, pose))
        beliefs.append(belief)
    return tuple(beliefs)


def _motions() -> np.ndarray:
    return np.vstack([np.zeros(3), between(PATH[:-1], PATH[1:])])


def cloud_beliefs(n: int, seed: int) -> list[Particles]:
    """Run the particle filter on the same scans with a fixed number of particles."""
    known, rng = small_map(), np.random.default_rng([11, seed])
    fixed = KnownMap(known.grid, known.field, _fixed(n))
    state = LocalizationState(Particles(spread(known.grid, n, rng), np.zeros(n)))
    clouds, nothing = [], (np.zeros(0), np.zeros(0), np.zeros(0))
    for k, (pose, motion) in enumerate(zip(PATH, _motions(), strict=True)):
        points = scan_from(known, pose)
        event = ScanEvent(float(k), points, np.arange(len(points)), np.zeros(2), 0, motion, nothing)
        state, info = localization_step(state, event, fixed, rng)
        assert info.particles is not None
        clouds.append(info.particles)
    return clouds


def _fixed(n: int) -> LocalizationConfig:
    return LocalizationConfig(
        first=n,
        particles=n,
        least=n,
        sigma=CONFIG.sigma,
        effective_beams=CONFIG.effective_beams,
        inject=False,
        noise=CONFIG.noise,
    )


def distance_to_exact(n: int, seed: int) -> float:
    """Return the greatest total variation between cloud and histogram over the four scans: 0 alike, 1 disjoint."""
    pairs = zip(exact_beliefs(), cloud_beliefs(n, seed), strict=True)
    return max(
        0.5 * float(np.abs(coarse(h.nodes, h.belief) - coarse(c.poses, c.weights)).sum()) for h, c in pairs
    )
