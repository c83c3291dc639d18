"""Tilt of the body: pitch and roll from gyro and accelerometer, for floors that are not flat.

The accelerometer measures which way is up, but also every push of the motors; the gyro measures how the body turns, but
drifts. A complementary filter takes the fast part from the gyro and the slow part from the accelerometer. The robot's
own acceleration, known from the wheels and the yaw rate, is subtracted first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.motion import Controls, controls
from pfslam.recording import Recording
from pfslam.sensors import STANDARD_GRAVITY

SPEED_SMOOTHING = 0.1
"""Time constant (s) of the speed whose change is taken out: whole wheel counts make the raw speed jump."""


TIME_CONSTANT = 2.0
"""Below this time (s) the gyro is trusted, above it the accelerometer."""
LEVEL_BELOW = float(np.deg2rad(2.5))
"""A smaller pitch or roll (rad) counts as level: on a flat floor the estimate sways by up to 2 degrees."""


@dataclass(frozen=True, eq=False)
class Tilt:
    """``pitch`` (positive nose down) and ``roll`` (positive right side down), each ``(K,)`` rad, at times ``t`` (s)."""

    t: np.ndarray
    pitch: np.ndarray
    roll: np.ndarray

    def at(self, t) -> np.ndarray:
        """Return pitch and roll ``(2,)`` at a time, ``(M, 2)`` at ``(M,)`` times, the nearest outside the gyro's."""
        return np.stack([np.interp(t, self.t, self.pitch), np.interp(t, self.t, self.roll)], axis=-1)


def standing_start(recording: Recording) -> np.ndarray:
    """Tell which IMU samples ``(K,)`` bool are of a standing start: from when on the wheels are known, until they move.

    A reading of the encoders tells of the time since the one before it, the first one of nothing. A start shorter than
    ``TIME_CONSTANT`` is none: for so long the accelerometer is not believed about what is level.
    """
    encoders, imu = recording.wheels_and_gyro()
    moving = np.flatnonzero(encoders.counts[1:].any(axis=1))
    still = (imu.t >= encoders.t[0]) & (imu.t <= encoders.t[moving[0] if len(moving) else -1])
    long_enough = still.any() and np.ptp(imu.t[still]) >= TIME_CONSTANT
    return still & long_enough


def estimate_tilt(recording: Recording, inputs: Controls | None = None) -> Tilt | None:
    """Estimate pitch and roll along a recording, 0 where below ``LEVEL_BELOW``; None without encoders and IMU.

    The tilt of the accelerometer's own axes and the bias of the gyro are taken from a standing start: the robot is
    supposed to stand on level ground then. Without one the bias is the median over the drive, most of which passes
    without pitching or rolling; the accelerometer is taken for level, and where the filter begins is what it shows in
    the first ``TIME_CONSTANT``. ``inputs`` are the recording's ``controls``, for callers that have them already.
    """
    if recording.imu is None or recording.encoders is None:
        return None
    inputs = controls(recording) if inputs is None else inputs
    _, imu = recording.wheels_and_gyro()
    dt = np.diff(imu.t, prepend=imu.t[0])
    speed = _smoothed(np.interp(imu.t, 0.5 * (inputs.t[1:] + inputs.t[:-1]), inputs.v), dt, SPEED_SMOOTHING)
    forward = np.divide(np.diff(speed, prepend=speed[0]), dt, out=np.zeros_like(dt), where=dt > 1e-3)
    sideways = speed * recording.robot.imu.yaw_rate(imu.angular_velocity)
    still = standing_start(recording)
    rates, felt = (recording.robot.imu.in_body(raw) for raw in (imu.angular_velocity, imu.acceleration_g))
    bias = rates[still].mean(axis=0) if still.any() else np.median(rates, axis=0)
    level = felt[still].mean(axis=0) if still.any() else np.zeros(3)
    gx, gy, gz = (felt - [level[0], level[1], 0.0]).T
    pitch_from_gravity = np.arctan2(-(gx - forward / STANDARD_GRAVITY), gz)
    roll_from_gravity = np.arctan2(gy - sideways / STANDARD_GRAVITY, gz)
    first = 0 if still.any() else int(np.searchsorted(imu.t, imu.t[0] + TIME_CONSTANT))
    pitch = _complementary(rates[:, 1] - bias[1], pitch_from_gravity, dt, first)
    roll = _complementary(rates[:, 0] - bias[0], roll_from_gravity, dt, first)
    tilted = [np.where(np.abs(angle) < LEVEL_BELOW, 0.0, angle) for angle in (pitch, roll)]
    return Tilt(imu.t, *tilted)


def _smoothed(values: np.ndarray, dt: np.ndarray, time_constant: float) -> np.ndarray:
    """Apply a first-order low pass that uses the past only, so that it could run on the robot."""
    result, state = np.empty_like(values), values[0]
    for k, (value, share) in enumerate(zip(values, np.minimum(1.0, dt / time_constant), strict=True)):
        state += share * (value - state)
        result[k] = state
    return result


def _complementary(rate: np.ndarray, measured: np.ndarray, dt: np.ndarray, first: int) -> np.ndarray:
    """Integrate ``rate`` (rad/s) to an angle that returns to ``measured`` (rad) with the time constant.

    It begins with the median of what the ``first`` samples say of the beginning; with none, at 0.
    """
    turned = rate * dt
    angle = float(np.median((measured - np.cumsum(turned))[:first])) if first else 0.0
    result = np.empty_like(rate)
    for k, share in enumerate(np.minimum(1.0, dt / TIME_CONSTANT)):
        angle = (1.0 - share) * (angle + turned[k]) + share * measured[k]
        result[k] = angle
    return result
