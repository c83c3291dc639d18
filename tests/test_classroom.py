"""The page for teachers: minutes, memory and exercises of a chapter, by hand."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "book" / "_ext"))
from classroom import (  # noqa: E402
    TABLE,
    chapters_table,
    exams_table,
    exercises,
    minutes,
    read,
    server_text,
)


def test_every_chapter_is_measured():
    assert len(read(ROOT / TABLE, sorted((ROOT / "notebooks").glob("*.ipynb")))) > 10


def test_the_course_fits_the_sessions_that_the_plan_gives_it():
    """Ninety minutes for each time that a chapter stands in the table of the five weeks."""
    weeks = re.findall(
        r"^\| \d \|(.*)\|.*\|$", (ROOT / "book/teachers.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    sessions = re.findall(r"\b(\d\d),", " ".join(weeks))
    assert len(sessions) == 10
    for row in read(ROOT / TABLE, sorted((ROOT / "notebooks").glob("0[0-6]_*.ipynb"))):
        assert minutes(row) <= 90 * sessions.count(row["chapter"][:2]), row["chapter"]


def test_minutes_and_memory_by_hand():
    row = {"chapter": "01_x", "words": 1200, "widgets": 2, "exercises": 3}
    row |= {"startup_s": "1.0", "run_s": "30.0", "memory_mb": "256"}
    assert "| **50** |" in chapters_table([row])  # 10 + 8 + 30 = 48
    assert "need 10 GB" in server_text([row])


def cell(text, *tags):
    """A cell of Markdown, or of code where it has tags."""
    return {"cell_type": "code" if tags else "markdown", "source": text, "metadata": {"tags": list(tags)}}


def test_exercises_by_hand():
    cells = [
        cell("**Exercise 1 (goes into your filter).** Write it."),
        cell("def move(poses):\n    return ...", "exercise-1"),
        cell("def move(poses):\n    return poses", "solution-1"),
        cell("**Exercise 2.** Another."),
        cell("def other():\n    return ...", "exercise-2"),
        cell("**Exercise 3 (explore and explain).** Look."),
    ]
    assert exercises({"cells": cells}) == (["move", "other"], ["move"], 1)


def test_exams_by_hand():
    asked = {
        "00a": {"level": "remember"},
        "00b": {"level": "apply", "numbers": True},
        "01a": {"level": "apply"},
    }
    rows = exams_table(asked).splitlines()[2:]
    assert rows == ["| 00 | 1 | 1 | 0 | 1 |", "| 01 | 0 | 1 | 0 | 0 |", "| **all** | 1 | 2 | 0 | 1 |"]
