"""What each image pair of a drive says about the floor: its poses, its floor pixels, and how they are read.

``floor_pixels`` does for a whole image what the functions of ``pfslam.texture.floor`` do for chosen pixels, with the
rays of all pixels worked out once, a pose for each of the two images, and a floor that need not be level.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import Trajectory, between, invert_transform, pose_to_transform, transform_points
from pfslam.recording import RgbdStream, image_pairs, nearest_stamp
from pfslam.sensors import RgbdModel
from pfslam.texture.config import TextureConfig
from pfslam.texture.floor import (
    MAX_SLOPE,
    FloorPlane,
    associate_rgb,
    back_project,
    depth_from_disparity,
    depth_mask,
    disparity_from_depth,
    fit_floor_plane,
    level_camera,
)


@dataclass(frozen=True, eq=False)
class PosedPairs:
    """Image pairs with a pose for each image: indices ``(P,)``, poses ``(P, 3)``; ``dropped`` by reason."""

    disparity: np.ndarray
    rgb: np.ndarray
    pose_disparity: np.ndarray
    pose_rgb: np.ndarray
    dropped: dict[str, int]


def posed_pairs(
    camera: RgbdStream, trajectory: Trajectory, config: TextureConfig, every: int = 1
) -> PosedPairs:
    """The image pairs to paint, each ``every``-th, with the body's pose when the images were taken."""
    pairs = image_pairs(camera, config.max_image_gap, every)
    dropped = Counter({"pairs: no partner in time": pairs.unpaired})
    t_disparity, t_rgb = camera.disparity_t[pairs.disparity], camera.rgb_t[pairs.rgb]
    inside = trajectory.covers(t_disparity) & trajectory.covers(t_rgb)
    if config.states == "nearest":
        nearest = nearest_stamp(trajectory.t, t_disparity)
        inside = trajectory.covers(t_disparity)
        chosen = np.zeros(len(inside), dtype=bool)
        if len(chosen):
            chosen[nearest_stamp(t_disparity, trajectory.t)] = True
        dropped["pairs: no state of their own"] += int(np.count_nonzero(inside & ~chosen))
        near = np.abs(trajectory.t[nearest] - t_disparity) <= config.max_pose_gap
        use = inside & chosen & near
        poses = trajectory.poses[nearest[use]], trajectory.poses[nearest[use]]
        far = inside & chosen & ~near
    else:
        near = _gap(trajectory, t_disparity) <= config.max_pose_gap
        use = inside & near
        poses = trajectory.at(t_disparity[use]), trajectory.at(t_rgb[use])
        far = inside & ~near
    dropped["pairs: outside the trajectory"] += int(np.count_nonzero(~inside))
    dropped["pairs: no state near in time"] += int(np.count_nonzero(far))
    return PosedPairs(pairs.disparity[use], pairs.rgb[use], *poses, +dropped)


def _gap(trajectory: Trajectory, t: np.ndarray) -> np.ndarray:
    """Time (s) between the two states around each ``t``."""
    if len(trajectory) == 1:
        return np.zeros(t.shape)
    after = np.clip(np.searchsorted(trajectory.t, t, side="right"), 1, len(trajectory) - 1)
    return trajectory.t[after] - trajectory.t[after - 1]


@dataclass(frozen=True, eq=False)
class FloorPixels:
    """Floor pixels of one image pair: ``cells (M, 2)`` (ix, iy), ``u_rgb, v_rgb (M,)``, ``depth (M,)`` m,
    and ``points_w (M, 2)`` m, from which the cells were made."""

    cells: np.ndarray
    u_rgb: np.ndarray
    v_rgb: np.ndarray
    depth: np.ndarray
    points_w: np.ndarray


@dataclass(frozen=True, eq=False)
class PixelRays:
    """What every image shares: the rays of the pixels and the depths of the disparities.

    ``direction (3, rows, columns)`` float32 is a pixel's step in the body frame per metre of depth. Rows
    begin at ``first_row``, above which no floor is seen. Columns are ``column_step`` apart: at most half a
    cell at the largest trusted depth, so the ones between add work and hardly a cell. ``depth (65536,)``
    float32, in metres, is looked up by disparity.
    """

    camera: RgbdModel
    first_row: int
    column_step: int
    direction: np.ndarray
    depth: np.ndarray
    depth_limit: float

    @classmethod
    def of(cls, camera: RgbdModel, config: TextureConfig, resolution: float) -> PixelRays:
        limit = config.depth_limit(camera)
        v, u = np.indices((camera.height, camera.width)).reshape(2, -1)
        direction = back_project(u, v, np.ones(u.size), camera.K) @ camera.T_bo[:3, :3].T
        direction = direction.T.reshape(3, camera.height, camera.width).astype(np.float32)
        slack = config.floor_tolerance + config.tolerance_per_metre * limit
        slack += MAX_SLOPE * limit if config.pitch == "floor plane" else 0.0
        sees_floor = (limit * direction[2] + camera.position_b[2] <= slack).any(axis=1)
        first_row = int(np.argmax(sees_floor)) if sees_floor.any() else camera.height
        depth = depth_from_disparity(np.arange(2**16), camera).astype(np.float32)
        step = max(int(0.5 * resolution * camera.focal_u / limit), 1)
        return cls(camera, first_row, step, direction[:, first_row:, ::step], depth, limit)

    def crop(self, image: np.ndarray) -> np.ndarray:
        """The pixels of an image ``(height, width)`` that have a ray here."""
        return image[self.first_row :, :: self.column_step]


def camera_from_floor(
    stream: RgbdStream, indices: np.ndarray, camera: RgbdModel, config: TextureConfig, images: int = 24
) -> RgbdModel:
    """The camera with the pitch and height that the floor shows: medians over planes in ``images`` images.

    The mounting does not change during a drive, so one image's error, or one ramp's slope, does not count.
    Images with less than a quarter of their pixels on a plane are left out; with fewer than three left the
    camera stays as it is.
    """
    rays, planes = PixelRays.of(camera, config, resolution=0.05), []
    for k in np.unique(indices[np.linspace(0, len(indices) - 1, images).astype(int)]) if len(indices) else ():
        plane = _image_plane(read_disparity(stream, k, camera), rays, config)
        if np.count_nonzero(plane.inliers) >= max(len(plane.inliers) / 4, 3):
            planes.append((plane.pitch_error, plane.height))
    if len(planes) < 3:
        return camera
    pitch_error, height = np.median(planes, axis=0)
    return level_camera(camera, FloorPlane(float(pitch_error), float(height), np.zeros(0, dtype=bool)))


def _image_plane(disparity, rays: PixelRays, config: TextureConfig) -> FloorPlane:
    """The floor's plane in one disparity image, from about one pixel in a hundred."""
    rows, columns = slice(None, None, 10), slice(None, None, max(10 // rays.column_step, 1))
    depth = rays.depth[rays.crop(disparity)[rows, columns]]
    trusted = depth_mask(depth, config.z_min, rays.depth_limit)
    points_b = (depth * rays.direction[:, rows, columns])[:, trusted].T + rays.camera.position_b
    return fit_floor_plane(points_b)


def floor_pixels(disparity, rays: PixelRays, pose_disparity, pose_rgb, spec, config) -> FloorPixels | None:
    """Floor pixels of a whole image, with a fitted plane and two poses if asked; None without floor."""
    camera, (x_c, _, z_c) = rays.camera, rays.camera.position_b
    depth = rays.depth[rays.crop(disparity)]
    above = depth * rays.direction[2] + np.float32(z_c)
    if config.pitch == "floor plane":
        plane = _image_plane(disparity, rays, config)
        slope = np.float32(np.tan(plane.pitch_error))
        above -= np.float32(plane.height) + slope * (depth * rays.direction[0] + np.float32(x_c))
    tolerance = config.floor_tolerance + config.tolerance_per_metre * depth
    floor = depth_mask(depth, config.z_min, rays.depth_limit) & (np.abs(above) <= tolerance)
    at = np.flatnonzero(floor)
    if len(at) < config.min_points:
        return None
    depth = depth.ravel()[at].astype(float)
    direction = rays.direction.reshape(3, -1)[:, at]
    points_b = (depth * direction).T + camera.position_b
    points_w = transform_points(pose_disparity, points_b[:, :2])
    if config.states == "interpolated":
        u_rgb, v_rgb = _colour_pixels_from(between(pose_rgb, pose_disparity), points_b, camera)
    else:
        v, u = np.unravel_index(at, floor.shape)
        v, u = v + rays.first_row, u * rays.column_step
        u_rgb, v_rgb = associate_rgb(u, v, disparity[v, u], camera)
    return FloorPixels(spec.world_to_cell(points_w), u_rgb, v_rgb, depth, points_w)


def _colour_pixels_from(motion, points_b, camera: RgbdModel):
    """Colour pixels of points seen by the depth camera when the body has since moved by ``motion`` (a pose).

    The points are seen afresh by a depth camera at the colour image's time; Eq. 16 takes it from there.
    """
    T_ob = invert_transform(camera.T_bo) @ pose_to_transform(motion)
    # einsum, because the threads of a matrix product cost more than so small a product is worth.
    x, y, z = np.einsum("ij,mj->im", T_ob[:3, :3], points_b) + T_ob[:3, 3:]
    behind, z = z <= 0, np.maximum(z, 1e-6)
    u = (camera.focal_u * x + camera.skew * y) / z + camera.centre_u
    v = camera.focal_v * y / z + camera.centre_v
    u_rgb, v_rgb = associate_rgb(u, v, disparity_from_depth(z, camera), camera)
    return np.where(behind, -1.0, u_rgb), v_rgb


def read_disparity(stream: RgbdStream, index: int, camera: RgbdModel) -> np.ndarray:
    """Disparity image ``index``, checked: uint16 of the camera's size."""
    return _checked(stream.read_disparity(int(index)), f"disparity image {index + 1}", np.uint16, camera, ())


def read_rgb(stream: RgbdStream, index: int, camera: RgbdModel) -> np.ndarray:
    """Colour image ``index``, checked: uint8 of the camera's size."""
    return _checked(stream.read_rgb(int(index)), f"rgb image {index + 1}", np.uint8, camera, (3,))


def _checked(image, source: str, dtype, camera: RgbdModel, channels: tuple[int, ...]) -> np.ndarray:
    shape = (camera.height, camera.width, *channels)
    if getattr(image, "shape", None) != shape or image.dtype != dtype:
        found = "nothing" if image is None else f"{image.dtype} of shape {image.shape}"
        raise DataError(source, "pixels", found, f"{np.dtype(dtype)} of shape {shape}")
    return image
