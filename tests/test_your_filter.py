"""Your filter: the printed solutions joined follow the robot, a spoiled part is named, and any loop is scored."""

import ast
import inspect
import math
import re
from collections import deque
from dataclasses import replace
from functools import partial
from itertools import accumulate

import numpy as np
import pytest
from notebook_cells import source
from pfslam_book import your_filter
from pfslam_book.ch05.whole import check_filter, differences
from pfslam_book.show.keep import keep, kept
from pfslam_book.your_filter import (
    BOOK,
    CHAPTERS,
    Filter,
    drive,
    error,
    my_filter,
    step,
    stored_errors,
)
from right_styles import OTHERS, RESAMPLED, as_list, as_tuples

import pfslam
from pfslam.particles import RESAMPLERS

pytestmark = pytest.mark.slow

SOLUTIONS = {
    "scan_points": ("00", 1),
    "to_world": ("00", 3),
    "inputs_between": ("01", 5),
    "cell_of": ("02", 1),
    "crossed_cells": ("02", 3),
    "update_log_odds": ("02", 4),
    "move": ("03", 2),
    "count_on_walls": ("04", 1),
    "update": ("05", 1),
    "resample": ("05", 2),
    "mean_pose": ("05", 3),
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


def test_the_books_loop_is_the_printed_one():
    assert statements(inspect.getsource(step), "step") == statements(source("05", "loop"), "step")


def test_the_joined_solutions_follow_the_robot():
    hall = pfslam.load("hall")
    driven = drive(step, my_filter("none"), hall, seconds=45.0, particles=40)
    assert error(driven, hall).ate_rmse_m < 0.05 < 0.4 < np.hypot(*last_gap(hall, driven))


def last_gap(recording, driven):
    """By how much (x, y) odometry has left the path of a drive at its end."""
    end = driven.trajectory
    return pfslam.dead_reckoning(recording).at(end.t[-1])[:2] - end.poses[-1][:2]


B = BOOK
SPOILED = {
    "scan_points": lambda ranges, angles, xy: B["scan_points"](ranges, angles, xy) - xy,
    "to_world": lambda pose, points: B["to_world"](pose * [1, 1, -1], points),
    "inputs_between": lambda *streams: B["inputs_between"](*streams) * [4, 1, 1],
    "cell_of": lambda points, origin, resolution: B["cell_of"](points, origin, resolution)[:, ::-1],
    "crossed_cells": lambda start, ends: np.concatenate([B["crossed_cells"](start, ends), ends]),
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


def by_logarithms(f, s, poses, weights, log_odds, points_b, inputs, rng, stops=True):
    """The loop in another style: logarithms, no work on an empty map, lists and tuples given back."""
    for v, omega, dt in inputs:
        poses = f.move(poses, v, omega, dt, s.sigma_v, s.sigma_omega, rng)
    if (log_odds > 0).any():
        logs = np.log(weights)
        for k, pose in enumerate(poses):
            points = f.to_world(pose, points_b)
            count = f.count_on_walls(points, log_odds > 0, s.origin, s.resolution)
            logs[k] += s.sharpness * count / len(points)
        weights = np.exp(logs - np.logaddexp.reduce(logs))
    x, y, theta = estimate = tuple(f.mean_pose(poses, weights))
    ends = f.cell_of(f.to_world(np.array(estimate), points_b), s.origin, s.resolution)
    c, d = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]]) @ s.lidar_xy
    start = f.cell_of(np.array([[x + c, y + d]]), s.origin, s.resolution)[0]
    rest = s.hit, s.free, s.clamp
    if stops and min(*start, *ends.min(axis=0)) < 0:
        raise ValueError("off the map")
    log_odds = np.float32(f.update_log_odds(log_odds, ends, f.crossed_cells(start, ends), *rest))
    if np.sum(weights**2) * s.resample_below * len(weights) >= 1:
        poses, weights = f.resample(poses, weights, rng)
    return [poses, weights, log_odds, estimate]


def spoiled(parts=lambda s: {}, settings=lambda s, w: {}, inputs=list, log_odds=np.copy):
    """The printed loop with other parts, settings or inputs, or another map, which make of it what a mistake does."""

    def loop(f, s, poses, weights, walls, points_b, controls, rng):
        f, changed = Filter(**vars(f) | parts(s)), replace(s, **settings(s, weights))
        return step(f, changed, poses, weights, log_odds(walls), points_b, inputs(controls), rng)

    return loop


def summed(inputs):
    """All inputs as a single one of the same length in time."""
    v, omega, dt = np.reshape(inputs, (-1, 3)).T
    return [(v @ dt / dt.sum(), omega @ dt / dt.sum(), dt.sum())] if len(dt) else []


def upside_down(s, weights):
    return {"resample_below": float(1 / np.sum(weights**2) > s.resample_below * len(weights))}


def after_resampling(s):
    again = lambda p, w: B["resample"](p, w, np.random.default_rng(1)) if s.resample_below else (p, w)  # noqa: E731
    return {"mean_pose": lambda p, w: B["mean_pose"](*again(p, w))}


@pytest.mark.parametrize(
    ("change", "step_of_the_loop"),
    [
        ({"inputs": lambda u: []}, "Predict"),
        ({"inputs": summed}, "Predict"),
        ({"inputs": lambda u: u[-1:]}, "Predict"),
        ({"settings": lambda s, w: {"sigma_v": 0, "sigma_omega": 0}}, "Predict"),
        ({"settings": lambda s, w: {"resample_below": 0.0}}, "Resample"),
        ({"settings": lambda s, w: {"resample_below": 1.0}}, "Resample"),
        ({"settings": upside_down}, "Resample"),
        ({"parts": lambda s: {"resample": lambda p, w, rng: (B["resample"](p, w, rng)[0], w)}}, "Resample"),
        ({"parts": lambda s: {"update": lambda w, likelihood: w}}, "Weigh"),
        ({"parts": lambda s: {"update": lambda w, likelihood: likelihood / likelihood.sum()}}, "Weigh"),
        ({"log_odds": lambda log_odds: log_odds + 1e-9}, "Weigh"),
        ({"settings": lambda s, w: {"sharpness": 240 * s.sharpness}}, "Weigh"),
        ({"parts": lambda s: {"mean_pose": lambda p, w: p[np.argmax(w)]}}, "Estimate"),
        (
            {"parts": lambda s: {"mean_pose": lambda p, w: B["mean_pose"](p, np.full(len(w), 1 / len(w)))}},
            "Estimate",
        ),
        ({"parts": lambda s: {"update_log_odds": lambda log_odds, *scan: log_odds}}, "Draw"),
        ({"settings": lambda s, w: {"free": 0.0}}, "Draw"),
        ({"settings": lambda s, w: {"lidar_xy": (0.0, 0.0)}}, "Draw"),
        ({"settings": lambda s, w: {"resolution": 0.05}}, "Draw"),
        (
            {"parts": lambda s: {"update_log_odds": lambda m, *scan: B["update_log_odds"](0 * m, *scan)}},
            "Draw",
        ),
    ],
)
def test_the_step_that_differs_is_named(change, step_of_the_loop):
    assert differences(spoiled(**change))[0].startswith(f"**{step_of_the_loop}**")


def test_a_loop_in_another_style_is_right_and_no_difference_is_mentioned():
    verdict = check_filter(by_logarithms, my_filter("none"))
    assert verdict, verdict
    assert "differ" not in verdict.message


def stratified(f, *rest):
    """The printed loop with a random number for each tooth of the comb."""
    draw = lambda p, w, rng: (p[RESAMPLERS["stratified"](w, rng)], np.full(len(w), 1 / len(w)))  # noqa: E731
    return step(Filter(**vars(f) | {"resample": draw}), *rest)


OTHER_WAYS = {
    "estimate after resampling": (spoiled(after_resampling), ["Estimate"]),
    "stratified": (stratified, []),
    "another likelihood": (spoiled(settings=lambda s, w: {"sharpness": 0.6 * s.sharpness}), ["Weigh"]),
}


@pytest.mark.parametrize("name", OTHER_WAYS)
def test_another_way_that_follows_the_robot_is_right_and_its_difference_only_mentioned(name):
    loop, named = OTHER_WAYS[name]
    verdict = check_filter(loop, my_filter("none"))
    assert verdict, verdict
    assert [f"**{step_of_the_loop}**" in verdict.message for step_of_the_loop in named] == [True] * len(named)


def test_a_loop_that_loses_the_robot_hears_by_how_much_and_what_is_different():
    verdict = check_filter(spoiled(inputs=lambda u: []), my_filter("none"))
    assert verdict.verdict == "wrong"
    off = [float(metres) for metres in re.findall(r"([0-9.]+) m in", verdict.message)]
    assert len(off) == 2
    assert min(off) > 1.0  # it stays where it began, and the robot drives some metres
    assert "**Predict**" in verdict.message


def test_a_loop_with_a_size_of_cells_of_its_own_is_told_of_the_setting():
    """The drives of the check have cells of another size than the chapter."""
    verdict = check_filter(spoiled(settings=lambda s, w: {"resolution": 0.05}), my_filter("none"))
    assert verdict.verdict == "wrong"
    assert "in cells of s.resolution" in verdict.message


def test_a_scan_that_leaves_the_map_is_not_drawn_on_its_far_side():
    """The printed loop stops, and a reader's own that does not is told."""
    low = {"origin": (-12.0, -0.5), "particles": 2, "seconds": 4.0}
    with pytest.raises(IndexError, match="leaves the map"):
        drive(step, my_filter("none"), pfslam.load("hall"), **low)
    drive(unaware := partial(by_logarithms, stops=False), my_filter("none"), pfslam.load("hall"), **low)
    assert any("on its right side" in words for words in differences(unaware))


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


HALF = 0.5  # a constant of the notebook


def halved(values):  # and a helper
    return [HALF * math.fsum([value]) for value in values]


def test_imports_constants_and_helpers_of_the_notebook_are_kept_too(tmp_path, capsys):
    def mean_pose(poses, weights):
        return halved(2 * np.add.reduce(poses) / len(poses)) if accumulate([0]) else the_drive  # noqa: F821

    file = tmp_path / "my_filter.py"
    keep(mean_pose, file)
    assert "cannot have the_drive." in capsys.readouterr().out
    keep(mean_pose, file)
    assert file.read_text().count("import math") == file.read_text().count("def halved(") == 1
    np.testing.assert_allclose(kept(file)["mean_pose"](np.ones((4, 3)), None), np.ones(3))
    keep(BOOK["move"], file)
    assert "cannot" not in capsys.readouterr().out.split("move")[-1]


def dressed(name, dress):
    """A part of the filter that gives its numbers back in another dress."""

    def part(*arguments):
        answer = BOOK[name](*arguments)
        return tuple(map(dress, answer)) if name == "resample" else dress(answer)

    return part


@pytest.mark.parametrize("dress", [as_list, as_tuples, lambda numbers: deque(as_list(numbers)), np.float32])
def test_parts_that_return_lists_tuples_and_float_cells_drive_as_well(rough_path, dress):
    parts = {name: dressed(name, dress) for name in BOOK}
    np.testing.assert_allclose(roughly_driven(**parts), rough_path, atol=0.01)


def test_a_stub_is_not_kept(tmp_path, capsys):
    def move(poses):
        return ...  # your turn

    keep(move, tmp_path / "my_filter.py")
    assert "not written yet" in capsys.readouterr().out
    assert not (tmp_path / "my_filter.py").exists()


STYLES = [
    (name, style)
    for name, chapter in CHAPTERS.items()
    for style in (RESAMPLED if name == "resample" else OTHERS.get(f"{chapter} check_{name}", []))
]


def roughly_driven(**parts):
    """The path of a few particles over a few scans, with other parts."""
    driven = drive(step, my_filter("none", **parts), pfslam.load("hall"), seconds=6.0, particles=4, every=80)
    return driven.trajectory.poses


@pytest.fixture(scope="module")
def rough_path():
    """The path of the book's own parts."""
    return roughly_driven()


@pytest.mark.parametrize(("name", "style"), STYLES)
def test_what_is_called_right_works_in_the_filter(rough_path, name, style):
    np.testing.assert_allclose(roughly_driven(**{name: style}), rough_path, atol=0.05)


def test_each_harm_does_what_the_chapter_says():
    for whole in (False, True):
        errors = stored_errors(whole=whole)
        assert errors["as printed"].max() < 0.05
        assert (
            errors["as printed"].max() < errors["full clearing"].min() < errors["full clearing"].max() < 0.1
        )
        put_right = stored_errors("ch05_gyro", whole=whole)["half the noise"]
        assert errors["half the noise"].min() > max(0.1, 3 * put_right.max())
        assert errors["never resampled"].min() > 0.2
