"""The pages of `make grade` are for everybody: axe finds nothing, they fit a phone, and they ask for nothing."""

from types import SimpleNamespace

import grade  # noqa: F401 - tells Python where the book's tools are
import pytest
from grading.cage import Cage
from grading.copies_of import Copy
from grading.judge import STATES, Grade
from grading.pages import write
from headless import WIDTH_BEYOND_SCREEN, violations

pytestmark = pytest.mark.browser
LONG = "<b>Your function returns " + "a_very_long_word_" * 30


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The pages of two students, one of whom has handed in nothing that can be read."""
    out = tmp_path_factory.mktemp("grade")
    tasks = [SimpleNamespace(number=str(n), name="update_log_odds") for n in range(1, 7)]
    grades = [Grade(state, LONG) for state in STATES]
    copies = [
        Copy("Jörg <Müller>" * 9, "a.ipynb", [], "02", grades),
        Copy("empty", "", grades=[Grade(STATES[3], LONG)]),
    ]
    write(out, copies, {"02": SimpleNamespace(tasks=tasks)}, Cage("room"))
    return out


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_axe_finds_nothing_and_the_pages_fit(open_file, folder, width, scheme):
    files = [folder / "index.html", *sorted((folder / "students").iterdir())]
    assert len(files) == 3
    for file in files:
        page = open_file(file, "() => document.readyState === 'complete'", width=width, color_scheme=scheme)
        assert violations(page) == []
        assert page.evaluate(WIDTH_BEYOND_SCREEN) <= 0
        assert page.locator("b").count() == 0, "what a student's code says is text"
