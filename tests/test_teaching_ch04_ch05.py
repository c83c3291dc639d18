"""What chapters 04 and 05 draw and count, against the definition and against cases with a known answer."""

import numpy as np
import pytest

from pfslam.correlation import map_correlation
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.poses import Trajectory
from pfslam.recording import LidarScans, Recording
from pfslam.teaching import ch04, ch04_search, ch05_runs


@pytest.fixture
def place():
    """A ragged map and a scan of random points, some of them outside the grid."""
    rng = np.random.default_rng(4)
    spec = GridSpec((-2.0, -1.5), 0.05, (60, 80))
    log_odds = np.where(rng.random(spec.shape) < 0.3, 1.0, -1.0).astype(np.float32)
    points = rng.uniform(-2.5, 2.5, (400, 2))
    return ch04.Place(OccupancyGrid(spec, log_odds), points, np.array([0.113, -0.207, 0.4]))


def count(place, points_w):
    return map_correlation(place.grid.occupied, place.grid.spec, points_w)


def test_points_that_light_up_are_the_points_that_count(place):
    assert ch04.on_walls(place, place.moved()).sum() == count(place, place.moved())


@pytest.mark.parametrize(("row", "column"), [(8, 8), (0, 0), (3, 14), (16, 5)])
def test_surface_is_the_count_at_each_shift(place, row, column):
    scores = ch04.surface(place, dtheta=0.05)
    moved = place.moved((column - 8) * 0.05, (row - 8) * 0.05, 0.05)
    assert scores[row, column] == count(place, moved)


def test_volume_gives_the_counts_of_the_definition(place):
    node = ch04.LATTICE.nearest(place.pose)
    slow, fast = ch04_search.block_by_definition(place, node), ch04_search.block_from_volume(place, node)
    assert slow.shape == (9, 9, 9)
    assert slow.max() > 0
    np.testing.assert_array_equal(slow, fast)


def test_on_an_empty_map_argmax_walks_and_the_package_stays(place):
    np.testing.assert_allclose(ch04_search.first_index_walk(2)[-1], [-0.4, -0.4, -0.04])
    before, after = ch04_search.match_on_empty_map(place, np.random.default_rng(0))
    np.testing.assert_allclose(before, after)


def test_a_path_stretched_along_the_corridor_makes_it_too_long_by_that_much():
    t = np.linspace(0.0, 40.0, 81)
    truth = Trajectory(t, np.column_stack([t, np.zeros_like(t), np.zeros_like(t)]))
    stretched = Trajectory(t, truth.poses * [1.05, 1.0, 1.0])
    recording = Recording(
        "corridor", odometry=truth, truth=truth, lidar=LidarScans(t, np.ones((len(t), 1081)))
    )
    assert ch05_runs.corridor_excess(recording, truth) == pytest.approx(0.0)
    assert ch05_runs.corridor_excess(recording, stretched) == pytest.approx(0.05 * 14.0)
    assert ch05_runs.first_seconds(recording, 10.0).lidar.t[-1] < 10.0
