"""The table of misconceptions on the page for teachers, drawn from the tags of the chapters' cells.

A cell tagged ``m33`` meets entry 33 of ``misconceptions.yml``. Nothing is listed that no cell meets.
"""

import json
import re
from pathlib import Path

import yaml
from sphinx.util.docutils import SphinxDirective

TAG = re.compile(r"m(\d+)")


def met_in(notebooks: Path) -> dict[int, list[tuple[str, str]]]:
    """For each number, where it is met: (chapter's file name, heading above the cell), in reading order."""
    found: dict[int, list[tuple[str, str]]] = {}
    for path in sorted(notebooks.glob("*.ipynb")):
        heading = ""
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] == "markdown":
                for line in "".join(cell["source"]).splitlines():
                    heading = line.lstrip("# ") if re.match(r"#{1,3} ", line) else heading
            for tag in cell["metadata"].get("tags", []):
                if match := TAG.fullmatch(tag):
                    places = found.setdefault(int(match[1]), [])
                    if (path.stem, heading) not in places:
                        places.append((path.stem, heading))
    return found


def load_misconceptions(path: Path) -> dict[int, tuple[str, str]]:
    """Number: (what is believed, what is then seen)."""
    return {
        number: tuple(words) for number, words in yaml.safe_load(path.read_text(encoding="utf-8")).items()
    }


def table(source: Path) -> str:
    """The table as Markdown: belief, sight, chapters."""
    words, rows = load_misconceptions(source / "book" / "misconceptions.yml"), []
    for number, places in sorted(met_in(source / "notebooks").items()):
        links = ", ".join(f"[{stem[:2]} {heading}](../notebooks/{stem}.ipynb)" for stem, heading in places)
        rows.append("| {} | {} | {} |".format(*words[number], links))
    head = "| what some learners believe | what they then see | where the book meets it |\n|---|---|---|\n"
    return f"{len(rows)} of the {len(words)} we collected are met in the chapters.\n\n{head}" + "\n".join(
        rows
    )


class Misconceptions(SphinxDirective):
    """``{misconceptions}``: the table, as the notebooks stand."""

    def run(self):
        source = Path(self.env.srcdir)
        for path in [*(source / "notebooks").glob("*.ipynb"), source / "book" / "misconceptions.yml"]:
            self.env.note_dependency(str(path))
        return self.parse_text_to_nodes(table(source))


def setup(app):
    app.add_directive("misconceptions", Misconceptions)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
