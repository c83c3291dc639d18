"""The LiDAR: exact intersections of beams with walls, people and sloping ground, many scans at a time.

A wall covers a contiguous run of beams. Each wall is intersected only with the beams of its run, which is about twenty
times less work than intersecting every beam with every wall.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pfslam.poses import compose
from pfslam.sensors import LidarModel
from pfslam.simulator.config import SimulatorConfig
from pfslam.simulator.drive import Drive
from pfslam.simulator.ground import ground_distance, rotations
from pfslam.simulator.world import World

CHUNK = 96  # scans at a time: what they need fits into the processor's cache
TOO_FAR = 60.0  # what a beam shows that met nothing (m)
SWEEP_PARTS = 23  # a smeared scan is this many short scans of 47 beams


@dataclass(frozen=True, eq=False)
class Sensor:
    """A scanner at S moments: times ``t (S,)``, ``origin (S, 3)`` and ``rotation (S, 3, 3)`` from sensor to plan."""

    t: np.ndarray
    origin: np.ndarray
    rotation: np.ndarray

    def rows(self, part: slice) -> Sensor:
        """Select some of the moments."""
        return Sensor(self.t[part], self.origin[part], self.rotation[part])


def sensor_at(world: World, drive: Drive, t: np.ndarray, position_b) -> Sensor:
    """Place a sensor mounted at ``position_b (3,)`` on the body, level with it, at times ``t (S,)``."""
    poses, z, pitch, roll = drive.at(t)
    poses_p = compose(world.pose_pw, poses)
    rotation = rotations(roll, pitch, poses_p[:, 2])
    return Sensor(t, np.column_stack([poses_p[:, :2], z]) + rotation @ np.asarray(position_b), rotation)


def cast(world: World, sensor: Sensor, angles: np.ndarray, progress: Callable | None = None) -> np.ndarray:
    """Cast beams at ``angles (B,)`` (evenly spaced, rad): true ranges ``(S, B)`` in metres, infinity for no hit."""
    ranges = np.empty((len(sensor.t), len(angles)))
    for first in (progress or iter)(range(0, len(sensor.t), CHUNK)):
        part = slice(first, first + CHUNK)
        ranges[part] = _cast_chunk(world, sensor.rows(part), angles)
    return ranges


def _cast_chunk(world: World, sensor: Sensor, angles: np.ndarray) -> np.ndarray:
    ranges = np.full((len(sensor.t), len(angles)), np.inf)
    # Seen from above, beam a points along M (cos a, sin a); on level ground M (S, 2, 2) is a rotation.
    M = sensor.rotation[:, :2, :2]
    _meet_walls(ranges, world, sensor, M, angles)
    for person in world.people:
        _meet_disc(ranges, person.at(sensor.t) - sensor.origin[:, :2], person.radius, M, angles)
    if world.slopes:
        _meet_ground(ranges, world, sensor, angles)
    return ranges


def _meet_walls(ranges: np.ndarray, world: World, sensor: Sensor, M: np.ndarray, angles: np.ndarray) -> None:
    """Shorten ``ranges (S, B)`` to the nearest vertical wall."""
    step = angles[1] - angles[0]
    begin = world.walls[None, :, 0] - sensor.origin[:, None, :2]  # (S, W, 2), from the sensor
    edge = world.walls[:, 1] - world.walls[:, 0]
    facing = begin[..., 0] * edge[:, 1] - begin[..., 1] * edge[:, 0]  # twice the triangle sensor, begin, end
    there = (world.closed[:, 0] <= sensor.t[:, None]) & (sensor.t[:, None] <= world.closed[:, 1])
    scan, wall = np.nonzero((np.abs(facing) > 1e-9) & there)
    inverse = np.linalg.inv(M)
    ends = np.stack([begin, begin + edge], axis=2)[scan, wall]  # (P, 2, 2)
    local = np.einsum("pij,pkj->pki", inverse[scan], ends)
    bearing = np.arctan2(local[..., 1], local[..., 0])
    width = (bearing[:, 1] - bearing[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
    low = np.where(width >= 0.0, bearing[:, 0], bearing[:, 1])
    high = low + np.abs(width)
    # A wall behind the sensor straddles +-pi: it is tried a second time, one turn lower.
    scan, wall = np.tile(scan, 2), np.tile(wall, 2)
    low, high = np.concatenate([low, low - 2.0 * np.pi]), np.concatenate([high, high - 2.0 * np.pi])
    first = np.clip(np.ceil((low - angles[0]) / step), 0, len(angles)).astype(np.intp)
    count = np.clip(np.floor((high - angles[0]) / step) + 1, 0, len(angles)).astype(np.intp) - first
    met = count > 0
    scan, wall, first, count = scan[met], wall[met], first[met], count[met]
    pair = np.repeat(np.arange(len(scan)), count)
    beam = np.arange(len(pair)) + np.repeat(first - np.cumsum(count) + count, count)
    # Cramer's rule for origin + t M (cos, sin) = begin + s edge; what does not depend on the beam is factored out.
    across = M[scan, 0] * edge[wall, 1, None] - M[scan, 1] * edge[wall, 0, None]
    scaled = across / facing[scan, wall][:, None]
    t = 1.0 / (scaled[pair, 0] * np.cos(angles)[beam] + scaled[pair, 1] * np.sin(angles)[beam])
    t[~(t > 0.0)] = np.inf
    np.minimum.at(ranges.reshape(-1), (scan * len(angles))[pair] + beam, t)


def _meet_disc(
    ranges: np.ndarray, centre: np.ndarray, radius: float, M: np.ndarray, angles: np.ndarray
) -> None:
    """Shorten ``ranges (S, B)`` to a vertical cylinder at ``centre (S, 2)`` from the sensor."""
    direction = np.einsum("sij,jb->sbi", M, np.stack([np.cos(angles), np.sin(angles)]))
    a = (direction**2).sum(axis=-1)
    b = np.einsum("sbi,si->sb", direction, centre)
    inside = b**2 - a * ((centre**2).sum(axis=-1) - radius**2)[:, None]
    with np.errstate(invalid="ignore"):
        t = np.where(inside >= 0.0, (b - np.sqrt(inside)) / a, np.inf)
    np.minimum(ranges, np.where(t > 0.0, t, np.inf), out=ranges)


def _meet_ground(ranges: np.ndarray, world: World, sensor: Sensor, angles: np.ndarray) -> None:
    """Shorten ``ranges (S, B)`` to the ground: the plane z = 0 and the faces of the humps."""
    beams = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    tilted = np.flatnonzero(np.abs(sensor.rotation[:, 2, :2]).max(axis=1) > 1e-9)
    if len(tilted) == 0:  # a level plane 0.51 m up passes above every hump
        return
    origin, direction = sensor.origin[tilted], np.swapaxes(sensor.rotation[tilted] @ beams, 1, 2)
    nearest = ground_distance(world.slopes, origin[:, None], direction)
    ranges[tilted] = np.minimum(ranges[tilted], nearest)


def true_ranges(
    world: World,
    drive: Drive,
    lidar: LidarModel,
    t: np.ndarray,
    scan_time: float = 0.0,
    progress: Callable | None = None,
) -> np.ndarray:
    """Compute what a perfect LiDAR would read, ``(S, beams)`` m, at stamps ``t (S,)``.

    With a ``scan_time`` (s) the beams are measured one after the other, the middle one at the stamp, so that motion
    distorts the scan. ``progress`` wraps the work.
    """
    if scan_time == 0.0:
        return cast(world, sensor_at(world, drive, t, lidar.position_b), lidar.angles, progress)
    parts = []
    sweep = np.array_split(np.arange(lidar.beams), min(SWEEP_PARTS, max(lidar.beams // 2, 1)))
    for beams in (progress or iter)(sweep):
        delay = scan_time * (beams.mean() / (lidar.beams - 1) - 0.5)
        parts.append(cast(world, sensor_at(world, drive, t + delay, lidar.position_b), lidar.angles[beams]))
    return np.concatenate(parts, axis=1)


def measured(ranges: np.ndarray, config: SimulatorConfig, rng: np.random.Generator) -> np.ndarray:
    """Add noise and wrong and missing returns: ranges ``(S, beams)`` float32 in whole millimetres."""
    noisy = ranges + config.range_noise * rng.standard_normal(ranges.shape, dtype=np.float32)
    noisy[~(noisy < TOO_FAR)] = TOO_FAR
    random = rng.random(ranges.shape, dtype=np.float32)
    at = np.nonzero(random < config.random_share)
    noisy[at] = rng.uniform(0.1, 30.0, len(at[0]))
    at = np.nonzero(random > 1.0 - config.invalid_share) if config.invalid_share else ()
    if at:
        noisy[at] = np.where(rng.random(len(at[0])) < 0.9, 0.001, TOO_FAR)
    if config.quantised:
        noisy = np.round(noisy * 1000.0) / 1000.0
    return noisy.astype(np.float32)
