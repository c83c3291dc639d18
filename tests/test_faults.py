"""Every fault of chapter 08: its number separates it from the healthy run, its cure restores."""

from dataclasses import replace

import numpy as np
import pytest
from pfslam_book import ch08
from pfslam_book.ch08 import data as ch08_data
from pfslam_book.ch08.data import BENDS, DELAY, MIRRORED_X
from pfslam_book.ch08.fault import STATES
from pfslam_book.ch08.filter import door_history, filter_run, lab_run, plain_filter, score_aside
from pfslam_book.ch08.world import WITH_PEOPLE, seen_points
from pfslam_book.show import faults

import pfslam
from pfslam.evaluation.trajectory import aligned_at_first, trajectory_error
from pfslam.grid import LOG_4
from pfslam.particles import Particles
from pfslam.recording import LidarScans
from pfslam.run import run_slam
from pfslam.sensors import scan_points
from pfslam.slam import SlamConfig

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def hall():
    return pfslam.load("hall")


RANGES = {
    "clock": ((-0.005, 0.005), (DELAY - 0.02, DELAY + 0.02)),
    "lever arm": ((-0.02, 0.02), (-2 * MIRRORED_X - 0.03, -2 * MIRRORED_X + 0.03)),
    "track": ((0.999, 1.001), (1.8, 2.0)),
    "renumbered beams": ((0, 0), (1, 1)),
    "lost second": ((-1e-9, 1e-9), (0.6, 1.1)),
    "too sharp": ((0.3, 0.6), (0, 0.1)),
    "kept weights": ((0.999, 1.001), (0, 0.9)),
    "torn rows": ((1, 1), (0, 0.1)),
    "w = 0": ((0.5, 1), (-1e-9, 1e-9)),
    "no clamp": ((3, 3), (61, 61)),
    "half a cell": ((-1e-9, 1e-9), (-2.5 - 1e-9, -2.5 + 1e-9)),
    "swapped K": ((-0.5, 0.5), (3, 7.1)),
    "disparity offset": ((-0.02, 0.02), (0.2, np.inf)),
    "paired by number": ((0, 0.05), (1, np.inf)),
}
"""Between which numbers the healthy and the broken robot lie."""
AT_NIGHT = {"people": ((0, 0.1), (0.2, 1)), "glass": ((0, 2), (20, 100))}


def test_every_row_of_the_table_is_tried():
    assert set(RANGES) | set(AT_NIGHT) == set(ch08.FAULTS)


@pytest.mark.parametrize(
    "name", [*RANGES, *(pytest.param(name, marks=pytest.mark.nightly) for name in AT_NIGHT)]
)
def test_the_number_of_a_fault_separates_healthy_from_broken(name):
    fault = ch08.FAULTS[name]
    for state, (low, high) in zip(STATES, (RANGES | AT_NIGHT)[name], strict=True):
        assert low <= fault.seen[state].value <= high, state
    assert fault.alt("healthy") != fault.alt("broken")


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


def test_corrections_give_back_the_lever_arm():
    turn, step, lever = np.array([0.5, -0.3, 1.0]), np.tile([0.2, 0.0], (3, 1)), np.array([0.2, -0.1])
    c, s = np.cos(turn) - 1, np.sin(turn)
    shift = np.column_stack([c * lever[0] - s * lever[1], s * lever[0] + c * lever[1]])
    np.testing.assert_allclose(ch08_data.lever_fit(step, turn, shift), lever, atol=1e-12)


# ---- the data


def test_what_was_measured_cures(hall):
    part = faults.scans_between(hall, *BENDS)
    healthy = ch08.corrections(part)
    late, moved = faults.late_scans(part, DELAY), faults.lidar_at(part, MIRRORED_X, 0.0)
    clock, lever = ch08.corrections(late), ch08.corrections(moved)
    x, y = np.array([MIRRORED_X, 0.0]) + lever.lever
    cured = faults.late_scans(late, -clock.delay), faults.lidar_at(moved, float(x), float(y))
    for broken, mended in zip((clock, lever), cured, strict=True):
        assert broken.ate > 10 * healthy.ate
        assert ch08.corrections(mended).ate < 0.1 * broken.ate


def test_two_flips_hide_from_the_score_and_one_does_not(hall):
    flipped = faults.clockwise(hall)
    scores, errors, ratios = [], [], []
    for world in (hall, flipped, faults.scaled_gyro(flipped, -1.0)):
        part = faults.scans_between(world, *BENDS)
        config = replace(SlamConfig.refined(), particles=20, every=20, tilt=False)
        run = run_slam(part, config, rng=np.random.default_rng(0), second_look=False)
        scores.append(np.median([info.score for info in run.infos if info.matched]))
        errors.append(trajectory_error(run.trajectory, part.true_path()).ate_rmse_m)
        ratios.append(ch08.turn_ratio(faults.heading_from_wheels(world), world))
    assert abs(scores[2] - scores[0]) < 0.01
    assert scores[1] < scores[0] - 0.03
    assert errors[2] > 100 * errors[0]
    assert ratios[2] == pytest.approx(-ratios[0], rel=0.01)


# ---- the filter, the map and the camera


def test_the_numbers_of_the_filter_hold_on_another_seed():
    healthy, torn = filter_run("healthy", 1), filter_run("torn rows", 1)
    assert healthy.known_rows == 1.0
    assert torn.known_rows < 0.1
    assert abs(np.subtract(*score_aside("w = 0", 1))) < 1e-9


def test_a_clamp_is_what_lets_a_map_forget(hall):
    for clamp, highest, scans in ((2 * LOG_4, 2 * LOG_4, 3), (np.inf, 60 * LOG_4, 61)):
        history, _ = door_history(hall.robot.lidar, clamp)
        assert history.max() == pytest.approx(highest, rel=1e-5)
        assert np.argmax(history[60:] < -0.1) + 1 == scans  # down to 0, and one more


def test_two_camera_faults_tilt_the_floor_alike(hall):
    camera = hall.robot.camera
    cameras = camera, faults.swapped_centre(camera), faults.disparity_offset_by(camera, 20.0)
    tilts = []
    for points in (seen_points(c, floor=True) for c in cameras):
        x, _, z = points[(points[:, 0] > 0.5) & (points[:, 0] < 3.5)].T
        tilts.append(np.rad2deg(np.arctan(np.polyfit(x, z, 1)[0])))
    level, swapped, offset = tilts
    assert abs(level) < 0.05
    assert swapped > 5.0
    assert abs(offset) > 1.0
    assert faults.swapped_centre(cameras[1]) == camera


# ---- the world


@pytest.mark.nightly
def test_people_drag_the_estimate_and_the_run_says_so():
    drives = ("empty", 5), ("people", 5), ("people", 20), ("people", 5, True)
    runs = [ch08.world_run(hazard, WITH_PEOPLE, *rest) for hazard, *rest in drives]
    healthy, broken, few, careful = (ch08.error_of(*run) for run in runs)
    assert healthy < 0.02 < 0.3 < broken
    assert max(few, careful) < 0.05
    assert runs[3][1].config.outliers is not None
    doubts = [result.distrust for _, result in runs]
    assert doubts[0] == doubts[2] == []
    (part, result), first = runs[1], doubts[1][0]
    assert first["reason"].startswith("scans moved")
    # What scans moved is judged over two seconds, so it is told within two seconds of the first ten centimetres.
    poses, true = aligned_at_first(result.trajectory, part.truth)
    dragged = result.trajectory.t[np.argmax(np.hypot(*(poses - true)[:, :2].T) > 0.1)]
    assert 0.0 < first["from"] - dragged < 2.0


@pytest.mark.nightly
def test_glass_changes_the_map_and_not_the_path():
    assert ch08.error_of(*ch08.world_run("glass", 60.0, 20)) < 0.02
