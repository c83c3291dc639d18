"""Chapter 06: image pairs of a simulated drive, what the truth says about them, and scores of floor textures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from pfslam.grid import GridSpec
from pfslam.poses import Trajectory
from pfslam.recording import Recording, RgbdStream, image_pairs, nearest_stamp
from pfslam.refined.floor import (
    PixelRays,
    fit_floor_plane,
    floor_pixels,
    level_camera,
    map_texture,
    posed_pairs,
    read_disparity,
    read_rgb,
)
from pfslam.run import SlamResult, run_slam
from pfslam.sensors import RgbdModel
from pfslam.simulator import Simulation
from pfslam.simulator.cache import cached_simulation
from pfslam.slam import SlamConfig
from pfslam.texture import (
    FloorTexture,
    TextureConfig,
    associate_rgb,
    back_project,
    depth_from_disparity,
    depth_mask,
    floor_mask,
    project_floor,
    to_world,
)
from pfslam_book.show.tables import Shown
from pfslam_book.show.texture_error import TextureError, texture_error, visible_floor

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
        read_disparity=cache(camera.read_disparity),
        read_rgb=cache(camera.read_rgb),
    )
    return Drive(simulation, replace(simulation.recording, camera=few), few, truth)


def cheap_run(drive: Drive) -> SlamResult:
    """Run the refined filter with 20 particles on every tenth scan: two seconds, and poses good to a centimetre."""
    config = replace(SlamConfig.refined(), particles=20, every=10)
    return run_slam(drive.recording, config, keep_particles=False)


def state_gaps(drive: Drive, result: SlamResult) -> tuple[float, float]:
    """Give how far in time (s, median) an image is from its state if every state takes its nearest image.

    First with the drive's few images, then with all that the camera took.
    """
    whole, states, gaps = drive.simulation.recording.camera, result.trajectory.t, []
    assert whole is not None  # every simulated drive has one
    for stamps in (
        drive.stream.disparity_t[drive.stream.disparity_index],
        whole.disparity_t[image_pairs(whole).disparity],
    ):
        taken = np.unique(stamps[nearest_stamp(stamps, states)])
        gaps.append(float(np.median(np.abs(taken - states[nearest_stamp(states, taken)]))))
    return gaps[0], gaps[1]


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
class Points:
    """Every ``step``-th pixel of a shot, row by row: pixels, depth (m) and points in the body frame (m)."""

    u: np.ndarray
    v: np.ndarray
    depth: np.ndarray
    points_b: np.ndarray


def points_of(shot: Shot, camera: RgbdModel | None = None, step: int = 4) -> Points:
    """Do steps 2 and 4 for a whole image, seen from the robot: the pose is zero."""
    camera = camera or shot.camera
    v, u = (axis.ravel() for axis in np.mgrid[: camera.height : step, : camera.width : step])
    depth = depth_from_disparity(shot.disparity[v, u], camera)
    return Points(u, v, depth, to_world(back_project(u, v, depth, camera.K), np.zeros(3), camera))


def chosen_as_floor(
    points: Points, tolerance: float, z_max: float = 10.0, per_metre: float = 0.0
) -> np.ndarray:
    """Do steps 3 and 5 with Z_MIN 0.1 m: say which points are taken for floor (bool)."""
    trusted = depth_mask(points.depth, 0.1, z_max)
    return trusted & floor_mask(points.points_b, tolerance, per_metre, points.depth)


def floor_shares(shot: Shot, points: Points, chosen: np.ndarray) -> tuple[float, float]:
    """Give the share of the floor's pixels that were chosen, and the share of the chosen that are no floor."""
    ground = shot.ground[points.v, points.u] & np.isfinite(points.depth)
    right = np.count_nonzero(chosen & ground)
    count = int(np.count_nonzero(chosen))
    return float(right / np.count_nonzero(ground)), float(1.0 - right / max(count, 1)) if count else 0.0


def pitched(camera: RgbdModel, error_deg: float) -> RgbdModel:
    """Give the camera as a program has it whose pitch is wrong by so many degrees."""
    return replace(camera, pitch=camera.pitch + np.deg2rad(error_deg))


def pitch_sweep(shots: list[Shot], errors_deg, tolerance: float, per_metre: float = 0.0) -> np.ndarray:
    """Give the share of floor ``(errors, shots)`` that is found with a wrong pitch."""
    table = []
    for error in errors_deg:
        clouds = [points_of(shot, pitched(shot.camera, error), step=8) for shot in shots]
        table.append(
            [
                floor_shares(s, p, chosen_as_floor(p, tolerance, 10.0, per_metre))[0]
                for s, p in zip(shots, clouds, strict=True)
            ]
        )
    return np.array(table)


def registered_colours(shot: Shot, points: Points, camera: RgbdModel | None = None) -> np.ndarray:
    """Do step 1: take the colour ``(M, 3)`` of each pixel where Eq. 16 says."""
    u, v = associate_rgb(points.u, points.v, shot.disparity[points.v, points.u], camera or shot.camera)
    h, w = shot.rgb.shape[:2]
    return shot.rgb[np.clip(np.rint(v), 0, h - 1).astype(int), np.clip(np.rint(u), 0, w - 1).astype(int)]


def journey(shot: Shot, u: int, v: int, spec: GridSpec) -> list[tuple[str, str]]:
    """Follow one pixel through the six steps with the report's settings, up to where it is refused."""
    d, config = int(shot.disparity[v, u]), TextureConfig.report()
    rows = [("depth pixel", f"u = {u}, v = {v}, d = {d}")]
    depth = float(depth_from_disparity(d, shot.camera))
    if not np.isfinite(depth):
        return [*rows, ("1 colour pixel", "no reading: the journey ends here")]
    u_rgb, v_rgb = associate_rgb(u, v, d, shot.camera)
    rows.append(("1 colour pixel", f"u = {u_rgb:.1f}, v = {v_rgb:.1f}"))
    point_o = back_project(u, v, depth, shot.camera.K)
    rows.append(("2 optical point", "X = {:.2f}, Y = {:.2f}, Z = {:.2f} m".format(*point_o[0])))
    trusted = bool(depth_mask(depth, config.z_min, config.z_max))
    verdict = "trusted" if trusted else "refused"
    rows.append(("3 depth", f"{config.z_min:g} <= {depth:.2f} <= {config.z_max:g} m: {verdict}"))
    if not trusted:
        return rows
    point_w = to_world(point_o, shot.pose, shot.camera)
    rows.append(("4 world point", "x = {:.2f}, y = {:.2f}, z = {:.3f} m".format(*point_w[0])))
    floor = bool(floor_mask(point_w, config.floor_tolerance)[0])
    rows.append(("5 floor", f"|z| {'<=' if floor else '>'} 0.01 m: {'floor' if floor else 'not floor'}"))
    if floor:
        cell = project_floor(u, v, d, shot.pose, shot.camera, spec, config).cells[0]
        colour = shot.rgb[round(float(v_rgb)), round(float(u_rgb))]
        rows.append(("6 map cell", "[iy = {1}, ix = {0}] becomes ({2}, {3}, {4})".format(*cell, *colour)))
    return rows


@dataclass(frozen=True, eq=False)
class CellViews:
    """Every look at one cell of the floor in the order of time: stamps (s), depths (m), colours ``(V, 3)``."""

    t: np.ndarray
    depth: np.ndarray
    colours: np.ndarray


def views_of_cell(drive: Drive, result: SlamResult, place: tuple[float, float]) -> CellViews:
    """Collect what every image pair of the drive saw in the cell around ``place`` (m): its nearest pixel there."""
    config, camera, spec = TextureConfig.refined(), drive.recording.robot.camera, result.grid.spec
    pairs = posed_pairs(drive.stream, result.trajectory, config)
    rays, cell = PixelRays.of(camera, config, spec.resolution), spec.world_to_cell(np.array([place]))[0]
    seen = []
    for k, (at_depth, at_rgb) in enumerate(zip(pairs.disparity, pairs.rgb, strict=True)):
        disparity = read_disparity(drive.stream, at_depth, camera)
        pixels = floor_pixels(disparity, rays, pairs.pose_disparity[k], pairs.pose_rgb[k], spec, config)
        if pixels is None:
            continue
        inside = np.flatnonzero((pixels.cells == cell).all(axis=1))
        if len(inside):
            one = inside[np.argmin(pixels.depth[inside])]
            v, u = round(float(pixels.v_rgb[one])), round(float(pixels.u_rgb[one]))
            if 0 <= v < camera.height and 0 <= u < camera.width:
                colour = read_rgb(drive.stream, at_rgb, camera)[v, u]
                seen.append((drive.stream.disparity_t[at_depth], pixels.depth[one], colour))
    t, depth, colours = zip(*seen, strict=True)
    return CellViews(np.array(t) - drive.stream.disparity_t[0], np.array(depth), np.array(colours))


@dataclass(frozen=True, eq=False)
class Judge:
    """The true floor on one window of a map: colours, which cells are floor, which the images could show."""

    spec: GridSpec
    window: tuple[slice, slice]
    colours: np.ndarray
    floor: np.ndarray
    visible: np.ndarray

    def cut(self, texture: FloorTexture) -> FloorTexture:
        """The texture on the window."""
        return replace(texture, spec=self.spec, rgb=texture.rgb[self.window], seen=texture.seen[self.window])

    def colour_at(self, place: tuple[float, float]) -> np.ndarray:
        """Give the true colour ``(3,)`` of the cell around ``place`` (m)."""
        ix, iy = self.spec.world_to_cell(np.array([place]))[0]
        return self.colours[iy, ix]

    def error(self, texture: FloorTexture) -> TextureError:
        """Compare a texture with the true floor."""
        return texture_error(self.cut(texture), self.colours, self.floor, self.visible)


def judge_for(drive: Drive, spec: GridSpec, margin: int = 20) -> Judge:
    """Prepare what the truth says about textures on the cells of ``spec``."""
    floor = drive.simulation.floor_area(spec)
    iy, ix = np.nonzero(floor)
    low = np.maximum([ix.min() - margin, iy.min() - margin], 0)
    window = slice(low[1], iy.max() + margin), slice(low[0], ix.max() + margin)
    floor = floor[window]
    x, y = np.array(spec.origin) + low * spec.resolution
    cut = GridSpec((float(x), float(y)), spec.resolution, floor.shape)
    stream, truth = drive.stream, drive.truth
    t = stream.disparity_t[stream.disparity_index]
    poses = truth.at(t[truth.covers(t)])
    visible = visible_floor(cut, poses, drive.recording.robot.camera, ~floor, VISIBLE_TO)
    return Judge(cut, window, drive.simulation.floor_image(cut), floor, visible)


RUNGS = {
    "report": "report",
    "cut to the map": "cut to the map",
    "pose of its own time": "a pose for every image",
    "depth limited": "depth range",
    "tolerance grows, floor plane fitted": "pitch from the floor plane",
    "best view kept": "best view wins",
}
"""The lines of the chapter's table, each with the step of ``TextureConfig.steps`` that it ends with."""


def climb(
    drive: Drive, result: SlamResult, judge: Judge, rungs: Sequence[str] = tuple(RUNGS)
) -> dict[str, tuple[FloorTexture, TextureError]]:
    """Map the texture with the settings of each rung, and judge each map."""
    steps, maps = TextureConfig.steps(), {}
    for name in rungs:
        texture = map_texture(drive.recording, result.trajectory, result.grid, steps[RUNGS[name]])
        maps[name] = judge.cut(texture), judge.error(texture)
    return maps


def score_table(maps: dict[str, tuple[FloorTexture, TextureError]]) -> Shown:
    """List the scores of each map, rounded to what survives another processor."""
    rows = []
    for name, (_, e) in maps.items():
        shift = f"{e.position_median_cells:.1f}"
        rows.append(
            (name, f"{100 * e.coverage:.0f}", f"{100 * e.beyond_floor:.0f}", shift, f"{e.colour_mean:.0f}")
        )
    heads = (
        "settings",
        "floor covered [%]",
        "paint off the floor [%]",
        "shift [cells]",
        "colour error [of 255]",
    )
    return Shown(heads, rows)


def journey_table(shot: Shot, u: int, v: int, spec: GridSpec) -> Shown:
    """List the journey of one pixel."""
    return Shown(("step", "result"), journey(shot, u, v, spec))


def fitted_camera(shot: Shot, camera: RgbdModel) -> RgbdModel:
    """Correct pitch and height of the camera by the floor that this one shot shows."""
    points = points_of(shot, camera)
    near = np.isfinite(points.depth) & (points.depth < 4.0)
    plane = fit_floor_plane(points.points_b[near])
    return level_camera(camera, plane.pitch_error, plane.height)
