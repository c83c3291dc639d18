"""What a class has handed in: whose copy is where, and what can be read of it."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from copies import CHECK, number, source

from grading.judge import RIGHT, UNREADABLE, Grade

LONGEST = 50 * 2**20
"""A file that is longer (bytes) is not read: a copy with all its pictures has a tenth of it."""


@dataclass
class Copy:
    """A copy that a student has handed in: ``cells`` of code with their text and the number of a check."""

    student: str
    file: str
    cells: list[dict] = field(default_factory=list)
    chapter: str = ""
    grades: list[Grade] = field(default_factory=list)

    @property
    def points(self) -> int:
        """How many exercises are right."""
        return sum(grade.state == RIGHT for grade in self.grades)


def find(folder: Path) -> list[Copy]:
    """All copies in a folder, by student; a student without any has one that is unreadable."""
    while len(inside := visible(folder)) == 1 and inside[0].is_dir() and holds_a_class(inside[0]):
        folder = inside[0]  # a zip often holds one folder with everything
    copies = []
    for entry in inside:
        files = [entry] if not entry.is_dir() or entry.is_symlink() else below(entry)
        notebooks = [file for file in files if ".ipynb" in file.name.lower()] or files[:1]
        copies += [read(entry, file, folder) for file in notebooks] or [
            unreadable(entry, "", "There is nothing in this folder.")
        ]
    return copies


def holds_a_class(folder: Path) -> bool:
    """Whether the only folder that was handed in is no student's: it has folders, or several notebooks."""
    inside = visible(folder)
    return any(map(Path.is_dir, inside)) or sum(path.suffix == ".ipynb" for path in inside) > 1


def visible(folder: Path) -> list[Path]:
    """What is in a folder, by name, without what systems and editors leave there."""
    return sorted(p for p in folder.iterdir() if not p.name.startswith((".", "__MACOSX")))


def below(folder: Path) -> list[Path]:
    """All files below a folder, by name; links are not followed."""
    found = []
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__MACOSX")))
        found += [Path(place, name) for name in sorted(files) if not name.startswith(".")]
    return found


def unreadable(entry: Path, file: str, why: str) -> Copy:
    """A copy of which nothing can be said but why."""
    return Copy(entry.name.partition(".ipynb")[0], file, grades=[Grade(UNREADABLE, why)])


def read(entry: Path, file: Path, folder: Path) -> Copy:
    """The copy in a file; an unreadable one says what is the matter with it."""
    name = str(file.relative_to(folder))
    if file.is_symlink() or not file.is_file():
        return unreadable(entry, name, "This is a link or a device, and not a file.")
    if (size := file.stat().st_size) > LONGEST or size == 0:
        return unreadable(
            entry, name, f"The file has {size / 2**20:.0f} MB." if size else "The file is empty."
        )
    try:
        text = file.read_text(encoding="utf-8-sig")
        if any(line.startswith(("<<<<<<< ", ">>>>>>> ")) for line in text.splitlines()):
            return unreadable(
                entry, name, "Two versions were merged and the marks <<<<<<< are still in the file."
            )
        cells = [
            {"source": source(cell).strip(), "check": number({"metadata": metadata(cell)}, CHECK) or ""}
            for cell in json.loads(text)["cells"]
            if cell["cell_type"] == "code"
        ]
    except OSError as error:
        return unreadable(entry, name, f"The file cannot be read: {error.strerror}.")
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return unreadable(entry, name, "The file is no notebook, or a broken one.")
    copy = unreadable(entry, name, "No cell of any chapter is in it.")
    copy.cells = cells
    return copy


def metadata(cell: dict) -> dict:
    """The tags of a cell as far as they are text."""
    found = cell.get("metadata")
    tags = found.get("tags", []) if isinstance(found, dict) else []
    return {"tags": [tag for tag in tags if isinstance(tag, str)] if isinstance(tags, list) else []}


def chapter_of(copy: Copy, notebooks: Path) -> str:
    """The chapter with which a copy has most of its cells in common, empty if none."""
    cells = {cell["source"] for cell in copy.cells}
    common = {name: len(cells & printed) for name, printed in chapters(notebooks).items()}
    best = max(common, key=lambda name: common[name])
    return best if common[best] else ""


@cache
def chapters(notebooks: Path) -> dict[str, frozenset[str]]:
    """The code cells of each chapter, without those that other chapters have as well."""
    cells = {
        path.stem: {
            source(c).strip()
            for c in json.loads(path.read_text(encoding="utf-8"))["cells"]
            if c["cell_type"] == "code"
        }
        for path in sorted(notebooks.glob("*.ipynb"))
    }
    return {
        name: frozenset(own - set().union(*(other for key, other in cells.items() if key != name)))
        for name, own in cells.items()
    }
