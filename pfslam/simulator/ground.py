"""The ground: flat, but for humps that cross a corridor. One height model for robot, LiDAR and camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


WHEELBASE = 0.33  # front axle to rear axle (m)


@dataclass(frozen=True)
class Slope:
    """A hump across a corridor, between its walls: height over one axis is piecewise linear through the knots."""

    axis: str
    sides: tuple[float, float]
    """The corridor's walls on the other axis (m)."""
    knots: tuple[float, ...]
    heights: tuple[float, ...]

    def mirrored(self) -> Slope:
        if self.axis == "x":
            return replace(self, sides=(-self.sides[1], -self.sides[0]))
        return replace(self, knots=tuple(-k for k in self.knots[::-1]), heights=self.heights[::-1])

    def along_across(self, points_p) -> tuple[np.ndarray, np.ndarray]:
        """The two coordinates of points ``(..., 2)``: along the hump's axis, and across it."""
        points_p = np.asarray(points_p)
        return (points_p[..., 0], points_p[..., 1]) if self.axis == "x" else (points_p[..., 1], points_p[..., 0])

    def faces(self) -> list[tuple[float, float, float, float]]:
        """The planes (from, to, height at 0, slope) over the axis that rise above the flat ground."""
        faces = []
        for a, b, ha, hb in zip(self.knots[:-1], self.knots[1:], self.heights[:-1], self.heights[1:], strict=True):
            slope = (hb - ha) / (b - a)
            if ha or hb:
                faces.append((a, b, ha - slope * a, slope))
        return faces


def height(slopes: tuple[Slope, ...], points_p) -> np.ndarray:
    """Height (m) of the ground at points ``(..., 2)`` of the plan frame."""
    points_p = np.asarray(points_p, dtype=float)
    z = np.zeros(points_p.shape[:-1])
    for slope in slopes:
        along, across = slope.along_across(points_p)
        inside = (across >= slope.sides[0]) & (across <= slope.sides[1])
        z = np.where(inside, np.maximum(z, np.interp(along, slope.knots, slope.heights)), z)
    return z


def stance(slopes: tuple[Slope, ...], poses_p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How the robot stands at poses ``(N, 3)``: height z (m), pitch and roll (rad), each ``(N,)``.

    It rests on its axles, half a wheelbase before and behind the centre, and on wheels as far apart sideways.
    Positive pitch is nose down.
    """
    if not slopes:
        zero = np.zeros(len(poses_p))
        return zero, zero, zero
    ahead = 0.5 * WHEELBASE * np.stack([np.cos(poses_p[:, 2]), np.sin(poses_p[:, 2])], axis=-1)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    here = poses_p[:, :2]
    front, rear, left, right = (height(slopes, here + step) for step in (ahead, -ahead, aside, -aside))
    pitch = -np.arctan((front - rear) / WHEELBASE)
    roll = np.arctan((left - right) / WHEELBASE * np.cos(pitch))
    return 0.5 * (front + rear), pitch, roll


def rotations(roll: np.ndarray, pitch: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Body-to-world rotations ``(N, 3, 3)``: the one of ``rotation_matrix`` for many poses at once."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
