"""Where numbers get awkward: angles at +-pi, far places, fine and coarse cells, one of a thing, clocks that jump.

Worlds and drives are made by hand (``rooms``), so the truth is exact.
"""

import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from rooms import CURVES, LIDAR, ROOM, box, drive, scan

from pfslam.correlation import map_correlation
from pfslam.errors import DataError
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, between, compose
from pfslam.recording import Encoders, Imu, LidarScans
from pfslam.run import run_slam
from pfslam.sensors import scan_points
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


@pytest.mark.parametrize("rate", [np.pi / 2, -np.pi / 2])
def test_turning_twice_round_on_the_spot(rate):
    found = error(drive([(0.5, 0, 0.0), (4.0, 0, 2.0 * rate), (0.5, 10, 0.0)]))
    assert found.ate_max_m < CELL
    assert found.heading_rmse_deg < 0.3


@pytest.mark.parametrize("heading", [np.pi, -np.pi + 1e-9, 3.0])
def test_a_log_that_begins_at_pi_gives_the_run_of_one_that_begins_at_zero(heading):
    recording = drive(CURVES)
    turned = as_log(recording, (0.0, 0.0, heading))
    np.testing.assert_allclose(
        between(dead_reckoning(turned).poses, dead_reckoning(as_log(recording)).poses), 0.0, atol=1e-9
    )
    assert error(turned).ate_max_m < CELL


# Far from the origin
# ---------------------------------------------------------------------------------------------


def test_a_log_ten_kilometres_away_gives_the_same_estimates():
    here, there = as_log(drive(SHORT)), as_log(drive(SHORT), (*FAR, 0.0))
    found, expected = (run_slam(log, FEW).trajectory.poses for log in (there, here))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_map_and_score_ten_kilometres_away_are_the_same():
    """Cells are 0.05 m and ten kilometres are 200,000 of them: doubles still tell a picometre there.

    A tenth of a cell keeps all points off the borders of cells, where the last bit decides.
    """
    points = scan_points(scan(ROOM, np.zeros(3)), LIDAR)
    spec = GridSpec.around(points, CELL).grown(1, 1, 1, 1)
    near = np.add(spec.origin, [0.1 * CELL, 0.13 * CELL])
    inside = (np.abs(((points - near) / CELL) % 1.0 - 0.5) < 0.499).all(axis=1)
    points, beams, sensor = points[inside], np.flatnonzero(inside), np.array([0.1, 0.0])
    assert inside.sum() > 300
    spec, far = (GridSpec(tuple(origin), CELL, spec.shape) for origin in (near, near + FAR))
    here, there = OccupancyGrid.empty(spec), OccupancyGrid.empty(far)
    integrate_scan(here, points, beams, sensor, MapConfig())
    integrate_scan(there, points + FAR, beams, sensor + FAR, MapConfig())
    np.testing.assert_array_equal(there.log_odds, here.log_odds)
    assert map_correlation(there.occupied, far, points + FAR) == len(points)


def test_a_map_that_would_be_too_large_is_refused_before_memory_is_taken():
    grid = OccupancyGrid.empty(GridSpec((0.0, 0.0), CELL, (100, 100)))
    with pytest.raises(
        DataError, match=r"map: cells: found 20\d{4} x 20\d{4} to reach .* at most 400000000 cells"
    ):
        grid.covering(np.array([FAR]))
    straight = grid.covering(np.array([[2000.0, 1.0]]))  # two kilometres along an axis are fine
    assert straight.spec.shape == (100, 40101)


def leaping(metres):
    """A drive by hand as a log whose odometry leaps, half a second before its end, and never comes back."""
    log = as_log(drive(SHORT))
    t, poses = log.odometry.t, log.odometry.poses.copy()
    poses[t > t[-1] - 0.5, :2] += np.multiply(metres, [0.8, 0.6])
    return replace(log, odometry=Trajectory(t, poses))


@pytest.mark.parametrize("config", [FEW, SlamConfig.matching()], ids=["refined", "matching"])
def test_a_leap_of_the_odometry_is_refused_before_memory_is_taken(config):
    """A map that holds it would take a terabyte and more; the run takes some megabytes, as without the leap."""
    tracemalloc.start()
    with pytest.raises(DataError, match="at most 400000000 cells: look for a leap") as raised:
        run_slam(leaping(1e7), config)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert re.match(r"by hand, scan at 2\.100 s, (map|particles): cells: found \d+ x \d+ ", str(raised.value))
    assert peak < 50e6


def test_a_scan_that_reaches_too_far_is_refused_before_memory_is_taken():
    """Nine kilometres at forty-five degrees: the piece of the map to match it with would take tens of gigabytes."""
    recording = drive(SHORT, lidar=replace(LIDAR, range_max=1e4))
    ranges = recording.lidar.ranges.copy()
    ranges[5, np.argmin(np.abs(LIDAR.angles - np.pi / 4))] = 9000.0
    tracemalloc.start()
    with pytest.raises(
        DataError, match=r"scan at 0\.500 s, scan matching: cells: found \d+ x \d+ to hold one scan"
    ):
        run_slam(replace(recording, lidar=LidarScans(recording.lidar.t, ranges)), SlamConfig.matching())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


# Resolution
# ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("resolution", [0.01, 0.5])
def test_fine_and_coarse_cells(resolution):
    recording = drive(SHORT, lidar=FINE)
    result = run_slam(recording, replace(FEW, map=replace(FEW.map, resolution=resolution)))
    assert result.grid.spec.resolution == resolution
    assert result.updates == len(result.trajectory) - 1
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < max(resolution, 0.03)


def test_cells_finer_than_half_the_gap_between_beams_hold_the_robot_back():
    """A wall is then a row of dots, and the next scan fits best on the same dots: a limit of the method.

    Beams of three quarters of a degree are 11 cm apart at eight metres and a half.
    """
    recording = drive(SHORT, box(-8.03, -7.52, 9.01, 8.48))
    held, free = (error(recording, replace(FEW, map=replace(FEW.map, resolution=r))) for r in (0.02, 0.05))
    assert held.ate_max_m > 0.2
    assert free.ate_max_m < 0.05


# Beams
# ---------------------------------------------------------------------------------------------


def test_one_beam_is_too_few_and_counted_and_odometry_leads():
    recording = drive(SHORT, lidar=replace(LIDAR, angle_min=0.0, angle_max=0.0, beams=1))
    result = run_slam(recording, FEW)
    assert result.dropped["scans with too few valid beams"] == len(result.trajectory)
    assert result.updates == 0
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < 0.01


def test_all_the_way_round():
    """The first beam and the last point the same way, and what is behind the robot is seen."""
    lidar = replace(LIDAR, angle_min=-np.pi, angle_max=np.pi, beams=721)
    recording = drive(SHORT, lidar=lidar)
    result = run_slam(recording, FEW)
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < CELL
    ix, iy = result.grid.spec.world_to_cell([[-1.0, 0.03], [-1.0, -0.03]]).T
    assert result.grid.free[iy, ix].all()


# Time
# ---------------------------------------------------------------------------------------------


def first_scan_only(recording):
    scans = recording.lidar
    return replace(recording, lidar=LidarScans(scans.t[5:6], scans.ranges[5:6]))


@pytest.mark.parametrize(
    "config", [FEW, replace(SlamConfig.report(), particles=10), SlamConfig.per_particle()]
)
def test_a_recording_of_one_scan(config):
    result = run_slam(first_scan_only(drive(SHORT)), config)
    assert (len(result.trajectory), result.updates) == (1, 0)
    assert result.grid.occupied.sum() > 100
    assert np.isfinite(result.trajectory.poses).all()


def later(recording, at, by):
    """The recording with all clocks set forward by ``by`` seconds at time ``at``."""

    def clock(t):
        return np.where(t >= at, t + by, t)

    wheels, gyro, scans, truth = recording.encoders, recording.imu, recording.lidar, recording.truth
    return replace(
        recording,
        encoders=Encoders(clock(wheels.t), wheels.counts),
        imu=Imu(clock(gyro.t), gyro.angular_velocity, gyro.acceleration_g),
        lidar=LidarScans(clock(scans.t), scans.ranges),
        truth=Trajectory(clock(truth.t), truth.poses),
    )


@pytest.mark.parametrize("by", [10.0, 3600.0])
def test_clocks_set_forward_while_the_robot_stands(by):
    recording = later(drive([*SHORT, (1.0, 0, 0.0), *SHORT]), 3.0, by)
    result = run_slam(recording, FEW)
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < CELL
    assert len(result.trajectory) == len(recording.lidar.t)


def test_stamps_of_this_century_keep_their_microseconds():
    """A double holds a stamp of 1.8e9 s to a quarter of a microsecond."""
    now, then = drive(SHORT, epoch=1.8e9), drive(SHORT)
    found, expected = (run_slam(recording, FEW).trajectory.poses for recording in (now, then))
    np.testing.assert_allclose(found, expected, atol=1e-4)
