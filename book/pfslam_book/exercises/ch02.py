"""Exercises of chapter 02."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

from pfslam.grid import LOG_4

rngs = [np.random.default_rng(seed) for seed in range(4)]

# ---- 1: points and their cells


def cell_case(rng, resolution) -> tuple:
    """Points in a grid and beside it, a corner that is no multiple of the cell, and the size of a cell."""
    corner = rng.uniform(-2.0, -1.0, 2)
    cells = np.column_stack([rng.permutation(20)[:7], rng.permutation(20)[:7]]) - 4
    cells[:2] = [[-3, 4], [6, -1]]
    return corner + (cells + rng.choice([0.2, 0.35, 0.65, 0.8], (7, 2))) * resolution, corner, resolution


def cells(rule, p, o, r):
    """Cells (row, column) of points by some rule of rounding."""
    return rule((p - np.asarray(o)) / r)[:, ::-1]


check_cell_of = Exercise(
    right=lambda p, o, r: cells(np.floor, p, o, r).astype(int),
    cases=[
        (np.array([[3.0, 1.0], [-1.2, -2.0], [0.5, -0.5], [2.3, -2.5]]), np.array([-1.0, -2.0]), 0.5),
        *(cell_case(rng, resolution) for rng, resolution in zip(rngs, (0.05, 0.3, 0.07, 0.5), strict=True)),
    ],
    mistakes={
        "The order: the row comes from y, the column from x, and the row stands first. Your map will be transposed.": (
            lambda *case: cells(np.floor, *case)[:, ::-1]
        ),
        "You round to the nearest whole number. A cell begins at its lower edge and reaches to the next: floor.": (
            lambda *case: cells(np.rint, *case)
        ),
        "int() cuts towards zero, so points just outside the grid land in row or column 0. Use floor.": (
            lambda *case: cells(np.trunc, *case)
        ),
        "Whole numbers are asked for: take the floor of these.": lambda *case: cells(np.positive, *case),
        "Points outside the grid get row or column 0, and draw a false wall along the border. Let them be negative.": (
            lambda *case: np.maximum(cells(np.floor, *case), 0)
        ),
    },
    praise="Floor, row first, and negative numbers for points outside the grid.",
)

# ---- 2: one cell's life

STORIES = [
    (["free", "none", "hit", "hit"], 2.5 * LOG_4),
    (["hit", "hit", "hit", "free", "none"], 2 * LOG_4),
    (["free", "none", "free", "free", "hit", "hit", "hit"], 2 * LOG_4),
    (["hit", "free", "free", "free", "none", "free", "free", "hit"], 2.5 * LOG_4),
    (["none", "hit", "hit", "none", "hit", "hit", "free", "none", "free", "free"], 2.5 * LOG_4),
]


def life(story, clamp, low=True, hit=LOG_4):
    """Log-odds after a story, ``hit`` for each hit, limited at every step, below only if asked for."""
    level = 0.0
    for word in story:
        level = min(level + {"hit": hit, "free": -hit, "none": 0.0}[word], clamp)
        level = max(level, -clamp) if low else level
    return level


def chance(level):
    return 1 / (1 + np.exp(-level))


check_cell_story = Exercise(
    right=lambda story, clamp: chance(life(story, clamp)),
    cases=STORIES,
    mistakes={
        "That is log-odds. The question is for the probability, 1 / (1 + exp(-log-odds)).": life,
        "The clamp does nothing here: it must act at every step, and its result must be kept.": (
            lambda story, clamp: chance(life(story, np.inf))
        ),
        "You clamp once, at the end. By then the sum has run too far: clamp at every step.": (
            lambda story, clamp: chance(np.clip(life(story, np.inf), -clamp, clamp))
        ),
        "The clamp works above only. A cell that was seen free many times is limited too, at -clamp.": (
            lambda story, clamp: chance(life(story, clamp, low=False))
        ),
        "You take logarithms to base 10. Log-odds here are natural: log 4 is 1.386, and the probability comes from a "
        "power of e.": (
            lambda story, clamp: 1 / (1 + 10.0 ** -life(story, clamp)),
            lambda story, clamp: chance(life(story, clamp, hit=np.log10(4))),
        ),
    },
    praise="Each hit adds log 4 and each free scan takes it away, never further than the clamp on either side.",
)

# ---- 3: the cells that the beams of a scan cross


def beam_case(rng) -> tuple:
    """The LiDAR's cell and the ends of beams in all directions, one of them in the LiDAR's own cell.

    The longer way has an odd number of cells and the shorter an even one, so that no beam runs exactly between two
    cells or through a corner. From an even cell half a cell is rounded alike, before and after the start is added.
    """
    start = 2 * rng.integers(-3, 15, 2)
    long, short = 2 * rng.integers(1, 8, 8) + 1, rng.uniform(-0.95, 0.95, 8)
    steps = np.column_stack([long, 2 * np.rint(long * short / 2)]).astype(int) * rng.choice([-1, 1], (8, 1))
    steps[::2] = steps[::2, ::-1]
    steps[3] = 0
    return start, start + steps


def beams(start, ends, rule=np.rint, first=0, last=0, steps=lambda way: np.abs(way).max()):
    """The crossed cells (F, 2), beam by beam, by some rule of rounding and counting."""
    crossed = [np.zeros((0, 2))]
    for way in ends - start:
        n = steps(way)
        crossed.append(start + rule(np.arange(first, n + last)[:, None] / max(n, 1) * way))
    return np.concatenate(crossed).astype(int)


def once_more(crossed):
    """A rule for all beams, and the same with each cell listed once."""
    return crossed, lambda start, ends: np.unique(crossed(start, ends), axis=0)


def touched(start, ends):
    """Every cell that a beam touches, beam by beam, but for those of the ends."""
    fine = [np.unique(beams(start, end[None], steps=lambda way: 999), axis=0) for end in ends]
    return np.concatenate([cells[(cells != end).any(axis=1)] for cells, end in zip(fine, ends, strict=True)])


def in_rows(cells):
    """The cells in an order of their own."""
    return np.array(sorted(map(tuple, np.asarray(cells, dtype=float).tolist())))


check_crossed_cells = Exercise(
    right=beams,
    also=once_more(beams)[1:],
    cases=[beam_case(rng) for rng in rngs],
    same=lambda found, expected: np.array_equal(in_rows(found), in_rows(expected)),
    mistakes={
        "The cells in which the beams end are in your list too. There something was hit: leave them out.": (
            once_more(lambda start, ends: beams(start, ends, last=1))
        ),
        "You take one cell for each column. A beam that runs along the columns gets gaps, or no cell at all: step "
        "along the longer way of the two.": once_more(
            lambda start, ends: beams(start, ends, steps=lambda way: abs(way[1]))
        ),
        "You take one cell for each row. A beam that runs along the rows gets gaps, or no cell at all: step along the "
        "longer way of the two.": once_more(
            lambda start, ends: beams(start, ends, steps=lambda way: abs(way[0]))
        ),
        "You list every cell that a beam touches, sometimes two of them side by side. Asked is one cell for each step "
        "of the longer way, the one nearest to the beam.": once_more(touched),
        "You cut where the beam stands between two cells. It takes the nearest of them: round.": (
            once_more(lambda start, ends: beams(start, ends, rule=np.floor))
        ),
        "The LiDAR's own cell is missing: where it stands nothing else can, so count from 0.": (
            once_more(lambda start, ends: beams(start, ends, first=1))
        ),
        "One beam ends in the LiDAR's own cell. It crosses none, and you divide by its 0 steps.": ZeroDivisionError,
    },
    praise="One cell for each step of the longer way, for beams in all directions, and the hits left out.",
)

# ---- 4: one scan into the map


def map_case(rng, hit_step, free_step, clamp) -> tuple:
    """A map, hits and free cells with repetitions, some of them in both lists, and three different amounts."""
    before = rng.uniform(-0.6, 0.6, (6, 8)) * clamp
    before[0, :2] = [0.95 * clamp, -0.95 * clamp]
    free = np.array([[1, 1], [1, 2], [1, 1], [0, 1], [2, 3], [1, 1], [3, 0], [4, 2]])
    hits = np.array([[2, 3], [0, 0], [2, 3], [4, 5], [3, 4]])
    return before, rng.permutation(hits), rng.permutation(free), hit_step, free_step, clamp


def write(rule, hit_limit=1, free_limit=1, clip=np.clip):
    """A way to write a scan: who wins, how often a cell counts at most, and how the result is limited."""

    def update(log_odds, hits, free, hit_step, free_step, clamp):
        struck, crossed = np.zeros(log_odds.shape), np.zeros(log_odds.shape)
        np.add.at(struck, tuple(np.asarray(hits).T), 1)
        np.add.at(crossed, tuple(np.asarray(free).T), 1)
        up, down = hit_step * np.minimum(struck, hit_limit), -free_step * np.minimum(crossed, free_limit)
        change = {
            "hits win": np.where(struck > 0, up, down),
            "free wins": np.where(crossed > 0, down, up),
            "sum": up + down,
        }
        return clip(log_odds + change[rule], -clamp, clamp)

    return update


check_update_log_odds = Exercise(
    right=write("hits win"),
    cases=[
        map_case(rng, *steps)
        for rng, steps in zip(
            rngs, [(1.4, 0.5, 2.0), (0.9, 0.7, 3.5), (1.1, 0.3, 2.6), (0.8, 0.4, 3.0)], strict=True
        )
    ],
    mistakes={
        "You add and take away beam by beam. One cell was crossed by three beams of this scan, which is one look "
        "at it and not three; another was hit and crossed. Once per scan, and hits win.": (
            write("sum", np.inf, np.inf)
        ),
        "You count free cells once per beam: one of them was crossed by three beams of one scan. They are not three "
        "independent proofs. Once per scan.": write("hits win", 1, np.inf),
        "A cell that was hit and crossed gets both changes. Hits win: it gets the hit alone.": write("sum"),
        "The free cells overwrite the hits: one cell was hit, and a neighbouring beam grazed it. Hits win.": (
            write("free wins")
        ),
        "The clamp is missing, or its result was thrown away.": (
            write("hits win", clip=lambda values, low, high: values)
        ),
    },
    praise="Every cell once, hits win, and the clamp holds on both sides.",
)

# ---- 5: what a reading says

READINGS = (np.inf, 0.0, 0.05, 11.4, np.nan, 2.0, 60.0, -np.inf, 0.2, 20.0)


def meaning(reading, low, high):
    if np.isnan(reading) or reading < low:
        return "nothing"
    return "hit" if reading < high else "free"


check_meaning = Exercise(
    right=meaning,
    cases=[
        (reading, low, high)
        for low, high in ((0.1, 30.0), (0.25, 12.0))
        for reading in (*READINGS, low, high)
    ],
    mistakes={
        "A beam that never came back hit nothing: as a hit it draws a ring of false wall at maximum range.": (
            lambda r, low, high: "hit" if r >= high else meaning(r, low, high)
        ),
        "A beam beyond range_max is good news here: nothing stood in its way.": (
            lambda r, low, high: "nothing" if r >= high else meaning(r, low, high)
        ),
        "Exactly range_max is what many scanners write where nothing came back. A hit lies below it, as in "
        "chapter 00.": lambda r, low, high: "hit" if r == high else meaning(r, low, high),
        "NaN says nothing, and yours is a hit. Every comparison with NaN is False: mind your last else.": (
            lambda r, low, high: "hit" if np.isnan(r) else meaning(r, low, high)
        ),
        "NaN says nothing, and yours is free. Every comparison with NaN is False: mind your last else.": (
            lambda r, low, high: "free" if np.isnan(r) else meaning(r, low, high)
        ),
    },
    praise="A hit within the limits, free from the maximum on, and nothing below the minimum or for NaN.",
)
