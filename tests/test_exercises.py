"""Every exercise: the stub is unanswered, the solution right in any style, and each mistake gets its own words."""

import importlib
import json
import re
from functools import cache

import numpy as np
import pytest
from notebook_cells import NOTEBOOKS, run, source
from pfslam_book.ch06.your_floor import few_pairs
from pfslam_book.show.exercise import Exercise
from right_styles import OTHERS, styles
from test_your_floor import names_of_the_page
from test_your_localiser import PARTS

import pfslam


def exercises():
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            for tag in cell["metadata"].get("tags", []):
                if found := re.fullmatch(r"exercise-(\d+)", tag):
                    yield path.name[:2], int(found[1])


@cache
def robots():
    from pfslam_book import ch08

    return ch08.mystery(pfslam.load("hall"), seed=1)


def localiser():
    names = {}
    for tag in ("setup", *(f"localiser-{part}" for part in PARTS)):
        run(source("10", tag), names)
    return names


EARLIER = {
    ("06", 6): lambda: names_of_the_page(few_pairs()),
    ("08", 3): lambda: {"robots": robots()},
    ("10", 4): localiser,
}
"""What an exercise takes from an earlier cell of its chapter, besides the set-up."""


@pytest.mark.slow
@pytest.mark.parametrize(("chapter", "number"), list(exercises()))
def test_the_stub_is_unanswered_and_the_solution_right(chapter, number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where a reader's own filter is kept
    names = EARLIER.get((chapter, number), dict)()
    run(source(chapter, "setup"), names)
    run(source(chapter, f"exercise-{number}"), names)
    assert run(source(chapter, f"check-{number}"), names).verdict == "unanswered"
    verdict = run(source(chapter, f"solution-{number}"), names)
    assert verdict.verdict == "passed", verdict


# ---- exercises that are data: their mistakes here, right answers in other styles in right_styles.py

CONVERTED = ("00", "01", "02", "03", "04", "05", "06", "07", "08", "09", "10", "11", "12", "13")
TABLES = {chapter: importlib.import_module(f"pfslam_book.exercises.ch{chapter}") for chapter in CONVERTED}
DATA = {
    f"{chapter} {name}": check
    for chapter, module in TABLES.items()
    for name, check in vars(module).items()
    if isinstance(check, Exercise)
}
MISTAKES = [
    (name, words, wrong)
    for name, check in DATA.items()
    for words, several in check.mistakes.items()
    for wrong in (several if isinstance(several, tuple) else (several,))
]


@pytest.mark.parametrize("name", DATA)
def test_an_exercise_names_eight_mistakes_at_most_and_has_a_right_answer(name):
    check = DATA[name]
    assert len(check.mistakes) <= 8
    assert OTHERS.keys() <= DATA.keys()
    for right in (check.right, *check.also):
        assert check(right).message == f"Right. {check.praise}"


@pytest.mark.parametrize(("name", "words", "mistake"), MISTAKES)
def test_every_mistake_gets_its_own_words(name, words, mistake):
    def raising(*arguments):
        raise mistake

    wrong = raising if isinstance(mistake, type) else mistake
    assert DATA[name](wrong).message == f"Not yet. {words}"


@pytest.mark.parametrize("name", DATA)
def test_the_same_in_another_style_is_right_too(name):
    check = DATA[name]
    for style in styles(check.right, check.right(*check.cases[0])) + OTHERS.get(name, []):
        verdict = check(style)
        assert verdict, verdict


@pytest.mark.parametrize("name", DATA)
def test_any_other_wrong_answer_is_told_what_was_expected_and_nonsense_never_raises(name):
    check = DATA[name]

    def broken(*arguments):
        return nothing  # noqa: F821

    def slightly_off(*case):
        right = check.right(*case)
        return f"{right}?" if isinstance(right, str) else np.asarray(right) * 1.37 + 3.21

    assert "NameError" in check(broken).message
    assert re.search(r"your function returns \S+.*; expected ", check(slightly_off).message)
    for answer in ("text", [[1.0], [1.0, 2.0]], np.zeros((7, 7)), {"a": 1}, np.full(3, np.nan), 12345.0):
        assert check(lambda *arguments, answer=answer: answer).verdict == "wrong"


def right(name, change=lambda answer: answer, seed=None):
    """The right function, with its answer changed or the random numbers of another rng."""

    def answer(*case):
        return change(DATA[name].right(*case if seed is None else (*case[:-1], np.random.default_rng(seed))))

    return answer


BESIDES = {
    "07 check_by_building": (right("07 check_by_building", seed=3), "never draws from the rng"),
    "07 check_difference": (right("07 check_difference", seed=3), "never draws from the rng"),
    "09 check_draw_all": (right("09 check_draw_all", change=np.copy), "more memory than needed"),
}


@pytest.mark.parametrize("name", BESIDES)
def test_what_answers_do_not_show_is_looked_at_besides(name):
    answer, words = BESIDES[name]
    verdict = DATA[name](answer)
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def can_change(check):
    parts = [part for case in check.cases for part in case]
    return any(isinstance(p, list) or (isinstance(p, np.ndarray) and p.dtype != bool) for p in parts)


@pytest.mark.parametrize("name", [name for name, check in DATA.items() if can_change(check)])
def test_an_answer_that_changes_what_it_is_given_is_told_so(name):
    check = DATA[name]

    def in_place(*case):
        case = list(case)
        for part in case:
            if isinstance(part, np.ndarray) and part.dtype != bool:
                part[0] += 1
            elif isinstance(part, list):
                part.append(part[0])
        return check.right(*case)

    assert "changes what it is given" in check(in_place).message
