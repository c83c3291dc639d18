"""What comes out: a page for each student, a page for the class, and a table for any gradebook."""

from __future__ import annotations

import csv
import re
from collections import Counter
from html import escape
from pathlib import Path

from grading.cage import Cage
from grading.copies_of import Copy
from grading.judge import STATES, UNREADABLE, Chapter

STYLE = """
:root { color-scheme: light dark }
body { font: 1rem/1.5 system-ui, sans-serif; max-width: 60rem; margin: 0 auto; padding: 1rem }
table { border-collapse: collapse; width: 100%; margin: 1rem 0 }
a { color: inherit }
th, td { border: 1px solid; padding: .3rem .6rem; text-align: left; vertical-align: top; overflow-wrap: anywhere }
"""


def page(title: str, body: list[str]) -> str:
    """A page of HTML that needs nothing else."""
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f"<title>{escape(title)}</title><style>{STYLE}</style>"
    parts = [f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body><main>']
    return "\n".join([*parts, f"<h1>{escape(title)}</h1>", *body, "</main></body></html>\n"])


def table(columns: list[str], rows: list[list]) -> str:
    """A table whose first column names its rows; cells that are no text are numbers or links made here."""
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in columns)
    lines = [
        f'<tr><th scope="row">{cell(first)}</th>'
        + "".join(f"<td>{cell(value)}</td>" for value in rest)
        + "</tr>"
        for first, *rest in rows
    ]
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def cell(value) -> str:
    """The text of a cell; a pair is a link and its words."""
    return f'<a href="{value[0]}">{escape(value[1])}</a>' if isinstance(value, tuple) else escape(str(value))


def titles(copy: Copy, chapters: dict[str, Chapter]) -> list[str]:
    """What the grades of a copy are for."""
    return [f"{t.number}, {t.name}" for t in chapters[copy.chapter].tasks] if copy.chapter else ["the file"]


def of_student(copy: Copy, chapters: dict[str, Chapter]) -> str:
    """The page that a student gets."""
    rows = [[title, g.state, g.words] for title, g in zip(titles(copy, chapters), copy.grades, strict=True)]
    body = [f"<p>Chapter {escape(copy.chapter)}: {copy.points} of {len(rows)} exercises are right.</p>"]
    return page(copy.student, [*(body if copy.chapter else []), table(["exercise", "grade", "hint"], rows)])


def of_class(copies: list[Copy], names: list[str], chapters: dict[str, Chapter], cage: Cage) -> str:
    """The page for the teacher: each exercise with its mistakes, and all copies."""
    body = [f"<p>{escape(cage.words)}</p>"]
    for name, chapter in chapters.items():
        own = [copy for copy in copies if copy.chapter == name]
        rows, mistakes = [], []
        for k, task in enumerate(chapter.tasks):
            grades = [copy.grades[k] for copy in own]
            states = Counter(grade.state for grade in grades)
            rows.append([f"{task.number}, {task.name}", *(states[s] for s in STATES if s != UNREADABLE)])
            words = Counter((g.state, g.words) for g in grades if g.state in STATES[1:] and g.words)
            mistakes += [[f"{task.number}, {task.name}", n, *pair] for pair, n in words.most_common()]
        body += [
            f"<h2>{escape(name)}</h2>",
            table(["exercise", *(s for s in STATES if s != UNREADABLE)], rows),
        ]
        body += ["<h3>What went wrong</h3>", table(["exercise", "copies", "grade", "hint"], mistakes)]
    rows = [
        [(file, copy.student), copy.file, copy.chapter, copy.points, ", ".join(g.state for g in copy.grades)]
        for copy, file in zip(copies, names, strict=True)
    ]
    return page(
        "The class",
        [*body, "<h2>Copies</h2>", table(["student", "file", "chapter", "right", "grades"], rows)],
    )


def plain(text: str) -> str:
    """A text that a spreadsheet takes for a text, and not for a formula."""
    return f"'{text}" if text[:1] in tuple("=+-@\t\r") else text


def write(out: Path, copies: list[Copy], chapters: dict[str, Chapter], cage: Cage) -> None:
    """Write all pages and the table."""
    (out / "students").mkdir(parents=True, exist_ok=True)
    for old in (out / "students").glob("[0-9][0-9][0-9]-*.html"):
        old.unlink()  # of another class
    names = []
    for k, copy in enumerate(copies, 1):
        names.append(f"students/{k:03d}-{re.sub(r'[^A-Za-z0-9]+', '-', copy.student)[:60].strip('-')}.html")
        (out / names[-1]).write_text(of_student(copy, chapters), encoding="utf-8", errors="replace")
    of_all = of_class(copies, names, chapters, cage)
    (out / "index.html").write_text(of_all, encoding="utf-8", errors="replace")
    numbers = sorted({int(t.number) for chapter in chapters.values() for t in chapter.tasks})
    with open(out / "grades.csv", "w", newline="", encoding="utf-8-sig", errors="replace") as file:
        table = csv.writer(file)
        table.writerow(
            ["student", "file", "chapter", "right", "of", *(f"exercise {n}" for n in numbers), "unreadable"]
        )
        for copy in copies:
            tasks = chapters[copy.chapter].tasks if copy.chapter else []
            states = {int(t.number): g.state for t, g in zip(tasks, copy.grades, strict=False)}
            why = "" if tasks else copy.grades[0].words
            row = [
                copy.points,
                len(tasks) or "",
                *(states.get(n, "" if tasks else UNREADABLE) for n in numbers),
                why,
            ]
            table.writerow([plain(copy.student), plain(copy.file), copy.chapter, *row])
