"""Rules of one line each, with values worked out by hand: each was once broken without any test failing."""

from dataclasses import replace

import numpy as np
import pytest
from rooms import LIDAR, ROOM, scan

import pfslam
from pfslam.beyond.localization import KnownMap, LocalizationConfig, LocalizationState, localization_step
from pfslam.grid import GridSpec, MapConfig, OccupancyGrid
from pfslam.particles import Particles
from pfslam.refined.events import level_scan, levelled_event
from pfslam.refined.map import OLD
from pfslam.refined.outliers import OutlierConfig, WaitingScan, settle_hits
from pfslam.refined.step import RefinedConfig, refined_step
from pfslam.sensors import FLOOR_CLEARANCE, LidarModel

NOT_MOVED = (np.zeros(0),) * 3


def event_at(pose, motion=(0.0, 0.0, 0.0), walls=ROOM):
    """The event of a scan in the room, stamped 0."""
    path = pfslam.Trajectory(np.array([0.0]), np.zeros((1, 3)))
    return levelled_event(0.0, scan(walls, np.array(pose)), LIDAR, np.array(motion), NOT_MOVED, path)


@pytest.mark.parametrize(("height", "struck"), [(0.05, 1), (0.15, 0), (-0.05, 1)])
def test_a_beam_that_ends_lower_than_the_clearance_has_struck_the_floor(height, struck):
    """The body leans forward by 0.1 rad; the beam ends so high above the ground under the wheels."""
    lidar = LidarModel(angle_min=0.0, angle_max=0.0, beams=1, position_b=(0.0, 0.0, 0.5))
    pitch = 0.1
    length = (0.5 * np.cos(pitch) - height) / np.sin(pitch)
    points, _, _, left_out = level_scan(np.array([length]), lidar, (pitch, 0.0), FLOOR_CLEARANCE)
    assert (len(points), left_out) == (1 - struck, struck)


def test_a_wall_is_old_once_twenty_scans_were_drawn_since_it_was_first_hit():
    """The walls that the first scans hit are old, those of the last twenty are not."""
    config = RefinedConfig()
    drawn = config.start().map
    first, last = event_at((0.0, 0.0, 0.0)), event_at((2.0, 0.5, np.pi))
    for k in range(OLD + 5):
        drawn.draw(first if k < 5 else last, np.zeros(3), np.eye(3))
    assert drawn.on_old_walls(first, np.zeros(3)) > 0.9
    only_new = [drawn.moments.first_scan(p[None])[0] >= 5 for p in last.points_b]
    assert np.mean(only_new) > 0.1
    assert drawn.on_old_walls(last, np.zeros(3)) == pytest.approx(1.0 - np.mean(only_new))


def test_the_variance_of_scans_without_beams_adds_up_once():
    config = RefinedConfig(particles=5)
    rng, belief = np.random.default_rng(0), config.start()
    belief, _ = refined_step(belief, event_at((0.0, 0.0, 0.0)), config, rng)
    blind = replace(event_at((0.0, 0.0, 0.0)), points_b=np.zeros((0, 2)), beams=np.zeros(0, dtype=int))
    sigma_xy, sigma_yaw = config.noise.sigmas(0.0, 0.0)
    for k in range(1, 4):
        belief, step = refined_step(belief, blind, config, rng)
        assert not step.matched
        expected = [k * sigma_xy**2, k * sigma_xy**2, k * sigma_yaw**2]
        np.testing.assert_allclose(np.diag(step.covariance), expected, rtol=1e-9)


@pytest.mark.parametrize(("votes", "drawn"), [(1, 1), (0, 1), (-1, 0)])
def test_a_hit_that_was_held_back_is_drawn_if_met_at_least_as_often_as_seen_through(votes, drawn):
    """It has waited for five scans; the last one says nothing of it."""
    spec, far = GridSpec((0.0, 0.0), 0.05, (200, 200)), np.array([[9.0, 9.0]])
    others = WaitingScan(np.zeros((0, 2)), np.zeros(0, dtype=int), np.zeros(0, dtype=bool))
    oldest = WaitingScan(far, np.array([votes]), np.array([False]))
    now = np.array([[2.0, 1.0], [2.0, 1.1]])
    before, scan_now = (oldest, others, others, others, others), (now, np.array([0, 1]), np.ones(2))
    hits, waiting = settle_hits(before, spec, *scan_now, MapConfig(), OutlierConfig())
    assert len(waiting) == 5
    assert np.count_nonzero((hits == far).all(axis=1)) == drawn


def test_particles_are_drawn_anew_from_the_first_scan_on_if_it_fits_badly():
    """No pose of the map explains a scan of walls that it does not have: the right place is not among the particles."""
    spec = GridSpec((-5.0, -5.0), 0.05, (200, 200))
    free = np.full(spec.shape, -1.0, dtype=np.float32)
    free[:, 0] = 1.0
    known = KnownMap.of(OccupancyGrid(spec, free), LocalizationConfig())
    state = LocalizationState(Particles.at(np.zeros(3), 100))
    event = event_at((0.0, 0.0, 0.0))
    _, info = localization_step(state, event, known, np.random.default_rng(0))
    assert info.fit < 0.2
    assert info.injected > 0.5


def test_an_odometer_keeps_what_the_first_beams_of_the_next_scan_ask_for():
    """Scans follow one another faster than one of them is measured; the robot turns to and fro meanwhile."""
    lidar = replace(LIDAR, sweep=0.3)
    t = np.arange(60) / 50.0
    poses = np.column_stack([0.5 * t, 0.0 * t, 0.4 * np.sin(12.0 * t)])
    scans = pfslam.recording.LidarScans(0.3 + np.arange(6) / 10.0, np.tile(scan(ROOM, np.zeros(3)), (6, 1)))
    robot = replace(pfslam.RobotModel(), lidar=lidar)
    recording = pfslam.Recording("to and fro", robot, odometry=pfslam.Trajectory(t, poses), lidar=scans)
    odometer, expected = pfslam.Odometer(robot), RefinedConfig(every=1).used_scans(recording).events()
    waiting = list(zip(t, poses, strict=True))
    for event, ranges in zip(expected, scans.ranges, strict=True):
        while not odometer.reaches(event.t):
            odometer.add_pose(*waiting.pop(0))
        np.testing.assert_allclose(odometer.event(event.t, ranges).points_b, event.points_b, atol=1e-12)


def test_weights_come_back_from_a_file_to_the_last_bit(tmp_path):
    """Normalised a second time they would change: these sum to 1 only as nearly as numbers can."""
    rng = np.random.default_rng(0)
    clouds = (Particles(rng.normal(size=(7, 3)), rng.normal(size=7)) for _ in range(100))
    cloud = next(
        c for c in clouds if not np.array_equal(Particles(*vars(c).values()).log_weights, c.log_weights)
    )
    mapper = pfslam.Mapper(LIDAR, RefinedConfig(particles=7))
    mapper.add(0.0, scan(ROOM, np.zeros(3)), np.zeros(3))
    mapper.belief = replace(mapper.belief, particles=cloud)
    mapper.save(tmp_path / "belief.npz")
    again = pfslam.Mapper.load(tmp_path / "belief.npz").belief.particles
    np.testing.assert_array_equal(again.log_weights, cloud.log_weights)
    np.testing.assert_array_equal(again.poses, cloud.poses)
