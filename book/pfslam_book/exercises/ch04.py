"""Exercises of chapter 04."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

from pfslam.poses import transform_points

rngs = [np.random.default_rng(seed) for seed in range(1, 5)]

# ---- 1: Eq. 8


def scan_case(rng, origin, resolution, shape) -> tuple:
    """Points, several to a cell and some beyond every edge; a map; its origin and the size of its cells."""
    (rows, columns), origin = shape, np.array(origin)
    occupied = rng.random(shape) < 0.4
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    inside = rng.integers(0, (columns, rows), (12, 2))
    below = [[-1, 2], [-1, 3], [1 - columns, 1], [3, -1], [2, -1]]
    beyond = [[columns, 1], [columns, 2], [2, rows], [40, 40], [columns, rows]]
    cells = rng.permutation(np.concatenate([inside, inside[:4], below, beyond]))
    return origin + (cells + rng.uniform(0.1, 0.9, cells.shape)) * resolution, occupied, origin, resolution


def edge_case() -> tuple:
    """Points on the lower edges of cells, the grid's own upper edge among them, in exact binary fractions."""
    origin = np.array([-1.25, -0.75])
    cells = np.array([[1, 0], [1, 1], [3, 2], [6, 4], [5, 3], [8, 2], [2, 5]])
    occupied = np.zeros((5, 8), dtype=bool)
    occupied[[0, 2, 3], [1, 3, 5]] = True
    return origin + 0.5 * cells, occupied, origin, 0.5


def within(ix, iy, rows, columns):
    return (ix >= 0) & (ix < columns) & (iy >= 0) & (iy < rows)


def count(points, occupied, origin, resolution, to_cell=np.floor, keep=within, clip=False, once=False):
    """Eq. 8, or what becomes of it with another rounding, other limits, or each cell counted once."""
    ix, iy = to_cell((points - np.array(origin)) / resolution).astype(int).T
    kept = keep(ix, iy, *occupied.shape)
    cells = np.column_stack([iy[kept], ix[kept]])
    if clip:
        cells = np.clip(cells, 0, np.array(occupied.shape) - 1)
    return int(occupied[tuple((np.unique(cells, axis=0) if once else cells).T)].sum())


def counting(**change):
    """A count with one thing changed."""
    return lambda *case: count(*case, **change)


check_count_on_walls = Exercise(
    right=count,
    cases=[
        scan_case(rngs[0], (-1.3, -0.7), 0.5, (5, 8)),
        scan_case(rngs[1], (0.4, -2.1), 0.05, (7, 6)),
        scan_case(rngs[2], (-3.2, 1.9), 0.2, (6, 9)),
        edge_case(),
    ],
    mistakes={
        "IndexError: the first index of the array is the row, iy, and then comes ix. Points outside the grid must be "
        "left out before you look into it; n columns have the indices 0 to n - 1.": IndexError,
        "A cell begins at its lower edge: floor, not round. Rounding moves half of all points into a neighbour.": (
            counting(to_cell=np.rint)
        ),
        "Points beyond the left and the lower edge score too: in Python, index -1 is the last column or row. Test "
        "both bounds, of x and of y.": counting(keep=lambda ix, iy, h, w: (ix < w) & (iy < h)),
        "Points outside the grid score at its edge: leave them out instead of clipping them.": (
            counting(keep=lambda ix, iy, h, w: ix == ix, clip=True)
        ),
        "Two points in one wall cell are two points. You count the cells; Eq. 8 counts the points.": (
            counting(once=True)
        ),
        "You take the column for the row, so your map is transposed. The first index of the map is the row, and it "
        "comes from y.": (
            lambda p, m, o, r: count(p, m.T, o, r),
            lambda p, m, o, r: count(
                p, m.T, o, r, keep=lambda ix, iy, h, w: within(ix, iy, h, w) & within(ix, iy, w, h)
            ),
        ),
    },
    praise="Points on walls, however many to a cell; what lies outside the grid scores nothing.",
)

# ---- 2: the best of the window

STEPS = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def window_case(peaks, height, second=(0, 0, 0), behind=20.0, rng=None) -> tuple:
    """A window whose best score stands at each of ``peaks``; another step is ``behind`` them by so much."""
    steps = STEPS if rng is None else rng.permutation(STEPS)
    scores = np.zeros(len(steps)) if rng is None else height * rng.integers(0, 10, len(steps)) / 20
    scores[np.all(steps == second, axis=1)] = height - behind
    for peak in peaks:
        scores[np.all(steps == peak, axis=1)] = height
    return scores, steps


def squares(steps):
    return (steps**2).sum(axis=1)


def nearest_of_best(length):
    """The best score; of equals the least by some length of the steps."""
    return lambda s, d: np.flatnonzero(s == s.max())[np.argmin(length(d[s == s.max()]))]


check_choose = Exercise(
    right=nearest_of_best(squares),
    cases=[
        window_case([], 0.0, behind=0.0),  # an empty map
        window_case([(-2, -2, 1), (1, 1, 1), (2, 0, 0), (0, 1, 2), (2, 2, 2)], 40.0),
        window_case([(2, -2, 2)], 0.03, behind=1e-7),  # a better score is better, by however little
        window_case([(-2, 1, -2), (2, 2, 1), (1, -2, -1), (0, 0, 2), (-1, -1, 1)], 50.0, rng=rngs[0]),
        window_case([(2, 1, 0), (0, 2, -2), (1, 2, -1)], 600.0, rng=rngs[1]),
    ],
    mistakes={
        "argmax takes the first of equals. On an empty map all scores are 0, and at each scan every particle jumps "
        f"to the same corner of the window, step {STEPS[0].tolist()}.": lambda s, d: np.argmax(s),
        "You return the best score. The index of the pose that has it is asked for.": lambda s, d: s.max(),
        "That is a position among the best, not an index into scores: look it up, tied[...].": (
            lambda s, d: np.argmin(squares(d[s == s.max()]))
        ),
        "You let the length of the step outvote the score. It only settles ties; a better score wins from any "
        "distance, and by however little.": lambda s, d: np.argmax(s - 0.001 * squares(d)),
        "Of equals you take the least sum of absolute steps; the least sum of squares is asked for.": (
            nearest_of_best(lambda d: np.abs(d).sum(axis=1))
        ),
    },
    praise="An empty map moves no particle, and a tie moves a particle as little as possible.",
)

# ---- 3: a test of the transform

RIGHT = "that is right"


def transforms():
    """The right function and wrong ones, each with what one would say of it."""
    change = np.multiply
    for words, function in {
        RIGHT: transform_points,
        "that ignores x and y of the pose (all positions score alike)": (
            lambda pose, p: transform_points(change(pose, [0, 0, 1]), p)
        ),
        "that ignores the heading": lambda pose, p: transform_points(change(pose, [1, 1, 0]), p),
        "that turns the wrong way round": lambda pose, p: transform_points(change(pose, [1, 1, -1]), p),
        "that exchanges left and right of the robot": lambda pose, p: transform_points(
            pose, p * np.array([1, -1])
        ),
        "that shifts first and turns then": lambda pose, p: transform_points([0, 0, pose[2]], p + pose[:2]),
        "that takes the heading for degrees": (
            lambda pose, p: transform_points(change(pose, [1, 1, np.pi / 180]), p)
        ),
        "that adds the x of the pose to both coordinates": (
            lambda pose, p: transform_points(pose[[0, 0, 2]], p)
        ),
        "that takes the angle for its sine and 1 for its cosine": (
            lambda pose, p: p + pose[:2] + pose[2] * p[:, ::-1] * [-1, 1]
        ),
        "that forgets the cosines": lambda pose, p: pose[:2] + np.sin(pose[2]) * p[:, ::-1] * [-1, 1],
        "that returns y before x": lambda pose, p: transform_points(pose, p)[:, ::-1],
    }.items():

        def called(pose, points, function=function):
            return function(np.asarray(pose, dtype=float), np.asarray(points, dtype=float))

        called.words = f"= one {words}"  # type: ignore[attr-defined]
        yield called


def moves(pose, point, expected):
    """A test that tries one point."""
    return lambda transform: bool(np.allclose(transform(np.array(pose), np.array([point])), [expected]))


check_transform_test = Exercise(
    right=lambda transform: transform.words == f"= one {RIGHT}",
    cases=[(transform,) for transform in transforms()],
    mistakes={
        "Your test raises an AssertionError. Return False where a function is wrong.": AssertionError,
        "Your test accepts every function, also those that do nothing right.": lambda transform: True,
        "Your test rejects every function, the right one too. Work its points out by hand: turn by the heading, "
        "then shift.": lambda transform: False,
        "With a heading of 0 nothing turns, and many wrong functions pass. Test a heading that is no multiple of a "
        "right angle.": moves([3.0, 1.0, 0.0], [2.0, 1.0], [5.0, 2.0]),
        "At the origin nothing shifts, and many wrong functions pass. Test a pose with x, y and heading, all three.": (
            moves([0.0, 0.0, np.pi / 2], [2.0, 1.0], [-1.0, 2.0])
        ),
    },
    praise="Your test accepts the right function and catches ten wrong ones.",
)
