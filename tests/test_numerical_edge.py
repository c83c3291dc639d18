"""Where numbers get awkward: angles at +-pi, far places, fine and coarse cells, one of a thing, clocks that jump.

Worlds and drives are made by hand (``rooms``), so the truth is exact.
"""

import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from rooms import CURVES, LIDAR, ROOM, SQUARE, arcs, box, drive, scan

from pfslam.config import PolishConfig, SlamConfig
from pfslam.correlation import ScoreField, map_correlation
from pfslam.errors import DataError
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.io.carmen import load_carmen
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, between, compose, transform_points
from pfslam.recording import Encoders, Imu, LidarScans, Recording
from pfslam.refinement import HitMoments, polish
from pfslam.runs import run_slam
from pfslam.search.lattice import Lattice, Window
from pfslam.search.volume import search
from pfslam.sensors import scan_points

pytestmark = pytest.mark.slow
FEW = replace(SlamConfig.refined(), particles=10)
CELL = FEW.map.resolution
FINE = replace(LIDAR, beams=1081)
FAR = np.array([10_000.0, -10_000.0])
SHORT = [(1.0, 10, 0.0), (1.0, 10, 0.8), (0.5, 10, 0.0)]
BRIEF = [(0.25, 10, 0.0), (0.5, 10, 0.8)]


def error(recording, config=FEW):
    """The filter's error on a recording."""
    return trajectory_error(run_slam(recording, config).trajectory, recording.truth)


def as_log(recording, start=(0.0, 0.0, 0.0)):
    """The recording as a log: its true poses, seen from elsewhere, in place of wheels and gyro."""
    odometry = Trajectory(recording.truth.t, compose(np.array(start), recording.truth.poses))
    return replace(recording, encoders=None, imu=None, odometry=odometry)


def scanned(legs, step, lidar=LIDAR, walls=ROOM):
    """A drive by hand with a scan every ``step`` seconds."""
    recording = drive(legs, walls, lidar)
    metres_per_second = recording.robot.encoders.metres_per_count / 0.025
    pose = arcs([(seconds, counts * metres_per_second, omega) for seconds, counts, omega in legs])
    t = np.arange(0.0, recording.truth.t[-1], step)
    return replace(recording, lidar=LidarScans(t, np.array([scan(walls, pose(when), lidar) for when in t])))


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
    here, _ = integrate_scan(OccupancyGrid.empty(spec), points, beams, sensor, MapConfig())
    there, _ = integrate_scan(OccupancyGrid.empty(far), points + FAR, beams, sensor + FAR, MapConfig())
    np.testing.assert_array_equal(there.log_odds, here.log_odds)
    assert map_correlation(there.occupied, far, points + FAR) == len(points)


def test_the_polish_ten_kilometres_away_corrects_as_much():
    points = scan_points(scan(ROOM, np.zeros(3)), LIDAR)
    spec, off = GridSpec.around(points, CELL, 2.0), np.array([0.02, -0.015, 0.01])
    far = GridSpec(tuple(np.add(spec.origin, FAR)), CELL, spec.shape)
    near_lines = HitMoments.empty(spec).add(points)
    far_lines = HitMoments.empty(far).add(points + FAR)
    shift = np.array([*FAR, 0.0])
    near = polish(near_lines, points, off, off, PolishConfig()).pose
    there = polish(far_lines, points, off + shift, off + shift, PolishConfig()).pose
    assert np.abs(near).max() < np.abs(off).max() / 3
    np.testing.assert_allclose(there - shift, near, atol=1e-6)


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


METHODS = {
    "refined": FEW,
    "report": replace(SlamConfig.report(), particles=10),
    "matching": SlamConfig.matching(),
    "a map for each": replace(SlamConfig.per_particle(), particles=3),
}


@pytest.mark.parametrize("metres", [1e5, 1e7, 1e8])
@pytest.mark.parametrize("method", METHODS)
def test_a_leap_of_the_odometry_is_refused_before_memory_is_taken(method, metres):
    """A map that holds it would take a terabyte and more; the run takes some megabytes, as without the leap."""
    tracemalloc.start()
    with pytest.raises(
        DataError, match="at most 400000000 cells: look for a leap in odometry or ranges"
    ) as raised:
        run_slam(leaping(metres), METHODS[method])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    who = (
        "map" if method in ("matching", "a map for each") else "(map|particles)"
    )  # one particle spreads nowhere
    assert re.match(rf"by hand, scan at 2\.100 s, {who}: cells: found \d+ x \d+ ", str(raised.value))
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
        run_slam(replace(recording, lidar=LidarScans(recording.lidar.t, ranges)), METHODS["matching"])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


def test_a_cloud_that_is_spread_over_half_a_kilometre_is_scored_in_little_memory():
    """The map is read around each particle, not once around all of them: 10,000 x 10,000 cells would be 400 MB."""
    spec = GridSpec((-5.0, -5.0), CELL, (200, 200))
    values = np.random.default_rng(0).integers(0, 1000, spec.shape).astype(np.float32)
    field = ScoreField(values, "distance")
    points, lattice, window = scan_points(scan(ROOM, np.zeros(3)), LIDAR), Lattice(CELL, 0.01), Window(4, 4)
    poses = np.random.default_rng(1).uniform(-1, 1, (100, 3)) * [250.0, 250.0, np.pi]
    poses[::2, :2] /= 250.0
    tracemalloc.start()
    together = scores_by_particle(search(field, spec, points, poses, lattice, window))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6
    for k, pose in enumerate(poses):
        (alone,) = search(field, spec, points, pose[None], lattice, window)
        np.testing.assert_array_equal(together[k], alone.scores[0])


def scores_by_particle(boxes):
    return {m: box.scores[n] for box in boxes for m, n in zip(box.members, box.node_of, strict=True)}


# Resolution
# ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("resolution", [0.01, 0.5])
def test_fine_and_coarse_cells(resolution):
    recording = drive(SHORT, lidar=FINE)
    result = run_slam(recording, replace(FEW, map=replace(FEW.map, resolution=resolution)))
    assert result.grid.spec.resolution == resolution
    assert result.updates == len(result.trajectory) - 1
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < max(resolution, 0.03)


@pytest.mark.parametrize(
    ("walls", "fine", "coarse"),
    [(ROOM, 0.01, 0.02), (box(-8.03, -7.52, 9.01, 8.48), 0.02, 0.05)],
    ids=["a room of 6 m", "a hall of 17 m"],
)
def test_cells_finer_than_half_the_gap_between_beams_hold_the_robot_back(walls, fine, coarse):
    """A wall is then a row of dots, and the next scan fits best on the same dots: a limit of the method.

    Beams of three quarters of a degree are 4 cm apart at three metres, 11 cm at eight and a half.
    """
    recording = drive(SHORT, walls)
    held, free = (error(recording, replace(FEW, map=replace(FEW.map, resolution=r))) for r in (fine, coarse))
    assert held.ate_max_m > 0.2
    assert free.ate_max_m < coarse


# Beams
# ---------------------------------------------------------------------------------------------


def test_one_beam_is_too_few_and_counted_and_odometry_leads():
    recording = drive(SHORT, lidar=replace(LIDAR, angle_min=0.0, angle_max=0.0, beams=1))
    result = run_slam(recording, FEW)
    assert result.dropped["scans with too few valid beams"] == len(result.trajectory)
    assert result.updates == 0
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < 0.01


@pytest.mark.parametrize("config", [FEW, replace(SlamConfig.report(), particles=10)])
def test_one_beam_may_be_used_if_asked_for(config):
    recording = drive(SHORT, lidar=replace(LIDAR, angle_min=0.0, angle_max=0.0, beams=1))
    result = run_slam(recording, replace(config, min_beams=1))
    assert result.updates == len(result.trajectory) - 1
    assert np.isfinite(result.trajectory.poses).all()


def test_five_thousand_beams():
    recording = scanned(SHORT, 0.25, replace(LIDAR, beams=5000))
    assert error(recording, replace(FEW, search=replace(FEW.search, beam_stride=1))).ate_max_m < CELL


def test_all_the_way_round():
    """The first beam and the last point the same way, and what is behind the robot is seen."""
    lidar = replace(LIDAR, angle_min=-np.pi, angle_max=np.pi, beams=721)
    recording = drive(SHORT, lidar=lidar)
    result = run_slam(recording, FEW)
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < CELL
    ix, iy = result.grid.spec.world_to_cell([[-1.0, 0.03], [-1.0, -0.03]]).T
    assert result.grid.free[iy, ix].all()


def test_a_log_of_a_scanner_that_sees_all_the_way_round(tmp_path):
    ranges = " ".join(["2.5"] * 720)
    step = np.deg2rad(0.5)
    (tmp_path / "a.log").write_text(
        "".join(
            f"ROBOTLASER1 0 {-np.pi} {2 * np.pi} {step} 30 0.01 0 720 {ranges} 0 0 0 0 0 0 0 0 0 0 0 0 {k} robot {k}\n"
            for k in range(1, 4)
        )
    )
    recording = load_carmen(tmp_path / "a.log")
    points = scan_points(recording.lidar.ranges[0], recording.robot.lidar)
    assert len(points) == 720
    np.testing.assert_allclose(np.hypot(*points.T), 2.5, atol=1e-6)
    assert np.degrees(np.ptp(recording.robot.lidar.angles)) == pytest.approx(359.5)


# Time
# ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hertz", [1.0, 200.0])
def test_rare_and_frequent_scans(hertz):
    recording = scanned(SQUARE if hertz == 1.0 else BRIEF, 1.0 / hertz)
    result = run_slam(recording, replace(FEW, every=1))
    assert len(result.trajectory) == len(recording.lidar.t)
    assert trajectory_error(result.trajectory, recording.truth).ate_max_m < CELL


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


def test_a_log_of_one_line(tmp_path):
    (tmp_path / "a.log").write_text(f"FLASER 20 {' '.join(['2.5'] * 20)} 1 2 3 1 2 3 10 robot 10\n")
    recording = load_carmen(tmp_path / "a.log")
    result = run_slam(recording, FEW)
    np.testing.assert_array_equal(result.trajectory.poses, [[0.0, 0.0, 0.0]])
    assert result.grid.occupied.any()


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


@pytest.mark.parametrize("by", [-1.0, -1e6])
def test_clocks_set_back_are_refused_with_the_place(by):
    with pytest.raises(DataError, match=r"time_stamps\[\d+\].*strictly increasing"):
        later(drive(SHORT), 1.0, by)


def test_stamps_of_this_century_keep_their_microseconds():
    """A double holds a stamp of 1.8e9 s to a quarter of a microsecond."""
    now, then = drive(SHORT, epoch=1.8e9), drive(SHORT)
    found, expected = (run_slam(recording, FEW).trajectory.poses for recording in (now, then))
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_one_clock_an_hour_late_has_nothing_in_common_with_the_others():
    recording = drive(SHORT)
    late = replace(recording, lidar=LidarScans(recording.lidar.t + 3600.0, recording.lidar.ranges))
    with pytest.raises(DataError, match=r"no scan within the odometry's time.*overlap"):
        run_slam(late, FEW)
    gyro = recording.imu
    with pytest.raises(DataError, match="the streams must overlap"):
        dead_reckoning(
            replace(recording, imu=Imu(gyro.t + 3600.0, gyro.angular_velocity, gyro.acceleration_g))
        )


def test_a_long_corridor_far_out_grows_the_map_only_where_the_robot_went():
    walls = box(-3.0, -1.02, 40.0, 1.03)
    recording = drive([(20.0, 25, 0.0)], walls=walls)
    grid = run_slam(
        replace(recording, lidar=LidarScans(recording.lidar.t[::5], recording.lidar.ranges[::5])), FEW
    ).grid
    height, width = (n * CELL for n in grid.spec.shape)
    assert height < 25.0
    assert 40.0 < width < 65.0
    x = transform_points(np.zeros(3), np.array([[19.0, 0.0]]))
    ix, iy = grid.spec.world_to_cell(x).T
    assert grid.free[iy, ix].all()


def test_recording_without_anything_is_refused():
    with pytest.raises(DataError, match="neither encoders with IMU nor odometry"):
        Recording("empty", drive(SHORT).robot)
