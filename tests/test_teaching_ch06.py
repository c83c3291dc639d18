"""Chapter 06: the geometry that it derives, against the package; and how its tables are written."""

import numpy as np
import pytest
from pfslam_book.show.tables import Shown

from pfslam.sensors import RgbdModel
from pfslam.texture import associate_rgb, disparity_from_depth

CAMERA = RgbdModel()


def test_the_reports_constants_are_a_projector_beside_a_camera():
    """d = 1089 - 8 f b / Z with a baseline of 72 mm."""
    z = np.linspace(0.5, 9.0, 30)
    focal_times_baseline = 1.03 / 0.00304 / 8
    np.testing.assert_allclose(disparity_from_depth(z, CAMERA), 3.31 / 0.00304 - 8 * focal_times_baseline / z)
    assert focal_times_baseline / CAMERA.focal_u == pytest.approx(0.0724, abs=1e-4)


def test_eq_16_is_a_second_pinhole_camera():
    x, y, z = np.random.default_rng(0).uniform((-1, -0.5, 0.6), (1, 0.5, 6.0), (20, 3)).T
    u, v = CAMERA.focal_u * x / z + CAMERA.centre_u, CAMERA.focal_v * y / z + CAMERA.centre_v
    u_rgb, v_rgb = associate_rgb(u, v, disparity_from_depth(z, CAMERA), CAMERA)
    np.testing.assert_allclose(u_rgb, 526.37 * x / z + 317.11 - 13.87 / z, atol=0.02)
    np.testing.assert_allclose(v_rgb, 526.37 * y / z + 247.05, atol=0.02)


def test_a_bar_in_a_cell_of_a_table_is_no_column():
    table = Shown(("step", "result"), [("5 floor", "|z| <= 0.01 m")])
    assert table.markdown().splitlines()[-1] == "| 5 floor | \\|z\\| <= 0.01 m |"
