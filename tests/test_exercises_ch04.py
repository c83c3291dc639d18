"""Exercises of chapter 04: right answers in many styles, wrong ones and the words for each."""

import numpy as np
import pytest

from pfslam.correlation import map_correlation
from pfslam.grid import GridSpec
from pfslam.teaching import ch04

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
        (ch04.check_choose, choose_in_a_loop),
        (ch04.check_choose, lambda s, d: np.float32(choose_in_a_loop(s, d))),
        (ch04.check_choose, lambda s, d: np.array([choose_in_a_loop(s, d)])),
        (ch04.check_choose, lambda s, d: np.argmax(s * 1e6 - (np.abs(d) ** 2).sum(axis=1))),
        (ch04.check_choose, lambda s, d: min(range(len(s)), key=lambda k: (-s[k], (d[k] ** 2).sum()))),
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


WRONG_COUNTS = [
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

WRONG_TESTS = [
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
