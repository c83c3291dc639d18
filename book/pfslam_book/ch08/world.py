"""Chapter 08, faults of the world and of the camera: people and glass; wrong models of the depth camera."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.recording import Recording, nearest_stamp
from pfslam.refined.floor import read_disparity
from pfslam.refined.health import IMPROBABLE, departures
from pfslam.run import SlamResult, run_slam
from pfslam.sensors import RgbdModel, scan_points
from pfslam.simulator import Hazards, simulate
from pfslam.simulator.cache import cached_simulation
from pfslam.slam import SlamConfig
from pfslam.study.disturbances import first_seconds
from pfslam.texture import back_project, depth_from_disparity, to_world
from pfslam_book.ch08.data import hall
from pfslam_book.ch08.fault import Panel, Seen
from pfslam_book.show import faults

HAZARDS = {"people": Hazards(people=6), "glass": Hazards(glass=0.1)}
WITH_PEOPLE, OUT_AND_BACK = 32.0, 60.0
"""Seconds of the drive: up the corridor behind somebody; the way out, and a part of the way back."""


@cache
def _whole(hazard: str) -> Recording:
    """Return the whole drive through the hall, ``"empty"`` or with a hazard."""
    return simulate("hall", hazards=HAZARDS[hazard]).recording if hazard in HAZARDS else hall()


@cache
def world_run(
    hazard: str, seconds: float, every: int, second_look: bool = False
) -> tuple[Recording, SlamResult]:
    """Return the first seconds through the hall, ``"empty"`` or with a hazard, and the refined filter's run of them."""
    part, config = first_seconds(_whole(hazard), seconds), replace(SlamConfig.refined(), every=every)
    rng = np.random.default_rng(0)
    return part, run_slam(part, config, rng=rng, keep_particles=False, second_look=second_look)


def error_of(part: Recording, result: SlamResult) -> float:
    """Return the root mean square of a run's error (m)."""
    return trajectory_error(result.trajectory, part.true_path()).ate_rmse_m


def _map_of(part: Recording, result: SlamResult, **limits: tuple) -> Panel:
    """Return a part of the map at the end of a run, with the path of the estimate and the true one."""
    return Panel(
        grid=result.grid, paths={"truth": part.true_path(), "estimate": result.trajectory}, limits=limits
    )


def people(broken: bool) -> Seen:
    """Let somebody walk ahead of the robot and drag its estimate along."""
    part, result = world_run("people" if broken else "empty", WITH_PEOPLE, 5)
    t, (metres, sigma) = result.trajectory.t, departures(result.infos)
    panel = Panel(
        "time [s]", "moved by scans in 2 s [sigma]", curve=(t - t[0], metres / sigma), level=IMPROBABLE
    )
    return Seen(metres.max(), _map_of(part, result, xlim=(2.5, 9.0), ylim=(5.0, 16.5)), panel)


def glass(broken: bool) -> Seen:
    """Build walls that send no light back."""
    part, result = world_run("glass" if broken else "empty", OUT_AND_BACK, 20)
    t, ranges = part.scans().t[::20], part.scans().ranges[::20]
    missing = 100 * (~part.robot.lidar.valid(ranges)).mean(axis=1)
    panel = Panel("time [s]", "beams without echo [%]", curve=(t - t[0], missing))
    return Seen(missing.max(), _map_of(part, result, xlim=(2.0, 8.0), ylim=(9.0, 17.0)), panel)


# ---- the camera

SHOT, COUNTS = 900, 20.0
"""A disparity image with floor ahead and walls on both sides; by how many counts the disparities are off."""


def seen_points(camera: RgbdModel, floor: bool, step: int = 4) -> np.ndarray:
    """Return where a camera model puts the pixels that truly show floor, or those that do not: ``(M, 3)`` (body, m)."""
    simulation = cached_simulation("hall")
    stream, renderer = simulation.recording.camera, simulation.renderer
    assert stream is not None
    v, u = (axis.ravel() for axis in np.mgrid[: camera.height : step, : camera.width : step])
    disparity = read_disparity(stream, SHOT, simulation.recording.robot.camera)
    ground = renderer.see(renderer.depth_eye, float(renderer.disparity_t[SHOT])).ground
    depth = depth_from_disparity(disparity[v, u], camera)
    chosen = (ground[v, u] == floor) & np.isfinite(depth)
    v, u, depth = v[chosen], u[chosen], depth[chosen]
    return to_world(back_project(u, v, depth, camera.K), np.zeros(3), camera)


def beyond(points: np.ndarray, walls: np.ndarray, turn: float = 0.0) -> np.ndarray:
    """Return how much farther (m) than the LiDAR's nearest beam the camera sees each wall point after a turn (rad)."""
    bearing, order = np.arctan2(*walls.T[::-1]), np.argsort(np.arctan2(*walls.T[::-1]))
    beam = order[nearest_stamp(bearing[order], np.arctan2(points[:, 1], points[:, 0]) + turn)]
    return np.hypot(*points[:, :2].T) - np.hypot(*walls[beam].T)


def _look(camera: RgbdModel, turned: bool) -> Seen:
    """Return the floor and the walls by one camera model; the walls' turn (deg), or how far off (m) they are."""
    scans, camera_t = hall().scans(), hall().camera.disparity_t[SHOT : SHOT + 1]  # type: ignore[union-attr]
    lidar = scan_points(scans.ranges[int(nearest_stamp(scans.t, camera_t)[0])], hall().robot.lidar)
    floor, walls = seen_points(camera, floor=True), seen_points(camera, floor=False)
    walls, ahead = walls[walls[:, 2] > 0.1], floor[floor[:, 0] < 3.7][::7]
    turns = np.deg2rad(np.arange(-12.0, 12.01, 0.25))
    misfit = [np.median(np.abs(beyond(walls, lidar, turn))) for turn in turns]
    value = np.rad2deg(turns[np.argmin(misfit)]) if turned else np.median(beyond(walls, lidar))
    limits = {"xlim": (0, 6.5), "ylim": (-2.5, 4)}
    heights = Panel(
        "ahead [m]", "height [cm]", dots=(ahead[:, 0], 100 * ahead[:, 2]), limits={"ylim": (-15, 45)}
    )
    both = Panel("ahead [m]", "left [m]", dark=tuple(lidar.T), dots=tuple(walls[::5, :2].T), limits=limits)
    return Seen(float(value), heights, both)


def swapped_k(broken: bool) -> Seen:
    """Take the principal point in (row, column) order."""
    camera = hall().robot.camera
    return _look(faults.swapped_centre(camera) if broken else camera, turned=True)


def disparity_offset(broken: bool) -> Seen:
    """Read all disparities some counts off."""
    camera = hall().robot.camera
    return _look(faults.disparity_offset_by(camera, COUNTS) if broken else camera, turned=False)


def paired_by_number(broken: bool) -> Seen:
    """Pair images by their number instead of their stamp."""
    stream, truth = hall().camera, hall().true_path()
    assert stream is not None
    depth, rgb = nearest_stamp(stream.disparity_t, stream.rgb_t), np.arange(len(stream.rgb_t))
    if broken:
        depth, rgb = faults.pairs_by_number(len(stream.disparity_t), len(stream.rgb_t))
    t, t_rgb = stream.disparity_t[depth], stream.rgb_t[rgb]
    inside = truth.covers(t) & truth.covers(t_rgb)
    t, t_rgb = t[inside], t_rgb[inside]
    moved = np.hypot(*(truth.at(t_rgb) - truth.at(t))[:, :2].T)
    pair, gap = np.arange(len(t)), np.abs(t_rgb - t)
    gaps = Panel("pair", "time between images [s]", curve=(pair, gap))
    return Seen(float(np.median(gap)), Panel("pair", "robot moved [m]", curve=(pair, moved)), gaps)
