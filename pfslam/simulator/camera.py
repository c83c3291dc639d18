"""The RGB-D camera: disparity and colour images, each rendered from the building when it is read.

A pixel's ray meets the floor or a wall. Walls are vertical, so the nearest wall in each horizontal direction is found
once and kept in a table by azimuth, where each pixel looks it up. All depths are inverse depths 1 / Z: the nearest
surface has the largest, and disparity is linear in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pfslam.poses import compose, rotation_matrix
from pfslam.sensors import RgbdModel
from pfslam.simulator.config import SimulatorConfig
from pfslam.simulator.drive import Drive
from pfslam.simulator.floor import Floor, paint_floor
from pfslam.simulator.ground import ground_in_view
from pfslam.simulator.pinhole import Eye, View, depth_pinhole, rgb_pinhole
from pfslam.simulator.walls import Skyline, skyline, wall_colours
from pfslam.simulator.world import World

NO_READING = 2047
DISTANT = 0.4  # 1 / m: the floor farther than 2.5 m is looked up in the coarse picture
RGB_NOISE = 2.0  # standard deviation of a colour value
TILE = (1024, 1536)  # noise is a cut-out of one tile, placed anew for every image


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
    """Renders images of a world along a drive; ``disparity_t`` and ``rgb_t`` are seconds from the first stamp."""

    world: World
    drive: Drive
    config: SimulatorConfig
    disparity_t: np.ndarray
    rgb_t: np.ndarray
    seed: np.random.SeedSequence

    @property
    def model(self) -> RgbdModel:
        return self.config.robot.camera

    @cached_property
    def floor(self) -> Floor:
        """The painted floor."""
        return paint_floor(self.world.plan, np.random.default_rng(self._streams[0]))

    @cached_property
    def _streams(self) -> list[np.random.SeedSequence]:
        fresh = np.random.SeedSequence(self.seed.entropy, spawn_key=self.seed.spawn_key)
        return fresh.spawn(3)

    @cached_property
    def depth_eye(self) -> Eye:
        """The depth camera on this robot."""
        return Eye.mounted(depth_pinhole(self.model), self.model)

    @cached_property
    def rgb_eye(self) -> Eye:
        """The colour camera on this robot."""
        return Eye.mounted(rgb_pinhole(self.model), self.model)

    @cached_property
    def _noise(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tiles of normal noise, of uniform numbers and of colour noise."""
        rng = np.random.default_rng(self._streams[1])
        colour = np.rint(RGB_NOISE * rng.standard_normal((*TILE, 3), dtype=np.float32)).astype(np.int16)
        return rng.standard_normal(TILE, dtype=np.float32), rng.random(TILE, dtype=np.float32), colour

    def read_disparity(self, k: int) -> np.ndarray:
        """Render the k-th disparity image, ``(480, 640)`` uint16; 2047 where there is no reading."""
        inverse = self.see(self.depth_eye, float(self.disparity_t[k])).inverse_depth
        model, config = self.model, self.config
        cut = self._cut(0, k)
        disparity = (model.depth_scale * inverse - np.float32(model.disparity_offset)) / model.disparity_slope
        if config.disparity_noise:
            disparity += np.float32(config.disparity_noise) * self._noise[0][cut]
        near, far = config.depth_limits
        seen = (
            (inverse <= 1.0 / near)
            & (inverse >= 1.0 / far)
            & (self._noise[1][cut] >= config.missing_disparity)
        )
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
        ground = ground_in_view(self.world.slopes, origin, yaw, view.ray)
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
        rng = np.random.default_rng([*self._streams[2].generate_state(2), stream, int(index)])
        v, u = rng.integers(0, [TILE[0] - self.model.height, TILE[1] - self.model.width])
        return slice(v, v + self.model.height), slice(u, u + self.model.width)
