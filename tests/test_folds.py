"""What the site shows of a chapter's code: no bare calls, and no fold that holds nothing new."""

import sys
from pathlib import Path

import pytest
from docutils import nodes
from docutils.utils import new_document

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "book" / "_ext"))

from folds import only_calls, tidy


@pytest.mark.parametrize(
    ("code", "alone"),
    [
        ("ch05.maps_lab()", True),
        ("ch08.explorer(ch08.FAULTS,\n  'data')", True),
        ("x = ch05.maps_lab()", False),
        ("x = 1\nch05.maps_lab()", False),
        ("%time x", False),
    ],
)
def test_a_cell_that_only_calls_is_told_from_one_that_a_reader_may_change(code, alone):
    assert only_calls(code) == alone


def cell(code: str, *tags: str) -> nodes.container:
    source = nodes.container("", nodes.literal_block("", code), classes=["cell_input"])
    return nodes.container(
        "",
        source,
        classes=["cell", *(f"tag_{tag}" for tag in tags)],
        hide_mode="all",
        prompt_show="Show the code",
    )


def tidied(*parts: nodes.Element) -> nodes.section:
    """A section of a chapter with these parts, as the site has it."""
    tree, section = new_document("chapter"), nodes.section("", *parts)
    tree += section
    environment = type("Env", (), {"docname": "notebooks/03_x"})
    tidy(type("App", (), {"env": environment, "srcdir": Path(__file__).resolve().parents[1]}), tree)
    return section


@pytest.mark.parametrize(("code", "kept"), [("ch05.check(ch05.step)", 1), ("def mine():\n    return 3", 2)])
def test_a_solution_that_only_calls_what_the_page_has_is_no_fold(code, kept):
    exercise = nodes.paragraph("", "The printed loop passes.")
    assert len(tidied(exercise, cell(code, "hide-cell", "solution-4")).children) == kept
