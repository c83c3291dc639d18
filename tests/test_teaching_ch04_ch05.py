"""What chapters 04 and 05 draw and count, against the definition and against cases with a known answer."""

import numpy as np
import pytest
from pfslam_book.ch04 import scores as ch04
from pfslam_book.ch04 import search as ch04_search
from pfslam_book.ch04 import weights as ch04_judge
from pfslam_book.ch05 import measurements as ch05_runs

from pfslam.correlation import map_correlation
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.poses import Trajectory
from pfslam.recording import LidarScans, Recording


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


def test_on_an_empty_map_argmax_walks():
    np.testing.assert_allclose(ch04_search.first_index_walk(2)[-1], [-0.4, -0.4, -0.04])


def test_counts_pose_by_pose_and_of_the_window(place):
    poses = ch04_judge.cloud(place, n=5)
    stand = ch04_judge.counts_where_they_stand(place, poses)
    assert stand[0] == count(place, place.moved(*(poses[0] - place.pose)))
    nodes = ch04.LATTICE.nearest(poses)
    best = [ch04_search.block_from_volume(place, node).max() for node in nodes]
    np.testing.assert_array_equal(ch04_judge.counts_of_the_window(place, poses), best)


def test_sharpness_runs_from_flat_to_one_winner():
    counts = np.array([500.0, 520.0, 510.0])
    assert ch04_judge.n_eff(ch04_judge.sharpened(counts, 0.0)) == pytest.approx(3.0)
    weights = ch04_judge.sharpened(counts, 1.0)
    assert weights[1] / weights[0] == pytest.approx(np.exp(20.0))
    assert weights.sum() == pytest.approx(1.0)


def test_rounding_in_the_score_moves_its_peak_by_half_a_cell():
    wall = ch04_judge.wall_place(0.05)
    bias = ch04_judge.best_shift(wall, np.rint) - ch04_judge.best_shift(wall)
    assert bias[0] == pytest.approx(-0.025, abs=0.011)


def test_end_points_do_not_see_the_thickness_of_a_wall():
    dx = np.array([0.0, 0.5, 1.3])
    thick = ch04_search.fine_scores(ch04_judge.wall_place(1.0), dx, "distance")
    np.testing.assert_allclose(thick, [1.0, 1.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(ch04_judge.beam_scores(dx), [1.0, 0.0, 0.0], atol=1e-3)


def test_a_path_stretched_along_the_corridor_makes_it_too_long_by_that_much():
    t = np.linspace(0.0, 40.0, 81)
    truth = Trajectory(t, np.column_stack([t, np.zeros_like(t), np.zeros_like(t)]))
    stretched = Trajectory(t, truth.poses * [1.05, 1.0, 1.0])
    recording = Recording(
        "corridor", odometry=truth, truth=truth, lidar=LidarScans(t, np.ones((len(t), 1081)))
    )
    assert ch05_runs.corridor_excess(recording, truth) == pytest.approx(0.0)
    assert ch05_runs.corridor_excess(recording, stretched) == pytest.approx(0.05 * 14.0)
