"""Pictures: the report's figures for any recording, drawn with plain Matplotlib, and the picture of a search.

Matplotlib is an extra: it is imported when the first figure is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from pfslam.beyond.localization import LocalizationResult
from pfslam.events import scan_event
from pfslam.grid import GridSpec, MapConfig, OccupancyGrid
from pfslam.io.formats import map_pixels
from pfslam.map import Map
from pfslam.motion import controls, dead_reckoning
from pfslam.particles import ControlNoise, Particles, predict
from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording
from pfslam.refined.floor import map_texture
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam.texture import TextureConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRUTH = {"color": "#1b1b1b", "linestyle": ":", "label": "truth"}
ODOMETRY = {"color": "#d55e00", "linestyle": "--", "label": "dead reckoning"}
ESTIMATE = {"color": "#0072b2", "linestyle": "-", "label": "estimate"}
PARTICLES = {"color": "#56b4e9", "linewidth": 1.2, "marker": "o", "markevery": [-1], "label": "particles"}
"""Colours of Okabe and Ito, which stay apart under the common colour vision deficiencies."""
FAN = 5
"""Particles that are only predicted, as in the report."""
STEEP, STEEP_SHARE = np.deg2rad(8.0), 0.05
"""A robot that is tilted by more than this (rad) for a larger share of the time drives on slopes."""


def report_figures(
    recording: Recording, *, seed: int = 0, progress: Callable | None = None
) -> Iterator[tuple[str, Figure]]:
    """Yield the report's figures for a recording, with their file names: 1, 3, 5, 7a, 8a, 9a, or those of set 21.

    The filter is the report's, with its 200 particles. What the recording lacks has no figure.
    """
    noise, odometry = report_noise(recording), dead_reckoning(recording)
    reckoned = odometry.poses, ODOMETRY
    truth = [] if recording.truth is None else [(recording.truth.poses, TRUTH)]
    yield "dead_reckoning_trajectory", path_figure("Dead reckoning", *truth, reckoned)
    if recording.odometry is None:
        fan = prediction_fan(recording, noise, FAN, np.random.default_rng(seed)).swapaxes(0, 1)
        looks = [PARTICLES, *[PARTICLES | {"label": None}] * (FAN - 1)]
        title = f"Prediction only, {FAN} particles, $\\sigma_\\omega$ = {noise.sigma_omega:.3f} rad/s"
        yield "prediction_only", path_figure(title, *zip(fan, looks, strict=True), reckoned)
    if recording.lidar is None:
        return
    yield "dead_reckoning_map", map_figure("Map from dead reckoning", map_along(recording, odometry))
    config = SlamConfig.report(noise.sigma_v, noise.sigma_omega)
    result = run_slam(recording, config, rng=np.random.default_rng(seed), progress=progress)
    title = f"The report's filter, {config.particles} particles (not the refined one)"
    yield "slam_map", map_figure(title, result.grid)
    yield "slam_trajectory", path_figure(title, *truth, (result.trajectory.poses, ESTIMATE))
    if recording.camera is not None and len(recording.camera.rgb_index):
        settings = TextureConfig.report()
        texture = map_texture(recording, result.trajectory, result.grid, settings, progress=progress)
        rgba = np.dstack([texture.rgb, np.where(texture.seen, 255, 0).astype(np.uint8)])
        yield "texture_map", cells_figure("Floor texture", texture.spec, rgba, texture.seen)


def report_noise(recording: Recording) -> ControlNoise:
    """Return the noise that the report chose: sqrt(0.02) rad/s on flat floors, sqrt(0.05) rad/s on slopes.

    The report chose by data set; here the accelerometer decides (the robot of the second set is tilted by more than
    8 degrees for 13 % of the time).
    """
    variance = 0.02
    if recording.imu is not None:
        x, y, z = recording.robot.imu.in_body(recording.imu.acceleration_g).T
        if np.mean(np.abs(np.arctan2(x, np.hypot(y, z))) > STEEP) > STEEP_SHARE:
            variance = 0.05
    return ControlNoise(sigma_omega=float(np.sqrt(variance)))


def prediction_fan(
    recording: Recording, noise: ControlNoise, n: int, rng: np.random.Generator, every: int = 20
) -> np.ndarray:
    """Predict ``n`` particles without any scan: paths ``(T, n, 3)``, a row for every ``every``-th control."""
    inputs = controls(recording)
    particles, path = Particles.at(np.zeros(3), n), []
    for k, dt in enumerate(np.diff(inputs.t)):
        if k % every == 0:
            path.append(particles.poses)
        particles = predict(particles, inputs.v[k], inputs.omega[k], dt, noise, rng)
    return np.array([*path, particles.poses])


def map_along(
    recording: Recording, trajectory: Trajectory, config: MapConfig | None = None, every: int = 5
) -> OccupancyGrid:
    """Draw the map along a given trajectory, scan by scan: no filter. Scans outside its time are left out."""
    config, scans, lidar = config or MapConfig(), recording.scans(), recording.robot.lidar
    used = [i for i in range(0, len(scans.t), every) if trajectory.covers(scans.t[i])]
    events = [scan_event(scans.t[i], scans.ranges[i], lidar, np.zeros(3), ()) for i in used]
    drawn = list(zip(events, trajectory.at(scans.t[used]), strict=True))
    seen = [transform_points(pose, np.vstack([event.points_b, event.sensor_b])) for event, pose in drawn]
    map = Map(config, GridSpec.around(np.concatenate(seen), config.resolution))
    map.is_empty = False  # it holds all scans already: it need not be laid out around the first
    for event, pose in drawn:
        map.draw(event, pose)
    return map.grid


def sheet(title: str) -> tuple[Figure, Any]:
    """Make a figure with one pair of axes in metres."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.8, 6.2), layout="constrained")
    axes = figure.subplots()
    axes.set(title=title, xlabel="x (m)", ylabel="y (m)", aspect="equal")
    return figure, axes


def path_figure(title: str, *paths: tuple[np.ndarray, dict]) -> Figure:
    """Draw paths ``(K, 3)``, each with its look."""
    figure, axes = sheet(title)
    for poses, look in paths:
        axes.plot(*poses[:, :2].T, **look)
    axes.legend()
    return figure


def map_figure(title: str, grid: OccupancyGrid) -> Figure:
    """Draw a map: black occupied, white free, grey unknown."""
    shades = {"cmap": "gray_r", "vmin": -1.0, "vmax": 1.0}
    return cells_figure(title, grid.spec, np.sign(grid.log_odds), grid.log_odds != 0, **shades)


def cells_figure(title: str, spec: GridSpec, image: np.ndarray, known: np.ndarray, **look) -> Figure:
    """Draw the cells of a grid with half a metre around those that are known, ``(H, W)`` bool."""
    figure, axes = sheet(title)
    axes.imshow(image, origin="lower", extent=spec.extent, interpolation="nearest", **look)
    iy, ix = np.nonzero(known)
    if len(ix):
        (x0, y0), (x1, y1) = spec.cell_to_world([[ix.min(), iy.min()], [ix.max(), iy.max()]])
        axes.set(xlim=(x0 - 0.5, x1 + 0.5), ylim=(y0 - 0.5, y1 + 0.5))
    return figure


UNSURE, SURE, END = (170, 170, 170), (0, 114, 178), (213, 94, 0)
"""Colours (RGB) of estimates that were not found yet, of those that were, and of the last pose."""


def picture_of_search(grid: OccupancyGrid, result: LocalizationResult) -> np.ndarray:
    """Draw the estimates over the map, ``(H, W, 3)`` uint8 RGB: grey while unsure, blue once found, the last in red."""
    pixels = np.ascontiguousarray(np.repeat(map_pixels(grid)[..., None], 3, axis=2))
    cells = grid.spec.world_to_cell(result.trajectory.poses[:, :2])
    places = np.column_stack([cells[:, 0], grid.spec.shape[0] - 1 - cells[:, 1]]).clip(-10_000, 10**6)
    size = max(1, round(0.1 / grid.spec.resolution))
    for place, sure in zip(places.tolist(), result.located, strict=True):
        cv2.circle(pixels, place, size, SURE if sure else UNSURE, -1)
    cv2.circle(pixels, places[-1].tolist(), 2 * size, END, -1)
    return pixels


DASHES = {"odometry": (ODOMETRY, 8), "truth": (TRUTH, 3), "estimate": (ESTIMATE, 0), "revised": (ESTIMATE, 0)}
"""How the paths on a map look, and how many pixels a dash and a gap are long; 0 for a whole line."""
LARGEST = 4000
"""A picture of a map has at most so many pixels each way."""


def picture_of_run(grid: OccupancyGrid, paths: Mapping[str, np.ndarray]) -> np.ndarray:
    """Draw paths over a map, ``(H, W, 3)`` uint8 RGB: a pixel is a cell, unless the map is too large.

    ``paths`` are poses ``(K, 3)`` by name, NaN where they are not known.
    """
    n = -(-max(grid.spec.shape) // LARGEST)
    grey = cv2.resize(map_pixels(grid), None, fx=1 / n, fy=1 / n, interpolation=cv2.INTER_AREA)
    pixels = np.ascontiguousarray(np.repeat(grey[..., None], 3, axis=2))
    x, _, _, y = grid.spec.extent
    for name, poses in paths.items():
        look, dash = DASHES[name]
        at = (poses[np.isfinite(poses[:, 0]), :2] - [x, y]) * [1, -1] / (n * grid.spec.resolution) - 0.5
        way = np.append(0.0, np.cumsum(np.hypot(*np.diff(at, axis=0).T)))
        along = np.arange(0.0, way[-1] + 1.0)  # a point for each pixel of the way
        line = np.column_stack([np.interp(along, way, at[:, k]) for k in (0, 1)]).clip(-10_000, 100_000)
        part = along // dash if dash else np.zeros(len(along))
        pieces = np.split(np.rint(16 * line).astype(np.int32), np.flatnonzero(np.diff(part)) + 1)
        colour = tuple(bytes.fromhex(look["color"][1:]))
        cv2.polylines(pixels, pieces[:: 2 if dash else 1], False, colour, 2, cv2.LINE_AA, shift=4)
    return pixels
