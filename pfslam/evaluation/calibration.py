"""Self-calibration: bias and scale errors of the instruments, estimated from the drive itself.

The yaw rate that a gyro shows while the robot stands is its bias. Afterwards the matched
motion, which is right to centimetres thanks to the walls, is compared with the odometry: it gives the scale of the
wheels, and scale and drift of the gyro, by the least squares of ``mounting``. Nothing is applied unless
``apply_calibration`` is called.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pfslam.errors import DataError
from pfslam.evaluation.mounting import Drive
from pfslam.motion import dead_reckoning
from pfslam.poses import between
from pfslam.recording import Recording
from pfslam.run import SlamResult

WINDOW = 1.0
"""Length (s) of the pieces in which stillness is checked: long against the gyro's memory of a few samples."""
MARGIN = 0.25
"""The wheels must also have stood still for this long (s) before and after a piece."""
WARM_UP = 1.0
"""The first second of a gyro is left out: real ones, and the simulated, start up to 0.002 rad/s off."""
BLOCK, LEAST_BLOCKS = 1.0, 10
"""Seconds of matched motion compared at a time: a metre of driving against centimetres of error; and how many."""
LEAST_WINDOWS = 3
LEAST_SAMPLES = 10
LARGEST_BIAS = 0.05
"""A steady rate above this (rad/s) means that the robot is being turned: no gyro has such a bias."""
SHAKEN = 3.0
"""A piece counts as shaken if the gyro spreads this many times more than in the quietest piece."""
SPREAD_FLOOR = 1e-4
"""Spread (rad/s) below which every gyro is quiet."""


@dataclass(frozen=True)
class Calibration:
    """What a drive says about its own instruments, each value with its standard error and the data behind it.

    ``gyro_bias`` (rad/s) is what the gyro shows at rest, ``drive_bias`` what it shows too much over the whole drive: a
    real gyro's bias moves when the robot does. ``wheel_scale`` is the true way over the way of the wheels,
    ``gyro_scale`` the true angle over the gyro's, bias taken off: both relative to the recording's own robot. What
    could not be estimated keeps the robot's value with an infinite error.
    """

    gyro_bias: float
    gyro_bias_error: float
    still_seconds: float
    drive_bias: float
    drive_bias_error: float
    gyro_scale: float
    gyro_scale_error: float
    wheel_scale: float
    wheel_scale_error: float


def calibrate(recording: Recording, result: SlamResult | None = None) -> Calibration:
    """Estimate bias from the still stretches; with the ``result`` of a run also drift and scales, from its motion."""
    gyro, values, errors = recording.robot.imu, np.array([1.0, 0.0, 0.0, 1.0]), np.full(4, np.inf)
    t0, t1, moves = matched_motion(recording, result) if result is not None else (values[:0],) * 3
    if len(t0) >= LEAST_BLOCKS:
        drive = Drive.of(dead_reckoning(recording), t0, t1)
        # The estimate is of the body itself: on a circle, another place of the LiDAR would explain any scale of wheels.
        here = np.append(values, np.zeros(3))
        found, error = (v[:4] for v in drive.fit(here, moves, np.zeros((3, 3)), known=slice(4, 7)))
        error[:2] = np.inf if drive.turns_at_one_rate(LEAST_WINDOWS) else error[:2]
        values, errors = np.where(error < 1.0, [found, error], [values, errors])
    (turns, drift, _, ways), (error_turns, error_drift, _, error_ways) = values.tolist(), errors.tolist()
    shown = gyro.gyro_scale * turns
    bias = gyro.gyro_bias - drift / shown, error_drift / abs(shown)
    return Calibration(*gyro_bias(recording), *bias, turns, error_turns, ways, error_ways)


def apply_calibration(recording: Recording, calibration: Calibration) -> Recording:
    """Return the same readings, with a robot whose wheels and gyro are as the calibration says.

    The bias over the drive is taken where it is known, else that at rest.
    """
    wheels, gyro = recording.robot.encoders, recording.robot.imu
    wheels = replace(wheels, metres_per_count=wheels.metres_per_count * calibration.wheel_scale)
    bias = calibration.drive_bias if np.isfinite(calibration.drive_bias_error) else calibration.gyro_bias
    gyro = replace(gyro, gyro_bias=bias, gyro_scale=gyro.gyro_scale * calibration.gyro_scale)
    return replace(recording, robot=replace(recording.robot, encoders=wheels, imu=gyro))


def gyro_bias(recording: Recording) -> tuple[float, float, float]:
    """Estimate the yaw rate at rest (rad/s), its standard error, and the seconds of stillness behind it.

    The mean over pieces of a second; their own spread gives the error, so the gyro's coloured noise counts in full.
    """
    _, imu = recording.wheels_and_gyro()
    shown = recording.robot.imu.in_body(imu.angular_velocity)[:, 2]
    rates = np.array([shown[piece].mean() for piece in still_pieces(recording)])
    if len(rates) < LEAST_WINDOWS:
        return recording.robot.imu.gyro_bias, np.inf, len(rates) * WINDOW
    return float(rates.mean()), float(rates.std(ddof=1) / np.sqrt(len(rates))), len(rates) * WINDOW


def still_pieces(recording: Recording) -> list[slice]:
    """Find the gyro samples, as slices of one second each, during which the robot stood.

    No wheel counts then, nor just before or after; the gyro shows no steady turning; and it spreads, about each axis,
    hardly more than in the quietest such piece. So a robot that is pushed, carried or shaken does not count.
    """
    encoders, imu = recording.wheels_and_gyro()
    begin = max(encoders.t[0], imu.t[0] + WARM_UP - MARGIN)
    moved = encoders.t[encoders.counts.any(axis=1)]
    moved = np.concatenate([[begin], moved[moved > begin], encoders.t[-1:]])
    candidates = []
    for k in np.flatnonzero(np.diff(moved) > WINDOW + 2 * MARGIN):
        first, last = np.searchsorted(imu.t, [moved[k] + MARGIN, moved[k + 1] - MARGIN])
        candidates += [slice(first + i, first + j) for i, j in _whole_pieces(imu.t[first:last], WINDOW)]
    pieces = [piece for piece in candidates if piece.stop - piece.start >= LEAST_SAMPLES]
    shown = recording.robot.imu.in_body(imu.angular_velocity)
    spread = np.array([shown[piece].std(axis=0) for piece in pieces]).reshape(-1, 3)
    if not len(pieces):
        return []
    quiet = (spread <= SHAKEN * np.maximum(spread.min(axis=0), SPREAD_FLOOR)).all(axis=1)
    rate = np.array([shown[piece, 2].mean() for piece in pieces])
    return [piece for piece, ok in zip(pieces, quiet & (np.abs(rate) < LARGEST_BIAS), strict=True) if ok]


def _whole_pieces(t: np.ndarray, length: float) -> list[tuple[int, int]]:
    """Divide times ``t (K,)`` into pieces of ``length`` s, as index pairs (i, j); the last, cut short, is left out."""
    if not len(t):
        return []
    edges = np.flatnonzero(np.diff(np.floor((t - t[0]) / length))) + 1
    return list(pairwise([0, *edges.tolist()]))


def matched_motion(recording: Recording, result: SlamResult) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return begin and end ``(B,)`` (s) of blocks of a second, and the estimated motion ``(B, 3)`` in each.

    Only blocks count in which every scan was matched and no direction was left to odometry: where the map says
    nothing, the estimate is the odometry, and comparing the two would prove whatever one likes.
    """
    path, scans = result.trajectory, len(result.config.used_scans(recording).motion)
    if scans != len(result.infos):
        raise DataError(
            "calibrate", "result", f"{len(result.infos)} scans", f"the run of this recording: {scans}"
        )
    usable = np.array([info.matched and info.silent_direction is None for info in result.infos])
    blocks = [(i, j) for i, j in _whole_pieces(path.t, BLOCK) if usable[i + 1 : j + 1].all()]
    i, j = np.array(blocks, dtype=int).reshape(-1, 2).T
    return path.t[i], path.t[j], between(path.poses[i], path.poses[j])
