"""Encoders, gyro and accelerometer: what they report of the true drive."""

from __future__ import annotations

import numpy as np

from pfslam.recording import Encoders, Imu
from pfslam.sensors import STANDARD_GRAVITY
from pfslam.simulator.clocks import ENCODER_CLOCK, IMU_CLOCK, ticks_and_stamps, unix
from pfslam.simulator.config import SimulatorConfig
from pfslam.simulator.drive import TIME_STEP, Drive, episodes, turned
from pfslam.simulator.ground import rotations

# Three equal low-pass stages give the gyro's noise its memory: 0.90, 0.70 and 0.21 after 1, 2 and 5 samples.
GYRO_POLE, GYRO_STAGES = 0.48, 3
ACCELEROMETER_WINDOW = 0.40  # s
WARM_UP = 0.5  # s
SLIP_LASTS = (0.3, 0.8)  # s


def encoder_counts(
    drive: Drive, config: SimulatorConfig, rng: np.random.Generator, slips: np.random.Generator
) -> Encoders:
    """Simulate the counts of the four wheels; each carries its fraction of a count over to the next reading.

    Moments of slip have random numbers of their own, ``slips``.
    """
    t, stamps = ticks_and_stamps(ENCODER_CLOCK, 0.0, drive.duration, rng, config.timing.jitter)
    slip, yaw = config.slip, turned(drive)
    rate = np.abs(np.gradient(yaw, TIME_STEP))
    loss = slip.straight + slip.turning * rate + slip.wander * _slow_noise(drive, rng)
    middle = np.concatenate([[0.0], np.cumsum(np.diff(drive.travelled) * (1.0 + loss[1:]))])
    uneven = np.cumsum(
        np.concatenate([[0.0], np.diff(drive.travelled)]) * slip.wander * _slow_noise(drive, rng)
    )
    half = 0.5 * slip.effective_track * yaw
    right, left = middle + half + uneven, middle - half - uneven
    tyres = 1.0 + 0.1 * slip.wander * rng.uniform(-1.0, 1.0, 4)
    rolled = np.stack([right, left, right, left]) * tyres[:, None] / slip.true_metres_per_count
    for begin, end in episodes(config.hazards.slip, SLIP_LASTS, drive.duration, config.timing, slips):
        during = (drive.t > begin) & (drive.t <= end)
        lost_or_doubled = slips.choice([-1.0, 1.0]) * during * np.diff(rolled, prepend=rolled[:, :1])
        rolled = rolled + np.cumsum(lost_or_doubled, axis=1)
    turns = np.stack([np.interp(t, drive.t, wheel) for wheel in rolled], axis=1)
    start = turns[0]
    counts = np.diff(np.floor(turns - start + rng.random(4)) if config.quantised else turns - start, axis=0)
    counts = np.vstack([np.zeros(4), counts])
    return Encoders(unix(stamps, config.quantised), counts.astype(np.int16) if config.quantised else counts)


def imu_samples(drive: Drive, config: SimulatorConfig, rng: np.random.Generator) -> Imu:
    """Simulate angular velocity and acceleration in the body's axes; a gyro sample is the mean rate since the last."""
    begin, end = config.timing.imu
    t, stamps = ticks_and_stamps(IMU_CLOCK, begin, drive.duration + end, rng, config.timing.jitter)
    rate = _body_rates(drive, t) / config.gyro.scale
    speed = np.interp(t, drive.t, np.gradient(drive.travelled, TIME_STEP))
    rate += config.gyro.bias + config.gyro.noise * np.column_stack(
        [_gyro_noise(len(t), rng) for _ in range(3)]
    )
    rate[:, 2] += config.gyro.warm_up * 2.0 * np.exp(-(t - t[0]) / WARM_UP)
    rate[:, :2] += (
        config.gyro.sway * speed[:, None] * np.column_stack([_shaking(len(t), rng) for _ in range(2)])
    )
    force = _specific_force_g(drive, t) + config.gyro.acceleration_bias_g
    force += config.gyro.acceleration_noise_g * rng.standard_normal(force.shape)
    shake = np.column_stack([_shaking(len(t), rng) for _ in range(3)]) * [1.0, 1.0, 0.3]
    force += config.gyro.acceleration_sway_g * speed[:, None] * shake
    if config.quantised:
        rate, force = np.round(rate, 6), np.round(force, 6)
    return Imu(unix(stamps, config.quantised), rate, force)


def _body_rates(drive: Drive, t: np.ndarray) -> np.ndarray:
    """Average the body's angular velocity between consecutive times, ``(K, 3)`` rad/s, the first twice."""
    yaw, pitch, roll = (np.interp(t, drive.t, angle) for angle in (turned(drive), drive.pitch, drive.roll))
    dt = np.diff(t)
    dyaw, dpitch, droll = (np.diff(angle) / dt for angle in (yaw, pitch, roll))
    p, r = 0.5 * (pitch[1:] + pitch[:-1]), 0.5 * (roll[1:] + roll[:-1])
    about_x = droll - dyaw * np.sin(p)
    about_y = dpitch * np.cos(r) + dyaw * np.cos(p) * np.sin(r)
    about_z = -dpitch * np.sin(r) + dyaw * np.cos(p) * np.cos(r)
    rates = np.column_stack([about_x, about_y, about_z])
    return np.vstack([rates[:1], rates])


def _specific_force_g(drive: Drive, t: np.ndarray) -> np.ndarray:
    """Compute what an accelerometer at the body's origin measures, ``(K, 3)`` g: acceleration minus gravity."""
    position = np.column_stack([drive.poses[:, :2], drive.z])
    velocity = np.gradient(position, TIME_STEP, axis=0)
    acceleration = np.gradient(velocity, TIME_STEP, axis=0) / STANDARD_GRAVITY + [0.0, 0.0, 1.0]
    rotation = rotations(drive.roll, drive.pitch, drive.poses[:, 2])
    force = np.einsum("kji,kj->ki", rotation, acceleration)
    window = np.hanning(int(ACCELEROMETER_WINDOW / TIME_STEP) + 1)
    padded = np.pad(force, ((len(window) // 2, len(window) // 2), (0, 0)), mode="edge")
    smooth = [np.convolve(padded[:, axis], window / window.sum(), mode="valid") for axis in range(3)]
    return np.column_stack([np.interp(t, drive.t, axis) for axis in smooth])


def _gyro_noise(count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw noise ``(count,)`` of unit variance, smoothed as by the gyro's low-pass filter."""
    stage = GYRO_POLE ** np.arange(24)
    response = np.ones(1)
    for _ in range(GYRO_STAGES):
        response = np.convolve(response, stage)
    response /= np.sqrt((response**2).sum())
    return np.convolve(rng.standard_normal(count + len(response) - 1), response, mode="valid")


def _shaking(count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw swaying ``(count,)`` of unit variance at a few hertz."""
    window = np.hanning(24)
    return np.convolve(rng.standard_normal(count + 23), window / np.sqrt((window**2).sum()), mode="valid")


def _slow_noise(drive: Drive, rng: np.random.Generator) -> np.ndarray:
    """Draw a slowly changing number of about unit variance: one draw per metre of the drive, interpolated."""
    knots = np.arange(int(drive.travelled[-1]) + 2)
    return np.interp(drive.travelled, knots, rng.standard_normal(len(knots)))
