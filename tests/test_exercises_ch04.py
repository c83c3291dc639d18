"""Exercises of chapter 04: right answers in many styles, wrong ones and the words for each."""

import math

import numpy as np
import pytest
from notebook_cells import check_nonsense_is_named
from pfslam_book import ch04

from pfslam.correlation import map_correlation
from pfslam.grid import GridSpec

CHECKS = [ch04.check_count_on_walls, ch04.check_choose, ch04.check_transform_test]


@pytest.mark.parametrize("check", CHECKS)
def test_nonsense_is_named_and_never_raises(check):
    check_nonsense_is_named(check, -7.0, 2)


# ---- right answers: loops, lists, float32, the package, other containers, assertions


def count_in_a_loop(points, occupied, origin, resolution):
    count = 0
    for x, y in points.tolist():
        ix, iy = int((x - origin[0]) // resolution), int((y - origin[1]) // resolution)
        if 0 <= iy < len(occupied) and 0 <= ix < len(occupied[0]):
            count += bool(occupied[iy][ix])
    return count


def count_float32(points, occupied, origin, resolution):
    return np.float32(count_in_a_loop(np.asarray(points, np.float32), occupied, origin, resolution))


def count_complex(points, occupied, origin, resolution):
    z = (points[:, 0] + 1j * points[:, 1] - complex(*origin)) / resolution
    walls = {(int(ix), int(iy)) for iy, ix in zip(*np.nonzero(occupied), strict=True)}
    return [sum((int(np.floor(p.real)), int(np.floor(p.imag))) in walls for p in z)]


def choose_in_a_loop(scores, steps):
    best = 0
    for k, (score, step) in enumerate(zip(scores.tolist(), steps.tolist(), strict=True)):
        if (score, -sum(s * s for s in step)) > (scores[best], -sum(s * s for s in steps[best])):
            best = k
    return best


def count_in_histogram(points, occupied, origin, resolution):
    edges = [low + resolution * np.arange(n + 1) for low, n in zip(origin, occupied.shape[::-1], strict=True)]
    inside = np.all(points < [edge[-1] for edge in edges], axis=1)  # NumPy's last bin has both its edges
    return int(np.histogram2d(*points[inside].T, bins=edges)[0].T[occupied].sum())


def count_by_padding(points, occupied, origin, resolution):
    walls = np.pad(occupied, 1)
    columns, rows = np.clip(
        np.floor((points - origin) / resolution) + 1, 0, np.array(walls.shape[::-1]) - 1
    ).T
    return walls[rows.astype(int), columns.astype(int)].tolist().count(True)


def count_in_sets(points, occupied, origin, resolution):
    walls = set(map(tuple, np.argwhere(occupied)))
    return sum(tuple(cell) in walls for cell in np.floor_divide(points - origin, resolution)[:, ::-1])


def choose_by_lexsort(scores, steps):
    return np.lexsort([(steps**2).sum(axis=1), -scores])[0]


def works_by_complex_numbers(transform):
    pose, points = np.array([3.0, -1.0, 2.1]), np.random.default_rng(1).normal(size=(5, 2))
    moved = complex(*pose[:2]) + np.exp(1j * pose[2]) * (points @ [1, 1j])
    return np.allclose(np.asarray(transform(pose, points)) @ [1, 1j], moved)


def works_by_matrices(transform):
    c, s = np.cos(-2.2), np.sin(-2.2)
    T_wb = np.array([[c, -s, 0.4], [s, c, 5.0], [0, 0, 1]])
    points = np.array([[1.0, 2.0], [-3.0, 0.5]])
    expected = (T_wb @ np.vstack([points.T, [1, 1]]))[:2].T
    return np.max(np.abs(transform(np.array([0.4, 5.0, -2.2]), points) - expected)) < 1e-9


def works_there_and_back(transform):
    pose, points = np.array([-2.0, 4.0, 1.1]), np.array([[2.0, 1.0], [0.0, -1.0]])
    dx, dy = (np.asarray(transform(pose, points)) - pose[:2]).T
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for (x, y), back in zip(points.tolist(), zip(c * dx + s * dy, c * dy - s * dx, strict=True), strict=True):
        if math.dist((x, y), back) > 1e-6:
            return False
    return True


def works_in_float32(transform):
    found = np.float32(transform(np.float32([3, 1, 0.7]), np.float32([[2, 1]]))).tolist()[0]
    return all(math.isclose(a, b, rel_tol=1e-4) for a, b in zip(found, [3.8855, 3.0533], strict=True))


def works_in_a_table(transform):
    for (x, y, theta), (px, py), expected in [
        ((3.0, 1.0, 0.7), (2.0, 0.0), (4.5297, 2.2884)),
        ((3.0, 1.0, 0.7), (0.0, 1.0), (2.3558, 1.7648)),
    ]:
        (found,) = transform(np.array([x, y, theta]), np.array([[px, py]]))
        assert [round(float(v), 4) for v in found] == list(expected), "not where it should be"


def works_by_assertions(transform):
    moved = np.asarray(transform(np.array([3.0, 1.0, 0.7]), np.array([[2.0, 0.0], [0.0, 1.0]])))
    c, s = np.cos(0.7), np.sin(0.7)
    assert moved[0] == pytest.approx([3 + 2 * c, 1 + 2 * s])
    np.testing.assert_allclose(moved[1], [3 - s, 1 + c], atol=1e-6)


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch04.check_count_on_walls, count_in_a_loop),
        (ch04.check_count_on_walls, count_float32),
        (ch04.check_count_on_walls, count_complex),
        (ch04.check_count_on_walls, lambda p, m, o, r: map_correlation(m, GridSpec(o, r, m.shape), p)),
        (ch04.check_count_on_walls, count_in_histogram),
        (ch04.check_count_on_walls, count_by_padding),
        (ch04.check_count_on_walls, count_in_sets),
        (ch04.check_choose, choose_in_a_loop),
        (ch04.check_choose, choose_by_lexsort),
        (ch04.check_choose, lambda s, d: choose_by_lexsort(np.float32(s), np.float32(d))),
        (
            ch04.check_choose,
            lambda s, d: np.argmin(np.where(s < s.max(), 99, np.abs(d @ [1, 1j, 0]) ** 2 + d[:, 2] ** 2)),
        ),
        (ch04.check_choose, lambda s, d: np.float32(choose_in_a_loop(s, d))),
        (ch04.check_choose, lambda s, d: np.array([choose_in_a_loop(s, d)])),
        (ch04.check_choose, lambda s, d: np.argmax(s * 1e6 - (np.abs(d) ** 2).sum(axis=1))),
        (ch04.check_choose, lambda s, d: min(range(len(s)), key=lambda k: (-s[k], (d[k] ** 2).sum()))),
        (ch04.check_transform_test, works_by_complex_numbers),
        (ch04.check_transform_test, works_by_matrices),
        (ch04.check_transform_test, works_there_and_back),
        (ch04.check_transform_test, works_in_float32),
        (ch04.check_transform_test, works_in_a_table),
        (ch04.check_transform_test, works_by_assertions),
        (ch04.check_transform_test, lambda transform: works_by_assertions(transform) is None),
    ],
)
def test_the_same_in_another_style_is_right_too(check, answer):
    assert check(answer), check(answer)


# ---- wrong answers


def counting(rounding=np.floor, transposed=False, guard="both", move=1.0, cells=False, upside_down=False):
    """A count of points on walls with one thing wrong."""

    def count(points, occupied, origin, resolution):
        ix, iy = rounding((points - np.array(origin) * move) / resolution).astype(int).T
        rows, columns = occupied.shape
        if transposed:
            ix, iy = iy, ix
        keep = np.ones(len(ix), dtype=bool)
        if guard in ("both", "upper"):
            keep = (ix < columns) & (iy < rows)
        if guard == "one too far":
            keep = (ix >= 0) & (iy >= 0) & (ix <= columns) & (iy <= rows)
        if guard == "both":
            keep &= (ix >= 0) & (iy >= 0)
        if guard == "clip":
            ix, iy = np.clip(ix, 0, columns - 1), np.clip(iy, 0, rows - 1)
        found = occupied[::-1] if upside_down else occupied
        if cells:
            return len({(a, b) for a, b in zip(ix[keep], iy[keep], strict=True) if found[b, a]})
        return found[iy[keep], ix[keep]].sum()

    return count


def count_until_outside(points, occupied, origin, resolution):
    count = 0
    for x, y in points:
        ix, iy = int((x - origin[0]) // resolution), int((y - origin[1]) // resolution)
        if not (0 <= iy < occupied.shape[0] and 0 <= ix < occupied.shape[1]):
            return count
        count += occupied[iy, ix]
    return count


def count_by_indices(find):
    """A count by some way to look up the cells ``ix``, ``iy`` in a map of so many ``rows`` and ``columns``."""

    def count(points, occupied, origin, resolution):
        ix, iy = np.floor((points - origin) / resolution).astype(int).T
        return np.sum(find(occupied, ix, iy, *occupied.shape))

    return count


def only(keep):
    return lambda m, ix, iy, rows, columns: m[iy[k := keep(ix, iy, rows, columns)], ix[k]]


def moved_in_place(points, occupied, origin, resolution):
    points -= origin
    return counting()(points, occupied, 0.0, resolution)


WRONG_COUNTS = [
    (counting(lambda cells: np.ceil(cells) - 1), "lower edge"),
    (count_until_outside, "stop at the first point outside"),
    (
        lambda p, m, o, r: count_until_outside(p, m, o, r) * bool(np.all(p >= o)),
        "stop at the first point outside",
    ),
    (count_by_indices(only(lambda ix, iy, h, w: (ix < w) & (iy < h) & (iy >= 0))), "left or lower edge"),
    (count_by_indices(only(lambda ix, iy, h, w: (ix < w) & (iy < h) & (ix >= 0))), "left or lower edge"),
    (
        count_by_indices(only(lambda ix, iy, h, w: (ix < h) & (iy < w) & (ix >= 0) & (iy >= 0))),
        "changed places",
    ),
    (count_by_indices(lambda m, ix, iy, h, w: m[iy % h, ix % w]), "the remainder"),
    (
        count_by_indices(
            lambda m, ix, iy, h, w: np.pad(m, ((0, 8), (0, 8)))[abs(iy) % (h + 8), abs(ix) % (w + 8)]
        ),
        "abs()",
    ),
    (
        count_by_indices(
            lambda m, ix, iy, h, w: np.pad(m, 1, constant_values=True)[
                np.clip(iy + 1, 0, h + 1), np.clip(ix + 1, 0, w + 1)
            ]
        ),
        "every point outside",
    ),
    (lambda p, m, o, r: counting()(p, m[:, ::-1], o, r), "turn the columns over"),
    (lambda p, m, o, r: counting()(p, m, o[::-1], r), "coordinates of the origin"),
    (lambda p, m, o, r: counting()(np.floor(p / r) - np.floor(o / r) + 0.5, m, 0.0 * o, 1.0), "separately"),
    (lambda p, m, o, r: m.sum(), "occupied cells of the map"),
    (lambda *a: str(counting()(*a)), "One number"),
    (moved_in_place, "changes what it is given"),
    (counting(np.rint), "floor, not round"),
    (counting(np.ceil), "floor, not ceil"),
    (lambda p, m, o, r: counting()(p - r / 2, m, o, r), "Half a cell off"),
    (counting(np.trunc), "towards zero"),
    (counting(transposed=True), "occupied[iy, ix]"),
    (counting(transposed=True, guard="none"), "the first index of the array is the row"),
    (counting(move=0.0), "subtract it"),
    (counting(move=-1.0), "you added it"),
    (counting(cells=True), "Eq. 8 counts the points"),
    (counting(upside_down=True), "Row 0 is the lowest y"),
    (counting(guard="upper"), "last column"),
    (counting(guard="clip"), "do not clip"),
    (counting(guard="one too far"), "the indices 0 to n - 1"),
    (lambda p, m, o, r: len(p), "inside the grid"),
    (lambda p, m, o, r: counting()(p, m, o, r) / len(p), "the share of the points"),
    (lambda p, m, o, r: counting()(p, m, o, r) + 1, "off by one"),
    (lambda *arguments: 1 / 0, "ZeroDivisionError"),
    (lambda *arguments: "three", "One number"),
]


def nearest_of_best(norm):
    def choose(scores, steps):
        tied = np.flatnonzero(scores == scores.max())
        return tied[np.argmin(norm(steps[tied].astype(float)))]

    return choose


def random_tie(scores, steps):
    return np.random.default_rng(0).choice(np.flatnonzero(scores == scores.max()))


def doubled_in_place(scores, steps):
    scores *= 2
    return choose_in_a_loop(scores, steps)


WRONG_CHOICES = [
    (lambda s, d: np.argmin((d[s == s.max()] ** 2).sum(axis=1)), "position among the best"),
    (
        lambda s, d: np.argmin((d**2).sum(axis=1)) if (s == s.max()).sum() > 1 else s.argmax(),
        "not mean an empty map",
    ),
    (nearest_of_best(lambda d: ((d * [0.05, 0.05, 0.005]) ** 2).sum(axis=1)), "metres and radians"),
    (nearest_of_best(lambda d: np.hypot(d[:, 0], d[:, 1])), "leave the heading out"),
    (nearest_of_best(lambda d: np.abs(d[:, 2])), "the heading alone"),
    (nearest_of_best(lambda d: d.sum(axis=1) ** 2), "square the sum"),
    (lambda s, d: np.lexsort([(d**2).sum(axis=1), s])[0], "the worst score"),
    (lambda s, d: np.argmax(s - 0.01 * (d**2).sum(axis=1)), "outvote the score"),
    (lambda s, d: np.argmax(s), "first of equals"),
    (lambda s, d: len(s) - 1 - np.argmax(s[::-1]), "last of equals"),
    (lambda s, d: s.max(), "best score"),
    (lambda s, d: np.argmin((d**2).sum(axis=1)), "only settles ties"),
    (nearest_of_best(lambda d: np.abs(d).sum(axis=1)), "absolute steps"),
    (nearest_of_best(lambda d: np.abs(d).max(axis=1)), "greatest steps"),
    (nearest_of_best(lambda d: -np.linalg.norm(d, axis=1)), "the farthest"),
    (lambda s, d: np.argmax(s - 0.5 * (d**2).sum(axis=1)), "outvote the score"),
    (random_tie, "says nothing"),
    (doubled_in_place, "changes what it is given"),
    (lambda s, d: d[np.argmax(s)], "An index"),
    (lambda s, d: -1, "index from 0"),
    (lambda s, d: 0.5 * len(s), "index from 0"),
]


def one_point(pose, expected, point=(2.0, 0.0)):
    return lambda transform: np.allclose(transform(np.array(pose), np.array([point])), [expected])


def both(first, second):
    return lambda transform: bool(first(transform) and second(transform))


TURNING, SHIFTING = one_point([0, 0, np.pi / 2], [0.0, 2.0]), one_point([3.0, 1.0, 0.0], [5.0, 1.0])
AHEAD = one_point([3.0, 1.0, np.pi / 2], [3.0, 3.0])

C, S = np.cos(0.7), np.sin(0.7)
GENERIC = one_point([3.0, 1.0, 0.7], [3 + 2 * C - S, 1 + 2 * S + C], point=(2.0, 1.0))


def close_to(tolerance, pick=lambda found: found):
    """A test that compares part of what it finds, or not closely."""
    expected = np.array([[3 + 2 * C - S, 1 + 2 * S + C]])
    return lambda f: np.allclose(
        pick(f(np.array([3, 1, 0.7]), np.array([[2.0, 1.0]]))), pick(expected), atol=tolerance
    )


WRONG_TESTS = [
    (one_point([3.0, 1.0, np.pi / 2], [2.0, 3.0], point=(2.0, 1.0)), "forgets the cosines"),
    (one_point([2.0, 2.0, 0.7], [2 + 2 * C - S, 2 + 2 * S + C], point=(2.0, 1.0)), "x of the pose to both"),
    (close_to(0.5), "its sine"),
    (close_to(1e-3, pick=lambda found: np.sum(found)), "y before x"),
    (close_to(1e-3, pick=lambda found: found[:, 0]), "x of the pose to both"),
    (
        lambda transform: np.isclose(transform([3, 1, 0.7], np.array([[2.0, 1.0]])), [[3.8855, 3.0533]]),
        "several",
    ),
    (lambda transform: not GENERIC(transform), "rejects the right"),
    (one_point([0.0, 0.0, 0.0], [2.0, 0.0]), "ignores x and y"),
    (TURNING, "ignores x and y"),
    (SHIFTING, "ignores the heading"),
    (AHEAD, "drops the y"),
    (one_point([3.0, 1.0, np.pi], [1.0, 1.0]), "drops the y"),
    (one_point([3.0, 1.0, np.pi], [2.0, 0.0], point=(1.0, 1.0)), "wrong way round"),
    (one_point([3.0, 1.0, 0.0], [4.0, 2.0], point=(1.0, 1.0)), "ignores the heading"),
    (both(TURNING, SHIFTING), "drops the y"),
    (both(both(TURNING, SHIFTING), one_point([0, 0, 0.0], [0.0, 1.0], point=(0.0, 1.0))), "shifts first"),
    (one_point([3.0, 1.0, np.pi / 2], [3.0, -1.0]), "rejects the right"),
    (lambda transform: True, "ignores x and y"),
    (lambda transform: 2.0, "True or False"),
    (lambda transform: 1 / 0, "ZeroDivisionError"),
]


@pytest.mark.parametrize(
    ("check", "answer", "words"),
    [(ch04.check_count_on_walls, *pair) for pair in WRONG_COUNTS]
    + [(ch04.check_choose, *pair) for pair in WRONG_CHOICES]
    + [(ch04.check_transform_test, *pair) for pair in WRONG_TESTS],
)
def test_a_wrong_answer_is_refused_by_name(check, answer, words):
    verdict = check(answer)
    assert verdict.verdict == "wrong"
    assert words in verdict.message
