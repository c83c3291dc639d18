"""Every fault of chapter 08: its symptom is there, its number separates it from the healthy run, its cure restores."""

from dataclasses import replace

import numpy as np
import pytest
from pfslam_book.ch08 import data as ch08_data
from pfslam_book.ch08 import demos as ch08_demos
from pfslam_book.ch08 import exhibit as ch08
from pfslam_book.ch08.camera import floor_tilt_deg, look, seen_points
from pfslam_book.ch08.data_exhibits import DELAY, MIRRORED_X, data_faults
from pfslam_book.ch08.filter import (
    door_map,
    door_scans,
    lab_run,
    parents,
    plain_filter,
)
from pfslam_book.ch08.filter_exhibits import filter_faults, filter_runs
from pfslam_book.ch08.map_exhibits import camera_faults, map_faults
from pfslam_book.ch08.world_exhibits import world_faults, world_runs
from pfslam_book.show import faults

import pfslam
from pfslam.grid import LOG_4
from pfslam.particles import Particles
from pfslam.recording import LidarScans
from pfslam.sensors import scan_points

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def hall():
    return pfslam.load("hall")


@pytest.fixture(scope="module")
def runs(hall):
    return filter_runs(hall)


@pytest.fixture(scope="module")
def exhibits(hall, runs):
    return data_faults(hall) | filter_faults(hall, runs) | map_faults(hall) | camera_faults(hall)


EXHIBITS = {
    "clock": ((-0.005, 0.005), (DELAY - 0.02, DELAY + 0.02)),
    "lever arm": ((-0.02, 0.02), (-2 * MIRRORED_X - 0.03, -2 * MIRRORED_X + 0.03)),
    "track": ((0.999, 1.001), (1.8, 2.0)),
    "renumbered beams": ((0, 0), (1, 1)),
    "lost second": ((-1e-9, 1e-9), (0.6, 1.1)),
    "kept weights": ((0.999, 1.001), (0, 0.9)),
    "torn rows": ((1, 1), (0, 0.1)),
    "w = 0": ((0.5, 1), (-1e-9, 1e-9)),
    "swapped K": ((-0.5, 0.5), (3, 7.1)),
    "disparity offset": ((-0.02, 0.02), (0.2, np.inf)),
    "paired by number": ((0, 0.05), (1, np.inf)),
}
"""Between which numbers the healthy and the broken run lie."""


@pytest.mark.parametrize("name", EXHIBITS)
def test_the_number_of_an_exhibit_separates_healthy_from_broken(exhibits, name):
    for state, (low, high) in zip(("healthy", "broken"), EXHIBITS[name], strict=True):
        assert low <= exhibits[name].reading[state] <= high, state


# ---- the switches by themselves


def scan_of_four(*ranges):
    """A recording of one scan with four beams."""
    hall = pfslam.load("hall")
    lidar = replace(hall.robot.lidar, beams=4)
    robot = replace(hall.robot, lidar=lidar)
    return replace(hall, robot=robot, lidar=LidarScans(hall.lidar.t[:1], np.array([ranges], dtype=float)))


def test_renumbering_closes_the_gap_and_a_pane_leaves_it_open():
    np.testing.assert_array_equal(
        faults.renumbered(scan_of_four(1.0, np.inf, 3.0, 4.0)).lidar.ranges, [[1, 3, 4, np.inf]]
    )
    pane = faults.glass_pane(scan_of_four(1.0, 2.0, 3.0, 4.0), first=1, beams=2)
    np.testing.assert_array_equal(pane.lidar.ranges, [[1, np.inf, np.inf, 4]])
    assert ch08_data.ends_cut(pane) == 0.0
    assert ch08_data.ends_cut(faults.renumbered(pane)) == 1.0
    assert ch08_data.ends_cut(scan_of_four(1.0, 2.0, 3.0, 4.0)) == 0.0


def test_a_turned_lidar_sees_its_walls_elsewhere_and_another_unit_farther_away():
    four = scan_of_four(1.0, 2.0, 3.0, np.inf)
    turned = faults.turned_lidar(four, np.pi)
    place = four.robot.lidar.position_b[:2]
    seen, behind = (scan_points(r.lidar.ranges[0], r.robot.lidar) - place for r in (four, turned))
    np.testing.assert_allclose(behind, -seen, atol=1e-12)
    np.testing.assert_array_equal(faults.scaled_ranges(four, 0.5).lidar.ranges, [[0.5, 1, 1.5, np.inf]])


def test_torn_rows_keep_each_column_and_break_the_pairs():
    poses = np.column_stack([np.arange(50.0), np.zeros(50), np.arange(50.0) / 100])
    torn = faults.torn_rows(Particles(poses, np.zeros(50)), np.random.default_rng(0), "systematic")
    assert sorted(torn.poses[:, 0]) == sorted(poses[:, 0])
    assert sorted(torn.poses[:, 2]) == pytest.approx(sorted(poses[:, 2]))
    rows = parents(Particles(poses, np.zeros(50)), torn)
    np.testing.assert_array_equal(torn.poses[:, 0], poses[rows, 0])
    assert np.mean(torn.poses[:, 0] / 100 == torn.poses[:, 2]) < 0.2


def test_the_laboratory_runs_the_filter_of_the_package(hall):
    lab, config = faults.scans_between(hall, 12.0, 16.0), plain_filter(20)
    here, there = lab_run(lab, config, seed=3), pfslam.run_slam(lab, config, rng=np.random.default_rng(3))
    np.testing.assert_array_equal(here.state.grid.log_odds, there.grid.log_odds)
    for info, (before, _), expected in zip(here.infos, here.clouds, there.infos[1:], strict=True):
        np.testing.assert_array_equal(info.estimate, expected.estimate)
        np.testing.assert_array_equal(before.poses, expected.particles.poses)


# ---- what corrections give away, on made-up corrections


def test_corrections_give_back_scale_and_delay():
    rng = np.random.default_rng(1)
    turn, change, dt = rng.normal(0, 0.3, 60), rng.normal(0, 0.5, 60), rng.uniform(0.4, 0.6, 60)
    heading = 0.03 * turn - 0.12 * change + 0.004 * dt
    assert ch08_data.correction_fit(turn, change, dt, heading) == pytest.approx((1.03, 0.12))


# ---- the data


def test_what_was_measured_cures(hall):
    for name, cure in ch08_demos.cures(hall).items():
        assert cure.broken > 10 * cure.healthy, name
        assert cure.cured < 0.1 * cure.broken, name


def test_two_flips_hide_from_the_score_and_one_does_not(hall):
    worlds = ch08_demos.mirrored_worlds(hall)
    healthy, one, both = worlds.values()
    assert abs(both.score - healthy.score) < 0.01
    assert one.score < healthy.score - 0.03
    assert both.error > 100 * healthy.error
    assert both.wheels_per_gyro == pytest.approx(-healthy.wheels_per_gyro, rel=0.01)


# ---- the filter


# ---- the map and the camera


def test_a_clamp_is_what_lets_a_map_forget(hall):
    closed, opened = door_scans(hall)
    maps = [door_map(closed, opened, hall.robot.lidar, clamp) for clamp in (2 * LOG_4, np.inf)]
    assert [m.to_believe for m in maps] == [
        3,
        61,
    ]  # two scans down to 0, or as many as it was seen, and one more
    assert maps[0].history.max() == pytest.approx(2 * LOG_4)
    assert maps[1].history.max() == pytest.approx(60 * LOG_4, rel=1e-5)


def test_two_camera_faults_tilt_the_floor_alike(hall):
    shot, camera = look(), hall.robot.camera
    cameras = camera, faults.swapped_centre(camera), faults.disparity_offset_by(camera, 20.0)
    level, swapped, offset = (floor_tilt_deg(seen_points(shot, c, floor=True)) for c in cameras)
    assert abs(level) < 0.05
    assert swapped > 5.0
    assert abs(offset) > 1.0
    assert faults.swapped_centre(cameras[1]) == camera


# ---- the world


@pytest.fixture(scope="module")
def worlds(hall):
    return world_runs(hall)


@pytest.mark.nightly
def test_people_drag_the_estimate_and_the_run_says_so(worlds):
    healthy, broken, few, careful = (worlds[name] for name in list(worlds)[:4])
    exhibit = world_faults(worlds)["people"]
    assert exhibit.healthy < 0.1 < 0.2 < exhibit.broken
    assert healthy.ate < 0.02 < 0.3 < broken.ate
    assert max(few.ate, careful.ate) < 0.05
    assert careful.result.config.outliers is not None
    assert (healthy.says, few.says) == ("no doubt", "no doubt")
    assert broken.says.startswith("in doubt from 20 s on: scans moved")


@pytest.mark.nightly
def test_glass_and_doors_change_the_map_and_not_the_path(worlds):
    exhibits = world_faults(worlds)
    assert exhibits["glass"].healthy < 2 < 20 < exhibits["glass"].broken
    assert exhibits["closed door"].broken > 5 * exhibits["closed door"].healthy
    assert max(worlds["glass"].ate, worlds["doors"].ate) < 0.02
    for exhibit in exhibits.values():
        words = {state: ch08.exhibit_frame(exhibit, state)[1] for state in ch08.STATES}
        assert words["healthy"] != words["broken"]


# ---- the pictures
