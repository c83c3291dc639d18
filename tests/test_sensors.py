"""Sensor geometry by hand: beams, tilt, the camera's place, units."""

from dataclasses import replace

import numpy as np
import pytest

from pfslam.errors import DataError
from pfslam.poses import apply_transform, rotation_matrix, transform
from pfslam.refined.events import level_scan, tilted_points
from pfslam.sensors import ImuModel, LidarModel, RgbdModel, RobotModel, nearest_ranges, scan_points

FIVE = LidarModel(angle_min=-np.pi / 2, angle_max=np.pi / 2, beams=5, position_b=(0.2, 0.1, 0.5))
ROOT_HALF = np.sqrt(0.5)


def test_beam_points_by_hand():
    # Right, half right, ahead, half left, left; every point two metres from the LiDAR at (0.2, 0.1). Eq. 7.
    expected = np.array(
        [[0, -2], [2 * ROOT_HALF, -2 * ROOT_HALF], [2, 0], [2 * ROOT_HALF, 2 * ROOT_HALF], [0, 2]]
    )
    np.testing.assert_allclose(scan_points(np.full(5, 2.0), FIVE), expected + [0.2, 0.1], atol=1e-15)


def test_readings_that_are_none_give_no_point_nor_does_exactly_the_maximum():
    """Many scanners write it where nothing came back."""
    lidar = replace(FIVE, range_max=8.0)
    ranges = np.array([np.nan, np.nextafter(0.1, 0.0), 3.0, np.inf, 8.0])
    np.testing.assert_array_equal(lidar.valid(ranges), [False, False, True, False, False])
    np.testing.assert_allclose(scan_points(ranges, lidar), [[3.2, 0.1]])
    assert lidar.valid(np.array([0.1, np.nextafter(8.0, 0.0)])).all()


def test_pitched_down_scan_meets_the_floor_where_the_plane_does():
    # Nose down by p: the beam ahead starts at R (0.2, 0, 0.5) and falls by sin p for each metre.
    pitch = np.deg2rad(10.0)
    lidar = LidarModel(angle_min=-0.1, angle_max=0.1, beams=3, position_b=(0.2, 0.0, 0.5))
    height = 0.5 * np.cos(pitch) - 0.2 * np.sin(pitch)
    ranges = np.full(3, height / np.sin(pitch))
    points = tilted_points(ranges, lidar, pitch, 0.0)
    assert points[1, 2] == pytest.approx(0.0, abs=1e-12)
    assert points[1, 0] == pytest.approx(0.2 * np.cos(pitch) + 0.5 * np.sin(pitch) + height / np.tan(pitch))
    np.testing.assert_array_equal(points[:, :2], level_scan(ranges, lidar, (pitch, 0.0), -1.0)[0])


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize(
    ("first", "last"), [(-1.0, 2.0), (2.0, -1.0), (0.0, 2 * np.pi), (5.0, 3.0), (0.3, 0.3)]
)
@pytest.mark.parametrize("yaw", [0.0, 0.7, -3.0])
def test_a_mounted_lidar_sees_what_its_own_axes_say(upside_down, first, last, yaw):
    """Clockwise or not, upside down or not: the model's points are the scanner's, brought to the body's frame."""
    T_bl = transform(rotation_matrix(np.pi * upside_down, 0.0, yaw), (0.2, -0.1, 0.4))
    angles = np.linspace(first, last, 7)
    ranges = np.arange(1.0, 8.0)
    own = ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(7)])
    lidar, step = LidarModel.mounted(T_bl, (first, last), 7, (0.1, 20.0), sweep=0.1)
    found = scan_points(ranges[::step], lidar)
    np.testing.assert_allclose(found, apply_transform(T_bl, own)[::step, :2], atol=1e-9)
    assert lidar.sweep == 0.1 * step
    assert abs(lidar.angle_min + lidar.angle_max) <= 2 * np.pi + 1e-9


def test_a_lidar_that_leans_is_refused():
    steep = transform(rotation_matrix(roll=np.deg2rad(11.0)))
    with pytest.raises(DataError, match="mounting: found a lean of 11 deg, expected a level LiDAR"):
        LidarModel.mounted(steep, (-1.0, 1.0), 3, (0.1, 30.0))
    upside_down = transform(rotation_matrix(roll=np.deg2rad(171.0)))
    assert LidarModel.mounted(upside_down, (-1.0, 1.0), 3, (0.1, 30.0))[1] == -1


def test_an_angle_takes_the_nearest_beam_or_none():
    angles = np.array([-0.16, -0.14, 0.04, 0.06, 0.14, 0.16, 0.06 - 2 * np.pi])
    ranges = [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(nearest_ranges(angles, -0.1, 0.1, ranges), [np.nan, 1, 2, 3, 3, np.nan, 3])
    np.testing.assert_array_equal(nearest_ranges(angles, 0.1, -0.1, ranges), [np.nan, 3, 2, 1, 1, np.nan, 1])


def test_yaw_rate_takes_off_the_bias_before_the_scale():
    rates = np.array([[9.0, 9.0, 0.5], [9.0, 9.0, 0.02]])
    np.testing.assert_allclose(ImuModel(gyro_bias=0.02, gyro_scale=1.5).yaw_rate(rates), [0.72, 0.0])
    np.testing.assert_array_equal(ImuModel(yaw_axis=0).yaw_rate(rates), [9.0, 9.0])


@pytest.mark.parametrize(("yaw_axis", "columns"), [(0, "zxy"), (1, "yzx"), (2, "xyz")])
def test_the_columns_of_an_imu_are_put_in_the_order_of_the_body(yaw_axis, columns):
    shown = {"x": 1.0, "y": 2.0, "z": 3.0}
    raw = np.array([[shown[c] for c in columns]] * 2)
    model = ImuModel(yaw_axis=yaw_axis)
    np.testing.assert_array_equal(model.in_body(raw), [[1.0, 2.0, 3.0]] * 2)
    np.testing.assert_array_equal(model.yaw_rate(raw), [3.0, 3.0])


def test_the_constants_of_the_camera_are_the_reports():
    """Eq. 16 and step 2, as printed: dd = -0.00304 d + 3.31, depth = 1.03 / dd, the two lines for i and j."""
    camera = RgbdModel()
    np.testing.assert_array_equal(
        camera.K, [[585.05108211, 0, 315.83800193], [0, 585.05108211, 242.94140713], [0, 0, 1]]
    )
    assert (camera.disparity_slope, camera.disparity_offset, camera.depth_scale) == (-0.00304, 3.31, 1.03)
    assert (camera.rgb_focal, camera.rgb_divisor) == (526.37, 585.051)
    assert (camera.rgb_offset_u, camera.rgb_offset_v) == (19276.0, 16662.0)
    assert camera.rgb_baseline == pytest.approx(-7877.07)
    assert (camera.width, camera.height) == (640, 480)
    assert np.rad2deg(camera.pitch) == pytest.approx(18.0)
    assert RobotModel().lidar.position_b == (0.13323, 0.0, 0.51435)
    assert RobotModel().encoders.metres_per_count == 0.0022
