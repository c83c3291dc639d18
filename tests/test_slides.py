"""The slides of the course: each chapter has a set that can be projected, and it shows only what the chapter has."""

import inspect
import json
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest
from copies import full_copy
from plain import Place

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "book" / "_ext"))
from slides import SHOW, TAG, marked, split  # noqa: E402

TWO_SESSIONS = {"03", "05"}
MARKED = """# A question?
1. this
2. that
. . .
This, by @eq-5 or not.
@lab-drive

Note: 2 min. Ask.
---
# It is *this*

@fig-floor
Note: 3 min. Wait."""


@pytest.fixture(params=sorted((ROOT / "notebooks").glob("0[0-6]_*.ipynb")), ids=lambda path: path.stem)
def chapter(request) -> tuple[str, dict]:
    """The number of a chapter of the course, and its notebook."""
    return request.param.stem[:2], json.loads(request.param.read_text(encoding="utf-8"))


def test_marks_become_slides_with_parts_and_notes():
    first, second = split(MARKED)
    assert first["headline"] == "A question?"
    assert first["parts"] == ["1. this\n2. that", "This, by @eq-5 or not.\n@lab-drive"]
    assert first["notes"] == "2 min. Ask."
    assert SHOW.findall(first["parts"][1]) == [("lab", "drive")]  # within a sentence it is no mark
    assert second == {"headline": "It is *this*", "parts": ["@fig-floor"], "notes": "3 min. Wait."}


def test_a_chapter_of_the_course_has_ten_to_fifteen_slides(chapter):
    _, notebook = chapter
    assert 10 <= len(marked(notebook)) <= 15


def test_a_slide_is_short_enough_for_the_last_row(chapter):
    """A headline, and some forty words; formulas, marks and the letters of a poll are no words."""
    for one in marked(chapter[1]):
        text = re.sub(r"\$\$.*?\$\$|\$[^$]*\$|\{eval\}`[^`]*`", "x", "\n".join(one["parts"]), flags=re.DOTALL)
        words = re.findall(r"[^\W\d_]{2,}", SHOW.sub("", text))
        assert one["headline"]
        assert len(words) <= 45, one["headline"]


def test_every_slide_tells_the_lecturer_what_to_do(chapter):
    for one in marked(chapter[1]):
        assert re.match(r"\d+ min\. ", one["notes"]), one["headline"]
        assert len(one["notes"].split()) >= 15, one["headline"]


def test_a_set_leaves_time_for_the_students(chapter):
    """The minutes in the notes fit the sessions of 90 minutes that the plan gives to the chapter."""
    number, notebook = chapter
    planned = sum(int(one["notes"].split()[0]) for one in marked(notebook))
    assert planned <= 90 * (1 + (number in TWO_SESSIONS))


def test_the_answer_of_a_poll_is_one_key_press_away(chapter):
    found = marked(chapter[1])
    polls = [k for k, one in enumerate(found) if re.search(r"^1\. ", one["parts"][0], re.MULTILINE)]
    assert len(polls) >= 2
    for k in polls:
        assert re.search(r"^3\. ", found[k]["parts"][0], re.MULTILINE), found[k]["headline"]
        assert len(found[k]["parts"]) > 1 or k + 1 < len(found), found[k]["headline"]


def laboratories(number: str, code: str) -> list[str]:
    """The laboratories that a chapter's cells show, by the names that slides give them."""
    module, found = import_module(f"pfslam_book.ch{number}"), []
    for called in re.findall(r"^ch\d\d\.(\w+_(?:lab|picture))\(", code, re.MULTILINE):
        name = re.search(r'show_lab\(\s*"(\w+)"', inspect.getsource(getattr(module, called)))[1]
        same = sum(other.split("-")[0] == name for other in found)
        found.append(f"{name}-{same + 1}" if same else name)
    return found


def test_what_a_slide_shows_is_in_its_chapter(chapter):
    number, notebook = chapter
    cells = notebook["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    prose = "".join(line for cell in cells if cell["cell_type"] == "markdown" for line in cell["source"])
    named = [cell["metadata"].get("mystnb", {}).get("figure", {}).get("name") for cell in cells]
    known = {
        "fig": {name.removeprefix("fig-") for name in named if name},
        "lab": set(laboratories(number, code)),
        "eq": set(re.findall(r"^:label: eq-(\d+)$", prose, re.MULTILINE)),
    }
    shown = [found for one in marked(notebook) for found in SHOW.findall("\n".join(one["parts"]))]
    assert [kind for kind, _ in shown].count("fig") >= 2
    assert [kind for kind, _ in shown].count("lab") >= 1
    assert [(kind, name) for kind, name in shown if name not in known[kind]] == []


def test_marks_are_folded_in_jupyterlab_and_left_out_of_copies(chapter):
    """The mark of a slide is a raw cell, so it counts no word of the chapter and is no cell of a copy."""
    _, notebook = chapter
    raw = [cell for cell in notebook["cells"] if cell["cell_type"] == "raw"]
    assert raw
    assert raw == [cell for cell in notebook["cells"] if TAG in cell["metadata"].get("tags", [])]
    assert all(cell["metadata"]["jupyter"] == {"source_hidden": True} for cell in raw)
    asked = sum("".join(c["source"]).count("{eval}`") for c in notebook["cells"] if c not in raw)
    copy = full_copy(notebook, ["1"] * asked, Place(ROOT, frozenset(), ""))
    assert [cell["id"] for cell in copy["cells"]] == [c["id"] for c in notebook["cells"] if c not in raw]
