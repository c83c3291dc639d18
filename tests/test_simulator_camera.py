"""Rendered images against the formulas of the report, the LiDAR's building and the painted floor."""

from dataclasses import replace

import numpy as np
import pytest
from drives import simulated
from rooms import distance_to_walls

from pfslam.grid import GridSpec
from pfslam.poses import rotation_matrix, transform_points
from pfslam.simulator import HALL
from pfslam.simulator.camera import FARTHEST, NEAREST, NO_READING
from pfslam.simulator.clocks import START_OF_TIME
from pfslam.simulator.ground import height

U, V = np.meshgrid(np.arange(640.0), np.arange(480.0))


@pytest.fixture
def hall():
    return simulated("hall")


@pytest.fixture
def exact_hall():
    return simulated("hall", exact=True)


def points_w(simulation, k, depth):
    """Pixels of the k-th disparity image as points ``(480, 640, 3)`` in the world, step by step by the report."""
    t = simulation.recording.camera.disparity_t[k : k + 1] - START_OF_TIME
    pose, z, pitch, roll = simulation.drive.at(t)
    x, y = (U - 315.83800193) / 585.05108211, (V - 242.94140713) / 585.05108211
    points_o = np.stack([x, y, np.ones_like(x)], axis=-1) * depth[..., None]
    points_c = np.stack([points_o[..., 2], -points_o[..., 0], -points_o[..., 1]], axis=-1)
    points_b = points_c @ rotation_matrix(pitch=np.deg2rad(18.0)).T + [0.16766, 0.0, 0.38001]
    return points_b @ rotation_matrix(roll[0], pitch[0], pose[0, 2]).T + [pose[0, 0], pose[0, 1], z[0]]


# --- disparity --------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [300, 900, 1500])
def test_disparity_is_depth_in_whole_counts_and_nothing_where_it_is_too_near_or_too_far(exact_hall, k):
    depth, disparity = exact_hall.renderer.true_depth(k), exact_hall.recording.camera.read_disparity(k)
    assert (disparity.dtype, disparity.shape) == (np.uint16, (480, 640))
    outside = (depth < NEAREST) | (depth > FARTHEST)
    np.testing.assert_array_equal(disparity == NO_READING, outside)
    np.testing.assert_allclose(disparity[~outside], (3.31 - 1.03 / depth[~outside]) / 0.00304, atol=0.501)


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


@pytest.mark.parametrize("name", ["hall", "ramp"])
def test_back_projected_pixels_lie_on_the_ground_or_the_walls(name):
    exact = simulated(name, exact=True)
    world, tilt = exact.world, np.abs(exact.drive.at(exact.renderer.disparity_t)[2])
    some = np.array([200, 1200]) if name == "hall" else np.flatnonzero(tilt > np.deg2rad(7))
    for k in some[:: -(-len(some) // 7)]:
        depth = exact.renderer.true_depth(k)
        points = points_w(exact, k, depth)
        plan = transform_points(world.pose_pw, points[..., :2].reshape(-1, 2)).reshape(480, 640, 2)
        ground = np.abs(points[..., 2] - height(world.slopes, plan)) < 2e-3
        assert ground[470].mean() > 0.9
        # The table of azimuths has steps of 0.05 deg: 3 mm at 6 m, more along a wall seen at a low angle.
        off = distance_to_walls(points[(depth < 4.0) & ~ground][::97, :2], world.walls_w)
        assert not len(off) or (off < 0.02).mean() > 0.95


def test_who_walks_ahead_of_the_robot_is_in_the_picture():
    simulation = simulated("hall", exact=True, people=6)
    t, person = simulation.renderer.disparity_t, simulation.world.people[0]
    k = int(np.searchsorted(t, np.mean(person.t[[0, -1]])))
    depth = simulation.renderer.true_depth(k)
    centre = transform_points(simulation.world.pose_wp, person.at(t[k : k + 1]))
    off = np.abs(
        np.hypot(*np.moveaxis(points_w(simulation, k, depth)[..., :2] - centre[0], -1, 0)) - person.radius
    )
    assert np.count_nonzero((off < 0.01) & (depth < 3.0)) > 5000


# --- colour -----------------------------------------------------------------------------------------


@pytest.mark.slow
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


# --- reading on demand ------------------------------------------------------------------------------


@pytest.mark.slow
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
