"""Your filter: the printed solutions joined follow the robot, and each part that is spoiled is named."""

import ast
import inspect
import math
from dataclasses import replace
from itertools import accumulate

import numpy as np
import pytest
from notebook_cells import source
from pfslam_book.ch05 import your_filter
from pfslam_book.ch05.whole import check_filter
from pfslam_book.ch05.your_filter import BOOK, drive, error, my_filter, odometry_error, step
from pfslam_book.show.keep import keep, kept

import pfslam

SOLUTIONS = {
    "scan_points": ("00", 1),
    "to_world": ("00", 3),
    "cell_of": ("02", 1),
    "update_log_odds": ("02", 4),
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


def exact(f, s, poses, weights, log_odds, points_b):
    """Log-likelihood of every particle where it stands."""
    scans = [f.to_world(pose, points_b) for pose in poses]
    return s.sharpness * np.array([f.count_on_walls(p, log_odds > 0, s.origin, s.resolution) for p in scans])


def reweighted(f, s, poses, weights, log_odds, points_b):
    likelihood = exact(f, s, poses, weights, log_odds, points_b)
    return f.update(weights, np.exp(likelihood - likelihood.max()))


def below(s, weights):
    return 1 / np.sum(weights**2) <= s.resample_below * len(weights)


def drawn(f, s, log_odds, estimate, points_b, hit=1.0, free=1.0, clamp=1.0):
    ends, sensor = f.to_world(estimate, points_b), f.to_world(estimate, np.array([s.lidar_xy]))
    along = np.linspace(0, 1, 120)[:-1, None, None]
    crossed = (sensor + along * (ends[::2] - sensor)).reshape(-1, 2)
    cells = [f.cell_of(points, s.origin, s.resolution) for points in (ends, crossed)]
    return f.update_log_odds(log_odds, *cells, hit * s.hit, free * s.free, clamp * s.clamp)


def loop(
    weigh=reweighted, mean=None, resample=below, draw=drawn, order="weigh estimate resample draw", **rest
):
    """A loop of the five steps, with other steps or in another order, and what it gives back as it likes."""

    def spoiled(f, s, poses, weights, log_odds, points_b, drive, rng):
        for v, omega, dt in drive[: rest.get("controls")]:
            poses = f.move(poses, v, omega, dt * rest.get("dt", 1), s.sigma_v, s.sigma_omega * (v != 0), rng)
        estimate = None
        for name in order.split():
            if name == "weigh" and (log_odds > 0).any():
                weights = weigh(f, s, poses, weights, log_odds, points_b)
            if name == "estimate":
                estimate = (mean or f.mean_pose)(poses, weights)
            if name == "resample" and resample(s, weights):
                new, equal = f.resample(poses, weights, rng)
                poses, weights = new, weights if rest.get("old_weights") else equal
            if name == "draw":
                log_odds = draw(f, s, log_odds, estimate, points_b)
        return rest.get("give", lambda *four: four)(poses, weights, log_odds, estimate)

    return spoiled


def weighed_by_logarithms(f, s, poses, weights, log_odds, points_b):
    logs = np.log(weights) + exact(f, s, poses, weights, log_odds, points_b)
    return np.exp(logs - np.logaddexp.reduce(logs))


@pytest.mark.parametrize(
    "style",
    [
        {},
        {"weigh": weighed_by_logarithms},
        {"give": lambda *four: tuple(np.float32(part) for part in four)},
        {"mean": lambda poses, weights: tuple(BOOK["mean_pose"](poses, weights))},
    ],
)
def test_a_loop_in_another_style_is_right_too(style):
    verdict = check_filter(loop(**style), my_filter(file="none"))
    assert verdict, verdict


def with_sharpness(factor):
    def weigh(f, s, *rest):
        return reweighted(f, replace(s, sharpness=factor * s.sharpness), *rest)

    return weigh


def scan_alone(f, s, poses, weights, log_odds, points_b):
    return reweighted(f, s, poses, np.full(len(weights), 1 / len(weights)), log_odds, points_b)


def drawn_twice(f, s, log_odds, estimate, points_b):
    return drawn(f, s, drawn(f, s, log_odds, estimate, points_b), estimate, points_b)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"controls": 0}, "predict first"),
        ({"dt": 2}, "use every control"),
        ({"order": "estimate resample draw"}, "leaves all weights equal"),
        ({"weigh": with_sharpness(0.02)}, "too flat"),
        ({"weigh": with_sharpness(10)}, "too sharp"),
        ({"weigh": scan_alone}, "old weights are forgotten"),
        ({"resample": lambda s, weights: False}, "never resampled"),
        ({"resample": lambda s, weights: 1 / weights.sum() <= s.resample_below * len(weights)}, "*squares*"),
        ({"old_weights": True}, "take the new weights"),
        ({"order": "weigh resample estimate draw"}, "before resampling"),
        ({"mean": lambda poses, weights: poses[np.argmax(weights)]}, "not the mean"),
        ({"order": "weigh estimate resample"}, "stays empty"),
        ({"draw": lambda f, s, log_odds, *rest: drawn(f, s, 0 * log_odds, *rest)}, "old map is gone"),
        ({"draw": lambda f, s, log_odds, _, p: drawn(f, s, log_odds, np.zeros(3), p)}, "not drawn where"),
        ({"draw": lambda *a: drawn(*a, free=0.0)}, "ever cleared"),
        ({"draw": drawn_twice}, "more than once"),
        ({"give": lambda p, w, m, e: (p, w, e, m)}, "in this order"),
        ({"give": lambda p, w, m, e: (p.tolist(), w, m, e)}, "TypeError"),
    ],
)
def test_a_spoiled_loop_is_told_what_it_leaves_out(change, words):
    verdict = check_filter(loop(**change), my_filter(file="none"))
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


def in_lists(name):
    """A part of the filter as loops write it: lists and tuples, and whole numbers as floats."""

    def part(*arguments):
        answer = BOOK[name](*arguments)
        if name == "cell_of":
            return [(float(row), float(column)) for row, column in answer]
        return tuple(map(np.ndarray.tolist, answer)) if name == "resample" else np.asarray(answer).tolist()

    return part


def test_parts_that_return_lists_tuples_and_float_cells_drive_as_well():
    hall = pfslam.load("hall")
    paths = [
        drive(step, my_filter("none", **parts), hall, seconds=12.0, particles=10).trajectory.poses
        for parts in ({}, {name: in_lists(name) for name in BOOK})
    ]
    np.testing.assert_array_equal(*paths)


def test_a_stub_is_not_kept(tmp_path, capsys):
    def move(poses):
        return ...  # your turn

    keep(move, tmp_path / "my_filter.py")
    assert "not written yet" in capsys.readouterr().out
    assert not (tmp_path / "my_filter.py").exists()
