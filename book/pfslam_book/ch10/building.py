"""Chapter 10: a building that looks the same after half a turn but for one door, a drive in it, and a kidnapping."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from pfslam.beyond.localization import STEP_METRES, STEP_RADIANS
from pfslam.events import ScanEvent
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.motion import dead_reckoning
from pfslam.particles import Particles
from pfslam.poses import Trajectory, between, compose, invert
from pfslam.recording import LidarScans, Recording
from pfslam.refined.map import RefinedMap
from pfslam.refined.step import RefinedBelief, RefinedConfig, refined_step
from pfslam.sensors import LidarModel, RobotModel
from pfslam.simulator import HALL, Simulation
from pfslam.simulator.clocks import START_OF_TIME
from pfslam.simulator.config import Timing
from pfslam.simulator.drive import drive_path, make_path, start_pose
from pfslam.simulator.lidar import measured, true_ranges
from pfslam.simulator.odometry import encoder_counts, imu_samples
from pfslam.simulator.plan import FloorPlan, outline
from pfslam.simulator.world import WALL_KINDS, World

HALF = ((-12.0, -1.0, 12.0, 1.0), (2.0, 1.25, 6.5, 5.0), (3.4, 1.0, 4.4, 1.25), (8.0, -1.5, 9.0, -1.0))
"""A corridor, and on one half of it a room, the room's doorway and a shallow recess (x0, y0, x1, y1; m)."""
DOOR = (9.0, 1.0, 10.0, 2.2)
"""The open door that has no twin."""
ROUTE = ((-5.4, -4.0), (-4.6, -4.0), (-4.0, -3.4), (-3.9, -1.6), (-3.6, -0.3), (-2.0, -0.2), (10.6, -0.2))
LIDAR = LidarModel(beams=271, range_max=8.0)
SCANS_PER_SECOND = 8


@dataclass(frozen=True, eq=False)
class Place:
    """A known map and a drive in it whose truth is known in the map's frame; ``twin`` turns a pose half round."""

    grid: OccupancyGrid
    recording: Recording
    centre: np.ndarray

    def twin(self, poses) -> np.ndarray:
        """Turn poses ``(..., 3)`` by half a turn about the middle of the building."""
        turned = np.asarray(poses, dtype=float) * [-1.0, -1.0, 1.0]
        return turned + [2.0 * self.centre[0], 2.0 * self.centre[1], np.pi]


def true_map(simulation: Simulation | World, resolution: float = 0.05) -> OccupancyGrid:
    """Draw the map of a simulated building from its walls, as from an architect's plan."""
    world = simulation if isinstance(simulation, World) else simulation.world
    spec = GridSpec.around(world.walls_w.reshape(-1, 2), resolution)
    cells = np.where(world.true_grid(spec), 1.0, np.where(world.free_area(spec), -1.0, 0.0))
    return OccupancyGrid(spec, cells.astype(np.float32))


def without_furniture(world: World) -> World:
    """Return the building as it stood before anybody moved in."""
    keep = world.wall_kind != WALL_KINDS.index("clutter")
    walls, kind, closed = (array[keep] for array in (world.walls, world.wall_kind, world.closed))
    return replace(world, walls=walls, wall_kind=kind, closed=closed, clutter=())


@cache
def two_halves(door: bool = True) -> Place:
    """Drive out of a room and along the corridor of a building whose halves are alike but for one door.

    Without the ``door`` nothing tells the halves apart.
    """
    twins = [(-x1, -y1, -x0, -y0) for x0, y0, x1, y1 in HALF]
    world = world_of(np.array([*HALF, *twins[1:], *([DOOR] if door else [])]), np.array(ROUTE))
    return Place(true_map(world), driven(world), world.pose_wp[:2])


def shares(place: Place, t: float, poses: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Add up a cloud's weight within a metre of the true position, and of its twin: ``(2,)``."""
    truth = place.recording.true_path().at(t)
    away = [np.hypot(*(poses - pose)[:, :2].T) for pose in (truth, place.twin(truth))]
    return np.array([weights[distance < 1.0].sum() for distance in away])


def world_of(areas: np.ndarray, route: np.ndarray) -> World:
    """Build the world whose free room is the union of rectangles ``(R, 4)``, with a route through it ``(W, 2)``."""
    path, walls = make_path(route), outline(areas)
    plan = FloorPlan(areas, ("corridor",) * len(areas), route)
    always = np.tile([-np.inf, np.inf], (len(walls), 1))
    return World(plan, path, invert(start_pose(path)), walls, np.zeros(len(walls), dtype=int), always, ())


def driven(world: World, seed: int = 11) -> Recording:
    """Simulate the drive along the world's path with the robot of the book and a scanner that sees eight metres."""
    timing = Timing(still_start=1.0, still_end=2.0)
    config = replace(HALL, robot=RobotModel(lidar=LIDAR), cruise_speed=0.7, timing=timing)
    rng = [np.random.default_rng([seed, k]) for k in range(6)]
    drive = drive_path(world.path, (), config, rng[0], rng[1])
    t = np.arange(0.5, drive.duration - 1.6, 1.0 / SCANS_PER_SECOND)
    ranges = measured(true_ranges(world, drive, LIDAR, t), config, rng[2])
    stamps = t + START_OF_TIME
    return Recording(
        "two halves",
        config.robot,
        encoders=encoder_counts(drive, config, rng[3], rng[4]),
        imu=imu_samples(drive, config, rng[5]),
        lidar=LidarScans(stamps, ranges),
        truth=Trajectory(stamps, drive.at(t)[0]),
    )


def part(recording: Recording, begin: float, seconds: float) -> Recording:
    """Cut a recording to the scans from ``begin`` (s after the first) on, for so many seconds."""
    scans = recording.scans()
    keep = (scans.t >= scans.t[0] + begin) & (scans.t <= scans.t[0] + begin + seconds)
    return replace(recording, lidar=LidarScans(scans.t[keep], scans.ranges[keep]))


def kidnapped(recording: Recording, begin: float, end: float) -> Recording:
    """Cut a stretch (s after the first scan) out of a drive: at its end the robot wakes up without having moved."""
    odometry, scans, truth = dead_reckoning(recording), recording.scans(), recording.true_path()
    first, gap = scans.t[0], end - begin - 0.125
    leave, wake = first + begin, first + end

    def joined(t: np.ndarray, values: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        before, behind = t < leave, t >= wake
        return np.concatenate([t[before], t[behind] - gap]), np.concatenate([values[before], after[behind]])

    carried = compose(odometry.at(leave), between(odometry.at(wake), odometry.poses))
    t, poses = joined(odometry.t, odometry.poses, carried)
    true_t, true_poses = joined(truth.t, truth.poses, truth.poses)
    scan_t, ranges = joined(scans.t, scans.ranges, scans.ranges)
    return Recording(
        f"{recording.name}, kidnapped",
        recording.robot,
        odometry=Trajectory(t, poses),
        lidar=LidarScans(scan_t, ranges),
        truth=Trajectory(true_t, true_poses),
    )


def after_moves(events: Iterable[ScanEvent]) -> Iterator[ScanEvent]:
    """Yield the first scan, and then each that comes after 10 cm or 0.1 rad, with the motion since the one before."""
    motion, first = np.zeros(3), True
    for event in events:
        motion = compose(motion, event.motion)
        if first or np.hypot(*motion[:2]) >= STEP_METRES or abs(motion[2]) >= STEP_RADIANS:
            yield replace(event, motion=motion)
            motion, first = np.zeros(3), False


def match_along(grid: OccupancyGrid, recording: Recording, start: np.ndarray) -> Trajectory:
    """Follow a robot by scan matching in a known map, from a start that is given: ``refined_step`` that never draws."""
    config = replace(RefinedConfig.matching(), lines=None, draw_metres=np.inf, draw_radians=np.inf)
    known = RefinedMap.known(grid, config.map)
    start = np.asarray(start, dtype=float)
    state = RefinedBelief(Particles.at(start, 1), start, known)
    t, poses = [], []
    for event in config.used_scans(recording).events():
        state, info = refined_step(state, event, config, np.random.default_rng(0))
        t.append(info.t)
        poses.append(info.estimate)
    return Trajectory(np.array(t), np.array(poses))


def distances(trajectory: Trajectory, recording: Recording) -> np.ndarray:
    """Return the distance (m) of each estimate from the true position at its time."""
    truth = recording.true_path().at(trajectory.t)
    return np.hypot(*(trajectory.poses - truth)[:, :2].T)
