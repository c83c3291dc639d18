"""Walls and people around the camera: for each azimuth the distance and colour of the nearest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.simulator.world import WALL_KINDS, World

AZIMUTH_STEP = float(np.deg2rad(0.05))
AZIMUTHS = np.arange(-1200, 1201) * AZIMUTH_STEP  # from the robot's heading, +-60 deg

PLASTER = np.array([226.0, 218.0, 204.0])
DOORS = np.array([[72, 104, 128], [146, 96, 58], [96, 124, 92], [150, 70, 62]], dtype=float)
CLUTTER = np.array(
    [[196, 160, 92], [92, 110, 132], [168, 88, 70], [120, 140, 104], [188, 188, 184]], dtype=float
)
COAT = np.array([150.0, 60.0, 70.0])
PANEL = 1.2  # joints between wall panels (m)


@dataclass(frozen=True, eq=False)
class Skyline:
    """What is nearest at each azimuth: ``inverse_distance (A,)`` float32, 1/m in plan view, and ``colour (A, 3)``."""

    inverse_distance: np.ndarray
    colour: np.ndarray


def skyline(world: World, origin: np.ndarray, yaw: float, t: float) -> Skyline:
    """Look around from ``origin (2,)`` of the plan at time ``t`` (s)."""
    direction = np.column_stack([np.cos(yaw + AZIMUTHS), np.sin(yaw + AZIMUTHS)])
    inverse, wall, along = _nearest_wall(world, origin, direction, t)
    colour = _wall_paint(world, wall, along)
    for person in world.people:
        centre = person.at(np.array([t]))[0] - origin
        ahead = direction @ centre
        inside = ahead**2 - (centre @ centre - person.radius**2)
        hit = (inside > 0.0) & (ahead > 0.0)
        nearer = np.zeros(len(AZIMUTHS))
        nearer[hit] = 1.0 / (ahead[hit] - np.sqrt(inside[hit]))
        shown = nearer > inverse
        inverse = np.maximum(inverse, nearer)
        colour[shown] = COAT * (0.7 + 0.3 * np.sqrt(inside[shown])[:, None] / person.radius)
    return Skyline(inverse.astype(np.float32), colour.astype(np.float32))


def _nearest_wall(world: World, origin, direction, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find inverse distance, wall index and distance along that wall (m), all ``(A,)``, for directions ``(A, 2)``."""
    begin, edge = world.walls[:, 0] - origin, world.walls[:, 1] - world.walls[:, 0]
    facing = begin[:, 0] * edge[:, 1] - begin[:, 1] * edge[:, 0]
    there = (world.closed[:, 0] <= t) & (t <= world.closed[:, 1]) & (np.abs(facing) > 1e-9)
    walls = np.flatnonzero(there)
    begin, edge, facing = begin[walls], edge[walls], facing[walls]
    # origin + d direction = begin + s edge, by Cramer's rule: 1/d and s.
    inverse = (edge[:, 1:] * direction[:, 0] - edge[:, :1] * direction[:, 1]) / facing[:, None]
    turned = (begin[:, 1:] * direction[:, 0] - begin[:, :1] * direction[:, 1]) / facing[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = turned / -inverse
    hit = (inverse > 0.0) & (part >= -1e-9) & (part <= 1.0 + 1e-9)
    inverse = np.where(hit, inverse, 0.0)
    best = inverse.argmax(axis=0)
    columns = np.arange(len(direction))
    along = np.nan_to_num(part[best, columns]) * np.hypot(*edge[best].T)
    return inverse[best, columns], walls[best], along


def _wall_paint(world: World, wall: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Colour walls ``(A, 3)``, lit from one side: plaster with joints, doors in the alcoves, boxes in the room."""
    kind = world.wall_kind[wall]
    edge = world.walls[wall, 1] - world.walls[wall, 0]
    length = np.hypot(edge[:, 0], edge[:, 1])
    colour = np.tile(PLASTER, (len(wall), 1))
    door = (kind == WALL_KINDS.index("alcove")) & (length > 0.5) | (kind == WALL_KINDS.index("door"))
    colour[door] = DOORS[wall[door] % len(DOORS)]
    box = kind == WALL_KINDS.index("clutter")
    colour[box] = CLUTTER[(wall[box] // 4) % len(CLUTTER)]
    light = 0.86 + 0.14 * edge[:, 1] / length  # the way the wall faces
    light = np.where((along % PANEL < 0.02) & (kind == 0), 0.72 * light, light)
    light = np.where(np.minimum(along, length - along) < 0.04, 0.85 * light, light)
    return colour * light[:, None]


def wall_colours(sky: Skyline, column: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Colour walls seen in ``column (H, W)`` of the skyline at ``height (H, W)`` m: ``(H, W, 3)`` uint8."""
    step = np.clip((height + np.float32(1.0)) * np.float32(100.0), 0, len(_BY_HEIGHT) - 1).astype(np.int32)
    picture = sky.colour[column]
    picture *= _BY_HEIGHT[step][..., None]
    return picture.astype(np.uint8)


def _height_profile() -> np.ndarray:
    """Tabulate the brightness of a wall in 1 cm steps from -1 m: skirting board, wainscot, rail, plaster."""
    height = np.arange(-100, 400) / 100.0
    profile = np.where(height < 0.95, 0.88, 1.0)
    profile[(height > 0.95) & (height < 1.03)] = 0.6
    profile[height < 0.12] = 0.45
    return (profile * (0.94 + 0.02 * np.clip(height, 0.0, 3.0))).astype(np.float32)


_BY_HEIGHT = _height_profile()
