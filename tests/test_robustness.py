"""Where filters die: nothing to see, too little to see, wrong things to see, too few particles, nothing to do at all.

Drives of half a minute through the built-in building, in pieces cut from ``hall``; limits are the project's targets.
"""

from dataclasses import replace

import numpy as np
import pytest
from measure.robots import GROUPS
from measure.robots import drive as robot
from rooms import SQUARE
from rooms import drive as room_drive

import pfslam
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.motion import dead_reckoning
from pfslam.poses import between
from pfslam.recording import Imu, LidarScans
from pfslam.refined.health import alarms
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam.study.disturbances import blind, first_seconds, missing_beams, random_ranges

REFINED = SlamConfig.refined()
FEW = replace(REFINED, particles=20)
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def hall():
    return pfslam.load("hall")


@pytest.fixture(scope="module")
def drive(hall):
    """The first 33 s: standing, then 20 m of corridor with a turn."""
    return first_seconds(hall, 33.0)


def run(recording, config=FEW, seed=0):
    return run_slam(recording, config, rng=np.random.default_rng(seed))


def away(result, truth):
    """Distance (m) of each estimate from the truth, NaN outside the truth's time."""
    known = truth.covers(result.trajectory.t)
    found = np.full(len(known), np.nan)
    found[known] = np.hypot(*(result.trajectory.poses[known] - truth.at(result.trajectory.t[known]))[:, :2].T)
    return found


# Few particles, bad beams
# ---------------------------------------------------------------------------------------------


def half_of_the_beams(drive):
    return missing_beams(drive, 0.5, np.random.default_rng(1))


def one_beam_in_ten_reads_anything(drive):
    return random_ranges(drive, 0.1, np.random.default_rng(2))


@pytest.mark.parametrize(
    ("change", "particles", "metres", "degrees"),
    [
        (lambda drive: drive, 1, 0.03, 0.2),
        (lambda drive: drive, 5, 0.03, 0.2),
        (half_of_the_beams, 20, 0.03, 0.2),
        (one_beam_in_ten_reads_anything, 20, 0.05, 0.3),
    ],
    ids=["one particle", "five particles", "half of the beams", "one beam in ten wild"],
)
def test_few_particles_and_bad_beams(drive, change, particles, metres, degrees):
    result = run(change(drive), replace(REFINED, particles=particles))
    found = trajectory_error(result.trajectory, drive.truth)
    assert found.ate_rmse_m <= metres
    assert found.heading_rmse_deg <= degrees


# Seconds without a return
# ---------------------------------------------------------------------------------------------


def test_seconds_without_a_return(drive):
    """At most 0.15 m off afterwards; while blind, the cloud grows as odometry's own uncertainty does."""
    result = run(blind(drive, 18.0, 23.0))
    t = result.trajectory.t - drive.encoders.t[0]
    assert np.nanmax(away(result, drive.truth)[t > 23.5]) <= 0.15
    dark = (t > 18.1) & (t < 22.9)
    assert not any(info.matched for info, it in zip(result.infos, dark, strict=True) if it)
    spread = np.array([np.hypot(*info.particles.poses[:, :2].std(axis=0)) for info in result.infos])
    assert spread[dark][-1] > 2.0 * spread[dark][0]
    assert len(alarms(result.infos)) == 0  # blind is not lost


def test_the_very_first_scans_may_be_blind(drive):
    """The map begins with the first scan that sees anything."""
    drive = first_seconds(drive, 20.0)
    result = run(blind(drive, 0.0, 14.0))
    first = next(k for k, info in enumerate(result.infos) if info.drawn)
    assert not any(info.matched for info in result.infos[: first + 1])
    assert all(info.scored for info in result.infos[first + 1 :])
    # Where odometry says, and all particles there: the map begins at this pose, so nobody is wrong about it.
    began, saw = dead_reckoning(drive).at(result.trajectory.t[[0, first]])
    assert np.hypot(*between(began, saw)[:2]) > 1.0
    np.testing.assert_allclose(result.infos[first].estimate, between(began, saw), atol=1e-9)
    assert np.ptp(result.infos[first].particles.poses, axis=0).max() == 0.0
    assert result.dropped["scans with too few valid beams"] == first
    assert trajectory_error(result.trajectory, drive.truth).ate_rmse_m <= 0.1


# An odometry that fails for a while
# ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["set back to zero", "frozen for 3 s"])
def test_an_odometry_that_was_set_back_or_had_stood_still_is_got_over_and_its_jump_counted(name):
    """While it stands still, scans alone lead the estimate, by more than any particle has searched."""
    recording = GROUPS["odometry that fails for a while"][name](robot())
    result = run(recording)
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m <= 0.05
    assert result.dropped["jumps of the odometry"] == 1
    assert result.distrust == []


# Standing still
# ---------------------------------------------------------------------------------------------


STOOD = 60.0


@pytest.fixture(scope="module")
def long_stop():
    """A minute of standing in a room made by hand, then a drive; scans and gyro with the robot's noise."""
    exact = room_drive([(STOOD, 0, 0.0), *SQUARE])
    rng = np.random.default_rng(0)
    rates = exact.imu.angular_velocity + 0.0039 * rng.standard_normal(exact.imu.angular_velocity.shape)
    rates[:, 2] += 0.0005
    ranges = exact.lidar.ranges + 0.01 * rng.standard_normal(exact.lidar.ranges.shape)
    imu = Imu(exact.imu.t, rates, exact.imu.acceleration_g)
    return replace(exact, imu=imu, lidar=LidarScans(exact.lidar.t, ranges))


@pytest.fixture(scope="module")
def waited(long_stop):
    return run(long_stop, replace(FEW, every=2))


def test_standing_long_moves_nothing_and_adds_nothing_to_the_map_and_the_drive_goes_on(long_stop, waited):
    t = waited.trajectory.t
    still, drawn = t < STOOD, np.array([info.drawn for info in waited.infos])
    assert away(waited, long_stop.truth)[still].max() < 0.01
    assert np.abs(np.rad2deg(waited.trajectory.poses[still, 2])).max() < 0.25
    # Dead reckoning alone has turned by the gyro's bias meanwhile.
    assert np.rad2deg(dead_reckoning(long_stop).at(STOOD)[2]) > 1.0
    assert drawn[still].sum() == 1
    assert drawn.sum() > 5
    assert np.nanmax(away(waited, long_stop.truth)) < 0.05
    assert len(alarms(waited.infos)) == 0


def test_standing_long_neither_bursts_nor_collapses_the_cloud(waited):
    t = waited.trajectory.t
    spread = np.array([np.hypot(*info.particles.poses[:, :2].std(axis=0)) for info in waited.infos])
    still = (t > 5.0) & (t < STOOD)
    assert 0.5 < np.median(spread[still & (t > 45.0)]) / np.median(spread[still & (t < 20.0)]) < 2.0
    assert 1e-4 < spread[still].min() < spread[still].max() < 0.1
    infos = [info for info, it in zip(waited.infos, still, strict=True) if it]
    assert all(info.resampled or info.effective_sample_size > 2.0 for info in infos)
