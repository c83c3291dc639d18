"""Slides of a chapter, made by the build from marks in its notebook: raw cells with the tag ``slides``.

    # The headline, a sentence
    Text for the screen, in the same Markdown as the chapter, with {eval} and formulas.
    1. an answer of a poll
    2. another one
    . . .
    What comes at the next key press.
    @fig-name         the chapter's figure of this name, as this build drew it
    @lab-name         its laboratory, alive (@lab-name-2 is the second of this name)
    @eq-5             its equation with this number
    Note: 4 min. What only the lecturer sees.
    ---
    # The headline of the next slide

Raw cells are no words of the chapter, and the copies leave them out. ``slides/05.html`` is the set of chapter 05.
"""

import json
import re
import shutil
from html import escape
from importlib.metadata import files
from pathlib import Path

from docutils import nodes
from pfslam_book.show import lab
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

TAG = "slides"
PACKAGE = "sphinx-revealjs"  # it carries reveal.js whole
VENDORED = ("dist/reveal.js", "dist/reveal.css", "plugin/notes/notes.js", "revealjs/LICENSE")
OWN = Path(__file__).with_name("slides_site")
SHOW = re.compile(r"^@(fig|lab|eq)-(\w[\w-]*)$", re.MULTILINE)
LABORATORY = re.compile(r'class="pfslam-lab" data-lab="(\w+)"')
logger = logging.getLogger(__name__)


class slide(nodes.General, nodes.Element):
    """One slide: its headline, its parts, its notes. It is taken from the chapter before that is written."""


class show(nodes.General, nodes.Element):
    """The place of a figure, laboratory or equation of the chapter, by ``kind`` and ``name``."""


def split(text: str) -> list[dict]:
    """The slides of a cell: each with its ``headline``, its ``parts``, one for a key press, and its ``notes``."""
    found = []
    for one in re.split(r"^---$", text, flags=re.MULTILINE):
        shown, _, notes = one.partition("\nNote:")
        headline, _, body = shown.strip().partition("\n")
        parts = [part.strip() for part in re.split(r"^\. \. \.$", body, flags=re.MULTILINE)]
        found.append({"headline": headline.lstrip("# "), "parts": parts, "notes": notes.strip()})
    return found


def marked(notebook: dict) -> list[dict]:
    """The slides of a chapter, in their order."""
    cells = [cell for cell in notebook["cells"] if TAG in cell["metadata"].get("tags", [])]
    return [one for cell in cells for one in split("".join(cell["source"]))]


def read_marks(app, docname, source) -> None:
    """Let the marks be read where they stand, so that a number on a slide is the one of its place in the chapter."""
    if docname.startswith("notebooks/"):
        notebook = json.loads(source[0])
        for cell in notebook["cells"]:
            if TAG in cell["metadata"].get("tags", []):
                text = "".join(cell["source"])
                cell |= {"cell_type": "markdown", "source": f"`````````{{slides}}\n{text}\n`````````"}
        source[0] = json.dumps(notebook)


class Slides(SphinxDirective):
    """``{slides}``: what a raw cell has marked, as nodes."""

    has_content = True

    def run(self):
        self.env.temp_data[TAG] = True  # the numbers of the slides are none of the chapter's sentences
        found = [self.one(**parts) for parts in split("\n".join(self.content))]
        self.env.temp_data[TAG] = False
        return found

    def one(self, headline: str, parts: list[str], notes: str) -> slide:
        """One slide as nodes: a headline, one container for each key press, the notes."""
        made = slide("", nodes.container("", *self.parse_text_to_nodes(headline), classes=["headline"]))
        for number, part in enumerate(parts):
            made += nodes.container("", *self.pieces(part), classes=["fragment"] if number else ["at-once"])
        made += nodes.container("", *self.parse_text_to_nodes(notes), classes=["notes"])
        return made

    def pieces(self, part: str) -> list[nodes.Node]:
        """The text of a part, with a place for each thing that it shows."""
        between, found = SHOW.split(part), []
        for k in range(0, len(between), 3):
            found += self.parse_text_to_nodes(between[k]) if between[k].strip() else []
            found += [show(kind=between[k + 1], name=between[k + 2])] if k + 2 < len(between) else []
        return found


def laboratories(doctree) -> dict[str, nodes.Node]:
    """The laboratories of a chapter by their names, a second one of a kind as ``name-2``."""
    found: dict[str, nodes.Node] = {}
    for raw in doctree.findall(nodes.raw):
        for name in LABORATORY.findall(raw.rawsource or raw.astext()):
            same = sum(other.split("-")[0] == name for other in found)
            found[f"{name}-{same + 1}" if same else name] = raw
    return found


def figures(doctree) -> dict[str, nodes.Node]:
    """The figures of a chapter by their names, each without its caption."""
    found = {}
    for figure in doctree.findall(nodes.figure):
        picture = [child.deepcopy() for child in figure if not isinstance(child, nodes.caption)]
        for name in figure["names"]:
            found[name.removeprefix("fig-")] = nodes.container("", *picture)
    return found


def equations(doctree) -> dict[str, nodes.Node]:
    """The numbered equations of a chapter by their numbers."""
    labels = {block: block.get("label") or "" for block in doctree.findall(nodes.math_block)}
    return {label.removeprefix("eq-"): block for block, label in labels.items() if label}


def fill(docname: str, doctree, made: list[slide]) -> None:
    """Put what the slides name into its places."""
    known = {"fig": figures(doctree), "lab": laboratories(doctree), "eq": equations(doctree)}
    for place in [place for one in made for place in one.findall(show)]:
        kind, name = place["kind"], place["name"]
        if name not in known[kind]:
            logger.warning("slides name %s-%s, which the chapter does not have", kind, name, location=docname)
        shown = [known[kind][name].deepcopy()] if name in known[kind] else []
        place.replace_self(nodes.container("", *shown, classes=["shown", f"shown-{kind}"]))


def section(builder, made: slide) -> str:
    """One slide as HTML."""
    headline, *parts, notes = (builder.render_partial(child)["fragment"] for child in made.children)
    headline = re.sub(r"</?(?:div|p)\b[^>]*>", "", headline).strip()
    shown = f'<div class="slide">\n<h2>{headline}</h2>\n{"".join(parts)}</div>'
    return f'<section>{shown}\n<aside class="notes">{notes}</aside></section>'


def write_set(app, doctree, docname) -> None:
    """Take the slides from a chapter, write them as a page of their own, and let the chapter say where it is."""
    made = list(doctree.findall(slide))
    for one in made:
        one.parent.remove(one)
    if not made or app.builder.format != "html":
        return
    fill(docname, doctree, made)
    title = next(iter(doctree.findall(nodes.title))).astext()
    number = title.split()[0]
    sections = "\n".join(section(app.builder, one) for one in made)
    names = dict.fromkeys(LABORATORY.findall(sections))
    scripts = [f"labs/{script}" for script in dict.fromkeys(s for name in names for s in lab.scripts(name))]
    page = (OWN / "page.html").read_text(encoding="utf-8")
    words = {
        "TITLE": escape(title),
        "CHAPTER": f"../{docname}.html",
        "SECTIONS": sections,
        "SCRIPTS": "\n".join(f'<script src="../_static/{script}"></script>' for script in scripts),
    }
    page = re.sub(r"\{\{(\w+)\}\}", lambda found: words[found[1]], page)
    target = Path(app.outdir) / "slides" / f"{number}.html"
    target.parent.mkdir(exist_ok=True)
    target.write_text(page, encoding="utf-8", newline="\n")
    for line in doctree.findall(nodes.paragraph):
        if "pfslam-run" in line["classes"]:
            line += nodes.Text(". For a lecture: ")
            line += nodes.reference("", "slides", refuri=f"../slides/{number}.html", internal=True)


def copy_files(app) -> None:
    """The script and the style of the slides, and reveal.js with its licence, into the site."""
    if app.builder.format == "html":
        target = Path(app.outdir) / "_static" / "slides"
        target.mkdir(parents=True, exist_ok=True)
        vendored = [entry.locate() for entry in files(PACKAGE) or [] if str(entry).endswith(VENDORED)]
        for source in [*vendored, OWN / "slides.js", OWN / "slides.css"]:
            shutil.copyfile(source, target / Path(source).name)


def setup(app):
    app.add_node(slide)
    app.add_node(show)
    app.add_directive(TAG, Slides)
    app.connect("source-read", read_marks)
    app.connect("doctree-resolved", write_set)
    app.connect("builder-inited", copy_files)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
