"""Chapter 11: the drive of ``hall`` past corners of its building, whose range and bearing the robot measures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pfslam.motion import motion_model
from pfslam.poses import between, compose, transform_points, wrap_angle
from pfslam.simulator.cache import cached_simulation

STEP, REACH = 0.25, 6.0
"""Seconds between two looks around, and how far (m) the robot sees."""
INWARDS = 0.02
"""A corner stands so far (m) inside its room, or the walls that meet there would hide it."""
WAY, RANGE, BEARING = 0.01, 0.1, np.deg2rad(1.0)
"""Standard deviations of the measured way of a step (m), and of a range (m) and a bearing (rad)."""


@dataclass(frozen=True, eq=False)
class Drive:
    """What a robot measured, and the truth.

    ``path (K, 3)`` are the true poses and ``posts (M, 2)`` the true corners. ``controls (K - 1, 2)`` are the measured
    way (m) and turn (rad) of each step, ``sights (K, M, 2)`` ranges (m) and bearings (rad), where ``seen (K, M)``.
    ``Q`` and ``R (2, 2)`` are the covariances of their errors.
    """

    path: np.ndarray
    posts: np.ndarray
    seen: np.ndarray
    controls: np.ndarray
    sights: np.ndarray
    Q: np.ndarray
    R: np.ndarray


@lru_cache
def truth() -> tuple[np.ndarray, ...]:
    """Return true controls, poses, corners, and which corners are in sight from where.

    The corners are all four of each room and one of each recess. The poses follow from the controls by Eq. 5, so that
    the filter's model of the motion is exact; they stay within 0.2 m of the path of ``hall``.
    """
    simulation = cached_simulation("hall")
    world, true = simulation.world, simulation.recording.true_path()
    moving = true.at(np.arange(true.t[0] + 9.5, true.t[-1] - 7.5, STEP))
    controls = between(moving[:-1], moving[1:])[:, [0, 2]]
    path = moving[:1]
    for way, turn in controls:
        path = np.vstack([path, motion_model(path[-1], way, turn, 1.0)])
    corners = []
    for (x0, y0, x1, y1), kind in zip(world.plan.areas, world.plan.kinds, strict=True):
        four = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)]
        some = {"alcove": 1, "room": 4, "lobby": 4, "hall": 4}.get(kind, 0)
        corners += [corner + INWARDS * np.sign(np.mean(four, axis=0) - corner) for corner in four[:some]]
    eye = compose(world.pose_pw, path)[:, :2]
    seen = np.column_stack([world.in_sight(eye, corner + 0 * eye, REACH) for corner in corners])
    return controls, path, transform_points(world.pose_wp, corners), seen


def drive(turn: float = 0.25, seed: int = 0) -> Drive:
    """Return the drive with errors of ``turn`` degrees (standard deviation) in the turn of each step."""
    controls, path, posts, seen = truth()
    rng = np.random.default_rng(seed)
    to = posts - path[:, None, :2]
    bearing = np.arctan2(to[..., 1], to[..., 0]) - path[:, None, 2]
    sights = np.stack([np.hypot(to[..., 0], to[..., 1]), bearing], axis=-1)
    sigmas, sigmas_of_sight = np.array([WAY, np.deg2rad(turn)]), np.array([RANGE, BEARING])
    controls = controls + sigmas * rng.standard_normal(controls.shape)
    sights = sights + sigmas_of_sight * rng.standard_normal(sights.shape)
    sights[..., 1] = wrap_angle(sights[..., 1])
    return Drive(path, posts, seen, controls, sights, np.diag(sigmas**2), np.diag(sigmas_of_sight**2))
