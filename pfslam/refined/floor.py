"""The floor over a whole drive: fast for whole images, with a pose for each image and a floor that need not be level.

``floor_pixels`` gives the cells of ``pfslam.texture.project_floor``, from rays and depths that are worked out once.
Frames: o optical (x right, y down, z forward), b body, w world. Angles in radians, lengths in metres.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pfslam.errors import DataError
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.poses import Trajectory, between, invert_transform, pose_to_transform, transform_points
from pfslam.recording import Recording, RgbdStream, image_pairs, nearest_stamp
from pfslam.sensors import RgbdModel
from pfslam.texture import (
    FloorPixels,
    FloorTexture,
    TextureConfig,
    associate_rgb,
    back_project,
    colour_code,
    depth_from_disparity,
    depth_mask,
    disparity_from_depth,
    paint,
    view_code,
)

IMAGE_GAP, POSE_GAP = 0.1, 0.5
"""Longest time (s) from a colour image to its depth image; from an image to its state, or between two states."""
CELL = 0.05
"""Cell size (m) of a texture without a map."""
MIN_POINTS = 200
"""An image with fewer floor pixels than this shows no floor."""
MAX_SLOPE, MAX_HEIGHT, NEAR_PLANE = 0.4, 0.1, 0.02
"""The steepest floor (rise over run) and the largest height (m) looked for; a plane's points lie this near (m)."""
EMPTY = np.iinfo(np.int64).max
"""The code of a cell that no pixel has painted: larger than every code."""


# The floor as a plane, and the camera that it corrects.


class FloorPlane(NamedTuple):
    """The floor as a camera saw it, in the body frame: z = height + tan(pitch_error) x."""

    pitch_error: float
    """True pitch of the camera minus the assumed one (rad), if the floor is level."""
    height: float
    """Height of the floor under the body's origin (m); 0 if the calibration is right."""
    inliers: np.ndarray
    """Which of the points lie on the plane, bool ``(M,)``."""


def fit_floor_plane(points_b) -> FloorPlane:
    """The plane z = height + slope x on which most points ``(M, 3)`` of the body frame lie, walls or not.

    Every point votes for the height it allows under each slope; the winner is refined by least squares over
    the points near it. Among equals the smallest slope wins. No points: no inliers.
    """
    x, z = np.asarray(points_b)[:, 0], np.asarray(points_b)[:, 2]
    slope, height = _vote(x, z)
    inliers = np.abs(z - height - slope * x) <= NEAR_PLANE
    for _ in range(5):
        if np.count_nonzero(inliers) < 3:
            break
        x_in, z_in = x[inliers], z[inliers]
        spread = x_in - x_in.mean()
        slope = float(spread @ z_in / max(spread @ spread, 1e-9))
        height = float(z_in.mean() - slope * x_in.mean())
        inliers = np.abs(z - height - slope * x) <= NEAR_PLANE
    return FloorPlane(float(np.arctan(slope)), height, inliers)


def _vote(x, z) -> tuple[float, float]:
    """(slope, height) with the most points near: slopes in steps of 0.01, heights of ``NEAR_PLANE``."""
    thin = max(len(x) // 3000, 1)  # a few thousand voters decide as well as all
    x, z = x[::thin], z[::thin]
    near = np.abs(z) <= MAX_HEIGHT + MAX_SLOPE * np.abs(x)
    steps = round(MAX_SLOPE / 0.01)
    slopes = np.array(sorted(range(-steps, steps + 1), key=abs)) * 0.01
    bins = 2 * int(np.ceil(MAX_HEIGHT / NEAR_PLANE)) + 1
    cell = np.floor((z[near] - slopes[:, None] * x[near]) / NEAR_PLANE + bins / 2).astype(int)
    inside = (cell >= 0) & (cell < bins)
    row = np.broadcast_to(np.arange(len(slopes))[:, None], cell.shape)
    votes = np.bincount((row * bins + cell)[inside], minlength=len(slopes) * bins).reshape(len(slopes), bins)
    # Bins are counted in pairs: a plane on the edge of one must not lose half its votes.
    window = votes[:, :-1] + votes[:, 1:]
    best, at = np.unravel_index(int(np.argmax(window)), window.shape)
    return float(slopes[best]), float((at + 1 - bins / 2) * NEAR_PLANE)


def level_camera(camera: RgbdModel, pitch_error: float, height: float) -> RgbdModel:
    """The camera with pitch and height corrected so that a fitted floor becomes z = 0 of the body frame."""
    x, y, z = camera.position_b
    above = float((z - height - np.tan(pitch_error) * x) * np.cos(pitch_error))
    return replace(camera, pitch=camera.pitch + pitch_error, position_b=(x, y, above))


# Whole images.


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
        """Prepare a camera for cells of this ``resolution`` (m)."""
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

    def depths(self, disparity: np.ndarray) -> np.ndarray:
        """Look up the depths ``(rows, columns)`` of a disparity image ``(height, width)``."""
        return self.depth[disparity[self.first_row :, :: self.column_step]]

    def plane(self, depth: np.ndarray, config: TextureConfig) -> FloorPlane:
        """Fit the floor's plane to ``depth (rows, columns)``, to about one pixel in a hundred."""
        some = (slice(None, None, 10), slice(None, None, max(10 // self.column_step, 1)))
        depth, direction = depth[some], self.direction[:, *some]
        trusted = depth_mask(depth, config.z_min, self.depth_limit)
        return fit_floor_plane((depth * direction)[:, trusted].T + self.camera.position_b)


def floor_pixels(
    disparity, rays: PixelRays, pose_disparity, pose_rgb, spec: GridSpec, config: TextureConfig
) -> FloorPixels | None:
    """Floor pixels of a whole image, with a fitted plane and two poses if asked; None without floor."""
    camera, (x_c, _, z_c) = rays.camera, rays.camera.position_b
    depth = rays.depths(disparity)
    above = depth * rays.direction[2] + np.float32(z_c)
    if config.pitch == "floor plane":
        pitch_error, height, _ = rays.plane(depth, config)
        slope = np.float32(np.tan(pitch_error))
        above -= np.float32(height) + slope * (depth * rays.direction[0] + np.float32(x_c))
    tolerance = config.floor_tolerance + config.tolerance_per_metre * depth
    floor = depth_mask(depth, config.z_min, rays.depth_limit) & (np.abs(above) <= tolerance)
    at = np.flatnonzero(floor)
    if len(at) < MIN_POINTS:
        return None
    depth = depth.ravel()[at].astype(float)
    points_b = (depth * rays.direction.reshape(3, -1)[:, at]).T + camera.position_b
    points_w = transform_points(pose_disparity, points_b[:, :2])
    if config.states == "interpolated":
        u_rgb, v_rgb = _colour_pixels_from(between(pose_rgb, pose_disparity), points_b, camera)
    else:
        v, u = np.unravel_index(at, floor.shape)
        v, u = v + rays.first_row, u * rays.column_step
        u_rgb, v_rgb = associate_rgb(u, v, disparity[v, u], camera)
    return FloorPixels(spec.world_to_cell(points_w), u_rgb, v_rgb, depth, points_w)


def _colour_pixels_from(motion, points_b, camera: RgbdModel) -> tuple[np.ndarray, np.ndarray]:
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


# The drive.

UNREADABLE = "that cannot be read"
"""How such images are told from others that are left out."""


class PosedPairs(NamedTuple):
    """Image pairs with a pose for each image: indices ``(P,)``, poses ``(P, 3)``; ``dropped`` by reason."""

    disparity: np.ndarray
    rgb: np.ndarray
    pose_disparity: np.ndarray
    pose_rgb: np.ndarray
    dropped: Counter[str]


def posed_pairs(camera: RgbdStream, trajectory: Trajectory, config: TextureConfig) -> PosedPairs:
    """The image pairs to paint, with the body's pose when the images were taken."""
    pairs = image_pairs(camera, IMAGE_GAP)
    t_disparity, t_rgb = camera.disparity_t[pairs.disparity], camera.rgb_t[pairs.rgb]
    inside, own = trajectory.covers(t_disparity), np.ones(len(t_disparity), dtype=bool)
    if config.states == "nearest":
        nearest = nearest_stamp(trajectory.t, t_disparity)
        gap = np.abs(trajectory.t[nearest] - t_disparity)
        if len(own):
            own = np.isin(np.arange(len(own)), nearest_stamp(t_disparity, trajectory.t))
    else:
        inside &= trajectory.covers(t_rgb)
        after = np.searchsorted(trajectory.t, t_disparity, side="right")
        gap = np.diff(trajectory.t, prepend=trajectory.t[0])[np.minimum(after, len(trajectory) - 1)]
    use = inside & own & (gap <= POSE_GAP)
    if config.states == "nearest":
        poses = trajectory.poses[nearest[use]], trajectory.poses[nearest[use]]
    else:
        poses = trajectory.at(t_disparity[use]), trajectory.at(t_rgb[use])
    dropped = Counter(
        {
            "pairs: no partner in time": pairs.unpaired,
            "pairs: no state of their own": int(np.count_nonzero(inside & ~own)),
            "pairs: outside the trajectory": int(np.count_nonzero(~inside)),
            "pairs: no state near in time": int(np.count_nonzero(inside & own & ~use)),
        }
    )
    return PosedPairs(pairs.disparity[use], pairs.rgb[use], *poses, +dropped)


def camera_from_floor(
    stream: RgbdStream, indices: np.ndarray, camera: RgbdModel, config: TextureConfig, images: int = 24
) -> RgbdModel:
    """The camera with the pitch and height that the floor shows: medians over planes in ``images`` images.

    The mounting does not change during a drive, so one image's error, or one ramp's slope, does not count.
    Images with less than a quarter of their pixels on a plane are left out; with fewer than three left the
    camera stays as it is.
    """
    rays, planes = PixelRays.of(camera, config, CELL), []
    for k in np.unique(indices[np.linspace(0, len(indices) - 1, images).astype(int)]) if len(indices) else ():
        try:
            plane = rays.plane(rays.depths(read_disparity(stream, k, camera)), config)
        except DataError:  # who paints counts the images that cannot be read
            continue
        if np.count_nonzero(plane.inliers) >= max(len(plane.inliers) / 4, 3):
            planes.append((plane.pitch_error, plane.height))
    return camera if len(planes) < 3 else level_camera(camera, *np.median(planes, axis=0).tolist())


def map_texture(
    recording: Recording,
    trajectory: Trajectory,
    grid: OccupancyGrid | None = None,
    config: TextureConfig | None = None,
    progress: Callable | None = None,
) -> FloorTexture:
    """The floor's colours along a drive, from all its image pairs (``config`` None: ``refined``).

    The texture lies on the cells of ``grid``; without one it covers all that the camera can reach from the
    trajectory. What is left out is counted in ``dropped``, a damaged image with its pair. Images are read one pair at
    a time. Raises ``DataError`` without a camera, or if no image can be read.
    """
    config = TextureConfig.refined() if config is None else config
    if recording.camera is None:
        raise DataError(recording.name, "camera", "no images", "a recording with disparity and RGB images")
    stream, model = recording.camera, recording.robot.camera
    pairs = posed_pairs(stream, trajectory, config)
    if config.pitch == "floor plane":
        model = camera_from_floor(stream, pairs.disparity, model, config)
    rays = PixelRays.of(model, config, CELL if grid is None else grid.spec.resolution)
    spec = _within_reach(trajectory, rays) if grid is None else grid.spec
    canvas, dropped, painted = np.full(spec.shape, EMPTY), Counter(pairs.dropped), 0
    damaged: list[DataError] = []
    for k, disparity, image in _readable(stream, pairs, model, damaged, progress or iter):
        pixels = floor_pixels(disparity, rays, pairs.pose_disparity[k], pairs.pose_rgb[k], spec, config)
        if pixels is None:
            dropped["pairs: no floor"] += 1
            continue
        dropped.update(_paint_pixels(canvas, pixels, image, spec, config))
        painted += 1
    dropped.update(_unreadable(damaged, painted))
    if grid is not None and config.crop:
        unknown = (canvas != EMPTY) & (grid.log_odds == 0)
        canvas[unknown] = EMPTY
        dropped["cells: outside the map"] += int(np.count_nonzero(unknown))
    return FloorTexture(spec, _colours(canvas), canvas != EMPTY, dict(+dropped), painted, model)


def _readable(
    stream: RgbdStream, pairs: PosedPairs, camera: RgbdModel, damaged: list[DataError], progress: Callable
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield number, disparity and colours of each pair; why one cannot be read goes to ``damaged``."""
    for k in progress(range(len(pairs.disparity))):
        try:
            images = (
                read_disparity(stream, pairs.disparity[k], camera),
                read_rgb(stream, pairs.rgb[k], camera),
            )
        except DataError as error:
            damaged.append(error)
        else:
            yield k, *images


def _unreadable(damaged: list[DataError], painted: int) -> dict[str, int]:
    """How many pairs could not be read; the first complaint is raised if nothing was painted."""
    if not damaged:
        return {}
    if not painted:
        raise damaged[0]
    return {f"pairs: an image {UNREADABLE}, first {Path(damaged[0].source).name}": len(damaged)}


def _colours(canvas: np.ndarray) -> np.ndarray:
    """The colours ``(H, W, 3)`` uint8 of a canvas of codes, black where nothing was painted."""
    code = np.where(canvas == EMPTY, 0, canvas)
    return np.stack([code >> 16 & 255, code >> 8 & 255, code & 255], axis=-1).astype(np.uint8)


def _paint_pixels(
    canvas, pixels: FloorPixels, image, spec: GridSpec, config: TextureConfig
) -> dict[str, int]:
    """Paint the pixels that fall into the colour image; counts of those that could not be painted."""
    u, v = np.rint(pixels.u_rgb).astype(np.int64), np.rint(pixels.v_rgb).astype(np.int64)
    height, width = image.shape[:2]
    visible = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    rgb = np.take(image.reshape(-1, 3), v[visible] * width + u[visible], axis=0)
    if config.view == "best":
        codes = view_code(rgb, pixels.depth[visible], pixels.points_w[visible], spec)
    else:
        codes = colour_code(rgb)
    outside = paint(canvas, pixels.cells[visible], codes, config.view)
    hidden = int(np.count_nonzero(~visible))
    return {"points: outside the colour image": hidden, "points: outside the grid": outside}


def _within_reach(trajectory: Trajectory, rays: PixelRays) -> GridSpec:
    """Make a grid over all that the camera can reach from the trajectory."""
    sideways = np.hypot(*rays.direction[:2]).max(initial=0.0)
    reach = np.hypot(*rays.camera.position_b[:2]) + rays.depth_limit * float(sideways)
    return GridSpec.around(trajectory.poses[:, :2], CELL, margin=reach)
