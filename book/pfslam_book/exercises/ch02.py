"""Checks of the exercises of chapter 02: each takes the reader's function and says in words what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pfslam_book.show.checks import Check, attempt, compare, hint

from pfslam.grid import LOG_4

# ---- exercise 1: points and their cells


def _cell_case(seed: int) -> tuple:
    """Return points in a grid and beside it, a corner that is no multiple of the cell, and the size of a cell."""
    rng = np.random.default_rng(seed)
    resolution = (0.05, 0.3, 0.07, 0.5)[seed]
    corner = rng.uniform(-2.0, -1.0, 2)
    cells = np.column_stack([rng.permutation(20)[:7], rng.permutation(20)[:7]]) - 4
    cells[:2] = [[-3, 4], [6, -1]]
    inside = rng.choice([0.2, 0.35, 0.65, 0.8], (7, 2))
    return corner + (cells + inside) * resolution, corner, resolution


EDGES = (
    np.array([[3.0, 1.0], [-1.2, -2.0], [0.5, -0.5], [-1.5, 0.1], [2.3, -2.5], [0.9, 1.5], [-1.0, 0.0]]),
    np.array([-1.0, -2.0]),
    0.5,
)
"""The points of the check by hand and others, most of them on the lower edge of a cell."""


def _cells(rule: Callable, points, corner, resolution) -> np.ndarray:
    """Return cells (row, column) of points by some rule of rounding."""
    return rule((np.asarray(points) - corner) / resolution).astype(int)[..., ::-1]


def cell_of(points, origin, resolution) -> np.ndarray:
    """Solve exercise 1."""
    return _cells(np.floor, points, origin, resolution)


def _separately(rule: Callable) -> Callable:
    """Make the mistake to round the point and the origin each by itself."""
    return lambda p, o, r: (rule(p / r) - rule(np.asarray(o) / r)).astype(int)[:, ::-1]


def _turned_over(p, o, r) -> np.ndarray:
    """Count rows from the highest point downwards."""
    rows, columns = cell_of(p, o, r).T
    return np.column_stack([rows.max() - rows, columns])


CELL_MISTAKES = [
    (
        lambda p, o, r: cell_of(p, o, r)[:, ::-1],
        "The order: the row comes from y, the column from x, and the row stands first. Your map will be transposed.",
    ),
    (
        lambda p, o, r: _cells(np.rint, p, o, r),
        "You round to the nearest whole number. A cell begins at its lower edge and reaches to the next: floor.",
    ),
    (
        lambda p, o, r: _cells(np.ceil, p, o, r),
        "You round up. A cell begins at its lower edge and reaches to the next: floor.",
    ),
    (
        lambda p, o, r: _cells(np.trunc, p, o, r),
        "int() cuts towards zero, so points just outside the grid land in row or column 0. Use floor.",
    ),
    (
        lambda p, o, r: _cells(np.floor, p, 0.0, r),
        "Subtract the origin before you divide: cell [0, 0] does not lie at (0, 0).",
    ),
    (
        lambda p, o, r: _cells(np.floor, p + np.asarray(o), 0.0, r),
        "The origin is subtracted, not added: it is where cell [0, 0] begins.",
    ),
    (
        lambda p, o, r: _cells(np.floor, p, o[::-1], r),
        "The two coordinates of the origin have changed places.",
    ),
    *(
        (
            _separately(rule),
            "You round the point and the origin separately. Subtract first, and round the difference once.",
        )
        for rule in (np.floor, np.rint, np.trunc)
    ),
    (
        lambda p, o, r: _cells(lambda cells: np.ceil(cells) - 1, p, o, r),
        "A point on the lower edge of a cell belongs to that cell. With ceil - 1 it falls into the one before: floor.",
    ),
    (
        lambda p, o, r: _cells(np.floor, np.asarray(p) - r / 2, o, r),
        "Half a cell off: the origin is the outer corner of cell [0, 0], not its middle.",
    ),
    (
        lambda p, o, r: _cells(np.trunc, p, o, r)[:, ::-1],
        "Two things: row and column have changed places, and int() cuts towards zero. The row comes from y and "
        "stands first; take the floor.",
    ),
    (
        lambda p, o, r: _cells(np.rint, p, o, r)[:, ::-1],
        "Two things: row and column have changed places, and you round to the nearest number. The row comes from y "
        "and stands first; take the floor.",
    ),
    (
        lambda p, o, r: ((p - np.asarray(o)) / r)[:, ::-1],
        "Whole numbers are asked for: take the floor of these.",
    ),
    *(
        (upside_down, "Upside down: row 0 holds the lowest y. Do not turn the rows over.")
        for upside_down in (_turned_over, lambda p, o, r: cell_of(p, o, r) * [-1, 1])
    ),
    (
        lambda p, o, r: _cells(np.floor, p, o, 1.0 / r),
        "You multiply by the resolution. It is the size of a cell: divide by it.",
    ),
    (
        lambda p, o, r: np.maximum(cell_of(p, o, r), 0),
        "Points outside the grid get row or column 0, and draw a false wall along the border. Let them be negative.",
    ),
    (
        lambda p, o, r: np.abs(cell_of(p, o, r)),
        "Points outside the grid are mirrored into it. Let their row or column be negative.",
    ),
    (
        lambda p, o, r: cell_of(p, o, r) + 1,
        "Your cells are counted from 1. Arrays are counted from 0.",
    ),
]


def check_cell_of(theirs: Callable) -> Check:
    """Check whether ``cell_of(points, origin, resolution)`` gives (row, column) by floor, outside the grid too."""
    cases = [EDGES, *(_cell_case(seed) for seed in range(4))]
    praise = "Floor, row first, and negative numbers for points outside the grid."
    return compare(theirs, cell_of, cases, mistakes=CELL_MISTAKES, praise=praise)


# ---- exercise 2: one cell's life

CLAMP = 2 * LOG_4
STORIES = (
    (("free", "none", "hit", "hit"), 2.5 * LOG_4),
    (("hit", "hit", "hit", "free", "none"), CLAMP),
    (("free", "none", "free", "free", "hit", "hit", "hit"), CLAMP),
    (("hit", "free", "free", "free", "none", "free", "free", "hit"), 2.5 * LOG_4),
    (("none", "hit", "hit", "none", "hit", "hit", "free", "none", "free", "free"), 2.5 * LOG_4),
)


def _life(story, clamp, changes=(LOG_4, -LOG_4, 0.0), low=True, high=True, start=0.0) -> float:
    """Return log-odds after a story, limited at every step on the sides that are asked for."""
    level = start
    for word in story:
        level += dict(zip(("hit", "free", "none"), changes, strict=True))[word]
        level = max(level, -clamp) if low else level
        level = min(level, clamp) if high else level
    return level


def probability(level):
    """Return the probability of log-odds, one or many."""
    return 1 / (1 + np.exp(-level))


def cell_story(story, clamp) -> float:
    """Solve exercise 2."""
    return probability(_life(story, clamp))


def _multiplied(story, clamp) -> float:
    """Return probabilities multiplied as if they were odds."""
    return float(np.prod([{"hit": 0.8, "free": 0.2, "none": 1.0}[word] for word in story]) * 0.5)


def _forgetful(story, clamp) -> float:
    """Start again after every scan that says nothing."""
    last = max((k for k, word in enumerate(story) if word == "none"), default=-1)
    return cell_story(story[last + 1 :], clamp)


STORY_MISTAKES = [
    (
        lambda s, c: _life(s, c),
        "That is log-odds. The question is for the probability, 1 / (1 + exp(-log-odds)).",
    ),
    (
        lambda s, c: _life(s, np.inf),
        "That is log-odds. The question is for the probability, 1 / (1 + exp(-log-odds)).",
    ),
    (
        lambda s, c: np.exp(_life(s, c)),
        "Those are the odds. The probability is odds / (1 + odds).",
    ),
    (
        lambda s, c: probability(_life(s, np.inf)),
        "The clamp does nothing here: it must act at every step, and its result must be kept.",
    ),
    (
        lambda s, c: probability(np.clip(_life(s, np.inf), -c, c)),
        "You clamp once, at the end. By then the sum has run too far: clamp at every step.",
    ),
    (
        lambda s, c: probability(_life(s, c, low=False)),
        "The clamp works above only. A cell that was seen free many times is limited too, at -clamp.",
    ),
    (
        lambda s, c: probability(_life(s, c, high=False)),
        "The clamp works below only. A cell that was hit many times is limited too, at +clamp.",
    ),
    (
        lambda s, c: probability(_life(s[::-1], c)),
        "You read the story backwards. With a clamp the order matters.",
    ),
    (
        lambda s, c: probability(_life(s, c, (LOG_4, -LOG_4, -LOG_4))),
        "A scan that says nothing about the cell is not a free scan: leave the log-odds alone.",
    ),
    (
        lambda s, c: probability(-_life(s, c)),
        "That is the probability that the cell is free.",
    ),
    (
        lambda s, c: 1 / (1 + 10.0 ** -_life(s, c)),
        "Log-odds here are natural: e, not 10.",
    ),
    (
        lambda s, c: probability(_life(s, c, (np.log10(4), -np.log10(4), 0.0))),
        "The logarithm of 4 is the natural one, 1.386.",
    ),
    (
        lambda s, c: probability(_life(s, c, (1.0, -1.0, 0.0))),
        "A hit adds log 4, not 1.",
    ),
    (
        lambda s, c: probability(_life(s, c, start=0.5)),
        "The cell starts unknown. That is a probability of 0.5, and log-odds of 0.",
    ),
    (
        lambda s, c: probability(_life(s, c, (np.log(0.8), np.log(0.2), 0.0))),
        "You add the logarithm of a probability. Log-odds take the logarithm of the odds, log(0.8 / 0.2) = log 4.",
    ),
    (
        lambda s, c: probability(_life(s, c, (LOG_4, 0.0, 0.0))),
        "A free scan takes log 4 away; in your story it changes nothing.",
    ),
    (
        lambda s, c: probability(_life(s, c * LOG_4)),
        "The clamp is given in log-odds. Do not multiply it by log 4.",
    ),
    (
        _forgetful,
        "A scan that did not touch the cell does not make it unknown again: leave the log-odds alone.",
    ),
    (
        _multiplied,
        "You multiply probabilities. The odds are what gets multiplied.",
    ),
]


def check_cell_story(theirs: Callable) -> Check:
    """Check whether ``cell_story(story, clamp)`` adds log 4 for a hit and clamps at each step."""
    cases = [(list(story), clamp) for story, clamp in STORIES]
    praise = (
        "Each hit adds log 4 and each free scan takes it away, never further than the clamp on either side."
    )
    return compare(theirs, cell_story, cases, mistakes=STORY_MISTAKES, praise=praise)


# ---- exercise 3: one scan into the map


def _map_case(seed: int) -> tuple:
    """Return a map, hits and free cells with repetitions, some of them in both lists, and three different amounts."""
    rng = np.random.default_rng(seed)
    clamp = (2.0, 3.5, 2.6, 3.0)[seed]
    before = rng.uniform(-0.6, 0.6, (5, 6)) * clamp
    before[0, :2] = [0.95 * clamp, -0.95 * clamp]
    free = np.array([[1, 1], [1, 2], [1, 1], [0, 1], [2, 3], [1, 1], [3, 0], [4, 2]])
    hits = np.array([[2, 3], [0, 0], [2, 3], [4, 5], [3, 4]])
    rows = rng.permutation(len(free)), rng.permutation(len(hits))
    return before, hits[rows[1]], free[rows[0]], (1.4, 0.9, 1.1, 0.8)[seed], (0.5, 0.7, 0.3, 0.4)[seed], clamp


def _changes(shape, hits, free, per_beam: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return how often each cell is hit and crossed, or whether."""
    struck, crossed = np.zeros(shape), np.zeros(shape)
    np.add.at(struck, tuple(np.asarray(hits).T), 1)
    np.add.at(crossed, tuple(np.asarray(free).T), 1)
    return (struck, crossed) if per_beam else (np.minimum(struck, 1), np.minimum(crossed, 1))


def _written(
    rule: str = "hits win", beams: tuple[bool, bool] = (False, False), clip=np.clip, first: bool = False
):
    """Make a way to write a scan: who wins, what counts per beam, and how the result is limited."""

    def update(log_odds, hits, free, hit_step, free_step, clamp):
        struck, crossed = (
            _changes(log_odds.shape, hits, free, per_beam)[k] for k, per_beam in enumerate(beams)
        )
        up, down = hit_step * struck, free_step * crossed
        if rule == "hits win":
            change = np.where(struck > 0, up, -down)
        elif rule == "free wins":
            change = np.where(crossed > 0, -down, up)
        else:
            change = up - down
        limited = (clip(log_odds, -clamp, clamp) if first else log_odds) + change
        return limited if first else clip(limited, -clamp, clamp)

    return update


def _no_clip(values, low, high) -> np.ndarray:
    return values


update_log_odds = _written()
"""The right answer of exercise 3."""


def _swapped(log_odds, hits, free, hit_step, free_step, clamp) -> np.ndarray:
    """Return the two steps exchanged."""
    return update_log_odds(log_odds, hits, free, free_step, hit_step, clamp)


def _twice(log_odds, hits, free, hit_step, free_step, clamp) -> np.ndarray:
    """Return free cells lowered, hit cells among them too, and then every hit raised by two steps."""
    return _written("sum")(log_odds, hits, free, 2 * hit_step, free_step, clamp)


def _assigned(log_odds, hits, free, hit_step, free_step, clamp) -> np.ndarray:
    """Set the cells to the steps."""
    new = log_odds.copy()
    new[tuple(np.asarray(free).T)] = -free_step
    new[tuple(np.asarray(hits).T)] = hit_step
    return np.clip(new, -clamp, clamp)


def _as_block(log_odds, hits, free, hit_step, free_step, clamp) -> np.ndarray:
    """Change every listed row in every listed column."""
    change = np.zeros_like(log_odds)
    change[np.ix_(free[:, 0], free[:, 1])] = -free_step
    change[np.ix_(hits[:, 0], hits[:, 1])] = hit_step
    return np.clip(log_odds + change, -clamp, clamp)


def _in_array(log_odds, hits, free, hit_step, free_step, clamp) -> np.ndarray:
    """Skip a free cell if its row or its column stands anywhere among the hits."""
    left = np.array([cell for cell in free if cell not in hits]).reshape(-1, 2)
    return update_log_odds(log_odds, hits, left, hit_step, free_step, clamp)


WRITE_MISTAKES = [
    (_written(clip=_no_clip), "The clamp is missing, or its result was thrown away."),
    (_written(first=True), "You limit the map before the scan is added. Limit the result."),
    (
        _written(clip=lambda v, low, high: np.minimum(v, high)),
        "The clamp works above only. A cell that was seen free many times is limited too, at -clamp.",
    ),
    (
        _written(clip=lambda v, low, high: np.maximum(v, low)),
        "The clamp works below only. A cell that was hit many times is limited too, at +clamp.",
    ),
    (
        _written(clip=lambda v, low, high: np.clip(v, 0, high)),
        "Free cells fall below zero: the lower limit is -clamp, not 0.",
    ),
    (
        _written(beams=(True, True)),
        "You count once per beam: one free cell was crossed by three beams of one scan. They are not three "
        "independent "
        "proofs. Once per scan.",
    ),
    (
        _written(beams=(False, True)),
        "You count free cells once per beam: one of them was crossed by three beams of one scan. They are not three "
        "independent proofs. Once per scan.",
    ),
    (
        _written(beams=(True, False)),
        "You count hits once per beam: two beams of one scan ended in the same cell. Once per scan.",
    ),
    (
        _written("free wins"),
        "The free cells overwrite the hits: one cell was hit, and a neighbouring beam grazed it. Hits win.",
    ),
    (
        _written("sum"),
        "A cell that was hit and crossed gets both changes. Hits win: it gets the hit alone.",
    ),
    (
        _written("sum", (True, True)),
        "You count once per beam, and lower the hit cells as well: near the robot everything is washed out.",
    ),
    (
        _twice,
        "You lower the hit cells with the free ones and then raise them by two steps. That is one step only if both "
        "steps are equal: leave hit cells out of the free ones.",
    ),
    (_swapped, "hit_step and free_step have changed places."),
    (
        lambda m, h, f, up, down, c: update_log_odds(m, h, f, up, up, c),
        "You take hit_step for the free cells too; free_step is what a free cell loses.",
    ),
    (
        lambda m, h, f, up, down, c: update_log_odds(m, h, f, up, -down, c),
        "Free cells rise in your map. free_step is positive, and it is taken away.",
    ),
    (
        lambda m, h, f, up, down, c: update_log_odds(0 * m, h, f, up, down, c),
        "You start from an empty map. The scan is added to what the map already says.",
    ),
    (lambda m, *rest: m, "The map is unchanged."),
    (_assigned, "You set the cells to the steps. Add the steps to what the map already says."),
    (
        _as_block,
        "np.ix_ takes every listed row with every listed column. Pair them: change[cells[:, 0], cells[:, 1]].",
    ),
    (
        _in_array,
        "`cell in hits` asks whether *any* number in the array agrees. Compare whole rows, or write the hits last.",
    ),
    (
        lambda m, h, f, up, down, c: update_log_odds(m, h, f, up, 0.0, c),
        "The crossed cells stay as they were: each loses free_step.",
    ),
    *(
        (no_hits, "The hit cells do not rise: each gains hit_step.")
        for no_hits in (
            lambda m, h, f, up, down, c: update_log_odds(m, h[:0], f, up, down, c),
            lambda m, h, f, up, down, c: update_log_odds(m, h, f, 0.0, down, c),
        )
    ),
    (
        lambda m, h, f, up, down, c: update_log_odds(m, h, f, down, down, c),
        "You take free_step for the hits too; hit_step is what a hit cell gains.",
    ),
    (
        lambda m, h, f, up, down, c: update_log_odds(m, h, f, -up, -down, c),
        "The signs are exchanged: a hit raises the log-odds, a crossing lowers them.",
    ),
    *(
        (fixed, "You take log 4 whatever the arguments say: use hit_step and free_step.")
        for fixed in (
            lambda m, h, f, up, down, c: update_log_odds(m, h, f, LOG_4, LOG_4, c),
            lambda m, h, f, up, down, c: update_log_odds(m, h, f, LOG_4, LOG_4, CLAMP),
        )
    ),
    (
        lambda m, h, f, up, down, c: update_log_odds(m, h, f, up, down, CLAMP),
        "You clamp to 2 log 4 whatever the argument says: use clamp.",
    ),
    (
        lambda *arguments: probability(update_log_odds(*arguments)),
        "Those are probabilities. A map keeps log-odds, and log-odds are asked for.",
    ),
    (
        lambda m, h, f, up, down, c: update_log_odds(m[::-1], h, f, up, down, c)[::-1],
        "Upside down: row 0 of the lists is row 0 of the array. Do not turn the rows over.",
    ),
    (
        IndexError,
        "IndexError: a cell outside the map. Are rows and columns swapped? The lists hold (row, column), row first.",
    ),
]


def check_update_log_odds(theirs: Callable) -> Check:
    """Check whether ``update_log_odds(...)`` writes each cell once, lets hits win, and clamps on both sides."""
    cases = [_map_case(seed) for seed in range(4)]
    praise = "Every cell once, hits win, and the clamp holds on both sides."
    return compare(theirs, update_log_odds, cases, mistakes=WRITE_MISTAKES, praise=praise)


# ---- exercise 4: what a beam says

WORDS = ("hit", "free", "nothing")
RANGES = (0.1, 30.0), (0.25, 12.0)
READINGS = (np.inf, 0.0, 0.05, 11.4, np.nan, 2.0, 60.0, -1.0, -np.inf, 0.2, 20.0)


def meaning(reading, range_min, range_max) -> str:
    """Solve exercise 4."""
    if np.isnan(reading) or reading < range_min:
        return "nothing"
    return "hit" if reading <= range_max else "free"


def _meaning_mistake(change: Callable) -> Callable:
    """Return a wrong answer: what ``change`` says, or the right one where it says nothing."""
    return lambda r, low, high: change(r, low, high) or meaning(r, low, high)


MEANING_MISTAKES = [
    (
        _meaning_mistake(lambda r, low, high: "hit" if r > high else ""),
        "A beam that never came back hit nothing: as a hit it draws a ring of false wall at maximum range.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "hit" if r == np.inf else ""),
        "A beam that never came back hit nothing: as a hit it draws a ring of false wall at maximum range.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "free" if np.isnan(r) else ""),
        "NaN is not a number, and here it says nothing. Every comparison with NaN is False: mind your last else.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "hit" if np.isnan(r) else ""),
        "NaN is not a number, and here it says nothing. Every comparison with NaN is False: mind your last else.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "hit" if r < low else ""),
        "Below range_min the device was blinded, or saw its own frame. That hits nothing and frees nothing.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "free" if r < low else ""),
        "Below range_min the device was blinded, or saw its own frame. That hits nothing and frees nothing.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "hit" if 0 < r < low else ""),
        "Below range_min the device was blinded, or saw its own frame. That hits nothing and frees nothing.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "free" if r == 0 else ""),
        "0 is below range_min, like every reading that is too short: it says nothing.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "nothing" if r > high else ""),
        "For this sensor a beam beyond range_max is good news: all is free up to there. (Whether to believe it in a "
        "building with glass is another matter; the package does not.)",
    ),
    (
        _meaning_mistake(lambda r, low, high: "nothing" if r == np.inf else ""),
        "Infinity is beyond range_max, like every reading that is too long: all is free up to there.",
    ),
    (
        lambda r, low, high: meaning(abs(r), low, high),
        "A negative reading is below range_min, like every reading that is too short: it says nothing.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "free" if r == high else ""),
        "A reading of exactly range_max does not reach further than range_max: it is a hit.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "nothing" if r == low else ""),
        "A reading of exactly range_min is not below range_min: it is a hit.",
    ),
    (
        _meaning_mistake(lambda r, low, high: {low: "nothing", high: "free"}.get(r, "")),
        "Readings of exactly range_min and range_max are hits: neither is below the one or beyond the other.",
    ),
    *(
        (
            lambda r, low, high, limits=limits: meaning(
                r, *(a or b for a, b in zip(limits, (low, high), strict=True))
            ),
            "Your limits are fixed. Another LiDAR has others: use range_min and range_max.",
        )
        for limits in (*RANGES, (None, 30.0), (None, 12.0), (0.1, None), (0.25, None))
    ),
    (
        lambda r, low, high: meaning(r, high, low),
        "range_min and range_max have changed places.",
    ),
    (
        lambda r, low, high: {"hit": "free", "free": "hit"}.get(meaning(r, low, high), "nothing"),
        "You have exchanged hit and free: a beam that comes back has hit something.",
    ),
    (
        _meaning_mistake(lambda r, low, high: "free" if r == -np.inf else ""),
        "Minus infinity is below range_min and says nothing; np.isinf is true for both signs.",
    ),
]


def _same_word(found, *words) -> bool:
    """Tell whether an answer is one of these words."""
    return isinstance(found, str) and found in words


def check_meaning(theirs: Callable) -> Check:
    """Check whether ``meaning(reading, range_min, range_max)`` tells hit, free up to the maximum, and nothing apart."""
    cases = [(reading, *limits) for limits in RANGES for reading in (*READINGS, *limits)]
    found = attempt(theirs, 2.0, 0.1, 30.0)
    if not (found is None or found is ... or isinstance(found, Check) or _same_word(found, *WORDS)):
        return hint(f"Each answer is 'hit', 'free' or 'nothing'; yours is {found!r}.")
    praise = "A hit within the limits, free beyond the maximum, and nothing below the minimum or for NaN."
    return compare(theirs, meaning, cases, mistakes=MEANING_MISTAKES, same=_same_word, praise=praise)
