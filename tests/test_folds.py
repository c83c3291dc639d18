"""What the site shows of a chapter's code: no bare calls."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "book" / "_ext"))

from folds import only_calls


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
