"""Checks of the exercises of chapter 04: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pfslam_book.ch04.weights import turned_only
from pfslam_book.show.checks import Check, answer_to, compare, hint, is_number, passed

from pfslam.poses import transform_points

# ---- 1: Eq. 8

ORIGIN, RESOLUTION, SHAPE = np.array([-1.3, -0.7]), 0.5, (5, 8)


def _scan(seed: int, outside: bool) -> tuple:
    """Points, map, origin and cell size: several points a cell; if ``outside``, some off each side."""
    rng = np.random.default_rng(seed)
    occupied = rng.random(SHAPE) < 0.4
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[-1, -1] = False
    occupied[1:-1, 1:-1] &= rng.random((SHAPE[0] - 2, SHAPE[1] - 2)) < 0.7
    cells = rng.integers(0, (SHAPE[1], SHAPE[0]), (25, 2))
    if outside:
        x, y = SHAPE[::-1]
        low = [[-1, 2], [-1, 3], [-7, 1], [3, -1], [5, -1], [6, -1], [2, -1]]
        cells = np.concatenate([cells[:10], low, [[x, 1], [x, 2], [2, y], [40, 40], [x, y]]])
        cells = rng.permutation(cells)
    return ORIGIN + (cells + rng.uniform(0.1, 0.9, cells.shape)) * RESOLUTION, occupied, ORIGIN, RESOLUTION


def _on_edges() -> tuple:
    """Points on the lower edges of cells, the grid's own upper edge among them, with exact binary fractions."""
    origin, cells = (
        np.array([-1.25, -0.75]),
        np.array([[1, 0], [1, 1], [3, 2], [6, 4], [5, 3], [8, 2], [2, 5]]),
    )
    occupied = np.zeros(SHAPE, dtype=bool)
    occupied[[0, 2, 3], [1, 3, 5]] = True
    return origin + 0.5 * cells, occupied, origin, 0.5


def counted(points, occupied, origin, resolution, rounding=np.floor, find=None) -> int:
    """Eq. 8, or what becomes of it with another rounding, or with another way ``find`` to look a cell up."""
    ix, iy = rounding((np.asarray(points) - origin) / resolution).astype(int).T
    if find is not None:
        return int(np.sum(find(occupied, ix, iy)))
    rows, columns = occupied.shape
    inside = (ix >= 0) & (ix < columns) & (iy >= 0) & (iy < rows)
    return int(occupied[iy[inside], ix[inside]].sum())


def _distinct(occupied, ix, iy):
    rows, columns = occupied.shape
    inside = (ix >= 0) & (ix < columns) & (iy >= 0) & (iy < rows)
    drawn = np.zeros_like(occupied)
    drawn[iy[inside], ix[inside]] = True
    return drawn & occupied


def _lacking(left=True, bottom=True) -> Callable:
    """Forget to test the lower bound in x, in y, or in both."""

    def find(occupied, ix, iy):
        keep = (ix < occupied.shape[1]) & (iy < occupied.shape[0]) & (ix >= -occupied.shape[1])
        keep &= (left | (ix >= 0)) & (bottom | (iy >= 0))
        return occupied[iy[keep], ix[keep]]

    return find


def _limits_swapped(occupied, ix, iy):
    columns, rows = occupied.shape
    inside = (ix >= 0) & (ix < columns) & (iy >= 0) & (iy < rows)
    return occupied[iy[inside], ix[inside]]


def _clipped(occupied, ix, iy):
    return occupied[np.clip(iy, 0, occupied.shape[0] - 1), np.clip(ix, 0, occupied.shape[1] - 1)]


def _mirrored(occupied, ix, iy):
    ix, iy = np.abs(ix), np.abs(iy)
    keep = (ix < occupied.shape[1]) & (iy < occupied.shape[0])
    return occupied[iy[keep], ix[keep]]


def _wrapped(occupied, ix, iy):
    return occupied[iy % occupied.shape[0], ix % occupied.shape[1]]


def _outside_too(occupied, ix, iy):
    rows, columns = occupied.shape
    outside = (ix < 0) | (ix >= columns) | (iy < 0) | (iy >= rows)
    return outside | _clipped(occupied, ix, iy)


def _until_outside(give_up: bool) -> Callable:
    """Stop at the first point outside: keep the count so far, or give up and return 0."""

    def find(occupied, ix, iy):
        rows, columns = occupied.shape
        outside = (ix < 0) | (ix >= columns) | (iy < 0) | (iy >= rows)
        first = int(np.argmax(outside)) if outside.any() else len(ix)
        return [] if give_up and outside.any() else occupied[iy[:first], ix[:first]]

    return find


def _found(find: Callable, rounding=np.floor) -> Callable:
    return lambda p, m, o, r: counted(p, m, o, r, rounding, find)


COUNT_INSIDE: list[tuple[Callable, str]] = [
    (IndexError, "IndexError for points inside the grid: the first index of the array is the row, iy; then ix."),
    (_found(_distinct), "Two points in one wall cell are two points. You count the cells; Eq. 8 counts the points."),
    (lambda p, m, o, r: counted(p, m, o, r, np.rint), "A cell begins at its lower edge: floor, not round. Rounding "
     "moves half of all points to a neighbour."),
    (lambda p, m, o, r: counted(np.asarray(p) - r / 2, m, o, r), "Half a cell off: the origin is the outer corner of "
     "cell [0, 0], not its middle."),
    (lambda p, m, o, r: counted(p, m, o, r, np.ceil), "A cell begins at its lower edge: floor, not ceil."),
    (lambda p, m, o, r: counted(np.asarray(p)[:, ::-1], m, o[::-1], r), "Rows are y: the array is occupied[iy, ix]."),
    (lambda p, m, o, r: counted(p, m, 0.0 * o, r), "Cell [0, 0] lies at the origin of the grid: subtract it before you "
     "divide."),
    (lambda p, m, o, r: counted(p, m, -o, r), "Subtract the origin: you added it."),
    (lambda p, m, o, r: counted(p, m[::-1], o, r), "Row 0 is the lowest y: do not turn the rows over."),
    (lambda p, m, o, r: counted(p, m[:, ::-1], o, r), "Column 0 is the lowest x: do not turn the columns over."),
    (lambda p, m, o, r: counted(p, m, o[::-1], r), "The two coordinates of the origin have changed places."),
    (lambda p, m, o, r: counted(np.floor(p / r) - np.floor(o / r) + 0.5, m, 0.0, 1.0), "You round the point and the "
     "origin separately. Subtract first, and round the difference once."),
    (_found(_limits_swapped), "The number of columns limits x and the number of rows limits y: they have changed "
     "places."),
    (lambda p, m, o, r: int(m.sum()), "You count the occupied cells of the map. Count the points that fall on them."),
    (lambda p, m, o, r: counted(p, ~m, o, r), "You counted the points on free cells."),
    (lambda p, m, o, r: len(p), "You counted the points inside the grid. Count those on occupied cells."),
    (lambda p, m, o, r: counted(p, m, o, r) / len(p), "That is the share of the points. Their number is asked for."),
]  # fmt: skip
COUNT_OUTSIDE: list[tuple[Callable, str]] = [
    (IndexError, "Right inside the grid, but some points lie outside. They must score 0, not stop the robot. A grid of "
     "n columns has the indices 0 to n - 1."),
    *((_found(find), "Right inside the grid, but points beyond its left or lower edge score too: index -1 is the last "
       "column or row in Python. Test both bounds, of x and of y.")
      for find in (_lacking(), _lacking(bottom=False), _lacking(left=False))),
    (_found(_clipped), "Right inside the grid, but points outside it score at its edge: do not clip."),
    (_found(_outside_too), "Right inside the grid, but you count every point outside it as well. They score nothing."),
    (_found(_mirrored), "Right inside the grid, but points beyond its lower edges are mirrored into it by abs()."),
    (_found(_wrapped), "Right inside the grid, but points beyond one edge come in again at the opposite one: do not "
     "take the remainder."),
    *((_found(_until_outside(give_up)), "Right inside the grid, but you stop at the first point outside. Skip that "
       "point alone, and go on.") for give_up in (False, True)),
    (lambda p, m, o, r: counted(p, m, o, r, np.trunc), "int() rounds towards zero, so a point just outside the lower "
     "edge comes to lie in cell 0. floor rounds down."),
    (_found(_lacking(), np.trunc), "int() rounds towards zero and -1 is the last column: use floor and test both "
     "bounds."),
    (_found(_clipped, np.trunc), "Right inside the grid, but points outside it score at its edge: do not clip."),
    (lambda p, m, o, r: counted(p, m, o, r, lambda cells: np.ceil(cells) - 1), "A point on the lower edge of a cell "
     "belongs to that cell. With ceil - 1 it falls into the one before: floor."),
]  # fmt: skip


def check_count_on_walls(count_on_walls) -> Check:
    """Whether ``count_on_walls(points, occupied, origin, resolution)`` counts as Eq. 8 does."""
    inside, outside = ([_scan(seed, beyond) for seed in (1, 2, 3)] for beyond in (False, True))
    outside.append(_on_edges())
    praise = "Points on walls, however many a cell; what lies outside the grid scores nothing."
    verdict = compare(count_on_walls, counted, inside, mistakes=COUNT_INSIDE)
    return verdict and compare(count_on_walls, counted, outside, mistakes=COUNT_OUTSIDE, praise=praise)


# ---- 2: the best of the window

STEPS = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def chosen(scores, steps) -> int:
    """The index of the best score; of equals, the one with the shortest step."""
    return int(np.lexsort((np.sum(np.square(steps), axis=1), -np.asarray(scores)))[0])


def _windows() -> list[tuple]:
    """Windows with nothing in them, one peak, three ties, and two that are random and out of order."""
    empty = np.zeros(len(STEPS))

    def with_peaks(base, height, *steps):
        scores = base.copy()
        for step in steps:
            scores[np.flatnonzero(np.all(np.equal(STEPS, step), axis=1))] = height
        return scores

    # (2, 0, 0) and (0, 1, 2) are shorter than (1, 1, 1) in another norm, or in metres and radians
    ties = with_peaks(empty, 40.0, (-2, -2, 1), (1, 1, 1), (2, 0, 0), (0, 1, 2), (2, 2, 2))
    lone = with_peaks(with_peaks(empty, 40.0, (2, -2, 2)), 39.0, (0, 0, 0))
    close = with_peaks(with_peaks(empty + 12.5, 38.55, (-2, 2, 2)), 38.5, (0, 0, 0))
    windows = [(empty, STEPS), (ties, STEPS), (lone, STEPS), (close, STEPS)]
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        order, scores = rng.permutation(len(STEPS)), rng.integers(0, 30, len(STEPS)).astype(float)
        steps = STEPS[order]
        far = np.flatnonzero(np.sum(steps**2, axis=1) == 9)[:3]
        scores[[*far, int(np.flatnonzero(np.sum(steps**2, axis=1) == 6)[0])]] = 50.0
        windows.append((scores, steps))
    return windows


def _squares(steps: np.ndarray) -> np.ndarray:
    return np.sum(steps**2, axis=1)


def _nearest(norm: Callable) -> Callable:
    """A choice that settles ties by another length of the steps."""

    def wrong(scores, steps):
        tied = np.flatnonzero(scores == scores.max())
        return tied[np.argmin(norm(steps[tied]))]

    return wrong


CHOOSE_MISTAKES = [
    (lambda s, d: np.argmax(s), "argmax takes the first of equals. On an empty map all scores are 0, and every "
     f"particle jumps to the same corner of the window, step {STEPS[0].tolist()}, at each scan."),
    (lambda s, d: len(s) - 1 - np.argmax(s[::-1]), "You take the last of equals: the particles drift to the other "
     "corner of the window."),
    (lambda s, d: s.max(), "You return the best score. The index of the pose that has it is asked for."),
    (lambda s, d: np.argmin(_squares(d)), "You always stay at the centre. Nearness only settles ties."),
    (lambda s, d: np.argmin(s), "You take the worst score."),
    (_nearest(lambda d: np.abs(d).sum(axis=1)), "Of equals you take the least sum of absolute steps; the least sum of "
     "squares is asked for."),
    (_nearest(lambda d: np.abs(d).max(axis=1)), "Of equals you take the least of the greatest steps; the least sum of "
     "squares is asked for."),
    (_nearest(lambda d: -_squares(d)), "Of equals you take the farthest."),
    (_nearest(lambda d: d.sum(axis=1)), "A step of -2 is as long as one of 2: square it before you add."),
    *((lambda s, d, cost=cost: np.argmax(s - cost * _squares(d)), "You let the length of the step outvote the score. "
       "It settles ties only; a better score wins from any distance.") for cost in (0.5, 0.1, 0.01)),
    (lambda s, d: np.argmin(_squares(d[s == s.max()])), "That is a position among the best, not an index into scores: "
     "look it up, tied[...]."),
    (lambda s, d: np.argmin(_squares(d)) if np.sum(s == s.max()) > 1 else np.argmax(s), "A tie does not mean an empty "
     "map: of the poses that share the best score take the nearest."),
    (_nearest(lambda d: _squares(d * [0.05, 0.05, 0.005])), "You measure the steps in metres and radians. The plain "
     "sum of their squares is asked for."),
    (_nearest(lambda d: _squares(d[:, :2])), "You leave the heading out: all three steps count."),
    (_nearest(lambda d: d[:, 2] ** 2), "You look at the heading alone: all three steps count."),
    (_nearest(lambda d: d.sum(axis=1) ** 2), "Square each step before you add; you square the sum."),
    (lambda s, d: np.lexsort((_squares(d), s))[0], "You take the worst score."),
    (lambda s, d: len(s) // 2 if s.max() == 0 else np.argmax(s), "An empty map is treated well, but of other equals "
     "you take the first."),
]  # fmt: skip


def check_choose(choose) -> Check:
    """Whether ``choose(scores, steps)`` takes the best perturbation, and of equals the one nearest to the centre."""
    scores, steps = _windows()[0]
    answer = answer_to(choose, (scores, steps), 0)
    if isinstance(answer, Check):
        return hint("An index is asked for, one whole number.") if "shape" in answer.message else answer
    if not (is_number(answer) and answer == int(answer) and 0 <= answer < len(STEPS)):
        return hint(f"An index from 0 to {len(STEPS) - 1} is asked for; your function returns {answer}.")
    praise = "An empty map moves no particle, a tie moves a particle as little as possible."
    verdict = compare(choose, chosen, _windows(), mistakes=CHOOSE_MISTAKES, praise=praise)
    if verdict or "your function returns" not in verdict.message or answer == chosen(scores, steps):
        return verdict
    return hint("With all scores equal the scan says nothing: stay at the step (0, 0, 0).")


# ---- 3: a test of the transform


def turned_backwards(pose, points_b):
    """A faulty ``transform_points``: it turns by minus the heading."""
    return transform_points([pose[0], pose[1], -pose[2]], points_b)


def shifted_first(pose, points_b):
    """A faulty ``transform_points``: it shifts, then turns, so the pose swings about the origin."""
    return transform_points([0.0, 0.0, pose[2]], np.asarray(points_b) + np.asarray(pose)[:2])


def mirrored(pose, points_b):
    """A faulty ``transform_points``: left and right of the robot are exchanged."""
    return transform_points(pose, np.asarray(points_b) * [1.0, -1.0])


def never_turned(pose, points_b):
    """A faulty ``transform_points``: it ignores the heading."""
    return transform_points([pose[0], pose[1], 0.0], points_b)


def without_y(pose, points_b):
    """A faulty ``transform_points``: it takes every point to lie straight ahead."""
    return transform_points(pose, np.asarray(points_b) * [1.0, 0.0])


def y_before_x(pose, points_b):
    """A faulty ``transform_points``: it exchanges the two coordinates of its answer."""
    return transform_points(pose, points_b)[:, ::-1]


def x_for_both(pose, points_b):
    """A faulty ``transform_points``: it adds the x of the pose to both coordinates."""
    return transform_points([pose[0], pose[0], pose[2]], points_b)


def without_cosine(pose, points_b):
    """A faulty ``transform_points``: it leaves out the terms with a cosine."""
    x, y = np.asarray(points_b, dtype=float).T
    s = np.sin(pose[2])
    return np.column_stack([pose[0] - s * y, pose[1] + s * x])


def small_angle(pose, points_b):
    """A faulty ``transform_points``: it takes the angle for its sine and 1 for its cosine."""
    x, y = np.asarray(points_b, dtype=float).T
    return np.column_stack([pose[0] + x - pose[2] * y, pose[1] + pose[2] * x + y])


def in_degrees(pose, points_b):
    """A faulty ``transform_points``: it takes the heading for degrees."""
    return transform_points([pose[0], pose[1], np.deg2rad(pose[2])], points_b)


FAULTS = (
    (turned_only, "ignores x and y of the pose. With it all particles of one heading score alike, wherever they stand, "
     "and the map still looks fine. Test a pose away from the origin."),
    (never_turned, "ignores the heading. Test a heading other than 0."),
    (without_y, "drops the y of every point. Test a point that is not straight ahead."),
    (mirrored, "exchanges left and right. Test a point that is not straight ahead."),
    (turned_backwards, "turns the wrong way round. Test a heading that is neither 0 nor 180 degrees."),
    (shifted_first, "shifts first and turns then. Test x, y and heading together, not one at a time."),
    (in_degrees, "takes the heading for degrees. Test a heading of about 1 rad."),
    (without_cosine, "forgets the cosines. At a right angle they are 0, so test another heading."),
    (small_angle, "takes the angle for its sine and 1 for its cosine, which is nearly right for small headings. Test a "
     "large one, and compare closely."),
    (x_for_both, "adds the x of the pose to both coordinates. Test a pose whose x and y differ, and compare both."),
    (y_before_x, "returns y before x. Compare both coordinates, not only their sum or their lengths."),
)  # fmt: skip


def check_transform_test(transform_works) -> Check:
    """Whether ``transform_works(transform)`` accepts the right transform and rejects the faulty ones.

    A test may return True or False, or be written with ``assert`` and return nothing.
    """
    accepted = _judgement(transform_works, transform_points)
    if isinstance(accepted, Check):
        return accepted
    if not accepted:
        return hint(
            "Your test rejects the right function. Work the points out by hand: turn by the heading, then shift."
        )
    for faulty, words in FAULTS:
        accepted = _judgement(transform_works, faulty)
        if isinstance(accepted, Check):
            return accepted
        if accepted:
            return hint(f"Your test lets a function pass that {words}")
    return passed(f"Your test accepts the right function and catches {len(FAULTS)} wrong ones.")


def _judgement(transform_works, transform) -> bool | Check:
    """Whether a reader's test accepts a transform: by its answer, or because none of its assertions failed."""

    def asked(candidate):
        try:
            answer = transform_works(candidate)
        except AssertionError:
            return False
        return True if answer is None else answer

    answer = answer_to(asked, (transform,), True)
    if isinstance(answer, Check):
        return answer
    if isinstance(answer, bool | np.bool_):
        return bool(answer)
    if isinstance(answer, np.ndarray | list | tuple):
        return hint(
            "One True or False is asked for; your test returns several. Join them with np.all or np.allclose."
        )
    return hint(f"True or False is asked for, or assertions; your test returns {answer!r}.")
