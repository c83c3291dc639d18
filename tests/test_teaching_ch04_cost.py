"""The chapter's figures of cost: every way scores the same, and every part of an update is named once."""

import numpy as np
import pytest

import pfslam
from pfslam.teaching.ch04 import cost as ch04_cost
from pfslam.teaching.show.drives import place_at


@pytest.fixture(scope="module")
def corner():
    return place_at(pfslam.load("hall"), 14.5)


@pytest.mark.parametrize("cloud", ch04_cost.CLOUDS)
def test_windows_by_themselves_hold_the_scores_that_the_package_finds(corner, cloud):
    ways = ch04_cost.ways_to_score(corner, *ch04_cost.CLOUDS[cloud])
    windows, boxes = ways["each window by itself"](), ways["the package"]()
    assert sum(len(box.nodes) for box in boxes) == len(windows)
    # The same multiset of scores, however the nodes are ordered.
    found = np.concatenate([box.scores for box in boxes])
    np.testing.assert_array_equal(np.sort(found.ravel()), np.sort(windows.ravel()))


def test_pictures_name_every_bar():
    times = {cloud: dict.fromkeys(ch04_cost.WAYS, 2.0) for cloud in ch04_cost.CLOUDS}
    alt = ch04_cost.width_picture(times).alt
    assert all(name in alt for name in [*ch04_cost.CLOUDS, *ch04_cost.WAYS])
    alt = ch04_cost.update_picture({"predict": 0.1, "polish": 1.2}).alt
    assert "predict 0.1 ms" in alt
    assert "polish 1.2 ms" in alt
