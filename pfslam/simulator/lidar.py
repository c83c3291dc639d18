"""The LiDAR: exact intersections of beams with walls, people and sloping ground, many scans at a time.

A wall covers a contiguous run of beams. Each wall is intersected only with the beams of its run, which is about twenty
times less work than intersecting every beam with every wall. Where a scanner sweeps, each beam starts from where the
robot is at that beam's own time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pfslam.poses import compose
from pfslam.sensors import LidarModel
from pfslam.simulator.config import SimulatorConfig
from pfslam.simulator.drive import Drive
from pfslam.simulator.ground import ground_in_view, rotations
from pfslam.simulator.world import World, cross

CHUNK = 96  # scans at a time: what they need fits into the processor's cache
TOO_FAR = 60.0  # what a beam shows that met nothing (m)
SWEEP_CHUNK = 1000  # sweeping scans at a time, in parts of at most this many beams and seconds,
PART_BEAMS, PART_TIME = 47, 0.004
STRAY = float(np.deg2rad(2.0))  # in which the bearing of a wall changes by less than this


class Sensor(NamedTuple):
    """A scanner at S moments: times ``t (S,)``, ``origin (S, 3)`` and ``rotation (S, 3, 3)`` from sensor to plan."""

    t: np.ndarray
    origin: np.ndarray
    rotation: np.ndarray


def sensor_at(world: World, drive: Drive, t: np.ndarray, position_b) -> Sensor:
    """Place a sensor mounted at ``position_b (3,)`` on the body, level with it, at times ``t (S,)``."""
    poses, z, pitch, roll = drive.at(t)
    poses_p = compose(world.pose_pw, poses)
    rotation = rotations(roll, pitch, poses_p[:, 2])
    return Sensor(t, np.column_stack([poses_p[:, :2], z]) + rotation @ np.asarray(position_b), rotation)


def _meet_walls(ranges: np.ndarray, world: World, sensor: Sensor, angles: np.ndarray) -> None:
    """Shorten ``ranges (S, B)`` to the nearest vertical wall."""
    scan, wall, run, beam = _beams_on_walls(world, sensor, angles)
    # Cramer's rule for origin + t M (cos, sin) = begin + s edge; what does not depend on the beam is factored out.
    M, begin = sensor.rotation[:, :2, :2], world.walls[wall, 0] - sensor.origin[scan, :2]
    edge = (world.walls[:, 1] - world.walls[:, 0])[wall]
    across = M[scan, 0] * edge[:, 1, None] - M[scan, 1] * edge[:, 0, None]
    scaled = across / cross(begin, edge)[:, None]
    t = 1.0 / (scaled[run, 0] * np.cos(angles)[beam] + scaled[run, 1] * np.sin(angles)[beam])
    t[~(t > 0.0)] = np.inf
    np.minimum.at(ranges.reshape(-1), (scan * len(angles))[run] + beam, t)


def _beams_on_walls(
    world: World, sensor: Sensor, angles: np.ndarray, stray: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """List runs of beams that lie between the ends of a wall, or at most ``stray`` (rad) beside them.

    Returns ``scan (R,)`` and ``wall (R,)`` of each run, and ``run (P,)`` and ``beam (P,)`` of each beam in one.
    """
    step = angles[1] - angles[0]
    begin = world.walls[None, :, 0] - sensor.origin[:, None, :2]  # (S, W, 2), from the sensor
    edge = world.walls[:, 1] - world.walls[:, 0]
    facing = cross(begin, edge)  # twice the triangle sensor, begin, end
    there = (world.closed[:, 0] <= sensor.t[:, None]) & (sensor.t[:, None] <= world.closed[:, 1])
    scan, wall = np.nonzero((np.abs(facing) > 1e-9) & there)
    # Seen from above, beam a points along M (cos a, sin a); on level ground M (S, 2, 2) is a rotation.
    inverse = np.linalg.inv(sensor.rotation[:, :2, :2])
    ends = np.stack([begin, begin + edge], axis=2)[scan, wall]  # (P, 2, 2)
    local = np.einsum("pij,pkj->pki", inverse[scan], ends)
    bearing = np.arctan2(local[..., 1], local[..., 0])
    width = (bearing[:, 1] - bearing[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
    low = np.where(width >= 0.0, bearing[:, 0], bearing[:, 1])
    high = low + np.abs(width)
    # A wall behind the sensor straddles +-pi: it is tried a second time, one turn lower.
    scan, wall = np.tile(scan, 2), np.tile(wall, 2)
    low = np.concatenate([low, low - 2.0 * np.pi]) - stray
    high = np.concatenate([high, high - 2.0 * np.pi]) + stray
    first = np.clip(np.ceil((low - angles[0]) / step), 0, len(angles)).astype(np.intp)
    count = np.clip(np.floor((high - angles[0]) / step) + 1, 0, len(angles)).astype(np.intp) - first
    met = count > 0
    scan, wall, first, count = scan[met], wall[met], first[met], count[met]
    run = np.repeat(np.arange(len(scan)), count)
    beam = np.arange(len(run)) + np.repeat(first - np.cumsum(count) + count, count)
    return scan, wall, run, beam


def _meet_the_rest(ranges: np.ndarray, world: World, t: np.ndarray, origin, direction: np.ndarray) -> None:
    """Shorten ``ranges (S, B)`` to people and ground, along rays from ``origin`` in ``direction (S, B, 3)``.

    Times ``t (S, n)`` and origins ``(S, n, 3)`` are one for each scan or one for each beam. The ground is the plane
    z = 0 and the faces of the humps.
    """
    for person in world.people:
        centre = person.at(t.ravel()).reshape(*t.shape, 2) - origin[..., :2]
        near = np.flatnonzero(np.isfinite(centre[..., 0]).any(axis=1))
        met = _disc_distance(centre[near], person.radius, direction[near, :, :2])
        ranges[near] = np.minimum(ranges[near], met)
    tilted = np.flatnonzero(np.abs(direction[..., 2]).max(axis=1) > 1e-9)
    if len(tilted):  # a level plane 0.51 m up passes above every hump
        start, way = np.moveaxis(origin[tilted], -1, 0), np.moveaxis(direction[tilted], -1, 0)
        with np.errstate(divide="ignore"):
            nearest = 1.0 / ground_in_view(world.slopes, start, way)
        ranges[tilted] = np.minimum(ranges[tilted], nearest)


def _disc_distance(centre: np.ndarray, radius: float, direction: np.ndarray) -> np.ndarray:
    """Find t ``(S, B)`` at which rays along ``direction (S, B, 2)`` meet a disc; infinity if never.

    Its ``centre (S, n, 2)`` is seen from the rays' origin; NaN is nowhere.
    """
    a, b = (direction**2).sum(axis=-1), (direction * centre).sum(axis=-1)
    inside = b**2 - a * ((centre**2).sum(axis=-1) - radius**2)
    with np.errstate(invalid="ignore"):
        t = np.where(inside >= 0.0, (b - np.sqrt(inside)) / a, np.inf)
    return np.where(t > 0.0, t, np.inf)


def _cast_part(world: World, drive: Drive, lidar: LidarModel, t, beams, only_walls: bool) -> np.ndarray:
    """Cast some ``beams (B,)`` of scans at ``t (S,)``, each from the scanner's place at its own time: ``(S, B)`` m."""
    angles, shape = lidar.angles[beams], (len(t), len(beams))
    times = t[:, None] + lidar.sweep * (beams / (lidar.beams - 1) - 0.5)
    own = sensor_at(world, drive, times.ravel(), lidar.position_b)
    origin, rotation = own.origin.reshape(*shape, 3), own.rotation.reshape(*shape, 3, 3)
    direction = rotation[..., 0] * np.cos(angles)[:, None] + rotation[..., 1] * np.sin(angles)[:, None]
    middle = sensor_at(world, drive, times.mean(axis=1), lidar.position_b)
    scan, wall, run, beam = _beams_on_walls(world, middle, angles, STRAY)
    scan, wall = scan[run], wall[run]
    begin, edge = world.walls[wall, 0] - origin[scan, beam, :2], world.walls[wall, 1] - world.walls[wall, 0]
    way = direction[scan, beam, :2]
    across = cross(way, edge)
    with np.errstate(divide="ignore", invalid="ignore"):
        along, part = cross(begin, edge) / across, cross(begin, way) / across
    hit = (along > 0.0) & (part >= -1e-9) & (part <= 1.0 + 1e-9)
    ranges = np.full(shape, np.inf)
    np.minimum.at(ranges, (scan[hit], beam[hit]), along[hit])
    if not only_walls:
        _meet_the_rest(ranges, world, times, origin, direction)
    return ranges


def true_ranges(
    world: World,
    drive: Drive,
    lidar: LidarModel,
    t: np.ndarray,
    progress: Callable | None = None,
    only_walls: bool = False,
) -> np.ndarray:
    """Compute what a perfect LiDAR would read, ``(S, beams)`` m, at stamps ``t (S,)``.

    A LiDAR with a ``sweep`` measures its beams one after the other, the middle one at the stamp, so that motion
    distorts the scan. ``progress`` wraps the work; ``only_walls`` leaves people and ground out.
    """
    angles, ranges = lidar.angles, np.full((len(t), lidar.beams), np.inf)
    if lidar.sweep == 0.0:
        beams = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
        for first in (progress or iter)(range(0, len(t), CHUNK)):
            some = slice(first, first + CHUNK)
            here = sensor_at(world, drive, t[some], lidar.position_b)
            _meet_walls(ranges[some], world, here, angles)
            if not only_walls:
                direction = np.swapaxes(here.rotation @ beams, 1, 2)
                _meet_the_rest(ranges[some], world, here.t[:, None], here.origin[:, None], direction)
        return ranges
    least = max(lidar.beams // PART_BEAMS, int(np.ceil(lidar.sweep / PART_TIME)))
    parts = np.array_split(np.arange(lidar.beams), min(least, max(lidar.beams // 2, 1)))
    for first in (progress or iter)(range(0, len(t), SWEEP_CHUNK)):
        for beams in parts:
            some = slice(first, first + SWEEP_CHUNK)
            ranges[some, beams] = _cast_part(world, drive, lidar, t[some], beams, only_walls)
    return ranges


def seen_through(ranges: np.ndarray, glass, range_max: float, rng: np.random.Generator) -> np.ndarray:
    """Let beams that meet ``glass (S, beams)`` bool return nothing, or, half of them, exactly ``range_max``."""
    nothing = rng.random(ranges.shape, dtype=np.float32) < 0.5
    return np.where(glass, np.where(nothing, TOO_FAR, range_max), ranges).astype(np.float32)


def measured(ranges: np.ndarray, config: SimulatorConfig, rng: np.random.Generator) -> np.ndarray:
    """Add noise and missing returns: ranges ``(S, beams)`` float32 in whole millimetres."""
    noisy = ranges + config.range_noise * rng.standard_normal(ranges.shape, dtype=np.float32)
    noisy[~(noisy < TOO_FAR)] = TOO_FAR
    random = rng.random(ranges.shape, dtype=np.float32)
    missing = random > 1.0 - config.invalid_share
    noisy[missing] = np.where(rng.random(np.count_nonzero(missing)) < 0.9, 0.001, TOO_FAR)
    if config.quantised:
        noisy = np.round(noisy * 1000.0) / 1000.0
    return noisy.astype(np.float32)
