"""The simulated drives, measured like the real ones, and the geometry behind them."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from drives import BEAMS, simulated, slow_range
from rooms import distance_to_walls

from pfslam.errors import DataError
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.motion import dead_reckoning
from pfslam.poses import rotation_matrix, transform_points, wrap_angle
from pfslam.recording import nearest_stamp
from pfslam.sensors import LidarModel, scan_points
from pfslam.simulator import HALL, RAMP, SimulatorConfig, simulate
from pfslam.simulator.clocks import START_OF_TIME
from pfslam.simulator.drive import path_length
from pfslam.simulator.ground import ground_distance, height, stance
from pfslam.simulator.lidar import measured
from pfslam.simulator.plan import outline
from pfslam.simulator.world import make_world

# Measured on the real robot; the tolerances are what one building and one driver differ from another.
REAL = {
    "hall": {
        "duration": 123.6, "path": 95.9, "still": (9.7, 8.4), "yaw_rate": 1.5,
        "imu": (0.28, -1.42), "bias": 0.0005, "first_second": 0.0022,
        "images": (2407, 2289), "camera": (1.80, 1.00), "mean_range": 2.4,
    },
    "ramp": {
        "duration": 119.4, "path": 91.8, "still": (12.9, 10.3), "yaw_rate": 1.9,
        "imu": (0.48, -1.57), "bias": 0.0003, "first_second": -0.0016,
        "images": (2188, 2112), "camera": (3.33, -3.32), "mean_range": 2.6,
    },
}  # fmt: skip


@pytest.fixture(scope="module", params=["hall", "ramp"])
def drive(request):
    return simulated(request.param, None), REAL[request.param]


@pytest.fixture(scope="module")
def exact_ramp():
    return simulated("ramp", exact=True)


def still(recording):
    """The IMU samples taken before the wheels first turn, 0.3 s to spare."""
    moving = recording.encoders.counts.any(axis=1)
    return recording.imu.t < recording.encoders.t[np.argmax(moving)] - 0.3


# --- the drive and its clocks, against the table --------------------------------------------------


def test_lasts_and_drives_as_the_real_ones(drive):
    simulation, real = drive
    encoders = simulation.recording.encoders
    duration = encoders.t[-1] - encoders.t[0]
    assert duration == pytest.approx(real["duration"], rel=0.04)
    assert encoders.counts.mean(axis=1).sum() * 0.0022 == pytest.approx(real["path"], rel=0.01)
    moving = np.flatnonzero(encoders.counts.any(axis=1))
    assert encoders.t[moving[0]] - encoders.t[0] == pytest.approx(real["still"][0], abs=0.2)
    assert encoders.t[-1] - encoders.t[moving[-1]] == pytest.approx(real["still"][1], abs=0.2)


def test_encoder_stamps_jitter_and_counts_do_not(drive):
    encoders = drive[0].recording.encoders
    interval = np.diff(encoders.t)
    assert interval.min() > 0.003
    assert 0.035 < interval.max() < 0.069
    assert np.median(interval) == pytest.approx(0.025, abs=0.0003)
    fast = encoders.counts.sum(axis=1)[1:] > 20
    # A late stamp is a late stamp: the count is not larger for it (0.02 on the real robot).
    assert abs(np.corrcoef(interval[fast], encoders.counts.sum(axis=1)[1:][fast])[0, 1]) < 0.15


def test_imu_starts_late_and_ends_early(drive):
    simulation, real = drive
    imu, encoders = simulation.recording.imu, simulation.recording.encoders
    assert imu.t[0] - encoders.t[0] == pytest.approx(real["imu"][0], abs=0.03)
    assert imu.t[-1] - encoders.t[-1] == pytest.approx(real["imu"][1], abs=0.05)
    assert np.median(np.diff(imu.t)) == pytest.approx(0.010, abs=0.0002)


def test_lidar_stamps_and_ranges(drive):
    simulation, real = drive
    recording = simulation.recording
    lidar, model = recording.lidar, recording.robot.lidar
    assert lidar.ranges.shape == (len(lidar.t), BEAMS)
    assert 40.5 < 1.0 / np.median(np.diff(lidar.t)) < 42.5
    assert len(lidar.t) / (recording.encoders.t[-1] - recording.encoders.t[0]) == pytest.approx(
        4962 / 123.6, rel=0.01
    )
    valid = model.valid(lidar.ranges)
    assert valid.mean() == pytest.approx(0.996, abs=0.0005)
    assert lidar.ranges[valid].mean() == pytest.approx(real["mean_range"], abs=0.25)
    assert np.unique(lidar.ranges[~valid]) == pytest.approx([0.001, 60.0])


def test_camera_stamps(drive):
    simulation, real = drive
    camera, encoders = simulation.recording.camera, simulation.recording.encoders
    assert (len(camera.disparity_t), len(camera.rgb_t)) == pytest.approx(real["images"], rel=0.08)
    assert camera.disparity_t[0] - encoders.t[0] == pytest.approx(real["camera"][0], abs=0.05)
    assert camera.disparity_t[-1] - encoders.t[-1] == pytest.approx(real["camera"][1], abs=0.06)
    assert 0.2 < np.diff(camera.disparity_t).max() < 0.65
    gap = np.abs(camera.disparity_t[nearest_stamp(camera.disparity_t, camera.rgb_t)] - camera.rgb_t)
    assert np.median(gap) == pytest.approx(0.011, abs=0.003)
    assert np.quantile(gap, 0.95) == pytest.approx(0.086, abs=0.02)


def test_everything_is_quantised(drive):
    recording = drive[0].recording
    assert recording.encoders.counts.dtype == np.int16
    assert recording.lidar.ranges.dtype == np.float32
    rates, mm = recording.imu.angular_velocity, recording.lidar.ranges[::50].astype(float) * 1e3
    np.testing.assert_allclose(rates * 1e6, np.round(rates * 1e6), atol=1e-6)
    np.testing.assert_allclose(mm, np.round(mm), atol=3e-3)  # float32 at 30 m resolves 2e-6 m
    for t in (recording.encoders.t, recording.imu.t, recording.lidar.t, recording.camera.rgb_t):
        np.testing.assert_allclose((t - START_OF_TIME) * 1e6, np.round((t - START_OF_TIME) * 1e6), atol=0.3)


# --- the instruments' errors, against the table ---------------------------------------------------


def test_gyro_noise_and_bias_at_rest(drive):
    simulation, real = drive
    recording = simulation.recording
    yaw_rate, t = recording.imu.angular_velocity[:, 2], recording.imu.t
    rest = still(recording) & (t > t[0] + 2.5)
    # Noise that remembers six samples leaves a sixth as many to average over. Four standard errors:
    per_root = 4 * 0.0039 * np.sqrt(6)
    assert yaw_rate[rest].mean() == pytest.approx(real["bias"], abs=per_root / np.sqrt(rest.sum()))
    assert yaw_rate[rest].std() == pytest.approx(0.0039, rel=0.15)
    first = t < t[0] + 1.0
    assert yaw_rate[first].mean() == pytest.approx(real["first_second"], abs=per_root / np.sqrt(first.sum()))


def turned(t, theta, at):
    return np.diff(np.interp(at, t, np.unwrap(theta)))


def test_gyro_scale_is_three_percent_off(drive):
    recording = drive[0].recording
    imu, truth = recording.imu, recording.truth
    at = np.arange(imu.t[0] + 2.0, imu.t[-1], 1.0)
    shown = np.concatenate([[0.0], np.cumsum(np.diff(imu.t) * imu.angular_velocity[1:, 2])])
    true, gyro = turned(truth.t, truth.poses[:, 2], at), turned(imu.t, shown, at)
    assert (true @ gyro) / (gyro @ gyro) == pytest.approx(1.03, abs=0.01)


def test_wheels_overstate_yaw_by_skidding(drive):
    recording = drive[0].recording
    encoders, truth = recording.encoders, recording.truth
    right, left = encoders.counts[:, [0, 2]].mean(axis=1), encoders.counts[:, [1, 3]].mean(axis=1)
    at = np.arange(encoders.t[0] + 2.0, encoders.t[-1] - 2.0, 1.0)
    by_wheels = turned(encoders.t, np.cumsum(right - left) * 0.0022 / 0.394, at)
    true = turned(truth.t, truth.poses[:, 2], at)
    assert (by_wheels @ true) / (true @ true) == pytest.approx(1.85, abs=0.06)


def test_dead_reckoning_drifts_like_the_real_robot(drive):
    recording = drive[0].recording
    error = trajectory_error(dead_reckoning(recording), recording.truth)
    assert 0.5 < error.ate_rmse_m < 3.0  # 1.14 m on the half-real drive
    assert 1.0 < error.heading_rmse_deg < 12.0


def test_tilt_seen_by_the_accelerometer():
    def tilt(name):
        force = simulated(name, None).recording.imu.acceleration_g
        force = np.stack([np.convolve(axis, np.ones(25) / 25, mode="valid") for axis in force.T], axis=1)
        return np.rad2deg(np.arccos(force[:, 2] / np.linalg.norm(force, axis=1)))

    flat, sloping = tilt("hall"), tilt("ramp")
    assert 4.0 < flat.max() < 8.5
    assert (flat > 8.0).mean() < 0.001
    assert 18.0 < sloping.max() < 25.0
    assert (sloping > 8.0).mean() == pytest.approx(0.13, abs=0.03)


# --- exact truth ----------------------------------------------------------------------------------


def test_truth_starts_at_the_origin_at_the_lidars_stamps(drive):
    recording = drive[0].recording
    np.testing.assert_array_equal(recording.truth.poses[0], 0.0)
    np.testing.assert_array_equal(recording.truth.t, recording.lidar.t)
    assert len(drive[0].z) == len(drive[0].pitch) == len(recording.truth)


def test_without_errors_dead_reckoning_is_the_truth():
    recording = simulated("hall", exact=True).recording
    odometry = dead_reckoning(recording)
    inside = odometry.covers(recording.truth.t)
    difference = odometry.at(recording.truth.t[inside]) - recording.truth.poses[inside]
    # Euler's step of 10 ms at 1.4 m/s and 1.5 rad/s strays by 0.1 mm; turns to and fro cancel.
    assert np.abs(difference[:, :2]).max() < 0.02
    assert np.abs(wrap_angle(difference[:, 2])).max() < 1e-3


def test_wheels_measure_the_slope_and_truth_its_shadow(exact_ramp):
    recording = exact_ramp.recording
    wheels = recording.encoders.counts.mean(axis=1).sum() * recording.robot.encoders.metres_per_count
    shadow = np.hypot(*np.diff(exact_ramp.drive.poses[:, :2], axis=0).T).sum()
    slant = np.sqrt(
        (np.diff(exact_ramp.drive.poses[:, :2], axis=0) ** 2).sum(axis=1) + np.diff(exact_ramp.drive.z) ** 2
    ).sum()
    assert wheels == pytest.approx(slant, abs=1e-3)
    assert slant > shadow + 0.2


def test_body_rates_integrate_to_the_attitude(exact_ramp):
    """Gyro rates, turned into a rotation step by step, must end where the truth ends: axes are the body's."""
    imu = exact_ramp.recording.imu
    t = imu.t - START_OF_TIME
    part = slice(1500, 6000)
    poses, _, pitch, roll = exact_ramp.drive.at(t[part])
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
        4.0 + 2.0 + 0.5
    )  # Green: area on the left counts positive
    along = walls[:, 1] - walls[:, 0]
    left = walls.mean(axis=1) + 1e-3 * np.column_stack([-along[:, 1], along[:, 0]])
    inside = ((left[:, None] > areas[:, :2]) & (left[:, None] < areas[:, 2:])).all(axis=2).any(axis=1)
    assert inside.all()


@pytest.mark.parametrize("name", ["hall", "ramp"])
def test_ranges_against_brute_force(name):
    simulation, rng = simulated(name, exact=True), np.random.default_rng(0)
    lidar, t = simulation.recording.lidar, simulation.recording.lidar.t - START_OF_TIME
    scans = rng.integers(0, len(t), 60)
    if name == "ramp":
        scans = np.concatenate([scans, rng.choice(np.flatnonzero(np.abs(simulation.pitch) > 0.05), 60)])
    for k, beam in zip(scans, rng.integers(0, BEAMS, len(scans)), strict=True):
        slow = slow_range(simulation, t[k], simulation.recording.robot.lidar.angles[beam])
        assert lidar.ranges[k, beam] == pytest.approx(slow, abs=2e-3), (k, beam)


def test_rays_to_the_ground_end_on_it_and_not_below():
    slopes = make_world(RAMP, np.random.SeedSequence(3)).slopes
    rng = np.random.default_rng(0)
    for slope in slopes:
        at = rng.uniform(slope.knots[0] - 2.0, slope.knots[-1] + 2.0, 300)
        aside = rng.uniform(-0.8, 0.8, 300)
        ground = np.column_stack([at, aside] if slope.axis == "x" else [aside, at])
        origin = np.column_stack([ground, height(slopes, ground) + rng.uniform(0.2, 1.0, 300)])
        along = rng.uniform(-1.0, 1.0, 300)
        level = np.column_stack([along, 0.0 * along] if slope.axis == "x" else [0.0 * along, along])
        direction = np.column_stack([level, rng.uniform(-0.5, -0.05, 300)])
        t = ground_distance(slopes, origin, direction)
        end = origin + t[:, None] * direction
        np.testing.assert_allclose(end[:, 2], height(slopes, end[:, :2]), atol=1e-9)
        assert (end[:, 2] > 0.05).sum() > 100
        before = origin[:, None] + (np.linspace(0.0, 0.999, 200) * t[:, None])[..., None] * direction[:, None]
        assert (before[..., 2] > height(slopes, before[..., :2])).all()


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


def test_ranges_are_spoiled_as_much_and_as_often_as_the_settings_say():
    exact, config = np.full((1000, 1081), 5.0), replace(HALL, invalid_share=0.05)
    found = measured(exact, config, np.random.default_rng(0)).astype(float)
    missing = ~LidarModel().valid(found)
    assert missing.mean() == pytest.approx(0.05, abs=0.001)
    assert found[~missing].std() == pytest.approx(config.range_noise, rel=0.01)
    assert found[~missing].mean() == pytest.approx(5.0, abs=1e-4)


def test_stance_on_a_ramp():
    slopes = make_world(RAMP, np.random.SeedSequence(3)).slopes
    slope = next(s for s in slopes if s.axis == "x")
    rise = (slope.heights[1] - slope.heights[0]) / (slope.knots[1] - slope.knots[0])
    middle = np.array([0.5 * (slope.knots[0] + slope.knots[1]), 0.0])
    z, pitch, roll = stance(slopes, np.array([[*middle, 0.0], [*middle, np.pi], [*middle, np.pi / 2]]))
    assert z == pytest.approx([0.5 * slope.heights[1]] * 3)
    assert pitch == pytest.approx(
        [-np.arctan(rise), np.arctan(rise), 0.0]
    )  # up: nose up; back down: nose down
    assert roll == pytest.approx([0.0, 0.0, -np.arctan(rise)], abs=1e-9)


# --- the building ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "seed", [None, 1, *(pytest.param(s, marks=pytest.mark.nightly) for s in range(2, 20))]
)
def test_every_building_lets_the_robot_through(seed):
    simulation = simulated("hall", seed)
    truth, world = simulation.recording.truth.poses, simulation.world
    assert distance_to_walls(truth[::20, :2], world.walls_w).min() > 0.35
    spec = world.spec(0.05)
    cells = spec.world_to_cell(truth[:, :2])
    assert simulation.floor_area(spec)[cells[:, 1], cells[:, 0]].all()
    assert not simulation.true_grid(spec)[cells[:, 1], cells[:, 0]].any()
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


def test_bad_input_is_named():
    with pytest.raises(DataError, match="'attic'"):
        simulate("attic")
    with pytest.raises(DataError, match="seed"):
        simulate("hall", seed=-1)
    with pytest.raises(DataError, match="layout"):
        SimulatorConfig(layout="spiral")
    with pytest.raises(DataError, match="range_noise"):
        SimulatorConfig(range_noise=-0.1)
