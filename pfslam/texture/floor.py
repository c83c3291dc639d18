"""From one depth image to points on the floor: the report's texture pipeline, steps 1 to 5, as functions.

Pixels are (u, v): column and row. Frames: o optical (x right, y down, z forward), b body, w world. Angles in
radians, lengths in metres. An invalid reading is NaN from the first function on; every mask is False there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pfslam.poses import apply_transform, pose_to_transform
from pfslam.sensors import RgbdModel

NO_READING = 2047
"""The disparity that the depth camera reports where it saw nothing."""
MAX_SLOPE = 0.4
"""The steepest floor, as rise over run, that is still looked for."""


def inverse_depth(disparity, camera: RgbdModel) -> np.ndarray:
    """The report's dd = -0.00304 d + 3.31, any shape; a point lies 1.03 / dd metres away."""
    return camera.disparity_slope * np.asarray(disparity, dtype=float) + camera.disparity_offset


def depth_from_disparity(disparity, camera: RgbdModel) -> np.ndarray:
    """Depth Z_o = 1.03 / dd in metres, any shape; NaN where there is no reading. The depth of Eq. 17.

    No reading is dd <= 0 (a disparity of 1089 or more), the value 2047, and NaN.
    """
    dd = inverse_depth(disparity, camera)
    measured = (dd > 0) & (np.asarray(disparity) != NO_READING)
    return np.divide(camera.depth_scale, dd, out=np.full(dd.shape, np.nan), where=measured)


def disparity_from_depth(depth, camera: RgbdModel) -> np.ndarray:
    """The disparity that a point at ``depth`` metres would show (not rounded): the inverse of the above."""
    return (camera.depth_scale / np.asarray(depth) - camera.disparity_offset) / camera.disparity_slope


def disparity_from_depth_image(depth, camera: RgbdModel) -> np.ndarray:
    """The disparity ``(H, W)`` uint16 of an image of depths in metres, in whole steps.

    Where there is no depth (0, infinity or NaN), or none that 16 bits can tell, it shows that there is no reading.
    """
    seen = np.isfinite(depth) & (np.asarray(depth) > 0)
    steps = np.round(disparity_from_depth(np.where(seen, depth, np.inf), camera))
    steps[steps == NO_READING] += 1
    return np.where(seen & (steps >= 0) & (steps < 2**16), steps, NO_READING).astype(np.uint16)


def depth_step(depth, camera: RgbdModel) -> np.ndarray:
    """By how many metres the depth changes for one step of disparity: it grows as depth squared."""
    return np.asarray(depth) ** 2 * abs(camera.disparity_slope) / camera.depth_scale


def depth_for_step(step: float, camera: RgbdModel) -> float:
    """The depth (m) at which one step of disparity is worth ``step`` metres."""
    return float(np.sqrt(step * camera.depth_scale / abs(camera.disparity_slope)))


def associate_rgb(u, v, disparity, camera: RgbdModel) -> tuple[np.ndarray, np.ndarray]:
    """Colour pixel (u_rgb, v_rgb), not rounded, of depth pixel (u, v), any shape. Implements Eq. 16 (step 1).

    The two cameras sit side by side, so the shift in u depends on how far the point is. Written out, this is
    a second pinhole camera: focal length 526.37 px, principal point (317.1, 247.1), 26 mm to the side.
    """
    dd = inverse_depth(disparity, camera)
    u_rgb = camera.rgb_focal * np.asarray(u) + camera.rgb_baseline * dd + camera.rgb_offset_u
    v_rgb = camera.rgb_focal * np.asarray(v) + camera.rgb_offset_v
    return u_rgb / camera.rgb_divisor, v_rgb / camera.rgb_divisor


def back_project(u, v, depth, K: np.ndarray) -> np.ndarray:
    """Optical points ``(M, 3)`` of pixels u, v ``(M,)`` at depth ``(M,)`` m. Implements Eq. 17 (step 2).

    ``K`` is ``RgbdModel.K``. The report prints its two centres swapped; they belong in (u, v) order.

    >>> K = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
    >>> back_project(320.0, 240.0, 2.0, K).tolist()  # the principal point lies straight ahead
    [[0.0, 0.0, 2.0]]
    """
    u, v, depth = np.atleast_1d(u), np.atleast_1d(v), np.atleast_1d(depth)
    pixels = np.stack([u, v, np.ones(u.shape)])
    return (np.linalg.inv(K) @ pixels).T * depth[:, None]


def depth_mask(depth, z_min: float, z_max: float) -> np.ndarray:
    """Which depths to trust: Z_MIN <= Z_o <= Z_MAX, and never NaN. Implements step 3.

    >>> depth_mask(np.array([0.05, 2.0, np.nan]), 0.1, 10.0).tolist()
    [False, True, False]
    """
    return (depth >= z_min) & (depth <= z_max)


def to_world(points_o, pose_w, camera: RgbdModel, z: float = 0.0, pitch: float = 0.0) -> np.ndarray:
    """Points ``(M, 3)`` of the optical frame, in the world. Implements Eq. 18 (step 4).

    T_wo = T_wb T_bc T_co: ``pose_w (3,)`` gives T_wb, with the body's height ``z`` and ``pitch`` on a slope;
    the mounting of the camera gives T_bc; the change of axes T_co is fixed.
    """
    return apply_transform(pose_to_transform(pose_w, z, pitch) @ camera.T_bo, points_o)


def floor_mask(points_w, tolerance: float, tolerance_per_metre: float = 0.0, distance=0.0) -> np.ndarray:
    """Which points ``(M, 3)`` lie on the floor: ``|Z_w| <= tolerance``, bool ``(M,)``. Implements step 5.

    With ``tolerance_per_metre`` the tolerance grows with ``distance (M,)`` (m): an error in pitch lifts a far
    point more than a near one, 17 mm per metre and degree.

    >>> floor_mask(np.array([[1.0, 0.0, 0.004], [1.0, 0.0, 0.2]]), tolerance=0.01).tolist()
    [True, False]
    """
    return np.abs(points_w[:, 2]) <= tolerance + tolerance_per_metre * np.asarray(distance)


def nearest_floor(camera: RgbdModel) -> float:
    """How far ahead of the camera (m) the floor enters the image.

    The lowest row looks down by the pitch plus half the field of view; the floor is at height / tan(angle). A robot
    that turns on the spot sees no floor within this distance plus that of the camera from the turning point.
    """
    angle = camera.pitch + np.arctan((camera.height - 0.5 - camera.centre_v) / camera.focal_v)
    return float(camera.position_b[2] / np.tan(angle))


class FloorPlane(NamedTuple):
    """The floor as a camera saw it, in the body frame: z = height + tan(pitch_error) x."""

    pitch_error: float
    """True pitch of the camera minus the assumed one (rad), if the floor is level."""
    height: float
    """Height of the floor under the body's origin (m); 0 if the calibration is right."""
    inliers: np.ndarray
    """Which of the points lie on the plane, bool ``(M,)``."""


def fit_floor_plane(
    points_b, tolerance: float = 0.02, max_slope: float = MAX_SLOPE, max_height: float = 0.1, rounds: int = 5
) -> FloorPlane:
    """The plane z = height + slope x on which most points ``(M, 3)`` of the body frame lie, walls or not.

    Every point votes for the height it allows under each slope; the winner is refined by least squares over
    the points within ``tolerance`` (m). Among equals the smallest slope wins. No points: no inliers.
    """
    x, z = np.asarray(points_b)[:, 0], np.asarray(points_b)[:, 2]
    slope, height = _vote(x, z, tolerance, max_slope, max_height)
    inliers = np.abs(z - height - slope * x) <= tolerance
    for _ in range(rounds):
        if np.count_nonzero(inliers) < 3:
            break
        x_in, z_in = x[inliers], z[inliers]
        spread = x_in - x_in.mean()
        slope = float(spread @ z_in / max(spread @ spread, 1e-9))
        height = float(z_in.mean() - slope * x_in.mean())
        inliers = np.abs(z - height - slope * x) <= tolerance
    return FloorPlane(float(np.arctan(slope)), height, inliers)


def _vote(x, z, tolerance: float, max_slope: float, max_height: float) -> tuple[float, float]:
    """(slope, height) with the most points near: slopes in steps of 0.01, heights of ``tolerance``."""
    thin = max(len(x) // 3000, 1)  # a few thousand voters decide as well as all
    x, z = x[::thin], z[::thin]
    near = np.abs(z) <= max_height + max_slope * np.abs(x)
    steps = round(max_slope / 0.01)
    slopes = np.array(sorted(range(-steps, steps + 1), key=abs)) * 0.01
    bins = 2 * int(np.ceil(max_height / tolerance)) + 1
    residual = z[near] - slopes[:, None] * x[near]
    cell = np.floor(residual / tolerance + bins / 2).astype(int)
    inside = (cell >= 0) & (cell < bins)
    row = np.broadcast_to(np.arange(len(slopes))[:, None], cell.shape)
    votes = np.bincount((row * bins + cell)[inside], minlength=len(slopes) * bins).reshape(len(slopes), bins)
    # Bins are counted in pairs: a plane on the edge of one must not lose half its votes.
    window = votes[:, :-1] + votes[:, 1:]
    best, at = np.unravel_index(int(np.argmax(window)), window.shape)
    return float(slopes[best]), float((at + 1 - bins / 2) * tolerance)


def level_camera(camera: RgbdModel, plane: FloorPlane) -> RgbdModel:
    """The camera with pitch and height corrected so that the fitted floor becomes z = 0 of the body frame."""
    x, y, z = camera.position_b
    above = z - plane.height - np.tan(plane.pitch_error) * x
    height = float(above * np.cos(plane.pitch_error))
    return replace(camera, pitch=camera.pitch + plane.pitch_error, position_b=(x, y, height))
