"""Chapter 10: what its helpers compute, against values known beforehand."""

import numpy as np
import pytest
from pfslam_book import ch10
from pfslam_book.ch10.building import match_along, two_halves
from pfslam_book.ch10.exact import Histogram, coarse, small_map

from pfslam.poses import between


def test_the_building_without_its_door_is_its_own_twin():
    place = two_halves(door=False)
    grid = place.grid
    iy, ix = np.nonzero(grid.occupied)
    walls = grid.spec.cell_to_world(np.column_stack([ix, iy]))
    turned = place.twin(np.column_stack([walls, np.zeros(len(walls))]))[:, :2]
    apart = [np.hypot(*(walls - point).T).min() for point in turned[::7]]
    assert max(apart) < 0.08
    pose = np.array([1.0, 2.0, 0.5])
    np.testing.assert_allclose(place.twin(place.twin(pose))[:2], pose[:2])


def test_a_kidnapped_robot_feels_no_motion():
    recording = two_halves().recording
    t0 = recording.lidar.t[0]
    taken = ch10.kidnapped(recording, 10.0, 20.0)
    leave = np.searchsorted(taken.lidar.t, t0 + 10.0)
    jump = between(taken.truth.poses[leave - 1], taken.truth.poses[leave])
    felt = between(*taken.odometry.at(taken.lidar.t[leave - 1 : leave + 1]))
    assert np.hypot(*jump[:2]) > 3.0
    assert np.hypot(*felt[:2]) < 0.2
    assert len(taken.lidar.t) == len(recording.lidar.t) - 80
    assert (np.diff(taken.lidar.t) < 0.3).all()


@pytest.mark.slow
def test_the_histogram_is_a_distribution_that_moves_as_told():
    known = small_map()
    even = Histogram.even(known)
    assert even.belief.sum() == pytest.approx(1.0)
    at = np.argmin(np.abs(even.nodes - [-0.8, 0.1, 0.13]).sum(axis=1))
    moved = Histogram(even.nodes, np.eye(len(even.nodes))[at]).moved(np.array([0.6, 0.0, 0.0]))
    mean = moved.belief @ moved.nodes[:, :2]
    theta = even.nodes[at, 2]
    expected = even.nodes[at, :2] + 0.6 * np.array([np.cos(theta), np.sin(theta)])
    np.testing.assert_allclose(mean, expected, atol=0.03)
    assert coarse(moved.nodes, moved.belief).sum() == pytest.approx(1.0)


def test_followed_from_its_start_a_robot_stays_found_and_beside_it_does_not():
    place = two_halves()
    short = ch10.part(place.recording, 0.0, 4.0)
    start = short.truth.at(short.lidar.t[0])
    ends = [
        ch10.distances(match_along(place.grid, short, pose), short)[-1]
        for pose in (start, start + [2.0, 0.0, 0.5])
    ]
    assert ends[0] < 0.05
    assert ends[1] > 0.5
