"""The pages of real buildings and of trust: what is stored belongs to its study, and was prepared rightly."""

import csv
import subprocess
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from conftest import ROOT
from pfslam_book.show import logs
from pfslam_book.show.tables import read_table

import pfslam
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.poses import Trajectory, compose
from pfslam.recording import LidarScans, Recording
from pfslam.run import run_slam
from pfslam.sensors import LidarModel, RobotModel
from pfslam.slam import SlamConfig

sys.path.append(str(ROOT / "book" / "_tools"))
from measure import unseen
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


def carmen_log(tmp_path, text):
    (tmp_path / "made.log").write_text(text)
    return pfslam.load(tmp_path / "made.log")


def test_a_log_of_wean_hall_is_translated(tmp_path):
    """Centimetres become metres; lines without a scan are left out."""
    ranges = " ".join(["250"] * 179 + ["8183"])
    text = f"O 0 0 0 .1\nL 100 200 .5 100 225 .5 {ranges} .2\nL 110 200 .5 110 225 .5 {ranges} .4\n"
    log = carmen_log(tmp_path, unseen.wean(text))
    np.testing.assert_allclose(log.odometry.poses, [[1.0, 2.0, 0.5], [1.1, 2.0, 0.5]])
    assert log.scans().ranges[0, [0, -1]].tolist() == pytest.approx([2.5, 81.83])
    assert log.odometry.t.tolist() == [0.2, 0.4]


def test_a_log_of_the_rover_of_mines_is_translated(tmp_path):
    """Both wheels turn once, then the right one alone by a quarter: a circle about the left one."""
    ranges = " ".join(["1500"] * 682)
    rest = " ".join(["0"] * 20)
    counts = (0, 0), (2000, 2000), (2000, 2500)
    lines = [f"{k}00000 0 {q[0]} {q[1]} {rest} {ranges} 9" for k, q in enumerate(counts, start=1)]
    log = carmen_log(tmp_path, unseen.mines("\n".join(lines)))
    turn = 0.5 * np.pi * 0.077 / 0.33
    np.testing.assert_allclose(log.odometry.poses[1], [2 * np.pi * 0.077, 0.0, 0.0], atol=1e-5)
    assert log.odometry.poses[2, 2] == pytest.approx(turn, abs=1e-5)
    assert np.degrees(log.robot.lidar.angles[[0, -1]]).tolist() == pytest.approx([-120, 120], abs=1e-3)
    assert log.robot.lidar.position_b[0] == 0.145
    np.testing.assert_allclose(log.scans().ranges, 1.5)


def test_a_log_of_broombot_is_translated(tmp_path):
    """Its first line is left out; what no beam saw stays empty."""
    lines = ["0, 90, 80, 1.0, 1.0", "0, 0, .1, 2.0, 0.0, 0.05, 3.0", "50, 90, .1, 2.0, 0.0, 0.0, 3.0"]
    log = carmen_log(tmp_path, unseen.broombot("\n".join(lines)))
    s = 0.5 * np.sqrt(0.5)
    np.testing.assert_allclose(log.odometry.poses, [[0, 0, 0], [s, s, np.pi / 2]], atol=1e-5)
    assert np.flatnonzero(log.scans().ranges[0]).tolist() == [0, 540]


def test_the_tables_of_unseen_logs_are_those_of_the_study():
    table = read_table("unseen")
    assert set(table["label"]) == set(unseen.LOGS) == set(unseen.MAPS)
    shown = {"": unseen.by_log(table), "_counts": unseen.counts(table), "_sources": unseen.sources()}
    for name, rows in shown.items():
        with open(unseen.TABLES / f"unseen{name}.csv", encoding="utf-8", newline="") as file:
            assert [tuple(row) for row in csv.reader(file)] == rows


def test_a_word_counts_where_the_map_is_wrong_and_against_the_run_where_it_is_right(monkeypatch):
    names = list(unseen.LOGS)[:4]
    monkeypatch.setattr(unseen, "MAPS", {name: (k < 2, "") for k, name in enumerate(names)})
    table = {
        "label": np.array(names),
        "exit": np.array([0.0, 0.0, 3.0, 0.0]),
        "failed": np.array([0.0, 1.0, 1.0, 0.0]),
        "doubted": np.array([0.0, 0.0, np.nan, 0.0]),
    }
    assert unseen.counts(table)[-1] == ("all", "2", "1", "0", "2", "1")


def test_logs_are_fetched_from_a_host(tmp_path, monkeypatch):
    git = partial(subprocess.run, check=True, capture_output=True, text=True, cwd=tmp_path / "me" / "logs")
    git.keywords["cwd"].mkdir(parents=True)
    (git.keywords["cwd"] / "a.txt").write_text("one")
    git(["git", "init", "--quiet"])
    git(["git", "add", "a.txt"])
    git(["git", "-c", "user.name=me", "-c", "user.email=me@here", "commit", "--quiet", "-m", "a log"])
    commit = git(["git", "rev-parse", "HEAD"]).stdout.strip()
    source = unseen.Source("r", "l", unseen.TUNING, "me/logs", "none", commit, {"a.log": "a.txt"}, str.upper)
    monkeypatch.setattr(unseen, "SOURCES", (source, source._replace(files={"b/c.bag": "a.txt"}, read=None)))
    monkeypatch.setenv("PFSLAM_DATA", str(tmp_path))
    unseen.fetch(str(tmp_path))
    assert (tmp_path / "unseen" / "a.log").read_text() == "ONE"
    assert (tmp_path / "unseen" / "b" / "c.bag").read_text() == "one"
