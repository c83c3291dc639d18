"""Chapter 08, faults of the data: what odometry alone draws, and what a filter keeps correcting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import OccupancyGrid
from pfslam.motion import Controls, controls, dead_reckoning, integrate, wheel_distance
from pfslam.poses import Trajectory, between, transform_points, wrap_angle
from pfslam.recording import Recording
from pfslam.run import run_slam
from pfslam.sensors import scan_points
from pfslam.slam import SlamConfig
from pfslam_book.show.figures import map_along

LAB = (9.0, 52.0)
"""Seconds after the first scan: from the room up the corridor, round, and part of the way back."""
BENDS = (30.0, 52.0)
"""Half of it, with all its bends: enough to see what a filter keeps correcting."""
TURNS = (36.0, 52.0)
"""The end of it, with a half turn in a dead end: what odometry draws is short enough to be sharp."""
CELL = 0.05
HALF = 2**16
"""Cells each way from the origin that one number can tell apart: three kilometres."""


# ---- what odometry alone draws


def drawn_by_odometry(recording: Recording, inputs: Controls | None = None) -> OccupancyGrid:
    """Return the map of a few seconds along dead reckoning, or along other controls."""
    odometry = dead_reckoning(recording) if inputs is None else integrate(inputs)
    start = odometry.at(recording.scans().t[0])
    return map_along(recording, Trajectory(odometry.t, between(start, odometry.poses)), every=8)


@dataclass(frozen=True, eq=False)
class Turn:
    """A few seconds of scans, ready to be laid out with another clock: stamps, points of each scan, odometry."""

    t: np.ndarray
    points_b: list[np.ndarray]
    odometry: Trajectory

    @classmethod
    def of(cls, recording: Recording, begin: float = TURNS[0], end: float = TURNS[1], every: int = 8) -> Turn:
        """Return every ``every``-th scan between two times (s after the first scan)."""
        scans = recording.scans()
        index = np.flatnonzero((scans.t >= scans.t[0] + begin) & (scans.t < scans.t[0] + end))[::every]
        points = [scan_points(scans.ranges[i], recording.robot.lidar) for i in index]
        return cls(scans.t[index], points, dead_reckoning(recording))

    def hits(self, shift: float) -> list[np.ndarray]:
        """Return the distinct cells that each scan hits if its stamp is moved by ``shift`` s, as one number each."""
        cells = []
        for pose, points in zip(self.odometry.at(self.t + shift), self.points_b, strict=True):
            x, y = np.floor(transform_points(pose, points) / CELL).astype(int).T
            cells.append(np.unique((y + HALF) * 2 * HALF + x + HALF))
        return cells

    def places(self, shift: float) -> np.ndarray:
        """Return the centres ``(C, 2)`` (m) of all cells that are hit."""
        y, x = np.divmod(np.unique(np.concatenate(self.hits(shift))), 2 * HALF)
        return (np.column_stack([x, y]) - HALF + 0.5) * CELL

    def cells(self, shift: float) -> int:
        """Return how many cells the hits of all scans need: a sharp map needs few."""
        return len(np.unique(np.concatenate(self.hits(shift))))

    def lonely(self, shift: float, least: int = 3) -> np.ndarray:
        """Return share ``(S,)`` of each scan's cells that fewer than ``least`` of the scans hit."""
        hits = self.hits(shift)
        _, which, scans = np.unique(np.concatenate(hits), return_inverse=True, return_counts=True)
        alone = scans[which] < least
        return np.array([part.mean() for part in np.split(alone, np.cumsum([len(h) for h in hits])[:-1])])

    def yaw_rate(self) -> np.ndarray:
        """Return yaw rate ``(S,)`` (rad/s) at each scan, from odometry over 40 ms."""
        return _rate(self.odometry, self.t)


def _rate(odometry: Trajectory, t: np.ndarray, half: float = 0.02) -> np.ndarray:
    return wrap_angle(odometry.at(t + half)[:, 2] - odometry.at(t - half)[:, 2]) / (2 * half)


# ---- what the filter keeps correcting


@dataclass(frozen=True, eq=False)
class Corrections:
    """How a run disagrees with its odometry, scan by scan, and the causes that explain it best.

    ``turn (K,)`` rad by odometry; ``rate_change (K,)`` rad/s; ``heading (K,)`` rad and ``shift (K, 2)`` m in the body
    frame: what the filter added. ``delay`` s: how much too late the scans are stamped; ``scale``: true turn over
    odometry's; ``lever (2,)`` m: true place of the LiDAR less the assumed one; ``ate`` m: error against the truth.
    """

    turn: np.ndarray
    rate_change: np.ndarray
    heading: np.ndarray
    shift: np.ndarray
    delay: float
    scale: float
    lever: np.ndarray
    ate: float


def correction_fit(turn, rate_change, dt, heading) -> tuple[float, float]:
    """Return (scale, delay) that explain corrections of the heading ``(K,)`` best.

    Stamps that are ``delay`` too late make odometry turn too far by ``delay`` times the change of the yaw rate; a
    scale error adds a share of the turn, a bias a share of the time. Least squares settles the three.
    """
    causes = np.column_stack([turn, -rate_change, dt])
    scale, delay, _ = np.linalg.lstsq(causes, heading, rcond=None)[0]
    return 1.0 + float(scale), float(delay)


def lever_fit(step, turn, shift) -> np.ndarray:
    """Return lever error ``(2,)`` m that explains corrections of the position ``(K, 2)`` best, beside a wheel scale.

    If the LiDAR sits ``error`` away from where it is thought to be, a turn seems to move it by (R(turn) - I) error.
    """
    c, s = np.cos(turn) - 1.0, np.sin(turn)
    along_x, along_y = np.column_stack([step[:, 0], c, -s]), np.column_stack([step[:, 1], s, c])
    causes = np.concatenate([along_x, along_y])
    return np.linalg.lstsq(causes, shift.T.ravel(), rcond=None)[0][1:]


def body_corrections(path: Trajectory, odometry: Trajectory) -> tuple[np.ndarray, ...]:
    """Return odometry's steps ``(K, 3)`` and what a path added to them: headings ``(K,)`` and shifts ``(K, 2)``."""
    step = between(odometry.at(path.t[:-1]), odometry.at(path.t[1:]))
    matched = between(path.poses[:-1], path.poses[1:])
    return step, wrap_angle(matched[:, 2] - step[:, 2]), matched[:, :2] - step[:, :2]


def corrections(recording: Recording, seed: int = 0, every: int = 20) -> Corrections:
    """Run the refined filter with twenty particles and see where it disagrees with the odometry."""
    config = replace(SlamConfig.refined(), particles=20, every=every, tilt=False)
    path = run_slam(recording, config, rng=np.random.default_rng(seed), keep_particles=False).trajectory
    odometry = dead_reckoning(recording)
    step, heading, shift = body_corrections(path, odometry)
    change = np.diff(_rate(odometry, path.t))
    scale, delay = correction_fit(step[:, 2], change, np.diff(path.t), heading)
    lever = lever_fit(step, step[:, 2], shift)
    ate = trajectory_error(path, recording.true_path()).ate_rmse_m
    return Corrections(step[:, 2], change, heading, shift, delay, scale, lever, ate)


# ---- one instrument against another


def turn_ratio(recording: Recording, reference: Recording, begin: float, end: float) -> float:
    """Return how many times further a recording's heading turns than the reference's in the same time."""
    used, gyro = (headings(r, begin, end) for r in (recording, reference))
    return float(np.polyfit(gyro, used, 1)[0])


def headings(recording: Recording, begin: float, end: float) -> np.ndarray:
    """Return heading (rad, unwrapped, from 0) that odometry adds up, 20 times a second."""
    t = recording.scans().t[0] + np.arange(begin, end, 0.05)
    theta = np.unwrap(dead_reckoning(recording).at(t)[:, 2])
    return theta - theta[0]


def ends_cut(recording: Recording) -> float:
    """Return the share of the scans whose missing beams are all the last ones: that is a renumbered scan."""
    valid = recording.robot.lidar.valid(recording.scans().ranges)
    missing = ~valid.all(axis=1)
    in_order = (np.diff(valid.astype(int), axis=1) <= 0).all(axis=1)
    count = int(np.count_nonzero(missing))
    return float(np.count_nonzero(in_order & missing) / count) if count else 0.0


Inputs = Callable[[Controls], Controls]


def metres_lost(recording: Recording, change: Inputs = lambda inputs: inputs) -> float:
    """Return metres that the wheels turned and the path lacks."""
    inputs = controls(recording)
    return float(distance_gap(recording, change(inputs))[1][-1])


def distance_gap(recording: Recording, inputs: Controls) -> tuple[np.ndarray, np.ndarray]:
    """Return time (s after the first scan) and metres turned by the wheels less metres driven by the controls."""
    encoders, _ = recording.wheels_and_gyro()
    driven = np.concatenate([[0.0], np.cumsum(inputs.v * np.diff(inputs.t))])
    turned = wheel_distance(encoders, recording.robot.encoders, inputs.t)
    return inputs.t - recording.scans().t[0], turned - turned[0] - driven
