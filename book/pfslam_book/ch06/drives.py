"""Chapter 06: image pairs of a simulated drive, and what the truth says about pictures of its floor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pfslam.grid import GridSpec
from pfslam.poses import Trajectory
from pfslam.recording import Recording, RgbdStream, image_pairs, nearest_stamp
from pfslam.refined.floor import read_disparity, read_rgb
from pfslam.sensors import RgbdModel
from pfslam.simulator import Simulation
from pfslam.simulator.cache import cached_simulation
from pfslam.texture import FloorTexture
from pfslam_book.show.texture_error import pattern_shifts, visible_floor

EVERY = 60
"""Of the scans: the image pair nearest to each is taken. The filter updates at these scans too, so that an image has
a state near it although so few images are used."""
WORD_SHOT = 1091  # the disparity image with the letter C in front of the robot
VISIBLE_TO = 4.0  # m: floor that an image shows no nearer than this is not asked for


@dataclass(frozen=True, eq=False)
class Shot:
    """One image pair, the pose it was taken from, and the truth: ``ground (H, W)`` marks what is floor."""

    disparity: np.ndarray
    rgb: np.ndarray
    pose: np.ndarray
    true_depth: np.ndarray
    ground: np.ndarray
    camera: RgbdModel


@dataclass(frozen=True, eq=False)
class Drive:
    """A simulated drive with few image pairs, each rendered once, and the truth."""

    simulation: Simulation
    recording: Recording
    stream: RgbdStream
    truth: Trajectory


def load_drive(name: str, every: int = EVERY) -> Drive:
    """Load a built-in drive with the image pair nearest to each ``every``-th scan."""
    simulation = cached_simulation(name)
    camera, truth = simulation.recording.camera, simulation.recording.truth
    if camera is None or truth is None:  # the simulator makes both
        raise ValueError(f"{name}: no camera or no truth")
    pairs, stamps = image_pairs(camera), simulation.recording.scans().t[::every]
    chosen = np.unique(nearest_stamp(camera.disparity_t[pairs.disparity], stamps))
    few = replace(
        camera,
        disparity_index=pairs.disparity[chosen],
        rgb_index=pairs.rgb[chosen],
        read_disparity=lru_cache(128)(camera.read_disparity),
        read_rgb=lru_cache(128)(camera.read_rgb),
    )
    return Drive(simulation, replace(simulation.recording, camera=few), few, truth)


def take_shot(drive: Drive, k: int = WORD_SHOT) -> Shot:
    """Take disparity image ``k`` with the colour image nearest in time."""
    renderer, stream, camera = drive.simulation.renderer, drive.stream, drive.recording.robot.camera
    t = stream.disparity_t[k]
    j = int(nearest_stamp(stream.rgb_t, np.array([t]))[0])
    sight = renderer.see(renderer.depth_eye, float(renderer.disparity_t[k]))
    with np.errstate(divide="ignore"):
        true_depth = 1.0 / sight.inverse_depth
    disparity, rgb = read_disparity(stream, k, camera), read_rgb(stream, j, camera)
    return Shot(disparity, rgb, drive.truth.at(t), true_depth, sight.ground, camera)


def shots_along(drive: Drive, n: int = 12) -> list[Shot]:
    """Take ``n`` shots spread over the drive, those at rest at both ends left out."""
    index = drive.stream.disparity_index
    chosen = index[np.linspace(0.12 * len(index), 0.88 * len(index), n).astype(int)]
    return [take_shot(drive, int(k)) for k in chosen]


@dataclass(frozen=True, eq=False)
class Judge:
    """The true floor on the cells of ``spec``: colours, which cells are floor, which the images could show."""

    spec: GridSpec
    colours: np.ndarray
    floor: np.ndarray
    visible: np.ndarray
    window: tuple[slice, slice]

    def cut(self, texture: FloorTexture) -> np.ndarray:
        """The colours of a texture of the whole map, on our cells; black where nothing was painted."""
        return texture.rgb[self.window]

    def shift(self, rgb: np.ndarray) -> float:
        """By how much the pattern of colours ``(H, W, 3)`` is displaced (m): the median over patches of a metre."""
        seen = rgb.any(axis=2) & self.floor
        moved = np.hypot(*pattern_shifts(rgb, seen, self.colours, self.floor).T)
        return self.spec.resolution * float(np.median(moved)) if len(moved) else np.nan


@lru_cache(8)
def judge_for(drive: Drive, spec: GridSpec, margin: int = 20) -> Judge:
    """Prepare what the truth says about the floor, on those cells of ``spec`` that the building takes up."""
    floor = drive.simulation.world.free_area(spec)
    iy, ix = np.nonzero(floor)
    low = np.maximum([ix.min() - margin, iy.min() - margin], 0)
    window = slice(low[1], iy.max() + margin), slice(low[0], ix.max() + margin)
    floor = floor[window]
    x, y = np.array(spec.origin) + low * spec.resolution
    cut = GridSpec((float(x), float(y)), spec.resolution, floor.shape)
    t = drive.stream.disparity_t[drive.stream.disparity_index]
    poses = drive.truth.at(t[drive.truth.covers(t)])
    visible = visible_floor(cut, poses, drive.recording.robot.camera, ~floor, VISIBLE_TO)
    return Judge(cut, drive.simulation.floor_image(cut), floor, visible & floor, window)
