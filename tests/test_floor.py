"""From a depth image to floor points: hand values, OpenCV as an oracle, planes with a known tilt."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from floor_oracle import camera_axes, depth_step, disparity_image, nearest_floor

from pfslam.refined.floor import fit_floor_plane, level_camera
from pfslam.sensors import RgbdModel
from pfslam.texture import (
    associate_rgb,
    back_project,
    depth_from_disparity,
    depth_mask,
    disparity_from_depth,
    disparity_from_depth_image,
    floor_mask,
    to_world,
)

CAMERA = RgbdModel()


# Disparity and depth (the depth of Eq. 17)


def test_depth_of_a_disparity_by_hand_none_where_there_is_no_reading_and_back():
    disparity = np.array([750, 1000, 500, 1089, 1090, 2047, 65535, np.nan])
    depth = depth_from_disparity(disparity, CAMERA)
    assert depth == pytest.approx([1.0, 1.03 / 0.27, 1.03 / 1.79, *[np.nan] * 5], rel=1e-12, nan_ok=True)
    assert disparity_from_depth(depth[:3], CAMERA) == pytest.approx(disparity[:3])


def test_the_masks_are_closed_and_leave_nan_out():
    depth = np.array([0.09, 0.1, 5.0, 10.0, 10.01, np.nan, np.inf])
    assert depth_mask(depth, 0.1, 10.0).tolist() == [False, True, True, True, False, False, False]
    points = np.array([[1, 0, 0.01], [1, 0, -0.0101], [3, 0, 0.035], [1, 0, np.nan]])
    assert floor_mask(points, 0.01).tolist() == [True, False, False, False]
    assert floor_mask(points, 0.01, 0.01, distance=points[:, 0]).tolist() == [True, True, True, False]


@pytest.mark.parametrize(
    ("camera", "depths"),
    [
        (CAMERA, (0.6, 1.0, 4.0)),
        (RgbdModel.registered(640, 480, CAMERA.K, CAMERA.T_bo), (0.16, 1.0, 9.0, 1e4 / 2047)),
    ],
)
def test_an_image_of_depths_comes_back_within_half_a_step_and_nothing_stays_nothing(camera, depths):
    nothing = [0.0, -1.0, np.nan, np.inf, 0.01 if camera is not CAMERA else 0.2]
    image = disparity_from_depth_image(np.array([[*depths, *nothing]]), camera)
    found = depth_from_disparity(image, camera)[0]
    step = [max(depth_step(depth, camera), 1e-3) for depth in depths]
    assert image.dtype == np.uint16
    assert (np.abs(found[: len(depths)] - depths) <= step).all()
    assert np.isnan(found[len(depths) :]).all()


# Eq. 16 to 18


def test_opencv_projects_back_projected_points_onto_their_pixels_in_both_cameras():
    """By Eq. 16 the colour camera is a second pinhole, 26 mm to the side."""
    v, u = np.indices((480, 640)).reshape(2, -1)[:, ::97]
    depth = np.random.default_rng(1).uniform(0.4, 8.0, len(u))
    points = back_project(u, v, depth, CAMERA.K)
    colour = associate_rgb(u, v, disparity_from_depth(depth, CAMERA), CAMERA)
    for pixels, focal, centre, aside, tolerance in (
        ((u, v), 585.05108211, (315.83800193, 242.94140713), 0.0, 1e-6),
        (colour, 526.37, (317.1, 247.05), -0.02635, 0.02),
    ):
        intrinsic = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])
        found, _ = cv2.projectPoints(points, np.zeros(3), np.array([aside, 0.0, 0.0]), intrinsic, None)
        assert found[:, 0] == pytest.approx(np.column_stack(pixels), abs=tolerance)
    assert points[:, 2] == pytest.approx(depth)


def floor_points_from(K, camera=CAMERA, pitch=CAMERA.pitch):
    """Points of a rendered floor, back-projected with K and placed by ``camera``."""
    v, u = np.indices((480, 640)).reshape(2, -1)
    depth = depth_from_disparity(disparity_image((0, 0, 0), pitch=pitch).ravel(), camera)
    seen = depth_mask(depth, 0.1, 3.0)
    return to_world(back_project(u[seen], v[seen], depth[seen], K), (0, 0, 0), camera)


# Step 5 and the floor plane


def test_the_blind_ring_begins_45_cm_ahead_of_the_camera():
    assert nearest_floor(CAMERA) == pytest.approx(0.45, abs=0.005)
    in_the_image = floor_points_from(CAMERA.K)[:, 0].min() - CAMERA.position_b[0]
    assert in_the_image == pytest.approx(nearest_floor(CAMERA), abs=0.003)


def test_a_rendered_floor_comes_back_at_height_zero_and_elsewhere_by_the_reports_swapped_matrix():
    half_a_step_at_3_m = 0.0011 * 3 / 2
    assert np.abs(floor_points_from(CAMERA.K)[:, 2]).max() < half_a_step_at_3_m + 1e-4
    swapped = CAMERA.K.copy()
    swapped[0, 2], swapped[1, 2] = CAMERA.K[1, 2], CAMERA.K[0, 2]
    assert np.mean(floor_mask(floor_points_from(swapped), 0.01)) < 0.01


def test_the_camera_stands_and_looks_where_yaw_height_and_pitch_of_the_body_say():
    theta = 0.7
    axes = to_world(np.eye(3), (0, 0, theta), CAMERA) - to_world(np.zeros((1, 3)), (0, 0, theta), CAMERA)
    assert axes == pytest.approx(np.array(camera_axes(theta, np.deg2rad(18))))
    camera_at = to_world(np.zeros((1, 3)), (1.0, 2.0, np.pi / 2), CAMERA, z=0.5, pitch=0.1)[0]
    forward = 0.16766 * np.cos(0.1) + 0.38001 * np.sin(0.1)
    up = 0.38001 * np.cos(0.1) - 0.16766 * np.sin(0.1)
    assert camera_at == pytest.approx([1.0, 2.0 + forward, 0.5 + up])


def synthetic_plane(slope, height, rng, outliers=0.3):
    """Points of a floor seen over 0.6 to 3 m with 2 mm of noise, among points of walls."""
    x, y = rng.uniform(0.6, 3.0, 4000), rng.uniform(-1, 1, 4000)
    z = height + slope * x + rng.normal(0, 0.002, 4000)
    walls = rng.random(4000) < outliers
    z[walls] = rng.uniform(0.05, 1.5, walls.sum()) + slope * x[walls]
    return np.column_stack([x, y, z]), ~walls


@pytest.mark.parametrize(("pitch_deg", "height"), [(0, 0), (2.6, 0.02), (-3, -0.05), (12, 0.0), (-15, 0.03)])
def test_a_tilted_plane_is_recovered_among_walls(pitch_deg, height):
    points, floor = synthetic_plane(np.tan(np.deg2rad(pitch_deg)), height, np.random.default_rng(2))
    plane = fit_floor_plane(points)
    assert np.rad2deg(plane.pitch_error) == pytest.approx(pitch_deg, abs=0.1)
    assert plane.height == pytest.approx(height, abs=0.003)
    assert np.mean(plane.inliers[floor]) > 0.99
    assert np.mean(plane.inliers[~floor]) < 0.05


def test_a_plane_between_two_bins_of_the_vote_beats_a_smaller_one_within_a_bin():
    rng = np.random.default_rng(6)
    x, height = rng.uniform(0.6, 3.0, 1000), np.where(np.arange(1000) < 600, 0.01, 0.08)
    plane = fit_floor_plane(np.column_stack([x, 0 * x, height + rng.normal(0, 0.002, 1000)]))
    assert plane.height == pytest.approx(0.01, abs=0.002)


def test_the_fitted_plane_corrects_the_pitch_and_height_of_the_camera():
    sheet = replace(CAMERA, pitch=0.36, position_b=(0.16766, 0.0, 0.36))
    plane = fit_floor_plane(floor_points_from(CAMERA.K, sheet)[::50])
    assert plane.pitch_error == pytest.approx(CAMERA.pitch - sheet.pitch, abs=1e-3)
    levelled = level_camera(sheet, plane.pitch_error, plane.height)
    assert levelled.pitch == pytest.approx(CAMERA.pitch, abs=1e-3)
    assert levelled.position_b[2] == pytest.approx(CAMERA.position_b[2], abs=2e-3)
    assert floor_mask(floor_points_from(CAMERA.K, levelled), 0.006).all()
