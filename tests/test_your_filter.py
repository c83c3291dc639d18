"""Your filter: the printed solutions joined follow the robot, and each part that is spoiled is named."""

import ast
import inspect
from dataclasses import replace

import numpy as np
import pytest
from notebook_cells import source

import pfslam
from pfslam.teaching.ch05 import your_filter
from pfslam.teaching.ch05.whole import check_filter
from pfslam.teaching.ch05.your_filter import BOOK, drive, error, my_filter, odometry_error, step
from pfslam.teaching.show.keep import keep, kept

SOLUTIONS = {
    "scan_points": ("00", 1),
    "to_world": ("00", 3),
    "cell_of": ("02", 1),
    "update_log_odds": ("02", 3),
    "move": ("03", 2),
    "count_on_walls": ("04", 1),
    "update": ("05", 1),
    "resample": ("05", 2),
    "mean_pose": ("05", 3),
    "step": ("05", 4),
}


def statements(code, name):
    """The body of a function as its syntax tree, without docstring, comments and line breaks."""
    (function,) = (n for n in ast.parse(code).body if isinstance(n, ast.FunctionDef) and n.name == name)
    body = function.body[1:] if ast.get_docstring(function) else function.body
    return [ast.dump(part) for part in (function.args, *body)]


@pytest.mark.parametrize("name", SOLUTIONS)
def test_the_books_part_is_the_printed_solution(name):
    chapter, number = SOLUTIONS[name]
    printed = statements(source(chapter, f"solution-{number}"), f"{name}_solution")
    assert statements(inspect.getsource(getattr(your_filter, name)), name) == printed


def test_the_joined_solutions_follow_the_robot():
    hall = pfslam.load("hall")
    driven = drive(step, my_filter(), hall, seconds=45.0, particles=40)
    assert error(driven, hall).ate_rmse_m < 0.1 < odometry_error(hall, driven.trajectory)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_joined_solutions_follow_the_robot_through_the_whole_drive(seed):
    hall = pfslam.load("hall")
    driven = drive(step, my_filter(), hall, particles=200, every=10, seconds=np.inf, seed=seed)
    assert error(driven, hall).ate_rmse_m < 0.1
    assert odometry_error(hall, driven.trajectory) > 1.0


B = BOOK
SPOILED = {
    "scan_points": lambda ranges, angles, xy: B["scan_points"](ranges, angles, xy) - xy,
    "to_world": lambda pose, points: B["to_world"](pose * [1, 1, -1], points),
    "cell_of": lambda points, origin, resolution: B["cell_of"](points, origin, resolution)[:, ::-1],
    "update_log_odds": lambda L, hits, free, up, down, clamp: B["update_log_odds"](
        L, free, hits, -down, -up, clamp
    ),
    "move": lambda p, v, w, dt, sv, sw, rng: B["move"](p, v, w, dt, sv**2, sw**2, rng),
    "count_on_walls": lambda p, walls, origin, resolution: B["count_on_walls"](
        p + 0.05, walls, origin, resolution
    ),
    "update": lambda weights, likelihood: likelihood / likelihood.sum(),
    "resample": lambda poses, weights, rng: (B["resample"](poses, weights, rng)[0], weights),
    "mean_pose": lambda poses, weights: weights @ poses,
}


@pytest.mark.parametrize("name", SPOILED)
def test_a_spoiled_part_is_named(name):
    verdict = check_filter(step, my_filter(**{name: SPOILED[name]}))
    assert verdict.verdict == "wrong"
    assert f"`{name}`" in verdict.message


def test_a_part_that_stops_or_is_a_stub_is_named_too():
    assert "`cell_of`" in check_filter(step, my_filter(cell_of=lambda points: points)).message
    assert "`update`" in check_filter(step, my_filter(update=lambda *a: ...)).message


def loop(**change):
    """The book's step with one thing wrong."""

    def spoiled(f, s, poses, weights, log_odds, points_b, drive, rng):
        drive = [] if change.get("predict") is False else drive
        walls = log_odds if change.get("score") is not False else np.zeros_like(log_odds)
        if "sharpness" in change:
            s = replace(s, sharpness=change["sharpness"])
        if "resample_below" in change:
            s = replace(s, resample_below=change["resample_below"])
        poses, weights, _, estimate = step(f, s, poses, weights, walls, points_b, drive, rng)
        if "estimate" in change:
            estimate = change["estimate"](poses, weights)
        at_estimate = np.repeat(np.array([estimate]), len(poses), axis=0)
        drawn = step(f, replace(s, resample_below=0.0), at_estimate, weights, log_odds * 0, points_b, [], rng)
        new = np.clip(log_odds + drawn[2], -s.clamp, s.clamp)
        return poses, weights, log_odds if change.get("draw") is False else new, estimate

    return spoiled


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"predict": False}, "predict first"),
        ({"score": False}, "leaves all weights equal"),
        ({"sharpness": 0.001}, "too flat"),
        ({"sharpness": 0.5}, "too sharp"),
        ({"sharpness": -0.05}, "a sign wrong"),
        ({"resample_below": 0.0}, "never resampled"),
        ({"resample_below": 1.0}, "resampled at every scan"),
        ({"draw": False}, "stays empty"),
        ({"estimate": lambda poses, weights: poses[0]}, "not the mean"),
    ],
)
def test_a_spoiled_loop_is_told_what_it_leaves_out(change, words):
    verdict = check_filter(loop(**change), my_filter())
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def test_an_unwritten_loop_is_unanswered_and_a_short_answer_is_named():
    assert check_filter(lambda *arguments: ..., my_filter()).verdict == "unanswered"
    assert "four things" in check_filter(lambda *arguments: arguments[2], my_filter()).message


def test_kept_functions_come_back_and_replace_their_forerunners(tmp_path, capsys):
    file = tmp_path / "my_filter.py"
    assert kept(file) == {}
    keep(BOOK["move"], file)
    keep(BOOK["mean_pose"], file)
    keep(BOOK["move"], file)
    assert capsys.readouterr().out.count("Kept: move") == 2
    assert file.read_text().count("def move(") == 1
    f = my_filter(file)
    assert repr(f).count("yours") == 2
    np.testing.assert_array_equal(f.mean_pose(np.eye(3), np.full(3, 1 / 3))[:2], [1 / 3, 1 / 3])


def test_a_stub_is_not_kept(tmp_path, capsys):
    def move(poses):
        return ...  # your turn

    keep(move, tmp_path / "my_filter.py")
    assert "not written yet" in capsys.readouterr().out
    assert not (tmp_path / "my_filter.py").exists()
