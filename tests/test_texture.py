"""The texture map against a floor whose every tile has its own colour, seen by an analytic camera."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from floor_oracle import TILE, colour_image, disparity_image, tile_colour

from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.poses import Trajectory
from pfslam.recording import Recording, RgbdStream
from pfslam.refined.floor import EMPTY, PixelRays, camera_from_floor, floor_pixels, map_texture, posed_pairs
from pfslam.sensors import RgbdModel, RobotModel
from pfslam.texture import TextureConfig, colour_code, paint, project_floor, view_code

REPORT = TextureConfig.report()
REFINED = TextureConfig.refined()
NEAR = replace(REFINED, z_max=4.0)  # where one step of disparity moves a point by less than a cell
SPEC = GridSpec((-1.0, -3.0), 0.05, (120, 140))


def stream(t_disparity, t_rgb, read_disparity, read_rgb):
    every = np.arange(len(t_disparity)), np.arange(len(t_rgb))
    return RgbdStream(np.array(t_disparity, float), np.array(t_rgb, float), read_disparity, read_rgb, *every)


@cache
def disparity_at(pose, **floor):
    return disparity_image(pose, **floor)


@cache
def colours_at(pose):
    return colour_image(pose)


def drive(poses, rgb_delay=0.0, dt=0.1, robot=None, **floor):
    """The tiled floor, recorded every ``dt`` with the colour ``rgb_delay`` later, and the truth."""
    poses = np.array(poses, float)
    t = dt * np.arange(len(poses))
    truth = Trajectory(t, poses)
    t_image = t[:-1] if rgb_delay else t
    camera = stream(
        t_image,
        t_image + rgb_delay,
        lambda k: disparity_at(tuple(truth.at(t_image[k])), **floor),
        lambda k: colours_at(tuple(truth.at(t_image[k] + rgb_delay))),
    )
    return Recording("tiles", robot or RobotModel(), odometry=truth, camera=camera), truth


def share_of_right_colour(texture):
    """The share of seen cells with their tile's own colour; cells at the edge of a tile are left out."""
    iy, ix = np.nonzero(texture.seen)
    centre = texture.spec.cell_to_world(np.column_stack([ix, iy]))
    right = (texture.rgb[iy, ix] == tile_colour(centre[:, 0], centre[:, 1])).all(axis=1)
    to_edge = np.abs((centre / TILE + 0.5) % 1.0 - 0.5).min(axis=1) * TILE
    return right[to_edge > 0.05].mean()


STANDING = [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
WALKING = [(0.05 * k, 0.01 * k, 0.05 * k) for k in range(8)]


# The definition (Eq. 4) and the fast path


@pytest.mark.parametrize("config", [REPORT, replace(REPORT, floor_tolerance=0.015, tolerance_per_metre=0.01)])
def test_a_whole_image_gives_what_the_definition_gives(config):
    pose, camera = np.array([0.3, -0.2, 0.4]), RgbdModel()
    rng = np.random.default_rng(0)
    disparity = disparity_image(pose)
    noisy = rng.random(disparity.shape) < 0.2
    disparity[noisy] = rng.integers(0, 2048, noisy.sum())
    v, u = np.indices(disparity.shape).reshape(2, -1)
    want = project_floor(u, v, disparity.ravel(), pose, camera, SPEC, config)
    got = floor_pixels(disparity, PixelRays.of(camera, config, 0.001), pose, pose, SPEC, config)
    assert len(want.depth) > 50_000
    assert len(got.depth) == pytest.approx(len(want.depth), abs=20)  # single precision at the edge
    if len(got.depth) == len(want.depth):
        np.testing.assert_allclose(got.points_w, want.points_w, atol=1e-5)
        np.testing.assert_allclose(got.u_rgb, want.u_rgb)
        np.testing.assert_allclose(got.v_rgb, want.v_rgb)


def test_leaving_out_columns_leaves_out_no_cell():
    pose, camera = np.array([0.3, -0.2, 0.4]), RgbdModel()
    disparity = disparity_image(pose)
    all_columns, some = PixelRays.of(camera, REFINED, 0.001), PixelRays.of(camera, REFINED, 0.05)
    assert (all_columns.column_step, some.column_step) == (1, 2)
    every = floor_pixels(disparity, all_columns, pose, pose, SPEC, REFINED)
    chosen = floor_pixels(disparity, some, pose, pose, SPEC, REFINED)
    assert len(chosen.depth) < 0.51 * len(every.depth)
    # Nearer than 2 m the rows are less than half a cell apart too. At the rim a cell may show but a corner.
    near = set(map(tuple, every.cells[every.depth < 2.0].tolist()))
    inner = {(x, y) for x, y in near if {(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)} <= near}
    assert len(inner) > 500
    assert inner <= set(map(tuple, chosen.cells.tolist()))


# Step 6


@pytest.mark.parametrize(("view", "kept"), [("last", 5), ("best", 3)])
def test_the_last_view_of_a_cell_stays_or_the_best_and_what_lies_outside_is_counted(view, kept):
    cells = np.array([[1, 0], [-1, 0], [1, 0], [2, 1], [0, -1], [1, 0], [3, 0], [0, 2]])
    canvas = np.full((2, 3), EMPTY)
    assert paint(canvas, cells, np.array([7, 1, 3, 9, 1, 5, 1, 1]), view) == 4
    assert canvas.tolist() == [[EMPTY, kept, EMPTY], [EMPTY, EMPTY, 9]]


def test_a_nearer_view_beats_a_better_placed_one_and_that_beats_a_darker_one():
    centre, corner = SPEC.cell_to_world([[4, 4]]), SPEC.cell_to_world([[4, 4]]) + 0.02
    black, white = np.zeros((1, 3), np.uint8), np.full((1, 3), 255, np.uint8)
    far_centre = view_code(black, np.array([2.0]), centre, SPEC)
    near_corner = view_code(white, np.array([0.75]), corner, SPEC)
    near_centre = view_code(white, np.array([0.76]), centre, SPEC)
    assert near_centre < near_corner < far_centre < EMPTY
    assert view_code(black, np.array([0.75]), corner, SPEC) < near_corner
    assert colour_code(np.array([1, 2, 3], np.uint8)) == 0x010203


# Whole drives


@pytest.mark.parametrize("config", [replace(REPORT, z_max=2.0), NEAR])
def test_every_tile_gets_its_own_colour(config):
    recording, truth = drive(WALKING)
    texture = map_texture(recording, truth, config=config)
    assert texture.pairs == len(WALKING)
    assert texture.seen.sum() > 1000
    assert share_of_right_colour(texture) > 0.99


def test_a_pose_for_each_image_repairs_the_delay_of_the_colour_camera():
    turning = [(0.0, 0.0, 0.1 * k) for k in range(6)]
    recording, truth = drive(turning, rgb_delay=0.05)
    with_own = map_texture(recording, truth, config=NEAR)
    one_pose = map_texture(recording, truth, config=replace(NEAR, states="nearest"))
    assert share_of_right_colour(with_own) > 0.99
    assert share_of_right_colour(one_pose) < 0.9


def test_a_wrong_camera_pitch_empties_the_reports_map_and_not_the_refined_one():
    sheet = RobotModel(camera=replace(RgbdModel(), pitch=0.36, position_b=(0.16766, 0.0, 0.36)))
    recording, truth = drive(WALKING, robot=sheet)
    report = map_texture(recording, truth, config=REPORT)
    refined = map_texture(recording, truth, config=REFINED)
    assert report.seen.sum() < 0.1 * refined.seen.sum()
    assert refined.camera.pitch == pytest.approx(RgbdModel().pitch, abs=np.deg2rad(0.1))
    assert refined.camera.position_b[2] == pytest.approx(0.38001, abs=0.002)
    assert share_of_right_colour(refined) > 0.98


def test_a_rising_floor_is_found_by_its_plane():
    slope = np.tan(np.deg2rad(6.0))
    recording, truth = drive(STANDING, slope=slope)
    level = map_texture(recording, truth, config=REPORT)
    refined = map_texture(recording, truth, config=REFINED)
    assert level.seen.sum() < 0.1 * refined.seen.sum()
    assert refined.seen.sum() > 500


def test_one_image_of_a_ramp_does_not_turn_the_camera():
    def read(k):
        return disparity_image((0, 0, 0), slope=0.1 if k == 0 else 0.0)

    t = np.arange(5.0)
    camera = camera_from_floor(stream(t, t, read, None), np.arange(5), RgbdModel(), REFINED)
    assert camera.pitch == pytest.approx(RgbdModel().pitch, abs=np.deg2rad(0.1))


# What is left out is counted

CLOCK = 0.1 * np.arange(11)


@pytest.mark.parametrize(
    ("times", "states", "config", "kept", "x", "dropped"),
    [
        (
            ([0.0, 1.0, 2.0], [0.01, 1.01, 2.01, 3.01]),
            [0.0, 0.5, 1.0, 1.5],
            REFINED,
            [0, 1],
            [0.0, 2.0],
            {"pairs: no partner in time": 1, "pairs: outside the trajectory": 1},
        ),
        (
            ([0.0, 2.0, 4.0], [0.0, 2.0, 4.0]),
            [0.0, 0.1, 3.9, 4.0],  # a hole is not bridged
            REFINED,
            [0, 2],
            [0.0, 3.0],
            {"pairs: no state near in time": 1},
        ),
        # In the report a state takes its nearest pair, and that pair's time is the state's.
        (
            (CLOCK, CLOCK),
            [0.0, 0.52, 1.0],
            REPORT,
            [0, 5, 10],
            [0.0, 1.0, 2.0],
            {"pairs: no state of their own": 8},
        ),
    ],
)
def test_pairs_without_partner_or_state_are_counted(times, states, config, kept, x, dropped):
    way = np.column_stack([np.arange(len(states)), np.zeros((len(states), 2))])
    pairs = posed_pairs(stream(*times, None, None), Trajectory(states, way), config)
    assert pairs.disparity.tolist() == kept
    assert pairs.pose_disparity[:, 0].tolist() == x
    assert pairs.dropped == dropped


def test_a_grid_that_is_too_small_is_filled_and_the_rest_counted():
    recording, truth = drive(STANDING)
    spec = GridSpec((0.0, 0.0), 0.05, (20, 20))
    texture = map_texture(recording, truth, OccupancyGrid.empty(spec), replace(REFINED, crop=False))
    assert texture.spec == spec
    assert texture.dropped["points: outside the grid"] > 0
    assert share_of_right_colour(texture) > 0.99


def test_cropping_keeps_only_what_the_map_knows():
    recording, truth = drive(STANDING)
    log_odds = np.zeros(SPEC.shape, np.float32)
    log_odds[:60] = -1.0
    grid = OccupancyGrid(SPEC, log_odds)
    whole = map_texture(recording, truth, grid, replace(REFINED, crop=False))
    cropped = map_texture(recording, truth, grid)
    assert (cropped.seen == whole.seen & (log_odds != 0)).all()
    assert cropped.dropped["cells: outside the map"] == np.count_nonzero(whole.seen[60:])
    assert whole.seen[60:].any()


# Bad input
