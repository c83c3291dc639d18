"""The texture's own measures: known shifts come back, known gaps are counted, lines of sight are blocked."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from floor_oracle import nearest_floor
from pfslam_book.show.texture_error import pattern_shifts, texture_error, visible_floor

from pfslam.grid import GridSpec
from pfslam.sensors import RgbdModel

SPEC = GridSpec((-2.0, -3.0), 0.05, (120, 160))
ALL = np.ones(SPEC.shape, dtype=bool)


def blobs(rng, shift=(0.0, 0.0)):
    """A smooth random pattern, moved by ``shift`` cells (x, y) and cut from the middle of a larger one."""
    field = rng.normal(size=(SPEC.shape[0] + 40, SPEC.shape[1] + 40, 3)).astype(np.float32)
    field = cv2.GaussianBlur(field, (0, 0), 2.0)
    field = 128 + 40 * field / field.std()
    moved = cv2.warpAffine(field, np.float32([[1, 0, shift[0]], [0, 1, shift[1]]]), field.shape[1::-1])
    return np.clip(moved[20:-20, 20:-20], 0, 255).astype(np.uint8)


def texture(rgb, seen=ALL):
    return SimpleNamespace(spec=SPEC, rgb=rgb, seen=seen)


@pytest.mark.parametrize("shift", [(0, 0), (3, 0), (-2, 4), (0.5, -1.5)])
def test_a_known_shift_comes_back_with_its_sign(shift):
    truth, moved = (blobs(np.random.default_rng(0), s) for s in ((0, 0), shift))
    shifts = pattern_shifts(moved, ALL, truth, ALL)
    assert len(shifts) == (120 // 20) * (160 // 20)
    assert np.median(shifts, axis=0) == pytest.approx(shift, abs=0.1)


def test_patches_that_cannot_tell_a_shift_are_left_out():
    plain = np.full((*SPEC.shape, 3), 90, np.uint8)
    stripes = plain.copy()
    stripes[:, ::8] = 200  # moving along the stripes changes nothing
    for pattern, seen in ((plain, ALL), (stripes, ALL), (blobs(np.random.default_rng(2)), ~ALL)):
        assert len(pattern_shifts(pattern, seen, pattern, ALL)) == 0


def test_the_figures_of_a_texture_made_by_hand():
    truth = blobs(np.random.default_rng(3))
    floor = ALL.copy()
    floor[:, :40] = False
    visible = ALL.copy()
    visible[:, 100:] = False
    seen = np.zeros_like(ALL)
    seen[:, 20:85] = True
    error = texture_error(texture(truth - np.uint8(0), seen), truth, floor, visible)
    assert error.coverage == pytest.approx(45 / 60)
    assert error.beyond_floor == pytest.approx(20 / 65)
    assert error.position_median_cells == pytest.approx(0.0, abs=0.05)
    assert error.colour_mean == error.colour_median == 0.0
    lighter = np.minimum(truth.astype(int) + 7, 255).astype(np.uint8)
    assert texture_error(texture(lighter, seen), truth, floor, visible).colour_median == 7


def test_the_visible_floor_is_a_wedge_behind_the_blind_ring():
    camera = RgbdModel()
    seen = visible_floor(SPEC, (0.0, 0.0, 0.0), camera, np.zeros_like(ALL), max_depth=3.0)
    iy, ix = np.nonzero(seen)
    x, y = SPEC.cell_to_world(np.column_stack([ix, iy])).T
    assert x.min() == pytest.approx(camera.position_b[0] + nearest_floor(camera), abs=0.05)
    # Depth 3 m along an axis that dips by 18 degrees: (3 - 0.38 sin 18) / cos 18 ahead of the camera.
    farthest = (3.0 - 0.38001 * np.sin(np.pi / 10)) / np.cos(np.pi / 10)
    assert x.max() == pytest.approx(0.16766 + farthest, abs=0.05)
    widest = np.arctan2(np.abs(y), x - camera.position_b[0]).max()
    assert np.deg2rad(25) < widest < np.deg2rad(35)


def test_walls_block_the_line_of_sight():
    wall = np.zeros_like(ALL)
    at, _ = SPEC.world_to_cell([1.5, 0.0])
    wall[:, at] = True
    wall[SPEC.world_to_cell([0.0, 0.4])[1] :, at] = False
    open_view = visible_floor(SPEC, (0.0, 0.0, 0.0), RgbdModel(), np.zeros_like(ALL), max_depth=3.0)
    behind = visible_floor(SPEC, (0.0, 0.0, 0.0), RgbdModel(), wall, max_depth=3.0)
    assert (behind <= open_view).all()
    assert not behind[: SPEC.world_to_cell([0.0, 0.4])[1], at:].any()
    assert behind[:, at + 1 :].any()
    assert (behind[:, :at] == open_view[:, :at]).all()
