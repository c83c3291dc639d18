"""Floor plans: a building is a union of rectangles, and its walls are the outline of that union.

Everything here is in the plan frame p, whose axes run along the walls. Metres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from pfslam.simulator.config import SimulatorConfig
from pfslam.simulator.ground import Slope

WALL = 0.25  # thickness between a room and the corridor beside it (m)
LANE = 0.3  # the robot keeps to the right of the corridor's middle (m)
DEEP = 0.2  # share of the door recesses that are half a metre deep or more
RING_SIZE = (1.0, 58.0, 38.0)  # of the large ring: half a corridor's width, and from middle to middle (m)


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """A building in plan view.

    ``areas (R, 4)`` are free rectangles (x0, y0, x1, y1), each with its entry in ``kinds``; ``waypoints (W, 2)`` are
    those of the drive.
    """

    areas: np.ndarray
    kinds: tuple[str, ...]
    waypoints: np.ndarray
    slopes: tuple[Slope, ...] = ()

    def mirrored(self) -> FloorPlan:
        """Mirror the plan in y."""
        flip = np.array([1.0, -1.0])
        return replace(
            self,
            areas=self.areas[:, [0, 3, 2, 1]] * [1, -1, 1, -1],
            waypoints=self.waypoints * flip,
            slopes=tuple(slope.mirrored() for slope in self.slopes),
        )


def make_plan(config: SimulatorConfig, rng: np.random.Generator, turn_at: float = 15.0) -> FloorPlan:
    """Draw the floor plan of a layout; ``turn_at`` moves the turning point of the second arm ("arms" only)."""
    if config.layout == "arms":
        return _arms(config, rng, turn_at)
    if config.layout == "corridor":
        return _corridor(rng)
    return _ring(config, rng)


def _arms(config: SimulatorConfig, rng: np.random.Generator, turn_at: float) -> FloorPlan:
    """A cluttered room (west), two arms from one junction (north and east), a lobby and a hall (north end)."""
    sizes = _arm_sizes(rng)
    areas = _arm_areas(sizes, rng)
    start = np.array([sizes.room_e - rng.uniform(3.6, 4.2), sizes.door_y + rng.uniform(-0.5, 0.1)])
    turn = float(np.clip(turn_at, 8.0, sizes.east - 1.0))
    legs = _arm_legs(sizes, rng, start, turn)
    slopes = _arm_slopes(sizes, rng) if config.slopes else ()
    return _plan(areas, np.vstack([[start], *(legs * config.laps)]), slopes, sizes.mirror)


def _arm_sizes(rng: np.random.Generator) -> SimpleNamespace:
    """Draw where the parts of the "arms" layout end (m).

    ``half`` is half the width of its corridors, and ``parked`` the heading of the robot at the start (rad).
    """
    half = 0.5 * rng.uniform(1.85, 2.0)
    mirror, parked = rng.random() < 0.5, np.deg2rad(rng.choice([-1, 1]) * rng.uniform(2.0, 5.0))
    sizes = SimpleNamespace(half=half, mirror=mirror, parked=parked, room_e=-half - WALL)
    sizes.north, sizes.east = rng.uniform(14.5, 16.0), rng.uniform(18.5, 20.0)
    sizes.room_w = sizes.room_e - rng.uniform(5.8, 6.4)
    sizes.room_s, sizes.room_n = rng.uniform(-3.0, -2.5), rng.uniform(2.8, 3.4)
    sizes.door_y = rng.uniform(0.0, 0.5)
    sizes.lobby_n = sizes.north + rng.uniform(2.6, 3.2)
    sizes.lobby_w, sizes.lobby_e = -half - rng.uniform(0.3, 1.2), rng.uniform(3.4, 4.4)
    sizes.hall_x = rng.uniform(1.6, 2.2)
    sizes.hall_n = sizes.lobby_n + rng.uniform(4.5, 5.5)
    return sizes


def _arm_areas(sizes: SimpleNamespace, rng: np.random.Generator) -> dict[str, list[tuple]]:
    """The free rectangles by kind."""
    half, north, east = sizes.half, sizes.north, sizes.east
    return {
        "room": [(sizes.room_w, sizes.room_s, sizes.room_e, sizes.room_n)],
        "doorway": [(sizes.room_e, sizes.door_y - 0.6, -half, sizes.door_y + 0.6)],
        "corridor": [(-half, -half, half, north), (-half, -half, east, half)],
        "lobby": [(sizes.lobby_w, north, sizes.lobby_e, sizes.lobby_n)],
        "hall": [(sizes.hall_x - 1.4, sizes.lobby_n, sizes.hall_x + 1.4, sizes.hall_n)],
        "alcove": [
            *_alcoves(rng, "y", -half, -1, sizes.room_n + 0.8, north - 0.4),
            *_alcoves(rng, "y", half, 1, half + 1.2, north - 0.4),
            *_alcoves(rng, "x", -half, -1, half + 0.8, east - 0.5),
            *_alcoves(rng, "x", half, 1, half + 1.2, east - 0.5),
        ],
    }


def _arm_legs(sizes: SimpleNamespace, rng: np.random.Generator, start: np.ndarray, turn: float) -> list:
    """Waypoints of one lap, leg by leg: out of the room, up north and back, out east and back, into the room."""
    north, lobby_n, door = sizes.north, sizes.lobby_n, (sizes.room_e - 0.7, sizes.door_y)
    ahead = start + 1.3 * np.array([np.cos(sizes.parked), np.sin(sizes.parked)])
    up, down, end = sizes.hall_x + 0.5, sizes.hall_x - 0.5, sizes.hall_n - 1.1
    return [
        [ahead, door, (-sizes.half + 0.4, sizes.door_y)],
        _weave(rng, (LANE, 2.4), (LANE, north - 0.5)),
        [(LANE, north + 0.9), (up, north + 1.7), (up, lobby_n + 0.6), (up, end), (down, end)],
        [(down, lobby_n - 0.2), (-LANE, north + 0.6)],
        _weave(rng, (-LANE, north - 1.0), (-LANE, 1.6)),
        [(0.2, -0.3)],
        _weave(rng, (2.0, -LANE), (turn - 3.5, -LANE)),
        [(turn - 1.2, 0.5), (turn, 0.5), (turn, -0.5), (turn - 1.2, -0.5)],
        _weave(rng, (turn - 3.5, LANE), (2.0, LANE)),
        [(0.0, sizes.door_y), (sizes.room_e - 0.6, sizes.door_y)],
        start + np.array([(2.0, -0.7), (0.4, -1.1), (-0.9, -0.9), (-1.1, 0.0), (-0.3, 0.3), (0.5, 0.35)]),
    ]


def _arm_slopes(sizes: SimpleNamespace, rng: np.random.Generator) -> tuple[Slope, ...]:
    """A hump in each arm."""
    y, x = rng.uniform(5.0, 6.0), rng.uniform(5.0, 6.5)
    sides = (-sizes.half - 0.85, sizes.half + 0.85)  # the alcoves beside a hump rise with it
    return (
        Slope("y", sides, (y, y + 2.6, y + 4.4, y + 7.0), (0.0, 0.45, 0.45, 0.0)),
        Slope("x", sides, (x, x + 1.2, x + 3.2, x + 4.7), (0.0, 0.44, 0.44, 0.0)),
    )


def _ring(config: SimulatorConfig, rng: np.random.Generator) -> FloorPlan:
    """A rectangular ring of corridors: large with shallow door frames, or small with side alcoves.

    Along all but one of the large ring's corridors stand frames; the "symmetric" one looks the same from both ends.
    """
    large, symmetric = config.layout == "ring", config.layout == "symmetric"
    half, length, width = RING_SIZE
    if not large:
        half, length, width = 0.5 * rng.uniform(1.95, 2.15), rng.uniform(17.0, 20.0), rng.uniform(11.0, 14.0)
    corridors = [
        (-half, -half, length + half, half),
        (length - half, -half, length + half, width + half),
        (-half, width - half, length + half, width + half),
        (-half, -half, half, width + half),
    ]
    sides = [("x", -half, -1, length), ("y", length + half, 1, width)]
    sides += [] if symmetric else [("x", width + half, 1, length), ("y", -half, -1, width)]
    alcoves = []
    for axis, wall, side, end in sides[: 3 if large else 4]:
        alcoves += _alcoves(rng, axis, wall, side, 1.5, end - 1.0, 0.0 if large else DEEP)
    if symmetric:
        alcoves += [(length - x1, width - y1, length - x0, width - y0) for x0, y0, x1, y1 in alcoves]
    ends = [
        ((2.0, -LANE), (length - 1.5, -LANE)),
        ((length + LANE, 1.5), (length + LANE, width - 1.5)),
        ((length - 1.5, width + LANE), (1.5, width + LANE)),
        ((-LANE, width - 1.5), (-LANE, 1.5)),
    ]
    lap = [_weave(rng, *leg) for leg in ends]
    areas = {"corridor": corridors, "alcove": alcoves}
    return _plan(areas, np.vstack([*(lap * config.laps), [(1.0, -LANE), (2.0, -LANE)]]))


def _corridor(rng: np.random.Generator) -> FloorPlan:
    """Forty metres of nothing on either side of a 20 m drive: the ends are beyond the LiDAR's 30 m."""
    half = 0.5 * rng.uniform(1.6, 2.8)
    areas = {"corridor": [(-40.0, -half, 60.0, half)]}
    return _plan(areas, np.column_stack([[0.0, 10.0, 20.0], rng.uniform(-0.3, 0.3, 3)]))


def _plan(areas: dict, waypoints, slopes=(), mirror: bool = False) -> FloorPlan:
    rectangles = [rectangle for group in areas.values() for rectangle in group]
    kinds = tuple(kind for kind, group in areas.items() for _ in group)
    plan = FloorPlan(np.array(rectangles), kinds, np.asarray(waypoints, dtype=float), slopes)
    return plan.mirrored() if mirror else plan


def _alcoves(
    rng: np.random.Generator, axis: str, wall: float, side: int, start: float, stop: float, deep: float = DEEP
) -> list[tuple]:
    """Draw door recesses along a wall; ``side`` (-1 or +1) is the direction in which they reach outwards.

    The wall runs along ``axis`` and lies at ``wall`` on the other axis; a share ``deep`` of them is deep.
    """
    found, at = [], start + rng.uniform(0.0, 1.5)
    while at + 1.1 < stop:
        width = rng.uniform(0.85, 1.1)
        depth = rng.uniform(0.5, 0.8) if rng.random() < deep else rng.uniform(0.12, 0.2)
        near, far = sorted((wall, wall + side * depth))
        found.append((at, near, at + width, far) if axis == "x" else (near, at, far, at + width))
        at += width + rng.uniform(1.2, 3.0)
    return found


def _weave(rng: np.random.Generator, start, stop) -> np.ndarray:
    """Draw waypoints ``(n, 2)`` from ``start`` to ``stop``, about 2.5 m apart, slightly left and right of the line."""
    start, stop = np.asarray(start, dtype=float), np.asarray(stop, dtype=float)
    way = stop - start
    count = max(int(np.hypot(*way) / 2.5), 1) + 1
    sideways = np.array([-way[1], way[0]]) / np.hypot(*way)
    part = np.linspace(0.0, 1.0, count)[:, None]
    return start + part * way + rng.uniform(-0.12, 0.12, (count, 1)) * sideways


def outline(areas: np.ndarray) -> np.ndarray:
    """Trace the walls ``(W, 2, 2)`` around the union of rectangles ``(R, 4)``, with the free side on their left."""
    xs = np.unique(areas[:, [0, 2]])
    ys = np.unique(areas[:, [1, 3]])
    mid_x, mid_y = 0.5 * (xs[1:] + xs[:-1]), 0.5 * (ys[1:] + ys[:-1])
    x0, y0, x1, y1 = areas.T[..., None]
    in_x, in_y = (x0 < mid_x) & (mid_x < x1), (y0 < mid_y) & (mid_y < y1)
    free = np.pad((in_y[:, :, None] & in_x[:, None, :]).any(axis=0), 1)
    walls = []
    for i, y in enumerate(ys):  # free above: the wall runs in +x; free below: in -x
        above, below = free[i + 1, 1:-1], free[i, 1:-1]
        walls += [((xs[a], y), (xs[b], y)) for a, b in _runs(above & ~below)]
        walls += [((xs[b], y), (xs[a], y)) for a, b in _runs(below & ~above)]
    for i, x in enumerate(xs):  # free to the right: the wall runs in -y; free to the left: in +y
        right, left = free[1:-1, i + 1], free[1:-1, i]
        walls += [((x, ys[b]), (x, ys[a])) for a, b in _runs(right & ~left)]
        walls += [((x, ys[a]), (x, ys[b])) for a, b in _runs(left & ~right)]
    return np.array(walls)


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Find start and stop (exclusive) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edges[::2], edges[1::2], strict=True))
