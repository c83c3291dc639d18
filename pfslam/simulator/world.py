"""The building: walls, clutter and ground, and the people, doors and glass that may be in it.

Geometry is kept in the plan frame p, along the walls.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pfslam.grid import GridSpec
from pfslam.poses import invert, transform_points
from pfslam.simulator.config import SimulatorConfig
from pfslam.simulator.drive import make_path, path_length, start_pose
from pfslam.simulator.ground import Slope
from pfslam.simulator.plan import FloorPlan, make_plan, outline

WALL_KINDS = ("wall", "alcove", "clutter", "door")
CLEARANCE = 0.4  # clutter keeps this far from the robot's centre, at least (m)


@dataclass(frozen=True, eq=False)
class Person:
    """A disc that walks from point to point: it is at ``centres (K, 2)`` of the plan at times ``t (K,)``."""

    t: np.ndarray
    centres: np.ndarray
    radius: float = 0.2

    def at(self, t) -> np.ndarray:
        """Centres ``(T, 2)`` in the plan frame at times ``t (T,)``; NaN before the person comes and after it left."""
        ends = {"left": np.nan, "right": np.nan}
        return np.column_stack([np.interp(t, self.t, axis, **ends) for axis in self.centres.T])


@dataclass(frozen=True, eq=False)
class World:
    """A building, and the path of the robot through it.

    ``pose_wp (3,)`` is the pose of the plan in the world and ``path (S, 2)`` the robot's path in the plan.
    ``walls (W, 2, 2)`` are segments with the free side on their left; ``wall_kind (W,)`` indexes
    ``WALL_KINDS``; ``closed (W, 2)`` is the time (from, to) during which a wall is there: doors come and go.
    ``glass (G, 2, 2)`` are the parts of walls that the LiDAR sees through; the camera sees them as walls.
    """

    plan: FloorPlan
    path: np.ndarray
    pose_wp: np.ndarray
    walls: np.ndarray
    wall_kind: np.ndarray
    closed: np.ndarray
    clutter: tuple[np.ndarray, ...]
    people: tuple[Person, ...] = ()
    glass: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 2)))

    @property
    def slopes(self) -> tuple[Slope, ...]:
        """The humps of the plan."""
        return self.plan.slopes

    @property
    def panes(self) -> World:
        """The glass alone."""
        always = np.tile([-np.inf, np.inf], (len(self.glass), 1))
        return replace(self, walls=self.glass, closed=always)

    @property
    def pose_pw(self) -> np.ndarray:
        """The world in the plan frame, ``(3,)``."""
        return invert(self.pose_wp)

    @property
    def permanent(self) -> np.ndarray:
        """Which walls ``(W,)`` are always there."""
        return np.isinf(self.closed).all(axis=1)

    @property
    def walls_w(self) -> np.ndarray:
        """The permanent walls in the world frame, ``(W, 2, 2)`` m."""
        fixed = self.walls[self.permanent]
        return transform_points(self.pose_wp, fixed.reshape(-1, 2)).reshape(-1, 2, 2)

    def in_sight(self, eye: np.ndarray, target: np.ndarray, reach: float) -> np.ndarray:
        """Mark when ``(T,)`` an ``eye (T, 2)`` sees a ``target (T, 2)`` no farther than ``reach`` (m) away.

        Points are in the plan frame, and only permanent walls hide them.
        """
        begin, end = self.walls[self.permanent].swapaxes(0, 1)
        way, to = target - eye, begin - eye[:, None]
        across = cross(way[:, None], end - begin)
        with np.errstate(divide="ignore", invalid="ignore"):
            along, part = cross(to, end - begin) / across, cross(to, way[:, None]) / across
        hidden = (along > 0.0) & (along < 1.0 - 1e-9) & (part >= 0.0) & (part <= 1.0)
        return ~hidden.any(axis=1) & (np.hypot(*way.T) <= reach)

    def free_area(self, spec: GridSpec) -> np.ndarray:
        """Mark cells ``(H, W)`` bool whose centre is floor: inside the building and not under clutter."""
        ix, iy = np.meshgrid(np.arange(spec.shape[1]), np.arange(spec.shape[0]))
        centres = spec.cell_to_world(np.stack([ix, iy], axis=-1)).reshape(-1, 2)
        return self.is_floor(transform_points(self.pose_pw, centres)).reshape(spec.shape)

    def is_floor(self, points_p: np.ndarray) -> np.ndarray:
        """Mark the points ``(M, 2)`` of the plan that are floor (bool ``(M,)``)."""
        x, y = points_p.T
        inside = np.zeros(len(points_p), dtype=bool)
        for x0, y0, x1, y1 in self.plan.areas:
            inside |= (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
        for corners in self.clutter:
            around = (x > corners[:, 0].min()) & (x < corners[:, 0].max())
            near = np.flatnonzero(around & (y > corners[:, 1].min()) & (y < corners[:, 1].max()))
            edge = np.roll(corners, -1, axis=0) - corners
            to = points_p[near, None] - corners
            inside[near] &= ~(edge[:, 0] * to[..., 1] - edge[:, 1] * to[..., 0] > 0).all(axis=1)
        return inside

    def true_grid(self, spec: GridSpec) -> np.ndarray:
        """Mark cells ``(H, W)`` bool that a permanent wall runs through."""
        step = 0.1 * spec.resolution
        grid = np.zeros(spec.shape, dtype=bool)
        for a, b in self.walls_w:
            part = np.linspace(0.0, 1.0, int(np.hypot(*(b - a)) / step) + 2)[:, None]
            cells = spec.world_to_cell(a + part * (b - a))
            cells = cells[spec.contains(cells)]
            grid[cells[:, 1], cells[:, 0]] = True
        return grid


def make_world(config: SimulatorConfig, seed: np.random.SeedSequence) -> World:
    """Build the building of a configuration and a seed, and choose the robot's path through it.

    The building depends on the seed alone: hall and ramp of one seed are drives through the same building.
    """
    plan_seed, clutter_seed = seed.spawn(2)
    turn = 15.0
    plan = make_plan(config, np.random.default_rng(plan_seed), turn)
    path = make_path(plan.waypoints)
    if config.layout == "arms":  # moving the turning point by a metre makes every lap two metres longer
        turn += 0.5 * (config.path_length - path_length(path) / config.laps)
        plan = make_plan(config, np.random.default_rng(plan_seed), turn)
        path = make_path(plan.waypoints)
    clutter = _place_clutter(plan, path, np.random.default_rng(clutter_seed))
    outer = outline(plan.areas)
    boxes = [np.stack([box[::-1], np.roll(box[::-1], -1, axis=0)], axis=1) for box in clutter]
    walls = np.concatenate([outer, *boxes])
    kind = np.full(len(walls), WALL_KINDS.index("clutter"))
    kind[: len(outer)] = _touches_alcove(outer, plan)
    closed = np.tile([-np.inf, np.inf], (len(walls), 1))
    return World(plan, path, invert(start_pose(path)), walls, kind, closed, clutter)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute the cross product ``(...)`` of plane vectors ``(..., 2)``."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _touches_alcove(walls: np.ndarray, plan: FloorPlan) -> np.ndarray:
    """Give 1 for walls whose middle lies on the border of an alcove, 0 for others."""
    x, y = walls.mean(axis=1).T[..., None]
    x0, y0, x1, y1 = plan.areas[[kind == "alcove" for kind in plan.kinds]].T
    near = (x > x0 - 1e-6) & (x < x1 + 1e-6) & (y > y0 - 1e-6) & (y < y1 + 1e-6)
    return near.any(axis=1).astype(int)


def _place_clutter(plan: FloorPlan, path: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Place boxes and pillars ``(V, 2)``, counter-clockwise, where the robot does not drive."""
    wanted = {"room": 14, "lobby": 3, "hall": 2}
    placed: list[tuple[np.ndarray, float]] = []
    shapes = []
    for area, kind in zip(plan.areas, plan.kinds, strict=True):
        for _ in range(12 * wanted.get(kind, 0)):
            shape = _box(rng) if rng.random() < 0.75 else _pillar(rng)
            reach = np.hypot(*shape.T).max()
            centre = rng.uniform(area[:2] + reach, area[2:] - reach)
            off_path = np.hypot(*(path - centre).T).min() > reach + CLEARANCE
            apart = all(np.hypot(*(centre - other)) > reach + size + 0.1 for other, size in placed)
            inside = sum(bool((at > area[:2]).all() and (at < area[2:]).all()) for at, _ in placed)
            if off_path and apart and inside < wanted[kind]:
                placed.append((centre, reach))
                shapes.append(centre + shape)
    return tuple(shapes)


def _box(rng: np.random.Generator) -> np.ndarray:
    a, b, turn = rng.uniform(0.15, 0.5), rng.uniform(0.15, 0.3), rng.uniform(0.0, np.pi)
    return transform_points([0.0, 0.0, turn], [[-a, -b], [a, -b], [a, b], [-a, b]])


def _pillar(rng: np.random.Generator) -> np.ndarray:
    angle = np.arange(8) * np.pi / 4
    return rng.uniform(0.12, 0.22) * np.column_stack([np.cos(angle), np.sin(angle)])
