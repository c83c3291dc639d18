"""Chapter 13: each failure of the gallery is told by what the chapter says, and its map looks as described."""

import numpy as np
import pytest
from pfslam_book.ch13.gallery import gallery, what_tells

import pfslam

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def outcomes():
    return gallery(pfslam.load("hall"))


@pytest.fixture(scope="module")
def by_name(outcomes):
    return {outcome.failure.name: outcome for outcome in outcomes}


def end(outcome) -> np.ndarray:
    return outcome.result.trajectory.poses[-1]


def walls(outcome) -> int:
    return np.count_nonzero(outcome.result.grid.log_odds > 0)


@pytest.mark.parametrize(
    ("name", "tells"),
    [
        ("nothing wrong", "nothing"),
        ("turns by the ruler's track", "check-up: Do scans turn as the gyro does?"),
        ("beams backwards", "check-up: Do scans turn as the gyro does? factor -1."),
        ("gyro and beams mirrored", "check-up: Do wheels and gyro turn the same way? effective track -0."),
        (
            "LiDAR back to front",
            "check-up: Does the scene move as odometry says? factor 0.99, turned by +180",
        ),
        ("ranges halved", "check-up: Does the scene move as odometry says? factor 0.50"),
    ],
)
def test_what_tells(by_name, name, tells):
    assert what_tells(by_name[name]).startswith(tells)


def test_a_mirrored_world_is_as_sharp_and_ends_on_the_other_side(by_name):
    right, mirrored = by_name["nothing wrong"], by_name["gyro and beams mirrored"]
    np.testing.assert_allclose(end(mirrored), end(right) * [1, -1, -1], atol=0.1)
    assert walls(mirrored) == pytest.approx(walls(right), rel=0.05)
    assert mirrored.doubted == 0


def test_halved_ranges_give_half_the_world(by_name):
    np.testing.assert_allclose(
        end(by_name["ranges halved"])[:2], end(by_name["nothing wrong"])[:2] / 2, atol=0.1
    )


@pytest.mark.parametrize("name", ["turns by the ruler's track", "beams backwards", "LiDAR back to front"])
def test_the_other_three_break_the_map_and_the_run_says_so(by_name, name):
    assert walls(by_name[name]) > 1.3 * walls(by_name["nothing wrong"])
    assert by_name[name].doubted > 0.3
