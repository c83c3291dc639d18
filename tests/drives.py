"""Simulated drives for tests, made once each, and one beam followed the slow and obvious way."""

from dataclasses import replace
from functools import cache

import numpy as np

from pfslam.poses import compose, rotation_matrix
from pfslam.simulator import PRESETS, Hazards, simulate
from pfslam.simulator.config import GyroModel, SlipModel
from pfslam.simulator.ground import height

BEAMS = 361
"""Enough beams for every test of geometry, at a third of the time."""


def without_errors(config):
    """The same simulated drive with perfect instruments and clocks: what is left is geometry alone."""
    track, metres = config.slip.effective_track, config.robot.encoders.metres_per_count
    return replace(
        config,
        robot=replace(config.robot, encoders=replace(config.robot.encoders, track=track)),
        timing=replace(config.timing, jitter=0.0, imu=(0.0, 0.0)),
        slip=SlipModel(metres, track, 0.0, 0.0, 0.0),
        gyro=GyroModel((0.0, 0.0, 0.0), 0.0, 1.0, 0.0, 0.0, (0.0, 0.0, 0.0), 0.0, 0.0),
        quantised=False,
        range_noise=0.0,
        invalid_share=0.0,
        disparity_noise=0.0,
        missing_disparity=0.0,
        hazards=replace(config.hazards, slip=0),
    )


@cache
def simulated(name="hall", seed=3, exact=False, **hazards):
    """A simulation with fewer beams; ``exact`` leaves out all errors of the instruments."""
    config = PRESETS[name]
    config = replace(config, robot=replace(config.robot, lidar=replace(config.robot.lidar, beams=BEAMS)))
    return simulate(without_errors(config) if exact else config, seed, hazards=Hazards(**hazards))


def slow_range(simulation, t, angle):
    """Follow one beam: every wall that is there, every person, and ever finer steps down to the ground."""
    world = simulation.world
    poses, z, pitch, roll = simulation.drive.at(np.array([t]))
    x, y, yaw = compose(world.pose_pw, poses)[0]
    R = rotation_matrix(roll[0], pitch[0], yaw)
    origin = np.array([x, y, z[0]]) + R @ simulation.recording.robot.lidar.position_b
    direction = R @ np.array([np.cos(angle), np.sin(angle), 0.0])
    best = np.inf
    for (a, b), (begin, end) in zip(world.walls, world.closed, strict=True):
        sides = np.column_stack([direction[:2], a - b])
        if begin <= t <= end and abs(np.linalg.det(sides)) > 1e-12:
            r, s = np.linalg.solve(sides, a - origin[:2])
            best = r if r > 0 and -1e-12 <= s <= 1 + 1e-12 and r < best else best
    for person in world.people:
        away = person.at([t])[0] - origin[:2]
        if np.isfinite(away).all():
            across = direction[:2] @ direction[:2], -2 * direction[:2] @ away, away @ away - person.radius**2
            roots = np.roots(across)
            best = min([best, *(root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0)])
    along = np.arange(0.0, min(best, 40.0), 1e-3)
    points = origin + along[:, None] * direction
    below = points[:, 2] < height(world.slopes, points[:, :2])
    return along[np.argmax(below)] if below.any() else best
