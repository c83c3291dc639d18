"""What chapter 00 draws and counts, against cases with a known answer."""

import numpy as np
import pytest
from pfslam_book import ch00

from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, LidarScans, Recording


@pytest.fixture
def steady():
    """Ten seconds straight ahead at 1 m/s: 25 counts of 1 mm at 40 Hz would do; here 10 readings a second."""
    t = np.arange(0.0, 10.01, 0.1)
    counts = np.tile(np.array([[100, 100, 100, 100]]), (len(t), 1))
    truth = Trajectory(t, np.column_stack([t, np.zeros_like(t), np.zeros_like(t)]))
    scans = LidarScans(t[:-1] + 0.04, np.full((len(t) - 1, 1081), 2.0))
    imu = Imu(t, np.zeros((len(t), 3)), np.tile([0.0, 0.0, 1.0], (len(t), 1)))
    return Recording("steady", encoders=Encoders(t, counts), imu=imu, lidar=scans, truth=truth)


def test_a_turn_drawn_right_stays_on_the_walls_and_a_lost_arm_makes_a_ring_of_its_length():
    right = ch00.turn_points("right", 360.0)
    assert "up to 0 cm beyond the walls" in ch00.describe_turn("right", 360.0)
    for way, arm in (("no lever arm", 0.13323), ("lever arm on y", 0.13323 * np.sqrt(2))):
        np.testing.assert_allclose(np.hypot(*(ch00.turn_points(way, 360.0) - right).T), arm)


def test_a_late_clock_moves_points_along_a_straight_way_and_blurs_nothing_in_time(steady):
    right, late = (ch00.shifted_scans(steady, 5.0, offset) for offset in (0.0, 0.1))
    np.testing.assert_allclose(late - right, np.tile([0.1, 0.0], (len(right), 1)), atol=1e-9)
    assert ch00.spread(right, right) == 0.0
