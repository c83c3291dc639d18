"""What chapters 00 and 02 draw and count, against hand values and cases with a known answer."""

import numpy as np
import pytest
from pfslam_book import ch00
from pfslam_book.ch02 import failures as ch02_faults
from pfslam_book.ch02 import many_scans as ch02_story
from pfslam_book.ch02 import one_scan as ch02

from pfslam.grid import GridSpec
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, LidarScans, Recording

# ---- chapter 00


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


# ---- chapter 02


@pytest.fixture
def scan():
    """A LiDAR at (0, 0.02) sees three points: straight ahead, at a grazing angle beside it, and to the left."""
    points = np.array([[1.02, 0.02], [1.02, 0.07], [0.02, 1.02]])
    return ch02.Placed(points, np.array([10, 11, 300]), np.array([0.02, 0.02]), np.zeros(3))


def test_cells_of_one_beam_are_crossed_once_and_its_own_cell_by_all(scan):
    count, spec = ch02.crossings(scan), scan.spec()
    ix, iy = spec.world_to_cell(scan.sensor)
    assert count[iy, ix] == 3
    assert count.sum() == 3 * 20  # each of the three beams is 20 cells long
    assert count[tuple(spec.world_to_cell([0.02, 0.52])[::-1])] == 1


def test_a_wall_cell_that_a_later_beam_crosses_is_lost_to_the_last_beam():
    # The second beam runs on through the cell that the first one hit.
    scan = ch02.Placed(
        np.array([[0.52, 0.02], [1.02, 0.02]]), np.array([0, 1]), np.array([0.02, 0.02]), np.zeros(3)
    )
    assert [ch02.walls_left(scan, rule) for rule in ch02.RULES] == [1.0, 0.5, 0.5]


def test_door_by_hand():
    np.testing.assert_allclose(
        ch02_story.door(1.0, 0.5, 2.0, closed=3, opened=5), [0, 1, 2, 2, 1.5, 1, 0.5, 0, -0.5]
    )
    # From the clamp 2: two scans of 1 bring it to zero, unknown; the third makes it free.
    assert ch02_story.scans_to_believe(1.0, 1.0, 2.0, closed=40) == 3
    assert ch02_story.scans_to_believe(1.0, 1.0, np.inf, closed=40) == 41
    assert ch02_story.scans_to_believe(1.0, 0.1, 2.0, closed=40) == 21


def test_points_outside_are_masked_or_end_where_they_should_not():
    spec = GridSpec((0.0, 0.0), 1.0, (3, 4))
    points = np.array([[0.5, 0.5], [-0.5, 1.5], [9.0, 2.5]])
    marked = {
        rule: np.argwhere(ch02_faults.hits_on_grid(points, spec, rule)).tolist()
        for rule in ch02_faults.EDGE_RULES
    }
    masked, clipped, wrapped = marked.values()
    assert masked == [[0, 0]]
    assert clipped == [[0, 0], [1, 0], [2, 3]]
    assert wrapped == [[0, 0], [1, 3]]


def test_the_exact_cells_of_a_ray_hold_those_of_bresenham():
    # By hand: 3/7 a column from the middle of (0, 0). The line leaves row 0 at ix = 1.17, row 1 at 3.5, row 2 at 5.83.
    assert ch02.crossed((0, 0), (7, 3)) == {
        (0, 0), (1, 0), (1, 1), (2, 1), (3, 1), (4, 2), (5, 2), (6, 2), (6, 3), (7, 3),
    }  # fmt: skip
