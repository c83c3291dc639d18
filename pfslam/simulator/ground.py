"""The ground: flat except for humps across corridors, one height model for robot, LiDAR and camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

WHEELBASE = 0.33  # front axle to rear axle (m)


@dataclass(frozen=True)
class Slope:
    """A hump that fills a corridor from wall to wall, its height piecewise linear along one axis."""

    axis: str
    sides: tuple[float, float]
    """How far it reaches on the other axis, from wall to wall (m)."""
    knots: tuple[float, ...]
    heights: tuple[float, ...]

    def mirrored(self) -> Slope:
        """Mirror the hump in y."""
        if self.axis == "x":
            return replace(self, sides=(-self.sides[1], -self.sides[0]))
        return replace(self, knots=tuple(-k for k in self.knots[::-1]), heights=self.heights[::-1])

    def may_be_seen(self, origin: np.ndarray, yaw: float) -> bool:
        """Return whether any corner lies in front of a camera that looks along ``yaw`` (rad), or just behind it."""
        corners = np.array([(u, v) for u in (self.knots[0], self.knots[-1]) for v in self.sides])
        corners = corners if self.axis == "x" else corners[:, ::-1]
        return bool(((corners - origin[:2]) @ [np.cos(yaw), np.sin(yaw)] > -0.5).any())

    def faces(self) -> list[tuple[float, float, float, float]]:
        """List the planes above the flat ground as (from, to, height at 0, slope) along the axis."""
        faces = []
        for (a, ha), (b, hb) in pairwise(zip(self.knots, self.heights, strict=True)):
            slope = (hb - ha) / (b - a)
            if ha or hb:
                faces.append((a, b, ha - slope * a, slope))
        return faces


def height(slopes: tuple[Slope, ...], points_p) -> np.ndarray:
    """Compute the height (m) of the ground at points ``(..., 2)`` of the plan frame."""
    points_p = np.asarray(points_p, dtype=float)
    z = np.zeros(points_p.shape[:-1])
    for slope in slopes:
        along, across = (points_p[..., k] for k in ((0, 1) if slope.axis == "x" else (1, 0)))
        inside = (across >= slope.sides[0]) & (across <= slope.sides[1])
        z = np.where(inside, np.maximum(z, np.interp(along, slope.knots, slope.heights)), z)
    return z


def stance(slopes: tuple[Slope, ...], poses_p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute height z (m), pitch and roll (rad), each ``(N,)``, of the robot at poses ``(N, 3)``.

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
    """Build body-to-world rotations ``(N, 3, 3)``: ``rotation_matrix`` for many poses at once."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def ground_in_view(slopes: Sequence[Slope], origin, direction) -> np.ndarray:
    """Compute the inverse of the t at which rays ``origin + t direction`` meet the ground, 0 where they never do.

    ``origin`` is x, y, z in the plan, three numbers or arrays; ``direction`` three arrays, and the result is like them.
    A plane's 1 / t is linear in the direction, which makes images fast. The plane z = 0 runs on below the humps, where
    a ray reaches a face first, so the nearest of all is right.
    """
    x, y, z = direction

    def like(value):
        return np.asarray(value, dtype=z.dtype)

    inverse = np.maximum(z * like(-1.0 / origin[2]), like(0.0))
    for slope in slopes:
        at, aside = origin[:2] if slope.axis == "x" else origin[1::-1]
        along, across = (x, y) if slope.axis == "x" else (y, x)
        for begin, end, base, rise in slope.faces():
            above = origin[2] - base - rise * at
            seen = above > 0.0  # else the ray begins behind this plane, which faces away
            face = (like(rise) * along - z) * like(1.0 / np.where(seen, above, np.inf))
            on = seen & (face > inverse)
            on &= (along >= face * like(begin - at)) & (along <= face * like(end - at))
            left, right = slope.sides
            on &= (across >= face * like(left - aside)) & (across <= face * like(right - aside))
            np.copyto(inverse, face, where=on)
    return inverse
