"""The RGB-D camera: disparity and colour images, each rendered from the building when it is read.

A pixel's ray meets the floor or a wall. Walls are vertical, so the nearest wall in each horizontal direction is found
once and kept in a table by azimuth, where each pixel looks it up. All depths are inverse depths 1 / Z: the nearest
surface has the largest, and disparity is linear in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pfslam.poses import apply_transform, compose, rotation_matrix
from pfslam.sensors import RgbdModel
from pfslam.simulator.config import SimulatorConfig
from pfslam.simulator.drive import Drive
from pfslam.simulator.floor import Floor, paint_floor
from pfslam.simulator.ground import ground_in_view
from pfslam.simulator.world import WALL_KINDS, World
from pfslam.texture import NO_READING

NEAREST, FARTHEST = 0.5, 9.0  # where the depth camera gives a reading (m)
DISTANT = 0.4  # 1 / m: the floor farther than 2.5 m is looked up in the coarse picture
RGB_NOISE = 2.0  # standard deviation of a colour value
TILE = (1024, 1536)  # noise is a cut-out of one tile, placed anew for every image
AZIMUTH_STEP = float(np.deg2rad(0.05))
AZIMUTHS = np.arange(-1200, 1201) * AZIMUTH_STEP  # from the robot's heading, +-60 deg

PLASTER = np.array([226.0, 218.0, 204.0])
DOORS = np.array([[72, 104, 128], [146, 96, 58], [96, 124, 92], [150, 70, 62]], dtype=float)
CLUTTER = np.array(
    [[196, 160, 92], [92, 110, 132], [168, 88, 70], [120, 140, 104], [188, 188, 184]], dtype=float
)
COAT = np.array([150.0, 60.0, 70.0])
PANEL = 1.2  # joints between wall panels (m)


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
    def mounted(cls, model: RgbdModel, focal, centre, sideways: float = 0.0) -> Eye:
        """Mount a pinhole camera with ``focal``, ``centre`` (u, v) px, ``sideways`` (m) to the right of the model's."""
        shape = (model.height, model.width)
        x, y = ((np.arange(n) - c) / f for n, c, f in zip(shape[::-1], centre, focal, strict=True))
        rays_o = [np.broadcast_to(x, shape), np.broadcast_to(y[:, None], shape), np.ones(shape)]
        rays_b = np.einsum("ij,jhw->ihw", model.T_bo[:3, :3], np.stack(rays_o)).astype(np.float32)
        return cls(rays_b, apply_transform(model.T_bo, (sideways, 0.0, 0.0)), View.tilted(rays_b))

    @classmethod
    def of_colour(cls, model: RgbdModel) -> Eye:
        """Mount the colour camera that Eq. 16 describes.

        Eq. 16 turns u = f X/Z + c into a u_rgb linear in X/Z and 1/Z, which is a pinhole camera displaced along x.
        """
        scale = model.rgb_focal / model.rgb_divisor
        focal = (scale * model.focal_u, scale * model.focal_v)
        centre_u = scale * model.centre_u + model.rgb_offset_u / model.rgb_divisor
        centre_v = scale * model.centre_v + model.rgb_offset_v / model.rgb_divisor
        sideways = -model.rgb_baseline * model.depth_scale / model.rgb_divisor / focal[0]
        return cls.mounted(model, focal, (centre_u, centre_v), sideways)


@dataclass(frozen=True, eq=False)
class Skyline:
    """What is nearest at each azimuth: ``inverse_distance (A,)`` float32, 1/m in plan view, and ``colour (A, 3)``."""

    inverse_distance: np.ndarray
    colour: np.ndarray


def skyline(world: World, origin: np.ndarray, yaw: float, t: float) -> Skyline:
    """Look around from ``origin (2,)`` of the plan at time ``t`` (s)."""
    direction = np.column_stack([np.cos(yaw + AZIMUTHS), np.sin(yaw + AZIMUTHS)])
    inverse, wall, along = _nearest_wall(world, origin, direction, t)
    colour = _wall_paint(world, wall, along)
    for person in world.people:
        centre = person.at(np.array([t]))[0] - origin
        ahead = direction @ centre
        inside = ahead**2 - (centre @ centre - person.radius**2)
        hit = (inside > 0.0) & (ahead > 0.0)
        nearer = np.zeros(len(AZIMUTHS))
        nearer[hit] = 1.0 / (ahead[hit] - np.sqrt(inside[hit]))
        shown = nearer > inverse
        inverse = np.maximum(inverse, nearer)
        colour[shown] = COAT * (0.7 + 0.3 * np.sqrt(inside[shown])[:, None] / person.radius)
    return Skyline(inverse.astype(np.float32), colour.astype(np.float32))


def _nearest_wall(world: World, origin, direction, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find inverse distance, wall index and distance along that wall (m), all ``(A,)``, for directions ``(A, 2)``."""
    begin, edge = world.walls[:, 0] - origin, world.walls[:, 1] - world.walls[:, 0]
    facing = begin[:, 0] * edge[:, 1] - begin[:, 1] * edge[:, 0]
    there = (world.closed[:, 0] <= t) & (t <= world.closed[:, 1]) & (np.abs(facing) > 1e-9)
    walls = np.flatnonzero(there)
    begin, edge, facing = begin[walls], edge[walls], facing[walls]
    # origin + d direction = begin + s edge, by Cramer's rule: 1/d and s.
    inverse = (edge[:, 1:] * direction[:, 0] - edge[:, :1] * direction[:, 1]) / facing[:, None]
    turned = (begin[:, 1:] * direction[:, 0] - begin[:, :1] * direction[:, 1]) / facing[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = turned / -inverse
    hit = (inverse > 0.0) & (part >= -1e-9) & (part <= 1.0 + 1e-9)
    inverse = np.where(hit, inverse, 0.0)
    best = inverse.argmax(axis=0)
    columns = np.arange(len(direction))
    along = np.nan_to_num(part[best, columns]) * np.hypot(*edge[best].T)
    return inverse[best, columns], walls[best], along


def _wall_paint(world: World, wall: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Colour walls ``(A, 3)``, lit from one side: plaster with joints, doors in the alcoves, boxes in the room."""
    kind = world.wall_kind[wall]
    edge = world.walls[wall, 1] - world.walls[wall, 0]
    length = np.hypot(edge[:, 0], edge[:, 1])
    colour = np.tile(PLASTER, (len(wall), 1))
    door = (kind == WALL_KINDS.index("alcove")) & (length > 0.5) | (kind == WALL_KINDS.index("door"))
    colour[door] = DOORS[wall[door] % len(DOORS)]
    box = kind == WALL_KINDS.index("clutter")
    colour[box] = CLUTTER[(wall[box] // 4) % len(CLUTTER)]
    light = 0.86 + 0.14 * edge[:, 1] / length  # the way the wall faces
    light = np.where((along % PANEL < 0.02) & (kind == 0), 0.72 * light, light)
    light = np.where(np.minimum(along, length - along) < 0.04, 0.85 * light, light)
    return colour * light[:, None]


def wall_colours(sky: Skyline, column: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Colour walls seen in ``column (H, W)`` of the skyline at ``height (H, W)`` m: ``(H, W, 3)`` uint8."""
    step = np.clip((height + np.float32(1.0)) * np.float32(100.0), 0, len(_BY_HEIGHT) - 1).astype(np.int32)
    picture = sky.colour[column]
    picture *= _BY_HEIGHT[step][..., None]
    return picture.astype(np.uint8)


def _height_profile() -> np.ndarray:
    """Tabulate the brightness of a wall in 1 cm steps from -1 m: skirting board, wainscot, rail, plaster."""
    height = np.arange(-100, 400) / 100.0
    profile = np.where(height < 0.95, 0.88, 1.0)
    profile[(height > 0.95) & (height < 1.03)] = 0.6
    profile[height < 0.12] = 0.45
    return (profile * (0.94 + 0.02 * np.clip(height, 0.0, 3.0))).astype(np.float32)


_BY_HEIGHT = _height_profile()


@dataclass(frozen=True, eq=False)
class Sight:
    """What one camera sees at one moment.

    ``inverse_depth (H, W)`` is in 1/m, and ``ground (H, W)`` marks the pixels that show the ground.
    """

    inverse_depth: np.ndarray
    ground: np.ndarray
    view: View
    skyline: Skyline
    origin: np.ndarray
    yaw: float


@dataclass(frozen=True, eq=False)
class CameraRenderer:
    """Renders images of a world along a drive; ``disparity_t`` and ``rgb_t`` are seconds from the first stamp.

    ``seeds`` are those of the floor, of the tiles of noise, and of where noise is cut from them.
    """

    world: World
    drive: Drive
    config: SimulatorConfig
    disparity_t: np.ndarray
    rgb_t: np.ndarray
    seeds: tuple[np.random.SeedSequence, ...]

    @property
    def model(self) -> RgbdModel:
        return self.config.robot.camera

    @cached_property
    def floor(self) -> Floor:
        """The painted floor."""
        return paint_floor(self.world.plan, np.random.default_rng(self.seeds[0]))

    @cached_property
    def depth_eye(self) -> Eye:
        """The depth camera on this robot."""
        model = self.model
        return Eye.mounted(model, (model.focal_u, model.focal_v), (model.centre_u, model.centre_v))

    @cached_property
    def rgb_eye(self) -> Eye:
        """The colour camera on this robot."""
        return Eye.of_colour(self.model)

    @cached_property
    def _noise(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tiles of normal noise, of uniform numbers and of colour noise."""
        rng = np.random.default_rng(self.seeds[1])
        colour = np.rint(RGB_NOISE * rng.standard_normal((*TILE, 3), dtype=np.float32)).astype(np.int16)
        return rng.standard_normal(TILE, dtype=np.float32), rng.random(TILE, dtype=np.float32), colour

    def read_disparity(self, k: int) -> np.ndarray:
        """Render the k-th disparity image, ``(480, 640)`` uint16; 2047 where there is no reading."""
        inverse = self.see(self.depth_eye, float(self.disparity_t[k])).inverse_depth
        model, config = self.model, self.config
        cut = self._cut(0, k)
        disparity = (model.depth_scale * inverse - np.float32(model.disparity_offset)) / model.disparity_slope
        disparity += np.float32(config.disparity_noise) * self._noise[0][cut]
        seen = (inverse <= 1.0 / NEAREST) & (inverse >= 1.0 / FARTHEST)
        seen &= self._noise[1][cut] >= config.missing_disparity
        return np.where(seen, np.rint(disparity), NO_READING).astype(np.uint16)

    def read_rgb(self, j: int) -> np.ndarray:
        """Render the j-th colour image, ``(480, 640, 3)`` uint8."""
        sight = self.see(self.rgb_eye, float(self.rgb_t[j]))
        picture = self._colours(sight).astype(np.int16) + self._noise[2][self._cut(1, j)]
        return np.clip(picture, 0, 255).astype(np.uint8)

    def true_depth(self, k: int) -> np.ndarray:
        """Give the depth Z ``(480, 640)`` in metres behind the k-th disparity image, free of errors."""
        with np.errstate(divide="ignore"):
            return 1.0 / self.see(self.depth_eye, float(self.disparity_t[k])).inverse_depth

    def see(self, eye: Eye, t: float) -> Sight:
        """Compute what a camera of the robot sees at time ``t`` (s from the first encoder stamp)."""
        poses, heights, pitches, rolls = self.drive.at(np.array([t]))
        x, y, yaw = compose(self.world.pose_pw, poses)[0]
        z, pitch, roll = float(heights[0]), float(pitches[0]), float(rolls[0])
        view = View.tilted(eye.rays_b, pitch, roll) if abs(pitch) + abs(roll) > 1e-9 else eye.level
        origin = np.array([x, y, z]) + rotation_matrix(roll, pitch, yaw) @ eye.position_b
        around = skyline(self.world, origin[:2], yaw, t)
        wall = view.level * around.inverse_distance[view.column]
        c, s = np.float32(np.cos(yaw)), np.float32(np.sin(yaw))
        ahead, aside, up = view.ray
        slopes = [slope for slope in self.world.slopes if slope.may_be_seen(origin, yaw)]
        in_plan = (c * ahead - s * aside, s * ahead + c * aside, up) if slopes else view.ray
        ground = ground_in_view(slopes, origin, in_plan)
        return Sight(np.maximum(wall, ground), ground >= wall, view, around, origin, yaw)

    def _colours(self, sight: Sight) -> np.ndarray:
        """Look up the colours ``(H, W, 3)`` uint8 of what is seen."""
        depth = np.float32(1.0) / np.maximum(sight.inverse_depth, np.float32(1e-4))
        c, s = np.float32(np.cos(sight.yaw)), np.float32(np.sin(sight.yaw))
        ahead, aside = depth * sight.view.ray[0], depth * sight.view.ray[1]
        x = c * ahead - s * aside + np.float32(sight.origin[0])
        y = s * ahead + c * aside + np.float32(sight.origin[1])
        height = depth * sight.view.ray[2] + np.float32(sight.origin[2])
        picture = wall_colours(sight.skyline, sight.view.column, height)
        near = sight.ground & (sight.inverse_depth >= DISTANT)
        far = sight.ground & ~near
        for mask, distant in ((near, False), (far, True)):
            rows = np.flatnonzero(mask.any(axis=1))
            if len(rows):
                strip = slice(rows[0], rows[-1] + 1)
                colours = self.floor.colours(x[strip], y[strip], distant)
                np.copyto(picture[strip], colours, where=mask[strip, :, None])
        return picture

    def _cut(self, stream: int, index: int) -> tuple[slice, slice]:
        """Choose where the noise of one image is cut from the tiles."""
        rng = np.random.default_rng([*self.seeds[2].generate_state(2), stream, int(index)])
        v, u = rng.integers(0, [TILE[0] - self.model.height, TILE[1] - self.model.width])
        return slice(v, v + self.model.height), slice(u, u + self.model.width)
