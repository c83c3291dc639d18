"""The report's figures for any recording, and maps and paths that more than one chapter needs.

The artists have their names of before here, for chapters that do not yet draw in their own cells.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from pfslam.config import SlamConfig
from pfslam.grid import GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.motion import controls, dead_reckoning
from pfslam.particles import ControlNoise, Particles, predict
from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording
from pfslam.run import SlamResult, run_slam
from pfslam.sensors import scan_points
from pfslam.texture.mapping import FloorTexture, TextureConfig, map_texture
from pfslam_book.show.artists import draw_cloud as draw_particles  # noqa: F401
from pfslam_book.show.artists import draw_map, draw_scan  # noqa: F401
from pfslam_book.show.artists import draw_path as draw_trajectory
from pfslam_book.show.artists import draw_pose as draw_robot  # noqa: F401
from pfslam_book.show.style import COLOURS, metric_axes, new_figure

PREDICTION_PARTICLES = 5


def map_along(
    recording: Recording, trajectory: Trajectory, config: MapConfig | None = None, every: int = 5
) -> OccupancyGrid:
    """The map that a given trajectory draws, scan by scan: no filter. Scans outside its time are left out."""
    config = config or MapConfig()
    lidar, scans = recording.robot.lidar, recording.scans()
    ends: list[np.ndarray] = []
    hits = []
    for i in (i for i in range(0, len(scans.t), every) if trajectory.covers(scans.t[i])):
        pose = trajectory.at(scans.t[i])
        points = transform_points(pose, scan_points(scans.ranges[i], lidar))
        sensor = transform_points(pose, np.array([lidar.position_b[:2]]))[0]
        hits.append((points, np.flatnonzero(lidar.valid(scans.ranges[i])), sensor))
        ends.extend((points.min(axis=0), points.max(axis=0)) if len(points) else (sensor,))
    grid = OccupancyGrid.empty(GridSpec.around(np.array(ends), config.resolution))
    for points, beams, sensor in hits:
        if len(points):
            grid, _ = integrate_scan(grid, points, beams, sensor, config)
    return grid


def prediction_fan(
    recording: Recording, noise: ControlNoise, n: int, rng: np.random.Generator, every: int = 20
) -> np.ndarray:
    """Paths ``(T, n, 3)`` of ``n`` particles that are only predicted, one row for every ``every``-th control."""
    inputs = controls(recording)
    particles, path = Particles.at(np.zeros(3), n), []
    for k, dt in enumerate(np.diff(inputs.t)):
        if k % every == 0:
            path.append(particles.poses)
        particles = predict(particles, inputs.v[k], inputs.omega[k], dt, noise, rng)
    return np.array([*path, particles.poses])


def trajectory_figure(recording: Recording, trajectory: Trajectory, kind: str, title: str) -> Figure:
    """One path, with the true one beside it where it is known."""
    figure, axes = new_figure(6.8, 6.0)
    if recording.truth is not None:
        draw_trajectory(axes, recording.truth, "truth")
    draw_trajectory(axes, trajectory, kind, {"odometry": "dead reckoning"}.get(kind))
    metric_axes(axes, title).legend()
    return figure


def prediction_figure(recording: Recording, paths: np.ndarray, title: str) -> Figure:
    """The fan of predicted particles over the dead-reckoned path."""
    figure, axes = new_figure(6.8, 6.0)
    for k in range(paths.shape[1]):
        axes.plot(
            *paths[:, k, :2].T, color=COLOURS["particles"], linewidth=1.2, label=None if k else "particles"
        )
    axes.scatter(*paths[-1, :, :2].T, s=30, color=COLOURS["estimate"], zorder=3, label="where they end")
    draw_trajectory(axes, dead_reckoning(recording), "odometry", "dead reckoning")
    metric_axes(axes, title).legend()
    return figure


def map_figure(grid: OccupancyGrid, title: str, trajectory: Trajectory | None = None) -> Figure:
    """A map, with a path on it if one is given."""
    figure, axes = new_figure(6.8, 6.4)
    draw_map(axes, grid, title)
    if trajectory is not None:
        draw_trajectory(axes, trajectory, "estimate")
        axes.legend()
    return figure


def texture_figure(texture: FloorTexture, title: str) -> Figure:
    """The floor as the camera saw it; what it never saw stays paper."""
    figure, axes = new_figure(6.8, 6.4)
    image = np.dstack([texture.rgb, np.where(texture.seen, 255, 0).astype(np.uint8)])
    axes.imshow(image, origin="lower", extent=texture.spec.extent, interpolation="nearest")
    if texture.seen.any():
        iy, ix = np.nonzero(texture.seen)
        (x0, y0), (x1, y1) = texture.spec.cell_to_world([[ix.min(), iy.min()], [ix.max(), iy.max()]])
        axes.set_xlim(x0 - 0.5, x1 + 0.5)
        axes.set_ylim(y0 - 0.5, y1 + 0.5)
    metric_axes(axes, title)
    return figure


def report_noise(recording: Recording) -> ControlNoise:
    """The noise that the report chose: sqrt(0.02) rad/s on flat floors, sqrt(0.05) rad/s where the robot tilts.

    The report chose by data set; here the accelerometer decides. Tilted by more than 8 degrees for over 5 % of
    the time (the robot of the second set: 13 %) means slopes.
    """
    sloped = False
    if recording.imu is not None:
        g = recording.imu.acceleration_g
        sloped = np.mean(np.abs(np.arctan2(g[:, 0], np.hypot(g[:, 1], g[:, 2]))) > np.deg2rad(8.0)) > 0.05
    noise = SlamConfig.report(sigma_omega=float(np.sqrt(0.05 if sloped else 0.02))).noise
    assert isinstance(noise, ControlNoise)
    return noise


def report_figures(
    recording: Recording, *, seed: int = 0, progress: Callable | None = None
) -> dict[str, Figure]:
    """The report's figures for one recording, by file name: 1, 3, 5, 7a, 8a and 9a, or their siblings for set 21.

    The filter is the report's, with its 200 particles. The texture is there only where there are images.
    """
    noise, odometry = report_noise(recording), dead_reckoning(recording)
    spread = f"$\\sigma_\\omega$ = {noise.sigma_omega:.3f} rad/s"
    figures = {
        "dead_reckoning_trajectory": trajectory_figure(recording, odometry, "odometry", "Dead reckoning")
    }
    if recording.odometry is None:
        paths = prediction_fan(recording, noise, PREDICTION_PARTICLES, np.random.default_rng(seed))
        title = f"Prediction only, {PREDICTION_PARTICLES} particles, {spread}"
        figures["prediction_only"] = prediction_figure(recording, paths, title)
    if recording.lidar is None:
        return figures
    figures["dead_reckoning_map"] = map_figure(map_along(recording, odometry), "Map from dead reckoning")
    config = SlamConfig.report(noise.sigma_v, noise.sigma_omega)
    result: SlamResult = run_slam(recording, config, rng=np.random.default_rng(seed), progress=progress)
    figures["slam_map"] = map_figure(result.grid, f"Particle-filter SLAM, {config.particles} particles")
    figures["slam_trajectory"] = trajectory_figure(
        recording, result.trajectory, "estimate", "Particle-filter SLAM"
    )
    if recording.camera is not None and len(recording.camera.rgb_index):
        settings = TextureConfig.report()
        texture = map_texture(recording, result.trajectory, result.grid, settings, progress=progress)
        figures["texture_map"] = texture_figure(texture, "Floor texture")
    return figures
