"""The fast search gives the integers of the definition, everywhere and for every cloud."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pfslam.correlation import ScoreField, map_correlation, renew_field, score_field, squared_distance
from pfslam.grid import GridSpec
from pfslam.poses import transform_points
from pfslam.refined.search import boxes, volume
from pfslam.refined.search.boxes import cheapest_boxes
from pfslam.refined.search.lattice import Lattice, Window, distinct_nodes
from pfslam.refined.search.volume import search

SPEC = GridSpec((-1.0, -2.0), 0.5, (8, 6))


def test_definition_counts_points_on_occupied_cells():
    occupied = np.zeros((8, 6), dtype=bool)
    occupied[3, 1] = occupied[7, 5] = True  # x in [-0.5, 0), y in [-0.5, 0); and the last cell, to (2, 2)
    points = [[-0.5, -0.5], [-0.01, -0.01], [0.0, -0.25], [-0.25, 0.0], [1.9, 1.9], [-0.4, -0.4]]
    score = map_correlation(occupied, SPEC, np.array(points))
    assert score == 4  # two points of one cell count twice
    assert isinstance(score, int)


def test_points_outside_the_grid_score_nothing():
    outside = np.array([[-1.01, 0.0], [2.0, 0.0], [0.0, -2.01], [0.0, 2.0], [-700.0, 900.0]])
    assert map_correlation(np.ones((8, 6), dtype=bool), SPEC, outside) == 0
    assert map_correlation(np.ones((8, 6), dtype=bool), SPEC, np.zeros((0, 2))) == 0


def by_definition(occupied, spec, points_b, node, lattice, window):
    """Scores of the window around a node, one pose after another through the definition."""
    poses = lattice.pose(node + window.steps())
    return [map_correlation(occupied, spec, transform_points(pose, points_b)) for pose in poses]


def assert_search_is_the_definition(occupied, spec, points_b, poses, lattice, window):
    field, seen = score_field(occupied, "occupied"), []
    for found in search(field, spec, points_b, poses, lattice, window):
        for scores, node in zip(found.scores, found.nodes, strict=True):
            np.testing.assert_array_equal(
                scores, by_definition(occupied, spec, points_b, node, lattice, window)
            )
        np.testing.assert_array_equal(
            found.nodes[found.node_of], np.rint(poses[found.members] / lattice.steps)
        )
        seen.extend(found.members)
    assert sorted(seen) == list(range(len(poses)))


def random_case(seed, beams=25, cells=(30, 40), share=0.3, resolution=0.05):
    rng = np.random.default_rng(seed)
    occupied = rng.random(cells) < share
    # Off the lattice, so that no end point lies on the border of a cell, where round-off would decide.
    origin = -0.5 * resolution * np.array(cells[::-1]) + rng.uniform(0.1, 0.9, 2) * resolution
    return rng, occupied, GridSpec(tuple(origin), resolution, cells), rng.uniform(-1.0, 1.0, (beams, 2))


LATTICE, WINDOW = Lattice(0.05, 0.01), Window(2, 2)


@pytest.mark.parametrize("seed", range(6))
def test_search_equals_the_definition_on_random_maps_and_clouds(seed):
    rng, occupied, spec, points = random_case(seed)
    poses = rng.normal(0.0, [0.1, 0.1, 0.03], (12, 3))
    assert_search_is_the_definition(occupied, spec, points, poses, LATTICE, WINDOW)


@pytest.mark.parametrize("yaw_step", [0.01, 0.005, 0.0073])
def test_search_equals_the_definition_for_headings_on_both_sides_of_pi(yaw_step):
    rng, occupied, spec, points = random_case(7)
    poses = rng.normal(0.0, [0.05, 0.05, 0.02], (10, 3))
    poses[:, 2] = np.pi - np.abs(poses[:, 2])
    poses[::2, 2] *= -1
    assert_search_is_the_definition(occupied, spec, points, poses, Lattice(0.05, yaw_step), WINDOW)


@pytest.mark.parametrize("offset", [(1.0, 0.0), (0.0, -0.9), (-1.7, 1.2), (50.0, -80.0)])
def test_search_equals_the_definition_at_and_beyond_the_edge_of_the_map(offset):
    rng, occupied, spec, points = random_case(8)
    poses = rng.normal(0.0, [0.1, 0.1, 0.02], (6, 3)) + [*offset, 1.0]
    assert_search_is_the_definition(occupied, spec, points, poses, LATTICE, WINDOW)


def test_search_with_one_beam_one_particle_and_the_smallest_window():
    rng, occupied, spec, points = random_case(9, beams=1)
    assert_search_is_the_definition(occupied, spec, points, rng.normal(0, 0.1, (5, 3)), LATTICE, WINDOW)
    assert_search_is_the_definition(occupied, spec, points, np.zeros((1, 3)), LATTICE, Window(0, 0))


def test_search_with_unequal_window_and_cells_counted_twice():
    rng, occupied, spec, points = random_case(10)
    doubled = np.concatenate([points, points[:10]])
    assert_search_is_the_definition(
        occupied, spec, doubled, rng.normal(0, 0.1, (5, 3)), LATTICE, Window(3, 1)
    )


def test_wide_cloud_is_cut_into_boxes_with_the_same_scores():
    rng, occupied, spec, points = random_case(11, cells=(120, 140))
    centres = np.array([[-2.0, -2.0, -3.0], [2.0, 2.0, 0.0], [2.5, -2.0, 1.5]])
    poses = np.repeat(centres, 4, axis=0) + rng.normal(0, 0.02, (12, 3))
    found = list(search(score_field(occupied, "occupied"), spec, points, poses, LATTICE, WINDOW))
    assert len(found) > 1  # one volume over all three groups would hold 300 headings
    assert_search_is_the_definition(occupied, spec, points, poses, LATTICE, WINDOW)


def test_boxes_are_cut_where_memory_runs_out(monkeypatch):
    rng, occupied, spec, points = random_case(12)
    monkeypatch.setattr(boxes, "MAX_SCORES", 2 * 5**3)
    assert_search_is_the_definition(occupied, spec, points, rng.normal(0, 0.05, (12, 3)), LATTICE, WINDOW)


@pytest.mark.parametrize("in_one", [True, False])
def test_one_volume_and_a_window_for_each_node_give_the_integers_of_the_definition(monkeypatch, in_one):
    rng, occupied, spec, points = random_case(14)
    monkeypatch.setattr(volume, "volume_is_cheaper", lambda *_: in_one)
    monkeypatch.setattr(volume, "CACHE", 40)
    poses = rng.normal(0.0, [0.3, 0.3, 0.05], (9, 3))
    poses[5:] = poses[4]
    assert_search_is_the_definition(occupied, spec, points, poses, LATTICE, Window(2, 1))


REACH = np.array([2, 2, 2])


def test_headings_on_both_sides_of_pi_are_two_boxes_even_if_one_side_holds_a_single_node():
    nodes = np.array([[0, 0, -628], [0, 0, 620], [1, 0, 621], [0, 1, 625], [0, 0, 626], [1, 1, 627]])
    assert [list(part) for part in cheapest_boxes(nodes, REACH, 200)] == [[0], [1, 2, 3, 4, 5]]


def test_distinct_nodes_are_sorted_and_say_where_each_row_went():
    nodes = np.random.default_rng(0).integers(-3, 3, (60, 3)) * [1, 1000, 7]
    distinct, which = distinct_nodes(nodes)
    np.testing.assert_array_equal(distinct, np.unique(nodes, axis=0))
    np.testing.assert_array_equal(distinct[which], nodes)


def test_wide_cloud_over_a_distance_field_scores_whole_numbers():
    rng, occupied, spec, points = random_case(13)
    field, poses = score_field(occupied, "distance"), rng.normal(0, [0.3, 0.3, 0.5], (8, 3))
    for found in search(field, spec, points, poses, LATTICE, WINDOW):
        for scores, node in zip(found.scores, found.nodes, strict=True):
            for score, pose in zip(scores, LATTICE.pose(node + WINDOW.steps()), strict=True):
                cells = spec.world_to_cell(transform_points(pose, points))
                ix, iy = cells[spec.contains(cells)].T
                assert score == field.values[iy, ix].astype(int).sum()


@given(
    st.lists(st.tuples(*[st.integers(-300, 300)] * 3), min_size=1, max_size=40, unique=True),
    st.integers(1, 2000),
)
@settings(max_examples=50)
def test_boxes_part_the_nodes(nodes, beams):
    parts = cheapest_boxes(np.array(nodes), np.array([4, 4, 4]), beams)
    assert sorted(np.concatenate(parts)) == list(range(len(nodes)))


def test_window_steps_run_through_headings_rows_columns():
    steps = WINDOW.steps()
    assert steps.shape == (125, 3)
    np.testing.assert_array_equal(steps[0], [-2, -2, -2])
    np.testing.assert_array_equal(steps[1] - steps[0], [1, 0, 0])
    np.testing.assert_array_equal(steps[5] - steps[0], [0, 1, 0])
    np.testing.assert_array_equal(steps[25] - steps[0], [0, 0, 1])
    np.testing.assert_array_equal(steps[WINDOW.centre], [0, 0, 0])


def test_report_window_has_729_poses():
    assert len(Window(4, 4).steps()) == 729


def test_nearest_lattice_node():
    np.testing.assert_array_equal(
        LATTICE.nearest([[0.074, -0.076, 0.0149], [0.0, 0.024, -0.0051]]), [[1, -2, 1], [0, 0, -1]]
    )


def field_by_brute_force(occupied):
    """1000 exp(-d^2 / 2) of the distance in cells to the nearest occupied cell, up to four cells."""
    field, there = np.zeros(occupied.shape), np.argwhere(occupied)
    for iy, ix in np.ndindex(occupied.shape):
        squared = ((there - [iy, ix]) ** 2).sum(axis=1).min(initial=10_000)
        field[iy, ix] = np.round(1000 * np.exp(-0.5 * squared)) if squared <= 16 else 0
    return field


@given(
    st.integers(0, 10_000), st.integers(1, 30), st.integers(1, 30), st.sampled_from([0, 0.01, 0.1, 0.5, 1])
)
@settings(max_examples=60)
def test_likelihood_field_is_that_of_the_nearest_occupied_cell(seed, height, width, share):
    occupied = np.random.default_rng(seed).random((height, width)) < share
    field, count = score_field(occupied, "distance"), score_field(occupied, "occupied")
    np.testing.assert_array_equal(field.values, field_by_brute_force(occupied))
    np.testing.assert_array_equal(count.values, occupied)
    assert field.values.dtype == count.values.dtype == np.float32
    assert (field.top, count.top) == (1000, 1)


@given(st.integers(0, 10_000), st.integers(1, 12), st.integers(1, 12), st.integers(0, 6))
@settings(max_examples=60)
def test_squared_distance_is_the_least_over_all_occupied_cells(seed, height, width, reach):
    occupied = np.random.default_rng(seed).random((height, width)) < 0.1
    found, there = squared_distance(occupied, reach), np.argwhere(occupied)
    for iy, ix in np.ndindex(occupied.shape):
        squared = ((there - [iy, ix]) ** 2).sum(axis=1).min(initial=10_000)
        assert found[iy, ix] == squared if squared <= reach**2 else found[iy, ix] > reach**2


def test_counted_cells_are_those_of_each_row_counted_one_by_one():
    cells = np.random.default_rng(0).integers(0, 35, (8, 40))
    counts, iy, ix = volume.counted(cells, (5, 7))
    np.testing.assert_array_equal(7 * iy + ix, np.unique(cells))
    for row, found in zip(cells, counts, strict=True):
        np.testing.assert_array_equal(found, [np.count_nonzero(row == cell) for cell in np.unique(cells)])


@pytest.mark.parametrize("headings", [1, 7, 8, 9, 16, 20])
def test_headings_scored_together_are_scored_as_one_by_one(headings):
    _, occupied, spec, points = random_case(7, beams=60)
    field, low = score_field(occupied, "distance"), np.array([-3, -2, 5])
    high = low + [6, 4, headings - 1]
    together = volume.score_volume(field, spec, points, LATTICE, low, high)
    for k in range(headings):
        step = np.array([0, 0, k])
        alone = volume.window_scores(
            field, spec, points, LATTICE, np.array([[0, 0, 5]]) + step, Window(2, 0)
        ).reshape(5, 5)
        np.testing.assert_array_equal(together[k, :, 1:6], alone)


@given(st.integers(0, 10_000), st.sampled_from(["occupied", "distance"]))
def test_field_updated_around_a_change_is_the_field_computed_anew(seed, kind):
    rng = np.random.default_rng(seed)
    before = rng.random((30, 40)) < 0.02
    (y0, y1), (x0, x1) = np.sort(rng.integers(0, 31, 2)), np.sort(rng.integers(0, 41, 2))
    after = before.copy()
    after[y0:y1, x0:x1] = rng.random((y1 - y0, x1 - x0)) < 0.1
    field = score_field(before, kind)
    log_odds = np.where(after, 1.0, -1.0)
    renew_field(field, log_odds, np.s_[int(y0) : int(y1), int(x0) : int(x1)])
    np.testing.assert_array_equal(field.values, score_field(after, kind).values)


def test_sums_of_the_longest_scan_stay_exact_in_float32():
    # The largest sum that a scan of 16777 beams can reach is still a float32 whole number with a neighbour
    # one away.
    beams = 16_777
    full = ScoreField(np.full((1, 1), 1000, dtype=np.float32), "distance")
    found = search(
        full,
        GridSpec((-0.5, -0.5), 1.0, (1, 1)),
        np.zeros((beams, 2)),
        np.zeros((1, 3)),
        Lattice(1.0, 0.1),
        Window(0, 0),
    )
    assert int(next(iter(found)).scores[0, 0]) == beams * full.top < 2**24
