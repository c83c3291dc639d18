"""What a chapter's page shows of its code, and what its folds are called.

Out of sight are the lines that only draw, with what a picture says to those who cannot see it (the notebook has them),
calls that only show a laboratory, solutions that only call what the page has, and sentences that point at a fold. A
listing of the package is a link to the page that shows it. Every other fold is named by what is in it.
"""

import ast
import re
from pathlib import Path

import api_pages
from copies import POINTER
from docutils import nodes
from two_ways import cells, draws, tags

LISTED = re.compile(r"# (pfslam(?:\.[a-z]\w*)+)\.([\w.]+)$", re.MULTILINE)  # as `show_source` begins
DEFAULT = "Show the code"  # nb_code_prompt_show
SOLUTION = re.compile(r"solution-(\d+)")


def tidy(app, doctree) -> None:
    """Bring the code of a chapter into the form of the site."""
    if not app.env.docname.startswith("notebooks/"):
        return
    known = set(api_pages.modules(Path(app.srcdir) / "book" / "api.md"))
    for cell in cells(doctree):
        listing = listed(cell, known)
        if listing is not None:
            cell.replace_self(listing)
        elif is_solved_above(cell):
            cell.parent.remove(cell)
        elif source_of(cell) is not None and out_of_sight(cell):
            cell.remove(source_of(cell))
        else:
            name_fold(cell)
            join_answer(cell)
    for line in list(doctree.findall(nodes.paragraph)):
        if line.astext().strip() == POINTER:
            line.parent.remove(line)


def out_of_sight(cell: nodes.container) -> bool:
    """Whether the code of a cell only draws, or only serves a sentence, or only calls for a laboratory."""
    return tags(cell) & {"hide-input", "setup"} == {"hide-input"} or (draws(cell) and only_calls(code(cell)))


def is_solved_above(cell: nodes.container) -> bool:
    """Whether a solution is one call of what the page has, as the words of the exercise say."""
    return any(SOLUTION.fullmatch(tag) for tag in tags(cell)) and only_calls(code(cell))


def source_of(cell: nodes.container) -> nodes.container | None:
    """The part of a cell that holds its code."""
    inner = [child for child in cell.children if "cell_input" in child["classes"]]
    return inner[0] if inner else None


def code(cell: nodes.container) -> str:
    """The code of a cell, "" if the site does not show it."""
    return source.astext() if (source := source_of(cell)) is not None else ""


def only_calls(text: str) -> bool:
    """Whether a cell is one call such as ``ch05.maps_lab()``, and nothing that a reader could change."""
    try:
        body = ast.parse(text).body
    except SyntaxError:  # a magic command
        return False
    return len(body) == 1 and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Call)


def listed(cell: nodes.container, known: set[str]) -> nodes.paragraph | None:
    """A link to what a folded cell lists of the package, None if it lists nothing that has a page."""
    if not tags(cell) & {"hide-output", "hide-cell"}:
        return None
    found = LISTED.search("\n".join(block.astext() for block in cell.findall(nodes.literal_block)))
    if found is None or found[1] not in known:
        return None
    page = f"../_modules/{found[1].replace('.', '/')}.html#{found[2]}"
    line = nodes.paragraph("", "As the package does it: ", classes=["pfslam-package", "pfslam-workshop"])
    line += nodes.reference("", "", nodes.literal("", found[2]), refuri=page, internal=True)
    return line


def name_fold(cell: nodes.container) -> None:
    """A fold says what it hides; the notebook's own words for it come first."""
    if "hide_mode" not in cell or cell.get("prompt_show") != DEFAULT:
        return
    solution = [found[1] for tag in tags(cell) if (found := SOLUTION.fullmatch(tag))]
    if "setup" in tags(cell):
        words = "What this chapter imports"
    elif solution:
        words = f"A solution of exercise {solution[0]}"
    elif "found" in tags(cell):
        words = "How we looked"
    else:
        functions = re.findall(r"^def (\w+)", code(cell), re.MULTILINE)
        words = f"Code: {', '.join(functions) or first_comment(code(cell))}"
    cell["prompt_show"] = cell["prompt_hide"] = words


def join_answer(cell: nodes.container) -> None:
    """How we looked at an open question, and what was found, are one fold and not two."""
    parts = cell.parent
    answer = parts[parts.index(cell) + 1 : parts.index(cell) + 2]
    if "found" in tags(cell) and answer and isinstance(answer[0], nodes.Admonition):
        parts.remove(cell)
        answer[0] += cell
        del cell["hide_mode"]


def first_comment(text: str) -> str:
    """The first comment of some code, or its first line."""
    found = re.search(r"^# ?(.+)$", text, re.MULTILINE)
    return found[1] if found else text.split("\n")[0]


def setup(app):
    app.add_js_file("folds.js", loading_method="defer")
    app.connect("doctree-read", tidy, priority=700)  # the ways are marked by what the cells were
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
