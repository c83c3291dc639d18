"""Checks of the exercises of chapter 02. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pfslam.grid import LOG_4
from pfslam.teaching.show.checks import Check, attempt, hint, is_unanswered, passed, unanswered


def _shape(answer) -> tuple[int, ...] | None:
    """The shape of an answer; None if its rows have different lengths."""
    try:
        return np.shape(answer)
    except ValueError:
        return None


# ---- exercise 1: a post and its cell

ORIGIN, RESOLUTION = (-1.0, -2.0), 0.5
POSTS = {(3.0, 1.0): (6, 8), (0.3, -1.2): (1, 2), (-1.4, -2.6): (-2, -1)}
"""Posts (x, y) in metres and their (row, column)."""


def check_cell_of(cell_of: Callable) -> Check:
    """Whether ``cell_of(x, y, origin, resolution)`` gives (row, column) by floor, outside the grid too."""
    found = []
    for x, y in POSTS:
        answer = attempt(cell_of, x, y, ORIGIN, RESOLUTION)
        if is_unanswered(answer):
            return unanswered()
        if isinstance(answer, Check):
            return answer
        if _shape(answer) != (2,) or np.asarray(answer).dtype.kind not in "fiu":
            return hint(f"Two whole numbers are asked for, row and column; your function returns {answer!r}.")
        found.append(tuple(float(part) for part in answer))
    right = list(POSTS.values())
    if found == right:
        return passed(
            "Row 6, column 8 for the post at (3, 1), and negative numbers for a post outside the grid."
        )
    slips = {
        "The order: the row is y, the column is x. Your map will be transposed.": lambda p: p[::-1],
        "Round and floor disagree for half of all points along each axis. A cell begins at its lower edge: floor.": (
            _by(np.rint)
        ),
        "Ceil minus one is floor, except on a border: the post at (3, 1) stands on one and lands a cell early. "
        "Use one rule everywhere.": _by(lambda value: np.ceil(value) - 1),
        "int() cuts towards zero: the post outside the grid, at -0.8 cells, lands in cell 0. Use floor.": _by(
            np.trunc
        ),
        "Subtract the origin before you divide: cell [0, 0] does not lie at (0, 0).": _by(
            np.floor, (0.0, 0.0)
        ),
    }
    for words, slip in slips.items():
        made = (
            [tuple(slip(cell)) for cell in right]
            if words.startswith("The order")
            else [slip(p) for p in POSTS]
        )
        if found == made:
            return hint(words)
    return hint(f"For the posts {list(POSTS)} the cells (row, column) are {right}; yours are {found}.")


def _by(rule: Callable, origin=ORIGIN) -> Callable:
    """(row, column) of a post by some rounding rule."""

    def cell(post):
        column, row = (float(rule((c - o) / RESOLUTION)) for c, o in zip(post, origin, strict=True))
        return row, column

    return cell


# ---- exercise 2: one cell's life

STORY = ("hit", "hit", "hit", "free", "none")
CLAMP = 2 * LOG_4


def _life(story, clamp: float = CLAMP, step: float = LOG_4) -> float:
    level = 0.0
    for word in story:
        level += {"hit": step, "free": -step}.get(word, 0.0)
        level = float(np.clip(level, -clamp, clamp))
    return level


def _probability(level: float) -> float:
    return float(1 / (1 + np.exp(-level)))


def check_cell_story(cell_story: Callable) -> Check:
    """Whether ``cell_story(story, clamp)`` adds log 4 for a hit, clamps at each step, and returns a probability."""
    answer = attempt(cell_story, list(STORY), CLAMP)
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    if _shape(answer) != () or np.asarray(answer).dtype.kind not in "fiu":
        return hint(f"One probability is asked for; your function returns {answer!r}.")
    right = _life(STORY)
    if np.isclose(answer, _probability(right)):
        return passed(
            f"{_probability(right):.2f}: two hits count, the third meets the clamp, and the free scan undoes one."
        )
    unclamped = _life(STORY, np.inf)
    wrong = {
        unclamped: "That is log-odds. The question is for the probability, 1 / (1 + exp(-log-odds)).",
        right: "That is log-odds. The question is for the probability, 1 / (1 + exp(-log-odds)).",
        _probability(
            unclamped
        ): "The clamp does nothing here: it must act after every step, and its result must be kept. A "
        "clamp at the end comes too late: the third hit was counted already.",
        _probability(
            _life([w if w != "none" else "free" for w in STORY])
        ): "A scan that says nothing about the cell is not a free scan: leave the log-odds alone.",
        float(1 / (1 + 10.0**-right)): "Log-odds here are natural: e, not 10.",
        float(
            np.clip(0.5 * 0.8**3 * 0.2, 0, 1)
        ): "You multiply probabilities. The odds are what gets multiplied.",
    }
    for value, words in wrong.items():
        if np.isclose(answer, value):
            return hint(words)
    return hint(
        f"The story {' '.join(STORY)} ends at {_probability(right):.3f}; yours at {float(answer):.3f}."
    )


# ---- exercise 3: one scan into the map

BEFORE = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 2 * LOG_4, 0.0, 2 * LOG_4]])
FREE = np.array([[0, 0], [0, 1], [0, 0], [0, 1], [0, 0], [0, 2], [1, 1]])
"""Cells (row, column) that beams cross, beam after beam: [0, 0] three times, the hit cell [0, 2] once."""
HITS = np.array([[0, 2], [1, 3], [0, 2]])


def _written(per_beam: bool, order: str, clamp: bool = True) -> np.ndarray:
    """The map after the scan: each cell once or once per beam; ``order`` "hits win", "free wins" or "sum"."""
    change, free, hit = np.zeros(BEFORE.shape), tuple(FREE.T), tuple(HITS.T)
    cleared, struck = np.zeros(BEFORE.shape), np.zeros(BEFORE.shape)
    np.add.at(cleared, free, 1)
    np.add.at(struck, hit, 1)
    if not per_beam:
        cleared, struck = np.minimum(cleared, 1), np.minimum(struck, 1)
    change = LOG_4 * (struck - cleared)
    if order == "hits win":
        change = np.where(struck > 0, LOG_4 * struck, -LOG_4 * cleared)
    elif order == "free wins":
        change = np.where(cleared > 0, -LOG_4 * cleared, LOG_4 * struck)
    after = BEFORE + change
    return np.clip(after, -CLAMP, CLAMP) if clamp else after


def check_write_scan(write_scan: Callable) -> Check:
    """Whether ``write_scan(log_odds, hits, free, step, clamp)`` writes every cell once and lets hits win."""
    given = BEFORE.copy()
    answer = attempt(write_scan, given, HITS.copy(), FREE.copy(), LOG_4, CLAMP)
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    if _shape(answer) != BEFORE.shape or np.asarray(answer).dtype.kind not in "fiu":
        return hint(
            f"The new map is asked for, of shape {BEFORE.shape}; yours has the shape {_shape(answer)}."
        )
    values = np.asarray(answer, dtype=float)
    if np.allclose(values, _written(False, "hits win")):
        if not np.array_equal(given, BEFORE):
            return hint(
                "Right numbers, but you changed the map that you were given. Who holds the old one is surprised: copy."
            )
        return passed("Every cell once, hits win, and the clamp holds.")
    wrong = [
        (_written(False, "hits win", clamp=False), "The clamp is missing, or its result was thrown away."),
        (
            _written(True, "hits win"),
            "You count once per beam: cell [0, 0] was crossed by three beams of one scan. They are not three "
            "independent proofs. Once per scan.",
        ),
        (
            _written(False, "free wins"),
            "The free cells overwrite the hits: cell [0, 2] was hit, and a neighbouring beam grazed it. Hits win.",
        ),
        (
            _written(False, "sum"),
            "Cell [0, 2] was hit and crossed, and you did both: it stays unknown. Hits win.",
        ),
        (
            _written(True, "sum"),
            "Once per beam, and hit cells are lowered as well: near the robot all is washed out.",
        ),
        (BEFORE, "The map is unchanged."),
    ]
    for value, words in wrong:
        if np.allclose(values, value):
            return hint(words)
    return hint(
        f"Expected (in units of log 4) {np.round(_written(False, 'hits win') / LOG_4, 1).tolist()}; "
        f"yours is {np.round(values / LOG_4, 1).tolist()}."
    )


# ---- exercise 4: what a beam says

READINGS = [np.inf, 0.0, 0.05, 29.9, np.nan, 2.0, 60.0]
MEANINGS = ["free", "nothing", "nothing", "hit", "nothing", "hit", "free"]


def check_meaning(meaning: Callable) -> Check:
    """Whether ``meaning(reading, range_min, range_max)`` tells hit, free up to the maximum, and nothing apart."""
    found = []
    for reading in READINGS:
        answer = attempt(meaning, reading, 0.1, 30.0)
        if is_unanswered(answer):
            return unanswered()
        if isinstance(answer, Check):
            return answer
        found.append(answer)
    if not all(isinstance(word, str) and word in ("hit", "free", "nothing") for word in found):
        return hint(f"Each answer is 'hit', 'free' or 'nothing'; yours are {found}.")
    if found == MEANINGS:
        return passed("Two hits, two beams that saw nothing all the way, and three that say nothing.")
    by_reading = dict(zip(map(str, READINGS), found, strict=True))
    if "hit" in (by_reading["inf"], by_reading["60.0"]):
        return hint(
            "A beam that never came back hit nothing: as a hit it draws a ring of false wall at maximum range."
        )
    if by_reading["nan"] != "nothing":
        return hint(
            "NaN is not a number: nothing can be said. Every comparison with it is False; mind your last else."
        )
    if by_reading["0.0"] != "nothing" or by_reading["0.05"] != "nothing":
        return hint(
            "Below range_min the device was blinded, or saw its own frame. That frees nothing and hits nothing."
        )
    if by_reading["inf"] == "nothing" or by_reading["60.0"] == "nothing":
        return hint(
            "For this sensor a beam beyond range_max is good news: all is free up to there. (Whether to believe it "
            "in a building with glass is another matter; the package does not.)"
        )
    return hint(f"For {READINGS} the meanings are {MEANINGS}; yours are {found}.")
