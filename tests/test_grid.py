"""Cells, rays and log-odds: floor arithmetic, scalar Bresenham, and scans of hand-made rooms."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rooms import LIDAR, ROOM, box, scan, sensor_position

from pfslam.errors import DataError
from pfslam.grid import (
    LOG_4,
    Canvas,
    GridSpec,
    MapConfig,
    OccupancyGrid,
    free_cells,
    integrate_scan,
    log_odds,
    probability,
    trace_rays,
)
from pfslam.poses import transform_points
from pfslam.sensors import scan_points

SPEC = GridSpec((-3.0, -2.0), 0.5, (8, 12))
RAYS = ("bresenham", "polygon")


def test_world_to_cell_by_hand():
    # The outer corner of cell [0, 0] is (-3, -2); 0.75 m to the right and 3.1 m up are one and six cells on.
    np.testing.assert_array_equal(
        SPEC.world_to_cell([[-3.0, -2.0], [-2.25, 1.1], [-3.01, -2.0]]), [[0, 0], [1, 6], [-1, 0]]
    )
    np.testing.assert_allclose(SPEC.cell_to_world([[0, 0], [1, 6]]), [[-2.75, -1.75], [-2.25, 1.25]])
    assert SPEC.extent == (-3.0, 3.0, -2.0, 2.0)


@given(
    st.integers(-30, 30), st.integers(-30, 30), st.floats(0.01, 3.0), st.floats(-20, 20), st.floats(-20, 20)
)
def test_centre_of_a_cell_lies_in_it(ix, iy, resolution, x, y):
    spec = GridSpec((x, y), resolution, (5, 5))
    np.testing.assert_array_equal(spec.world_to_cell(spec.cell_to_world([ix, iy])), [ix, iy])


@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=5),
    st.sampled_from([0.05, 0.1, 0.25]),
)
def test_grid_around_points_contains_them_with_the_margin(points, resolution):
    spec = GridSpec.around(np.array(points), resolution, margin=0.5)
    for corner in (-0.49, 0.49):
        assert spec.contains(spec.world_to_cell(np.array(points) + corner)).all()
    corner_in_cells = np.array(spec.origin) / resolution
    np.testing.assert_allclose(corner_in_cells, np.rint(corner_in_cells), atol=1e-9)


@pytest.mark.parametrize(
    ("origin", "resolution", "shape", "field"),
    [
        ((0, 0), 0.0, (4, 4), "resolution"),
        ((0, 0), np.nan, (4, 4), "resolution"),
        ((0, np.inf), 0.1, (4, 4), "origin"),
        ((0, 0), 0.1, (0, 4), "shape"),
        ((0, 0), 0.001, (200_000, 200_000), "shape"),
    ],
)
def test_impossible_grids_are_refused(origin, resolution, shape, field):
    with pytest.raises(DataError, match=f"GridSpec: {field}"):
        GridSpec(origin, resolution, shape)


def test_probability_of_log_odds():
    # Eq. 14 and 15: a sensor right four times in five has odds of 4.
    assert log_odds(0.8) == pytest.approx(np.log(4)) == pytest.approx(LOG_4)
    np.testing.assert_allclose(
        probability([-np.log(4), 0.0, np.log(4), 2 * np.log(4)]), [0.2, 0.5, 0.8, 16 / 17]
    )


def bresenham(start, end):
    """The scalar textbook algorithm, the end left out: an error sum decides the step sideways."""
    (x, y), (dx, dy) = start, np.subtract(end, start)
    steep = abs(dy) > abs(dx)
    long, short = (abs(dy), abs(dx)) if steep else (abs(dx), abs(dy))
    sx, sy, cells, error = int(np.sign(dx)), int(np.sign(dy)), [], 2 * short - long
    for _ in range(long):
        cells.append((x, y))
        if error >= 0:
            x, y, error = (x + sx, y, error) if steep else (x, y + sy, error)
            error -= 2 * long
        x, y = (x, y + sy) if steep else (x + sx, y)
        error += 2 * short
    return cells


cell = st.tuples(st.integers(-20, 20), st.integers(-20, 20))


@given(cell, st.lists(cell, min_size=1, max_size=6))
def test_rays_are_bresenham_lines(start, ends):
    expected = [c for end in ends for c in bresenham(start, end)]
    np.testing.assert_array_equal(
        trace_rays(np.array(start), np.array(ends)), np.array(expected).reshape(-1, 2)
    )


def drawn(pose, walls=ROOM, config=None, lidar=LIDAR, broken=()):
    """An empty map with one noiseless scan in it; the beams in ``broken`` have no reading."""
    ranges = scan(walls, pose, lidar)
    ranges[list(broken)] = np.inf
    points = transform_points(pose, scan_points(ranges, lidar))
    beams = np.flatnonzero(lidar.valid(ranges))
    grid = OccupancyGrid.empty(GridSpec.around(points, 0.05))
    integrate_scan(grid, points, beams, sensor_position(pose, lidar), config or MapConfig())
    return grid, points, beams


def cells_of(grid, points):
    mask = np.zeros(grid.spec.shape, dtype=bool)
    ix, iy = grid.spec.world_to_cell(points).T
    mask[iy, ix] = True
    return mask


@pytest.mark.parametrize("rays", RAYS)
def test_one_scan_writes_each_cell_once_and_hits_win(rays):
    grid, points, _ = drawn((0.3, 0.2, 0.5), config=MapConfig(hit=1.5, free=0.25, clamp=9.0, rays=rays))
    hit = cells_of(grid, points)
    assert set(np.unique(grid.log_odds)) == {-0.25, 0.0, 1.5}
    np.testing.assert_array_equal(grid.log_odds == 1.5, hit)


def test_free_cells_of_the_definition_are_the_rays_less_the_hits():
    grid, points, _ = drawn((0.3, 0.2, 0.5), config=MapConfig(rays="bresenham"))
    start = tuple(int(c) for c in grid.spec.world_to_cell(sensor_position((0.3, 0.2, 0.5))))
    expected = np.zeros(grid.spec.shape, dtype=bool)
    for end in grid.spec.world_to_cell(points).tolist():
        for ix, iy in bresenham(start, end):
            expected[iy, ix] = True
    np.testing.assert_array_equal(grid.free, expected & ~cells_of(grid, points))


def distance_to(mask):
    """Distance in cells from every cell to the nearest one of ``mask``."""
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


@pytest.mark.parametrize("pose", [(0.3, 0.2, 0.5), (-1.5, -1.0, 2.0), (3.0, 1.0, -2.5)])
def test_polygon_covers_the_rays_and_nothing_beyond_what_the_beams_enclose(pose):
    walls = box(-2.03, -1.52, 4.01, 2.48)  # convex, so that the true outline of the scan is the room itself
    polygon, points, _ = drawn(pose, walls, MapConfig(rays="polygon"))
    rays = drawn(pose, walls, MapConfig(rays="bresenham"))[0]
    seen, hit = polygon.free | polygon.occupied, cells_of(polygon, points)
    # A cell of a line is at most half a cell from the line, and a filled cell likewise from the outline: one
    # cell in all.
    assert distance_to(seen)[rays.free].max() <= 1.0
    # What the polygon adds lies between neighbouring rays, whose end points are here less than three cells
    # apart.
    assert distance_to(rays.free | hit)[polygon.free].max() <= 3.0
    x, y = polygon.spec.cell_to_world(np.argwhere(polygon.free)[:, ::-1]).T
    assert -2.03 - 0.05 < x.min() <= x.max() < 4.01 + 0.05
    assert -1.52 - 0.05 < y.min() <= y.max() < 2.48 + 0.05


@pytest.mark.parametrize("rays", RAYS)
def test_beams_without_a_reading_clear_nothing(rays):
    pose, broken = (0.3, 0.2, 0.5), range(150, 211)  # a wedge of 45 degrees ahead
    grid, _, _ = drawn(pose, config=MapConfig(rays=rays), broken=broken)
    centres = grid.spec.cell_to_world(np.indices(grid.spec.shape)[::-1].transpose(1, 2, 0)) - sensor_position(
        pose
    )
    bearing = np.angle(np.exp(1j * (np.arctan2(centres[..., 1], centres[..., 0]) - pose[2])))
    # Two cells from the sides of the wedge, no cell of a neighbouring beam's line can lie.
    margin = np.hypot(*centres.transpose(2, 0, 1)) * np.sin(np.deg2rad(22.5) - np.abs(bearing)) > 0.1
    inside = (np.abs(bearing) < np.deg2rad(22.5)) & margin
    assert inside.sum() > 500
    assert not grid.log_odds[inside].any()


@pytest.mark.parametrize("clamp", [10.0, 1.25])
def test_hit_and_free_amounts_add_up_over_scans_up_to_the_clamp(clamp):
    grid = OccupancyGrid.empty(GridSpec((0.0, 0.0), 1.0, (1, 6)))
    config = MapConfig(1.0, 2.0, 0.5, clamp, "bresenham")
    for end in (5.5, 5.5, 3.5):  # two hits in cell 5 that cross cell 3, then one hit in cell 3
        integrate_scan(grid, np.array([[end, 0.5]]), np.array([0]), np.array([0.5, 0.5]), config)
    np.testing.assert_allclose(grid.log_odds, np.clip([[-1.5, -1.5, -1.5, 1.0, -1.0, 4.0]], -clamp, clamp))


def test_integrating_names_the_touched_rectangle_and_leaves_the_rest_and_copies_alone():
    pose = (0.3, 0.2, 0.5)
    grid, points, beams = drawn(pose)
    kept, before = grid.copy(), grid.log_odds.copy()
    rectangle = integrate_scan(grid, points[:40], beams[:40], sensor_position(pose), MapConfig())
    np.testing.assert_array_equal(kept.log_odds, before)
    assert (grid.log_odds != before).any()
    outside = np.ones(grid.spec.shape, dtype=bool)
    outside[rectangle] = False
    np.testing.assert_array_equal(grid.log_odds[outside], before[outside])


@given(
    st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), min_size=1, max_size=8), st.integers(0, 99)
)
def test_a_canvas_grows_like_copies_do_and_copies_little(far, seed):
    """Against arrays made anew; the cells copied in all stay below five times those of the last block."""
    rng, spec = np.random.default_rng(seed), GridSpec((-1.0, -1.0), 0.5, (4, 4))
    canvas, plain, copied = Canvas(spec, np.float32), np.zeros(spec.shape, np.float32), 0
    for point in far:
        wider = canvas.spec.covering(np.array([point]), margin=1.0)
        left, below = np.rint(np.subtract(canvas.spec.origin, wider.origin) / 0.5).astype(int)
        larger, block = np.zeros(wider.shape, np.float32), canvas.block
        larger[below : below + plain.shape[0], left : left + plain.shape[1]] = plain
        canvas.cover(wider)
        copied += 0 if canvas.block is block else plain.size
        plain = larger
        iy, ix = (int(rng.integers(n)) for n in plain.shape)
        plain[iy, ix] = canvas.values[iy, ix] = rng.random()
        np.testing.assert_array_equal(canvas.values, plain)
        np.testing.assert_array_equal(canvas.block.ravel()[canvas.flat(np.array([ix, iy]))], plain[iy, ix])
    assert copied <= 5 * canvas.block.size
    np.testing.assert_array_equal(canvas.copy().values, plain)


@pytest.mark.parametrize(
    ("point", "side"), [((-3.1, 0.0), 0), ((3.1, 0.0), 1), ((0.0, -2.1), 2), ((0.0, 2.1), 3)]
)
def test_a_grid_grows_by_at_least_the_margin_beyond_the_point_and_not_elsewhere(point, side):
    """A margin of 0.7 m is 1.4 cells of half a metre: two more than the cell that the point falls into."""
    grown = SPEC.covering(np.array([point]), margin=0.7).extent
    growth = np.abs(np.array(grown) - SPEC.extent)
    np.testing.assert_allclose(growth, np.where(np.arange(4) == side, 1.5, 0.0), atol=1e-12)


def free(beams):
    """What a scan of two beams, ten metres away and 45 degrees apart, saw through; cells of 1 m."""
    spec = GridSpec((0.0, 0.0), 1.0, (12, 12))
    ends = np.array([[10.5, 0.5], [10.5, 10.5]])
    return free_cells(spec, ends, np.array(beams), np.array([0.5, 0.5]), "polygon")[0]


def test_what_lies_between_two_neighbouring_beams_is_free_and_a_single_missing_beam_tells_nothing():
    assert free([4, 5])[4, 8] == 1
    assert free([4, 6])[4, 8] == 0
    assert free([4, 6])[0, 5] == 1  # along the beams themselves
