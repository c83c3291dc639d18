"""The drive: from waypoints to the robot's true pose every 2 ms.

Waypoints become a path with rounded corners, the path gets a speed, and speed and curvature are integrated once, with
exact arcs. That integral is the truth, and the readings of all instruments are derived from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.errors import DataError
from pfslam.motion import Controls, integrate, motion_model_arc
from pfslam.poses import Trajectory, compose, wrap_angle
from pfslam.simulator.config import SimulatorConfig, Timing
from pfslam.simulator.ground import WHEELBASE, Slope, stance

TIME_STEP = 0.002  # s
SPACE_STEP = 0.02  # m
ROUNDING = 0.33  # m
ACCELERATION = 0.55  # m/s^2
MAX_HOURS = 12
BUMP_DEG = (1.5, 3.0)  # how far a bump tilts the robot
BUMP_LASTS, BUMP_RISE = (1.0, 4.0), 0.3  # in all, and for coming up or down (s)
LEAD = 6.0  # the robot also stands still this long before the first stamp and after the last (s)


@dataclass(frozen=True, eq=False)
class Drive:
    """The true motion, sampled every ``TIME_STEP``.

    ``t (K,)`` are times (s, 0 at the first encoder stamp), ``poses (K, 3)`` planar poses in the world, ``z``,
    ``pitch``, ``roll`` ``(K,)`` the stance on the ground, and ``travelled (K,)`` the distance covered by the body (m).
    ``duration`` is the time from the first encoder stamp to the last.
    """

    t: np.ndarray
    poses: np.ndarray
    z: np.ndarray
    pitch: np.ndarray
    roll: np.ndarray
    travelled: np.ndarray
    duration: float

    def at(self, t) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Interpolate poses ``(M, 3)``, z, pitch and roll ``(M,)`` at times ``t (M,)``, constant outside the drive."""
        t = np.clip(t, self.t[0], self.t[-1])
        poses = Trajectory(self.t, self.poses).at(t)
        return poses, *(np.interp(t, self.t, values) for values in (self.z, self.pitch, self.roll))


def make_path(waypoints: np.ndarray) -> np.ndarray:
    """Smooth the polyline through ``waypoints (W, 2)`` into a path ``(S, 2)``.

    Positions are averaged along the polyline under a bell curve. An average stays on the inner side of each corner, so
    a path between walls stays between walls.
    """
    legs = np.hypot(*np.diff(waypoints, axis=0).T)
    at = np.concatenate([[0.0], np.cumsum(legs)])
    s = np.arange(0.0, at[-1], SPACE_STEP)
    points = np.column_stack([np.interp(s, at, waypoints[:, 0]), np.interp(s, at, waypoints[:, 1])])
    reach = int(4 * ROUNDING / SPACE_STEP)
    steps = np.arange(reach, 0, -1)[:, None]
    before = points[0] - steps * (points[1] - points[0])
    after = points[-1] + steps[::-1] * (points[-1] - points[-2])
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) * SPACE_STEP / ROUNDING) ** 2)
    bell /= bell.sum()
    padded = np.vstack([before, points, after])
    return np.column_stack([np.convolve(padded[:, axis], bell, mode="valid") for axis in (0, 1)])


def path_length(path: np.ndarray) -> float:
    """Compute the length (m) of a path ``(S, 2)``."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def start_pose(path: np.ndarray) -> np.ndarray:
    """Return the pose ``(3,)`` at the start of a path, looking along it."""
    return np.array([*path[0], _geometry(path[:2])[1][0]])


def drive_path(
    path_p: np.ndarray,
    slopes: tuple[Slope, ...],
    config: SimulatorConfig,
    rng: np.random.Generator,
    bumps: np.random.Generator,
) -> Drive:
    """Drive along a path of the plan frame, standing still before and after.

    Heights come from the plan's ``slopes`` and, if the configuration has any, from bumps with random numbers of
    their own. The world frame is the pose at the start, so the first pose is (0, 0, 0).
    """
    s, heading, curvature = _geometry(path_p)
    speed = _speed_limit(s, curvature, config, rng)
    travelled, heading_at, duration = _in_time(s, heading, speed, config)
    t = np.arange(len(travelled)) * TIME_STEP - LEAD
    controls = Controls(t, np.diff(travelled) / TIME_STEP, np.diff(heading_at) / TIME_STEP)
    poses = integrate(controls, model=motion_model_arc).poses
    z, pitch, roll = stance(slopes, compose(start_pose(path_p), poses))
    for begin, end in episodes(config.hazards.bumps, BUMP_LASTS, duration, config.timing, bumps):
        z, pitch, roll = _leaning(t, begin, end, bumps) + [z, pitch, roll]
    rise = np.concatenate([[0.0], np.diff(z)])
    step = np.hypot(np.concatenate([[0.0], np.diff(travelled)]), rise)
    return Drive(t, poses, z, pitch, roll, np.cumsum(step), duration)


def _geometry(path: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute arc length, unwrapped heading and curvature ``(S,)`` of a path."""
    step = np.diff(path, axis=0)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
    chords = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    heading = np.interp(s, 0.5 * (s[1:] + s[:-1]), chords)
    return s, heading, np.gradient(heading, s)


def _speed_limit(
    s: np.ndarray, curvature: np.ndarray, config: SimulatorConfig, rng: np.random.Generator
) -> np.ndarray:
    """Choose the speed ``(S,)`` along the path: varied, slow in corners, with bounded acceleration, 0 at both ends."""
    knots = np.arange(0.0, s[-1] + 4.0, 4.0)
    mood = np.interp(s, knots, 1.0 + 0.36 * rng.uniform(-1.0, 1.0, len(knots)))
    limit = np.minimum(config.cruise_speed * mood, config.top_yaw_rate / np.maximum(np.abs(curvature), 1e-9))
    limit[[0, -1]] = 0.0
    squared = limit**2
    gain = 2.0 * ACCELERATION * np.diff(s)
    for i in range(1, len(s)):
        squared[i] = min(squared[i], squared[i - 1] + gain[i - 1])
    for i in range(len(s) - 2, -1, -1):
        squared[i] = min(squared[i], squared[i + 1] + gain[i])
    return np.sqrt(squared)


def _in_time(s, heading, speed, config: SimulatorConfig) -> tuple[np.ndarray, np.ndarray, float]:
    """Sample distance and heading ``(K,)`` every ``TIME_STEP``, standing included; also the encoders' duration (s)."""
    mean_speed = 0.5 * (speed[1:] + speed[:-1])
    arrival = np.concatenate([[0.0], np.cumsum(np.diff(s) / mean_speed)])
    duration = config.timing.still_start + arrival[-1] + config.timing.still_end
    if duration > 3600 * MAX_HOURS:
        raise DataError("simulate", "duration", f"{duration / 3600:.0f} hours", f"at most {MAX_HOURS}")
    t = np.arange(-LEAD, duration + LEAD, TIME_STEP) - config.timing.still_start
    reach = int(0.2 / TIME_STEP)  # no robot starts or brakes in an instant: smooth the distance over 0.2 s
    bell = np.hanning(2 * reach + 1)
    travelled = np.convolve(
        np.pad(np.interp(t, arrival, s), reach, mode="edge"), bell / bell.sum(), mode="valid"
    )
    return travelled, np.interp(travelled, s, heading), duration


def episodes(
    count: int, lasting: tuple[float, float], duration: float, timing: Timing, rng: np.random.Generator
) -> np.ndarray:
    """Draw ``count`` intervals (from, to) ``(count, 2)`` s, spread over the time in which the robot drives.

    Each lasts between the two times of ``lasting``, or less where that many would overlap.
    """
    begin, end = timing.still_start, duration - timing.still_end
    slots = np.linspace(begin, end, count + 1)
    share = (end - begin) / max(count, 1)
    lasts = np.minimum(rng.uniform(*lasting, count), 0.8 * share)
    start = slots[:-1] + rng.uniform(0.0, 1.0, count) * (share - lasts)
    return np.column_stack([start, start + lasts])


def _leaning(t: np.ndarray, begin: float, end: float, rng: np.random.Generator) -> np.ndarray:
    """Draw what a bump adds to z, pitch and roll ``(3, K)``: the wheels of one end or side stand higher for a while."""
    tilt = rng.choice([-1.0, 1.0]) * np.deg2rad(rng.uniform(*BUMP_DEG))
    up = np.clip(np.minimum(t - begin, end - t) / min(BUMP_RISE, 0.5 * (end - begin)), 0.0, 1.0)
    angle = tilt * up**2 * (3.0 - 2.0 * up)
    pitch, roll = rng.permutation([angle, np.zeros_like(angle)])
    return np.array([0.5 * WHEELBASE * np.sin(np.abs(angle)), pitch, roll])


def turned(drive: Drive) -> np.ndarray:
    """Unwrap the yaw of the drive, ``(K,)`` rad without jumps of 2 pi."""
    return drive.poses[0, 2] + np.concatenate([[0.0], np.cumsum(wrap_angle(np.diff(drive.poses[:, 2])))])
