"""Chapter 06: the geometry that it derives, against the package; and which images its drives keep."""

import numpy as np
import pytest
from pfslam_book import ch06
from pfslam_book.ch06.geometry import SUBPIXEL, TAPE
from pfslam_book.show.tables import Shown

from pfslam.sensors import RgbdModel
from pfslam.texture import associate_rgb, disparity_from_depth

CAMERA = RgbdModel()


@pytest.fixture(scope="module")
def hall():
    return ch06.load_drive("hall")


def test_the_reports_constants_are_a_projector_beside_a_camera():
    """d = 1089 - 8 f b / Z with a baseline of 72 mm."""
    z = np.linspace(0.5, 9.0, 30)
    focal_times_baseline = 1.03 / 0.00304 / SUBPIXEL
    np.testing.assert_allclose(
        disparity_from_depth(z, CAMERA), 3.31 / 0.00304 - SUBPIXEL * focal_times_baseline / z
    )
    assert focal_times_baseline / CAMERA.focal_u == pytest.approx(0.0724, abs=1e-4)


def test_eq_16_is_a_second_pinhole_camera():
    x, y, z = np.random.default_rng(0).uniform((-1, -0.5, 0.6), (1, 0.5, 6.0), (20, 3)).T
    u, v = CAMERA.focal_u * x / z + CAMERA.centre_u, CAMERA.focal_v * y / z + CAMERA.centre_v
    u_rgb, v_rgb = associate_rgb(u, v, disparity_from_depth(z, CAMERA), CAMERA)
    np.testing.assert_allclose(u_rgb, 526.37 * x / z + 317.11 - 13.87 / z, atol=0.02)
    np.testing.assert_allclose(v_rgb, 526.37 * y / z + 247.05, atol=0.02)


def test_a_board_at_taped_distances_gives_the_constants_back(hall):
    shots = ch06.shots_along(hall, 3)
    tape, raw = ch06.tape_and_raw(shots, np.random.default_rng(0))
    assert len(tape) == len(raw) == len(TAPE)
    slope, offset = np.polyfit(raw, 1 / tape, 1)
    assert slope == pytest.approx(-0.00304 / 1.03, rel=0.01)
    assert -offset / slope == pytest.approx(1089, abs=4)


def test_the_votes_peak_at_the_slope_of_the_floor_among_walls():
    rng = np.random.default_rng(1)
    x = rng.uniform(0.5, 4.0, 900)
    wall = rng.uniform(0, 1, 900) < 0.4
    z = np.where(wall, rng.uniform(-0.1, 1.0, 900), 0.013 - 0.07 * x + 0.003 * rng.standard_normal(900))
    slopes = np.arange(-20, 21) * 0.01
    assert slopes[ch06.floor_votes(x, z, slopes).argmax()] == pytest.approx(-0.07, abs=0.011)


def test_a_bar_in_a_cell_of_a_table_is_no_column():
    table = Shown(("step", "result"), [("5 floor", "|z| <= 0.01 m")])
    assert table.markdown().splitlines()[-1] == "| 5 floor | \\|z\\| <= 0.01 m |"
