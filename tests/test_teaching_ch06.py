"""Chapter 06: the geometry that it derives, against the package; and how its tables are written."""

import numpy as np
import pytest
from pfslam_book.show.tables import Shown

from pfslam.sensors import RgbdModel
from pfslam.texture import disparity_from_depth

CAMERA = RgbdModel()


def test_the_reports_constants_are_a_projector_beside_a_camera():
    """d = 1089 - 8 f b / Z with a baseline of 72 mm."""
    z = np.linspace(0.5, 9.0, 30)
    focal_times_baseline = 1.03 / 0.00304 / 8
    np.testing.assert_allclose(disparity_from_depth(z, CAMERA), 3.31 / 0.00304 - 8 * focal_times_baseline / z)
    assert focal_times_baseline / CAMERA.focal_u == pytest.approx(0.0724, abs=1e-4)


def test_a_bar_in_a_cell_of_a_table_is_no_column():
    table = Shown(("step", "result"), [("5 floor", "|z| <= 0.01 m")])
    assert table.markdown().splitlines()[-1] == "| 5 floor | \\|z\\| <= 0.01 m |"
