"""Checks of the exercises of chapter 04. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np

from pfslam.poses import transform_points
from pfslam.teaching.ch04.weights import turned_only
from pfslam.teaching.show.checks import Check, attempt, hint, is_number, is_unanswered, passed, unanswered

ORIGIN, RESOLUTION = (-1.0, -1.0), 0.5
OCCUPIED = np.zeros((4, 6), dtype=bool)
for ix, iy in ((4, 1), (0, 3), (5, 0), (5, 3), (2, 1)):
    OCCUPIED[iy, ix] = True
# Three points on walls; three on free cells, each of which a common slip takes for a wall; two outside the grid.
INSIDE = np.array([[1.4, -0.1], [-0.7, 0.7], [1.7, -0.6], [1.2, 0.7], [0.7, -0.9], [-0.3, 0.2]])
OUTSIDE = np.array([[-1.1, 0.6], [0.1, 5.0]])
ON_WALLS = 3


def check_count_on_walls(count_on_walls) -> Check:
    """Whether ``count_on_walls(points, occupied, origin, resolution)`` counts as Eq. 8 does."""
    answer = attempt(count_on_walls, np.concatenate([INSIDE, OUTSIDE]), OCCUPIED, ORIGIN, RESOLUTION)
    if is_unanswered(answer):
        return unanswered()
    inside = attempt(count_on_walls, INSIDE, OCCUPIED, ORIGIN, RESOLUTION)
    if isinstance(inside, Check):
        if "IndexError" in inside.message:
            return hint(
                "IndexError for points inside the grid: the first index of the array is the row, iy; then ix."
            )
        return inside
    if is_number(inside) and inside == ON_WALLS:
        return _outside(answer)
    if not is_number(inside):
        return hint(f"One whole number is asked for; your function returns {inside!r}.")
    if inside == _count(np.rint):
        return hint("A cell begins at its lower edge: floor, not round. Rounding moves half of all points.")
    if inside == _count(np.floor, transposed=True):
        return hint("Rows are y: the array is occupied[iy, ix].")
    if inside == _count(np.floor, origin=(0.0, 0.0)):
        return hint("Cell [0, 0] lies at the origin of the grid: subtract it before you divide.")
    if inside == len(INSIDE):
        return hint("You counted the points inside the grid. Count those on occupied cells.")
    return hint(f"Of six points inside the grid three lie on walls; your function counts {inside}.")


def _outside(answer) -> Check:
    """The verdict on a function that is right for points inside the grid."""
    if isinstance(answer, Check) and "IndexError" in answer.message:
        return hint(
            "Right inside the grid, but two points lie outside. They must score 0, not stop the robot."
        )
    if isinstance(answer, Check):
        return answer
    if is_number(answer) and answer == ON_WALLS:
        return passed("Three of eight points lie on walls; the two outside the grid score nothing.")
    return hint(
        "Right inside the grid, but a point beyond the left edge scores too: index -1 is the last column in "
        "Python. Test both bounds, and do not clip to the edge."
    )


def _count(rounding, transposed: bool = False, origin=ORIGIN) -> int:
    """What a faulty count makes of the points inside the grid."""
    ix, iy = rounding((INSIDE - origin) / RESOLUTION).astype(int).T
    rows, columns = (ix, iy) if transposed else (iy, ix)
    inside = (rows >= 0) & (columns >= 0) & (rows < OCCUPIED.shape[0]) & (columns < OCCUPIED.shape[1])
    return int(OCCUPIED[rows[inside], columns[inside]].sum())


STEPS = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
CENTRE = len(STEPS) // 2


def _at(*step: int) -> int:
    return int(np.flatnonzero(np.all(np.equal(STEPS, step), axis=1))[0])


def check_choose(choose) -> Check:
    """Whether ``choose(scores, steps)`` takes the best perturbation, and of equals the one nearest to the centre."""
    empty = np.zeros(len(STEPS))
    on_empty = attempt(choose, empty, STEPS)
    if is_unanswered(on_empty):
        return unanswered()
    peak, tied = empty.copy(), empty.copy()
    peak[_at(1, -2, 0)] = 40
    tied[[_at(-2, -2, 1), _at(1, 0, 1), _at(2, 2, 2)]] = 40
    answers = [on_empty, attempt(choose, peak, STEPS), attempt(choose, tied, STEPS)]
    for answer in answers:
        if isinstance(answer, Check):
            return answer
    if not all(is_number(a) and a == int(a) and 0 <= a < len(STEPS) for a in answers):
        return hint(
            f"An index from 0 to {len(STEPS) - 1} is asked for; your function returns {answers[0]!r}."
        )
    if answers[1] == 40:
        return hint("You return the best score. The index of the pose that has it is asked for.")
    if answers[1] == CENTRE:
        return hint(
            "One pose scores 40, all others 0, and you stay at the centre. Nearness only settles ties."
        )
    if answers[1] != _at(1, -2, 0):
        return hint("One pose scores 40, all others 0, and you do not return its index.")
    if (on_empty, answers[2]) == (0, _at(-2, -2, 1)):
        return hint(
            "argmax takes the first of equals. On an empty map all scores are 0, and every particle jumps to "
            f"the same corner of the window, step {STEPS[0].tolist()}, at each scan."
        )
    if (on_empty, answers[2]) == (len(STEPS) - 1, _at(2, 2, 2)):
        return hint("You take the last of equals: the particles drift to the other corner of the window.")
    if on_empty != CENTRE:
        return hint("With all scores equal the scan says nothing: stay at the step (0, 0, 0).")
    if answers[2] != _at(1, 0, 1):
        return hint("Of three equal scores you do not take the one whose step is shortest.")
    return passed("An empty map moves nobody, a tie moves a particle as little as possible.")


def turned_backwards(pose, points_b):
    """A faulty ``transform_points``: it turns by minus the heading."""
    return transform_points([pose[0], pose[1], -pose[2]], points_b)


def shifted_first(pose, points_b):
    """A faulty ``transform_points``: it shifts, then turns, so the pose swings about the origin."""
    return transform_points([0.0, 0.0, pose[2]], np.asarray(points_b) + np.asarray(pose)[:2])


FAULTS = (
    (turned_only, "ignores x and y of the pose. With it all particles of one heading score alike, wherever they stand, "
     "and the map still looks fine. Test a pose away from the origin."),
    (turned_backwards, "turns the wrong way round. Test a heading that is neither 0 nor 180 degrees."),
    (shifted_first, "shifts first and turns then. Test x, y and heading together, not one at a time."),
)  # fmt: skip


def check_transform_test(transform_works) -> Check:
    """Whether ``transform_works(transform)`` accepts the right transform and rejects three faulty ones."""
    answer = attempt(transform_works, transform_points)
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    if not isinstance(answer, bool | np.bool_):
        return hint(f"True or False is asked for; your test returns {answer!r}.")
    if not answer:
        return hint(
            "Your test rejects the right function. Work the points out by hand: turn by the heading, then shift."
        )
    for faulty, words in FAULTS:
        found = attempt(transform_works, faulty)
        if isinstance(found, Check):
            return found
        if found:
            return hint(f"Your test lets a function pass that {words}")
    return passed("Your test accepts the right function and catches three wrong ones.")
