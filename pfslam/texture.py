"""Texture mapping: every image pair of a drive painted into one picture of the floor, seen from above.

The report's six steps, one function each, for chosen pixels; ``project_floor`` strings five of them together.
``pfslam.refined.floor`` does the same for the whole images of a drive, with a pose for each of the two images of a
pair and a floor that need not be level.

Pixels are (u, v): column and row. Frames: o optical (x right, y down, z forward), b body, w world. Angles in radians,
lengths in metres. An invalid reading is NaN from the first function on; every mask is False there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import Annotated, Literal, NamedTuple

import numpy as np

from pfslam.errors import DataError
from pfslam.grid import GridSpec
from pfslam.poses import apply_transform, pose_to_transform
from pfslam.sensors import RgbdModel
from pfslam.settings import Range, Settings

NO_READING = 2047
"""The disparity that the depth camera reports where it saw nothing."""
Metres = Annotated[float, Range(0.0, 100.0)]


@dataclass(frozen=True)
class TextureConfig(Settings):
    """What counts as floor, which pose belongs to an image, and which of several views of a cell is kept."""

    z_min: Metres = 0.1
    """Z_MIN (m), step 3."""
    z_max: Metres = 10.0
    """Z_MAX (m), step 3."""
    max_depth_step: Annotated[float, Range(1e-6, inf)] = inf
    """Trust a depth only while one step of disparity is worth at most this (m); it tightens ``z_max``."""
    floor_tolerance: Metres = 0.01
    """Step 5: how far from the floor (m) a point may lie."""
    tolerance_per_metre: Metres = 0.0
    """What the tolerance gains per metre of depth."""
    pitch: Literal["calibration", "floor plane"] = "calibration"
    """``calibration``: the floor is z = 0 of the body. ``floor plane``: the camera's pitch and height come
    from planes fitted to some images, and the floor in each image is the plane fitted to it."""
    states: Literal["nearest", "interpolated"] = "nearest"
    """``nearest``: each state of the trajectory takes its nearest image pair. ``interpolated``: each image,
    depth or colour, has the pose of its own stamp."""
    view: Literal["last", "best"] = "last"
    """``last``: the last view of a cell stays. ``best``: the nearest, then the pixel nearest its centre."""
    crop: bool = False
    """Leave out what lies where the map knows nothing."""

    def __post_init__(self):
        super().__post_init__()
        if not self.z_min < self.z_max:
            raise DataError("TextureConfig", "z_min, z_max", (self.z_min, self.z_max), "z_min < z_max")

    @classmethod
    def report(cls) -> TextureConfig:
        """The report's: ``|Z_w| <= 0.01`` m, depths of 0.1 to 10 m, one image per state, the last view wins."""
        return cls()

    @classmethod
    def refined(cls) -> TextureConfig:
        """Two improvements that the report names (crop, a pose for every image), and four of ours.

        The depth range ends where a step of disparity is worth 0.1 m. Since the best view wins, a point that far away
        is kept only where there was never a nearer view.
        """
        return list(cls.steps().values())[-1]

    @classmethod
    def steps(cls) -> dict[str, TextureConfig]:
        """From ``report`` to ``refined``, one change after the other, each named by what it changes."""
        steps = {"report": cls.report()}
        for name, change in _CHANGES.items():
            steps[name] = replace(list(steps.values())[-1], **change)
        return steps

    def depth_limit(self, camera: RgbdModel) -> float:
        """The largest depth (m) to trust with this camera."""
        return min(self.z_max, depth_for_step(self.max_depth_step, camera))


_CHANGES: dict[str, dict] = {
    "cut to the map": {"crop": True},
    "a pose for every image": {"states": "interpolated"},
    "depth range": {"max_depth_step": 0.1},
    "tolerance that grows with range": {"floor_tolerance": 0.015, "tolerance_per_metre": 0.01},
    "pitch from the floor plane": {"pitch": "floor plane"},
    "best view wins": {"view": "best"},
}


# The report's steps 1 to 5, for chosen pixels.


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
    """The disparity ``(H, W)`` uint16, in whole steps, of an image of depths in metres.

    Where there is no depth (0, infinity or NaN), or none that fits 16 bits, the disparity is that of no reading.
    """
    seen = np.isfinite(depth) & (np.asarray(depth) > 0)
    steps = np.round(disparity_from_depth(np.where(seen, depth, np.inf), camera))
    steps[steps == NO_READING] += 1
    return np.where(seen & (steps >= 0) & (steps < 2**16), steps, NO_READING).astype(np.uint16)


def depth_for_step(step: float, camera: RgbdModel) -> float:
    """The depth (m) at which one step of disparity is worth ``step`` metres; a step's worth grows as depth squared."""
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


class FloorPixels(NamedTuple):
    """Floor pixels of one image pair: their ``cells (M, 2)`` (ix, iy), ``u_rgb, v_rgb (M,)`` and ``depth (M,)`` m.

    ``points_w (M, 2)`` m are the points that the cells were made from.
    """

    cells: np.ndarray
    u_rgb: np.ndarray
    v_rgb: np.ndarray
    depth: np.ndarray
    points_w: np.ndarray


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


# Step 6: the best view of each cell.


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
