"""The simulated drives, measured like the real ones, and the geometry behind them."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from drives import simulated
from rooms import distance_to_walls

from pfslam.errors import DataError
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec
from pfslam.motion import dead_reckoning
from pfslam.poses import rotation_matrix, transform_points, wrap_angle
from pfslam.recording import nearest_stamp
from pfslam.sensors import scan_points
from pfslam.simulator import HALL, RAMP, Hazards, SimulatorConfig, simulate
from pfslam.simulator.clocks import START_OF_TIME
from pfslam.simulator.drive import path_length
from pfslam.simulator.ground import ground_in_view, height, stance
from pfslam.simulator.plan import outline
from pfslam.simulator.world import make_world


def figures(recording):
    """Figures of a drive, those of the real robot's two drives, and by how much one building and driver differ.

    All measured in the same way.
    """
    encoders, imu, lidar, camera = recording.encoders, recording.imu, recording.lidar, recording.camera
    counts, interval, yaw_rate = encoders.counts, np.diff(encoders.t), imu.angular_velocity[:, 2]
    moving, fast = np.flatnonzero(counts.any(axis=1)), counts.sum(axis=1)[1:] > 20
    valid = recording.robot.lidar.valid(lidar.ranges)
    gap = np.abs(camera.disparity_t[nearest_stamp(camera.disparity_t, camera.rgb_t)] - camera.rgb_t)
    rest = (imu.t > imu.t[0] + 2.5) & (imu.t < encoders.t[moving[0]] - 0.3)
    at = np.arange(encoders.t[0] + 3.0, encoders.t[-1] - 2.0, 1.0)
    apart = np.cumsum(counts[:, [0, 2]].mean(axis=1) - counts[:, [1, 3]].mean(axis=1)) * 0.0022 / 0.394
    shown = np.concatenate([[0.0], np.cumsum(np.diff(imu.t) * yaw_rate[1:])])
    heading = np.unwrap(recording.truth.poses[:, 2])
    streams = (recording.truth.t, heading), (imu.t, shown), (encoders.t, apart)
    true, gyro, wheels = (np.diff(np.interp(at, *stream)) for stream in streams)
    force = np.stack([np.convolve(axis, np.ones(25) / 25, mode="valid") for axis in imu.acceleration_g.T])
    tilt = np.rad2deg(np.arccos(force[2] / np.linalg.norm(force, axis=0)))
    late = np.corrcoef(interval[fast], counts.sum(axis=1)[1:][fast])[0, 1]
    error = trajectory_error(dead_reckoning(recording), recording.truth).ate_rmse_m
    first, last = encoders.t[[0, -1]]
    return {
        "duration": (last - first, 123.6, 119.4, 5.0),
        "path by the wheels": (counts.mean(axis=1).sum() * 0.0022, 95.9, 91.8, 1.0),
        "still at first": (encoders.t[moving[0]] - first, 9.7, 12.9, 0.2),
        "still at last": (last - encoders.t[moving[-1]], 8.4, 10.3, 0.2),
        "encoder interval": (np.median(interval), 0.025, 0.025, 0.0003),
        "longest encoder interval": (interval.max(), 0.052, 0.052, 0.017),
        # A late stamp is a late stamp: the count is not larger for it.
        "count against interval": (late, 0.0, 0.0, 0.15),
        "IMU starts": (imu.t[0] - first, 0.28, 0.48, 0.03),
        "IMU ends": (imu.t[-1] - last, -1.42, -1.57, 0.05),
        "IMU interval": (np.median(np.diff(imu.t)), 0.010, 0.010, 0.0002),
        "LiDAR interval": (np.median(np.diff(lidar.t)), 0.0241, 0.0241, 0.0006),
        "scans per second": (len(lidar.t) / (last - first), 40.15, 40.15, 0.4),
        "valid beams": (valid.mean(), 0.996, 0.996, 0.0005),
        "mean range": (lidar.ranges[valid].mean(), 2.4, 2.6, 0.25),
        "disparity images": (len(camera.disparity_t), 2407, 2188, 190),
        "colour images": (len(camera.rgb_t), 2289, 2112, 180),
        "camera starts": (camera.disparity_t[0] - first, 1.80, 3.33, 0.05),
        "camera ends": (camera.disparity_t[-1] - last, 1.00, -3.32, 0.06),
        "longest camera interval": (np.diff(camera.disparity_t).max(), 0.42, 0.42, 0.23),
        "gap in a pair": (np.median(gap), 0.011, 0.011, 0.003),
        "large gap in a pair": (np.quantile(gap, 0.95), 0.086, 0.086, 0.02),
        # Four standard errors of noise that remembers six samples.
        "gyro at rest": (yaw_rate[rest].mean(), 0.0005, 0.0003, 0.0014),
        "gyro in its first second": (yaw_rate[imu.t < imu.t[0] + 1.0].mean(), 0.0022, -0.0016, 0.0039),
        "gyro noise": (yaw_rate[rest].std(), 0.0039, 0.0039, 0.0006),
        "true turn over the gyro's": ((true @ gyro) / (gyro @ gyro), 1.03, 1.03, 0.01),
        # A skid-steered robot drags its wheels sideways.
        "turn by the wheels over the true": ((wheels @ true) / (true @ true), 1.85, 1.85, 0.06),
        "dead reckoning's error": (error, 1.7, 1.7, 1.3),  # 1.14 m on the half-real drive
        "steepest tilt in degrees": (tilt.max(), 6.2, 21.5, 3.5),
        "time tilted by 8 degrees": ((tilt > 8.0).mean(), 0.0, 0.13, 0.03),
    }


@pytest.fixture(scope="module", params=["hall", "ramp"])
def drive(request):
    return simulated(request.param, None)


def test_the_drives_are_in_every_figure_like_the_real_ones(drive):
    recording, real = drive.recording, ["hall", "ramp"].index(drive.config.name)
    for name, (found, *measured, tolerance) in figures(recording).items():
        assert found == pytest.approx(measured[real], abs=tolerance), name
    assert np.diff(recording.encoders.t).min() > 0.003
    assert np.unique(recording.lidar.ranges[~recording.robot.lidar.valid(recording.lidar.ranges)]) == (
        pytest.approx([0.001, 60.0])
    )
    np.testing.assert_array_equal(recording.truth.poses[0], 0.0)
    np.testing.assert_array_equal(recording.truth.t, recording.lidar.t)


# Measured on the real robot; the tolerances are what one building and one driver differ from another.


# --- exact truth ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_without_errors_dead_reckoning_is_the_truth():
    recording = simulated("hall", exact=True).recording
    odometry = dead_reckoning(recording)
    inside = odometry.covers(recording.truth.t)
    difference = odometry.at(recording.truth.t[inside]) - recording.truth.poses[inside]
    # Euler's step of 10 ms at 1.4 m/s and 1.5 rad/s strays by 0.1 mm; turns to and fro cancel.
    assert np.abs(difference[:, :2]).max() < 0.02
    assert np.abs(wrap_angle(difference[:, 2])).max() < 1e-3


@pytest.mark.slow
def test_wheels_measure_the_slope_and_truth_its_shadow():
    exact = simulated("ramp", exact=True)
    recording = exact.recording
    wheels = recording.encoders.counts.mean(axis=1).sum() * recording.robot.encoders.metres_per_count
    shadow = np.hypot(*np.diff(exact.drive.poses[:, :2], axis=0).T).sum()
    space = np.column_stack([exact.drive.poses[:, :2], exact.drive.z])
    slant = np.linalg.norm(np.diff(space, axis=0), axis=1).sum()
    assert wheels == pytest.approx(slant, abs=1e-3)
    assert slant > shadow + 0.2


def test_body_rates_integrate_to_the_attitude():
    """Gyro rates, turned into a rotation step by step, must end where the truth ends: axes are the body's."""
    exact = simulated("ramp", exact=True)
    imu = exact.recording.imu
    t = imu.t - START_OF_TIME
    part = slice(1500, 6000)
    poses, _, pitch, roll = exact.drive.at(t[part])
    R = rotation_matrix(roll[0], pitch[0], poses[0, 2])
    for dt, rate in zip(np.diff(t[part]), imu.angular_velocity[part][1:], strict=True):
        R = R @ cv2.Rodrigues(rate * dt)[0]
    end = rotation_matrix(roll[-1], pitch[-1], poses[-1, 2])
    angle = np.arccos(np.clip((np.trace(R.T @ end) - 1.0) / 2.0, -1.0, 1.0))
    assert np.ptp(pitch) > np.deg2rad(15)
    assert angle < np.deg2rad(0.5)


# --- geometry against other ways to compute it ----------------------------------------------------


def test_the_walls_enclose_the_union_of_the_rectangles():
    areas = np.array([[0.0, 0.0, 4.0, 1.0], [3.0, 0.0, 4.0, 3.0], [1.0, 1.0, 2.0, 1.5]])
    walls = outline(areas)
    (x0, y0), (x1, y1) = walls[:, 0].T, walls[:, 1].T
    assert 0.5 * (x0 * y1 - x1 * y0).sum() == pytest.approx(
        6.5  # Green: area on the left counts positive
    )
    along = walls[:, 1] - walls[:, 0]
    left = walls.mean(axis=1) + 1e-3 * np.column_stack([-along[:, 1], along[:, 0]])
    inside = ((left[:, None] > areas[:, :2]) & (left[:, None] < areas[:, 2:])).all(axis=2).any(axis=1)
    assert inside.all()


@pytest.mark.slow
def test_scan_points_fall_on_the_walls():
    simulation = simulated("hall", 3)
    recording = simulation.recording
    some = range(0, len(recording.lidar.t), 200)
    points = [scan_points(recording.lidar.ranges[k], recording.robot.lidar) for k in some]
    placed = [transform_points(recording.truth.poses[k], p) for k, p in zip(some, points, strict=True)]
    off = distance_to_walls(np.vstack(placed), simulation.world.walls_w)
    # Noise of 1 cm along the beam is at most 1 cm across the wall.
    assert 0.004 < np.sqrt(np.mean(off**2)) < 0.0105
    assert off.max() < 0.06


def test_stance_on_a_ramp():
    slopes = make_world(RAMP, np.random.SeedSequence(3)).slopes
    slope = next(s for s in slopes if s.axis == "x")
    tilt = np.arctan((slope.heights[1] - slope.heights[0]) / (slope.knots[1] - slope.knots[0]))
    middle = np.array([0.5 * (slope.knots[0] + slope.knots[1]), 0.0])
    z, pitch, roll = stance(slopes, np.array([[*middle, 0.0], [*middle, np.pi], [*middle, np.pi / 2]]))
    assert z == pytest.approx([0.5 * slope.heights[1]] * 3)
    assert pitch == pytest.approx([-tilt, tilt, 0.0])  # up: nose up; back down: nose down
    assert roll == pytest.approx([0.0, 0.0, -tilt], abs=1e-9)


def test_rays_from_anywhere_end_where_small_steps_along_them_meet_the_ground():
    slopes, rng = make_world(RAMP, np.random.SeedSequence(3)).slopes, np.random.default_rng(0)
    origin = rng.uniform([-3.0, -3.0, 0.6], [12.0, 12.0, 1.2], (1000, 3))
    direction = rng.uniform([-1.0, -1.0, -0.6], [1.0, 1.0, -0.05], (1000, 3))
    step = origin[:, 2] / -direction[:, 2] / 2000
    points = origin + (np.arange(2002)[:, None] * step)[..., None] * direction
    above = points[..., 2] - height(slopes, points[..., :2])
    met, ray = np.argmax(above <= 0.0, axis=0), np.arange(1000)
    # Not through a hump's side, where a wall would stand.
    ahead = above[met - 1, ray] - above[met, ray] < 0.01
    t = 1.0 / ground_in_view(slopes, origin.T, direction.T)
    assert (np.abs(t - met * step) <= 1.01 * step)[ahead].all()
    assert (ahead & (points[met, ray, 2] > 0.05)).sum() > 50


# --- the building ---------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [None, 1, *(pytest.param(s, marks=pytest.mark.nightly) for s in range(2, 20))]
)
def test_every_building_lets_the_robot_through(seed):
    simulation = simulated("hall", seed)
    truth, world = simulation.recording.truth.poses, simulation.world
    assert distance_to_walls(truth[::20, :2], world.walls_w).min() > 0.35
    spec = GridSpec.around(world.walls_w.reshape(-1, 2), 0.05)
    cells = spec.world_to_cell(truth[:, :2])
    assert world.free_area(spec)[cells[:, 1], cells[:, 0]].all()
    assert not world.true_grid(spec)[cells[:, 1], cells[:, 0]].any()
    assert not world.is_floor(np.array([corners.mean(axis=0) for corners in world.clutter])).any()
    size = np.ptp(world.walls_w.reshape(-1, 2), axis=0)
    assert (size > 20).all()
    assert (size < 30).all()
    tilt = np.rad2deg(abs(world.pose_wp[2]))
    assert 1.5 < tilt < 5.5  # walls are not parallel to the grid


def test_hall_and_ramp_are_the_same_building():
    hall, ramp = (make_world(config, np.random.SeedSequence(5)) for config in (HALL, RAMP))
    np.testing.assert_array_equal(hall.plan.areas, ramp.plan.areas)
    assert hall.slopes == ()
    assert len(ramp.slopes) == 2


FINGERPRINT = """
import hashlib
from pfslam.simulator import Hazards, simulate
hazards = Hazards(people=4, doors=3, glass=0.1, bumps=5, slip=3)
recording = simulate("ramp", seed=8, hazards=hazards).recording
digest = hashlib.sha256()
for stream in (recording.encoders, recording.imu, recording.lidar, recording.truth):
    for values in vars(stream).values():
        digest.update(values.tobytes())
for k in (400, 900):
    digest.update(recording.camera.read_disparity(k).tobytes() + recording.camera.read_rgb(k).tobytes())
print(digest.hexdigest())
"""


@pytest.mark.nightly
def test_an_older_processor_makes_the_same_files():
    """NumPy without its vector instructions stands for another machine: sines differ there in their last bits."""
    umath = np._core._multiarray_umath
    extra = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__.get(name)]
    plain = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    older = {**plain, "NPY_DISABLE_CPU_FEATURES": " ".join(extra)}
    root = Path(__file__).parents[1]
    prints = [
        subprocess.run(
            [sys.executable, "-c", FINGERPRINT], env=env, cwd=root, capture_output=True, check=True
        )
        for env in (plain, older)
    ]
    assert prints[0].stdout == prints[1].stdout


# --- the other layouts ----------------------------------------------------------------------------

FEW = replace(HALL.robot, lidar=replace(HALL.robot.lidar, beams=91))


def test_the_small_ring_is_driven_lap_by_lap_and_more_laps_are_a_longer_way():
    loop = simulate(SimulatorConfig(layout="loop", laps=2, robot=FEW), seed=2)
    assert np.hypot(*loop.recording.truth.poses[-1, :2]) < 1.0
    assert loop.drive.travelled[-1] > 2 * 50.0
    two = make_world(replace(HALL, laps=2), np.random.SeedSequence(2))
    assert path_length(two.path) == pytest.approx(2 * HALL.path_length, rel=0.02)


def test_the_corridor_has_no_end_within_reach_and_a_width_of_its_own():
    corridor, other = (simulate(SimulatorConfig(layout="corridor", robot=FEW), seed) for seed in (2, 3))
    assert corridor.recording.truth.poses[-1, 0] == pytest.approx(20.0, abs=0.1)
    assert np.median(corridor.recording.lidar.ranges[:, 45]) > 30.0  # straight ahead
    assert abs(np.ptp(other.world.walls[..., 1]) - np.ptp(corridor.world.walls[..., 1])) > 0.1


def test_a_symmetric_building_looks_the_same_after_half_a_turn():
    walls = make_world(SimulatorConfig(layout="symmetric"), np.random.SeedSequence(2)).walls
    corners = walls.reshape(-1, 2)
    assert distance_to_walls(corners.min(axis=0) + corners.max(axis=0) - corners, walls).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: simulate("attic"), "name: found 'attic', expected one of hall, ramp, ring"),
        (lambda: simulate("hall", seed=-1), "seed: found -1"),
        (lambda: simulate("hall", seed=True), "seed: found True"),
        (lambda: SimulatorConfig(layout="spiral"), "layout"),
        (lambda: SimulatorConfig(range_noise=-0.1), "range_noise"),
        (lambda: Hazards(people=1.5), "Hazards: people: found 1.5, expected"),
        (lambda: Hazards(bumps=True), "Hazards: bumps: found True, expected"),
        (lambda: Hazards(glass=1.1), "Hazards: glass: found 1.1, expected"),
        (
            lambda: simulate(HALL, 3, hazards=Hazards(doors=99)),
            "doors: found 99, expected at most 16: the alcoves",
        ),
    ],
)
def test_bad_input_is_named(build, words):
    with pytest.raises(DataError, match=words):
        build()
