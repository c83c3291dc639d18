"""What the site shows of a chapter's code: no words for those who cannot see a picture, no bare calls."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "book" / "_ext"))

from folds import only_calls, without_words

ALT = 'figure, axes = sheet(4)\nshow(figure, f"""The path is off\nby {worst:.1f} m.""")\nprint(worst)'


def test_the_words_of_a_picture_are_left_out_of_its_code():
    assert without_words(ALT) == "figure, axes = sheet(4)\nshow(figure)\nprint(worst)"
    assert without_words('show(figure, "wänd" + x)') == 'show(figure, "wänd" + x)'
    assert without_words("show(plan(axes).figure, words)") == "show(plan(axes).figure, words)"
    assert without_words('show(plan("ä"), "words")') == 'show(plan("ä"))'
    assert without_words("%matplotlib inline") == "%matplotlib inline"


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
