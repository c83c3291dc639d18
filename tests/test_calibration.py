"""Self-calibration against instruments whose errors are known because they were made."""

from dataclasses import replace

import numpy as np
import pytest
from drives import simulated
from rooms import drive

import pfslam
from pfslam.errors import DataError
from pfslam.evaluation.calibration import apply_calibration, calibrate, gyro_bias, still_pieces
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.motion import dead_reckoning
from pfslam.recording import Encoders, Imu, Recording
from pfslam.run import run_slam
from pfslam.sensors import EncoderModel, ImuModel, RobotModel
from pfslam.simulator import HALL
from pfslam.slam import SlamConfig

CONFIG = replace(SlamConfig.refined(), particles=1)
TRUE_SCALE_HALL = 1.03
TRUE_WHEELS_HALL = HALL.slip.true_metres_per_count / 0.0022 / (1.0 + HALL.slip.straight)


def standing(seconds, bias=0.0, noise=0.004, move=(), seed=0):
    """A robot that stands, but for the intervals ``move`` (from, to, counts, yaw rate); gyro at 100 Hz, white noise."""
    rng = np.random.default_rng(seed)
    t_wheels, t_gyro = np.arange(0.0, seconds, 0.025), np.arange(0.0, seconds, 0.01)
    counts, rates = np.zeros((len(t_wheels), 4), int), noise * rng.standard_normal((len(t_gyro), 3))
    rates[:, 2] += bias
    for begin, end, count, omega in move:
        counts[(t_wheels >= begin) & (t_wheels < end)] = count
        rates[(t_gyro >= begin) & (t_gyro < end), 2] += omega
    gravity = np.tile([0.0, 0.0, 1.0], (len(t_gyro), 1))
    return Recording("still", RobotModel(), Encoders(t_wheels, counts), Imu(t_gyro, rates, gravity))


# Bias
# ------------------------------------------------------------------------------------------------


def test_bias_of_a_standing_robot_to_within_its_own_error():
    away = []
    for seed in range(60):
        bias, error, seconds = gyro_bias(standing(12.0, bias=0.003, seed=seed))
        assert 9.0 <= seconds <= 11.0
        # White noise of 0.004 at 100 Hz over ten seconds: 0.004 / sqrt(1000).
        assert error == pytest.approx(0.004 / np.sqrt(100 * seconds), rel=0.9)
        away.append((bias - 0.003) / error)
    # The error is claimed honestly: Student's t of nine degrees of freedom has variance 9 / 7.
    assert 0.7 < np.std(away) < 1.7
    assert abs(np.mean(away)) < 4 * np.std(away) / np.sqrt(60)


@pytest.mark.parametrize(("count", "omega"), [(5, 0.8), (0, 0.3), (0, -1.0)])
def test_driving_or_being_turned_never_counts_as_standing(count, omega):
    """On a lift, or carried, the encoders see nothing and the gyro does."""
    moving = standing(30.0, bias=0.002, move=[(10.0, 20.0, count, omega)])
    bias, error, seconds = gyro_bias(moving)
    assert abs(bias - 0.002) < 5 * error < 0.002
    assert 15.0 < seconds < 20.0
    for piece in still_pieces(moving):
        assert not ((moving.imu.t[piece] > 10.0) & (moving.imu.t[piece] < 20.0)).any()


def test_without_stillness_the_robots_own_bias_stays():
    restless = standing(20.0, bias=0.01, move=[(0.0, 20.0, 4, 0.0)])
    restless = replace(restless, robot=RobotModel(imu=ImuModel(gyro_bias=0.007)))
    found = calibrate(restless)
    assert (found.gyro_bias, found.gyro_bias_error, found.still_seconds) == (0.007, np.inf, 0.0)
    assert (found.wheel_scale, found.gyro_scale) == (1.0, 1.0)
    assert found.wheel_scale_error == found.gyro_scale_error == np.inf
    with pytest.raises(DataError, match="imu"):
        calibrate(replace(restless, odometry=dead_reckoning(restless), imu=None))


# Scales
# ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 0.2, 0.4])
def test_a_drive_that_turns_at_one_rate_or_never_cannot_tell_drift_from_scale(turn):
    """Its gyro keeps the robot's values; the wheels' scale is told all the same."""
    recording = drive([(16.0, 12, turn)])
    found = calibrate(recording, run_slam(recording, CONFIG))
    assert (found.gyro_scale, found.drive_bias) == (1.0, 0.0)
    assert found.gyro_scale_error == found.drive_bias_error == np.inf
    assert abs(found.wheel_scale - 1.0) < 0.01


LEGS = [(4.0, 12, 0.0), (2.0, 0, 0.7), (2.0, 12, 0.0), (3.0, 0, -0.7), (4.0, 12, 0.0), (3.0, 0, 0.6)]


@pytest.mark.slow
def test_wheels_and_a_gyro_that_drifts_get_back_what_the_walls_tell():
    """Wheels whose sheet is 4 % wrong; a gyro that shows 0.02 rad/s too much and 5 % too little of its turning."""
    true = drive(LEGS)
    rates = true.imu.angular_velocity.copy()
    rates[:, 2] = rates[:, 2] / 1.05 + 0.02
    wheels = EncoderModel(metres_per_count=1.04 * true.robot.encoders.metres_per_count)
    recording = replace(
        true, robot=replace(true.robot, encoders=wheels), imu=Imu(true.imu.t, rates, true.imu.acceleration_g)
    )
    result = run_slam(recording, CONFIG)
    found = calibrate(recording, result)
    assert found.wheel_scale == pytest.approx(1 / 1.04, abs=0.005)
    assert found.drive_bias == pytest.approx(0.02, abs=0.001)
    assert found.gyro_scale == pytest.approx(1.05, abs=0.005)
    mended = apply_calibration(recording, found)
    assert mended.robot.encoders.metres_per_count == pytest.approx(0.001, rel=0.005)
    before, after = (trajectory_error(dead_reckoning(r), r.truth).ate_rmse_m for r in (recording, mended))
    assert after < 0.1 * before
    # A second pass over the mended robot has nothing left to mend.
    again = calibrate(mended, run_slam(mended, CONFIG))
    assert again.drive_bias == pytest.approx(found.drive_bias, abs=0.001)
    assert again.gyro_scale == pytest.approx(1.0, abs=0.005)
    # Where only odometry speaks, nothing is learned from it; and the run must be that of the recording.
    silent = tuple(replace(info, silent_direction=np.array([1.0, 0.0])) for info in result.infos)
    nothing = calibrate(recording, replace(result, infos=silent))
    assert (nothing.wheel_scale, nothing.wheel_scale_error) == (1.0, np.inf)
    with pytest.raises(DataError, match="the run of this recording"):
        calibrate(drive(LEGS[:2]), result)


# Whole drives
# ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_hall_finds_what_the_simulator_was_told():
    recording = simulated("hall", None).recording
    found = calibrate(recording, run_slam(recording, CONFIG, keep_particles=False))
    assert abs(found.gyro_bias - HALL.gyro.bias[2]) < 4 * found.gyro_bias_error < 0.002
    assert abs(found.drive_bias - HALL.gyro.bias[2]) < 4 * found.drive_bias_error < 0.001
    assert abs(found.gyro_scale - TRUE_SCALE_HALL) < 4 * found.gyro_scale_error < 0.003
    # Beside the standard error, 0.6 % of slow changes of the slip over the drive.
    assert found.wheel_scale == pytest.approx(TRUE_WHEELS_HALL, abs=0.002)
    assert found.still_seconds > 8.0
    mended = apply_calibration(recording, found)
    before, after = (trajectory_error(dead_reckoning(r), r.truth).ate_rmse_m for r in (recording, mended))
    assert after < before / 10


@pytest.mark.slow
def test_real_wheels_and_gyro(real_data):
    """Set 20. Its gyro drifts thrice as fast while driving as at rest: only the matched motion finds that."""
    recording = pfslam.load(20, real_data / "corridor20")
    found = calibrate(recording, run_slam(recording, CONFIG, keep_particles=False))
    assert found.gyro_scale == pytest.approx(1.03, abs=0.005)
    assert abs(found.gyro_bias - 0.0005) < 3 * found.gyro_bias_error < 0.002
    # Against the reference path: turning per second that the gyro shows too much, scale taken out.
    t = np.arange(np.ceil(recording.truth.t[0]), recording.imu.t[-1] - 1.0, 1.0)
    shown, true = (np.diff(np.unwrap(p.at(t)[:, 2])) for p in (dead_reckoning(recording), recording.truth))
    assert found.drive_bias == pytest.approx(np.mean(shown - true / found.gyro_scale), abs=2e-4)
    before, after = (
        trajectory_error(dead_reckoning(r), r.truth) for r in (recording, apply_calibration(recording, found))
    )
    assert after.heading_rmse_deg < 0.5 * before.heading_rmse_deg
    assert after.ate_rmse_m < before.ate_rmse_m
