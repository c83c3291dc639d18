"""How the robot moved: encoders and gyro to controls, the motion model, and dead reckoning.

The wheels give distance, the gyro gives turning. Distance is cumulated first and interpolated at the gyro's stamps,
so that no count is lost or used twice, whatever the clock does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import Trajectory, between, wrap_angle
from pfslam.recording import Encoders, Recording
from pfslam.sensors import EncoderModel


@dataclass(frozen=True, eq=False)
class Controls:
    """The control inputs u_t of the report: from ``t[k]`` to ``t[k + 1]`` the robot moved at ``v[k]``, ``omega[k]``.

    ``t (K + 1,)`` s, ``v (K,)`` m/s, ``omega (K,)`` rad/s.
    """

    t: np.ndarray
    v: np.ndarray
    omega: np.ndarray

    def during(self, start: float, stop: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ``(v, omega, dt)`` between two times, each ``(n,)``; the intervals at both ends are cut to fit."""
        first = max(int(np.searchsorted(self.t, start, side="right")) - 1, 0)
        last = int(np.searchsorted(self.t, stop, side="left"))
        edges = np.clip(self.t[first : last + 1], start, stop)
        return self.v[first:last], self.omega[first:last], np.diff(edges)


def wheel_distance(encoders: Encoders, model: EncoderModel, t) -> np.ndarray:
    """Add up the distance (m) of the chassis centre since the first reading, at times ``t (K,)``.

    The mean of the four wheels, cumulated, then interpolated. A time outside the encoders' own raises ``DataError``.
    """
    t = np.asarray(t, dtype=float)
    if len(t) and (t[0] < encoders.t[0] or t[-1] > encoders.t[-1]):
        raise DataError(
            "wheel_distance",
            "t",
            f"[{t[0]:.3f}, {t[-1]:.3f}] s",
            f"times in [{encoders.t[0]:.3f}, {encoders.t[-1]:.3f}] s",
        )
    per_reading = encoders.counts.mean(axis=1) * model.metres_per_count
    travelled = np.cumsum(per_reading) - per_reading[0]
    return np.interp(t, encoders.t, travelled)


def wheel_speed(encoders: Encoders, model: EncoderModel, t) -> np.ndarray:
    """Return the mean speed ``(K - 1,)`` in m/s between consecutive times ``t (K,)``. Implements Eq. 19.

    The report's sum(C) / 4 * l is a distance per reading; here it is cumulated and divided by the true interval.
    """
    return np.diff(wheel_distance(encoders, model, t)) / np.diff(t)


def controls(recording: Recording) -> Controls:
    """Derive the control inputs of a recording: one per gyro sample, or one per step of a log's odometry.

    A gyro sample stands for the interval that ends at its stamp. Gyro samples outside the encoders' time are not used,
    because the distance is not known there.
    """
    if recording.odometry is not None:
        t, poses = recording.odometry.t, recording.odometry.poses
        step = between(poses[:-1], poses[1:])
        return Controls(t, step[:, 0] / np.diff(t), step[:, 2] / np.diff(t))
    encoders, imu = recording.wheels_and_gyro()
    inside = (imu.t >= encoders.t[0]) & (imu.t <= encoders.t[-1])
    if np.count_nonzero(inside) < 2:
        raise DataError(
            recording.name,
            "imu time_stamps",
            f"{np.count_nonzero(inside)} of {len(inside)} samples within the encoders' time",
            "two or more: the streams must overlap",
        )
    t, robot = imu.t[inside], recording.robot
    omega = robot.imu.yaw_rate(imu.angular_velocity[inside])
    return Controls(t, wheel_speed(encoders, robot.encoders, t), omega[1:])


def motion_model(poses: np.ndarray, v, omega, dt) -> np.ndarray:
    """Move poses ``(..., 3)`` for ``dt`` s at ``v`` m/s and ``omega`` rad/s, Euler step. Implements Eq. 1, 3, 5.

    ``v`` and ``omega`` are scalars or one per pose. With noisy controls the result is a draw from the model's density.

    >>> motion_model(np.zeros(3), v=1.0, omega=0.5, dt=0.1).round(3).tolist()
    [0.1, 0.0, 0.05]
    """
    theta = poses[..., 2]
    x = poses[..., 0] + dt * v * np.cos(theta)
    y = poses[..., 1] + dt * v * np.sin(theta)
    return np.stack([x, y, wrap_angle(theta + dt * omega)], axis=-1)


def motion_model_arc(poses: np.ndarray, v, omega, dt) -> np.ndarray:
    """Move poses along the exact arc of constant ``v`` and ``omega``; equals the Euler step as dt goes to 0.

    >>> motion_model_arc(np.zeros(3), v=1.0, omega=np.pi / 2, dt=2.0).round(3).tolist()  # half a circle
    [0.0, 1.273, 3.142]
    """
    half = 0.5 * dt * np.asarray(omega, dtype=float)
    chord = dt * v * np.sinc(half / np.pi)  # NumPy's sinc(x) is sin(pi x) / (pi x)
    direction = poses[..., 2] + half
    x = poses[..., 0] + chord * np.cos(direction)
    y = poses[..., 1] + chord * np.sin(direction)
    return np.stack([x, y, wrap_angle(poses[..., 2] + 2.0 * half)], axis=-1)


def integrate(controls: Controls, start=(0.0, 0.0, 0.0), model=motion_model) -> Trajectory:
    """Apply the motion model, control after control, from pose ``start``, at the controls' own times."""
    poses = np.empty((len(controls.t), 3))
    poses[0] = start
    # The headings do not depend on the positions: sum them first, then take every step at once from the origin.
    turned = np.concatenate([[0.0], np.cumsum(controls.omega * np.diff(controls.t))])
    poses[:, 2] = start[2] + turned
    at_origin = np.column_stack([np.zeros((len(controls.v), 2)), poses[:-1, 2]])
    steps = model(at_origin, controls.v, controls.omega, np.diff(controls.t))[:, :2]
    poses[1:, :2] = poses[0, :2] + np.cumsum(steps, axis=0)
    return Trajectory(controls.t, poses)


def dead_reckoning(recording: Recording, inputs: Controls | None = None) -> Trajectory:
    """Integrate wheels and gyro as if they were free of errors, from (0, 0, 0): Eq. 5 without noise.

    A log that holds odometry poses returns those, moved to start at the origin. ``inputs`` are the recording's
    ``controls``, for callers that have them already.
    """
    if (odometry := recording.odometry) is not None:
        return Trajectory(odometry.t, between(odometry.poses[0], odometry.poses))
    return integrate(controls(recording) if inputs is None else inputs)
