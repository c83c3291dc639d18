"""Chapter 10: what its helpers compute, and the localiser that stands on its page, against values known beforehand."""

import math

import numpy as np
import pytest
from notebook_cells import run, source
from pfslam_book import ch10

import pfslam
from pfslam.beyond.localization import LocalizationConfig, enough, kld_bound, likelihood_field
from pfslam.poses import between
from pfslam.refined.events import LevelledScans

OWN = [f"localiser-{part}" for part in ("weigh", "bound", "resample", "alarm")]


def localiser() -> dict:
    """The names of the chapter's localiser, from the very cells that the reader sees."""
    names: dict = {}
    for tag in ("setup", "localiser-move", *OWN, "localiser-whole"):
        run(source("10", tag), names)
    return names


def test_the_building_without_its_door_is_its_own_twin():
    place = ch10.two_halves(door=False)
    grid = place.grid
    iy, ix = np.nonzero(grid.occupied)
    walls = grid.spec.cell_to_world(np.column_stack([ix, iy]))
    turned = place.twin(np.column_stack([walls, np.zeros(len(walls))]))[:, :2]
    apart = [np.hypot(*(walls - point).T).min() for point in turned[::7]]
    assert max(apart) < 0.08
    pose = np.array([1.0, 2.0, 0.5])
    np.testing.assert_allclose(place.twin(place.twin(pose))[:2], pose[:2])


def test_a_kidnapped_robot_feels_no_motion():
    recording = ch10.two_halves().recording
    t0 = recording.lidar.t[0]
    taken = ch10.kidnapped(recording, 10.0, 20.0)
    leave = np.searchsorted(taken.lidar.t, t0 + 10.0)
    jump = between(taken.truth.poses[leave - 1], taken.truth.poses[leave])
    felt = between(*taken.odometry.at(taken.lidar.t[leave - 1 : leave + 1]))
    assert np.hypot(*jump[:2]) > 3.0
    assert np.hypot(*felt[:2]) < 0.2
    assert len(taken.lidar.t) == len(recording.lidar.t) - 80
    assert (np.diff(taken.lidar.t) < 0.3).all()


def test_followed_from_its_start_a_robot_stays_found_and_beside_it_does_not():
    place = ch10.two_halves()
    short = ch10.part(place.recording, 0.0, 4.0)
    start = short.truth.at(short.lidar.t[0])
    ends = [
        ch10.distances(ch10.match_along(place.grid, short, pose), short)[-1]
        for pose in (start, start + [2.0, 0.0, 0.5])
    ]
    assert ends[0] < 0.05
    assert ends[1] > 0.5


def test_the_localiser_of_the_page_has_the_field_and_the_bound_of_the_package():
    own, grid = localiser(), ch10.two_halves().grid
    np.testing.assert_allclose(own["field_of"](grid), likelihood_field(grid, LocalizationConfig()), atol=1e-5)
    bins = np.array([2, 10, 100, 1000])
    np.testing.assert_allclose([own["bound"](k) for k in bins], kld_bound(bins), rtol=1e-3)
    heap = np.random.default_rng(0).normal(0.0, [0.5, 0.5, 0.1], (10_000, 3))
    weights, founder = np.full(10_000, 1e-4), np.arange(10_000)
    kept, family = own["resample"](heap, weights, founder, 0.0, grid, np.random.default_rng(0), least=10)
    assert 10 < enough(heap, least=10) <= len(kept) < 10_000
    np.testing.assert_array_equal(kept, heap[family])
    assert np.ptp(np.diff(family)) == 1  # a comb: every few
    _, family = own["resample"](heap, weights, founder, 0.4, grid, np.random.default_rng(0), least=10)
    assert (family < 0).mean() == pytest.approx(0.4, abs=0.02)


@pytest.mark.slow
def test_the_localiser_of_the_page_is_left_with_the_robot_and_its_twin():
    own, place = localiser(), ch10.two_halves()
    events = list(LevelledScans.of(place.recording).events())[:80]
    for seed in range(3):
        rng = np.random.default_rng(seed)
        step = own["localise"](place.grid, events, own["anywhere"](place.grid, 100_000, rng), rng)[-1]
        assert ch10.shares(place, *step[:3]).sum() > 0.95
        assert len(step.poses) < 1000


@pytest.mark.slow
def test_the_localiser_of_the_page_finds_a_robot_and_finds_it_again_if_it_has_an_alarm():
    own, hall = localiser(), pfslam.load("hall")
    grid = ch10.map_along(hall, hall.truth, pfslam.SlamConfig.refined().map, every=10)
    taken = ch10.kidnapped(ch10.part(hall, 15.0, 55.0), 12.0, 35.0)
    events = list(LevelledScans.of(taken).events())

    def away(step):
        return math.dist(step.weights @ step.poses[:, :2], taken.truth.at(step.t)[:2])

    for alarm, found_again in ((own["Alarm"](), True), (None, False)):
        rng = np.random.default_rng(3)
        steps = own["localise"](grid, events, own["anywhere"](grid, 100_000, rng), rng, alarm)
        before = [step for step in steps if step.t < events[0].t + 12.0][-1]
        assert away(before) < 0.1
        assert (away(steps[-1]) < 0.1) == found_again


def test_the_stored_searches_are_those_the_page_speaks_of():
    twins = ch10.read_table("ch10_twins")
    assert set(twins["cloud"]) == {"door", "no door", "drift 500", "drift 5000"}
    assert all(len(ch10.select(twins, cloud=cloud)["seed"]) == 20 for cloud in set(twins["cloud"]))
    assert (ch10.select(twins, cloud="door")["share_end"] > 0.95).all()
