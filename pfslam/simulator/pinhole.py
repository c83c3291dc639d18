"""The two pinhole cameras of the robot, and the rays of their pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.poses import apply_transform, rotation_matrix
from pfslam.sensors import RgbdModel
from pfslam.simulator.walls import AZIMUTH_STEP, AZIMUTHS


@dataclass(frozen=True, eq=False)
class Pinhole:
    """A pinhole camera.

    ``focal`` and ``centre`` are (u, v) in pixels, ``position_o (3,)`` lies in the depth camera's frame (m).
    """

    focal: tuple[float, float]
    centre: tuple[float, float]
    position_o: tuple[float, float, float]

    def rays_o(self, model: RgbdModel) -> np.ndarray:
        """Compute the ray of each pixel, ``(3, height, width)`` in the optical frame, scaled to Z = 1."""
        x = (np.arange(model.width) - self.centre[0]) / self.focal[0]
        y = (np.arange(model.height) - self.centre[1]) / self.focal[1]
        shape = (model.height, model.width)
        return np.stack([np.broadcast_to(x, shape), np.broadcast_to(y[:, None], shape), np.ones(shape)])


def depth_pinhole(model: RgbdModel) -> Pinhole:
    """Build the depth camera (its skew must be 0)."""
    return Pinhole((model.focal_u, model.focal_v), (model.centre_u, model.centre_v), (0.0, 0.0, 0.0))


def rgb_pinhole(model: RgbdModel) -> Pinhole:
    """Build the colour camera that Eq. 16 describes.

    Eq. 16 turns u = f X/Z + c into a u_rgb linear in X/Z and 1/Z, which is a pinhole camera displaced along x.
    """
    scale = model.rgb_focal / model.rgb_divisor
    focal = (scale * model.focal_u, scale * model.focal_v)
    centre_u = scale * model.centre_u + model.rgb_offset_u / model.rgb_divisor
    centre_v = scale * model.centre_v + model.rgb_offset_v / model.rgb_divisor
    sideways = -model.rgb_baseline * model.depth_scale / model.rgb_divisor / focal[0]
    return Pinhole(focal, (centre_u, centre_v), (sideways, 0.0, 0.0))


@dataclass(frozen=True, eq=False)
class View:
    """Rays of one camera on a body with some tilt, in the frame that follows the body's yaw but not its tilt.

    ``ray (3, H, W)`` float32 is for Z = 1, ``column (H, W)`` its place in the table of azimuths, and ``level (H, W)``
    its length seen from above.
    """

    ray: np.ndarray
    column: np.ndarray
    level: np.ndarray

    @classmethod
    def tilted(cls, rays_b: np.ndarray, pitch: float = 0.0, roll: float = 0.0) -> View:
        """Tilt the rays ``(3, H, W)`` of a camera with its body (rad)."""
        # Sums spelled out and a float64 angle: a matrix product, or a float32 arctangent, ends in other bits on
        # another processor, and a pixel at a corner would show the other wall.
        tilt = rotation_matrix(roll, pitch).astype(np.float32)
        ray = np.stack([row[0] * rays_b[0] + row[1] * rays_b[1] + row[2] * rays_b[2] for row in tilt])
        azimuth = np.arctan2(ray[1], ray[0], dtype=np.float64)
        column = np.rint((azimuth - AZIMUTHS[0]) / AZIMUTH_STEP).astype(np.int32)
        np.clip(column, 0, len(AZIMUTHS) - 1, out=column)
        return cls(ray, column, np.sqrt(ray[0] ** 2 + ray[1] ** 2))


@dataclass(frozen=True, eq=False)
class Eye:
    """A pinhole camera mounted on the body.

    ``rays_b (3, H, W)`` float32, for Z = 1, leave from ``position_b (3,)`` (m); ``level`` is the view of a level body.
    """

    rays_b: np.ndarray
    position_b: np.ndarray
    level: View

    @classmethod
    def mounted(cls, camera: Pinhole, model: RgbdModel) -> Eye:
        """Mount a camera where the model says."""
        rays_b = np.einsum("ij,jhw->ihw", model.T_bo[:3, :3], camera.rays_o(model)).astype(np.float32)
        return cls(rays_b, apply_transform(model.T_bo, camera.position_o), View.tilted(rays_b))
