"""Two ways to read a chapter, made by the build from one notebook: *Story* and *Workshop*.

Workshop is everything. Story is prose, laboratories, pictures and equations: what the question of the chapter needs to
be answered. It leaves out

- code, and what code prints, unless the sentence above ends with a colon or asks for a prediction of it;
- goals, exercises, questions with a folded answer, listings of the package;
- what the author has marked: cells with the tag ``workshop``.

A section whose heading stands in a cell with the tag ``aside`` becomes one line, which opens. A code cell with the
tag ``story`` is what a sentence is about, and stays with its code. The doctree gets classes by which ``two_ways.css``
hides, and ``two_ways.js`` is the switch: a page without script is Workshop.
"""

import json
import re

from docutils import nodes

ASIDE, LEFT_OUT, BEGIN, END = "aside", "workshop", "two-ways begin", "two-ways end"
NEVER = {
    LEFT_OUT,
    "hide-cell",
    "listing",
    "setup",
}  # tags of code cells that Story leaves out, whatever they show
ALWAYS_ASIDE = ("Test yourself", "Exercises")
NUMBER = re.compile(r"\d+\.$")
SHOWN = re.compile(r"pfslam-(?:picture|lab|explorer)\b")
HEADING = re.compile(r"^(?=#{2,3} )", re.MULTILINE)
# The page must not be painted in one way and then turn to the other. Readers who have not chosen yet get Story on
# a phone, where nobody works through code, and where laying out the whole chapter takes as long again.
EARLY = """{
  let way = null;
  try {
    way = localStorage.getItem("pfslam:read");
  } catch {}
  way ||= Math.min(screen.width, screen.height) < 600 ? "story" : "workshop";
  if (way === "story") document.documentElement.dataset.read = way;
}"""


def marked(cell: dict) -> str:
    """The text of a Markdown cell with a comment at each mark, which the doctree then has at this place."""
    text, tags = "".join(cell["source"]), cell["metadata"].get("tags", [])
    if ASIDE in tags:
        text = HEADING.sub(f"% {ASIDE}\n\n", text)
    if LEFT_OUT in tags:
        text = f"% {BEGIN}\n\n{text}\n\n% {END}"
    return text


def read_marks(app, docname, source) -> None:
    """Carry the tags of Markdown cells into the doctree."""
    if docname.startswith("notebooks/"):
        notebook = json.loads(source[0])
        for cell in notebook["cells"]:
            if cell["cell_type"] == "markdown":
                cell["source"] = marked(cell)
        source[0] = json.dumps(notebook)


def mark(app, doctree) -> None:
    """Give each part of a chapter the class of its way."""
    if app.env.docname.startswith("notebooks/"):
        follow_marks(doctree)
        awaited = predicted(doctree)
        for cell in cells(doctree):
            if in_exercises(cell):
                continue
            expected = cell in awaited or announced(cell)
            cell["classes"] += way_of(cell, expected)
            if draws(cell) and not expected:
                for printed in cell.findall(nodes.literal_block):
                    printed["classes"].append("pfslam-workshop")
        for part in [*goals(doctree), *questions(doctree)]:
            if not in_exercises(part):
                part["classes"].append("pfslam-workshop")


def follow_marks(doctree) -> None:
    """Turn comments into classes: of the section that follows, or of all blocks between two comments."""
    parts, between, aside, comments = list(doctree.findall()), False, False, []
    for part in parts:
        if isinstance(part, nodes.comment) and part.astext() in (ASIDE, BEGIN, END):
            between = part.astext() == BEGIN
            aside = part.astext() == ASIDE
            comments.append(part)
        elif isinstance(part, nodes.section):
            if aside or part.next_node(nodes.title).astext() in ALWAYS_ASIDE:
                part["classes"].append("pfslam-aside")
            aside = False
        elif between and isinstance(part.parent, nodes.section) and isinstance(part, nodes.Element):
            part["classes"].append("pfslam-workshop")
    for comment in comments:
        comment.parent.remove(comment)


def cells(doctree) -> list[nodes.container]:
    """The code cells of a chapter."""
    return [node for node in doctree.findall(nodes.container) if "cell" in node["classes"]]


def in_exercises(part: nodes.Node) -> bool:
    """Whether a part belongs to a section that, once it is open, is whole in Story too."""
    while part.parent is not None:
        part = part.parent
        if isinstance(part, nodes.section) and part.next_node(nodes.title).astext() in ALWAYS_ASIDE:
            return True
    return False


def tags(cell: nodes.container) -> set[str]:
    """The tags of a code cell."""
    return {name.removeprefix("tag_") for name in cell["classes"] if name.startswith("tag_")}


def way_of(cell: nodes.container, expected: bool) -> list[str]:
    """The class of a code cell: left out of Story, there with its result, or there with its code.

    What it prints is a result where the text has made the reader expect it.
    """
    if "story" in tags(cell):
        return []
    result = draws(cell) or cell.next_node(nodes.table) is not None or expected
    return ["pfslam-result" if result and not tags(cell) & NEVER else "pfslam-workshop"]


def draws(cell: nodes.container) -> bool:
    """Whether a cell shows a picture, an explorer or a laboratory."""
    return any(SHOWN.search(raw.astext()) for raw in cell.findall(nodes.raw))


def prints(cell: nodes.container) -> bool:
    """Whether a cell has an output that is not folded."""
    outputs = [inner for inner in cell.findall(nodes.container) if "cell_output" in inner["classes"]]
    return bool(outputs) and not tags(cell) & NEVER


def announced(cell: nodes.container) -> bool:
    """Whether the sentence above ends with a colon."""
    above = cell.previous_sibling()
    if not isinstance(above, nodes.paragraph) or "pfslam-workshop" in above["classes"]:
        return False
    return prints(cell) and above.astext().rstrip().endswith(":")


def predicted(doctree) -> list[nodes.container]:
    """The first cell with an output after each paragraph that asks for a prediction."""
    found, waiting = [], False
    for node in doctree.findall():
        if isinstance(node, nodes.strong) and node.astext().startswith("Predict first"):
            waiting = True
        elif waiting and isinstance(node, nodes.container) and "cell" in node["classes"] and prints(node):
            found.append(node)
            waiting = False
    return found


def goals(doctree) -> list[nodes.Element]:
    """How to run the chapter, and what one will learn."""
    found = [line for line in doctree.findall(nodes.paragraph) if "pfslam-run" in line["classes"]]
    for line in doctree.findall(nodes.paragraph):
        if line.astext() == "You will learn":
            found += [line, line.next_node(descend=False, siblings=True)]
    return found


def questions(doctree) -> list[nodes.Element]:
    """Every folded answer, with the question above it, which begins with a bold number."""
    found = []
    for answer in [node for node in doctree.findall(nodes.Admonition) if "dropdown" in node["classes"]]:
        parts, above = [answer], answer.previous_sibling()
        while isinstance(above, nodes.Element) and not isinstance(above, nodes.title | nodes.Admonition):
            parts.append(above)
            bold = above.next_node(nodes.strong)
            if bold is not None and NUMBER.match(bold.astext()) and above.astext().startswith(bold.astext()):
                found += parts
                break
            above = above.previous_sibling()
        else:
            found.append(answer)
    return found


def load(app, pagename, templatename, context, doctree) -> None:
    """Chapters load the switch."""
    if pagename.startswith("notebooks/"):
        app.add_js_file(None, body=EARLY)
        app.add_js_file("two_ways.js", loading_method="defer", priority=400)
        app.add_css_file("two_ways.css", priority=900)


def setup(app):
    app.connect("source-read", read_marks)
    app.connect("doctree-read", mark, priority=600)  # after the line about how to run the chapter is there
    app.connect("html-page-context", load)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
