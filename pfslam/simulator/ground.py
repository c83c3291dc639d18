"""The ground: flat except for humps across corridors, one height model for robot, LiDAR and camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

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

    def along_across(self, points_p) -> tuple[np.ndarray, np.ndarray]:
        """Split points ``(..., 2)`` into their coordinates along the hump's axis and across it."""
        points_p = np.asarray(points_p)
        return (
            (points_p[..., 0], points_p[..., 1]) if self.axis == "x" else (points_p[..., 1], points_p[..., 0])
        )

    def faces(self) -> list[tuple[float, float, float, float]]:
        """List the planes above the flat ground as (from, to, height at 0, slope) along the axis."""
        faces = []
        for a, b, ha, hb in zip(
            self.knots[:-1], self.knots[1:], self.heights[:-1], self.heights[1:], strict=True
        ):
            slope = (hb - ha) / (b - a)
            if ha or hb:
                faces.append((a, b, ha - slope * a, slope))
        return faces


def height(slopes: tuple[Slope, ...], points_p) -> np.ndarray:
    """Compute the height (m) of the ground at points ``(..., 2)`` of the plan frame."""
    points_p = np.asarray(points_p, dtype=float)
    z = np.zeros(points_p.shape[:-1])
    for slope in slopes:
        along, across = slope.along_across(points_p)
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


def ground_distance(slopes: tuple[Slope, ...], origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Find t ``(...)`` so that ``origin + t direction``, both ``(..., 3)``, lies on the ground; infinity if never.

    The plane z = 0 runs on below the humps, where a ray reaches a face first, so the nearest of all is right.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        t = origin[..., 2] / -direction[..., 2]
        t = np.where(t > 0.0, t, np.inf)
        for slope in slopes:
            at, aside = slope.along_across(origin[..., :2])
            along, across = slope.along_across(direction[..., :2])
            for begin, end, base, rise in slope.faces():
                face = (base + rise * at - origin[..., 2]) / (direction[..., 2] - rise * along)
                u, v = at + face * along, aside + face * across
                on = (face > 0.0) & (u >= begin) & (u <= end) & (v >= slope.sides[0]) & (v <= slope.sides[1])
                t = np.where(on, np.minimum(t, face), t)
    return t


def ground_in_view(slopes: tuple[Slope, ...], origin: np.ndarray, yaw: float, ray: np.ndarray) -> np.ndarray:
    """Compute the inverse depth ``(H, W)`` float32 of the ground along camera rays ``(3, H, W)``.

    ``yaw`` turns the rays into the plan. The ground is that of ``ground_distance``; a plane's inverse depth is linear
    in the ray, which makes images fast.
    """
    inverse = ray[2] * np.float32(-1.0 / origin[2])
    np.maximum(inverse, np.float32(0.0), out=inverse)
    c, s = np.cos(yaw), np.sin(yaw)
    for slope in slopes:
        if not _may_be_seen(slope, origin, (c, s)):
            continue
        at, aside = slope.along_across(origin[:2])
        ways = (
            np.float32(c) * ray[0] - np.float32(s) * ray[1],
            np.float32(s) * ray[0] + np.float32(c) * ray[1],
        )
        along, across = ways if slope.axis == "x" else ways[::-1]
        for begin, end, base, rise in slope.faces():
            above = origin[2] - base - rise * at
            if above <= 0.0:  # the camera is behind this plane, which faces away
                continue
            face = (np.float32(rise) * along - ray[2]) * np.float32(1.0 / above)
            first, last = face * np.float32(begin - at), face * np.float32(end - at)
            on = (face > inverse) & (along >= first) & (along <= last)
            left, right = face * np.float32(slope.sides[0] - aside), face * np.float32(slope.sides[1] - aside)
            on &= (across >= left) & (across <= right)
            np.copyto(inverse, face, where=on)
    return inverse


def _may_be_seen(slope: Slope, origin: np.ndarray, ahead: tuple[float, float]) -> bool:
    """Return whether any corner of a hump lies in front of the camera, or just behind it."""
    ends = [(u, v) for u in (slope.knots[0], slope.knots[-1]) for v in slope.sides]
    corners = np.array(ends) if slope.axis == "x" else np.array(ends)[:, ::-1]
    return bool((((corners - origin[:2]) @ np.array(ahead)) > -0.5).any())
