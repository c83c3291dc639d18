"""Exercises of chapter 09: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
from notebook_cells import defined

from pfslam.poses import Trajectory
from pfslam.teaching.ch09.beyond import best_fit_rmse
from pfslam.teaching.ch09.checks import check_blocked, check_draw_all, check_first_pose_error

CHECKS = {
    "check_first_pose_error": check_first_pose_error,
    "check_draw_all": check_draw_all,
    "check_blocked": check_blocked,
}


def from_notebook(tag, name):
    return defined("09", tag, **CHECKS)[name]


def test_first_pose_error_stub_and_solution():
    assert check_first_pose_error(from_notebook("exercise-1", "first_pose_error")).verdict == "unanswered"
    assert check_first_pose_error(from_notebook("solution-1", "first_pose_error_solution"))


def turned(poses, true_poses):
    turn = true_poses[0, 2] - poses[0, 2]
    c, s = np.cos(turn), np.sin(turn)
    return (poses[:, :2] - poses[0, :2]) @ np.array([[c, s], [-s, c]]) + true_poses[0, :2] - true_poses[:, :2]


def test_first_pose_error_hints():
    def fitted(poses, true_poses):
        t = np.arange(len(poses), dtype=float)
        return best_fit_rmse(Trajectory(t, poses), Trajectory(t, true_poses))

    def unturned(poses, true_poses):
        away = poses[:, :2] - poses[0, :2] - true_poses[:, :2] + true_poses[0, :2]
        return np.sqrt((away**2).sum(axis=1).mean())

    def raw(poses, true_poses):
        return np.sqrt(((poses - true_poses)[:, :2] ** 2).sum(axis=1).mean())

    assert "absorbs the heading" in check_first_pose_error(fitted).message
    assert "must be turned" in check_first_pose_error(unturned).message
    assert "frame of its own" in check_first_pose_error(raw).message
    assert "mean distance" in check_first_pose_error(lambda p, q: np.hypot(*turned(p, q).T).mean()).message
    assert "Take the root" in check_first_pose_error(lambda p, q: (turned(p, q) ** 2).sum(1).mean()).message
    assert "largest" in check_first_pose_error(lambda p, q: np.hypot(*turned(p, q).T).max()).message
    assert "should be" in check_first_pose_error(lambda p, q: 0.0).message
    assert "in metres" in check_first_pose_error(lambda p, q: p).message


def test_draw_all_stub_and_solution():
    assert check_draw_all(from_notebook("exercise-2", "draw_all")).verdict == "unanswered"
    assert check_draw_all(from_notebook("solution-2", "draw_all_solution"))


def test_draw_all_hints():
    def drawn(maps, ancestors, hits, copy):
        new = [copy(maps[a]) for a in ancestors]
        for m, h in zip(new, hits, strict=True):
            if h is not None:
                m[h] += 1
        return new

    def shared(maps, ancestors, hits):
        return drawn(maps, ancestors, hits, lambda m: m)

    def copied(maps, ancestors, hits):
        return drawn(maps, ancestors, hits, np.copy)

    def own(maps, ancestors, hits):
        return drawn(maps, range(4), hits, np.copy)

    def spoiling(maps, ancestors, hits):
        new = copied(maps, ancestors, hits)
        maps[3] += 1
        return new

    assert "one and the same array" in check_draw_all(shared).message
    assert "more memory" in check_draw_all(copied).message
    assert "use the ancestors" in check_draw_all(own).message
    assert "step before" in check_draw_all(spoiling).message
    assert "one map for each" in check_draw_all(lambda m, a, h: m[0]).message


def test_blocked_stub_and_solution():
    assert check_blocked(from_notebook("exercise-3", "blocked")).verdict == "unanswered"
    assert check_blocked(from_notebook("solution-3", "blocked_solution"))


def test_blocked_hints():
    def any_up_to(last):
        return lambda occupied, cells: occupied[cells[:last, 1], cells[:last, 0]].any()

    def two_before_the_end(occupied, cells):
        near = cells[-6:-3]
        return occupied[near[:, 1], near[:, 0]].any()

    assert "Leave the end" in check_blocked(any_up_to(None)).message
    assert "two cells thick" in check_blocked(any_up_to(-1)).message
    assert "only near the end" in check_blocked(two_before_the_end).message
    assert "No beam" in check_blocked(lambda occupied, cells: False).message
    assert "full marks" in check_blocked(lambda o, c: o[4, 10] and o[4, 20] and not o[4, 11]).message
    assert "True or False" in check_blocked(lambda occupied, cells: cells).message
