"""Every exercise of every chapter, as a reader runs it: its check calls the stub unanswered and the solution right."""

import json
import re
from functools import cache

import pytest
from notebook_cells import NOTEBOOKS, run, source

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


EARLIER = {("08", 3): lambda: {"robots": robots()}}
"""What an exercise takes from an earlier cell of its chapter, besides the set-up."""


@pytest.mark.parametrize(("chapter", "number"), list(exercises()))
def test_the_stub_is_unanswered_and_the_solution_right(chapter, number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where a reader's own filter is kept
    names = EARLIER.get((chapter, number), dict)()
    run(source(chapter, "setup"), names)
    run(source(chapter, f"exercise-{number}"), names)
    assert run(source(chapter, f"check-{number}"), names).verdict == "unanswered"
    verdict = run(source(chapter, f"solution-{number}"), names)
    assert verdict.verdict == "passed", verdict
