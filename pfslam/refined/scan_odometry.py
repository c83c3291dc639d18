"""An odometry made of scans alone, for a drive that has no other.

Each scan is matched to the map of those before it, by the accurate filter with one particle. Where odometry would say
how the robot moved since the last scan, its last motion is taken to continue. How far that may be wrong follows as for
jumps of an odometry (``pfslam.io.jumps``): wheels hold by friction, so within dt seconds no robot comes farther than
g dt^2 / 2 from where it would have gone. A radian counts as a metre. So far a match is looked for, but no farther than
two scans share enough walls: a scanner that is slower than two scans a second may lose a robot that drives as it likes.

The path that results takes the odometry's place, and any filter runs over it as over another. Two things differ, and
``unaided`` tells of them: nobody knows how far the robot came where no wall shows it, and a motion beyond the search
is not found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pfslam.poses import Trajectory, between
from pfslam.recording import Recording
from pfslam.refined.events import LEVEL, RefinedEvent, deskewed, level_scan
from pfslam.refined.health import BLIND_SECONDS, Distrust
from pfslam.refined.matching import SearchConfig
from pfslam.refined.noise import MotionNoise
from pfslam.refined.record import RefinedStep
from pfslam.refined.step import RefinedConfig
from pfslam.sensors import FLOOR_CLEARANCE, STANDARD_GRAVITY

FARTHEST_APART = 1.5
"""Metres from one scan to the next up to which they share walls enough; logs keep one a metre."""
SAID = "no odometry: scans alone tell how the robot moved, and nothing can check their clock, turns and ways"


def with_scan_odometry(recording: Recording, progress: Callable | None = None) -> Recording:
    """Return a recording whose odometry is made of its scans, and that says so; ``progress`` wraps the scans.

    What odometry it had is not looked at. Raises ``DataError`` without scans.

    >>> from pfslam import load, with_scan_odometry
    >>> with_scan_odometry(load("hall", odometry=False)).scan_matched
    True
    """
    path, notes = scan_odometry(recording, progress), (*recording.notes, SAID)
    return replace(recording, odometry=path, encoders=None, scan_matched=True, notes=notes)


def scan_odometry(recording: Recording, progress: Callable | None = None) -> Trajectory:
    """Match the scans of a recording, each to those before it, and return the robot's path from (0, 0, 0).

    As many are matched as a filter uses by default, and the last scan, so that the path covers all of them.
    """
    scans, every = recording.scans(), recording.default_every
    # People who walk ahead drag a robot along that knows nothing but what it sees: by 8 m in a simulated hall.
    config = RefinedConfig.matching().robust(recording.range_scatter())
    used = np.unique(np.append(np.arange(0, len(scans.t), every), len(scans.t) - 1))
    belief, rng, rate, poses = config.start(), np.random.default_rng(0), np.zeros(3), list[np.ndarray]()
    steps = list(zip(used.tolist(), np.diff(scans.t[used], prepend=scans.t[0]).tolist(), strict=True))
    for k, dt in progress(steps) if progress else steps:
        before, event = belief.estimate, _event(recording, k, rate, dt)
        belief, _ = _reaching(config, dt).step(belief, event, rng)
        rate = between(before, belief.estimate) / dt if poses else rate
        poses.append(belief.estimate)
    return Trajectory(scans.t[used], np.array(poses))


def reach(dt):
    """Return how far (m, or rad) a motion over ``dt`` s, one or an array, may be from the one before it."""
    return np.minimum(0.5 * STANDARD_GRAVITY * np.square(dt), FARTHEST_APART)


def _reaching(config: RefinedConfig, dt: float) -> RefinedConfig:
    """Return the settings that look for a match as far as the robot may have come; three sigmas span the search."""
    sigma, search = float(reach(dt)) / 3.0, SearchConfig()
    noise = MotionNoise(MotionNoise.xy + sigma, 0.0, MotionNoise.yaw + sigma, 0.0, 0.0, sampled=False)
    cells = search.cells[0], round(FARTHEST_APART / config.map.resolution)
    yaws = search.yaws[0], round(FARTHEST_APART / search.yaw_step)
    return replace(config, noise=noise, search=replace(search, cells=cells, yaws=yaws))


def _event(recording: Recording, k: int, rate: np.ndarray, dt: float) -> RefinedEvent:
    """Make the event of scan ``k``, ``dt`` s after the last, of a robot that goes on at ``rate (3,)``."""
    scans, lidar, motion = recording.scans(), recording.robot.lidar, rate * dt
    points, beams, sensor, struck = level_scan(scans.ranges[k], lidar, LEVEL, FLOOR_CLEARANCE)
    if lidar.sweep:
        points = deskewed(points, beams, lidar, rate * lidar.sweep)
    inputs = rate[:1], rate[2:], np.array([dt])
    return RefinedEvent(float(scans.t[k]), points, beams, sensor, motion, inputs, struck)


def unaided(recording: Recording, infos: Sequence[RefinedStep]) -> list[Distrust]:
    """List where the lack of an odometry leaves a run in doubt, as ``health.distrust`` does; empty if there is one.

    ``infos`` are the steps of a run over the recording.
    """
    if not recording.scan_matched or recording.odometry is None:
        return []
    return [*_beyond(recording.odometry), *_silent(infos)]


def _beyond(path: Trajectory) -> list[Distrust]:
    """Find the first motion that lay at the edge of what was looked at: the true one may lie farther out."""
    steps, dt = between(path.poses[:-1], path.poses[1:]), np.diff(path.t)[:, None]
    off = np.abs(steps[1:] - steps[:-1] / dt[:-1] * dt[1:])
    sigma = reach(dt[1:])
    found = np.hypot(off[:, 0], off[:, 1]) > sigma[:, 0] + 3.0 * MotionNoise.xy
    found |= off[:, 2] > sigma[:, 0] + 3.0 * MotionNoise.yaw
    if not found.any():
        return []
    k = int(np.argmax(found))
    (x, _, turn), seconds = steps[k + 1], dt[k + 1, 0]
    moved = f"the robot seems to have moved {x:+z.2f} m and {np.degrees(turn):+z.0f} deg in {seconds:.2f} s"
    reason = f"{moved}: without odometry, scan matching looks no farther"
    return [{"from": float(path.t[k + 2]), "to": None, "reason": reason}]


def _silent(infos: Sequence[RefinedStep]) -> list[Distrust]:
    """Find the first stretch of some seconds in which no wall showed the way along."""
    t = np.array([info.t for info in infos])
    told = np.array([info.silent_direction is None for info in infos])
    last = np.maximum.accumulate(np.where(told, t, t[:1]))
    found = t - last > BLIND_SECONDS
    if not found.any():
        return []
    reason = f"no wall shows the way along for more than {BLIND_SECONDS:g} s, and no odometry tells it"
    return [{"from": float(last[found.argmax()]), "to": None, "reason": reason}]
