"""What learners get wrong: each tag of a cell has an entry, and the book meets most of the entries."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "book" / "_ext"))
from misconceptions import load_misconceptions, met_in, table  # noqa: E402

WORDS = load_misconceptions(ROOT / "book" / "misconceptions.yml")
MET = met_in(ROOT / "notebooks")


def test_every_tag_has_its_entry_and_every_entry_two_sentences():
    assert set(MET) <= set(WORDS)
    assert all(len(words) == 2 and all(w.endswith(".") for w in words) for words in WORDS.values())


def test_the_book_meets_most_of_them():
    assert len(MET) >= 45


@pytest.mark.parametrize("number", sorted(MET))
def test_the_table_says_where(number):
    rows = [line for line in table(ROOT).splitlines() if line.startswith(f"| {WORDS[number][0]} ")]
    assert len(rows) == 1
    assert all(stem in rows[0] for stem, _ in MET[number])
