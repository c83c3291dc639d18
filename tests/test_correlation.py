"""The fast search gives the integers of the definition, everywhere and for every cloud."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pfslam.correlation import OccupiedCells, map_correlation
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.poses import transform_points
from pfslam.refined.field import TOP, renew_field, score_field
from pfslam.search import volume
from pfslam.search.lattice import Lattice, Window
from pfslam.search.volume import search

SPEC = GridSpec((-1.0, -2.0), 0.5, (8, 6))


def test_definition_counts_points_on_occupied_cells():
    occupied = np.zeros((8, 6), dtype=bool)
    occupied[3, 1] = occupied[7, 5] = True  # x in [-0.5, 0), y in [-0.5, 0); and the last cell, to (2, 2)
    points = [[-0.5, -0.5], [-0.01, -0.01], [0.0, -0.25], [-0.25, 0.0], [1.9, 1.9], [-0.4, -0.4]]
    score = map_correlation(occupied, SPEC, np.array(points))
    assert score == 4  # two points of one cell count twice
    assert isinstance(score, int)
    outside = np.array([[-1.01, 0.0], [2.0, 0.0], [0.0, -2.01], [0.0, 2.0], [-700.0, 900.0]])
    assert map_correlation(np.ones((8, 6), dtype=bool), SPEC, outside) == 0
    assert map_correlation(np.ones((8, 6), dtype=bool), SPEC, np.zeros((0, 2))) == 0


def by_definition(occupied, spec, points_b, node, lattice, window):
    """Scores of the window around a node, one pose after another through the definition."""
    poses = lattice.pose(node + window.steps())
    return [map_correlation(occupied, spec, transform_points(pose, points_b)) for pose in poses]


def assert_search_is_the_definition(occupied, spec, points_b, poses, lattice, window):
    cells, seen = OccupiedCells(OccupancyGrid(spec, np.where(occupied, 1.0, -1.0))), []
    for found in search(cells, spec, points_b, poses, lattice, window):
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
CASES = {
    "compact": {},
    "one beam": {"beams": 1, "spread": (0.1, 0.1, 0.1)},
    "one node": {"spread": (0, 0, 0), "window": Window(0, 0)},
    "unequal window": {"window": Window(3, 1)},
    "the report's": {"window": Window(4, 4), "lattice": Lattice(0.05, 0.005), "particles": 2},
    "right edge": {"centres": [(1.0, 0.0, 1.0)]},
    "lower edge": {"centres": [(0.0, -0.9, 1.0)]},
    "beyond": {"centres": [(50.0, -80.0, 1.0)]},
    "both sides of pi": {"centres": [(0, 0, np.pi), (0, 0, -np.pi)], "lattice": Lattice(0.05, 0.0073)},
    "wide": {"spread": (0.3, 0.3, 0.5), "particles": 8},
    "rooms apart": {"centres": [(-2, -2, -3.0), (2, 2, 0.0), (2.5, -2, 1.5)], "cells": (120, 140)},
}


@pytest.mark.parametrize("way", ["tiles", "small tiles", "little memory"])
@pytest.mark.parametrize("case", CASES)
def test_search_gives_the_integers_of_the_definition(monkeypatch, case, way):
    monkeypatch.setattr(volume, "TILE", 1 if way == "small tiles" else volume.TILE)
    if way == "little memory":
        for name, value in (("MAX_SCORES", 2 * 5**3), ("CHUNK", 2 * 5**3), ("CACHE", 40)):
            monkeypatch.setattr(volume, name, value)
    what = {"spread": (0.1, 0.1, 0.03), "centres": [(0, 0, 0)], "lattice": LATTICE, "window": WINDOW}
    what |= {"beams": 25, "cells": (30, 40), "particles": 4} | CASES[case]
    rng, occupied, spec, points = random_case(list(CASES).index(case), what["beams"], what["cells"])
    points = np.concatenate([points, points[:5]])  # some cells count twice
    poses = np.repeat(np.array(what["centres"], float), what["particles"], axis=0)
    poses += rng.normal(0.0, what["spread"], poses.shape)
    poses[-1] = poses[0]  # two particles at one place
    assert_search_is_the_definition(occupied, spec, points, poses, what["lattice"], what["window"])


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
    field = score_field(occupied)
    np.testing.assert_array_equal(field, field_by_brute_force(occupied))
    assert field.dtype == np.float32


@given(st.integers(0, 10_000))
def test_field_updated_around_a_change_is_the_field_computed_anew(seed):
    rng = np.random.default_rng(seed)
    before = rng.random((30, 40)) < 0.02
    (y0, y1), (x0, x1) = np.sort(rng.integers(0, 31, 2)), np.sort(rng.integers(0, 41, 2))
    after = before.copy()
    after[y0:y1, x0:x1] = rng.random((y1 - y0, x1 - x0)) < 0.1
    field = score_field(before)
    log_odds = np.where(after, 1.0, -1.0)
    renew_field(field, log_odds, np.s_[int(y0) : int(y1), int(x0) : int(x1)])
    np.testing.assert_array_equal(field, score_field(after))


def test_sums_of_the_longest_scan_stay_exact_in_float32():
    # The largest sum that a scan of 16777 beams can reach is still a float32 whole number with a neighbour
    # one away.
    beams = 16_777
    field, spec = np.full((1, 1), TOP, dtype=np.float32), GridSpec((-0.5, -0.5), 1.0, (1, 1))
    found = search(field, spec, np.zeros((beams, 2)), np.zeros((1, 3)), Lattice(1.0, 0.1), Window(0, 0))
    assert int(next(iter(found)).scores[0, 0]) == beams * TOP < 2**24
