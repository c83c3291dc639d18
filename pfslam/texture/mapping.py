"""The floor texture: every image pair of a drive painted into one picture of the floor, seen from above.

The equations live in ``pfslam.texture.floor`` and are offered here too. ``project_floor`` strings them together for
chosen pixels, as the report does; ``map_texture`` does the same for all images of a drive.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from pfslam.errors import DataError
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.sensors import RgbdModel
from pfslam.texture.config import TextureConfig
from pfslam.texture.floor import (
    associate_rgb,
    back_project,
    depth_from_disparity,
    depth_mask,
    fit_floor_plane,
    floor_mask,
    nearest_floor,
    to_world,
)
from pfslam.texture.views import (
    FloorPixels,
    PixelRays,
    camera_from_floor,
    floor_pixels,
    posed_pairs,
    read_disparity,
    read_rgb,
)

__all__ = [
    "FloorTexture",
    "TextureConfig",
    "associate_rgb",
    "back_project",
    "depth_from_disparity",
    "depth_mask",
    "fit_floor_plane",
    "floor_mask",
    "map_texture",
    "nearest_floor",
    "paint",
    "project_floor",
    "to_world",
]

EMPTY = np.iinfo(np.int64).max
"""The code of a cell that no pixel has painted: larger than every code."""


@dataclass(frozen=True, eq=False)
class FloorTexture:
    """``rgb (H, W, 3)`` uint8 on the cells of ``spec`` (row 0 at y_min) where ``seen (H, W)`` is True."""

    spec: GridSpec
    rgb: np.ndarray
    seen: np.ndarray
    dropped: dict[str, int] = field(default_factory=dict)
    """What was left out, by reason: image pairs and points."""
    pairs: int = 0
    """Image pairs painted."""
    camera: RgbdModel = field(default_factory=RgbdModel)
    """The camera as it was used: its pitch and height may have been corrected from the floor."""


def project_floor(
    u, v, disparity, pose_w, camera: RgbdModel, spec: GridSpec, config: TextureConfig
) -> FloorPixels:
    """Map cells of those depth pixels ``u, v, disparity (N,)`` that see the floor. Implements Eq. 4 (psi).

    The steps of the report in a row, with the floor at z = 0: the definition that ``map_texture`` keeps to.
    """
    u, v, disparity = np.atleast_1d(u), np.atleast_1d(v), np.atleast_1d(disparity)
    u_rgb, v_rgb = associate_rgb(u, v, disparity, camera)
    depth = depth_from_disparity(disparity, camera)
    points_o = back_project(u, v, depth, camera.K)
    trusted = depth_mask(depth, config.z_min, config.depth_limit(camera))
    points_w = to_world(points_o, pose_w, camera)
    floor = trusted & floor_mask(points_w, config.floor_tolerance, config.tolerance_per_metre, depth)
    on_floor = points_w[floor, :2]
    return FloorPixels(spec.world_to_cell(on_floor), u_rgb[floor], v_rgb[floor], depth[floor], on_floor)


def view_code(rgb, depth, points_w, spec: GridSpec) -> np.ndarray:
    """One integer ``(M,)`` per pixel, smaller for a better view, with the colour in its last 24 bits.

    First comes the depth in steps of 0.1 m, then the squared distance from the cell's centre, so that of two
    near views the better placed one wins. The colour settles a tie: no order of pixels or images matters.
    """
    place = (points_w - spec.origin) / spec.resolution
    off_centre = place - np.floor(place) - 0.5
    offset = (510.0 * (off_centre**2).sum(axis=1)).astype(np.int64)  # 0 at the centre, 255 in a corner
    view = np.minimum(10.0 * depth, 30000).astype(np.int64)
    return view << 32 | offset << 24 | colour_code(rgb)


def colour_code(rgb) -> np.ndarray:
    """Colours ``(M, 3)`` uint8 as integers ``(M,)``: red, green, blue from the high byte to the low."""
    rgb = np.asarray(rgb).astype(np.int64)
    return rgb[..., 0] << 16 | rgb[..., 1] << 8 | rgb[..., 2]


def paint(canvas: np.ndarray, cells, codes, view: str = "last") -> int:
    """Write codes ``(M,)`` into cells ``(M, 2)`` (ix, iy) of a canvas ``(H, W)`` int64. Implements step 6.

    The canvas changes in place. "last": the last code of a cell stays. "best": the smallest. Returns
    how many lay outside the canvas.
    """
    height, width = canvas.shape
    ix, iy = cells[:, 0], cells[:, 1]
    inside = (ix >= 0) & (iy >= 0) & (ix < width) & (iy < height)
    flat, codes = (iy * width + ix)[inside], codes[inside]
    if view == "best":
        np.minimum.at(canvas.reshape(-1), flat, codes)
    else:
        canvas.reshape(-1)[flat] = codes
    return int(np.count_nonzero(~inside))


def map_texture(
    recording: Recording,
    trajectory: Trajectory,
    grid: OccupancyGrid | None = None,
    config: TextureConfig | None = None,
    every: int = 1,
    progress: Callable[[Iterable], Iterable] | None = None,
) -> FloorTexture:
    """The floor's colours along a drive, from every ``every``-th image pair (``config`` None: ``refined``).

    The texture lies on the cells of ``grid``; without one it covers all that the camera can reach from the
    trajectory. What is left out is counted in ``dropped``. Images are read one pair at a time. Raises
    ``DataError`` without a camera or for an image of the wrong size.
    """
    config = TextureConfig.refined() if config is None else config
    if recording.camera is None:
        raise DataError(recording.name, "camera", "no images", "a recording with disparity and RGB images")
    if int(every) != every or every < 1:
        raise DataError("map_texture", "every", every, "a whole number of at least 1")
    stream, model = recording.camera, recording.robot.camera
    pairs = posed_pairs(stream, trajectory, config, every)
    if config.pitch == "floor plane":
        model = camera_from_floor(stream, pairs.disparity, model, config)
    resolution = config.resolution or (grid.spec.resolution if grid is not None else 0.05)
    rays = PixelRays.of(model, config, resolution)
    spec = _texture_spec(grid, trajectory, rays, resolution)
    canvas = np.full(spec.shape, EMPTY)
    dropped, painted = Counter(pairs.dropped), 0
    for k in (progress or iter)(range(len(pairs.disparity))):
        disparity = read_disparity(stream, pairs.disparity[k], model)
        pixels = floor_pixels(disparity, rays, pairs.pose_disparity[k], pairs.pose_rgb[k], spec, config)
        if pixels is None:
            dropped["pairs: no floor"] += 1
            continue
        dropped.update(_paint_pixels(canvas, pixels, read_rgb(stream, pairs.rgb[k], model), spec, config))
        painted += 1
    if grid is not None and config.crop:
        dropped["cells: outside the map"] += _crop(canvas, spec, grid)
    return FloorTexture(spec, *_colours(canvas), dict(+dropped), painted, model)


def _colours(canvas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the colours ``(H, W, 3)`` uint8 of a canvas of view codes, and which cells were seen."""
    seen = canvas != EMPTY
    code = np.where(seen, canvas, 0)
    rgb = np.stack([code >> 16 & 255, code >> 8 & 255, code & 255], axis=-1).astype(np.uint8)
    return rgb, seen


def _paint_pixels(canvas, pixels: FloorPixels, image, spec: GridSpec, config: TextureConfig) -> Counter:
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
    return Counter({"points: outside the colour image": hidden, "points: outside the grid": outside})


def _texture_spec(grid, trajectory: Trajectory, rays: PixelRays, resolution: float) -> GridSpec:
    """The grid's cells, or finer ones over the same ground; without a grid, all that the camera can reach."""
    if grid is None:
        direction = rays.direction[:2]
        reach = np.hypot(*rays.camera.position_b[:2])
        if direction.size:
            reach += rays.depth_limit * float(np.hypot(direction[0], direction[1]).max())
        return GridSpec.around(trajectory.poses[:, :2], resolution, margin=reach)
    if resolution == grid.spec.resolution:
        return grid.spec
    ratio = grid.spec.resolution / resolution
    shape = tuple(int(np.ceil(n * ratio - 1e-9)) for n in grid.spec.shape)
    return replace(grid.spec, resolution=resolution, shape=shape)


def _crop(canvas: np.ndarray, spec: GridSpec, grid: OccupancyGrid) -> int:
    """Clear the painted cells whose centre lies where the map knows nothing; returns how many."""
    iy, ix = np.nonzero(canvas != EMPTY)
    cells = grid.spec.world_to_cell(spec.cell_to_world(np.column_stack([ix, iy])))
    known = grid.spec.contains(cells)
    known[known] = grid.log_odds[cells[known, 1], cells[known, 0]] != 0
    canvas[iy[~known], ix[~known]] = EMPTY
    return int(np.count_nonzero(~known))
