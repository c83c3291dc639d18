"""Chapter 08, faults of the data: what odometry alone draws, and what a filter keeps correcting."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

import pfslam
from pfslam.cli.figures import map_along
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import OccupancyGrid
from pfslam.motion import Controls, controls, dead_reckoning, integrate, wheel_distance
from pfslam.poses import Trajectory, between, wrap_angle
from pfslam.recording import Recording
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam_book.ch08.fault import Panel, Seen
from pfslam_book.show import faults

LAB = (9.0, 52.0)
"""Seconds after the first scan: from the room up the corridor, round, and part of the way back."""
BENDS = (30.0, 52.0)
"""Half of it, with all its bends: enough to see what a filter keeps correcting."""
TURNS = (36.0, 52.0)
"""The end of it, with a half turn in a dead end: what odometry draws is short enough to be sharp."""
DELAY = 0.15
"""By how much the clock of the scans is off (s)."""
MIRRORED_X = -0.13323
"""Where the program takes the LiDAR to be: behind the centre instead of in front of it (m)."""
PANE = (300, 40)
"""First beam and number of beams of the glass pane."""
GAP = (40.5, 41.5)
"""Begin and end of the IMU's silence (s after the start)."""
LIMITS = {"xlim": (-7, 5), "ylim": (-6, 6.5)}


@cache
def hall() -> Recording:
    """Return the drive that is broken in so many ways."""
    return pfslam.load("hall")


def map_by_odometry(recording: Recording, inputs: Controls | None = None) -> OccupancyGrid:
    """Return the map of the half turn along dead reckoning, or along other controls."""
    odometry = dead_reckoning(recording) if inputs is None else integrate(inputs)
    part = faults.scans_between(recording, *TURNS)
    start = odometry.at(part.scans().t[0])
    return map_along(part, Trajectory(odometry.t, between(start, odometry.poses)), every=8)


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
    """Return (scale, delay) that explain corrections of the heading ``(K,)`` best, beside a bias.

    Stamps that are ``delay`` too late make odometry turn too far by ``delay`` times the change of the yaw rate.
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


def corrections(recording: Recording, seed: int = 0, every: int = 20) -> Corrections:
    """Run the refined filter with twenty particles and see where it disagrees with the odometry."""
    config = replace(SlamConfig.refined(), particles=20, every=every, tilt=False)
    path = run_slam(recording, config, rng=np.random.default_rng(seed), keep_particles=False).trajectory
    odometry = dead_reckoning(recording)
    step = between(odometry.at(path.t[:-1]), odometry.at(path.t[1:]))
    matched = between(path.poses[:-1], path.poses[1:])
    heading, shift = wrap_angle(matched[:, 2] - step[:, 2]), (matched - step)[:, :2]
    around = odometry.at(path.t + 0.02)[:, 2] - odometry.at(path.t - 0.02)[:, 2]
    change = np.diff(wrap_angle(around) / 0.04)
    scale, delay = correction_fit(step[:, 2], change, np.diff(path.t), heading)
    lever = lever_fit(step, step[:, 2], shift)
    ate = trajectory_error(path, recording.true_path()).ate_rmse_m
    return Corrections(step[:, 2], change, heading, shift, delay, scale, lever, ate)


def clock(broken: bool) -> Seen:
    """Stamp scans too late, and look at the corrections of the heading."""
    recording = faults.late_scans(hall(), DELAY) if broken else hall()
    c = corrections(faults.scans_between(recording, *BENDS))
    rest = np.rad2deg(c.heading - (c.scale - 1.0) * c.turn)
    panel = Panel("change of yaw rate [rad/s]", "heading corrected [deg]", dots=(c.rate_change, rest))
    panel = replace(panel, slope=-np.rad2deg(c.delay), limits={"ylim": (-16, 16)})
    return Seen(c.delay, Panel(grid=map_by_odometry(recording), limits=LIMITS), panel)


def lever_arm(broken: bool) -> Seen:
    """Take the LiDAR to be on the wrong side of the robot's centre, and look at corrections to the side."""
    recording = faults.lidar_at(hall(), MIRRORED_X, 0.0) if broken else hall()
    c = corrections(faults.scans_between(recording, *BENDS))
    dots, slope = (np.rad2deg(c.turn), 100 * c.shift[:, 1]), 100 * np.deg2rad(c.lever[0])
    panel = Panel("turn between scans [deg]", "moved sideways [cm]", dots=dots, slope=slope)
    symptom = Panel(grid=map_by_odometry(recording), limits=LIMITS)
    return Seen(float(c.lever[0]), symptom, replace(panel, limits={"ylim": (-20, 20)}))


# ---- one instrument against another


def headings(recording: Recording) -> np.ndarray:
    """Return heading (rad, unwrapped, from 0) that odometry adds up in the laboratory, 20 times a second."""
    theta = np.unwrap(dead_reckoning(recording).at(recording.scans().t[0] + np.arange(*LAB, 0.05))[:, 2])
    return theta - theta[0]


def turn_ratio(recording: Recording, reference: Recording) -> float:
    """Return how many times further a recording's heading turns than the reference's in the same time."""
    return float(np.polyfit(headings(reference), headings(recording), 1)[0])


def track(broken: bool) -> Seen:
    """Take the yaw rate from the wheels and the measured track."""
    recording = faults.heading_from_wheels(hall()) if broken else hall()
    gyro, used = (np.rad2deg(headings(r)) for r in (hall(), recording))
    ratio = turn_ratio(recording, hall())
    symptom = Panel(grid=map_by_odometry(recording), limits=LIMITS)
    return Seen(
        ratio, symptom, Panel("heading by gyro [deg]", "in use [deg]", dots=(gyro, used), slope=ratio)
    )


def ends_cut(recording: Recording) -> float:
    """Return the share of the scans whose missing beams are all the last ones: that is a renumbered scan."""
    valid = recording.robot.lidar.valid(recording.scans().ranges)
    missing = ~valid.all(axis=1)
    in_order = (np.diff(valid.astype(int), axis=1) <= 0).all(axis=1)
    return float(np.sum(in_order & missing) / max(1, missing.sum()))


def renumbered_beams(broken: bool) -> Seen:
    """Meet a pane of glass; drop what is invalid and number the rest."""
    glass = faults.glass_pane(hall(), *PANE)
    recording = faults.renumbered(glass) if broken else glass
    ranges = faults.scans_between(recording, *TURNS).scans().ranges[::8]
    scan, beam = np.nonzero(~recording.robot.lidar.valid(ranges))
    symptom = Panel(grid=map_by_odometry(recording), limits=LIMITS)
    return Seen(
        ends_cut(recording),
        symptom,
        Panel("beam without echo", "scan", dots=(beam, scan), limits={"xlim": (0, 1080)}),
    )


def distance_gap(recording: Recording, inputs: Controls) -> tuple[np.ndarray, np.ndarray]:
    """Return time (s after the first scan) and metres turned by the wheels less metres driven by the controls."""
    encoders, _ = recording.wheels_and_gyro()
    driven = np.concatenate([[0.0], np.cumsum(inputs.v * np.diff(inputs.t))])
    turned = wheel_distance(encoders, recording.robot.encoders, inputs.t)
    return inputs.t - recording.scans().t[0], turned - turned[0] - driven


def lost_second(broken: bool) -> Seen:
    """Lose the gyro for a second, and keep the old pose as long."""
    silent = faults.silent_gyro(hall(), *GAP)
    inputs = faults.skip_gaps(controls(silent)) if broken else controls(silent)
    t, lost = distance_gap(silent, inputs)
    some = (t > TURNS[0]) & (t < TURNS[1])
    symptom = Panel(grid=map_by_odometry(silent, inputs), limits=LIMITS)
    return Seen(lost[-1], symptom, Panel("time [s]", "wheels less path [m]", curve=(t[some], lost[some])))
