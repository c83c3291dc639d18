"""Where numbers get awkward: angles at +-pi, far places, fine and coarse cells, one of a thing, clocks that jump.

Worlds and drives are made by hand (``rooms``), so the truth is exact.
"""

import re
import tracemalloc
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from rooms import LIDAR, drive

from pfslam.errors import DataError
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.poses import Trajectory, compose
from pfslam.recording import LidarScans
from pfslam.run import run_slam
from pfslam.slam import SlamConfig

pytestmark = pytest.mark.slow
FEW = replace(SlamConfig.refined(), particles=10)
CELL = FEW.map.resolution
FINE = replace(LIDAR, beams=1081)
FAR = np.array([10_000.0, -10_000.0])
SHORT = [(1.0, 10, 0.0), (1.0, 10, 0.8), (0.5, 10, 0.0)]


def error(recording, config=FEW):
    """The filter's error on a recording."""
    return trajectory_error(run_slam(recording, config).trajectory, recording.truth)


def as_log(recording, start=(0.0, 0.0, 0.0)):
    """The recording as a log: its true poses, seen from elsewhere, in place of wheels and gyro."""
    odometry = Trajectory(recording.truth.t, compose(np.array(start), recording.truth.poses))
    return replace(recording, encoders=None, imu=None, odometry=odometry)


# Headings
# ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [np.pi, -np.pi])
def test_turning_twice_round_on_the_spot(rate):
    found = error(drive([(0.5, 0, 0.0), (4.0, 0, rate), (0.5, 10, 0.0)]))
    assert found.ate_max_m < CELL
    assert found.heading_rmse_deg < 0.3


def leaping():
    """A drive by hand as a log whose odometry leaps after a pause, half a second before its end, and stays there."""
    metres, seconds = 1e7, 2e6
    log = as_log(drive(SHORT))
    t, poses, end = log.odometry.t, log.odometry.poses.copy(), log.odometry.t[-1] - 0.5
    poses[t > end, :2] += np.multiply(metres, [0.8, 0.6])
    scans = LidarScans(log.lidar.t + seconds * (log.lidar.t > end), log.lidar.ranges)
    return replace(log, odometry=Trajectory(t + seconds * (t > end), poses), lidar=scans)


@pytest.mark.parametrize("config", [FEW, SlamConfig.matching()], ids=["refined", "matching"])
def test_a_leap_of_the_odometry_is_refused_before_memory_is_taken(config):
    """A map that holds it would take a terabyte and more; the run takes some megabytes, as without the leap.

    The robot may have driven as far: a recorder paused for days.
    """
    with (
        little_memory(),
        pytest.raises(DataError, match="at most 400000000 cells: look for a leap") as raised,
    ):
        run_slam(leaping(), config)
    assert re.match(
        r"by hand, scan at 200000\d\.\d+ s, (map|particles): cells: found \d+ x \d+ ", str(raised.value)
    )


@contextmanager
def little_memory():
    tracemalloc.start()
    yield
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


def test_a_scan_that_reaches_too_far_is_refused_before_memory_is_taken():
    """Nine kilometres at forty-five degrees: the piece of the map to match it with would take tens of gigabytes."""
    recording = drive(SHORT, lidar=replace(LIDAR, range_max=1e4))
    ranges = recording.lidar.ranges.copy()
    ranges[5, np.argmin(np.abs(LIDAR.angles - np.pi / 4))] = 9000.0
    said = r"scan at 0\.500 s, scan matching: cells: found \d+ x \d+ to hold one scan"
    with little_memory(), pytest.raises(DataError, match=said):
        run_slam(replace(recording, lidar=LidarScans(recording.lidar.t, ranges)), SlamConfig.matching())


# Resolution
# ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("resolution", [0.01, 0.5])
def test_fine_and_coarse_cells(resolution):
    recording = drive(SHORT, lidar=FINE)
    result = run_slam(recording, replace(FEW, map=replace(FEW.map, resolution=resolution)))
    assert result.grid.spec.resolution == resolution
    assert result.updates == len(result.trajectory) - 1
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < max(resolution, 0.03)


# Beams
# ---------------------------------------------------------------------------------------------


def test_all_the_way_round():
    """The first beam and the last point the same way, and what is behind the robot is seen."""
    lidar = replace(LIDAR, angle_min=-np.pi, angle_max=np.pi, beams=721)
    recording = drive(SHORT, lidar=lidar)
    result = run_slam(recording, FEW)
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < CELL
    ix, iy = result.grid.spec.world_to_cell([[-1.0, 0.03], [-1.0, -0.03]]).T
    assert result.grid.free[iy, ix].all()


@pytest.mark.parametrize(
    "config", [FEW, replace(SlamConfig.report(), particles=10), SlamConfig.per_particle()]
)
def test_a_recording_of_one_scan(config):
    recording = drive(SHORT)
    scans = recording.lidar
    result = run_slam(replace(recording, lidar=LidarScans(scans.t[5:6], scans.ranges[5:6])), config)
    assert (len(result.trajectory), result.updates) == (1, 0)
    assert result.grid.occupied.sum() > 100
    assert np.isfinite(result.trajectory.poses).all()


def test_stamps_of_this_century_keep_their_microseconds():
    """A double holds a stamp of 1.8e9 s to a quarter of a microsecond."""
    now, then = drive(SHORT, epoch=1.8e9), drive(SHORT)
    found, expected = (run_slam(recording, FEW).trajectory.poses for recording in (now, then))
    np.testing.assert_allclose(found, expected, atol=1e-4)
