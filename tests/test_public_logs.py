"""The pages of real buildings and of trust: what is stored belongs to its study, and was prepared rightly."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT
from pfslam_book.show import logs

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.poses import Trajectory, compose
from pfslam.recording import LidarScans, Recording
from pfslam.run import run_slam
from pfslam.sensors import LidarModel, RobotModel
from pfslam.slam import SlamConfig

sys.path.append(str(ROOT / "book" / "_tools"))
from measure.logs import LOGS, MARGIN, MOST_CELLS, SPARSE, by_the_metre, coarse, off
from measure.robots import AMONG, laid_on, robot

MOST_BYTES = 100_000


def wavy(count=50):
    s = np.arange(float(count))
    return Trajectory(s, np.column_stack([s, 3.0 * np.sin(s / 5), 0.1 * s]))


def test_every_run_that_came_to_an_end_has_its_map():
    ended = set(logs.logs_runs()["label"])
    with np.load(logs.KEPT, allow_pickle=False) as file:
        assert {name.rpartition(", ")[0] for name in file.files} == ended
    assert ended | set(logs.logs_runs(stopped=True)["label"]) == set(LOGS)
    assert logs.KEPT.stat().st_size <= MOST_BYTES


def test_the_tables_and_the_picture_name_each_building_with_its_numbers():
    told = logs.logs_picture().alt
    for (name, _, _, mean, *_), metres in zip(
        logs.logs_table().rows, logs.logs_runs()["mean_m"], strict=True
    ):
        assert mean == f"{metres:.2f}"
        assert f"{name} {mean} m" in told
    assert {row[0] for row in logs.stopped_table().rows} == set(LOGS) - {
        row[0] for row in logs.logs_table().rows
    }
    assert all(len(row) == 2 + len(logs.TRIALS) for row in logs.trials_table().rows)
    assert logs.logs_runs(SPARSE)["label"].tolist() == ["Freiburg 079"]


@pytest.mark.parametrize("turn", [0.0, 2.0, -3.0])
def test_a_path_that_was_only_moved_as_a_whole_lies_on_the_other(turn):
    path = wavy()
    moved = Trajectory(path.t, compose([40.0, -7.0, turn], path.poses))
    metres, radians = off(moved, path)
    np.testing.assert_allclose(metres, 0.0, atol=1e-12)
    np.testing.assert_allclose(radians, 0.0, atol=1e-12)


def test_what_is_left_is_the_least_that_a_turn_and_a_shift_can_leave():
    """Half of the path is bent by 0.2 rad; no other turn or shift, tried by hand, leaves a smaller sum of squares."""
    path = wavy()
    poses = path.poses.copy()
    poses[25:] = compose(
        poses[25], compose([0.0, 0.0, 0.2], compose([-25.0, -poses[25, 1], 0.0], poses[25:]))
    )
    laid, others = laid_on(Trajectory(path.t, poses), path)
    left = np.square(laid - others)[:, :2].sum()
    for change in (
        [0.05, 0.0, 0.0],
        [-0.05, 0.0, 0.0],
        [0.0, 0.05, 0.0],
        [0.0, 0.0, 0.01],
        [0.0, 0.0, -0.01],
    ):
        assert np.square(compose(change, laid) - others)[:, :2].sum() > left


def test_a_wall_outweighs_free_floor_in_a_coarser_map_about_the_path():
    """Cells of 0.1 m: free floor from x = 1 m on, one wall in it, and a path of which the map shows 8 m about."""
    signs = np.zeros((8 * MOST_CELLS, 30))
    signs[:, 10:] = -2.0
    signs[803, 15] = 3.0
    path = np.array([[1.5, 80.0], [1.5, 20.0]])
    found, corner = coarse(OccupancyGrid(GridSpec((0.0, 0.0), 0.1, signs.shape), signs), path)
    first = 20.0 - MARGIN
    assert corner == pytest.approx([1.0, first, 0.4])  # 76 m are 761 cells, and four of them one
    assert found.shape == (191, 5)
    y, x = np.argwhere(found == 1)[0]
    assert (y, x, np.count_nonzero(found == 1)) == (int((80.35 - first) / 0.4), 1, 1)
    assert np.count_nonzero(found == -1) == found.size - 1


def test_a_scan_a_metre_is_kept():
    t = np.arange(9.0)
    path = Trajectory(t, np.column_stack([np.minimum(0.4 * t, 2.4), np.zeros(9), np.zeros(9)]))
    lidar = LidarScans(t, np.ones((9, 1), dtype=np.float32))
    log = Recording("log", RobotModel(lidar=LidarModel(beams=1)), odometry=path, lidar=lidar)
    thin = by_the_metre(log)
    assert thin.scans().t.tolist() == thin.odometry.t.tolist() == [0.0, 3.0, 6.0]


@pytest.mark.nightly
def test_a_slip_that_scans_did_not_take_back_has_no_word():
    """The first look is better, and in doubt, so the second stands and has none."""
    recording = robot(AMONG, "ramp 308")
    config = replace(SlamConfig.refined(), every=recording.default_every)
    first, kept = (
        run_slam(recording, config, keep_particles=False, second_look=again) for again in (False, True)
    )
    errors = [trajectory_error(look.trajectory, recording.true_path()).ate_max_m for look in (first, kept)]
    assert errors[0] < 0.3 < 0.5 < errors[1] < 1.0
    assert (bool(first.distrust), bool(kept.distrust)) == (True, False)
