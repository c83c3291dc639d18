"""What makes a building hard to map: people, doors that change unseen, and glass.

Every choice is made with the robot's drive in hand, so that people meet the robot and never touch it, and nothing
changes before its eyes. Random numbers come from one stream for each kind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import compose
from pfslam.simulator.config import SimulatorConfig
from pfslam.simulator.drive import Drive
from pfslam.simulator.lidar import sensor_at
from pfslam.simulator.world import WALL_KINDS, Person, World

STEP = 0.1  # s between the moments that are looked at
CLEARANCE = 0.55  # nobody's centre comes closer to the robot's (m)
TRIES = 2000
AHEAD, FOLLOWED = (1.2, 1.6), (15.0, 25.0)  # the gap to the one who walks ahead (m), and for how long (s)
WALK = (0.8, 1.4)  # m/s
MARGIN, LEAST_GAP = 0.5, 2.0  # a door changes this long from any sight of it, in gaps of at least that (s)
PANE = 1.5  # length of a piece of glass (m)


@dataclass(frozen=True, eq=False)
class Route:
    """Where the robot and its LiDAR are at times ``t (T,)``: ``robot``, ``eye (T, 2)`` in the plan, ``arc (T,)`` m."""

    world: World
    t: np.ndarray
    robot: np.ndarray
    eye: np.ndarray
    arc: np.ndarray
    reach: float
    driving: tuple[float, float]

    @classmethod
    def of(cls, world: World, drive: Drive, config: SimulatorConfig) -> Route:
        """Look at a drive in small steps, from before the first stamp until after the last."""
        t = np.arange(drive.t[0], drive.t[-1], STEP)
        lidar = config.robot.lidar
        robot = compose(world.pose_pw, drive.at(t)[0])[:, :2]
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(robot, axis=0).T))])
        eye = sensor_at(world, drive, t, lidar.position_b).origin[:, :2]
        driving = config.timing.still_start, drive.duration - config.timing.still_end
        return cls(world, t, robot, eye, arc, lidar.range_max, driving)

    def beside(self, arc: np.ndarray, aside: np.ndarray) -> np.ndarray:
        """Find the points ``(T, 2)`` after ``arc (T,)`` m of the robot's path and ``aside (T,)`` m to its left."""
        path = self.world.path
        s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        arc = np.clip(arc, 0.0, s[-1] - 0.1)
        here = np.column_stack([np.interp(arc, s, axis) for axis in path.T])
        ahead = np.column_stack([np.interp(arc + 0.1, s, axis) for axis in path.T])
        return here + aside[:, None] * _left(ahead - here)

    def sees(self, points: np.ndarray) -> np.ndarray:
        """Mark the moments ``(T,)`` at which one of ``points (P, T, 2)`` is in sight, whichever way the LiDAR looks."""
        return np.any([self.world.in_sight(self.eye, p, self.reach) for p in points], axis=0)


def add_hazards(
    world: World,
    drive: Drive,
    config: SimulatorConfig,
    people: np.random.Generator,
    doors: np.random.Generator,
    glass: np.random.Generator,
) -> World:
    """Put the people, doors and glass of a configuration into a building, each with random numbers of its own."""
    hazards = config.hazards
    if hazards.glass:
        world = replace(world, glass=_glass(world, hazards.glass, glass))
    if hazards.people or hazards.doors:
        route = Route.of(world, drive, config)
        met = tuple(_meeting(route, i, people) for i in range(hazards.people))
        world = replace(_with_doors(world, route, hazards.doors, doors), people=met)
    return world


def _meeting(route: Route, number: int, rng: np.random.Generator) -> Person:
    """Draw a person who meets the robot once: number 0 walks ahead of it, the others cross its way or pass it."""
    kind = _ahead if number == 0 else _across if number % 2 else _past
    for _ in range(TRIES):
        begin, end, centres = kind(route, rng)
        meeting = (route.t >= begin) & (route.t <= end)
        if not _fits(route, centres[meeting], meeting):
            continue
        there = _until_unseen(route, centres, meeting)
        if _fits(route, centres[there], there):
            return Person(route.t[there], centres[there])
    raise DataError("simulate", "people", number + 1, "fewer: the building has no room for so many")


def _ahead(route: Route, rng: np.random.Generator) -> tuple[float, float, np.ndarray]:
    """Somebody who stands in the way, walks ahead of the robot for a while, and then steps aside."""
    begin, lasts = rng.uniform(*route.driving), rng.uniform(*FOLLOWED)
    gap = rng.uniform(*AHEAD)
    arc = np.interp(np.clip(route.t, begin, begin + lasts), route.t, route.arc) + gap
    aside = rng.choice([-0.75, 0.75]) * np.clip(route.t - begin - lasts, 0.0, 1.0)
    return begin, begin + lasts + 1.0, route.beside(arc, aside)


def _across(route: Route, rng: np.random.Generator) -> tuple[float, float, np.ndarray]:
    """Somebody who waits at one side, crosses a little ahead of the robot, and waits at the other side."""
    when, speed = rng.uniform(*route.driving), rng.uniform(*WALK)
    arc = np.interp(when, route.t, route.arc) + rng.uniform(1.3, 2.5)
    way = np.clip(speed * (route.t - when), -rng.uniform(0.4, 1.2), rng.uniform(0.6, 1.4))
    return when - 2.0, when + 2.0, route.beside(np.full_like(way, arc), rng.choice([-1.0, 1.0]) * way)


def _past(route: Route, rng: np.random.Generator) -> tuple[float, float, np.ndarray]:
    """Somebody who comes towards the robot along its way, and passes it on one side."""
    when, speed = rng.uniform(*route.driving), rng.uniform(*WALK)
    arc = np.interp(when, route.t, route.arc) - speed * (route.t - when)
    aside = np.full_like(arc, rng.choice([-1.0, 1.0]) * rng.uniform(0.65, 0.85))
    return when - 4.0, when + 4.0, route.beside(arc, aside)


def _until_unseen(route: Route, centres: np.ndarray, meeting: np.ndarray) -> np.ndarray:
    """Prolong a meeting, ``(T,)`` bool, both ways until the robot can no longer see the person."""
    away = centres - route.eye
    side = Person.radius * _left(away)
    unseen = np.flatnonzero(~route.sees(np.array([centres, centres - side, centres + side])))
    first, last = np.flatnonzero(meeting)[[0, -1]]
    before, after = unseen[unseen < first], unseen[unseen > last]
    there = np.zeros(len(meeting), dtype=bool)
    there[before[-1] if len(before) else 0 : after[0] + 1 if len(after) else None] = True
    return there


def _left(way: np.ndarray) -> np.ndarray:
    """Turn vectors ``(T, 2)`` a quarter to the left and make them 1 m long."""
    return np.column_stack([-way[:, 1], way[:, 0]]) / np.hypot(*way.T)[:, None]


def _fits(route: Route, centres: np.ndarray, there: np.ndarray) -> bool:
    """Return whether a person is clear of the robot and of the walls, all the time."""
    if len(centres) < 2 or np.hypot(*(centres - route.robot[there]).T).min() < CLEARANCE:
        return False
    angle = np.arange(8) * np.pi / 4
    edge = centres[:, None] + Person.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return bool(route.world.is_floor(edge.reshape(-1, 2)).all())


def _glass(world: World, share: float, rng: np.random.Generator) -> np.ndarray:
    """Choose pieces ``(G, 2, 2)`` of the building's own walls until they make up a share of their length."""
    pieces = []
    for a, b in world.walls[world.wall_kind == WALL_KINDS.index("wall")]:
        part = np.linspace(0.0, 1.0, int(np.ceil(np.hypot(*(b - a)) / PANE)) + 1)[:, None]
        corners = a + part * (b - a)
        pieces.append(np.stack([corners[:-1], corners[1:]], axis=1))
    shuffled = rng.permutation(np.concatenate(pieces))
    length = np.hypot(*(shuffled[:, 1] - shuffled[:, 0]).T)
    before = np.cumsum(length) - length
    return shuffled[before < share * length.sum()]


def _with_doors(world: World, route: Route, count: int, rng: np.random.Generator) -> World:
    """Hang doors in the deepest alcoves of those that the robot sees, loses from sight and sees again."""
    leaves: list[np.ndarray] = []
    times: list[np.ndarray] = []
    for leaf in _openings(world) if count else ():
        if len(leaves) == count:
            break
        part = np.linspace(0.01, 0.99, 25)[:, None]
        points = leaf[0] + part * (leaf[1] - leaf[0])
        seen = route.sees(np.broadcast_to(points[:, None], (len(points), len(route.t), 2)))
        changes = _changes(route.t, seen, rng)
        if len(changes):
            shut_at_first = rng.random() < 0.5
            ends = [-np.inf] * shut_at_first + [*changes, np.inf]
            leaves.append(leaf)
            times.append(np.reshape(ends[: len(ends) // 2 * 2], (-1, 2)))
    if len(leaves) < count:
        expected = f"at most {len(leaves)}: the alcoves that go out of the robot's sight and come back"
        raise DataError("simulate", "doors", count, expected)
    walls = [np.repeat(leaf[None], len(shut), axis=0) for leaf, shut in zip(leaves, times, strict=True)]
    closed = np.concatenate([world.closed, *times])
    kind = np.full(len(closed), WALL_KINDS.index("door"))
    kind[: len(world.walls)] = world.wall_kind
    return replace(world, walls=np.concatenate([world.walls, *walls]), wall_kind=kind, closed=closed)


def _changes(t: np.ndarray, seen: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw one time (s) in every gap between two sights of a door."""
    ends = np.flatnonzero(np.diff(seen.astype(int)))
    gaps = [(t[a], t[b]) for a, b in pairwise(ends) if not seen[b] and t[b] - t[a] > LEAST_GAP]
    return np.array([rng.uniform(begin + MARGIN, end - MARGIN) for begin, end in gaps])


def _openings(world: World) -> list[np.ndarray]:
    """Find the opening ``(2, 2)`` of each alcove towards a corridor, the deepest alcove first."""
    areas, kinds = world.plan.areas, np.array(world.plan.kinds)
    alcoves, corridors = areas[kinds == "alcove"], areas[kinds == "corridor"]
    openings = []
    depth = np.min(alcoves[:, 2:] - alcoves[:, :2], axis=1)
    for x0, y0, x1, y1 in alcoves[np.argsort(-depth, kind="stable")]:
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        for side in np.stack([corners, np.roll(corners, -1, axis=0)], axis=1):
            middle = side.mean(axis=0)
            if ((corridors[:, :2] <= middle) & (middle <= corridors[:, 2:])).all(axis=1).any():
                openings.append(side)  # the one side that lies on a corridor
    return openings
