"""The loop: pure steps, repeatable runs, what is dropped is counted, and a noiseless room is mapped."""

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from drives import simulated
from rooms import CURVES, SQUARE, blinded, distance_to_walls, drive, sensor_position

from pfslam.correlation import Perturbations, map_correlation
from pfslam.errors import DataError
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import LOG_4
from pfslam.motion import dead_reckoning
from pfslam.particles import ControlNoise, Particles, effective_sample_size
from pfslam.poses import average_pose, between, compose, transform_points
from pfslam.recording import LidarScans
from pfslam.refined.field import score_field
from pfslam.refined.map import Prior
from pfslam.refined.matching import match
from pfslam.refined.noise import MotionNoise, predicted
from pfslam.refined.step import RefinedConfig
from pfslam.run import run_slam, slam_steps
from pfslam.sensors import ImuModel
from pfslam.slam import SlamConfig, slam_step
from pfslam.study.disturbances import first_seconds

REPORT, REFINED = SlamConfig.report(), SlamConfig.refined()
PRESETS = pytest.mark.parametrize(
    "config", [replace(REPORT, particles=20), replace(REFINED, particles=20)], ids=["report", "refined"]
)
DRIVE = drive(CURVES)
SHORT = drive([(1.0, 10, 0.4)])


# The report's numbers
# --------------------------------------------------------------------------------------------


def test_report_preset_is_the_report():
    assert REPORT.noise == ControlNoise(np.sqrt(0.1), np.sqrt(0.02))
    assert SlamConfig.report(sigma_omega=np.sqrt(0.05)).noise.sigma_omega == np.sqrt(0.05)
    assert (REPORT.map.hit, REPORT.map.free, REPORT.map.clamp) == (LOG_4, LOG_4, 2 * LOG_4)
    assert REPORT.resample_below == 0.1
    # 0.2 m by 0.05 m and 0.02 rad by 0.005 rad each way: 729 poses.
    assert REPORT.map.resolution == 0.05
    assert REPORT.search == Perturbations(cells=4, yaws=4, yaw_step=0.005)
    assert REPORT.particles == 200
    assert SlamConfig() == REPORT != SlamConfig.refined()


# One step
# --------------------------------------------------------------------------------------------------------


def state_after(recording, config, steps, seed=0):
    run = slam_steps(recording, config, np.random.default_rng(seed))
    for _ in range(steps):
        state, info = next(run)
    return state, info


def event_number(k, config, recording=DRIVE):
    return list(config.used_scans(recording).events())[k]


@PRESETS
def test_a_step_taken_again_with_the_same_map_gives_the_same(config):
    """A step changes nothing that it was given but the map, of which each has its own copy here."""
    state, _ = state_after(DRIVE, config, 8)
    event, same = event_number(8, config), [replace(state, map=state.map.copy()) for _ in range(2)]
    (first, _), (again, _) = (config.step(belief, event, np.random.default_rng(5)) for belief in same)
    same_beliefs(first, again)
    assert (first.grid.log_odds != state.grid.log_odds).any()
    untouched, _ = state_after(DRIVE, config, 8)
    same_beliefs(state, untouched)


def same_beliefs(a, b):
    names = ["particles.poses", "particles.log_weights", "estimate", "grid.log_odds"]
    names += ["map.field", "map.moments.sums"] if hasattr(a.map, "field") else []
    for name in names:
        np.testing.assert_array_equal(attrgetter(name)(a), attrgetter(name)(b), err_msg=name)


def test_first_scan_is_drawn_at_the_start_pose_and_moved_by_no_prediction():
    state, info = state_after(DRIVE, REFINED, 1)
    np.testing.assert_array_equal(info.estimate, [0, 0, 0])
    np.testing.assert_array_equal(state.particles.poses, np.zeros((REFINED.particles, 3)))
    assert (info.drawn, info.matched, info.scored, info.resampled) == (True, False, False, False)
    hits = state.grid.spec.world_to_cell(event_number(0, REFINED).points_b)
    assert state.grid.occupied.sum() == len(np.unique(hits, axis=0))


def test_report_weights_are_counts_and_the_estimate_is_the_best_particle():
    config = replace(REPORT, particles=15, resample_below=0.0)
    state, _ = state_after(DRIVE, config, 5)
    event = event_number(5, config)
    state = replace(state, particles=Particles(state.particles.poses, np.log(1.0 + np.arange(15))))
    _, info = slam_step(state, event, config, np.random.default_rng(0))
    # The particles keep an offset of up to half a step from the pose that was scored, so the counts are those
    # of the nodes.
    nodes = np.rint(info.particles.poses / [0.05, 0.05, 0.005]) * [0.05, 0.05, 0.005]
    counts = [
        map_correlation(state.grid.occupied, state.grid.spec, transform_points(n, event.points_b))
        for n in nodes
    ]
    expected = state.particles.weights * counts
    np.testing.assert_allclose(info.particles.weights, expected / expected.sum())
    np.testing.assert_array_equal(info.estimate, info.particles.poses[np.argmax(expected)])
    assert info.effective_sample_size == pytest.approx(effective_sample_size(info.particles.weights))


def test_score_field_of_the_state_is_always_that_of_its_map():
    for config in (replace(RefinedConfig.of(REPORT), particles=5), replace(REFINED, particles=5)):
        for state, _ in slam_steps(SHORT, config, np.random.default_rng(0)):
            expected = score_field(state.grid.occupied)
            np.testing.assert_array_equal(state.map.field, expected)


def test_resampling_happens_when_few_particles_carry_the_weight_and_leaves_them_equal():
    config = replace(REFINED, particles=30)
    happened = 0
    for state, info in slam_steps(DRIVE, config, np.random.default_rng(0)):
        assert info.resampled == (info.matched and info.effective_sample_size <= 3)
        if info.resampled:
            happened += 1
            np.testing.assert_allclose(state.particles.weights, 1 / 30)
    assert 0 < happened < len(DRIVE.lidar.t)


def test_scans_are_drawn_after_enough_motion():
    config = replace(REFINED, particles=10)
    last = np.zeros(3)
    for info in run_slam(DRIVE, config).infos[1:]:
        step = between(last, info.estimate)
        assert info.drawn == (
            np.hypot(*step[:2]) >= config.draw_metres or abs(step[2]) >= config.draw_radians
        )
        last = info.estimate if info.drawn else last


# The run
# ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("legs", [SQUARE, CURVES], ids=["square", "curves"])
@pytest.mark.parametrize("gyro_scale", [1.0, 0.9])
def test_refined_filter_maps_a_noiseless_room_to_within_a_cell(legs, gyro_scale):
    # A gyro that is 10 % off puts dead reckoning out by more than two cells; the scans say where the robot is
    # to a cell.
    recording = drive(legs)
    recording = replace(recording, robot=replace(recording.robot, imu=ImuModel(gyro_scale=gyro_scale)))
    result = run_slam(recording, replace(REFINED, particles=30))
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < result.config.map.resolution
    y, x = np.nonzero(result.grid.occupied)
    at = result.grid.spec.cell_to_world(np.column_stack([x, y]))
    # A hit cell's centre is at most half a diagonal from its hit, and the pose is right to a cell.
    assert distance_to_walls(at).max() < 0.05 * (np.sqrt(0.5) + 1.0)
    assert len(at) > 300  # the room has 20 m of walls: 400 cells
    if gyro_scale != 1.0:
        assert trajectory_error(dead_reckoning(recording), recording.truth).ate_max_m > 0.1


def same_run(a, b):
    np.testing.assert_array_equal(a.trajectory.poses, b.trajectory.poses)
    np.testing.assert_array_equal(a.grid.log_odds, b.grid.log_odds)
    np.testing.assert_array_equal(a.infos[-1].particles.poses, b.infos[-1].particles.poses)
    np.testing.assert_array_equal(a.infos[-1].particles.log_weights, b.infos[-1].particles.log_weights)


@PRESETS
def test_same_seed_same_bits_and_another_seed_others(config):
    np.random.seed(1)  # noqa: NPY002 - the global state must not matter
    first = run_slam(SHORT, config, rng=np.random.default_rng(7))
    np.random.seed(2)  # noqa: NPY002
    same_run(first, run_slam(SHORT, config, rng=np.random.default_rng(7)))
    same_run(run_slam(SHORT, config), run_slam(SHORT, config, rng=np.random.default_rng(0)))
    other = run_slam(SHORT, config, rng=np.random.default_rng(8))
    assert (first.infos[-1].particles.poses != other.infos[-1].particles.poses).any()


RUN_IN_A_PROCESS = """
import cv2
from test_slam import digest, REFINED, REPORT
cv2.setNumThreads({threads})
print(digest(REPORT), digest(REFINED))
"""


def digest(config):
    result = run_slam(SHORT, replace(config, particles=20))
    return hashlib.sha256(result.trajectory.poses.tobytes() + result.grid.log_odds.tobytes()).hexdigest()


@pytest.mark.slow
def test_same_bits_on_one_core_and_on_two():
    runs = []
    for threads in "12":
        names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
        environment = os.environ | dict.fromkeys(names, threads) | {"PYTHONPATH": str(Path(__file__).parent)}
        code = [sys.executable, "-c", RUN_IN_A_PROCESS.format(threads=threads)]
        done = subprocess.run(code, env=environment, capture_output=True, text=True, check=True)
        runs.append(done.stdout.split())
    assert runs[0] == runs[1] == [digest(REPORT), digest(REFINED)]


def test_estimates_are_never_revised_and_come_at_the_used_scans():
    config = replace(REFINED, particles=10)
    whole = run_slam(DRIVE, config)
    np.testing.assert_array_equal(whole.trajectory.t, DRIVE.lidar.t)
    half = replace(DRIVE, lidar=LidarScans(DRIVE.lidar.t[:20], DRIVE.lidar.ranges[:20]))
    np.testing.assert_array_equal(run_slam(half, config).trajectory.poses, whole.trajectory.poses[:20])


def test_scans_outside_the_odometrys_time_are_dropped_and_counted():
    late = replace(SHORT, lidar=LidarScans(SHORT.lidar.t + 0.25, SHORT.lidar.ranges))
    result = run_slam(late, replace(REFINED, particles=5))
    assert sum(result.dropped.values()) == 3  # those at 1.05, 1.15 and 1.25 s
    assert len(result.trajectory) == len(SHORT.lidar.t) - 3
    never = replace(SHORT, lidar=LidarScans(SHORT.lidar.t + 50.0, SHORT.lidar.ranges))
    for recording, what in ((never, "lidar time_stamps"), (replace(SHORT, lidar=None), "LiDAR")):
        with pytest.raises(DataError, match=what):
            run_slam(recording, REFINED)


@PRESETS
def test_scans_without_a_reading_are_predicted_through_and_counted(config):
    result = run_slam(blinded(SHORT, [0, 4, 5, 6]), config)
    assert [k for k, info in enumerate(result.infos) if not info.matched] == [0, 1, 4, 5, 6]
    report = type(config) is SlamConfig
    assert result.dropped == {"scans without any return" if report else "scans with too few valid beams": 4}
    assert result.updates == len(SHORT.lidar.t) - 5
    assert result.grid.occupied.any()
    clouds, estimates = ([getattr(i, n) for i in result.infos[4:7]] for n in ("particles", "estimate"))
    assert np.ptp(clouds[1].poses[:, 2] - clouds[0].poses[:, 2]) > 1e-3  # each particle has its own noise
    if report:  # the estimate stays the best particle, which has noise of its own
        for cloud, estimate in zip(clouds, estimates, strict=True):
            np.testing.assert_array_equal(estimate, cloud.poses[np.argmax(cloud.log_weights)])
        return
    # Odometry alone moves the mean, without the noise that spreads the cloud.
    odometry = dead_reckoning(SHORT)
    step = between(odometry.at(result.infos[4].t), odometry.at(result.infos[5].t))
    np.testing.assert_allclose(estimates[1], compose(estimates[0], step), atol=1e-12)


@PRESETS
def test_a_scan_of_nine_beams_is_matched_by_the_report_alone(config):
    ranges = SHORT.lidar.ranges.copy()
    ranges[6, 9:] = np.inf
    result = run_slam(replace(SHORT, lidar=LidarScans(SHORT.lidar.t, ranges)), config)
    report = type(config) is SlamConfig
    assert (result.infos[6].beams, result.infos[6].matched) == (9, report)
    assert result.dropped == ({} if report else {"scans with too few valid beams": 1})


def test_uncertainty_adds_up_while_scans_are_missing_and_ends_with_a_match(monkeypatch):
    config, searched = replace(REFINED, particles=5), []

    def noted(field, spec, points, poses, sigmas, *rest):
        searched.append(sigmas)
        return match(field, spec, points, poses, sigmas, *rest)

    monkeypatch.setattr("pfslam.refined.map.match", noted)
    events = list(config.used_scans(SHORT).events())
    one = [np.square(config.noise.sigmas(np.hypot(*e.motion[:2]), abs(e.motion[2]))) for e in events]
    run = slam_steps(blinded(SHORT, [4, 5]), config, np.random.default_rng(0))
    variance = [state.variance for state, _ in run]
    np.testing.assert_allclose(variance[3:7], [[0, 0], one[4], one[4] + one[5], [0, 0]])
    np.testing.assert_allclose(np.square(searched[2:4]), [one[3], one[4] + one[5] + one[6]])


@pytest.mark.parametrize("per_root_second", [False, True])
def test_variance_of_white_noise_is_the_sum_over_its_samples(per_root_second):
    # Per sample: sum of (dt sigma)^2. As a density: the variance grows with time, whatever the rate.
    noise = ControlNoise(0.3, 0.2, per_root_second)
    event = list(REFINED.used_scans(SHORT).events())[3]
    dt = event.controls[2]
    spread = dt.sum() if per_root_second else (dt**2).sum()
    start = Particles.at(np.zeros(3), 20_000)
    after, variance = predicted(start, event, noise, np.random.default_rng(0))
    np.testing.assert_allclose(variance, [0.09 * spread, 0.04 * spread])
    # The cloud's own heading says the same; five standard errors of a variance over 20000 draws.
    assert after.poses[:, 2].var() == pytest.approx(variance[1], rel=5 * np.sqrt(2 / 20_000))


def test_noise_between_scans_is_sigma_times_the_draw_in_the_particles_own_frame():
    """0.5 m and 0.25 rad: sigmas 0.01 + 0.1 * 0.5 m and 0.02 + 0.2 * 0.25 + 0.3 * 0.5 rad; every draw is two."""

    class Twos:
        def standard_normal(self, shape):
            return np.full(shape, 2.0)

    noise = MotionNoise(0.01, 0.1, 0.02, 0.2, 0.3)
    event = replace(list(REFINED.used_scans(SHORT).events())[3], motion=np.array([0.3, 0.4, -0.25]))
    after, variance = predicted(Particles.at([1.0, 2.0, np.pi / 2], 3), event, noise, Twos())
    expected = [1.0 - (0.4 + 0.12), 2.0 + (0.3 + 0.12), np.pi / 2 - 0.25 + 0.44]
    np.testing.assert_allclose(after.poses, np.tile(expected, (3, 1)), rtol=1e-12)
    np.testing.assert_allclose(variance, [0.06**2, 0.22**2], rtol=1e-12)


def test_cloud_moves_with_the_aligned_estimate():
    # The estimate is the mean of the cloud before the alignment and must be its mean after it.
    for info in run_slam(SHORT, replace(REFINED, particles=15)).infos:
        if info.matched:
            mean = average_pose(info.particles.poses, info.particles.weights)
            np.testing.assert_allclose(info.estimate, mean, atol=1e-9)


@pytest.mark.parametrize("config", [SlamConfig.report(0.0, 0.0), REFINED], ids=["report", "refined"])
def test_recording_that_never_sees_anything_follows_its_odometry(config):
    blind = blinded(SHORT, slice(None))
    result = run_slam(blind, config)
    expected = dead_reckoning(blind).at(result.trajectory.t)
    np.testing.assert_allclose(result.trajectory.poses[:, :2], expected[:, :2], atol=1e-9)
    assert not result.grid.log_odds.any()


def test_a_scan_that_scores_nothing_leaves_the_weights_and_is_counted():
    # Eight metres of blank between two rooms: the second scan's end points fall on cells that no scan has
    # touched.
    config = replace(SlamConfig.report(0.0, 0.0), particles=6)
    event = next(config.used_scans(SHORT).events())
    state, _ = slam_step(config.start(), event, config, np.random.default_rng(0))
    weights = np.log([1.0, 2, 3, 4, 5, 6])
    state = replace(state, particles=Particles(state.particles.poses + [80.0, 0, 0], weights))
    _, info = slam_step(state, event, config, np.random.default_rng(0))
    assert info.matched
    assert not info.scored
    np.testing.assert_allclose(info.particles.weights, np.arange(1, 7) / 21)


def test_map_grows_as_far_as_the_drive_goes():
    # The scan reaches 4 m, the grid begins with 5 m around it; the corridor is longer than both.
    walls = np.array([[-3.01, 1.01, 15.01, 1.01], [-3.01, -1.01, 15.01, -1.01], [15.01, -1.01, 15.01, 1.01]])
    short_sighted = replace(SHORT.robot.lidar, range_max=3.0)
    recording = drive([(12.0, 20, 0.0)], walls, short_sighted)
    result = run_slam(recording, replace(REFINED, particles=3))
    assert result.grid.spec.extent[1] > 12.0
    inside = result.grid.spec.world_to_cell(sensor_position(result.trajectory.poses[-1]))
    assert result.grid.spec.contains(inside)
    assert result.grid.free[inside[1], inside[0]]


def test_progress_sees_every_scan():
    seen = []

    def progress(steps, total):
        seen.append(total)
        return (seen.append(step) or step for step in steps)

    result = run_slam(SHORT, replace(REFINED, particles=3), progress=progress)
    assert seen[0] == len(result.infos) == len(seen) - 1


def test_corrections_are_remembered_for_about_a_metre():
    """0.3 m before; then a metre by odometry, of which the scan takes 0.1 m back."""
    start, odometry, estimate = np.zeros(3), np.array([1.1, 0.0, 0.2]), np.array([1.0, 0.0, 0.3])
    prior = Prior(Particles.at(odometry, 1), odometry, np.zeros(2), start, None, np.array([0.3, 0.6]))
    np.testing.assert_allclose(prior.corrected_by(estimate), [0.3 / np.e - 0.1, 0.6 / np.e], atol=1e-12)


@pytest.mark.slow
def test_old_walls_tell_that_a_scan_took_back_what_wheels_lost():
    """The wheels count nothing for a second of the way: old walls are where the scans put the robot, and not there."""
    recording = first_seconds(simulated("hall").recording, 45.0)
    encoders = recording.encoders
    slips = np.abs(encoders.t - encoders.t[0] - 40.0) < 0.5
    lost = replace(encoders, counts=np.where(slips[:, None], 0, encoders.counts))
    infos = run_slam(replace(recording, encoders=lost), REFINED, second_look=False).infos
    gains = np.array([info.old_walls for info in infos])
    t = np.array([info.t for info in infos]) - encoders.t[0]
    assert np.hypot(*sum(info.departure for info in infos if 39.4 < info.t - encoders.t[0] < 41.0)) > 0.2
    assert gains[(t > 40.0) & (t < 41.0)].max() > 0.2
    assert np.abs(gains[t < 39.0]).max() < 0.1
