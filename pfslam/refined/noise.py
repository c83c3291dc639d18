"""Noise whose size follows from the motion, and a cloud that is moved by it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pfslam.events import ScanEvent
from pfslam.particles import ControlNoise, Particles, predict
from pfslam.poses import compose, wrap_angle
from pfslam.settings import Range, Settings

NoiseSize = Annotated[float, Range(0.0, 100.0)]


@dataclass(frozen=True)
class MotionNoise(Settings):
    """Noise on the motion between two scans, whose size grows with the metres moved and the radians turned."""

    xy: NoiseSize = 0.02
    xy_per_metre: NoiseSize = 0.08
    yaw: NoiseSize = 0.005
    yaw_per_radian: NoiseSize = 0.05
    yaw_per_metre: NoiseSize = 0.06
    sampled: bool = True
    """Whether particles are moved by noise of this size. If not, it only sets the search window and the prior."""

    def sigmas(self, metres: float, radians: float) -> tuple[float, float]:
        """Return the standard deviations (m, rad) of position (each axis) and heading."""
        return (
            self.xy + self.xy_per_metre * metres,
            self.yaw + self.yaw_per_radian * radians + self.yaw_per_metre * metres,
        )


def predicted(
    particles: Particles, event: ScanEvent, noise: MotionNoise | ControlNoise, rng: np.random.Generator
) -> tuple[Particles, np.ndarray]:
    """Move every particle by an event, each with noise of its own; weights stay (Eq. 11).

    With ``ControlNoise`` each control is noisy, as in the report; with ``MotionNoise`` the whole motion once. Also
    returns the variance ``(2,)`` (m^2, rad^2) that the noise adds to the position, along each axis, and to the heading.
    """
    if isinstance(noise, ControlNoise):
        for v, omega, dt in zip(*event.controls, strict=True):
            particles = predict(particles, v, omega, dt, noise, rng)
        steps = event.controls[2]
        spread = np.sum(steps) if noise.per_root_second else np.sum(steps**2)
        return particles, np.array([noise.sigma_v, noise.sigma_omega]) ** 2 * spread
    sigma_xy, sigma_yaw = noise.sigmas(float(np.hypot(*event.motion[:2])), abs(float(event.motion[2])))
    sigmas = np.array([sigma_xy, sigma_xy, sigma_yaw])
    drawn = sigmas * rng.standard_normal((len(particles), 3)) if noise.sampled else np.zeros(3)
    moved = Particles(compose(particles.poses, event.motion + drawn), particles.log_weights)
    return moved, np.array([sigma_xy, sigma_yaw]) ** 2


def shifted(particles: Particles, step: np.ndarray) -> Particles:
    """Return a cloud moved as a whole by ``step (3,)`` (m, m, rad), weights unchanged."""
    poses = particles.poses + step
    poses[:, 2] = wrap_angle(poses[:, 2])
    return Particles(poses, particles.log_weights)
