"""The tables on the page for teachers: words and exercises as they stand, and what a kernel needs, as measured."""

import csv
import json
import re
import tomllib
from pathlib import Path

from sphinx.util.docutils import SphinxDirective

TABLE = Path("book/tables/classroom.csv")
WORDS_PER_MINUTE = 120  # a text with equations and code is read at half the speed of a novel
MINUTES_PER_WIDGET = 4
MINUTES_PER_EXERCISE = 10


def content(notebook: dict) -> dict[str, int]:
    """Count words of prose, widgets and laboratories (by their saved outputs), and exercises."""
    cells = notebook["cells"]
    prose = " ".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    shown = str([cell["outputs"] for cell in cells if cell["cell_type"] == "code"])
    tags = [tag for cell in cells for tag in cell["metadata"].get("tags", [])]
    return {
        "words": len(prose.split()),
        "widgets": shown.count("[explorer: ") + shown.count("[laboratory: "),
        "exercises": sum(bool(re.fullmatch(r"exercise-\d+", tag)) for tag in tags),
    }


def minutes(row: dict) -> int:
    """Minutes to plan for one chapter in class, to the next five."""
    plain = int(row["words"]) / WORDS_PER_MINUTE
    plain += MINUTES_PER_WIDGET * int(row["widgets"]) + MINUTES_PER_EXERCISE * int(row["exercises"])
    return 5 * -(-round(plain) // 5)


def read(path: Path, notebooks: list[Path]) -> list[dict]:
    """A row for each chapter: counted as it stands, and what ``measure_classroom.py`` stored."""
    with open(path, encoding="utf-8", newline="") as file:
        measured = {row["chapter"]: row for row in csv.DictReader(file)}
    return [measured[p.stem] | content(json.loads(p.read_text(encoding="utf-8"))) for p in notebooks]


def chapters_table(rows: list[dict]) -> str:
    """One line per chapter and their sum, as Markdown."""
    lines = [
        "| chapter | words | wid~gets | exer~cises | plan [min] | start [s] | run [s] | mem~ory [MB] |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        link = f"[{row['chapter'].replace('_', ' ')}](../notebooks/{row['chapter']}.ipynb)"
        cells = [link, row["words"], row["widgets"], row["exercises"], minutes(row)]
        cells += [row["startup_s"], row["run_s"], row["memory_mb"]]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    total = sum(map(minutes, rows))
    lines.append(f"| **all** | | | | **{total}** | | | |")
    return "\n".join(lines).replace("~", "\u00ad")  # a soft hyphen, where a heading may be parted on a phone


def server_text(rows: list[dict], students: int = 40) -> str:
    """What a server for a class needs if everyone runs the same, most demanding chapter at once."""
    memory = max(int(row["memory_mb"]) for row in rows)
    longest = max(float(row["run_s"]) for row in rows)
    return (
        f"The most that any chapter's kernel held is {memory} MB, so {students} of them at once need "
        f"{students * memory / 1024:.0f} GB. The longest chapter keeps one core busy for {longest:.0f} s; "
        f"if all {students} students press *Run All* in the same minute, {students * longest / 60:.0f} core-minutes "
        f"are waiting, which eight cores work off in about {students * longest / 60 / 8:.0f} minutes. "
        "Cell by cell, as people work, nobody notices anybody."
    )


EXERCISE = re.compile(r"\*\*((?:Exercise|Explore)\b[^*]*)\*\*")
ASKED = re.compile(r"^(?:def )?(\w+)(?=\(| =)", re.MULTILINE)


def exercises(notebook: dict) -> tuple[list[str], list[str], int]:
    """What a chapter asks for by name, what of it goes into the reader's filter, and how many open exercises it has."""
    asked, kept, open_ones, heading = [], [], 0, ""
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            found = EXERCISE.findall(text)
            heading = found[-1] if found else heading
            open_ones += sum("explore" in words.lower() or "open" in words for words in found)
        elif any(re.fullmatch(r"exercise-\d+", tag) for tag in cell["metadata"].get("tags", [])):
            asked += ASKED.findall(text)[:1]
            kept += ASKED.findall(text)[:1] if "your filter" in heading else []
    return asked, kept, open_ones


def exercises_table(notebooks: list[Path]) -> str:
    """One line per chapter: what is written, what of it goes into the reader's filter, how much is open."""
    lines = ["| chapter | what is written | into your filter | open |", "|---|---|---|--:|"]
    for path in notebooks:
        asked, kept, open_ones = exercises(json.loads(path.read_text(encoding="utf-8")))
        names = [", ".join(f"`{name}`" for name in some) for some in (asked, kept)]
        link = f"[{path.stem.replace('_', ' ')}](../notebooks/{path.name})"
        lines.append(f"| {link} | {names[0]} | {names[1]} | {open_ones} |")
    return "\n".join(lines)


def exams_table(questions: dict[str, dict]) -> str:
    """How many questions for exams there are of each chapter and level, and how many have numbers that change."""
    levels = ("remember", "apply", "analyse")
    lines = ["| chapter | remember | apply | analyse | with numbers |", "|---|--:|--:|--:|--:|"]
    for chapter in sorted({name[:2] for name in questions}) + [""]:
        own = [question for name, question in questions.items() if name.startswith(chapter)]
        counts = [sum(question["level"] == level for question in own) for level in levels]
        counts.append(sum(question.get("numbers", False) for question in own))
        lines.append("| " + " | ".join([chapter or "**all**", *map(str, counts)]) + " |")
    return "\n".join(lines)


class Classroom(SphinxDirective):
    """``{classroom} chapters``, ``server``, ``exercises`` or ``exams``."""

    required_arguments = 1

    def run(self):
        notebooks = sorted((Path(self.env.srcdir) / "notebooks").glob("*.ipynb"))
        stored = Path(self.env.srcdir) / TABLE
        for path in [*notebooks, stored]:
            self.env.note_dependency(str(path))
        if self.arguments[0] == "exercises":
            return self.parse_text_to_nodes(exercises_table(notebooks))
        if self.arguments[0] == "exams":
            asked = Path(self.env.srcdir) / "teachers" / "exam.toml"
            self.env.note_dependency(str(asked))
            return self.parse_text_to_nodes(exams_table(tomllib.loads(asked.read_text(encoding="utf-8"))))
        make = {"chapters": chapters_table, "server": server_text}[self.arguments[0]]
        return self.parse_text_to_nodes(make(read(stored, notebooks)))


def setup(app):
    app.add_directive("classroom", Classroom)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
