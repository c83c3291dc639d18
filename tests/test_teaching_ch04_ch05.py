"""What chapters 04 and 05 draw and count, against the definition and against cases with a known answer."""

import numpy as np
import pytest
from pfslam_book.ch04 import scores as ch04
from pfslam_book.ch04 import search as ch04_search
from pfslam_book.ch04 import weights as ch04_judge

from pfslam.correlation import map_correlation
from pfslam.grid import GridSpec, OccupancyGrid


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


def test_counts_pose_by_pose_and_of_the_window(place):
    poses = ch04_judge.cloud(place, n=5)
    stand = ch04_judge.counts_where_they_stand(place, poses)
    assert stand[0] == count(place, place.moved(*(poses[0] - place.pose)))
    nodes = ch04.LATTICE.nearest(poses)
    best = [ch04_search.block_from_volume(place, node).max() for node in nodes]
    np.testing.assert_array_equal(ch04_judge.counts_of_the_window(place, poses), best)


def test_rounding_in_the_score_moves_its_peak_by_half_a_cell():
    wall = ch04_judge.wall_place(0.05)
    bias = ch04_judge.best_shift(wall, np.rint) - ch04_judge.best_shift(wall)
    assert bias[0] == pytest.approx(-0.025, abs=0.011)


def test_end_points_do_not_see_the_thickness_of_a_wall():
    dx = np.array([0.0, 0.5, 1.3])
    thick = ch04_search.fine_scores(ch04_judge.wall_place(1.0), dx, "distance")
    np.testing.assert_allclose(thick, [1.0, 1.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(ch04_judge.beam_scores(dx), [1.0, 0.0, 0.0], atol=1e-3)
