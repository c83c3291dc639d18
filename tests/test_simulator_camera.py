"""Rendered images against the formulas of the report, the LiDAR's building and the painted floor."""

from dataclasses import replace

import numpy as np
import pytest
from drives import simulated
from rooms import distance_to_walls

from pfslam.grid import GridSpec
from pfslam.poses import rotation_matrix, transform_points
from pfslam.sensors import RgbdModel
from pfslam.simulator import HALL
from pfslam.simulator.camera import FARTHEST, NEAREST, NO_READING, depth_pinhole, rgb_pinhole
from pfslam.simulator.clocks import START_OF_TIME
from pfslam.simulator.ground import height

U, V = np.meshgrid(np.arange(640.0), np.arange(480.0))


@pytest.fixture
def hall():
    return simulated("hall")


@pytest.fixture
def exact_hall():
    return simulated("hall", exact=True)


@pytest.fixture
def exact_ramp():
    return simulated("ramp", exact=True)


def points_w(simulation, k, depth):
    """Pixels of the k-th disparity image as points ``(480, 640, 3)`` in the world, step by step by the report."""
    t = simulation.recording.camera.disparity_t[k : k + 1] - START_OF_TIME
    pose, z, pitch, roll = simulation.drive.at(t)
    x, y = (U - 315.83800193) / 585.05108211, (V - 242.94140713) / 585.05108211
    points_o = np.stack([x, y, np.ones_like(x)], axis=-1) * depth[..., None]
    points_c = np.stack([points_o[..., 2], -points_o[..., 0], -points_o[..., 1]], axis=-1)
    points_b = points_c @ rotation_matrix(pitch=np.deg2rad(18.0)).T + [0.16766, 0.0, 0.38001]
    return points_b @ rotation_matrix(roll[0], pitch[0], pose[0, 2]).T + [pose[0, 0], pose[0, 1], z[0]]


# --- the two cameras --------------------------------------------------------------------------------


def test_a_point_in_both_images_is_where_equation_16_says():
    rng = np.random.default_rng(0)
    X, Y, Z = rng.uniform(-1, 1, 50), rng.uniform(-1, 1, 50), rng.uniform(0.5, 8, 50)
    depth, colour = depth_pinhole(RgbdModel()), rgb_pinhole(RgbdModel())
    u, v = (depth.focal[i] * P / Z + depth.centre[i] for i, P in enumerate((X, Y)))
    dd = 1.03 / Z
    u_rgb = (526.37 * u + (-4.5 * 1750.46) * dd + 19276.0) / 585.051
    v_rgb = (526.37 * v + 16662.0) / 585.051
    seen = [colour.focal[i] * (P - colour.position_o[i]) / Z + colour.centre[i] for i, P in enumerate((X, Y))]
    np.testing.assert_allclose(seen, [u_rgb, v_rgb], atol=1e-9)


# --- disparity --------------------------------------------------------------------------------------


def test_floor_depth_is_the_plane_equation(exact_hall):
    """On a level floor every row has one depth: height over the slope of its ray below the horizon."""
    depth = exact_hall.renderer.true_depth(900)
    below = np.arctan((np.arange(480) - 242.94140713) / 585.05108211) + np.deg2rad(18.0)
    with np.errstate(divide="ignore"):
        along = np.where(below > 0, 0.38001 / np.sin(np.maximum(below, 1e-9)), np.inf)
    plane = along * np.cos(below - np.deg2rad(18.0))
    assert (depth <= plane[:, None] * (1 + 1e-5)).all()  # a wall can only be nearer
    floor = np.isclose(depth, plane[:, None], rtol=1e-5)
    assert floor.mean() > 0.5
    assert floor[479].all()


def test_disparity_is_depth_rounded_to_whole_counts(exact_hall):
    disparity = exact_hall.recording.camera.read_disparity(900)
    read = disparity != NO_READING
    dd = 1.03 / exact_hall.renderer.true_depth(900)[read]
    assert disparity.dtype == np.uint16
    assert disparity.shape == (480, 640)
    np.testing.assert_allclose(disparity[read], (3.31 - dd) / 0.00304, atol=0.501)


def test_no_reading_where_it_is_too_near_or_too_far(exact_hall):
    for k in (300, 900, 1500):
        depth, disparity = exact_hall.renderer.true_depth(k), exact_hall.recording.camera.read_disparity(k)
        outside = (depth < NEAREST) | (depth > FARTHEST)
        np.testing.assert_array_equal(disparity == NO_READING, outside)
        assert disparity[~outside].max() < 1089


def test_disparity_noise_and_holes_have_their_size(hall, exact_hall):
    k = 40
    noisy, depth = hall.recording.camera.read_disparity(k), hall.renderer.true_depth(k)
    inside = (depth > 0.51) & (depth < 8.5)
    assert (noisy[inside] == NO_READING).mean() == pytest.approx(HALL.missing_disparity, rel=0.1)
    good = inside & (noisy != NO_READING)
    error = noisy[good] - (3.31 - 1.03 / depth[good]) / 0.00304
    assert error.std() == pytest.approx(
        np.sqrt(0.5**2 + 1 / 12), rel=0.02
    )  # noise, and rounding to whole counts


# --- geometry: one building for camera and LiDAR ----------------------------------------------------


@pytest.mark.parametrize("k", [200, 1200])
def test_back_projected_pixels_lie_on_floor_or_walls(exact_hall, k):
    points = points_w(exact_hall, k, exact_hall.renderer.true_depth(k))
    near = exact_hall.renderer.true_depth(k) < 6.0
    floor = np.abs(points[..., 2]) < 1e-4
    assert (floor & near).mean() > 0.3
    walls = points[near & ~floor][::97, :2]
    # The table of azimuths has steps of 0.05 deg: 3 mm at 6 m, more along a wall seen at a low angle.
    assert np.median(distance_to_walls(walls, exact_hall.world.walls_w)) < 1e-3
    assert (distance_to_walls(walls, exact_hall.world.walls_w) < 0.02).mean() > 0.97


def test_back_projected_pixels_lie_on_the_slopes(exact_ramp):
    world, camera = exact_ramp.world, exact_ramp.recording.camera
    _, _, pitch, _ = exact_ramp.drive.at(camera.disparity_t - START_OF_TIME)
    climbing = np.flatnonzero(np.abs(pitch) > np.deg2rad(7))
    for k in climbing[:: len(climbing) // 6]:
        depth = exact_ramp.renderer.true_depth(k)
        points = points_w(exact_ramp, k, depth)
        plan = transform_points(world.pose_pw, points[..., :2].reshape(-1, 2)).reshape(480, 640, 2)
        ground = np.abs(points[..., 2] - height(world.slopes, plan)) < 2e-3
        near = depth < 4.0
        assert ground[470].mean() > 0.9
        others = points[near & ~ground][::97, :2]
        if len(others):
            assert (distance_to_walls(others, world.walls_w) < 0.02).mean() > 0.95


def test_camera_and_lidar_see_the_same_wall(exact_hall):
    """The camera's wall points, looked up by bearing from the LiDAR, stand where the LiDAR's beams end."""
    k = 700
    t = exact_hall.recording.camera.disparity_t[k]
    scan = np.argmin(np.abs(exact_hall.recording.lidar.t - t))
    points = points_w(exact_hall, k, exact_hall.renderer.true_depth(k))
    pose = exact_hall.recording.truth.poses[scan]
    lidar = exact_hall.recording.robot.lidar
    # Points at the LiDAR's height: only then do both look at the same place.
    level = (np.abs(points[..., 2] - lidar.position_b[2]) < 0.01) & (exact_hall.renderer.true_depth(k) < 8.0)
    assert level.sum() > 200
    seen_b = transform_points(np.array([*(-pose[:2]), 0.0]), points[level][:, :2])
    seen_b = transform_points([0.0, 0.0, -pose[2]], seen_b) - [lidar.position_b[0], 0.0]
    beam = np.rint((np.arctan2(seen_b[:, 1], seen_b[:, 0]) - lidar.angle_min) / lidar.increment).astype(int)
    difference = np.hypot(*seen_b.T) - exact_hall.recording.lidar.ranges[scan, beam]
    assert np.median(np.abs(difference)) < 0.05  # up to 12 ms and 0.4 degrees apart


# --- colour -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [60, 1300])
def test_floor_pixels_carry_the_floors_colour(exact_hall, k):
    """By Eq. 16 from a disparity pixel to its colour, by Eq. 17 and 18 to the floor: the same paint."""
    camera = exact_hall.recording.camera
    j = int(np.argmin(np.abs(camera.rgb_t - camera.disparity_t[k])))
    rgb_t = exact_hall.renderer.rgb_t.copy()
    rgb_t[j] = camera.disparity_t[k] - START_OF_TIME  # so that both images show one moment
    moved = replace(exact_hall.renderer, rgb_t=rgb_t)
    depth = exact_hall.renderer.true_depth(k)
    points = points_w(exact_hall, k, depth)
    u = np.rint((526.37 * U - 4.5 * 1750.46 * 1.03 / depth + 19276.0) / 585.051).astype(int)
    v = np.rint((526.37 * V + 16662.0) / 585.051).astype(int)
    floor = (np.abs(points[..., 2]) < 1e-4) & (depth < 2.0) & (u >= 0) & (u < 640) & (v >= 0) & (v < 480)
    shown = moved.read_rgb(j)[v[floor], u[floor]].astype(float)
    spec = GridSpec.around(points[floor][:, :2], 0.01)
    cells = spec.world_to_cell(points[floor][:, :2])
    painted = exact_hall.floor_image(spec)[cells[:, 1], cells[:, 0]].astype(float)
    error = np.abs(shown - painted).mean(axis=1)
    assert floor.sum() > 50_000
    assert np.median(error) < 5.0  # colour noise of 2, a pixel's and a cell's rounding
    assert (error < 25.0).mean() > 0.95
    assert np.corrcoef(shown.ravel(), painted.ravel())[0, 1] > 0.95


def test_the_rooms_have_floors_of_their_own(hall):
    spec = hall.world.spec(0.05)
    picture, plan = hall.floor_image(spec).astype(float), hall.world.plan
    means = []
    for kind in ("room", "corridor", "lobby", "hall"):
        x0, y0, x1, y1 = plan.areas[plan.kinds.index(kind)]
        middle = transform_points(hall.world.pose_wp, [[0.5 * (x0 + x1), 0.5 * (y0 + y1)]])
        ix, iy = spec.world_to_cell(middle)[0]
        means.append(picture[iy - 10 : iy + 10, ix - 10 : ix + 10].mean(axis=(0, 1)))
    colours = np.array(means)
    apart = np.linalg.norm(colours[:, None] - colours, axis=-1)[np.triu_indices(4, 1)]
    assert apart.min() > 20.0


# --- reading on demand ------------------------------------------------------------------------------


def test_an_image_is_the_same_whenever_it_is_read(hall):
    camera = hall.recording.camera
    first = camera.read_disparity(1000)
    camera.read_disparity(3)
    camera.read_rgb(1000)
    np.testing.assert_array_equal(first, camera.read_disparity(1000))
    again = simulated.__wrapped__("hall").recording.camera
    np.testing.assert_array_equal(again.read_disparity(1000), first)
    assert not np.array_equal(first, camera.read_disparity(1001))


def test_the_camera_outlives_the_encoders_and_stands_still(exact_hall):
    """Set 20's camera runs on for a second after the encoders end."""
    recording = exact_hall.recording
    late = recording.camera.disparity_t > recording.encoders.t[-1] + 0.5
    assert late.any()
    last = exact_hall.renderer.true_depth(int(np.argmax(late)))
    np.testing.assert_array_equal(last, exact_hall.renderer.true_depth(len(late) - 1))
